"""State and loads of a robot at one instant: wrenches in loops and joints, inertia, velocity matrices.

`pointwise_dynamics` makes the record of an instant from a prescribed motion, `forward_dynamics` from given
torques. Loads are computed on first use.

With the forces r of the open tree (RNEA less external wrenches), the selection S of the actuated joints, and
the Jacobian J of all loop equations, redundant ones included,

    r = S' tau_joint + J' lambda.

lambda is unique only if J' has no null space. Wrenches of loops and joints that change along the null space
are indeterminate in a rigid robot. They are NaN, since any number would be an arbitrary choice.

The wrench in a joint is the inertial wrench of all bodies that the joint carries, less the external wrenches
and the loop wrenches on these bodies. All are summed about the base's origin.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.dynamics.forces import Forces, mass_matrices, motor_torque
from framework.errors import InvalidInput, finite_numbers
from framework.kinematics.couplings import coupling_jacobian
from framework.kinematics.external_wrenches import (
    applied_wrench,
    check_frame,
    expect_wrenches,
)
from framework.kinematics.frames import move_wrench, rotation_matrices, scratch_of, tree_columns
from framework.kinematics.line_springs import Lines
from framework.kinematics.linearised_loops import LinearisedLoops, clearance
from framework.kinematics.motion_rates import Motion, motor_speeds, platform_twists
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.velocity_matrices import VelocityMatrices, matrices_and_rates
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays, freeze, read_only
from framework.numerics.ordered_sums import matmul, matvec
from framework.tolerances import RANK_LOST, RANK_ROUNDING


@dataclass(frozen=True, eq=False)
class Instant(ReadOnlyArrays):
    """State and loads of a robot at one instant; wrenches are (force, moment) (6,) on base axes [N, N m].

    For a stack of T instants the first axis of every array is T. The deflections of springs are those of q;
    `spring_force` is the force that the springs must exert for balance, whatever their stiffness. The private
    fields are always stacks, T = 1 for one instant.
    """

    robot: ParallelRobot
    q: Array  # (nq,) configuration
    v: Array  # (nv,) joint rates
    a: Array  # (nv,) joint accelerations
    torque: Array  # (n_a,) motor side [N m], rotors included
    joint_torque: Array  # (n_a,) joint side [N m, N], rotors not included
    spring_force: Array  # (n_e,) [N, N m]
    _motion: Motion = field(repr=False)
    _forces: Array = field(repr=False)  # (T, nv) r of `tree_forces`

    @cached_property
    def clearance(self) -> Array | float:
        """The least singular value of the passive columns P; infinite without passive joints."""
        return self._shape_like_q(clearance(self.robot, self._motion.linearised))

    @cached_property
    def loop_forces(self) -> Mapping[str, Array]:
        """The wrench (6,) of each closure [a, b], BY b's body ON a's at a's origin; NaN if undetermined.

        It is minus the sum of the closure's unit wrenches times their multipliers.
        """
        robot, loops = self.robot, self._loop_loads
        unit_wrenches = move_wrench(loops.wrench, loops.displacement)  # at the origins of the first frames
        wrenches = {}
        first_row = 0
        for closure in robot.description.closures:
            rows = slice(first_row, first_row + len(closure.axes))
            first_row = rows.stop
            wrench = -matvec(unit_wrenches[:, rows].swapaxes(1, 2), loops.multipliers[:, rows])  # (T, 6)
            free = loops.null_space[:, :, rows] @ unit_wrenches[:, rows]  # (T, k, 6) of null-space vectors
            wrenches[closure.name] = _mark_indeterminate(robot, wrench, free)
        return self._shape_each_like_q(wrenches)

    @cached_property
    def coupling_torques(self) -> Mapping[str, Array | float]:
        """The torque of each coupling ON the first joint [N m, N]; NaN if undetermined.

        The torque on another joint is minus the derivative of q_joint along that joint times this torque.
        """
        robot, loops = self.robot, self._loop_loads
        rows = np.flatnonzero(robot.rows.coupled)  # the loop equations that are couplings
        # largest component of a null-space vector at each coupling (T, couplings)
        freedom = np.abs(loops.null_space[:, :, rows] * robot.row_lengths[rows]).max(axis=1, initial=0.0)
        torque = np.where(freedom > RANK_ROUNDING, np.nan, loops.multipliers[:, rows])
        names = [coupling.name for coupling in robot.description.couplings]
        return self._shape_each_like_q(dict(zip(names, torque.T, strict=True)))

    @cached_property
    def reactions(self) -> Mapping[str, Array]:
        """The wrench (6,) in each joint, BY the parent ON the child body at the joint; NaN if undetermined.

        The component along the joint's axis is exerted by a motor (rotor not included), a spring, damping or
        a coupling.
        """
        return self._shape_each_like_q(joint_reactions(self.robot, self._motion, self._loop_loads))

    @cached_property
    def platform_inertia(self) -> Array:
        """The inertia M_x (n, n) of all bodies and rotors: the kinetic energy is v' M_x v / 2."""
        mass = mass_matrices(self.robot, self._motion.q) + np.diag(self.robot.rotors)
        _G, rates = motor_speeds(self.robot, self._motion.linearised)  # (T, nv, n) joints, for unit twists
        return self._shape_like_q(rates.swapaxes(1, 2) @ mass @ rates)

    @cached_property
    def motor_inertia(self) -> Array:
        """The inertia (n_a, n_a) of all bodies and rotors along the motors' joints.

        It is S' M_x S with S = dv/d(dq_a), the platform's twists per motor rate, and M_x =
        `platform_inertia`. NaN with redundant motors, and at Type 2, where the platform can move with motors
        at rest.
        """
        robot = self.robot
        inertia = np.full((len(self._motion.v), robot.n_a, robot.n_a), np.nan)
        if robot.n_a == robot.n:
            is_regular = np.atleast_1d(self.clearance) >= RANK_LOST  # (T,)
            _G, joint_rates = motor_speeds(robot, self._motion.linearised)  # for unit twists
            S = np.linalg.inv(joint_rates[:, robot.actuated][is_regular])
            M_x = self.platform_inertia.reshape(-1, robot.n, robot.n)[is_regular]
            inertia[is_regular] = S.swapaxes(1, 2) @ M_x @ S
        return self._shape_like_q(inertia)

    @cached_property
    def platform_velocity(self) -> Array:
        """The platform's twist v (n,) [m/s, rad/s].

        It has an entry for each of the platform's axes: the velocity of its point along the axis, or its rate
        of turning about it. With several axes of rotation it is not dx/dt, as coordinates x of an attitude
        have other rates.
        """
        twist, _twist_rate = platform_twists(self.robot, self._motion)
        return self._shape_like_q(twist)

    @cached_property
    def platform_acceleration(self) -> Array:
        """The time derivative (n,) of the platform's twist, `platform_velocity` [m/s^2, rad/s^2]."""
        _twist, twist_rate = platform_twists(self.robot, self._motion)
        return self._shape_like_q(twist_rate)

    @cached_property
    def velocity_matrices(self) -> VelocityMatrices:
        """The matrices A, B, C of A v = B dq_a + C dq_e.

        v is the platform's twist; dq_a and dq_e are the rates of motor joints and of deflections.
        """
        matrices, _rates = matrices_and_rates(self.robot, self._motion)
        return VelocityMatrices(*map(self._shape_like_q, matrices))

    @cached_property
    def velocity_matrix_rates(self) -> VelocityMatrices:
        """The time derivatives of A, B and C along the motion."""
        _matrices, rates = matrices_and_rates(self.robot, self._motion)
        return VelocityMatrices(*map(self._shape_like_q, rates))

    @property
    def indeterminate(self) -> tuple[str, ...]:
        """Names of wrench components that no equation determines: `tip: force z`, `elbow: moment x`."""
        components = [f"{kind} {axis}" for kind in ("force", "moment") for axis in "xyz"]
        names = []
        for name, wrench in [*self.loop_forces.items(), *self.reactions.items()]:
            is_undetermined = np.isnan(np.atleast_2d(wrench)).any(axis=0)  # (6,)
            names += [f"{name}: {components[k]}" for k in np.flatnonzero(is_undetermined)]
        return tuple(names)

    @cached_property
    def _loop_loads(self) -> LoopLoads:
        """The multipliers of all loop equations that balance the robot, at T instants."""
        torque = np.atleast_2d(self.joint_torque)
        loads = loop_loads(self.robot, self._motion.linearised, self._forces, torque)
        freeze(loads)
        return loads

    def _shape_like_q(self, stack: Array) -> Array:
        """Return a stack (T, ...) if q is a stack, or its only item if q is a single configuration."""
        return read_only(stack if self.q.ndim == 2 else stack[0])

    def _shape_each_like_q(self, stacks: Mapping[str, Array]) -> Mapping[str, Array]:
        """Return named stacks (T, ...) if q is a stack, or the only item of each."""
        return MappingProxyType({name: self._shape_like_q(stack) for name, stack in stacks.items()})


