"""The singular locus on a map: traced curves on the map's branch, compared with the signs of g there.

Starts of the tracing are the poses beside which g changes its sign, and those where |g| is least among its
neighbours. A traced curve belongs to the map where a step of inverse kinematics from the nearest pose leads
to the curve's own configuration. So each point is singular, and of the poses' own branch. Completeness is not
claimed: a curve between the poses may be so small that g changes no sign on the grid. Changes of sign between
neighbours that no curve explains are reported.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput
from framework.kinematics.frames import frames_at
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.modes import leg_signs
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, BoolArray, IntArray, ReadOnlyArrays, select
from framework.singularity.curve_tracing import chord_offsets
from framework.singularity.locus_equations import LocusEquations
from framework.singularity.traced_locus import LocusCurve, trace_locus
from framework.tolerances import DISTINCT_SOLUTIONS

STARTS_PER_ROUND = 24  # sign changes of a round that tracing starts from, evenly chosen
MAX_ROUNDS = 4  # each from further sign changes, which the curves so far do not pass
# cells between curves that are one: on one branch of the map they have the same joints
SAME_CURVE_CELLS = 0.25
MAX_TOUCHES = 16  # least |g| that it starts from: curves along which g keeps its sign
STEPS_PER_REACH = 16.0  # of a curve along half an edge of the window, at least
REGION_MARGIN = 1.05  # half the edge of the region followed, to the window's farthest side
EXPLAINED_CELLS = 1.0  # between a change of sign and the curve that explains it
AROUND = np.array([(i, j) for i in (0, -1, 1) for j in (0, -1, 1)])  # a cell, and those about it
MAX_ANGLE_STEP = 3.0  # [rad] between neighbours: the angle has been counted on from pi to -pi


class MapPoses(NamedTuple):
    """The grid of poses of a map over two platform coordinates, on one branch."""

    axes: tuple[int, int]  # the two platform coordinates
    lower: Array  # (2,) their least values [m, rad]
    upper: Array  # (2,)
    cell: Array  # (2,) distance of neighbours along either axis
    x: Array  # (I, J, n)
    q: Array  # (I, J, nq)
    reached: BoolArray  # (I, J)
    g: Array  # (I, J) NaN where a pose is not reached
    # from q (T, nq) at x (T, n) and other x: configurations there, and whether they are on the same branch
    lead: Callable[[Array, Array, Array], tuple[Array, BoolArray]]


@dataclass(frozen=True, eq=False)
class MapCurve(ReadOnlyArrays):
    """A curve of the locus through m points."""

    x: Array  # (m, 2) the map's two coordinates
    q: Array  # (m, nq)


@dataclass(frozen=True, eq=False)
class MapLocus(ReadOnlyArrays):
    """The locus on the branch of a map, or the reason why none is traced."""

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
    """Trace the locus on a map, on the branch of its poses."""
    started = time.perf_counter()
    first = tuple(np.argwhere(poses.reached)[0])
    try:
        equations = LocusEquations.of(robot, poses.q[first], poses.x[first], _free_axes(robot, poses))
    except InvalidInput as error:
        return MapLocus((), 0, np.zeros((0, 2)), str(error), 0.0)
    changes = _sign_changes(poses.g)
    curves, unexplained = _trace_modes(equations, poses, changes)
    seconds = time.perf_counter() - started
    return MapLocus(tuple(curves), len(changes), _midpoints(poses, changes[unexplained]), "", seconds)


def _trace_modes(
    equations: LocusEquations, poses: MapPoses, changes: IntArray
) -> tuple[list[MapCurve], BoolArray]:
    """Trace the curves of all working modes, modes with most starts first.

    Args:
        changes: (e, 4) indices i, j of the poses on both sides of each change of sign.

    Returns:
        The curves; whether each change of sign is left unexplained, as no curve passes beside it, (e,).
    """
    minima = _find_minima(poses.g)  # (t, 2) indices i, j
    curves, unexplained = list[MapCurve](), np.ones(len(changes), dtype=bool)
    change_modes = _working_modes(equations.robot, poses, changes[:, :2])
    minimum_modes = _working_modes(equations.robot, poses, minima)
    modes, counts = np.unique(np.concatenate([change_modes, minimum_modes]), axis=0, return_counts=True)
    for mode in modes[np.argsort(-counts, kind="stable")]:
        of_mode = (change_modes == mode).all(axis=1)
        starts = _poses_at(poses, minima[(minimum_modes == mode).all(axis=1)])
        for _ in range(MAX_ROUNDS):  # from the minima of |g| first, each time from changes not yet explained
            todo = np.flatnonzero(unexplained & of_mode)
            starts = np.concatenate([starts, _poses_at(poses, changes[_choose_evenly(todo), :2])])
            if not len(starts):
                break
            for curve in _trace_near(equations.robot, poses, starts):
                for part in _parts_on_branch(equations, poses, curve):
                    if _is_apart(poses, part.x, curves, SAME_CURVE_CELLS).any():  # repeats no other
                        curves.append(part)
            unexplained = _is_apart(poses, _midpoints(poses, changes), curves, EXPLAINED_CELLS)
            remaining = np.count_nonzero(unexplained & of_mode)
            if remaining in (0, len(todo)) or len(todo) <= STARTS_PER_ROUND:  # none helped, or all were tried
                break
            starts = starts[:0]
    return curves, unexplained


def _poses_at(poses: MapPoses, cells: IntArray) -> Array:
    """Return the configurations (e, nq) at indices (e, 2) of the map."""
    return poses.q[cells[:, 0], cells[:, 1]]


def _choose_evenly(indices: IntArray) -> IntArray:
    """Return up to `STARTS_PER_ROUND` of the indices (k,), evenly spaced."""
    count = min(len(indices), STARTS_PER_ROUND)
    return indices[np.linspace(0, len(indices) - 1, count).round().astype(np.intp)]


def _free_axes(robot: ParallelRobot, poses: MapPoses) -> tuple[str, str]:
    """Return the names of the map's two platform coordinates."""
    return robot.axis_names[poses.axes[0]], robot.axis_names[poses.axes[1]]


