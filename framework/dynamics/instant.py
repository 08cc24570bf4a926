"""One instant of a robot: what its motors, loops and joints carry, and the inertia that is felt.

No law and no path: a pose, rates and accelerations of the platform, wrenches of the world. Motor torques
follow from the independent loop equations, as everywhere (`forces`), and are computed at once; what loops and
joints carry (`reactions`), inertia and velocity matrices are computed when they are asked for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

import numpy as np
import pinocchio as pin

from framework.arrays import Array, ArrayLike, ReadOnlyArrays, freeze, read_only
from framework.dynamics.forces import balanced_forces, motor_torque, tree_forces
from framework.dynamics.platform_wrench import motor_speeds
from framework.dynamics.reactions import Load, LoopLoads, joint_reactions, load_on, loop_forces, loop_loads
from framework.errors import InvalidInput, SingularPose, choose_from, finite_numbers, point, short
from framework.kinematics.frames import scratch_of
from framework.kinematics.inverse_kinematics import Motion, assembled_at, motion_at, require_square
from framework.kinematics.loop_matrices import passive_matrix
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.kinematics.velocity_matrices import VelocityMatrices, matrices_and_rates

LEAST_CLEARANCE = 1e-7  # singular value of P (radians, robot lengths) above which motors hold the robot


@dataclass(frozen=True, eq=False)
class Instant(ReadOnlyArrays):
    """What a robot is and carries at one instant; wrenches are (force, moment) (6,) in base axes [N, N m].

    At a stack of T instants every array has them as its first axis. Springs keep the deflections of q;
    `spring_force` is what they would have to give for that.
    """

    robot: ParallelRobot
    q: Array  # (nq,)
    v: Array  # (nv,)
    a: Array  # (nv,)
    torque: Array  # (n_a,) motor side [N m]: rotor inertia and joint torque through the gear
    joint_torque: Array  # (n_a,) joint side, rotors not included [N m, N]
    spring_force: Array  # (n_e,) [N, N m]
    clearance: Array | float  # least singular value of P (radians, robot lengths): 0 at Type 2
    _motion: Motion = field(repr=False)  # of T instants, T = 1 for one
    _loads: tuple[Load, ...] = field(repr=False)
    _forces: Array = field(repr=False)  # (T, nv) of the open tree, less the loads

    @cached_property
    def loop_forces(self) -> Mapping[str, Array]:
        """By closure with frames [a, b]: BY b's body ON a's body, at a's origin; NaN where indeterminate."""
        return self._by_name(loop_forces(self.robot, self._loops))

    @cached_property
    def reactions(self) -> Mapping[str, Array]:
        """By joint: BY the body before it ON the one behind it, at its origin; NaN where indeterminate.

        The part along the joint's axis is what a motor (rotor not included) or a spring gives.
        """
        return self._by_name(joint_reactions(self.robot, self._motion, self._loads, self._loops))

    @cached_property
    def platform_inertia(self) -> Array:
        """Of all bodies and rotors, along the platform's twist on its axes, (n, n)."""
        return self._shown(_platform_inertia(self.robot, self._motion))

    @cached_property
    def motor_inertia(self) -> Array:
        """Of all bodies and rotors, along the motors' joints, (n_a, n_a); NaN with redundant motors."""
        robot = self.robot
        if robot.n_a != robot.n:
            return self._shown(np.full((len(self._motion.v), robot.n_a, robot.n_a), np.nan))
        speeds = motor_speeds(robot, self._motion.system)[1][:, robot.actuated]
        to_platform = np.linalg.inv(speeds)
        along_platform = np.atleast_3d(self.platform_inertia.T).T
        return self._shown(to_platform.swapaxes(1, 2) @ along_platform @ to_platform)

    @property
    def velocity_matrices(self) -> VelocityMatrices:
        """A, B, C of A v = B dq_a + C dq_e, see `framework.velocity_matrices`."""
        return self._matrices[0]

    @property
    def velocity_matrix_rates(self) -> VelocityMatrices:
        """Time derivatives of A, B and C, see `matrices_and_rates`."""
        return self._matrices[1]

    @property
    def indeterminate(self) -> tuple[str, ...]:
        """Names of what the loops leave open, at some instant: `tip: force z`, `elbow: moment x`."""
        parts = [f"{kind} {axis}" for kind in ("force", "moment") for axis in "xyz"]
        return tuple(
            f"{name}: {part}"
            for wrenches in (self.loop_forces, self.reactions)
            for name, wrench in wrenches.items()
            for part, values in zip(parts, wrench.T, strict=True)
            if np.isnan(values).any()
        )

    @cached_property
    def _loops(self) -> LoopLoads:
        torque = np.atleast_2d(self.joint_torque)
        loads = loop_loads(self.robot, self._motion.system.frames, self._forces, torque)
        freeze(loads)
        return loads

    @cached_property
    def _matrices(self) -> tuple[VelocityMatrices, VelocityMatrices]:
        here, rates = matrices_and_rates(self.robot, self._motion)
        return VelocityMatrices(*map(self._shown, here)), VelocityMatrices(*map(self._shown, rates))

    def _shown(self, stack: Array) -> Array:
        return read_only(stack if self.q.ndim == 2 else stack[0])

    def _by_name(self, stacks: Mapping[str, Array]) -> Mapping[str, Array]:
        return MappingProxyType({name: self._shown(stack) for name, stack in stacks.items()})


