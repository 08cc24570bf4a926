"""Generalised forces of the open tree, and what the loops, the springs and the motors make of them.

With r = RNEA(q, v, a) of the tree and the loop equations' Jacobian J,

    passive    0           = r_p - P' lambda           P = J's passive columns
    elastic    -K q_e      = r_e - J_e' lambda         the paper's Eq. (3b)
    actuated   tau_joint   = r_a - J_a' lambda         Eq. (3a) without the rotors

At a Type 2 singularity P eta = 0, so lambda exists only if eta . r_p = 0: condition (8) with the inertia
of all bodies, legs included. With massless legs eta . r_p = t_s . W_p, the paper's form.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin

from framework.arrays import Array
from framework.kinematics.frames import difference, scratch_of
from framework.kinematics.inverse_kinematics import Motion, System, without_elastic_rates
from framework.kinematics.parallel_robot import ParallelRobot
from framework.linalg.ordered_sums import solve


class Forces(NamedTuple):
    """Forces at T instants; joint side of the gears, rotors not included."""

    joint_torque: Array  # (T, n_a) [N m] or [N]
    spring_force: Array  # (T, n_e) force of the springs on the elastic coordinates, -K q_e


class JointMotion(Protocol):
    """Positions q (T, nq), velocities v and accelerations a (T, nv) of all joints."""

    @property
    def q(self) -> Array: ...
    @property
    def v(self) -> Array: ...
    @property
    def a(self) -> Array: ...


def tree_forces(robot: ParallelRobot, motion: JointMotion) -> Array:
    """RNEA of the open tree and the springs on its own joints, (T, nv).

    Of a robot without `elastic_inertia` at the rates that its platform's motion alone makes.
    """
    if robot.n_e and not robot.elastic_inertia:
        motion = without_elastic_rates(robot, motion.q, motion.v, motion.a)
    model, data = robot.model, scratch_of(robot).data
    forces: Array = np.empty((len(motion.q), model.nv))
    for k, (q, v, a) in enumerate(zip(motion.q, motion.v, motion.a, strict=True)):
        forces[k] = pin.rnea(model, data, q, v, a)
    if robot.has_joint_springs:
        turned = difference(robot, pin.neutral(model), motion.q)
        forces = forces + np.asarray(robot.joint_stiffness * (turned - robot.joint_rest), dtype=float)
    return forces


def loop_forces(robot: ParallelRobot, motion: Motion) -> Forces:
    """Joint torques and spring forces along a motion, instant by instant; see `balanced_forces`."""
    return balanced_forces(robot, motion.system, tree_forces(robot, motion))


def balanced_forces(robot: ParallelRobot, system: System, r: Array) -> Forces:
    """What motors and springs give so that the loops can carry the forces r (T, nv) of the open tree.

    The loops close with the platform held by a wrench w and free motors, or by the motors alone:

        F' [w; lambda_0] = r        F' [M; ...] = unit torques of the motors        M tau = w

    with F = d[platform ; closures]/dq along the joints that follow, regular at Type 2 and factored when
    they moved, and M (n, n_a) = (dq_a/dx)', which is singular there. With redundant motors the sum of
    squares of tau_joint / gear ratio is least. An instant exactly on a Type 2 singularity divides 0 by 0
    and comes out as infinite.
    """
    columns = robot.moving  # the actuated ones first
    loads = np.zeros((1 + robot.n_a, len(r), len(columns)))
    loads[0] = r.take(columns, axis=1)
    loads[1:, :, : robot.n_a] = np.eye(robot.n_a)[:, None]
    carried = system.factors.solve_transposed(loads)
    wrench, matrix = carried[0, :, : robot.n], carried[1:, :, : robot.n].transpose(1, 2, 0)
    torque = _motor_share(robot, matrix, wrench)
    if not robot.n_e:
        return Forces(torque, np.zeros((len(r), 0)))
    with np.errstate(invalid="ignore"):  # an infinite torque leaves no number
        multipliers = carried[0] - np.einsum("atk,ta->tk", carried[1:], torque)
    multipliers[:, : robot.n] = 0.0  # nobody holds the platform
    held = system.equations.elastic.transposed_times(system.entries, multipliers)
    return Forces(torque, r[:, robot.elastic] - held)


def _motor_share(robot: ParallelRobot, matrix: Array, wrench: Array) -> Array:
    """Joint torques (T, n_a) with matrix (T, n, n_a) @ torque = wrench (T, n)."""
    if robot.n_a > robot.n:
        geared = matrix * robot.gear_ratio
        return robot.gear_ratio * np.einsum("tan,tn->ta", np.linalg.pinv(geared), wrench)
    return solve(matrix, wrench)


def motor_torque(robot: ParallelRobot, motion: Motion, joint_torque: Array) -> Array:
    """Torque (T, n_a) [N m] on the motor side: rotor inertia and joint torque through the gear.

    tau = I_a n ddq_a + tau_joint / n, Eqs. (3a) and (11c), with n the gear ratio and ddq_a on the
    joint side.
    """
    n = robot.gear_ratio
    return robot.rotor_inertia * n * motion.a[:, robot.actuated] + joint_torque / n
