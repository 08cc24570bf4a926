"""A linkage as a transmission: what a controller of a serial tree has to know of it.

The joints x of the platform are those of a tree, such as an ankle's pitch and roll. Motors behind the linkage
move at G dx, G = d(motor angles)/dx. With N = dq/dx of all joints, what they feel splits into

    inertia M(x) = N' M_carried N + N' M_links N + N_a' I N_a    carried bodies; cranks and rods; rotors,

where N_a are the rows of the motors' joints, and I is what a file states as rotors (n^2 times their inertia,
gear ratio n) or as armature of these joints. The carried bodies are those of the platform's joints, or that
of its frame.

Controllers of legs often map torques statically, tau_joint = G' tau_motor, and expect of the tree only its
carried bodies. The rest of the motors' torque is the error of that mapping,

    e = G' tau_motor - N' (inverse dynamics of the carried bodies, with damping of the platform's joints),

of which a constant armature N_a' I N_a of one posture explains a part, and N_a' I (N_a ddx + dN_a/dt dx) of
each posture nearly all: what is left are the cranks and rods, and springs and dampers on joints and between
points. These have the torques N' f(q, dq), f the forces that hold them. Dry friction and backlash of
the motors' joints are reflected by |dq_a/dx|' and |(dq_a/dx)^-1|, the latter without bound at Type 2: with
motors at rest the platform has the play |(dq_a/dx)^-1| (backlash of the joints) along each axis, at most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.dynamics.forces import all_spring_forces, damping_forces, mass_matrices
from framework.dynamics.platform_wrench import PlatformLimits, platform_limits
from framework.dynamics.pointwise_dynamics import dynamics_at
from framework.errors import FrameworkError, InvalidInput, NoAnswer, finite_numbers
from framework.kinematics.continuation.tracking import assemble
from framework.kinematics.line_springs import lines_at
from framework.kinematics.linearised_loops import assembled_at
from framework.kinematics.motion_rates import motor_speeds
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.platform import JointPlatform
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.numerics.fields import positive

FREQUENCIES = (1.0, 2.0, 4.0, 8.0)  # [Hz] of sines
AMPLITUDE = 0.2  # [rad, robot lengths] of sines
INSTANTS = 40  # of one period
POINTS = {1: 81, 2: 25}  # of the grid along each axis, by the number of axes
FEW_POINTS = 7  # with more axes


class MappingError(NamedTuple):
    """Largest errors of tau_joint = G' tau_motor in a sine along one axis, each (n,) [N m, N]."""

    axis: str
    frequency: float  # [Hz]
    mapped: Array  # largest G' tau_motor
    carried: Array  # largest torque that the carried bodies need
    nothing_known: Array
    constant_armature: Array
    own_armature: Array  # armature of each posture
    own_springs: Array  # armature, springs and dampers of each posture


@dataclass(frozen=True, eq=False)
class LinkageTransmission(ReadOnlyArrays):
    """A linkage as a transmission at P poses, platform's side, per unit rates of its coordinates."""

    robot: ParallelRobot
    x: Array  # (P, n) [rad, m]
    gear: Array  # (P, n_a, n) G, motor side
    inertia: Array  # (P, n, n) [kg m^2, kg] of all
    carried: Array  # (P, n, n) of the carried bodies
    links: Array  # (P, n, n) of cranks and rods
    rotors: Array  # (P, n, n) of rotors, and armature of the motors' joints
    springs: Array  # (P, n) [N m, N] that motors hold against springs on joints and between points
    damping: Array  # (P, n, n) [N m s, N s/m] of all joints and dampers
    friction: Array  # (P, n) [N m, N] dry friction of motors' joints, in any direction
    backlash: Array  # (P, n) [rad, m] of the platform by backlash 1 of each motor's joint
    play: Array  # (P, n) [rad, m] of the platform by the backlash in the robot file
    limits: tuple[PlatformLimits, ...]  # (P,)
    posture: Array  # (n,)
    armature: Array  # (n, n) of rotors at the posture
    errors: tuple[MappingError, ...]
    unreached: int  # poses of the grid that are not assembled or singular

    def axis_limits(self, kind: str) -> Array | None:
        """Return least and largest (P, 2, n) `wrenches` or `speeds` along each axis; None without limits."""
        polytopes = [getattr(limit, kind) for limit in self.limits]
        if any(one is None for one in polytopes):
            return None
        ends = [(one.vertices.min(axis=0), one.vertices.max(axis=0)) for one in polytopes if one]
        return np.array(ends)