def instant_of(robot: ParallelRobot, motion: Motion, r: Array, forces: Forces, entry: int | slice) -> Instant:
    """Return the instants of a motion, with their forces.

    Args:
        motion: T instants; its arrays become read-only.
        r: (T, nv) forces of the open tree [N m or N]; becomes read-only.
        forces: forces of motors and springs, in balance with r.
        entry: index of the results: 0 for one configuration, all for a stack.
    """
    freeze((motion, r))
    return Instant(
        robot=robot,
        q=motion.q[entry],
        v=motion.v[entry],
        a=motion.a[entry],
        torque=motor_torque(robot, motion, forces.joint_torque)[entry],
        joint_torque=forces.joint_torque[entry],
        spring_force=forces.spring_force[entry],
        _motion=motion,
        _forces=r,
    )


def entry_of(q: ArrayLike) -> int | slice:
    """Return the index of results in a stack: 0 for one configuration q (nq,), all for a stack (T, nq).

    `q` may be an object with an attribute `q`, such as the result of `assemble`.
    """
    return 0 if np.ndim(getattr(q, "q", q)) == 1 else slice(None)


class LoopLoads(NamedTuple):
    """The unit wrenches of all loop equations (rows), and the multipliers that balance the robot."""

    wrench: Array  # (T, rows, 6) of a unit multiplier on the second body, at the second frame's origin
    position: Array  # (T, rows, 3) [m] position of that origin
    displacement: Array  # (T, rows, 3) [m] from the origin of the first frame to that of the second
    multipliers: Array  # (T, rows) lambda of least norm
    null_space: Array  # (T, rows, rows) multipliers: rows span the null space of J', filled up with zero rows