def dynamics_at(
    robot: ParallelRobot,
    q: ArrayLike,
    *,
    dx: ArrayLike | None = None,
    ddx: ArrayLike | None = None,
    wrenches: Mapping[str, ArrayLike] | None = None,
) -> Instant:
    """Motor torques, loop forces, joint reactions and inertia at an assembled configuration q (nq,).

    Args:
        q: as `assemble` or `forward_kinematics` give it; or a stack of T instants (T, nq), and all that is
            told of one then has T as its first axis.
        dx, ddx: rates (n,) and accelerations (n,) of the platform coordinates, 0 by default; or (T, n).
        wrenches: of the world, by URDF link or joint: ON its body, at its origin, (force, moment) (6,) in
            base axes [N, N m]; or (T, 6).

    Raises:
        InvalidInput: q leaves the loops open; an argument of the wrong shape, or a frame that is not there;
            a platform that does not determine the joints.
        NotAssembled: it does not at this pose (Type 1).
        SingularPose: the motors do not hold the robot there (Type 2). The torque is then a limit that needs
            the motion on both sides and condition (8): see `inverse_dynamics`.
    """
    expect_robot(robot)
    require_square(robot)
    closed = assembled_at(robot, q, stacks=True)
    count, single = len(closed.q), np.ndim(getattr(q, "q", q)) == 1
    dx, ddx = (
        _rows(name, np.zeros(robot.n) if given is None else given, robot.n, count)
        for name, given in (("dx", dx), ("ddx", ddx))
    )
    clearance = np.linalg.svd(passive_matrix(robot, closed.system), compute_uv=False).min(
        axis=1, initial=np.inf
    )
    if count and clearance.min() < LEAST_CLEARANCE:
        x = closed.x[int(np.argmin(clearance))]
        raise SingularPose(
            f"{robot.name}: at {', '.join(robot.axis_names)} = {point(x)} the motors do not hold "
            f"the robot (Type 2): torque is a limit there that needs the motion on both sides; plan one",
            platform=x,
        )
    motion = motion_at(robot, closed, dx, ddx)
    loads = _loads(robot, motion, wrenches)
    r = tree_forces(robot, motion)
    for load in loads:
        r = r - load.generalised
    forces = balanced_forces(robot, motion.system, r)
    freeze((motion, loads, r))
    here = 0 if single else slice(None)
    return Instant(
        robot=robot,
        q=motion.q[here],
        v=motion.v[here],
        a=motion.a[here],
        torque=motor_torque(robot, motion, forces.joint_torque)[here],
        joint_torque=forces.joint_torque[here],
        spring_force=forces.spring_force[here],
        clearance=clearance[here],
        _motion=motion,
        _loads=loads,
        _forces=r,
    )


def _rows(name: str, given: ArrayLike, width: int, count: int) -> Array:
    """The given numbers, (width,) for all or (count, width), as an array (count, width)."""
    values = finite_numbers(name, given, width, stacks=True)
    if values.ndim == 2 and len(values) != count:
        raise InvalidInput(f"{name}: got {len(values)} rows for {count} configurations")
    return np.broadcast_to(values, (count, width))


def _loads(
    robot: ParallelRobot, motion: Motion, wrenches: Mapping[str, ArrayLike] | None
) -> tuple[Load, ...]:
    if not isinstance(wrenches, Mapping | None):
        raise InvalidInput(f"wrenches: needs a wrench by frame, {{name: (6,)}}, got {short(wrenches)}")
    model = robot.model
    for frame in wrenches or {}:
        if not model.existFrame(str(frame)) or frame == model.frames[0].name:  # the universe carries nothing
            names = [one.name for one in model.frames[1:]]
            raise InvalidInput(f"wrenches: {choose_from('frame', frame, names)}")
    return tuple(
        load_on(robot, motion, frame, _rows(f"wrenches: {frame}", wrench, 6, len(motion.q)))
        for frame, wrench in (wrenches or {}).items()
    )


def _platform_inertia(robot: ParallelRobot, motion: Motion) -> Array:
    """Inertia (T, n, n) of bodies and rotors along the platform's twist."""
    model, data = robot.model, scratch_of(robot).data
    upper = np.triu([pin.crba(model, data, q) for q in motion.q])
    mass = upper + np.triu(upper, 1).swapaxes(1, 2)
    mass[:, robot.actuated, robot.actuated] += robot.rotor_inertia * robot.gear_ratio**2
    rates = motor_speeds(robot, motion.system)[1]  # (T, nv, n)
    return np.asarray(rates.swapaxes(1, 2) @ mass @ rates)
