"""The dynamics of one instant: loads of motors, loops and joints, and the reflected inertia.

The pose, rates and accelerations of the platform, and external wrenches are given. Motor torques follow from
the independent loop equations (`forces`); on a Type 2 singularity they are a limit
(`pointwise_at_singularity`). Loads of loops and joints (`reactions`), inertia and velocity matrices are
computed on first use. `forward_dynamics` computes the same record from given torques.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from framework.dynamics.forces import Forces, balanced_forces, mass_matrices, motor_torque, tree_forces
from framework.dynamics.platform_wrench import motor_speeds
from framework.dynamics.pointwise_at_singularity import forces_through_singularity
from framework.dynamics.reactions import (
    LoopLoads,
    Wrenches,
    apply_wrenches,
    closure_wrenches,
    coupling_torques,
    joint_reactions,
    loop_loads,
    stack_wrenches,
    stacked_rows,
)
from framework.errors import SingularPose
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.linearised_loops import (
    ClosedStack,
    LinearisedLoops,
    assembled_at,
    clearance,
    find_near_type2,
)
from framework.kinematics.motion_rates import Motion, motion_at, platform_twists
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.kinematics.velocity_matrices import VelocityMatrices, matrices_and_rates
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays, freeze, read_only
from framework.tolerances import RANK_LOST


@dataclass(frozen=True, eq=False)
class Instant(ReadOnlyArrays):
    """State and loads of a robot at one instant; wrenches are (force, moment) (6,) on base axes [N, N m].

    For a stack of T instants the first axis of every array is T. The deflections of springs are those of q;
    `spring_force` is the force that the springs must exert for balance, whatever their stiffness.
    """

    robot: ParallelRobot
    q: Array  # (nq,)
    v: Array  # (nv,)
    a: Array  # (nv,)
    torque: Array  # (n_a,) motor side [N m], rotors included
    joint_torque: Array  # (n_a,) joint side [N m, N], rotors not included
    spring_force: Array  # (n_e,) [N, N m]
    _motion: Motion = field(repr=False)  # of T instants, T = 1 for one
    _forces: Array = field(repr=False)  # (T, nv) r of `tree_forces`

    @cached_property
    def clearance(self) -> Array | float:
        """The least singular value of the passive columns P; infinite without passive joints."""
        values = clearance(self.robot, self._motion.linearised)
        return read_only(values) if self.q.ndim == 2 else float(values[0])

    @cached_property
    def loop_forces(self) -> Mapping[str, Array]:
        """The wrench of each closure [a, b], BY b's body ON a's body at a's origin; NaN if undetermined."""
        return self._unstack_each(closure_wrenches(self.robot, self._loop_loads))

    @cached_property
    def coupling_torques(self) -> Mapping[str, Array | float]:
        """The torque of each coupling ON the first joint [N m, N]; NaN if undetermined.

        The torque on the second joint is minus `ratio` times this torque.
        """
        return self._unstack_each(coupling_torques(self.robot, self._loop_loads))

    @cached_property
    def reactions(self) -> Mapping[str, Array]:
        """The wrench of each joint, BY the parent body ON the child body at the joint; NaN if undetermined.

        The component along the joint's axis is exerted by a motor (rotor not included), a spring, damping or
        a coupling.
        """
        return self._unstack_each(joint_reactions(self.robot, self._motion, self._loop_loads))

    @cached_property
    def platform_inertia(self) -> Array:
        """The inertia M_x (n, n) of all bodies and rotors: the kinetic energy is v' M_x v / 2."""
        mass = mass_matrices(self.robot, self._motion.q) + np.diag(self.robot.rotors)
        _G, rates = motor_speeds(self.robot, self._motion.linearised)  # (T, nv, n) joints, for unit twists
        return self._unstack(rates.swapaxes(1, 2) @ mass @ rates)

    @cached_property
    def motor_inertia(self) -> Array:
        """The inertia (n_a, n_a) of all bodies and rotors along the motors' joints.

        It is S' M_x S with S = dv/d(dq_a), the platform's twists per motor rate, and M_x =
        `platform_inertia`. NaN with redundant motors, and at Type 2, where the platform can move with motors
        at rest.
        """
        robot = self.robot
        inertia = np.full((len(self._motion.v), robot.n_a, robot.n_a), np.nan)
        regular = np.atleast_1d(self.clearance) >= RANK_LOST
        if robot.n_a == robot.n:
            _G, joint_rates = motor_speeds(robot, self._motion.linearised)  # for unit twists
            S = np.linalg.inv(joint_rates[:, robot.actuated][regular])
            M_x = self.platform_inertia.reshape(-1, robot.n, robot.n)[regular]
            inertia[regular] = S.swapaxes(1, 2) @ M_x @ S
        return self._unstack(inertia)

    @cached_property
    def platform_velocity(self) -> Array:
        """The platform's twist v (n,), see `kinematics.platform`.

        For a platform with several axes of rotation the twist is not dx/dt.
        """
        twist, _twist_rate = platform_twists(self.robot, self._motion)
        return self._unstack(twist)

    @cached_property
    def platform_acceleration(self) -> Array:
        """The time derivative (n,) of `platform_velocity`."""
        _twist, twist_rate = platform_twists(self.robot, self._motion)
        return self._unstack(twist_rate)

    @property
    def velocity_matrices(self) -> VelocityMatrices:
        """The matrices A, B, C of A v = B dq_a + C dq_e, see `framework.velocity_matrices`."""
        return self._matrices[0]

    @property
    def velocity_matrix_rates(self) -> VelocityMatrices:
        """Time derivatives of A, B and C, see `matrices_and_rates`."""
        return self._matrices[1]

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

    @cached_property
    def _matrices(self) -> tuple[VelocityMatrices, VelocityMatrices]:
        """The velocity matrices and their time derivatives."""
        matrices, rates = matrices_and_rates(self.robot, self._motion)
        return VelocityMatrices(*map(self._unstack, matrices)), VelocityMatrices(*map(self._unstack, rates))

    def _unstack(self, stack: Array) -> Array:
        """Return a stack (T, ...), or its only item for a single configuration q."""
        return read_only(stack if self.q.ndim == 2 else stack[0])

    def _unstack_each(self, stacks: Mapping[str, Array]) -> Mapping[str, Array]:
        """Return each of the stacks as `_unstack` does."""
        return MappingProxyType({name: self._unstack(stack) for name, stack in stacks.items()})


