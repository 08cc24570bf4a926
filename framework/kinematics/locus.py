"""Where a path meets a singularity: all roots of g(s), transversal and tangential, to rounding.

On panels of the path g is a polynomial up to rounding (Chebyshev interpolation with a checked tail),
so its roots and its minima are all found as eigenvalues; each is then polished on the robot itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from framework.arrays import Array
from framework.errors import NotAssembled, NotConverged, SingularPath, Type1Singularity, point
from framework.kinematics.assembly import loop_rows, passive_columns
from framework.kinematics.closures import loop_equations, scaled
from framework.kinematics.inverse_kinematics import System, moving_columns, system_at
from framework.kinematics.platform import path_twist
from framework.kinematics.singularity import (
    VANISHED,
    Border,
    bordered,
    measured_matrix,
    uncontrolled_motion,
)
from framework.kinematics.tracking import Track, track_path, weakest_leg
from framework.model import ParallelRobot
from framework.motion.chebyshev import coefficients, extrema, nodes, real_roots, tail
from framework.motion.path import Path

PANEL_NODES = 24
RESOLVED = 1e-9  # tail of g on a panel; roots are polished afterwards
NARROWEST = 2e-4  # panel of s that still does not resolve: a border or the branch itself breaks down
LARGEST_ETA = 20.0  # a border that has turned away from the null vector
ON_THE_LOCUS = 1e-7  # |g| all along a panel: the path does not cross the locus, it follows it
TOUCH = 1e-12  # |g| over its largest value along the path: a minimum this deep touches the locus


@dataclass(frozen=True, eq=False)
class SingularPoint:
    """A place on the path where the motors lose hold of the robot, springs at rest.

    `kind` is type_2, leg_passive, constraint or closure (see `uncontrolled_motion`); `contact` is
    transversal or tangential. `slope` is dg/ds. `motion` are the joint rates of the twist.
    """

    s: float
    kind: str
    contact: str
    corank: int
    twist: Array  # (n,) t_s, unit, pointing along the path
    platform: Array  # (n,)
    slope: float
    q: Array  # (nq,)
    motion: Array  # (nv,)


def locate_singularities(
    robot: ParallelRobot, path: Path, *, track: Track | None = None
) -> tuple[SingularPoint, ...]:
    """All singular points on the path, ascending in s, each to rounding in s.

    Args:
        track: the path as followed by `track_path`, if at hand.

    Raises:
        OutOfReach, Type1Singularity: the path cannot be followed, or meets a stretched or folded leg.
        SingularPath: the path runs along the singular locus.
        NotConverged: g cannot be resolved, or needs loop equations that were dropped; says where.
    """
    track = track_path(robot, path) if track is None else track

    def mobile(system: System) -> Array:
        rows = loop_rows(robot)
        both = [scaled(robot, system.platform, None), scaled(robot, system.closures, rows)]
        return np.concatenate(both, axis=1)[:, :, moving_columns(robot)]

    def passive(system: System) -> Array:
        return measured_matrix(robot, system)

    samples = _Samples(track, {})
    try:
        type_1 = [s for s, _ in _contacts(samples, mobile) if _is_type_1(track, s)]
    except _Unresolved as unresolved:  # the branch has a kink, or another one meets it
        type_1 = [_weakest_place(track, mobile, unresolved.s)]
    if type_1:
        raise _type_1(track, type_1[0])
    if not len(passive_columns(robot)):  # every joint has a motor: locked, nothing moves
        return ()
    contacts = _contacts(samples, passive)
    for s, _ in contacts:
        _refuse_dropped_rows(track, s)
    return tuple(_singular_point(track, s, contact) for s, contact in contacts)


def _weakest_place(track: Track, matrix: Callable[[System], Array], s: float) -> float:
    """Where near s the matrix is nearest to singular: at a knot of the track, or to three digits."""
    near = track.s[np.abs(track.s - s) < 10 * NARROWEST]
    places = np.append(near, round(s, 3))
    system = system_at(track.robot, track.guess(places), track.path(places))
    return float(places[np.argmin(np.linalg.svd(matrix(system), compute_uv=False)[:, -1])])


def _refuse_dropped_rows(track: Track, s: float) -> None:
    """Raise NotConverged if the loops keep their rank at s and only the rows chosen at the reference lose it.

    An overconstrained robot repeats its loop equations in proportions that change as it moves; the rows
    that say it all at the reference need not do so everywhere.
    """
    robot, system = track.robot, track.closed(s).system
    columns = moving_columns(robot)
    whole = scaled(robot, loop_equations(robot.rows, system.frames).jacobian, robot.rows)[0][:, columns]
    kept = scaled(robot, system.closures, loop_rows(robot))[0][:, columns]
    every, chosen = (np.linalg.svd(part, compute_uv=False) for part in (whole, kept))
    if np.sum(chosen > VANISHED) < np.sum(every > VANISHED):
        dropped = sorted(set(robot.rows.names) - set(loop_rows(robot).names))
        raise NotConverged(
            f"{robot.name}: the loops are sound at s = {s:.6g}, but the loop equations that were dropped as "
            f"redundant at the reference ({', '.join(dropped)}) are needed there; give a reference nearer to "
            f"this place",
            residual=float(chosen[-1]),
        )


def _is_type_1(track: Track, s: float) -> bool:
    """Whether the platform stops following the joints at s; not that joints stop following the platform,
    as they do where they move without it."""
    _refuse_dropped_rows(track, s)
    system = track.closed(s).system
    values = np.linalg.svd(measured_matrix(track.robot, system)[0], compute_uv=False)
    smallest = values.min(initial=np.inf)
    return bool(smallest > VANISHED) or uncontrolled_motion(track.robot, system).kind == "type_2"


class _Unresolved(NotConverged):
    """g is not smooth near `s`, however narrow the panel."""

    def __init__(self, name: str, s: float, width: float) -> None:
        super().__init__(
            f"{name}: the singularity measure cannot be resolved near s = {s:.6g}: two motions may "
            f"become uncontrollable at once",
            residual=width,
        )
        self.s = s


class _Samples(NamedTuple):
    """The path closed on the nodes of panels, each panel once."""

    track: Track
    panels: dict[tuple[float, float], System]

    def on(self, start: float, end: float) -> System:
        if (start, end) not in self.panels:
            s = start + 0.5 * (end - start) * (nodes(PANEL_NODES) + 1.0)
            self.panels[start, end] = self.track.closed(s).system
        return self.panels[start, end]


@dataclass(frozen=True)
class _Panel:
    start: float
    end: float
    series: Array  # (size,) Chebyshev coefficients of g

    def at(self, local: Array) -> Array:
        return self.start + 0.5 * (self.end - self.start) * (np.asarray(local) + 1.0)


def _contacts(samples: _Samples, matrix: Callable[[System], Array]) -> list[tuple[float, str]]:
    """All s where the matrix of the system loses rank, with the contact, ascending."""
    track = samples.track
    panels = _panels(samples, matrix)
    largest = max(float(np.abs(panel.series).sum()) for panel in panels)
    touches: list[tuple[float, str]] = []
    roots: list[tuple[float, str]] = []
    for panel in panels:
        width = panel.end - panel.start
        turning = extrema(panel.series)
        deep = np.abs(chebyshev.chebval(turning, panel.series)) < 1e3 * RESOLVED * largest
        for s in panel.at(turning[deep]):
            s, depth = _polish_touch(track, matrix, float(s))
            if abs(depth) < TOUCH * largest and all(abs(s - other) > 1e-6 for other, _ in touches):
                touches.append((s, _contact(track, matrix, s)))
        for start in panel.at(real_roots(panel.series)):
            s, depth = _polish_root(track, matrix, float(start))
            is_root = abs(depth) < TOUCH * largest and abs(s - start) < 1e-3 * width
            # a touch is also a close pair of roots, and a root on the edge of two panels is found twice
            new = all(abs(s - other) > 1e-10 for other, _ in roots)
            if is_root and new and _contact(track, matrix, s) == "transversal":
                roots.append((s, "transversal"))
    alone = [root for root in roots if all(abs(root[0] - s) > 1e-4 for s, _ in touches)]
    return sorted(touches + alone)


def _panels(samples: _Samples, matrix: Callable[[System], Array]) -> list[_Panel]:
    """g on panels of [0, 1], each resolved; split where it is not."""
    track = samples.track
    edges = np.concatenate(([0.0], track.path.knots, [1.0]))
    waiting = list(pairwise(edges))[::-1]
    done: list[_Panel] = []
    while waiting:
        start, end = waiting.pop()
        panel = _resolve(samples, matrix, start, end)
        if panel is not None:
            done.append(panel)
            continue
        middle = 0.5 * (start + end)
        if end - start < NARROWEST:
            raise _Unresolved(track.robot.name, middle, end - start)
        waiting += [(middle, end), (start, middle)]
    return done


def _resolve(samples: _Samples, matrix: Callable[[System], Array], start: float, end: float) -> _Panel | None:
    """g on one panel, or None when its tail is too large or the border unfit."""
    try:
        matrices = matrix(samples.on(start, end))
    except NotAssembled:
        return None
    eta, g = bordered(matrices, Border.of(matrices[PANEL_NODES // 2]))
    largest = float(np.abs(g).max())
    if largest < ON_THE_LOCUS:
        raise SingularPath(
            f"{samples.track.robot.name}: the path runs along a singularity from s = {start:.6g} to {end:.6g}"
        )
    series = coefficients(g[:, None])
    if np.linalg.norm(eta, axis=1).max() > LARGEST_ETA or tail(series) > max(RESOLVED, 1e-13 / largest):
        return None
    return _Panel(start, end, series[:, 0])


def _polish_root(track: Track, matrix: Callable[[System], Array], s: float) -> tuple[float, float]:
    """Newton on g with the border of the root itself, and g there; slope by central differences."""
    h, depth = 1e-4, np.inf
    for _ in range(6):
        at = np.clip([s - h, s, s + h], 0.0, 1.0)
        matrices = matrix(track.closed(at).system)
        g = bordered(matrices, Border.of(matrices[1])).g
        depth = float(g[1])
        if g[2] == g[0] or abs(depth) < 1e-15:
            break
        step = -depth * (at[2] - at[0]) / (g[2] - g[0])
        if not abs(step) < h:
            break
        s = float(np.clip(s + step, 0.0, 1.0))
        if abs(step) < 1e-8:  # the next step would be h^2 of it, and what is left of g rounding
            depth = 0.0
            break
    return s, depth


def _contact(track: Track, matrix: Callable[[System], Array], s: float) -> str:
    """transversal if g changes its sign at s (or the path ends there), tangential if it keeps it."""
    h = 1e-6  # far more than the rounding of s, far less than what separates two crossings worth the name
    if not h < s < 1 - h:
        return "transversal"
    matrices = matrix(track.closed([s - h, s, s + h]).system)
    g = bordered(matrices, Border.of(matrices[1])).g
    return "tangential" if g[0] * g[2] > 0 else "transversal"


def _polish_touch(track: Track, matrix: Callable[[System], Array], s: float) -> tuple[float, float]:
    """The extremum of g near s and g there, on a panel of its own centred on it."""
    for width in (0.04, 0.04, 0.04):
        start, end = max(0.0, s - width), min(1.0, s + width)
        local = start + 0.5 * (end - start) * (nodes(PANEL_NODES) + 1.0)
        matrices = matrix(track.closed(np.append(local, s)).system)
        g = bordered(matrices, Border.of(matrices[-1])).g
        series = coefficients(g[:-1, None])[:, 0]
        turning = extrema(series)
        if not len(turning):
            return s, float(g[-1])
        centre = 2 * (s - start) / (end - start) - 1
        best = turning[np.argmin(np.abs(turning - centre))]
        depth = float(chebyshev.chebval(best, series))
        s = start + 0.5 * (end - start) * (float(best) + 1)
    return s, depth


def _singular_point(track: Track, s: float, contact: str) -> SingularPoint:
    robot = track.robot
    h = 1e-4
    at = np.clip([s - h, s, s + h], 0.0, 1.0)
    closed = track.closed(at)
    P = measured_matrix(robot, closed.system)
    g = bordered(P, Border.of(P[1])).g
    # a border taken at the root knows no sign of det: give g the sign of det P beyond it
    sign = np.sign(g[2]) * np.linalg.slogdet(P[2])[0] if at[2] > s else 1.0
    uncontrolled = uncontrolled_motion(robot, closed.system.at(1))
    forward = np.dot(uncontrolled.twist, path_twist(robot, track.path, s))
    along = -1.0 if forward < 0 else 1.0
    return SingularPoint(
        s=s,
        kind=uncontrolled.kind,
        contact=contact,
        corank=uncontrolled.corank,
        twist=along * uncontrolled.twist,
        platform=track.path(s),
        slope=float(sign * (g[2] - g[0]) / (at[2] - at[0])),
        q=closed.q[1],
        motion=along * uncontrolled.motion,
    )


def _type_1(track: Track, s: float) -> Type1Singularity:
    robot = track.robot
    x = track.path(s)
    joint = weakest_leg(robot, system_at(robot, track.guess(np.array([s])), x[None]))
    return Type1Singularity(
        f"{robot.name}: the path meets a Type 1 singularity at s = {s:.6g}, "
        f"{', '.join(robot.axis_names)} = {point(x)}: the leg of {joint} is stretched or folded there",
        s=s,
        platform=x,
        joint=joint,
    )