Wrenches = Mapping[str, Array]  # by URDF link or joint: (T, 6) ON the body, at the frame's origin, base axes


def stack_wrenches(robot: ParallelRobot, wrenches: Mapping[str, ArrayLike] | None, count: int) -> Wrenches:
    """Stack wrenches, each (6,) or (T, 6), for T = `count` configurations.

    Raises:
        InvalidInput: an unknown frame, or not 6 finite numbers.
    """
    expect_wrenches(wrenches)
    stacked = {}
    for frame, wrench in (wrenches or {}).items():
        check_frame(robot, frame)
        stacked[frame] = stack_rows(f"wrenches: {frame}", wrench, width=6, count=count)
    return stacked


def stack_rows(name: str, entries: ArrayLike, width: int, count: int) -> Array:
    """Return rows (count, width); repeat a single row (width,).

    Args:
        name: name of the argument in the error message.

    Raises:
        InvalidInput: `entries` has another shape, or numbers that are not finite.
    """
    values = finite_numbers(name, entries, width, stacks=True)
    if values.ndim == 1:
        return values[None].repeat(count, axis=0)
    if len(values) != count:
        raise InvalidInput(f"{name}: got {len(values)} rows for {count} configurations")
    return values


def apply_wrenches(robot: ParallelRobot, motion: Motion, wrenches: Wrenches) -> Motion:
    """Return the motion under external wrenches, each (6,) or (T, 6)."""
    frames = motion.linearised.frames
    applied = (applied_wrench(robot, frames, frame, wrench) for frame, wrench in wrenches.items())
    return motion.with_wrenches(tuple(applied))


def loop_loads(robot: ParallelRobot, linearised: LinearisedLoops, r: Array, joint_torque: Array) -> LoopLoads:
    """Solve r (T, nv) = S' tau_joint + J' lambda for the multipliers of all rows of J.

    The row of J for a loop equation contains the power of its unit wrench along the screw of each joint. The
    power is positive if the joint carries the second body of the loop alone, negative if it carries the first
    alone, and zero otherwise.

    Args:
        joint_torque: tau_joint (T, n_a).
    """
    rows = robot.rows
    columns = robot.moving
    frames = linearised.frames
    wrench = linearised.loops.wrench  # (T, rows, 6) of unit multipliers, at the second frames' origins
    position = frames.position[:, rows.second]
    signs = frames.carried[rows.second] - frames.carried[rows.first]  # (rows, nv)
    screws = frames.screws.swapaxes(1, 2)[:, :, columns]  # (T, 6, columns)
    jacobian = matmul(move_wrench(wrench, position), screws) * signs[:, columns]
    if rows.has_couplings:  # these have no wrench
        jacobian += coupling_jacobian(rows, frames.q, robot.nv)[:, :, columns]

    # solve in radians and robot lengths, so that the rank and the least norm do not depend on units
    loop_forces = r[:, columns].copy()  # J' lambda
    loop_forces[:, : robot.n_a] -= joint_torque
    scale = robot.column_scale[columns]
    lengths = robot.row_lengths
    scaled_jacobian = jacobian * scale / lengths[:, None]
    # With J = U S V', lambda = U S^-1 V' forces over the nonzero singular values; the other columns of U span
    # the null space of J'.
    U, singular_values, V_rows = np.linalg.svd(scaled_jacobian)
    count = singular_values.shape[1]
    is_nonzero = singular_values > RANK_ROUNDING * singular_values.max(axis=1, initial=0.0)[:, None]
    divisors = np.where(is_nonzero, singular_values, np.inf)  # zero singular values contribute nothing
    components = matvec(V_rows[:, :count], loop_forces * scale) / divisors
    multipliers = matvec(U[:, :, :count], components)  # (T, rows)
    null_space = U.swapaxes(1, 2).copy()  # (T, rows, rows)
    null_space[:, :count] *= ~is_nonzero[:, :, None]  # keeps the columns of U with zero singular values
    displacement = position - frames.position[:, rows.first]
    return LoopLoads(wrench, position, displacement, multipliers / lengths, null_space / lengths)


