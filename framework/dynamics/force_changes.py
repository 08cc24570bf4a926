"""First-order changes of the forces that motors and loops balance, for changes of a motion.

With the forces r of the open tree less the external ones, the Jacobian J of the loop equations and constant
loop forces lambda,

    d(r - J' lambda) = dr/dq dq + dr/dv dv + M da - (d(J' lambda)/dq) dq.

lambda may stay constant because J' dlambda does no work along motions that keep the loops closed. dr/dq,
dr/dv and M come from pinocchio's `computeRNEADerivatives`, d(J' lambda)/dq dq from `loop_force_changes`.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from framework.kinematics.closures import loop_force_changes
from framework.kinematics.external_wrenches import wrench_slope
from framework.kinematics.frames import forces_on_joints_slope, scratch_of
from framework.kinematics.motion_rates import Motion, MotionChanges
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array


def force_slopes(robot: ParallelRobot, motion: Motion) -> tuple[Array, Array, Array]:
    """Compute the derivatives of `tree_forces` by q, v and a, each (T, nv, nv).

    Derivatives by q are with respect to tangent vectors of pinocchio's configurations. The derivative by a is
    the mass matrix with armature, without rotors.
    """
    data, nv = scratch_of(robot).data, robot.nv
    by_q, by_v, by_a = np.empty((3, len(motion.q), nv, nv))
    for k, (q, v, a) in enumerate(zip(motion.q, motion.v, motion.a, strict=True)):
        pin.computeRNEADerivatives(robot.model, data, q, v, a)
        by_q[k], by_v[k], by_a[k] = data.dtau_dq, data.dtau_dv, data.M
    if robot.joint_stiffness.any():
        by_q += forces_on_joints_slope(robot, robot.neutral, motion.q, robot.joint_stiffness)
    by_v += np.diag(robot.joint_damping)
    for wrench in motion.wrenches:
        by_q -= wrench_slope(robot, motion.linearised.frames.screws, wrench)
    return by_q, by_v, by_a


def force_changes(robot: ParallelRobot, motion: Motion, multipliers: Array, changes: MotionChanges) -> Array:
    """Compute d(r - J' lambda) (3, T, k, nv) for k steps of positions, of rates and of accelerations.

    A step of positions with closed loops also changes rates and accelerations, and a step of rates also
    changes accelerations.

    Args:
        multipliers: (T, m) the constant lambda of the independent loop equations.
    """
    linearised, dq = motion.linearised, changes.q
    by_q, by_v, mass = force_slopes(robot, motion)
    wrenches = linearised.wrenches[:, robot.n :]  # of the loop equations
    of_loops = loop_force_changes(robot, robot.loops, linearised.frames, wrenches, multipliers, dq)
    forces = changes.accelerations @ mass  # changes are rows, so matrices are transposed and on the right
    forces[:2] += np.stack([changes.v, dq]) @ by_v.swapaxes(1, 2)  # steps of positions and of rates
    forces[0] += dq @ by_q.swapaxes(1, 2) - of_loops  # steps of positions
    return forces
