"""The singular locus of a robot in two of its freedoms, traced curve by curve, over all its modes.

Robots of two freedoms are traced as they are; of others a slice is: the platform's other coordinates held
(a 3-RPR at one orientation, a Gough-Stewart platform at one orientation and height, or at one position and
turn), or the other motors (the sections of the joint space in which cusps are drawn). Curves are found from
starts that the caller states or that are drawn in joint space from a fixed seed, and from the branch points
of curves already traced. A curve that no start and no branch leads to is missed: completeness is not claimed.

Curves are followed in a `Region` about a pose, in one working mode or all. A cusp is where a measure along
the curve vanishes. Where det [dF/du ; t'] changes its sign between two points another curve crosses. The
simple branch point is bracketed, and the second tangent found from the algebraic bifurcation equation psi' F"
(w, w) = 0 over the plane of both (Allgower and Georg, Introduction to Numerical Continuation Methods, SIAM
2003, chapter 8).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

import numpy as np

from framework.kinematics.frames import difference, frames_at
from framework.kinematics.inverse_kinematics import close_each
from framework.kinematics.linearised_loops import assembled_at, linearised_at
from framework.kinematics.modes import leg_determinants, leg_signs
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike, BoolArray, ReadOnlyArrays, join, select
from framework.numerics.ordered_sums import singular_values
from framework.singularity.curve_tracing import (
    MAX_CURVE_OFFSET,
    MAX_STEP,
    Curve,
    Points,
    advance,
    chord_offsets,
    curve_points_at,
    find_solutions,
    trace_curves,
)
from framework.singularity.locus_equations import LocusEquations
from framework.tolerances import DISTINCT_SOLUTIONS, RANK_LOST, RANK_ROUNDING

RESTING_EXTENT = 1e-7  # [rad, lengths] of motors or platform along a curve: points are solved to 1e-12
REGION_REACH = 1.2  # [robot lengths] of the region about the pose
RANDOM_STARTS = 40
RANDOM_SEED = 0
MAX_CURVES = 100
# of det [dF/du ; t'] at the neighbours: nearer to a branch point the corrector loses its digits
BRANCH_POINT_RATIO = 1e-6
DIFFERENCE_STEP = 1e-3  # [rad, lengths] of second differences there
BRANCH_STEP = 0.02  # [rad, lengths] to the first point of the other curve
ROOT_SIZE, MAX_ROOT_STEPS = 1e-13, 40  # of a measure without dimension between two points
WAY_STEPS = 10  # to a start
NEWTON_STEPS, MAX_JOINT_STEP = 6, 0.7  # in each of these; [rad, lengths] of one
MAX_ROTATION = 3.0  # [rad] of a rotation vector: its chart ends at pi
# of the last determinant in a working mode: what is left of it where a curve is cut
CUT_CLEARANCE_RATIO = 1e-3


class LocusPoint(NamedTuple):
    """A special point of the locus."""

    q: Array  # (nq,)
    x: Array  # (n,)
    motors: Array  # (n_a,) joint side


@dataclass(frozen=True, eq=False)
class LocusCurve(ReadOnlyArrays):
    """One curve of the locus, through m points; a closed one ends with its first point.

    Every point but the cusps is a fold of the forward kinematics: two assembly modes meet there. At a cusp
    three do; its image in the space of the motors is the corner around which assembly modes are changed
    without a singularity (Wenger and El Omri 1996; McAree and Daniel 1999).
    """

    q: Array  # (m, nq)
    x: Array  # (m, n)
    motors: Array  # (m, n_a) joint side, whole turns counted on
    modes: Array  # (m, legs) working mode: the sign of each leg, see `leg_signs`
    kind: str  # type_2; self_motion: the motors rest all along; joints_only: the platform does
    closed: bool
    ends: tuple[str, str]  # closed, left (the region), stalled or long, see `Curve`
    cusps: tuple[LocusPoint, ...]
    branch_points: tuple[LocusPoint, ...]  # where another curve of the locus crosses


@dataclass(frozen=True, eq=False)
class TracedLocus:
    """The traced part of the locus; `curves` are distinct, in the order of tracing.

    That each point is singular is certain, that there is no further curve is not claimed.
    """

    robot: ParallelRobot
    free: tuple[str, str]  # the two freedoms of the slice
    curves: tuple[LocusCurve, ...]
    starts: int  # points of the locus that the search found, each on one of the curves

    @property
    def cusps(self) -> tuple[LocusPoint, ...]:
        """All cusps, each once."""
        return tuple(point for curve in self.curves for point in curve.cusps)


def trace_locus(
    robot: ParallelRobot,
    q: ArrayLike,
    *,
    free: tuple[str, str] | None = None,
    reach: float = REGION_REACH,
    starts: int = RANDOM_STARTS,
    one_mode: bool = False,
    near: Sequence[Array] = (),
    longest: float = MAX_STEP,
) -> TracedLocus:
    """Trace the singular locus in the slice through an assembled configuration q (nq,).

    Args:
        free: the two freedoms that are left, axes of the platform or actuators; all others keep the values
            that they have at q. The platform's two translations by default.
        reach: half the width of the region that curves are followed in, in lengths of the robot: of free
            translations and sliding motors about q. Hinges turn without bound.
        starts: configurations that the search begins from, drawn with a fixed seed.
        one_mode: follow curves in the working mode of q alone; quicker.
        near: further configurations (nq,) that the search begins from.
        longest: the longest step along a curve [rad, lengths of the robot].

    Raises:
        InvalidInput: see `LocusEquations.of`; or q is no assembled configuration.
    """
    closed = assembled_at(robot, q)
    equations = LocusEquations.of(robot, closed.q[0], closed.x[0], free)
    mode = leg_signs(robot, closed.linearised)[0] if one_mode else None
    region = Region(equations, closed.q[0], closed.x[0], reach * robot.length, mode)
    if one_mode:
        guesses = draw_in_mode(region, starts)
    else:
        guesses = draw_joints(equations, closed.q[0], starts)
    solutions = find_solutions(equations, np.concatenate([guesses, np.reshape(near, (-1, robot.model.nq))]))
    solutions = solutions[region.contains(solutions)]
    curves = _trace_branches(equations, region, solutions, longest) if len(solutions) else []
    described = tuple(
        _describe_curve(equations, region.clip(curve), crossings) for curve, crossings in curves
    )
    return TracedLocus(robot, equations.free_names, described, starts=len(solutions))


def _trace_branches(
    equations: LocusEquations, region: Region, solutions: Array, longest: float
) -> list[tuple[Curve, list[Points]]]:
    """Trace all curves through solutions (S, nq), and curves that cross.

    Each comes with its branch points.
    """
    curves: list[Curve] = []
    crossings: list[list[Points]] = []
    starts = [curve_points_at(equations, solutions)]
    while starts and len(curves) < MAX_CURVES:
        traced = trace_curves(equations, join(starts), region.contains, longest)
        own_crossings = [_find_branch_points(equations, curve) for curve in traced]
        curves += traced
        crossings += own_crossings
        starts = []
        for crossing in chain.from_iterable(own_crossings):
            for point in points_on_crossing_curve(equations, crossing):
                passed = any(_passes_point(equations, curve, point) for curve in curves)
                if region.contains(point.q)[0] and not passed:
                    starts.append(point)
    return list(zip(curves, crossings, strict=True))


def _find_branch_points(equations: LocusEquations, curve: Curve) -> list[Points]:
    """Find the branch points of a curve, where other curves cross.

    There det [dF/du ; t'] changes its sign. Where the equations lose rank all along the curve (Type 1 and
    Type 2 at once) signs are rounding.
    """
    points = curve.points
    changes = np.flatnonzero(points.orientation[1:] * points.orientation[:-1] < 0)
    first_slopes = _least_slope(equations, select(points, changes))
    second_slopes = _least_slope(equations, select(points, changes + 1))
    regular = changes[np.maximum(first_slopes, second_slopes) > RANK_LOST]
    return [branch_point(equations, points.single(k), points.single(k + 1)) for k in regular.tolist()]


def _least_slope(equations: LocusEquations, points: Points) -> Array:
    """Compute the least singular value (S,) of the equations' derivatives dF/du."""
    if not len(points.q):
        return np.zeros(0)
    slopes = equations.evaluate(points.q, points.border).slopes
    return singular_values(slopes)[:, -1]


