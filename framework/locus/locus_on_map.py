"""The singular locus within a map: traced curves of the map's own branch, held against the map's signs of g.

Starts of the tracing are the poses beside which g changes its sign, and those where |g| is least among its
neighbours. A traced curve belongs to the map where a step of inverse kinematics from the nearest pose leads
to the curve's own configuration. So each point is singular, and of the poses' own branch. That the locus is
complete is not claimed: a curve may lie between the poses, so small that no sign of g tells. But each change
of sign between neighbours that no curve explains is told.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray, IntArray, ReadOnlyArrays
from framework.errors import InvalidInput
from framework.kinematics.frames import frames_at
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.modes import leg_signs
from framework.kinematics.parallel_robot import ParallelRobot
from framework.locus.locus_equations import LocusEquations
from framework.locus.traced_locus import LocusCurve, trace_locus
from framework.tolerances import DISTINCT_SOLUTIONS

STARTS_PER_ROUND = 24  # sign changes of a round that tracing starts from, evenly chosen
MAX_ROUNDS = 4  # each from further sign changes, which the curves so far do not pass
# cells between curves that are one: on one branch of the map they have the same joints
SAME_CURVE_CELLS = 0.25
MAX_TOUCHES = 16  # least |g| that it starts from: curves along which g keeps its sign
STEPS_PER_REACH = 16.0  # of a curve along half an edge of the window, at least
REGION_MARGIN = 1.05  # half the edge of the region followed, to the window's farthest side
EXPLAINED_CELLS = 1.0  # between a change of sign and the curve that explains it
MAX_ANGLE_STEP = 3.0  # [rad] between neighbours: the angle has been counted on from pi to -pi


class MapPoses(NamedTuple):
    """A grid of poses over two platform coordinates, on one branch: what a map hands over."""

    axes: tuple[int, int]  # the two platform coordinates
    lower: Array  # (2,) their least values [m, rad]
    upper: Array  # (2,)
    x: Array  # (I, J, n)
    q: Array  # (I, J, nq)
    reached: BoolArray  # (I, J)
    g: Array  # (I, J) NaN where a pose is not reached
    # q (T, nq) at x (T, n) led to other x: configurations there, and which of them are on the same branch
    lead: Callable[[Array, Array, Array], tuple[Array, BoolArray]]

    @property
    def cell(self) -> Array:
        """Distance of neighbours along either axis (2,)."""
        return np.asarray((self.upper - self.lower) / (np.array(self.g.shape) - 1))


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
    def sentence(self) -> str:
        """The result in words."""
        if self.why_not:
            return f"not traced: {self.why_not}"
        count, missed = len(self.curves), len(self.unexplained)
        curves = {0: "no curve", 1: "1 curve"}.get(count, f"{count} curves")
        rest = "all explained" if not missed else f"at {missed} no curve passes"
        signs = f"g changes its sign between {self.sign_changes} neighbours, {rest}"
        if not self.sign_changes:
            signs = "g does not change its sign"
        return f"{curves} traced; {signs}; completeness is not claimed"


def locus_on_map(robot: ParallelRobot, poses: MapPoses) -> MapLocus:
    """Trace the locus over the window of a map, on the branch of its poses."""
    started = time.perf_counter()
    first = tuple(np.argwhere(poses.reached)[0])
    try:
        equations = LocusEquations.of(robot, poses.q[first], poses.x[first], _free(robot, poses))
    except InvalidInput as error:
        return MapLocus((), 0, np.zeros((0, 2)), str(error), 0.0)
    changes, least = _sign_changes(poses.g), _least(poses.g)
    curves, left = list[MapCurve](), np.ones(len(changes), dtype=bool)
    change_modes, least_modes = (_modes(robot, poses, places) for places in (changes[:, :2], least))
    modes, counts = np.unique(np.concatenate([change_modes, least_modes]), axis=0, return_counts=True)
    for mode in modes[np.argsort(-counts, kind="stable")]:
        of_mode = (change_modes == mode).all(axis=1)
        starts = [poses.q[tuple(place)] for place in least[(least_modes == mode).all(axis=1)]]
        for _ in range(MAX_ROUNDS):
            todo = np.flatnonzero(left & of_mode)
            starts += [poses.q[tuple(place)] for place in changes[_spread_out(todo), :2]]
            if not starts:
                break
            for curve in _traced(robot, poses, starts):
                for part in _parts(equations, poses, curve):
                    if _apart(poses, part.x, curves, SAME_CURVE_CELLS).any():
                        curves.append(part)
            left = _apart(poses, _middles(poses, changes), curves, EXPLAINED_CELLS)
            unexplained = np.count_nonzero(left & of_mode)
            if unexplained in (0, len(todo)) or len(todo) <= STARTS_PER_ROUND:
                break
            starts = []
    seconds = time.perf_counter() - started
    return MapLocus(tuple(curves), len(changes), _middles(poses, changes[left]), "", seconds)


def _spread_out(places: IntArray) -> IntArray:
    """Return `STARTS_PER_ROUND` of places, evenly chosen."""
    if len(places) <= STARTS_PER_ROUND:
        return places
    return places[np.linspace(0, len(places) - 1, STARTS_PER_ROUND).round().astype(np.intp)]


def _free(robot: ParallelRobot, poses: MapPoses) -> tuple[str, str]:
    return robot.axis_names[poses.axes[0]], robot.axis_names[poses.axes[1]]


def _modes(robot: ParallelRobot, poses: MapPoses, places: IntArray) -> Array:
    """Return the sign of each leg (e, legs) at some poses of the map."""
    i, j = places.T
    return leg_signs(robot, linearised_at(robot, poses.q[i, j], poses.x[i, j]))


def _traced(robot: ParallelRobot, poses: MapPoses, starts: list[Array]) -> list[LocusCurve]:
    """Trace the curves near starts, all in the mode of the first, as far as the map goes."""
    axes = list(poses.axes)
    centre = robot.platform.coordinates(frames_at(robot, starts[0][None]))[0, axes]
    lengths = robot.platform_scale[axes]
    reach = REGION_MARGIN * float((np.abs(np.stack([poses.lower, poses.upper]) - centre) / lengths).max())
    traced = trace_locus(
        robot,
        starts[0],
        free=_free(robot, poses),
        reach=reach,
        starts=0,
        one_mode=True,
        near=starts,
        longest=reach / STEPS_PER_REACH,
    )
    return [curve for curve in traced.curves if curve.kind != "joints_only"]


# ------------------------------------------------------------------ the map's signs


def _sign_changes(g: Array) -> IntArray:
    """Find neighbours between which g changes its sign: (e, 4), the first's place and the second's."""
    changes = []
    for down, right in ((1, 0), (0, 1)):
        first, second = g[: len(g) - down, : g.shape[1] - right], g[down:, right:]
        places = np.argwhere(first * second < 0)
        changes.append(np.concatenate([places, places + np.array([down, right])], axis=1))
    return np.concatenate(changes)


def _least(g: Array) -> IntArray:
    """Find places (t, 2) where |g| is less than at all of eight neighbours."""
    size = np.pad(np.where(np.isfinite(g), np.abs(g), np.inf), 1, constant_values=np.inf)
    rows, columns = g.shape
    shifts = [(i, j) for i in range(3) for j in range(3) if (i, j) != (1, 1)]
    around = np.min([size[i : i + rows, j : j + columns] for i, j in shifts], axis=0)
    inner = size[1:-1, 1:-1]
    places = np.argwhere(inner < around)
    return places[np.argsort(inner[tuple(places.T)], kind="stable")[:MAX_TOUCHES]]


def _middles(poses: MapPoses, changes: IntArray) -> Array:
    """Return the middles (e, 2) of neighbours."""
    return poses.lower + 0.5 * (changes[:, :2] + changes[:, 2:]) * poses.cell


def _apart(poses: MapPoses, places: Array, curves: list[MapCurve], cells: float) -> BoolArray:
    """Whether places (e, 2) are more than `cells` cells away from all curves."""
    away, scaled = np.ones(len(places), dtype=bool), places / poses.cell
    for curve in curves:
        points = curve.x / poses.cell
        start, chord = points[:-1], np.diff(points, axis=0)
        size = np.maximum(np.sum(chord**2, axis=1), np.finfo(float).tiny)
        for k in np.flatnonzero(away).tolist():
            off = scaled[k] - start
            share = np.clip(np.sum(off * chord, axis=1) / size, 0.0, 1.0)
            away[k] = np.abs(off - share[:, None] * chord).max(axis=1).min() > cells
    return away


# ------------------------------------------------------------------ the curves


def _parts(equations: LocusEquations, poses: MapPoses, curve: LocusCurve) -> list[MapCurve]:
    """Return what of a curve is on the branch of the map's poses, cut where an angle jumps by a turn."""
    axes, robot = list(poses.axes), equations.robot
    x = curve.x[:, axes]
    place = np.round((x - poses.lower) / poses.cell).astype(int)
    sure, off = _compared(equations, poses, curve, place)
    jumps = (np.abs(np.diff(x, axis=0)) > MAX_ANGLE_STEP) & ~robot.translations[axes]
    breaks = np.flatnonzero(jumps.any(axis=1) | (off[1:] != off[:-1])) + 1
    parts = np.split(np.arange(len(x)), breaks)
    return [MapCurve(x[part], curve.q[part]) for part in parts if len(part) > 1 and sure[part].any()]


