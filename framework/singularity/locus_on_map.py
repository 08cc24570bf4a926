"""The singular locus on a map: curves traced on the map's branch, and compared with the signs of g.

Tracing starts from the poses next to a sign change of g, and from local minima of |g|, as g keeps its sign
across some curves. A point of a traced curve belongs to the map if a step of inverse kinematics from the
nearest pose leads to the configuration of the point. So each point is singular and on the branch of the
poses. Completeness is not claimed, because a curve between the poses may be so small that g has the same sign
at all poses. A curve explains a sign change between neighbours if it passes between them.
Sign changes that no curve explains are reported. Over one coordinate the locus consists of points, which
bisection between the neighbours locates.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from framework.errors import InvalidInput
from framework.kinematics.frames import frames_at
from framework.kinematics.linearised_loops import linearised_at, type2_matrix
from framework.kinematics.modes import ModeStates, leg_signs, share_working_mode
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import LEAST_DIVISOR, Array, BoolArray, IntArray, ReadOnlyArrays, select
from framework.numerics.ordered_sums import least_singular_values
from framework.singularity.curve_tracing import MAX_CURVE_OFFSET, STALLED, LocusEquations, chord_offsets
from framework.singularity.traced_locus import LocusCurve, trace_locus
from framework.singularity.type2 import has_signed_measure, uncontrolled_motion
from framework.tolerances import DISTINCT_SOLUTIONS, RANK_LOST

TYPE_2_KINDS = ("type_2", "self_motion")  # of a `LocusCurve`, on which motors lose hold of the platform
# index offsets (9, 2) of a cell (the first) and its eight neighbours
NINE_CELLS = np.array([(i, j) for i in (0, -1, 1) for j in (0, -1, 1)])


class MapPoses(NamedTuple):
    """The grid of poses of a map over k = 1 or 2 platform coordinates, on one branch."""

    axes: tuple[int, ...]  # (k,) indices of the platform coordinates
    lower: Array  # (k,) least values of these coordinates [m, rad]
    upper: Array  # (k,) largest values
    cell: Array  # (k,) distance between neighbours along each axis
    x: Array  # (I, J, n)
    q: Array  # (I, J, nq)
    reached: BoolArray  # (I, J)
    g: Array  # (I, J) NaN where a pose is not reached
    # continues q (T, nq) from x (T, n) to other x (T, n); returns the new q, and which are on the same branch
    continue_pose: Callable[[Array, Array, Array], tuple[Array, BoolArray]]


@dataclass(frozen=True, eq=False)
class MapCurve(ReadOnlyArrays):
    """A curve of the locus through m points; over one coordinate a point."""

    x: Array  # (m, k) platform coordinates on the map's axes
    q: Array  # (m, nq)
    kind: str  # as in `LocusCurve`

    @property
    def is_type2(self) -> bool:
        """Whether the motors lose hold of the platform, not the loops or a leg of its joints."""
        return self.kind in TYPE_2_KINDS


@dataclass(frozen=True, eq=False)
class MapLocus(ReadOnlyArrays):
    """The locus on the branch of a map, or the reason why none is traced."""

    curves: tuple[MapCurve, ...]
    sign_changes: int  # number of pairs of neighbouring poses between which g changes its sign
    unexplained: Array  # (u, k) midpoints of sign changes that no curve explains
    why_not: str  # empty if the locus was traced
    seconds: float

    @property
    def sentence(self) -> str:
        """The result in words."""
        if self.why_not:
            return f"not traced: {self.why_not}"
        count = sum(curve.is_type2 for curve in self.curves)
        is_plane = self.unexplained.shape[1] == 2
        noun, lies, found = ("curve", "passes", "traced") if is_plane else ("point", "lies", "located")
        curves = {0: f"no {noun}", 1: f"1 {noun}"}.get(count, f"{count} {noun}s")
        if count < len(self.curves):
            curves += f" of Type 2 and {len(self.curves) - count} of the loops or legs themselves"
        if self.sign_changes:
            missed = len(self.unexplained)
            rest = f"at {missed} no {noun} {lies}" if missed else "all explained"
            signs = f"g changes its sign between {self.sign_changes} neighbours, {rest}"
        else:
            signs = "g does not change its sign"
        return f"{curves} {found}; {signs}; completeness is not claimed"


def locus_on_map(robot: ParallelRobot, poses: MapPoses) -> MapLocus:
    """Trace the locus on a map, on the branch of its poses."""
    started = time.perf_counter()
    if len(poses.axes) == 1:
        return _locate_points(robot, poses, started)
    first_reached = tuple(np.argwhere(poses.reached)[0])  # any pose fixes the values of all other coordinates
    i, j = poses.axes
    free = robot.axis_names[i], robot.axis_names[j]
    try:
        equations = LocusEquations.of(robot, poses.q[first_reached], poses.x[first_reached], free)
    except InvalidInput as error:
        return MapLocus(
            curves=(), sign_changes=0, unexplained=np.zeros((0, 2)), why_not=str(error), seconds=0.0
        )
    changes = _sign_changes(poses.g)
    curves, unexplained = _trace_modes(equations, poses, changes)
    return MapLocus(
        curves=tuple(curves),
        sign_changes=len(changes),
        unexplained=_midpoints(poses, changes[unexplained]),
        why_not="",
        seconds=time.perf_counter() - started,
    )


def _locate_points(robot: ParallelRobot, poses: MapPoses, started: float) -> MapLocus:
    """Locate by bisection the singular points between neighbours on one axis.

    g may also change its sign by a jump; then the point has no singular matrix, and stays unexplained.
    """
    halvings = 45  # of a cell, down to rounding
    if not has_signed_measure(robot):
        why_not = "g has no sign without passive joints, or with other than a motor for each axis"
        return MapLocus((), 0, np.zeros((0, 1)), why_not, 0.0)
    g = poses.g[:, 0]
    is_positive = g >= 0
    is_change = np.isfinite(g[:-1] + g[1:]) & (is_positive[:-1] != is_positive[1:])
    first = np.flatnonzero(is_change)  # (e,) the lower neighbours
    sign = np.where(is_positive[first], 1.0, -1.0)
    x, q = poses.x[first, 0], poses.q[first, 0]
    step = poses.x[first + 1, 0] - x
    for _ in range(halvings):
        step = 0.5 * step
        ends, arrives = poses.continue_pose(q, x, x + step)
        keeps = arrives & (np.linalg.slogdet(type2_matrix(robot, linearised_at(robot, ends))).sign == sign)
        x = np.where(keeps[:, None], x + step, x)
        q = np.where(keeps[:, None], ends, q)
    linearised = linearised_at(robot, q)
    is_singular = least_singular_values(type2_matrix(robot, linearised)) < RANK_LOST
    points = [
        MapCurve(x[[k]], q[[k]], uncontrolled_motion(robot, linearised.select(int(k))).kind)
        for k in np.flatnonzero(is_singular)
    ]
    return MapLocus(tuple(points), len(first), x[~is_singular], "", time.perf_counter() - started)


def _trace_modes(
    equations: LocusEquations, poses: MapPoses, changes: IntArray
) -> tuple[list[MapCurve], BoolArray]:
    """Trace the curves of all working modes, modes with the most starts first.

    The curves of a mode start from the minima of |g| in this mode, and from the sign `changes` (e, 4) of
    `_sign_changes` that no earlier curve explains: from every eighth first, since a curve explains many, then
    from those that are left.

    Returns:
        The curves; which sign changes are left unexplained, (e,).
    """
    robot = equations.robot
    minima = _find_minima(poses.g)  # (t, 2)
    q = np.concatenate([poses.q[tuple(minima.T)], _zeros_between(poses, changes)])  # (t + e, nq) of starts
    start_modes = leg_signs(robot, linearised_at(robot, q))  # (t + e, legs)
    is_minimum = np.arange(len(q)) < len(minima)
    curves = list[MapCurve]()
    unexplained = np.ones(len(changes), dtype=bool)
    modes, counts = np.unique(start_modes, axis=0, return_counts=True)
    for mode in modes[np.argsort(-counts, kind="stable")]:
        is_untried = (start_modes == mode).all(axis=1)  # (t + e,)
        for is_first, stride in ((is_minimum, 8), (np.zeros_like(is_minimum), 1)):
            is_start = is_untried & is_first
            is_start[len(minima) + np.flatnonzero(is_untried[len(minima) :] & unexplained)[::stride]] = True
            is_untried &= ~is_start
            if not is_start.any():
                continue
            for curve in _trace_near(equations, poses, q[is_start]):
                parts = _parts_on_branch(equations, poses, curve)
                curves += [part for part in parts if _is_new(poses, part, curves)]
            unexplained = ~_is_explained(poses, changes, curves)
    return curves, unexplained


def _zeros_between(poses: MapPoses, changes: IntArray) -> Array:
    """Compute configurations (e, nq) near g = 0 between the neighbours of sign `changes` (e, 4).

    They are where g would be zero if it were linear, or the first neighbours if steps do not lead there.
    """
    first, second = tuple(changes[:, :2].T), tuple(changes[:, 2:].T)
    share = poses.g[first] / (poses.g[first] - poses.g[second])  # (e,)
    x, q = poses.x[first], poses.q[first]
    ends, arrives = poses.continue_pose(q, x, x + share[:, None] * (poses.x[second] - x))
    return np.where(arrives[:, None], ends, q)


def _trace_near(equations: LocusEquations, poses: MapPoses, starts: Array) -> list[LocusCurve]:
    """Trace the locus over the map from starts (k, nq), in the working mode of the first start.

    The first start is the centre of the region in which curves are followed; the region covers the map.
    """
    steps_per_reach = 16.0  # least number of steps of a curve along half an edge of its region
    robot = equations.robot
    axes = list(poses.axes)
    centre = robot.platform.coordinates(frames_at(robot, starts[:1]))[0, axes]
    distances = np.abs(np.stack([poses.lower, poses.upper]) - centre)  # (2, 2) of the map's sides [m, rad]
    reach = float(((distances + poses.cell) / robot.platform_scale[axes]).max())  # a cell beyond the map
    traced = trace_locus(
        robot,
        starts[0],
        free=equations.free_names,
        reach=reach,
        starts=0,
        one_mode=True,
        near=list(starts),
        longest=reach / steps_per_reach,
        with_cusps=False,
    )
    # where the equations lose rank no step leads on, or one by rounding and then none
    curves = [curve for curve in traced.curves if curve.ends != STALLED or len(curve.q) > 2]
    return [curve for curve in curves if curve.kind != "joints_only"]


# ------------------------------------------------------------------ the map's signs


def _sign_changes(g: Array) -> IntArray:
    """Find the neighbours between which g (I, J) changes its sign.

    Returns:
        Indices (e, 4): i, j of the one pose, then i, j of its neighbour.
    """
    changes_along_i = g[:-1] * g[1:] < 0  # (I - 1, J)
    changes_along_j = g[:, :-1] * g[:, 1:] < 0  # (I, J - 1)
    first_i = np.argwhere(changes_along_i)  # indices i, j of the poses with the lower i
    first_j = np.argwhere(changes_along_j)  # and of those with the lower j
    first = np.vstack([first_i, first_j])
    second = np.vstack([first_i + np.array([1, 0]), first_j + np.array([0, 1])])
    return np.hstack([first, second])


def _find_minima(g: Array, *, max_minima: int = 24) -> IntArray:
    """Find indices (t, 2) of the `max_minima` least local minima of |g| (I, J).

    At a minimum |g| is less than at all eight neighbours.
    """
    magnitude = np.where(np.isfinite(g), np.abs(g), np.inf)  # |g|; infinite where a pose is not reached
    around = sliding_window_view(np.pad(magnitude, 1, constant_values=np.inf), (3, 3))  # (I, J, 3, 3)
    is_neighbour = np.arange(9).reshape(3, 3) != 4  # all but the pose itself, in the middle
    least_beside = around.min(axis=(2, 3), initial=np.inf, where=is_neighbour)
    minima = np.argwhere(magnitude < least_beside)  # (minima, 2)
    by_magnitude = np.argsort(magnitude[tuple(minima.T)], kind="stable")
    return minima[by_magnitude[:max_minima]]


def _midpoints(poses: MapPoses, changes: IntArray) -> Array:
    """Return the points (e, 2) halfway between the neighbours of sign changes (e, 4)."""
    return poses.lower + 0.5 * (changes[:, :2] + changes[:, 2:]) * poses.cell


def _is_new(poses: MapPoses, part: MapCurve, curves: list[MapCurve]) -> bool:
    """Return whether any point of a part is on none of the curves.

    On one branch a point determines the configuration.
    """
    is_apart = np.ones(len(part.x), dtype=bool)
    for curve in curves:
        chord = np.diff(curve.x, axis=0) / poses.cell  # (c, 2)
        offset = (part.x[:, None] - curve.x[:-1]) / poses.cell  # (m, c, 2)
        distance = np.linalg.norm(chord_offsets(offset, chord), axis=2)
        is_apart &= (distance > MAX_CURVE_OFFSET * np.linalg.norm(chord, axis=1)).all(axis=1)
    return bool(is_apart.any())


def _is_explained(poses: MapPoses, changes: IntArray, curves: list[MapCurve]) -> BoolArray:
    """Return for which sign `changes` (e, 4) a curve passes between the poses, (e,)."""
    is_explained = np.zeros(len(changes), dtype=bool)
    in_cells = [(curve.x - poses.lower) / poses.cell for curve in curves]
    for along in (0, 1):  # the axis along which the poses are neighbours
        crossings = [np.zeros((3, 0)), *(_cross_lines(x, along) for x in in_cells)]
        lines, least, largest = np.concatenate(crossings, axis=1)
        for k in np.flatnonzero(changes[:, 2 + along] > changes[:, along]):
            first = changes[k, along]
            is_between = (largest >= first) & (least <= first + 1)
            is_explained[k] = (is_between & (lines == changes[k, 1 - along])).any()
    return is_explained


def _cross_lines(x: Array, along: int) -> Array:
    """Find where a curve through points x (m, 2) crosses the lines of poses along one axis, in cells.

    An arc that turns by an angle leaves its chord by an eighth of it times the chord. The turn is that from
    chord to chord; a quarter is counted. The curve may go on for a step at its ends.

    Returns:
        (3, crossings): number of the line, least and largest place on the line.
    """
    x = np.concatenate([2 * x[:1] - x[1:2], x, 2 * x[-1:] - x[-2:-1]])  # (m + 2, 2)
    chord = np.diff(x, axis=0)  # (m + 1, 2)
    length = np.linalg.norm(chord, axis=1)
    directions = chord / np.maximum(length, LEAST_DIVISOR)[:, None]
    turns = np.linalg.norm(np.diff(directions, axis=0), axis=1)  # (m,) [rad]
    doubt = 0.25 * length * np.maximum(np.append(turns, 0.0), np.append(0.0, turns))  # (m + 1,)
    across = x[:, 1 - along]
    low, high = np.sort(np.floor([across[:-1], across[1:]]).astype(int), axis=0)
    chords = np.repeat(np.arange(len(chord)), high - low)  # of the crossings
    before = np.cumsum(high - low) - (high - low)  # crossings of the chords before
    lines = low[chords] + 1 + np.arange(len(chords)) - before[chords]
    shares = (lines - across[chords]) / chord[chords, 1 - along]
    places = x[chords, along] + shares * chord[chords, along]
    return np.stack([lines, places - doubt[chords], places + doubt[chords]])


# ------------------------------------------------------------------ the curves


def _parts_on_branch(equations: LocusEquations, poses: MapPoses, curve: LocusCurve) -> list[MapCurve]:
    """Return the parts of a curve on the map's branch, cut where an angle jumps by a turn."""
    axes = list(poses.axes)
    x = curve.x[:, axes]
    is_on, is_off = _compare_branches(equations, poses, curve, x)

    turns = x[:, ~equations.robot.translations[axes]]
    is_jump = (np.abs(np.diff(turns, axis=0)) > np.pi).any(axis=1)  # (m - 1,) from pi to -pi
    leaves_or_enters = is_off[1:] != is_off[:-1]
    breaks = np.flatnonzero(is_jump | leaves_or_enters | _leaves_mode(equations.robot, curve)) + 1

    parts = np.split(np.arange(len(x)), breaks)  # indices of the points of each part
    parts = [part for part in parts if len(part) > 1 and is_on[part].any()]
    return [MapCurve(x[part], curve.q[part], curve.kind) for part in parts]