def _passes_point(equations: LocusEquations, curve: Curve, point: Points) -> bool:
    """Whether a curve passes through a point (S = 1).

    The distance of the point from the curve's chords decides.
    """
    offsets = equations.offsets(point.q, curve.points.q)  # (m, k) from the point
    chord = np.diff(offsets, axis=0)
    length = np.linalg.norm(chord, axis=1)
    distance = np.linalg.norm(chord_offsets(-offsets[:-1], chord), axis=1)
    is_step = length < 2 * MAX_STEP  # longer chords are jumps of a hinge by a turn
    return bool(((distance < MAX_CURVE_OFFSET * length) & is_step).any())


def _describe_curve(equations: LocusEquations, curve: Curve, crossings: list[Points]) -> LocusCurve:
    """Describe a traced curve by platform, motors, modes, cusps and branch points."""
    robot, points = equations.robot, curve.points
    linearised = linearised_at(robot, points.q, None)
    x = robot.platform.coordinates(linearised.frames)
    motors = robot.actuated_coordinates(points.q)
    hinges = ~robot.sliding[robot.actuated]
    motors[:, hinges] = np.unwrap(motors[:, hinges], axis=0)  # pieces may differ by whole turns
    steps = equations.offsets(points.q[:-1], points.q[1:])  # (m - 1, k), motors first
    kind = "type_2"
    if np.abs(steps[:, : robot.n_a]).max(initial=0.0) < RESTING_EXTENT:
        kind = "self_motion"
    if np.ptp(x / robot.platform_scale, axis=0).max() < RESTING_EXTENT:
        kind = "joints_only"
    return LocusCurve(
        q=points.q,
        x=x,
        motors=motors,
        modes=leg_signs(robot, linearised),
        kind=kind,
        closed=curve.ends[0] == "closed",
        ends=curve.ends,
        cusps=_find_cusps(equations, points) if kind == "type_2" else (),
        branch_points=tuple(_locus_point(robot, crossing.q[0]) for crossing in crossings),
    )


