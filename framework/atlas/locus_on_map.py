"""The singular locus within a map: traced curves of the map's own branch, held against the map's signs of g.

Starts of the tracing are the poses beside which g changes its sign, and those where |g| is least among its
neighbours. A traced curve belongs to the map where a step of inverse kinematics from the nearest pose leads
to the curve's own configuration. So each point is singular, and of the poses' own branch. That the locus is
complete is not claimed: a curve may lie between the poses, so small that no sign of g tells. But each change
of sign between neighbours that no curve explains is told.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from framework.arrays import Array, BoolArray, IntArray, ReadOnlyArrays
from framework.atlas.sweep import Reason, ReasonArray, stepped
from framework.atlas.window import Window
from framework.errors import InvalidInput
from framework.kinematics.frames import frames_at
from framework.kinematics.inverse_kinematics import system_at
from framework.kinematics.legs import leg_signs
from framework.kinematics.parallel_robot import ParallelRobot
from framework.singularity.locus_equations import LocusEquations
from framework.singularity.traced_locus import LocusCurve, trace_locus

SEEDS = 24  # sign changes of a round that tracing starts from, evenly chosen
ROUNDS = 4  # each from further sign changes, which the curves so far do not pass
SAME = 0.25  # cells between curves that are one: on one branch of the map they have the same joints
TOUCHES = 16  # least |g| that it starts from: curves along which g keeps its sign
STEPS = 16.0  # of a curve along half an edge of the window, at least
AROUND = 1.05  # half the edge of the region followed, to the window's farthest side
ALIKE = 1e-6  # [rad, lengths] between a curve's configuration and that of the map; branches are far apart
HALF_TURN = 3.0  # [rad] between neighbours: the angle has been counted on from pi to -pi


@dataclass(frozen=True, eq=False)
class MapCurve(ReadOnlyArrays):
    """A curve of the locus through m points."""

    x: Array  # (m, 2) the map's two coordinates
    q: Array  # (m, nq)


@dataclass(frozen=True, eq=False)
class MapLocus(ReadOnlyArrays):
    """The locus on the branch of a map, or why it is not traced."""

    curves: tuple[MapCurve, ...]
    sign_changes: int  # of g between neighbouring poses
    unexplained: Array  # (u, 2) where g changes its sign and no curve passes within a cell
    why_not: str  # empty if it was traced
    seconds: float

    @property
    def told(self) -> str:
        """What is known of the locus, in words."""
        if self.why_not:
            return f"not traced: {self.why_not}"
        count, missed = len(self.curves), len(self.unexplained)
        curves = "no curve" if not count else "1 curve" if count == 1 else f"{count} curves"
        rest = "all explained" if not missed else f"at {missed} no curve passes"
        signs = f"g changes its sign between {self.sign_changes} neighbours, {rest}"
        if not self.sign_changes:
            signs = "g does not change its sign"
        return f"{curves} traced; {signs}; completeness is not claimed"


def locus_on_map(robot: ParallelRobot, window: Window, q: Array, reason: ReasonArray, g: Array) -> MapLocus:
    """The locus over a window, from its configurations q (I, J, nq), their reasons and g (I, J)."""
    started = time.perf_counter()
    x, first = window.points(), tuple(np.argwhere(reason == Reason.REACHED)[0])
    try:
        equations = LocusEquations.of(robot, q[first], x[first], _free(robot, window))
    except InvalidInput as error:
        return MapLocus((), 0, np.zeros((0, 2)), str(error), 0.0)
    changes, least = _sign_changes(g), _least(g)
    curves, left = list[MapCurve](), np.ones(len(changes), dtype=bool)
    beside, alone = (_modes(robot, q, x, places) for places in (changes[:, :2], least))
    modes, counts = np.unique(np.concatenate([beside, alone]), axis=0, return_counts=True)
    for mode in modes[np.argsort(-counts, kind="stable")]:
        own = (beside == mode).all(axis=1)
        starts = [q[tuple(at)] for at in least[(alone == mode).all(axis=1)]]
        for _ in range(ROUNDS):
            todo = np.flatnonzero(left & own)
            starts += [q[tuple(at)] for at in changes[_spread_out(todo), :2]]
            if not starts:
                break
            for curve in _traced(robot, window, starts):
                parts = _parts(equations, window, q, reason, curve)
                curves += [part for part in parts if _apart(window, part.x, curves, SAME).any()]
            left = _apart(window, _middles(window, changes), curves, 1.0)
            unexplained = np.count_nonzero(left & own)
            if unexplained in (0, len(todo)) or len(todo) <= SEEDS:
                break
            starts = []
    found = (tuple(curves), len(changes), _middles(window, changes[left]))
    return MapLocus(*found, "", time.perf_counter() - started)


def _spread_out(places: IntArray) -> IntArray:
    """`SEEDS` of places, evenly chosen."""
    if len(places) <= SEEDS:
        return places
    return places[np.linspace(0, len(places) - 1, SEEDS).round().astype(np.intp)]


def _free(robot: ParallelRobot, window: Window) -> tuple[str, str]:
    return robot.axis_names[window.axes[0]], robot.axis_names[window.axes[1]]


def _modes(robot: ParallelRobot, q: Array, x: Array, places: IntArray) -> Array:
    """The sign of each leg (e, legs) at some poses of the map."""
    i, j = places.T
    return leg_signs(robot, system_at(robot, q[i, j], x[i, j]))


def _traced(robot: ParallelRobot, window: Window, starts: list[Array]) -> list[LocusCurve]:
    """The curves near starts, all in the mode of the first, as far as the window goes."""
    axes = list(window.axes)
    centre = robot.platform.coordinates(frames_at(robot, starts[0][None]))[0, axes]
    lengths = np.where(robot.translations, robot.length, 1.0)[axes]
    reach = AROUND * float((np.abs(np.stack([window.lower, window.upper]) - centre) / lengths).max())
    traced = trace_locus(
        robot,
        starts[0],
        free=_free(robot, window),
        reach=reach,
        starts=0,
        one_mode=True,
        near=starts,
        longest=reach / STEPS,
    )
    return [curve for curve in traced.curves if curve.kind != "joints_only"]


# ------------------------------------------------------------------ the map's signs


def _sign_changes(g: Array) -> IntArray:
    """Neighbours between which g changes its sign: (e, 4), the first's place and the second's."""
    found = []
    for down, right in ((1, 0), (0, 1)):
        one, two = g[: len(g) - down, : g.shape[1] - right], g[down:, right:]
        at = np.argwhere(one * two < 0)
        found.append(np.concatenate([at, at + np.array([down, right])], axis=1))
    return np.concatenate(found)


def _least(g: Array) -> IntArray:
    """Places (t, 2) where |g| is less than at all of eight neighbours."""
    size = np.pad(np.where(np.isfinite(g), np.abs(g), np.inf), 1, constant_values=np.inf)
    rows, columns = g.shape
    shifts = [(i, j) for i in range(3) for j in range(3) if (i, j) != (1, 1)]
    around = np.min([size[i : i + rows, j : j + columns] for i, j in shifts], axis=0)
    own = size[1:-1, 1:-1]
    at = np.argwhere(own < around)
    return at[np.argsort(own[tuple(at.T)], kind="stable")[:TOUCHES]]


def _middles(window: Window, changes: IntArray) -> Array:
    """The middles (e, 2) of neighbours."""
    return window.lower + 0.5 * (changes[:, :2] + changes[:, 2:]) * window.cell


def _apart(window: Window, places: Array, curves: list[MapCurve], cells: float) -> BoolArray:
    """Which places (e, 2) are more than so many cells away from all curves."""
    away, scaled = np.ones(len(places), dtype=bool), places / window.cell
    for curve in curves:
        points = curve.x / window.cell
        start, way = points[:-1], np.diff(points, axis=0)
        size = np.maximum(np.sum(way**2, axis=1), 1e-300)
        for k in np.flatnonzero(away).tolist():
            off = scaled[k] - start
            share = np.clip(np.sum(off * way, axis=1) / size, 0.0, 1.0)
            away[k] = np.abs(off - share[:, None] * way).max(axis=1).min() > cells
    return away


# ------------------------------------------------------------------ the curves


def _parts(
    equations: LocusEquations, window: Window, q: Array, reason: ReasonArray, curve: LocusCurve
) -> list[MapCurve]:
    """What of a curve is on the branch of the map's poses, cut where an angle jumps by a turn."""
    axes, robot = list(window.axes), equations.robot
    x = curve.x[:, axes]
    place = np.round((x - window.lower) / window.cell).astype(int)
    sure, off = _compared(equations, window, q, reason, curve, place)
    jumps = (np.abs(np.diff(x, axis=0)) > HALF_TURN) & ~robot.translations[axes]
    breaks = np.flatnonzero(jumps.any(axis=1) | (off[1:] != off[:-1])) + 1
    parts = np.split(np.arange(len(x)), breaks)
    return [MapCurve(x[part], curve.q[part]) for part in parts if len(part) > 1 and sure[part].any()]


