"""Exact derivatives of the inverse dynamics along motions that keep the loops closed.

T = dq/dx' are the joint rates for unit rates of the platform's coordinates x. G = n T_a are the motors'
speeds for these rates, with the gear ratio n. r are the forces of the open tree, J is the Jacobian of the
loop equations and lambda are the loop forces (`forces`). The motor torques t solve G' t = T' (r + rotors),
and their changes solve

    G' dt = T' d(r + rotors - J' lambda)          at fixed lambda.

The right side needs the change of the forces (`forces.driven_force_changes`) along the change of the joints'
motion (`coordinate_changes`). G' is singular at Type 2. With redundant motors the part of t that drives
bodies is the solution of least norm, t = G k with k (n,), and dt = dG k + G dk.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from framework.dynamics.body_parameters import body_parameters, tree_regressor
from framework.dynamics.forces import (
    driven_force_changes,
    joint_forces,
    least_motor_torques,
    motor_torque,
)
from framework.dynamics.platform_wrench import motor_speeds
from framework.dynamics.pointwise_dynamics import prescribed_motion, require_hold
from framework.kinematics.linearised_loops import ClosedStack
from framework.kinematics.motion_rates import Motion, coordinate_changes, motion_at, require_turns_at_rest
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays, read_only


@dataclass(frozen=True, eq=False)
class DynamicsDerivatives(ReadOnlyArrays):
    """Motor torques at one instant and their derivatives; at T instants, T is the first axis of all arrays.

    Torques are on the motor side, with rotors, armature, and damping and springs of joints. Each derivative
    varies one of the platform's coordinates x, their rates and their accelerations, and keeps the others.
    """

    torque: Array  # (n_a,) [N m, N] as `dynamics_at` gives it
    torque_x: Array  # (n_a, n) per m, rad
    torque_dx: Array  # (n_a, n) per m/s, rad/s
    torque_ddx: Array  # (n_a, n) per m/s2, rad/s2
    _robot: ParallelRobot = field(repr=False)
    _motion: Motion = field(repr=False)  # of T instants, T = 1 for one

    @property
    def parameters(self) -> tuple[str, ...]:
        """The names of the p inertial parameters of all bodies, such as LINK.mass."""
        return body_parameters(self._robot)[0]

    @cached_property
    def regressor(self) -> Array:
        """The derivatives (n_a, p) of the torques by the parameters, computed on first use."""
        G, rates = motor_speeds(self._robot, self._motion.linearised)
        # (T, n, p) wrenches on the platform for unit parameters, (dq/dv)' Y
        wrenches = rates.swapaxes(1, 2) @ tree_regressor(self._robot, self._motion)
        stack = least_motor_torques(self._robot, G.swapaxes(1, 2), wrenches)
        return read_only(stack if self.torque.ndim == 2 else stack[0])


def dynamics_derivatives(
    robot: ParallelRobot,
    q: ArrayLike,
    *,
    dx: ArrayLike | None = None,
    ddx: ArrayLike | None = None,
    wrenches: Mapping[str, ArrayLike] | None = None,
) -> DynamicsDerivatives:
    """Compute the derivatives of the torques of `dynamics_at` at an assembled configuration q (nq,).

    When x varies, all joints follow with closed loops. An elastic robot keeps the deflections of q, as in
    `dynamics_at`. External wrenches keep their components on base axes and move with their frames.

    Args:
        q: assembled configuration, as returned by `assemble`; or a stack of T instants (T, nq).
        dx, ddx: rates (n,) and accelerations (n,) of the platform coordinates, 0 by default; or (T, n).
        wrenches: external wrenches (6,) or (T, 6) [N, N m] by URDF link or joint, see `dynamics_at`.

    Raises:
        InvalidInput: as `dynamics_at`; or damping or armature of balls drives an idle turn.
        NotAssembled: the platform does not determine the joints at this pose (Type 1).
        SingularPose: the pose is singular of Type 2, where torques and their derivatives have a pole;
            `forward_derivatives` is regular there.
    """
    prescribed = prescribed_motion(robot, q, dx=dx, ddx=ddx, wrenches=wrenches)
    require_turns_at_rest(robot)
    motion = prescribed.motion
    require_hold(robot, motion.linearised, prescribed.x)
    rate, acceleration, _ = prescribed.rates
    changes = coordinate_changes(robot, motion, robot.structure.idle, (prescribed.x, rate, acceleration))
    motions = changes.q[:, : robot.n]  # (T, n, nv) T', joint rates for unit rates of x
    speeds = robot.gear_ratio * motions[..., robot.actuated]  # (T, n, n_a) G'
    joint_torque = joint_forces(robot, motion).joint_torque

    # slopes (3, T, n_a, k) of the torques by x, dx and ddx: those of the rotors and, if redundant, dG k
    accelerations = changes.accelerations[..., robot.actuated]
    slopes = (robot.rotor_inertia * robot.gear_ratio * accelerations).swapaxes(2, 3)
    if robot.n_a > robot.n:
        slopes[0, ..., : robot.n] += _redundant_torque_changes(
            robot, motion, prescribed.x, speeds, joint_torque
        )
    # the motors balance the other part of the wrench T' d(r + rotors - J' lambda) on the platform
    force_change = driven_force_changes(robot, motion, joint_torque, changes).swapaxes(2, 3)
    slopes += least_motor_torques(robot, speeds, motions @ force_change - speeds @ slopes)

    slopes = slopes[:, prescribed.entry, ..., : robot.n]  # without idle joints
    return DynamicsDerivatives(
        torque=motor_torque(robot, motion, joint_torque)[prescribed.entry],
        torque_x=slopes[0],
        torque_dx=slopes[1],
        torque_ddx=slopes[2],
        _robot=robot,
        _motion=motion,
    )


def _redundant_torque_changes(
    robot: ParallelRobot, motion: Motion, x: Array, speeds: Array, joint_torque: Array
) -> Array:
    """Compute dG k (T, n_a, n) of redundant motors by unit steps of x (T, n), at constant k.

    The torques t = G k of least norm are computed like the motors' speeds at the rates k of x. So dG k is the
    change of these speeds at constant rates.

    Args:
        motion: the motion at the T instants, of which only the positions count.
        x: platform coordinates.
        speeds: G' (T, n, n_a).
        joint_torque: torques (T, n_a) on the joint side, without those of the rotors.
    """
    torque = joint_torque / robot.gear_ratio
    k = (np.linalg.pinv(speeds.swapaxes(1, 2)) @ torque[..., None])[..., 0]
    at_rest = np.zeros_like(k)
    motion_at_k = motion_at(robot, ClosedStack(motion.q, x, motion.linearised), k, at_rest)
    changes = coordinate_changes(robot, motion_at_k, robot.structure.idle, (x, k, at_rest))
    return (robot.gear_ratio * changes.v[:, : robot.n, robot.actuated]).swapaxes(1, 2)