def _find_cusps(equations: LocusEquations, points: Points) -> tuple[LocusPoint, ...]:
    """Find the cusps of a curve of m points.

    There the slope of g along the escaping motion changes its sign. The motion may have been turned over
    between neighbours. Where curves cross a second motion escapes, and the slope says nothing.
    """
    cosine = np.sum(points.eta[1:] * points.eta[:-1], axis=1)
    changes = points.cusp[1:] * points.cusp[:-1] * cosine < 0
    changes &= points.orientation[1:] * points.orientation[:-1] > 0
    cusps = []
    for k in np.flatnonzero(changes).tolist():
        first, second = points.single(k), points.single(k + 1)
        if cosine[k] < 0:
            second = second._replace(eta=-second.eta, cusp=-second.cusp)
        cusp = root_between(equations, first, second, lambda point: float(point.cusp[0]))
        if cusp is not None:
            cusps.append(_locus_point(equations.robot, cusp.q[0]))
    return tuple(cusps)


def _locus_point(robot: ParallelRobot, q: Array) -> LocusPoint:
    """Return the special point at a configuration q (nq,)."""
    x = robot.platform.coordinates(frames_at(robot, q[None]))[0]
    return LocusPoint(q, x, robot.actuated_coordinates(q[None])[0])


def root_between(
    equations: LocusEquations,
    first: Points,
    second: Points,
    measure: Callable[[Points], float],
    *,
    small: float = ROOT_SIZE,
) -> Points | None:
    """Find the point between two neighbours where a measure is zero.

    The measure has opposite signs at the neighbours (S = 1). By false position (the Illinois variant) on the
    fraction of the chord, until the measure is `small`. Where the corrector fails, as near a branch point,
    the last point is returned; None if there is none.
    """
    chord = float(np.linalg.norm(equations.offsets(first.q[0], second.q[0])))
    bend = (second.tangent - first.tangent) / chord
    low, value_low = 0.0, measure(first)
    high, value_high = 1.0, measure(second)
    root = None
    replaced = 0  # the end that was replaced last: -1 low, 1 high
    for _ in range(MAX_ROOT_STEPS):
        share = (low * value_high - high * value_low) / (value_high - value_low)
        point, accepted = advance(equations, first, np.array([share * chord]), bend)
        if not accepted[0]:
            return root
        root, value = point, measure(point)
        if abs(value) < small or high - low < ROOT_SIZE:
            break
        # Illinois: the value at an end that stays twice is halved, or the end would stay for ever
        if value * value_low > 0:
            value_high *= 0.5 if replaced == -1 else 1.0
            low, value_low, replaced = share, value, -1
        else:
            value_low *= 0.5 if replaced == 1 else 1.0
            high, value_high, replaced = share, value, 1
    return root