def transmission(
    robot: ParallelRobot,
    *,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    posture: ArrayLike | None = None,
    frequencies: Sequence[float] = FREQUENCIES,
    points: int | None = None,
) -> LinkageTransmission:
    """Compute the linkage as a transmission over a box of platform coordinates.

    Args:
        robot: rigid, with as many motors as platform coordinates.
        lower, upper: ends (n,) of the ranges; by default the limits of the platform's joints.
        posture: x (n,) of constant armature and of sines; by default the reference.
        frequencies: [Hz] of sines of AMPLITUDE.
        points: poses along each axis; by default 81 of one axis, 25 of two, else 7.

    Raises:
        InvalidInput: an elastic robot or redundant motors; no ranges; wrong numbers; a sine about the posture
            that is out of reach.
        NoAnswer: no pose of the ranges is assembled and regular, or the posture is out of reach.
    """
    if robot.n_e or robot.n_a != robot.n:
        raise InvalidInput(
            f"transmission: of rigid robots with as many motors as platform axes; {robot.name} has "
            f"{robot.n_e} springs, {robot.n_a} motors and {robot.n} axes"
        )
    ends = _range_ends(robot, lower, upper)
    x0 = robot.reference.x if posture is None else finite_numbers("posture", posture, robot.n)
    for frequency in frequencies:
        positive("frequencies", frequency)
    count = POINTS.get(robot.n, FEW_POINTS) if points is None else points
    if count < 2:
        raise InvalidInput(f"points: needs at least 2 along each axis, got {points!r}")
    grid = np.array(list(product(*(np.linspace(low, high, count) for low, high in zip(*ends, strict=True)))))
    poses: list[Array] = []
    configurations: list[Array] = []
    limits: list[PlatformLimits] = []
    for x in grid:
        try:
            q = assemble(robot, x).q
            dynamics_at(robot, q)
            limits.append(platform_limits(robot, q))
        except FrameworkError:  # out of reach, or singular
            continue
        poses.append(x)
        configurations.append(q)
    if not poses:
        raise NoAnswer("no pose in these ranges is assembled and regular", name=robot.name)

    q = np.array(configurations)  # (P, nq)
    N, N0 = _joint_rates(robot, q), _joint_rates(robot, assemble(robot, x0).q[None])
    motors, transposed = N[:, robot.actuated], N.swapaxes(1, 2)
    armature = _rotor_inertia(robot, N0)[0]
    carried = transposed @ mass_matrices(_with_bodies(robot, carried=True), q) @ N
    links = transposed @ mass_matrices(_with_bodies(robot, carried=False), q) @ N
    dampers = lines_at(robot, q).damping + np.diag(robot.joint_damping)  # (P, nv, nv)
    reflected = np.abs(np.linalg.inv(motors))  # (P, n, n_a)
    E = robot.platform.rate_matrix(np.array(poses))
    return LinkageTransmission(
        robot=robot,
        x=np.array(poses),
        gear=robot.gear_ratio[:, None] * motors,
        inertia=E.swapaxes(1, 2) @ dynamics_at(robot, q).platform_inertia @ E,
        carried=carried,
        links=links,
        rotors=_rotor_inertia(robot, N),
        springs=np.vecmat(all_spring_forces(robot, q, robot.joint_stiffness), N),
        damping=transposed @ dampers @ N,
        friction=np.abs(motors).swapaxes(1, 2) @ robot.joint_friction[robot.actuated],
        backlash=reflected.sum(axis=2),
        play=reflected @ np.array([actuator.backlash for actuator in robot.description.actuators]),
        limits=tuple(limits),
        posture=x0,
        armature=armature,
        errors=tuple(
            _mapping_error(robot, x0, armature, axis, frequency)
            for axis in range(robot.n)
            for frequency in frequencies
        ),
        unreached=len(grid) - len(poses),
    )


def _range_ends(
    robot: ParallelRobot, lower: ArrayLike | None, upper: ArrayLike | None
) -> tuple[Array, Array]:
    """Return the ends (n,) of the ranges, by default the limits of the platform's joints."""
    if lower is not None and upper is not None:
        low, high = finite_numbers("lower", lower, robot.n), finite_numbers("upper", upper, robot.n)
        if not (low < high).all():
            raise InvalidInput(f"lower, upper: need lower < upper, got {low.tolist()} and {high.tolist()}")
        return low, high
    if lower is not None or upper is not None:
        raise InvalidInput("lower, upper: give both or neither")
    columns = robot.platform.columns if isinstance(robot.platform, JointPlatform) else ()
    low, high = robot.joint_ranges[:, list(columns)]  # (n,) each
    if not len(low) or not (np.isfinite(low) & np.isfinite(high)).all():
        raise InvalidInput(
            f"{robot.name}: the platform's coordinates ({', '.join(robot.axis_names)}) have no limits of "
            f"their own; give lower and upper, {robot.n} numbers each"
        )
    return low, high