def _leaves_mode(robot: ParallelRobot, curve: LocusCurve) -> BoolArray:
    """Return whether a curve of m points leaves its working mode after each but the last, (m - 1,).

    Only where equations are combinations: then tracing cannot cut the curve, as a leg's determinant has no
    sign at one pose by itself.
    """
    if not robot.structure.varies or curve.kind not in TYPE_2_KINDS:
        return np.zeros(len(curve.q) - 1, dtype=bool)
    states = ModeStates.of(robot, linearised_at(robot, curve.q))
    starts, ends = select(states, slice(None, -1)), select(states, slice(1, None))
    return ~share_working_mode(robot, starts, ends)


def _neighbouring_poses(poses: MapPoses, x: Array) -> tuple[Array, Array, BoolArray]:
    """Return the map's poses about points x (m, 2): the nearest and its neighbours, as in `NINE_CELLS`.

    These are x (m, 9, n), q (m, 9, nq), and whether a pose is on the map and reached (m, 9).
    """
    nearest = np.round((x - poses.lower) / poses.cell).astype(int)  # (m, 2) indices i, j
    cells = nearest[:, None] + NINE_CELLS  # (m, 9, 2) indices of the nine poses
    on_map = ((cells >= 0) & (cells < poses.g.shape)).all(axis=2)
    cells[~on_map] = 0  # a valid index for poses beyond the map, which do not count as `reached`
    i, j = np.moveaxis(cells, 2, 0)  # (m, 9) each
    return poses.x[i, j], poses.q[i, j], on_map & poses.reached[i, j]


