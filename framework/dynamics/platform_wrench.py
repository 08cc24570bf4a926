"""The wrench on the platform that a motion requires, and the wrenches that the motors can exert.

Along a virtual twist v of the platform with closed loops and constant deflections, the motor torques tau
(motor side, rotors included) do the same work as the forces r of the open tree and the rotors,

    v . W = tau . G v,        W = (dq/dv)' r + G' (torques of the rotors),        G = (d motor speed)/dv.

So W = G' tau is the wrench that the motion requires. It includes the inertia of the legs, and is W_p of the
paper if the legs have no mass. G' maps the box of motor torques onto the zonotope of wrenches that the motors
can exert. Row k of G is the wrench of motor k for a torque of 1 N m: a force along a line or, on a platform
that only turns, a moment about an axis.

At a Type 2 singularity G t_s = 0. Then the zonotope has no width along t_s, all lines of the motors' forces
are reciprocal to t_s (J.-P. Merlet, Parallel Robots, 2006), and W must have no component along t_s. The last
statement is condition (8) of Briot and Arakelian 2010.

`platform_limits` finds, at one pose and at rest, the wrenches and speeds within the motors' limits. With
motor torques tau the platform exerts the wrench

    U = G' tau - W_g,        |tau_k| <= limit of motor k,

on its surroundings, where W_g balances the weight of all bodies and the springs on their joints. Admissible
velocities v have |G v| <= speed limits; at Type 2 the speed along t_s has no limit. If the platform
coordinates are joints, as the pitch and roll of an ankle, the set of U has the true limits of the joints'
torques. They depend on the pose and on one another, while a file that describes the tree alone has
independent limits. Assumptions: all parts are rigid, springs keep their deflections, there are no contacts,
and motors reach their torque limit at every speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.dynamics.forces import tree_forces
from framework.dynamics.motor_limits import Limit, motor_limits
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.linearised_loops import assembled_at
from framework.kinematics.motion_rates import Motion, motion_at, motor_speeds
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.platform import FramePlatform
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.numerics.polytope import Polytope, sign_combinations, slabs, zonotope
from framework.singularity.points_on_path import SearchedPath
from framework.singularity.type2 import sign_along, singularity_measure, twist_norm
from framework.tolerances import FILE_ROUNDING, RANK_ROUNDING


class PlatformWrench(NamedTuple):
    """The wrench W = bodies + rotors that motors must give, W = G' tau, on the platform's axes [N, N m]."""

    bodies: Array  # (T, n) W_p = (dq/dv)' r, the part of W due to inertia and weight of all bodies
    rotors: Array  # (T, n) the part of W due to the rotors
    motor_speed: Array  # (T, n_a, n) G: motor speeds [rad/s] for unit twists along the platform's axes

    def force_along(self, twist: Array) -> Array:
        """Compute the component twist . W (T,) of the required wrench along a twist (n,) or (T, n)."""
        return np.sum((self.bodies + self.rotors) * twist, axis=1)

    def reach(self, twist: Array, torque_limit: Array) -> Array:
        """Compute the largest component (T,) of the motors' wrench along a twist.

        It is the largest t . G' tau = |G t| . limits.

        Args:
            twist: t (n,) or (T, n).
            torque_limit: (n_a,) [N m], motor side.
        """
        twists = np.broadcast_to(twist, self.bodies.shape)
        speeds = np.einsum("tan,tn->ta", self.motor_speed, twists)  # G t
        return np.abs(speeds) @ torque_limit

    def band(self, twist: Array, torque_limit: Array) -> Array:
        """Compute the least and the largest component (T, 2) along a twist of the wrench left for the bodies.

        The motors exert G' tau, and the rotors' part of W is spent on accelerating the rotors. The bodies get
        G' tau less this part. Where the motion is possible within the torque limits, t_s . W_p of
        `wrench_curves` lies between both results.

        Args:
            twist: (n,) or (T, n), such as t_s; the result is in N for a unit translation, else in N m.
            torque_limit: (n_a,) [N m], motor side.
        """
        reach = self.reach(twist, torque_limit)
        spent_on_rotors = np.sum(self.rotors * twist, axis=1)
        return np.column_stack([-reach - spent_on_rotors, reach - spent_on_rotors])

    def vertices(self, torque_limit: Array) -> Array:
        """Compute the wrenches (T, 2^n_a, n) of all motors at plus or minus their limits (n_a,).

        The convex hull of these wrenches is the set that the motors can exert.
        """
        return (sign_combinations(len(torque_limit)) * torque_limit) @ self.motor_speed


def platform_wrench(robot: ParallelRobot, motion: Motion) -> PlatformWrench:
    """Compute the wrench W on the platform that a motion requires, and G.

    Raises:
        NotAssembled: the platform does not determine the joints at some instant (Type 1).
    """
    G, rates = motor_speeds(robot, motion.linearised)
    rotor_torque = robot.rotor_inertia * robot.gear_ratio * motion.a[:, robot.actuated]  # (T, n_a)
    return PlatformWrench(
        bodies=np.einsum("tvn,tv->tn", rates, tree_forces(robot, motion)),  # (dq/dv)' r
        rotors=np.einsum("tan,ta->tn", G, rotor_torque),  # G' tau
        motor_speed=G,
    )


class Hold(NamedTuple):
    """The motor torques that balance a platform wrench at rest."""

    motor_speed: Array  # (n_a, n) G, as in PlatformWrench
    torque: Array | None  # (n_a,) [N m] motor side; None if not unique


def hold_at(robot: ParallelRobot, q: Array, wrench: Array) -> Hold:
    """Compute G and the motor torques tau that balance a wrench W (n,) at an assembled q (nq,).

    W = G' tau has a unique solution if G is square and regular.

    Raises:
        InvalidInput: q is not assembled.
    """
    stack, _rates = motor_speeds(robot, assembled_at(robot, q))
    G = stack[0]
    if robot.n_a != robot.n or np.linalg.matrix_rank(G) < robot.n:
        return Hold(G, torque=None)
    return Hold(G, np.linalg.solve(G.T, wrench))


class WrenchCurves(NamedTuple):
    """The force that a motion requires along t_s, the twist that the motors control least, at T instants.

    t_s is continued smoothly away from the singularity. Where |g| is least, t_s has unit size and points
    along the motion. `power` is eta . r, with the joint rates eta of t_s and the forces r of the open tree.
    It equals t_s . W_p at a singularity and, if the legs have no mass, at all poses.
    """

    g: Array  # (T,) measure, zero at Type 2
    twist: Array  # (T, n) t_s
    power: Array  # (T,) [N, or N m for a pure turn]


def wrench_curves(robot: ParallelRobot, motion: Motion) -> WrenchCurves:
    """Compute g, t_s and t_s . W_p at T ascending instants, along which t_s is continued."""
    measure = singularity_measure(robot, motion.linearised)
    twist = np.einsum("tnv,tv->tn", motion.linearised.platform, measure.motion)

    # scale t_s to unit size, along the motion, where |g| is least
    nearest = int(np.argmin(np.abs(measure.g)))
    signed_norm = twist_norm(robot, twist[nearest]) or 1.0  # 1 if the platform rests
    platform_twist = motion.linearised.platform[nearest] @ motion.v[nearest]
    signed_norm *= sign_along(twist[nearest], platform_twist)
    power = np.sum(tree_forces(robot, motion) * measure.motion, axis=1) / signed_norm
    return WrenchCurves(measure.g, twist / signed_norm, power)


def measure_at_rest(searched: SearchedPath, s: Array) -> Array:
    """Compute g (T,) at ascending path coordinates s (T,), with springs at rest."""
    branch = searched.branch
    return singularity_measure(branch.robot, branch.close(s)).g


class ActionLines(NamedTuple):
    """The line of each motor's force at F instants, relative to the platform's origin."""

    point: Array  # (F, n_a, 3) [m] the point of the line that is nearest to the origin
    direction: Array  # (F, n_a, 3) unit vector


def action_lines(robot: ParallelRobot, motor_speed: Array) -> ActionLines | None:
    """Compute the lines of the motors' forces, or the axes of their moments, from G (F, n_a, n).

    A force f along a line through p has the moment p x f. G, `motor_speed`, contains only the components
    along the platform's axes. With fewer than six axes several lines have these components; the result is the
    one nearest to the origin.

    Returns:
        The lines; None for a single motor, for a wrench that is not a force along a line (zero, or a screw
        with pitch), and if the platform's axes are not those of the base.
    """
    platform = robot.platform
    if robot.n_a < 2 or not isinstance(platform, FramePlatform) or not platform.constant:
        return None
    wrench = np.zeros((*motor_speed.shape[:2], 6))  # of each motor, for a torque of 1 N m
    wrench[:, :, platform.axes] = motor_speed
    force, moment = wrench[:, :, :3], wrench[:, :, 3:]
    translates = platform.translations.any()
    along_line = force if translates else moment
    norm = np.linalg.norm(along_line, axis=2, keepdims=True)
    if not np.all(np.isfinite(wrench)) or np.any(norm <= 0):
        return None
    direction = along_line / norm
    rotations = [axis - 3 for axis in platform.axes if axis >= 3]
    if not rotations or not translates:
        return ActionLines(np.zeros_like(direction), direction)

    # Solve point x direction = moment / norm on the platform's axes of rotation, for the shortest point.
    # The matrix of point -> point x direction has the columns (unit vector i) x direction.
    arm = (moment / norm)[:, :, rotations]  # [m] moments of unit forces
    products = np.cross(np.eye(3), direction[:, :, None, :])  # row i: (unit vector i) x direction
    cross_matrix = products.swapaxes(2, 3)[:, :, rotations]
    point = np.einsum("fkij,fkj->fki", np.linalg.pinv(cross_matrix, rcond=RANK_ROUNDING), arm)
    error = np.abs(np.einsum("fkij,fkj->fki", cross_matrix, point) - arm).max()
    if error > FILE_ROUNDING * max(robot.length, np.abs(arm).max()):
        return None
    return ActionLines(point, direction)


# ------------------------------------------------------------------ limits


@dataclass(frozen=True, eq=False)
class PlatformLimits(ReadOnlyArrays):
    """The admissible wrenches U and speeds v of the platform at one pose.

    U has forces [N] and moments [N m] along the components of v, so that the power is U . v. For a platform
    of joints they are the joints' forces and torques.
    """

    robot: ParallelRobot
    wrenches: Polytope | None  # U at rest; None if a motor has no torque limit
    speeds: Polytope | None  # v [m/s, rad/s]; None if a motor has no speed limit
    weight: Array  # (n,) W_g, the wrench that balances the weight

    @property
    def polytopes(self) -> dict[str, Polytope]:
        """The polytopes that exist, under the keys "wrench" and "speed"."""
        polytopes = {"wrench": self.wrenches, "speed": self.speeds}
        return {name: polytope for name, polytope in polytopes.items() if polytope is not None}


def platform_limits(
    robot: ParallelRobot, q: ArrayLike, *, torque_limit: Limit = None, speed_limit: Limit = None
) -> PlatformLimits:
    """Compute the admissible wrenches U and speeds v of the platform at an assembled configuration q (nq,).

    Args:
        q: as returned by `assemble` or `forward_kinematics`.
        torque_limit: limit [N m], motor side, of all motors; or one for each motor; or limits by joint. By
            default, limits are those of the robot file.
        speed_limit: limits [rad/s] in the same forms.

    Raises:
        InvalidInput: q leaves the loops open; limits have the wrong length or are not positive; the platform
            does not determine the joints.
        NotAssembled: the platform does not determine the joints at this pose (Type 1).
    """
    require_square(robot)
    closed = assembled_at(robot, q)
    torque = motor_limits(robot, "torque_limit", torque_limit)
    speed = motor_limits(robot, "speed_limit", speed_limit)
    G, rates = motor_speeds(robot, closed)
    at_rest = np.zeros((1, robot.n))
    motion = motion_at(robot, closed, at_rest, at_rest)
    weight = (tree_forces(robot, motion) @ rates[0])[0]  # (n,) W_g = (dq/dv)' r
    scale = robot.platform_scale  # the polytopes of scale * U and of v / scale are well conditioned
    wrenches = speeds = None
    if np.isfinite(torque).all():
        scaled_wrenches = zonotope(-weight * scale, torque[:, None] * G[0] * scale)
        wrenches = _unscale_polytope(scaled_wrenches, scale)
    if np.isfinite(speed).all():
        speeds = _unscale_polytope(slabs(G[0] * scale, speed), 1.0 / scale)
    return PlatformLimits(robot, wrenches, speeds, weight)


def _unscale_polytope(scaled: Polytope, scale: Array) -> Polytope:
    """Convert a polytope of scale * y to a polytope of y, with scale (n,).

    Normals are scaled to unit length, and free directions to an orthonormal basis.
    """
    normals = scaled.normals * scale
    lengths = np.linalg.norm(normals, axis=1)
    free = np.linalg.qr((scaled.free / scale).T)[0].T if len(scaled.free) else scaled.free
    return Polytope(normals / lengths[:, None], scaled.offsets / lengths, scaled.vertices / scale, free)