def _compared(
    equations: LocusEquations,
    window: Window,
    q: Array,
    reason: ReasonArray,
    curve: LocusCurve,
    place: IntArray,
) -> tuple[BoolArray, BoolArray]:
    """Which points (m,) of a curve surely are on the map's branch, and which are not.

    Where inverse kinematics is singular too no step leads to a point: there its configuration is compared
    with the poses around. Points at and beyond the rim of the reached poses may be neither.
    """
    around = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)])
    near = place[:, None] + around  # (m, 9, 2), the point's own in the middle
    there = ((near >= 0) & (near < np.array(window.shape))).all(axis=2)
    near = np.where(there[:, :, None], near, 0)
    there &= reason[near[..., 0], near[..., 1]] == Reason.REACHED
    sure, off = np.zeros((2, len(place)), dtype=bool)
    own = np.flatnonzero(there[:, 4])
    if not len(own):
        return sure, off
    i, j = place[own].T
    step = stepped(equations.robot, q[i, j], window.points()[i, j], curve.x[own])
    with np.errstate(invalid="ignore"):
        gap = np.abs(equations.apart(curve.q[own], step.q)).max(axis=1)
        cells = np.abs(equations.apart(q[i, j][:, None], q[near[own, :, 0], near[own, :, 1]])).max(axis=2)
        far = np.abs(equations.apart(q[i, j], curve.q[own])).max(axis=1)
    among = far <= np.where(there[own], cells, 0.0).max(axis=1)
    led = step.reason == Reason.REACHED
    sure[own] = np.where(led, gap < ALIKE, among)
    off[own] = ~sure[own] & (led | there[own].all(axis=1))
    return sure, off