def _compare_branches(
    equations: LocusEquations, poses: MapPoses, curve: LocusCurve, x: Array
) -> tuple[BoolArray, BoolArray]:
    """Decide which points x (m, 2) of a curve are on the map's branch, and which are not.

    A point is on the branch if a step of inverse kinematics from the nearest pose leads to the configuration
    of the point, and off the branch if the step leads elsewhere. Where the inverse kinematics is singular,
    too, the step fails. Then the point counts as on the branch if its joints are no farther from the nearest
    pose than those of the farthest neighbour, and no leg flips between them. Points at and beyond the edge of
    the reached poses may be neither on nor off.

    Returns:
        Masks (m,) of the points on the branch, and of the points off the branch.
    """
    is_on, is_off = np.zeros((2, len(x)), dtype=bool)
    near_x, near_q, reached = _neighbouring_poses(poses, x)
    inside = np.flatnonzero(reached[:, 0])  # points whose nearest pose is reached
    if not len(inside):
        return is_on, is_off
    near_x, near_q, reached = near_x[inside], near_q[inside], reached[inside]
    nearest_q = near_q[:, 0]
    q = curve.q[inside]
    ends, arrives = poses.continue_pose(nearest_q, near_x[:, 0], curve.x[inside])
    # largest motions of a joint [rad, robot lengths], for each of the points inside
    with np.errstate(invalid="ignore"):  # poses that are not reached have NaN
        gap = np.abs(equations.offsets(q, ends)).max(axis=1)
        to_neighbours = np.abs(equations.offsets(nearest_q[:, None], near_q)).max(axis=2)
        to_point = np.abs(equations.offsets(nearest_q, q)).max(axis=1)

    # whether the point is no farther away than the farthest neighbour
    is_among = to_point <= np.where(reached, to_neighbours, 0.0).max(axis=1)
    if equations.robot.structure.varies:  # else tracing stays in the mode
        near, point = (
            ModeStates.of(equations.robot, linearised_at(equations.robot, p)) for p in (nearest_q, q)
        )
        is_among &= share_working_mode(equations.robot, near, point)
    is_on[inside] = np.where(arrives, gap < DISTINCT_SOLUTIONS, is_among)
    is_off[inside] = ~is_on[inside] & (arrives | reached.all(axis=1))
    return is_on, is_off