def dynamics_at(
    robot: ParallelRobot,
    q: ArrayLike,
    *,
    dx: ArrayLike | None = None,
    ddx: ArrayLike | None = None,
    dddx: ArrayLike | None = None,
    wrenches: Mapping[str, ArrayLike] | None = None,
) -> Instant:
    """Compute motor torques, loop forces, joint reactions and inertia at an assembled configuration q (nq,).

    Args:
        q: as returned by `assemble` or `forward_kinematics`; or a stack of T instants (T, nq), for which the
            first axis of all results is T.
        dx, ddx: rates (n,) and accelerations (n,) of the platform coordinates, 0 by default; or (T, n).
        wrenches: external wrenches by URDF link or joint: ON its body, at its origin, (force, moment) (6,) on
            base axes [N, N m]; or (T, 6). They are assumed constant.
        dddx: third derivatives (n,), or (T, n), used only on a Type 2 singularity.

    Raises:
        InvalidInput: q leaves the loops open; an argument has the wrong shape; a frame is unknown; the
            platform does not determine the joints.
        NotAssembled: the platform does not determine the joints at this pose (Type 1).
        SingularPose: the pose is singular of Type 2. There the torque is a limit. It is computed only if dddx
            is given, the motion crosses the locus, and condition (8) holds.
    """
    prescribed = prescribed_motion(robot, q, dx=dx, ddx=ddx, wrenches=wrenches)
    motion, count = prescribed.motion, len(prescribed.x)
    jerk = stack_rates("dddx", dddx, robot.n, count)
    r = tree_forces(robot, motion)
    forces = balanced_forces(robot, motion.linearised, r)
    for k in map(int, find_near_type2(robot, motion.linearised)):
        if dddx is None:
            raise type2_pose(
                robot,
                prescribed.x[k],
                "is a limit there that needs the motion to third order; give dddx, or plan the motion",
            )
        limit = forces_through_singularity(
            robot,
            ClosedStack(motion.q[[k]], prescribed.x[[k]], motion.linearised.select(k)),
            rates=(prescribed.dx[k], prescribed.ddx[k], jerk[k]),
            wrenches={frame: wrench[k] for frame, wrench in prescribed.wrenches.items()},
        )
        forces.joint_torque[k], forces.spring_force[k] = limit.joint_torque[0], limit.spring_force[0]
    return instant_of(robot, motion, r, forces, prescribed.entry)