def branch_point(equations: LocusEquations, first: Points, second: Points) -> Points:
    """Find the point between two neighbours (S = 1) at which another curve crosses."""

    def measure(point: Points) -> float:
        return float(point.orientation[0])

    small = BRANCH_POINT_RATIO * max(abs(measure(first)), abs(measure(second)))
    root = root_between(equations, first, second, measure, small=small)
    if root is not None:
        return root
    return first if abs(measure(first)) < abs(measure(second)) else second


def points_on_crossing_curve(equations: LocusEquations, crossing: Points) -> list[Points]:
    """Compute points of the curve that crosses at a `branch_point`, one on each side."""
    tangent = _second_tangent(equations, crossing)
    points = []
    for direction in () if tangent is None else (tangent, -tangent):
        start = crossing._replace(tangent=direction[None])
        point, accepted = advance(equations, start, np.array([BRANCH_STEP]), np.zeros_like(start.tangent))
        points += [point] if accepted[0] else []
    return points


def _second_tangent(equations: LocusEquations, crossing: Points) -> Array | None:
    """Compute the unit tangent (k,) of the other curve at a branch point.

    None if it is not real. Both tangents w lie in the null space of the slopes F', of dimension 2, and solve
    y . F"(w, w) = 0, y the left null vector. With w = tangent + r normal that is along + 2 mixed r + across
    r^2 = 0, of which r = 0 is the curve itself.
    """
    evaluated = equations.evaluate(crossing.q, crossing.border)
    U, _, V_rows = np.linalg.svd(evaluated.slopes[0])
    tangent = crossing.tangent[0]
    shares = V_rows[-2:] @ tangent
    normal = shares[0] * V_rows[-1] - shares[1] * V_rows[-2]  # orthogonal to the tangent in the null space
    normal /= np.linalg.norm(normal)
    border = select(crossing.border, np.zeros(2, dtype=np.intp))

    def second_derivative(w: Array) -> float:
        """Compute y . F"(w, w) by a central difference along w (k,)."""
        ends = equations.move(np.repeat(crossing.q, 2, axis=0), DIFFERENCE_STEP * np.stack([w, -w]))
        ahead, back = equations.evaluate(ends, border).values
        return float(U[:, -1] @ (ahead + back - 2 * evaluated.values[0]) / DIFFERENCE_STEP**2)

    along, across = second_derivative(tangent), second_derivative(normal)
    mixed = 0.25 * (second_derivative(tangent + normal) - second_derivative(tangent - normal))
    roots = np.roots([across, 2 * mixed, along])
    if not len(roots) or np.abs(roots.imag).max() > DISTINCT_SOLUTIONS:
        return None
    normal *= roots.real[np.argmax(np.abs(roots))]
    return (tangent + normal) / np.linalg.norm(tangent + normal)