def _joint_rates(robot: ParallelRobot, q: Array) -> Array:
    """Compute the joint rates N (P, nv, n) per unit rates of x at q (P, nq)."""
    linearised = assembled_at(robot, q, stacks=True)
    _, N = motor_speeds(robot, linearised)
    return N @ robot.platform.rate_matrix(robot.platform.coordinates(linearised.frames))


def _joint_inertia(robot: ParallelRobot) -> Array:
    """Return the inertia (n_a,) of rotors and armature on the motors' joints [kg m^2, kg]."""
    joints = robot.actuated
    return np.asarray(robot.rotors[joints] + robot.model.armature[joints], float)


def _rotor_inertia(robot: ParallelRobot, N: Array) -> Array:
    """Compute the inertia N_a' I N_a (P, n, n) of rotors along the platform's axes [kg m^2, kg]."""
    N_a = N[:, robot.actuated]  # (P, n_a, n)
    return N_a.swapaxes(1, 2) @ (_joint_inertia(robot)[:, None] * N_a)


def _with_bodies(robot: ParallelRobot, *, carried: bool) -> ParallelRobot:
    """Return the robot with the inertia of the carried bodies alone, or of all others but the rotors.

    The armature of the platform's joints is carried.
    """
    model = robot.model.copy()
    own = robot.platform.columns if isinstance(robot.platform, JointPlatform) else np.arange(0)
    bodies = {model.frames[robot.frames[0]].parentJoint}
    bodies.update(joint for joint in range(1, model.njoints) if model.joints[joint].idx_v in own)
    for joint in range(1, model.njoints):
        if (joint in bodies) != carried:
            model.inertias[joint] = pin.Inertia.Zero()
    armature = np.where(np.isin(np.arange(robot.nv), own) == carried, robot.model.armature, 0.0)
    armature[robot.actuated] = 0.0
    model.armature = armature
    return replace(robot, model=model)


def _mapping_error(
    robot: ParallelRobot, x0: Array, armature: Array, axis: int, frequency: float
) -> MappingError:
    """Compute the errors of the static mapping in one period of a sine about x0 (n,), of armature (n, n)."""
    times = np.linspace(0.0, 1.0 / frequency, INSTANTS, endpoint=False)
    w = 2 * np.pi * frequency
    step = AMPLITUDE * robot.platform_scale * np.eye(robot.n)[axis]
    x = x0 + np.outer(np.sin(w * times), step)
    dx, ddx = np.outer(w * np.cos(w * times), step), np.outer(-(w**2) * np.sin(w * times), step)
    try:
        q = np.array([assemble(robot, one).q for one in x])
    except FrameworkError as failure:
        raise InvalidInput(
            f"posture: {robot.name} does not reach all of a sine of {AMPLITUDE} rad or robot lengths along "
            f"{robot.axis_names[axis]} about it ({failure.sentence})"
        ) from None
    instant = dynamics_at(robot, q, dx=dx, ddx=ddx)
    N = _joint_rates(robot, q)  # (T, nv, n)
    motors = N[:, robot.actuated]
    mapped = np.vecmat(robot.gear_ratio * instant.torque, motors)
    model = _with_bodies(robot, carried=True).model
    data = model.createData()
    rows = zip(q, instant.v, instant.a, strict=True)
    needed = np.array([pin.rnea(model, data, *row) for row in rows])  # (T, nv)
    damping = damping_forces(robot, q, instant.v)  # (T, nv)
    if isinstance(robot.platform, JointPlatform):
        columns = robot.platform.columns
        of_platform = robot.joint_damping[columns] * instant.v[:, columns]
        needed[:, columns] += of_platform
        damping[:, columns] -= of_platform
    carried = np.vecmat(needed, N)
    springs = np.vecmat(all_spring_forces(robot, q, robot.joint_stiffness) + damping, N)
    error = mapped - carried
    own = np.vecmat(_joint_inertia(robot) * instant.a[:, robot.actuated], motors)
    left = (error, error - ddx @ armature, error - own, error - own - springs)
    largest = [np.abs(one).max(axis=0) for one in (mapped, carried, *left)]
    return MappingError(robot.axis_names[axis], frequency, *largest)