def _working_modes(robot: ParallelRobot, poses: MapPoses, cells: IntArray) -> Array:
    """Compute the working mode, the sign of each leg (e, legs), at cells (e, 2) of the map."""
    return leg_signs(robot, linearised_at(robot, _poses_at(poses, cells), None))


def _trace_near(robot: ParallelRobot, poses: MapPoses, starts: Array) -> list[LocusCurve]:
    """Trace the locus over the map from starts (k, nq), in the working mode of the first."""
    axes = list(poses.axes)
    centre = robot.platform.coordinates(frames_at(robot, starts[:1]))[0, axes]
    lengths = robot.platform_scale[axes]
    reach = REGION_MARGIN * float((np.abs(np.stack([poses.lower, poses.upper]) - centre) / lengths).max())
    traced = trace_locus(
        robot,
        starts[0],
        free=_free_axes(robot, poses),
        reach=reach,
        starts=0,
        one_mode=True,
        near=list(starts),
        longest=reach / STEPS_PER_REACH,
    )
    return [curve for curve in traced.curves if curve.kind != "joints_only"]


# ------------------------------------------------------------------ the map's signs


def _sign_changes(g: Array) -> IntArray:
    """Find the neighbours between which g (I, J) changes its sign: (e, 4), indices of both."""
    changes = []
    for down, right in ((1, 0), (0, 1)):
        first, second = g[: len(g) - down, : g.shape[1] - right], g[down:, right:]
        indices = np.argwhere(first * second < 0)
        changes.append(np.concatenate([indices, indices + np.array([down, right])], axis=1))
    return np.concatenate(changes)


def _find_minima(g: Array) -> IntArray:
    """Find the cells (t, 2) at which |g| (I, J) is less than at all of eight neighbours."""
    from scipy.ndimage import minimum_filter

    size = np.where(np.isfinite(g), np.abs(g), np.inf)
    footprint = np.ones((3, 3), dtype=bool)
    footprint[1, 1] = False
    neighbours = minimum_filter(size, footprint=footprint, mode="constant", cval=np.inf)
    minima = np.argwhere(size < neighbours)
    return minima[np.argsort(size[tuple(minima.T)], kind="stable")[:MAX_TOUCHES]]


def _midpoints(poses: MapPoses, changes: IntArray) -> Array:
    """Return the points (e, 2) halfway between the neighbours of changes (e, 4) of sign."""
    return poses.lower + 0.5 * (changes[:, :2] + changes[:, 2:]) * poses.cell