class Region(NamedTuple):
    """The part of the configuration space in which curves are followed."""

    equations: LocusEquations
    q: Array  # (nq,) its centre
    x: Array  # (n,)
    reach: float  # [m]
    mode: Array | None  # (legs,) signs of the only working mode that counts

    def contains(self, q: Array) -> BoolArray:
        """Whether configurations (T, nq) are in the region, (T,)."""
        equations, robot = self.equations, self.equations.robot
        x = robot.platform.coordinates(frames_at(robot, q))
        if equations.in_motors:
            motors = robot.actuated[list(equations.free)]
            offset = difference(robot, self.q, q)[:, motors[robot.sliding[motors]]]
        else:
            offset = (x - self.x)[:, robot.translations]
        inside = np.abs(offset).max(axis=1, initial=0.0) < self.reach
        turns = x[:, ~robot.translations]
        if turns.shape[1] == 3:  # a rotation vector
            inside &= np.linalg.norm(turns, axis=1) < MAX_ROTATION
        if self.mode is None:
            return inside
        return inside & (self.clearance(q) > -RANK_ROUNDING)

    def clearance(self, q: Array) -> Array:
        """Compute the least determinant of a leg (T,) at q (T, nq), negative beyond the working mode."""
        robot = self.equations.robot
        linearised = linearised_at(robot, q, None)
        mode = np.ones(1) if self.mode is None else self.mode
        return (leg_determinants(robot, linearised) * mode).min(axis=1)

    def clip(self, curve: Curve) -> Curve:
        """Return the part of a curve in the working mode.

        It ends next to a Type 1 singularity.
        """
        if self.mode is None or len(curve.points.q) < 2:
            return curve
        points = curve.points
        if curve.ends[0] == "left":
            points = self._clip_end(points.backwards()).backwards()
        if curve.ends[1] == "left":
            points = self._clip_end(points)
        return Curve(points, curve.ends)

    def _clip_end(self, points: Points) -> Points:
        """Move the last point, if beyond the working mode, to the mode's edge."""
        last_inside, outside = self.clearance(points.q[-2:]).tolist()
        if not outside < 0 < last_inside:
            return points
        margin = CUT_CLEARANCE_RATIO * last_inside  # the clearance at the edge

        def excess(point: Points) -> float:
            return float(self.clearance(point.q)[0]) - margin

        ends = points.single(-2), points.single(-1)
        edge = root_between(self.equations, *ends, excess, small=0.1 * margin)
        points = select(points, slice(None, -1))
        return points if edge is None else join([points, edge])


def draw_in_mode(region: Region, count: int) -> Array:
    """Draw configurations (count, nq) of the region's working mode, led from its centre to random targets.

    All take their steps together; a configuration that cannot take a step stays.
    """
    equations, robot = region.equations, region.equations.robot
    axes = list(range(robot.n)) if equations.in_motors else list(equations.free)
    spread = np.where(robot.translations[axes], region.reach, np.pi)
    start = np.repeat(region.x[None], count, axis=0)
    whole_way = np.zeros_like(start)  # from the centre to the targets
    whole_way[:, axes] = np.random.default_rng(RANDOM_SEED).uniform(-spread, spread, (count, len(axes)))
    q = np.repeat(region.q[None], count, axis=0)
    for k in range(1, WAY_STEPS + 1):
        x = start + k / WAY_STEPS * whole_way
        next_q, _, closed = close_each(robot, x, q, iterations=NEWTON_STEPS, farthest=MAX_JOINT_STEP)
        closed[closed] &= region.contains(next_q[closed])
        q = np.where(closed[:, None], next_q, q)
    return q


def draw_joints(equations: LocusEquations, q: Array, count: int) -> Array:
    """Draw configurations (count, nq) to search from: hinges anywhere, slides about q (nq,)."""
    columns, rng = equations.robot.moving, np.random.default_rng(RANDOM_SEED)
    spread = np.where(equations.robot.sliding[columns], 1.0, np.pi)
    offsets = rng.uniform(-spread, spread, (count, len(columns)))
    return equations.move(np.repeat(q[None], count, axis=0), offsets)