def joint_reactions(robot: ParallelRobot, motion: Motion, loops: LoopLoads) -> dict[str, Array]:
    """Compute the wrench (T, 6) in each joint, by name; NaN if indeterminate.

    It is exerted BY the parent body of the joint ON the child body, at the joint's origin: the wrench in the
    open tree, less the loop wrenches, external wrenches and pulls of springs on all bodies that the joint
    carries.
    """
    model = robot.model
    reactions, position = _tree_reactions(robot, motion)  # at the joints' origins

    # whether a joint carries a body: 0 or 1 in (bodies, joints); pinocchio's joint 0, the base, carries all
    first_columns = [model.joints[j].idx_v for j in range(1, model.njoints)]
    carried_by_joint = np.insert(tree_columns(robot).carried[:, first_columns], 0, 1.0, axis=1)
    bodies = scratch_of(robot).bodies
    rows = robot.rows
    signs = carried_by_joint[bodies[rows.second]] - carried_by_joint[bodies[rows.first]]  # (rows, joints)

    # sum the wrenches of each joint about the base's origin, then move the sums to the joints' origins
    about_base = move_wrench(loops.wrench, loops.position)
    loads = matmul(signs.T, loops.multipliers[:, :, None] * about_base)
    lines = Lines.of(robot, motion.linearised.frames)
    for load in (*motion.wrenches, *lines.pulls(motion.v)):
        loads += carried_by_joint[load.joint][:, None] * load.wrench[:, None]
    reactions -= move_wrench(loads, -position)

    # the wrench in joint j by null-space vector k: the sum over rows m of sign, multiplier and unit wrench
    free = np.einsum("mj,tkm,tmi->tjki", signs, loops.null_space, about_base)
    free = move_wrench(free, -position[:, :, None])
    return {
        str(model.names[j]): _mark_indeterminate(robot, reactions[:, j], free[:, j])
        for j in range(1, model.njoints)
    }


def _tree_reactions(robot: ParallelRobot, motion: Motion) -> tuple[Array, Array]:
    """Compute wrenches (T, joints, 6) in the joints of the open tree, and the joints' origins.

    Wrenches [N, N m] are about the joint's origin, on the axes of the base; origins (T, joints, 3) [m].
    """
    scratch = scratch_of(robot)
    count = len(motion.q)
    poses = np.empty((count, *scratch.joint_placements.shape))  # of the joints: rotation (9 entries), origin
    forces = np.empty((count, *scratch.forces.shape))  # in the joints, on their own axes
    for k, (q, v, a) in enumerate(zip(motion.q, motion.v, motion.a, strict=True)):
        pin.forwardKinematics(robot.model, scratch.data, q)
        pin.rnea(robot.model, scratch.data, q, v, a)
        poses[k] = scratch.joint_placements
        forces[k] = scratch.forces
    rotations = rotation_matrices(poses)[:, :, None]
    on_base_axes = matvec(rotations, forces.reshape(*forces.shape[:2], 2, 3))  # forces and moments apart
    return on_base_axes.reshape(forces.shape), poses[..., 9:]


def _mark_indeterminate(robot: ParallelRobot, wrench: Array, free: Array) -> Array:
    """Replace indeterminate components of wrenches (T, 6) by NaN.

    A component is indeterminate if it changes along the null space of J'.

    Args:
        free: wrenches (T, k, 6) of k unit vectors in the null space.
    """
    moment_arms = np.repeat([1.0, robot.length], 3)  # convert moments to forces
    # (T, 6) largest component of a null-space vector as a moment, the unit in which the vectors have norm 1
    freedom = np.abs(free / moment_arms).max(axis=1, initial=0.0) * robot.length
    return np.where(freedom > RANK_ROUNDING, np.nan, wrench)
