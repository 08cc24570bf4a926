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
from framework.kinematics.linearised_loops import linearised_at, type2_matrix
from framework.kinematics.modes import ModeStates, leg_signs, share_working_mode
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike, BoolArray, IntArray, ReadOnlyArrays, select
from framework.numerics.ordered_sums import least_singular_values
from framework.singularity.curve_tracing import MAX_TANGENT_TURN, STALLED, LocusEquations
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
        return MapLocus((), 0, np.zeros((0, 2)), str(error), 0.0)
    changes = _sign_changes(poses.g)
    curves, unexplained = _trace_modes(equations, poses, changes)
    missed = _midpoints(poses, changes[unexplained])
    return MapLocus(tuple(curves), len(changes), missed, "", time.perf_counter() - started)


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
    `_sign_changes` that no curve of an earlier mode explains. The first start is the centre of the region in
    which curves are followed; the region covers the map.

    Returns:
        The curves; which sign changes are left unexplained, (e,).
    """
    steps_per_reach = 16.0  # least number of steps of a curve along half an edge of its region
    robot, axes = equations.robot, list(poses.axes)
    minima = _find_minima(poses.g)  # (t, 2)
    # where g would be zero between neighbours if it were linear; the first of them if no step leads there
    first, second = tuple(changes[:, :2].T), tuple(changes[:, 2:].T)
    share = poses.g[first] / (poses.g[first] - poses.g[second])  # (e,)
    x, q = poses.x[first], poses.q[first]
    zeros, arrives = poses.continue_pose(q, x, x + share[:, None] * (poses.x[second] - x))
    q = np.concatenate([poses.q[tuple(minima.T)], np.where(arrives[:, None], zeros, q)])  # (t + e, nq)
    linearised = linearised_at(robot, q)
    start_modes = leg_signs(robot, linearised)  # (t + e, legs)
    x = robot.platform.coordinates(linearised.frames)[:, axes]
    half_edges = 0.5 * (changes[:, 2:] - changes[:, :2])  # (e, 2) [cells] between the poses
    is_needed = np.ones(len(q), dtype=bool)
    curves = list[MapCurve]()
    modes, counts = np.unique(start_modes, axis=0, return_counts=True)
    for mode in modes[np.argsort(-counts, kind="stable")]:
        starts = np.flatnonzero((start_modes == mode).all(axis=1) & is_needed)
        if not len(starts):
            continue
        distances = np.abs(
            np.stack([poses.lower, poses.upper]) - x[starts[0]]
        )  # (2, 2) of the sides [m, rad]
        reach = float(((distances + poses.cell) / robot.platform_scale[axes]).max())  # a cell beyond the map
        traced = trace_locus(
            robot,
            q[starts[0]],
            free=equations.free_names,
            reach=reach,
            starts=0,
            one_mode=True,
            near=list(q[starts]),
            longest=reach / steps_per_reach,
            with_cusps=False,
        )
        for curve in traced.curves:
            # where the equations lose rank no step leads on, or one by rounding and then none
            is_stalled = curve.ends == STALLED and len(curve.q) <= 2
            if not is_stalled and curve.kind != "joints_only":
                parts = _parts_on_branch(equations, poses, curve)
                curves += [part for part in parts if not _are_passed(poses, part.x, 0.0, curves).all()]
        is_needed[len(minima) :] = ~_are_passed(poses, _midpoints(poses, changes), half_edges, curves)
    return curves, is_needed[len(minima) :]


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


def _are_passed(poses: MapPoses, x: Array, reach: ArrayLike, curves: list[MapCurve]) -> BoolArray:
    """Return whether curves pass within `reach` (e, 2) [cells] of points x (e, 2), (e,).

    Points `spacing` apart stand for a curve. Arcs leave their chords, which turn by MAX_TANGENT_TURN at most,
    by an eighth of it times the chord. On one branch a point of the map determines the configuration.
    """
    spacing = 0.1  # [cells]
    is_passed = np.zeros(len(x), dtype=bool)
    for curve in curves:
        chords = np.linalg.norm(np.diff(curve.x, axis=0) / poses.cell, axis=1)  # (m - 1,)
        lengths = np.append(0.0, np.cumsum(chords))  # (m,)
        places = np.linspace(0.0, lengths[-1], int(lengths[-1] / spacing) + 2)
        points = np.stack([np.interp(places, lengths, along) for along in curve.x.T], axis=1)
        # (e, 2) [cells]
        farthest = np.broadcast_to(
            np.asarray(reach) + 0.5 * spacing + MAX_TANGENT_TURN / 8.0 * chords.max(), x.shape
        )
        for k in np.flatnonzero(~is_passed):  # one by one: all times all points would need much memory
            is_passed[k] = (np.abs(points - x[k]) < poses.cell * farthest[k]).all(axis=1).any()
    return is_passed


# ------------------------------------------------------------------ the curves


def _parts_on_branch(equations: LocusEquations, poses: MapPoses, curve: LocusCurve) -> list[MapCurve]:
    """Return the parts of a curve on the map's branch, cut where an angle jumps by a turn."""
    axes = list(poses.axes)
    x = curve.x[:, axes]
    is_on, is_off = _compare_branches(equations, poses, curve, x)

    turns = x[:, ~equations.robot.translations[axes]]
    is_jump = (np.abs(np.diff(turns, axis=0)) > np.pi).any(axis=1)  # (m - 1,) from pi to -pi
    is_break = is_jump | (is_off[1:] != is_off[:-1])  # the curve leaves or enters the branch
    if equations.robot.structure.varies and curve.kind in TYPE_2_KINDS:
        # equations are combinations: a leg's determinant has no sign at one pose by itself, so that tracing
        # has not cut the curve where it leaves its working mode
        states = ModeStates.of(equations.robot, linearised_at(equations.robot, curve.q))
        ends = select(states, slice(None, -1)), select(states, slice(1, None))
        is_break |= ~share_working_mode(equations.robot, *ends)

    parts = np.split(np.arange(len(x)), np.flatnonzero(is_break) + 1)  # indices of the points of each part
    parts = [part for part in parts if len(part) > 1 and is_on[part].any()]
    return [MapCurve(x[part], curve.q[part], curve.kind) for part in parts]


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