def _is_apart(poses: MapPoses, x: Array, curves: list[MapCurve], cells: float) -> BoolArray:
    """Whether points x (e, 2) are more than `cells` cells away from all curves, (e,)."""
    is_apart, scaled = np.ones(len(x), dtype=bool), x / poses.cell
    for curve in curves:
        points = curve.x / poses.cell
        start, chord = points[:-1], np.diff(points, axis=0)
        for k in np.flatnonzero(is_apart).tolist():
            is_apart[k] = np.abs(chord_offsets(scaled[k] - start, chord)).max(axis=1).min() > cells
    return is_apart


# ------------------------------------------------------------------ the curves


def _parts_on_branch(equations: LocusEquations, poses: MapPoses, curve: LocusCurve) -> list[MapCurve]:
    """Return the parts of a curve that lie on the map's branch.

    Parts are cut where an angle jumps by a turn.
    """
    axes = list(poses.axes)
    x = curve.x[:, axes]
    is_on, is_off = _compare_branches(equations, poses, curve, x)
    jumps = (np.abs(np.diff(x, axis=0)) > MAX_ANGLE_STEP) & ~equations.robot.translations[axes]
    breaks = np.flatnonzero(jumps.any(axis=1) | (is_off[1:] != is_off[:-1])) + 1
    parts = np.split(np.arange(len(x)), breaks)
    return [MapCurve(x[part], curve.q[part]) for part in parts if len(part) > 1 and is_on[part].any()]


class _Neighbours(NamedTuple):
    """The map's poses about m points: the nearest one and its eight neighbours, in the order of `AROUND`."""

    cells: IntArray  # (m, 9, 2) indices, 0 where there is none
    reached: BoolArray  # (m, 9) whether there is a pose
    q: Array  # (m, 9, nq)


def _neighbouring_poses(poses: MapPoses, x: Array) -> _Neighbours:
    """Return the map's poses about points x (m, 2): the nearest and its eight neighbours."""
    nearest = np.round((x - poses.lower) / poses.cell).astype(int)
    cells = nearest[:, None] + AROUND
    on_map = ((cells >= 0) & (cells < np.array(poses.g.shape))).all(axis=2)
    cells = np.where(on_map[:, :, None], cells, 0)
    rows, columns = cells[..., 0], cells[..., 1]
    return _Neighbours(cells, on_map & poses.reached[rows, columns], poses.q[rows, columns])


def _compare_branches(
    equations: LocusEquations, poses: MapPoses, curve: LocusCurve, x: Array
) -> tuple[BoolArray, BoolArray]:
    """Tell which points x (m, 2) of a curve are on the map's branch.

    Returned are masks (m,) of those that surely are, and of those that surely are not. A step of inverse
    kinematics from the nearest pose leads to the point's own configuration, or elsewhere. Where the inverse
    kinematics is singular too no step leads to a point: it then counts as on the branch if it is no farther
    from the nearest pose than the farthest of the neighbours. Points at and beyond the rim of the reached
    poses may be neither.
    """
    is_on, is_off = np.zeros((2, len(x)), dtype=bool)
    neighbours = _neighbouring_poses(poses, x)
    inside = np.flatnonzero(neighbours.reached[:, 0])
    if not len(inside):
        return is_on, is_off
    neighbours, q = select(neighbours, inside), curve.q[inside]
    nearest_q = neighbours.q[:, 0]
    rows, columns = neighbours.cells[:, 0].T
    ends, arrives = poses.lead(nearest_q, poses.x[rows, columns], curve.x[inside])
    with np.errstate(invalid="ignore"):  # poses that are not reached
        gap = np.abs(equations.offsets(q, ends)).max(axis=1)
        to_neighbours = np.abs(equations.offsets(nearest_q[:, None], neighbours.q)).max(axis=2)
        to_point = np.abs(equations.offsets(nearest_q, q)).max(axis=1)
    is_among = to_point <= np.where(neighbours.reached, to_neighbours, 0.0).max(axis=1)
    is_on[inside] = np.where(arrives, gap < DISTINCT_SOLUTIONS, is_among)
    is_off[inside] = ~is_on[inside] & (arrives | neighbours.reached.all(axis=1))
    return is_on, is_off
