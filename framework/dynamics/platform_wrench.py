"""The wrench on the platform that a motion requires, and the wrenches that the motors can exert.

Along a virtual twist v of the platform with closed loops and constant deflections, the motor torques tau
(motor side, rotors included) do the same work as the forces r of the open tree and the rotors,

    v . W = tau . G v,        W = (dq/dv)' r + G' (torques of the rotors),        G = (d motor speed)/dv.

So W = G' tau is the wrench that the motion requires. It includes the inertia of the legs, and is W_p of the
paper if the legs have no mass. G' maps the box of motor torques onto the zonotope of wrenches that the motors
can exert.
At a Type 2 singularity G t_s = 0: the zonotope has no width along t_s, and W must have no component along
t_s. This is condition (8) of Briot and Arakelian 2010.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np

from framework.dynamics.forces import tree_forces
from framework.kinematics.linearised_loops import LinearisedLoops, assembled_at
from framework.kinematics.motion_rates import Motion, joint_rates
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array


class PlatformWrench(NamedTuple):
    """The required wrench W on the platform and the matrix G of W = G' tau, at T instants."""

    required: Array  # (T, n) W [N, N m] on the platform's axes: inertia and weight of all bodies and rotors
    motor_speed: Array  # (T, n_a, n) G: motor speeds [rad/s] for unit twists along the platform's axes
    rotors: Array  # (T, n) the part of W due to the rotors

    def force_along(self, twist: Array) -> Array:
        """Compute the required force (T,) along a twist (n,) or (T, n)."""
        return np.sum(self.required * twist, axis=1)

    def missing_wrench(self, torque: Array) -> Array:
        """Compute the missing wrench W - G' tau (T, n) under torques tau (T, n_a)."""
        return self.required - np.einsum("tan,ta->tn", self.motor_speed, torque)

    def reach(self, twist: Array, torque_limit: Array) -> Array:
        """Compute the largest force (T,) of motors along a twist t (n,) or (T, n).

        It is |G t| . limits.
        """
        twists = np.broadcast_to(twist, self.required.shape)
        speeds = np.einsum("tan,tn->ta", self.motor_speed, twists)  # G t
        return np.abs(speeds) @ torque_limit

    def band(self, twist: Array, torque_limit: Array) -> Array:
        """Compute the least and the largest force (T, 2) that motors exert on the bodies along a twist.

        The motors have torques up to the limits (n_a,), of which the rotors take a part. Where the motion is
        possible within these limits, t_s . W_p of `wrench_curves` lies between both forces.
        """
        reach = self.reach(twist, torque_limit)
        rotor_force = np.sum(self.rotors * twist, axis=1)
        return np.column_stack([-reach - rotor_force, reach - rotor_force])

    def vertices(self, torque_limit: Array) -> Array:
        """Compute the wrenches (T, 2^n_a, n) of all motors at plus or minus their limits (n_a,).

        The convex hull of these wrenches is the set that the motors can exert.
        """
        corners = np.array(list(product((-1.0, 1.0), repeat=len(torque_limit)))) * torque_limit
        return np.einsum("ca,tan->tcn", corners, self.motor_speed)  # G' tau of each corner


def motor_speeds(robot: ParallelRobot, linearised: LinearisedLoops) -> tuple[Array, Array]:
    """Compute G (T, n_a, n) and dq/dv (T, nv, n): speeds of motors and joints for unit twists."""
    count = len(linearised.residual)
    unit_twists = np.broadcast_to(np.eye(robot.n)[:, None], (robot.n, count, robot.n))
    rates = joint_rates(robot, linearised, unit_twists).transpose(1, 2, 0)
    return robot.gear_ratio[:, None] * rates[:, robot.actuated], rates


def platform_wrench(robot: ParallelRobot, motion: Motion) -> PlatformWrench:
    """Compute the wrench W on the platform that a motion requires, and G.

    Raises:
        NotAssembled: the platform does not determine the joints at some instant (Type 1).
    """
    G, rates = motor_speeds(robot, motion.linearised)
    rotor_torque = robot.rotor_inertia * robot.gear_ratio * motion.a[:, robot.actuated]  # (T, n_a)
    rotor_wrench = np.einsum("tan,ta->tn", G, rotor_torque)  # G' tau
    body_wrench = np.einsum("tvn,tv->tn", rates, tree_forces(robot, motion))  # (dq/dv)' r
    return PlatformWrench(required=body_wrench + rotor_wrench, motor_speed=G, rotors=rotor_wrench)


class Hold(NamedTuple):
    """The torques of motors at rest that balance a platform wrench."""

    motor_speed: Array  # (n_a, n) G, as in PlatformWrench
    torque: Array | None  # (n_a,) [N m] motor side; None if not unique


def hold_at(robot: ParallelRobot, q: Array, wrench: Array) -> Hold:
    """Compute G and the motor torques tau that balance a wrench W (n,) at an assembled q (nq,).

    W = G' tau has a unique solution if G is square and regular.

    Raises:
        InvalidInput: q is not assembled.
    """
    stack, _rates = motor_speeds(robot, assembled_at(robot, q).linearised)
    G = stack[0]
    if robot.n_a != robot.n or np.linalg.matrix_rank(G) < robot.n:
        return Hold(G, None)
    return Hold(G, np.linalg.solve(G.T, wrench))