def _compared(
    equations: LocusEquations,
    poses: MapPoses,
    curve: LocusCurve,
    place: IntArray,
) -> tuple[BoolArray, BoolArray]:
    """Whether points (m,) of a curve surely are on the map's branch, and whether they surely are not.

    Where inverse kinematics is singular too no step leads to a point: there its configuration is compared
    with the poses around. Points at and beyond the rim of the reached poses may be neither.
    """
    around = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)])
    near = place[:, None] + around  # (m, 9, 2), the point's own in the middle
    on_map = ((near >= 0) & (near < np.array(poses.g.shape))).all(axis=2)
    near = np.where(on_map[:, :, None], near, 0)
    on_map &= poses.reached[near[..., 0], near[..., 1]]
    sure, off = np.zeros((2, len(place)), dtype=bool)
    inside = np.flatnonzero(on_map[:, 4])
    if not len(inside):
        return sure, off
    i, j = place[inside].T
    q = poses.q
    ends, led = poses.lead(q[i, j], poses.x[i, j], curve.x[inside])
    with np.errstate(invalid="ignore"):
        gap = np.abs(equations.apart(curve.q[inside], ends)).max(axis=1)
        cells = np.abs(equations.apart(q[i, j][:, None], q[near[inside, :, 0], near[inside, :, 1]])).max(
            axis=2
        )
        far = np.abs(equations.apart(q[i, j], curve.q[inside])).max(axis=1)
    among = far <= np.where(on_map[inside], cells, 0.0).max(axis=1)
    sure[inside] = np.where(led, gap < DISTINCT_SOLUTIONS, among)
    off[inside] = ~sure[inside] & (led | on_map[inside].all(axis=1))
    return sure, off
