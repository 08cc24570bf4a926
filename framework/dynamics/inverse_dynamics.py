"""Motor torques along a path under a given motion law, through Type 2 singularities, with proof.

Torques, motor angles and deflections are functions of time on Chebyshev nodes. Where the motion meets
a Type 2 singularity they are a quotient 0/0 if the law respects condition (8), t_s . W_p = 0, and have
a pole if it does not. The first is no event for interpolation between nodes; the second is found on the
singular instant itself, and by coefficients that do not fall.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from framework.arrays import Array, ArrayLike
from framework.dynamics.certificate import Certificate
from framework.dynamics.elasticity import Deflected, LawChoice, settle
from framework.dynamics.forces import motor_torque, tree_forces
from framework.errors import (
    InvalidInput,
    NoLaw,
    NotAssembled,
    NotConverged,
    UnboundedTorque,
    choose_from,
    point,
)
from framework.kinematics.frames import move, offset
from framework.kinematics.inverse_kinematics import close_loops, mode_signs, motion_at, system_at
from framework.kinematics.locus import SingularPoint, locate_singularities
from framework.kinematics.singularity import (
    UNCROSSABLE,
    Border,
    bordered,
    measured_matrix,
    uncontrolled_motion,
)
from framework.kinematics.tracking import Track, track_path
from framework.model import ParallelRobot
from framework.motion.chebyshev import TimeFunction, TimeGrid, real_roots
from framework.motion.law import OVERSHOOT, Law, MotionLaw
from framework.motion.path import Path, along

GEOMETRIES = ("rigid", "deformed")
LOOSEST = 1e-6  # tolerance that still tells a resolved torque from a pole
TOLERANCE = 1e-10  # tail of the torques that counts as resolved
SIZES = (64, 128, 256, 512)  # nodes a panel, tried in turn
STANDING = 1e-7  # speed at a crossing over the largest one: no more than that is a stop
# |t_s . W_p| at a passage over the largest sum of its terms:
PROVED = 1e-11  # no more than this is rounding, and condition (8) holds
POLE = 1e-6  # more than this is a pole for sure, resolved or not
CLOSED_BETWEEN = 1e-9  # loop equations between the nodes, in lengths of the robot and radians


@dataclass(frozen=True, eq=False)
class Passage:
    """An instant at which the motion is in a Type 2 singularity.

    `wrench` is t_s . W_p there [N, or N m for a pure turn], the inertia of all bodies included; `scale`
    is the largest sum of the sizes of its terms along the motion, at least mass length / duration^2.
    Condition (8) holds when wrench / scale is rounding.
    """

    time: float
    s: float
    platform: Array  # (n,)
    twist: Array  # (n,)
    kind: str
    wrench: float
    scale: float

    @property
    def residual(self) -> float:
        """|t_s . W_p| relative to `scale`."""
        return abs(self.wrench) / self.scale if self.scale > 0 else 0.0


@dataclass(frozen=True, repr=False, eq=False)
class InverseDynamics:
    """Torques of a motion as functions of time, with the certificate."""

    robot: ParallelRobot
    path: Path
    law: MotionLaw
    geometry: str
    torques: TimeFunction  # (n_a) [N m], motor side
    motor_angles: TimeFunction  # (n_a) [rad], motor side
    deflections: TimeFunction  # (n_e) [m, rad]
    offsets: TimeFunction  # (nv) all coordinates as tangent offset from `origin`
    origin: Array  # (nq,)
    passages: tuple[Passage, ...]
    certificate: Certificate

    def __repr__(self) -> str:
        return (
            f"InverseDynamics({self.robot.name}, {self.robot.flexibility}, {self.geometry}: "
            f"{self.duration:g} s, passages at {[round(p.time, 6) for p in self.passages]} s, tail "
            f"{self.certificate.tail:.1e})"
        )

    @property
    def duration(self) -> float:
        return self.law.duration

    def torque(self, t: ArrayLike, order: int = 0) -> Array:
        """Motor torques [N m] or their time derivatives; t (T,) gives (T, n_a), a scalar (n_a,)."""
        return self.torques(t, order)

    def motor_angle(self, t: ArrayLike, order: int = 0) -> Array:
        """Motor angles [rad] (gear ratio times joint angle), (T, n_a)."""
        return self.motor_angles(t, order)

    def deflection(self, t: ArrayLike, order: int = 0) -> Array:
        """Deflections of the springs [m, rad], (T, n_e)."""
        return self.deflections(t, order)

    def platform(self, t: ArrayLike, order: int = 0) -> Array:
        """Platform coordinates [m, rad] or their time derivatives up to order 4, (T, n)."""
        times = np.asarray(t, dtype=float)
        return along(self.path, [self.law(times, k) for k in range(order + 1)])[order]

    def configuration(self, t: ArrayLike) -> Array:
        """All joint coordinates q (T, nq) at t (T,), deflections included."""
        return move(self.robot, self.origin, self.offsets(np.atleast_1d(t)))

    def velocity(self, t: ArrayLike, order: int = 1) -> Array:
        """Joint velocities (order 1) or accelerations (order 2), (T, nv)."""
        return self.offsets(np.atleast_1d(t), order)


def inverse_dynamics(
    robot: ParallelRobot,
    path: Path,
    law: MotionLaw,
    *,
    geometry: str | None = None,
    tolerance: float = TOLERANCE,
) -> InverseDynamics:
    """Torques for a path under any law that a user brings.

    Args:
        law: `law(t, order)` with `duration` [s] and values in [0, 1]; smooth between path knots.
        geometry: "rigid" (small displacements: forces of the undeformed robot) or "deformed", the
            default for elastic robots.
        tolerance: tail of the torques that counts as resolved.

    Raises:
        InvalidInput: geometry unknown, law leaves [0, 1] or is not finite, path does not fit.
        UnboundedTorque: the law violates condition (8) at a singular instant: no torque is returned.
        NoLaw: the motion stops on the locus, or meets a singularity that no law can cross.
        NotConverged: torques or deflections cannot be resolved to the tolerance.
        OutOfReach, Type1Singularity, SingularPath: see `locate_singularities`.
    """
    geometry = checked_geometry(robot, geometry)
    _check_law(law)
    track = track_path(robot, path)
    points = locate_singularities(robot, path, track=track)
    return resolve(track, points, lambda *_: law, geometry=geometry, tolerance=tolerance)


def checked_geometry(robot: ParallelRobot, geometry: str | None) -> str:
    """The geometry to use: deformed by default when the robot has springs."""
    if geometry is None:
        return "deformed" if robot.n_e else "rigid"
    if geometry not in GEOMETRIES:
        raise InvalidInput(choose_from("geometry", geometry, GEOMETRIES))
    return geometry if robot.n_e else "rigid"


def resolve(
    track: Track,
    points: tuple[SingularPoint, ...],
    choose_law: LawChoice,
    *,
    geometry: str,
    tolerance: float,
) -> InverseDynamics:
    """Double the nodes until the torques are resolved, or tell why they never are."""
    if not 0 < tolerance <= LOOSEST:
        raise InvalidInput(f"tolerance: must lie in (0, {LOOSEST:g}], got {tolerance!r}")
    law = choose_law(None, None)
    passages = rigid_passages(track, points, law)
    fixed_geometry = geometry == "rigid"
    if fixed_geometry:
        _refuse_pole(track.robot, passages, PROVED)
    instants = np.array([passage.time for passage in passages])
    start: TimeFunction | None = None
    tail = np.inf
    for size in SIZES:
        grid = TimeGrid.clear_of(instants, _panel_edges(track.path, law), size)
        try:
            state = settle(track, grid, choose_law, geometry, start, law)
        except NotAssembled as failure:
            _refuse_pole(track.robot, passages, POLE)
            raise NotConverged(
                f"{track.robot.name}: the deflections tear the loops open: the springs are too soft for this "
                f"motion; stiffen them, take more time, or use geometry rigid ({failure})",
                residual=failure.residual,
            ) from None
        except NotConverged:
            _refuse_pole(track.robot, passages, POLE)
            raise
        law = state.law
        result = _result(track, state, geometry, passages)
        tail = result.certificate.tail
        start = result.deflections if geometry == "deformed" else None
        if not fixed_geometry:
            passages = tuple(_deformed_passage(result, passage) for passage in passages)
        closed = result.certificate.max_closure_error <= CLOSED_BETWEEN * max(track.robot.length, 1.0)
        if tail <= tolerance and closed and _law_is_resolved(law, grid):
            _refuse_pole(track.robot, passages, PROVED)
            _check_passages(track.robot, state, geometry, passages)
            return replace(result, passages=passages)
    _refuse_pole(track.robot, passages, POLE)
    raise NotConverged(
        f"{track.robot.name}: the torques are not resolved by {grid.size} nodes a panel (tail "
        f"{tail:.2g}, tolerance {tolerance:.2g}): is the law smooth, is the path far from other "
        f"singularities?",
        residual=tail,
    )


def _check_law(law: MotionLaw) -> None:
    duration = law.duration
    if not (np.isfinite(duration) and duration > 0):
        raise InvalidInput(f"law: duration must be a positive number of seconds, got {duration!r}")
    s = np.asarray(law(np.linspace(0.0, duration, 257)), dtype=float)
    if s.shape != (257,) or not np.all(np.isfinite(s)):
        raise InvalidInput("law: must give one finite s for each t")
    if s.min() < -OVERSHOOT or s.max() > 1 + OVERSHOOT:
        raise InvalidInput(f"law: s must stay in [0, 1], got values from {s.min():.6g} to {s.max():.6g}")


def _law_is_resolved(law: MotionLaw, grid: TimeGrid) -> bool:
    """Whether the law is what its values on the nodes say, looked at 16 times as finely."""
    if isinstance(law, Law):
        return True  # a polynomial of lower degree than there are nodes
    times = np.linspace(0.0, law.duration, 16 * len(grid.times))
    through_nodes = grid.fit(np.asarray(law(grid.times))[:, None])(times)[:, 0]
    return bool(np.abs(law(times) - through_nodes).max() <= CLOSED_BETWEEN)


def _panel_edges(path: Path, law: MotionLaw) -> Array:
    """Ends of the motion and the instants at which the path has a knot."""
    whole = np.array([0.0, law.duration])
    inner = [_instants(law, whole, knot) for knot in path.knots]
    return np.unique(np.concatenate([whole, *inner])) if inner else whole


def _instants(law: MotionLaw, edges: Array, s: float) -> Array:
    """All t with law(t) = s."""
    grid = TimeGrid(edges, 65)
    function = grid.fit(np.asarray(law(grid.times))[:, None])
    found = []
    for start, end, series in zip(edges[:-1], edges[1:], function.coefficients[..., 0], strict=True):
        shifted = series.copy()
        shifted[0] -= s
        for t in start + 0.5 * (end - start) * (real_roots(shifted) + 1.0):
            for _ in range(3):
                slope = float(law(np.array([t]), 1)[0])
                if slope != 0.0:
                    t = np.clip(t - (float(law(np.array([t]))[0]) - s) / slope, start, end)
            if abs(float(law(np.array([t]))[0]) - s) < 1e-12:  # a root, and not a near miss
                found.append(t)
    times = np.sort(np.array(found))
    keep = np.concatenate(([True], np.diff(times) > 1e-9 * (edges[-1] - edges[0])))
    return times[keep[: len(times)]]


def rigid_passages(track: Track, points: tuple[SingularPoint, ...], law: MotionLaw) -> tuple[Passage, ...]:
    """All instants at which the law takes the undeformed robot through a singular point.

    Raises:
        NoLaw: the motion stands still on one of them, or one is not of Type 2.
    """
    for at in points:
        if at.kind != "type_2":
            raise NoLaw(f"{track.robot.name}: at s = {at.s:.6g} the path meets {UNCROSSABLE[at.kind]}")
    edges = _panel_edges(track.path, law)
    return tuple(_rigid_passage(track, law, t, at) for at in points for t in _instants(law, edges, at.s))


def _rigid_passage(track: Track, law: MotionLaw, t: float, at: SingularPoint) -> Passage:
    """t_s . W_p of the undeformed robot when the law takes it through a singular point at time t."""
    speed = float(law(np.array([t]), 1)[0])
    quickest = float(np.abs(law(np.linspace(0, law.duration, 101), 1)).max())
    if abs(speed) <= STANDING * quickest:
        raise NoLaw(
            f"{track.robot.name}: the motion stands still on a Type 2 singularity at t = {t:.6g} s, "
            f"s = {at.s:.6g}: a stop on the locus can never be crossed; shift the path's end or the law"
        )
    times = np.concatenate(([t], np.linspace(0.0, law.duration, 33)))
    s = [law(times, order) for order in range(3)]
    x, dx, ddx = along(track.path, s)
    closed = close_loops(track.robot, x, track.guess(s[0]))
    forces = tree_forces(track.robot, motion_at(track.robot, closed, dx, ddx))
    mass = sum(inertia.mass for inertia in track.robot.model.inertias)
    least = mass * track.robot.length / law.duration**2
    scale = max(float(np.abs(forces * at.motion).sum(axis=1).max()), least)
    return Passage(t, at.s, at.platform, at.twist, at.kind, float(forces[0] @ at.motion), scale)


def _deformed_passage(result: InverseDynamics, near: Passage) -> Passage:
    """The same passage in the deformed robot: where and when g vanishes, and t_s . W_p there."""
    robot, t = result.robot, near.time
    h = 1e-4 * result.duration
    for _ in range(4):
        times = np.clip([t - h, t, t + h], 0.0, result.duration)
        q = result.configuration(times)
        system = system_at(robot, q, result.platform(times))
        P = measured_matrix(robot, system)
        g = bordered(P, Border.of(P[1])).g
        step = -g[1] * (times[2] - times[0]) / (g[2] - g[0])
        t = float(np.clip(t + step, 0.0, result.duration))
        if abs(step) < 1e-15 * result.duration:
            break
    closed = close_loops(robot, result.platform(np.array([t])), result.configuration(t))
    times = np.array([t])
    motion = motion_at(
        robot,
        closed,
        result.platform(times, 1),
        result.platform(times, 2),
        result.deflections(times, 1),
        result.deflections(times, 2),
    )
    uncontrolled = uncontrolled_motion(robot, closed.system)
    along_path = -1.0 if np.dot(uncontrolled.twist, near.twist) < 0 else 1.0
    wrench = float(tree_forces(robot, motion)[0] @ uncontrolled.motion) * along_path
    return Passage(
        time=t,
        s=float(result.law(times)[0]),
        platform=result.platform(t),
        twist=along_path * uncontrolled.twist,
        kind=uncontrolled.kind,
        wrench=wrench,
        scale=near.scale,
    )


def _refuse_pole(robot: ParallelRobot, passages: tuple[Passage, ...], allowed: float) -> None:
    """Raise UnboundedTorque for the worst passage whose residual is above what is allowed."""
    worst = max(passages, key=lambda passage: passage.residual, default=None)
    if worst is None or worst.residual <= allowed:
        return
    unit = "N" if np.any(np.abs(worst.twist[robot.platform_axes < 3]) > 0) else "N m"
    raise UnboundedTorque(
        f"{robot.name}: unbounded torque at t = {worst.time:.9g} s, s = {worst.s:.12g}, "
        f"{', '.join(robot.axis_names)} = {point(worst.platform)}: a Type 2 singularity with "
        f"t_s . W_p = {worst.wrench:.6g} {unit} where condition (8) asks for zero",
        time=worst.time,
        s=worst.s,
        platform=worst.platform,
        wrench=worst.wrench,
    )


def _result(track: Track, state: Deflected, geometry: str, passages: tuple[Passage, ...]) -> InverseDynamics:
    robot, grid = track.robot, state.grid
    torques = grid.fit(motor_torque(robot, state.motion, state.forces.joint_torque))
    u = offset(robot, track.origin, state.motion.q)
    offsets = grid.fit(u)
    turned = offset(robot, pin.neutral(robot.model), track.origin[None]) + u
    motor = grid.fit(robot.gear_ratio * turned[:, robot.actuated])
    deflections = grid.fit(state.q_e)
    s = state.law(grid.times)
    result = InverseDynamics(
        robot=robot,
        path=track.path,
        law=state.law,
        geometry=geometry,
        torques=torques,
        motor_angles=motor,
        deflections=deflections,
        offsets=offsets,
        origin=track.origin,
        passages=passages,
        certificate=Certificate(
            nodes=len(grid.times),
            tail=max(torques.tail, deflections.tail),
            passes=max(len(state.changes), 1),
            change=state.changes[-1] if state.changes else 0.0,
            max_closure_error=0.0,
            end_speed=_end_speed(robot, state),
            monotone=bool(np.all(np.diff(s) > -1e-14)),
        ),
    )
    error = _closure_error_between(result, grid)
    return replace(result, certificate=replace(result.certificate, max_closure_error=error))


def _end_speed(robot: ParallelRobot, state: Deflected) -> float:
    """Largest motor speed at both ends of the motion over the largest one on the way."""
    speeds = np.abs(robot.gear_ratio * state.motion.v[:, robot.actuated])
    quickest = float(speeds.max(initial=0.0))
    return float(speeds[[0, -1]].max(initial=0.0)) / quickest if quickest > 0 else 0.0


def _closure_error_between(result: InverseDynamics, grid: TimeGrid) -> float:
    """Largest loop or platform equation half-way between the nodes, nothing solved there."""
    times = grid.times
    middle = 0.5 * (times[1:] + times[:-1])
    system = system_at(result.robot, result.configuration(middle), result.platform(middle))
    return float(np.abs(system.residual).max())


def _check_passages(
    robot: ParallelRobot, state: Deflected, geometry: str, passages: tuple[Passage, ...]
) -> None:
    """The assembly mode must change exactly at the known passages.

    With rigid geometry only the motors deflect, after the fact: what `motion` shows then proves nothing.
    """
    if geometry == "rigid" and robot.n_e:
        return
    signs = mode_signs(robot, state.motion.system)[1]
    times = state.grid.times
    for k in np.flatnonzero(signs[1:] != signs[:-1]):
        if not any(times[k] <= passage.time <= times[k + 1] for passage in passages):
            raise NoLaw(
                f"{robot.name}: the deflected robot meets a Type 2 singularity between t = "
                f"{times[k]:.6g} and {times[k + 1]:.6g} s that the undeflected one does not"
            )


__all__ = ["InverseDynamics", "Passage", "inverse_dynamics"]