def motor_inertia(robot: ParallelRobot, q: Array) -> Array:
    """Compute the inertia (n_a,) [kg m^2, kg] that each motor moves by itself, motor side.

    Raises:
        InvalidInput, NotAssembled, SingularPose: as `dynamics_at` for q (nq,).
    """
    speeds, _rates = motor_speeds(robot, assembled_at(robot, q).linearised)
    twists = np.linalg.pinv(speeds[0])  # (n, n_a) of the platform, for unit motor speeds
    return np.diag(twists.T @ dynamics_at(robot, q).platform_inertia @ twists)


class PrescribedMotion(NamedTuple):
    """The prescribed motion at T instants, with external wrenches."""

    x: Array  # (T, n)
    dx: Array  # (T, n)
    ddx: Array  # (T, n)
    motion: Motion
    wrenches: Wrenches
    entry: int | slice  # index of results: 0 for one configuration, all for a stack


def prescribed_motion(
    robot: ParallelRobot,
    q: ArrayLike,
    *,
    dx: ArrayLike | None,
    ddx: ArrayLike | None,
    wrenches: Mapping[str, ArrayLike] | None,
) -> PrescribedMotion:
    """Check the arguments of `dynamics_at` and compute the prescribed motion.

    Raises:
        InvalidInput, NotAssembled: as `dynamics_at`.
    """
    expect_robot(robot)
    require_square(robot)
    closed = assembled_at(robot, q, stacks=True)
    count = len(closed.q)
    rate, acceleration = stack_rates("dx", dx, robot.n, count), stack_rates("ddx", ddx, robot.n, count)
    applied = stack_wrenches(robot, wrenches, count)
    motion = apply_wrenches(robot, motion_at(robot, closed, rate, acceleration), applied)
    return PrescribedMotion(closed.x, rate, acceleration, motion, applied, entry_of(q))


def entry_of(q: ArrayLike) -> int | slice:
    """Return the index into results: 0 for a configuration q (nq,), all for a stack (T, nq).

    `q` may be an object with an attribute `q`, such as the result of `assemble`.
    """
    return 0 if np.ndim(getattr(q, "q", q)) == 1 else slice(None)


def require_hold(robot: ParallelRobot, linearised: LinearisedLoops, x: Array) -> None:
    """Raise SingularPose if one of the platform's poses x (T, n) is singular of Type 2."""
    singular = find_near_type2(robot, linearised)
    if len(singular):
        raise type2_pose(robot, x[singular[0]], "and its derivatives have a pole there")


def type2_pose(robot: ParallelRobot, x: Array, torque: str) -> SingularPose:
    """Return the error for a pose x (n,) at Type 2; `torque` continues the message "torque ..."."""
    return SingularPose(
        f"{robot.name}: at {robot.place(x)} the motors do not hold the robot (Type 2): torque {torque}",
        platform=x,
    )


def instant_of(robot: ParallelRobot, motion: Motion, r: Array, forces: Forces, entry: int | slice) -> Instant:
    """Return the instants of a stack of motions, with their forces.

    Args:
        r: (T, nv) forces of the open tree [N m or N].
        forces: forces of motors and springs, in balance with r.
        entry: index of the instants in the stack, see `entry_of`.
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


def stack_rates(name: str, values: ArrayLike | None, width: int, count: int) -> Array:
    """Return rates (count, width) as `stacked_rows` does; zeros by default."""
    return np.zeros((count, width)) if values is None else stacked_rows(name, values, width, count)
