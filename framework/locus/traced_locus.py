"""The singular locus of a robot in two of its freedoms, traced curve by curve, over all its modes.

Robots of two freedoms are traced as they are; of others a slice is: the platform's other coordinates held
(a 3-RPR at one orientation, a Gough-Stewart platform at one orientation and height, or at one position and
turn), or the other motors (the sections of the joint space in which cusps are drawn). Curves are found from
starts that are given or drawn at random in joint space, always alike, and from the branch points of curves
already traced. A curve that no start and no branch leads to is missed: completeness is not claimed.

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

from framework.arrays import Array, ArrayLike, BoolArray, ReadOnlyArrays, join, select
from framework.kinematics.frames import difference, frames_at
from framework.kinematics.inverse_kinematics import close_each
from framework.kinematics.linearised_loops import assembled_at, linearised_at
from framework.kinematics.modes import leg_determinants, leg_signs
from framework.kinematics.parallel_robot import ParallelRobot
from framework.linalg.ordered_sums import singular_values
from framework.locus.curve_tracing import (
    MAX_CURVE_OFFSET,
    MAX_STEP,
    Curve,
    Points,
    advance,
    chord_offsets,
    points_at,
    solutions_near,
    whole_curves,
)
from framework.locus.locus_equations import LocusEquations
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
    seed: int = RANDOM_SEED,
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
        starts: configurations that the search begins from, drawn with `seed`.
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
        guesses = draw_in_mode(region, starts, seed)
    else:
        guesses = draw_joints(equations, closed.q[0], starts, seed)
    solutions = solutions_near(equations, np.concatenate([guesses, np.reshape(near, (-1, robot.model.nq))]))
    solutions = solutions[region.contains(solutions)]
    curves = _trace_branches(equations, region, solutions, longest) if len(solutions) else []
    described = tuple(_describe(equations, region.clip(curve), crossings) for curve, crossings in curves)
    return TracedLocus(robot, equations.free_names, described, starts=len(solutions))


def _trace_branches(
    equations: LocusEquations, region: Region, solutions: Array, longest: float
) -> list[tuple[Curve, list[Points]]]:
    """Trace the curves through solutions (S, nq) and all curves that cross, with branch points."""
    curves: list[Curve] = []
    crossings: list[list[Points]] = []
    starts = [points_at(equations, solutions)]
    while starts and len(curves) < MAX_CURVES:
        traced = whole_curves(equations, join(starts), region.contains, longest)
        own_crossings = [_crossings(equations, curve) for curve in traced]
        curves += traced
        crossings += own_crossings
        starts = []
        for crossing in chain.from_iterable(own_crossings):
            for point in branches_at(equations, crossing):
                passed = any(_passes(equations, curve, point) for curve in curves)
                if region.contains(point.q)[0] and not passed:
                    starts.append(point)
    return list(zip(curves, crossings, strict=True))


def _crossings(equations: LocusEquations, curve: Curve) -> list[Points]:
    """Find the branch points of a curve, where other curves cross.

    Where the equations lose rank all along the curve (Type 1 and Type 2 at once) signs are rounding.
    """
    points = curve.points
    changes = np.flatnonzero(points.orientation[1:] * points.orientation[:-1] < 0)
    ranks = [_least_slope(equations, select(points, changes + k)) for k in (0, 1)]
    changes = changes[np.maximum(*ranks) > RANK_LOST]
    return [branch_point(equations, points.single(k), points.single(k + 1)) for k in changes.tolist()]


def _least_slope(equations: LocusEquations, points: Points) -> Array:
    """Compute the smallest singular value (S,) of the equations' derivatives."""
    if not len(points.q):
        return np.zeros(0)
    slopes = equations.evaluate(points.q, points.border).slopes
    return np.asarray(singular_values(slopes)[:, -1])


def _passes(equations: LocusEquations, curve: Curve, point: Points) -> bool:
    """Whether a curve passes a point (S = 1)."""
    offsets = equations.offsets(point.q, curve.points.q)  # (m, k)
    chord = np.diff(offsets, axis=0)
    length, gap = (np.linalg.norm(part, axis=1) for part in (chord, chord_offsets(-offsets[:-1], chord)))
    # longer ones jump where a hinge has turned once round
    return bool(((gap < MAX_CURVE_OFFSET * length) & (length < 2 * MAX_STEP)).any())


def _describe(equations: LocusEquations, curve: Curve, crossings: list[Points]) -> LocusCurve:
    """Describe a curve in the robot's own coordinates."""
    robot, points = equations.robot, curve.points
    linearised = linearised_at(robot, points.q, None)
    x, motors = robot.platform.coordinates(linearised.frames), robot.actuated_coordinates(points.q)
    steps = equations.offsets(points.q[:-1], points.q[1:])
    kind = "type_2"
    if np.abs(steps[:, : robot.n_a]).max(initial=0.0) < RESTING_EXTENT:
        kind = "self_motion"
    if np.ptp(x / robot.platform_scale, axis=0).max() < RESTING_EXTENT:
        kind = "joints_only"
    cosine = np.sum(points.eta[1:] * points.eta[:-1], axis=1)
    turning = points.cusp[1:] * points.cusp[:-1] * cosine < 0
    # not where curves cross: there a second motion escapes
    turning &= points.orientation[1:] * points.orientation[:-1] > 0
    turning &= kind == "type_2"
    cusps = [
        _cusp(equations, points.single(k), points.single(k + 1)) for k in np.flatnonzero(turning).tolist()
    ]
    hinges = ~robot.sliding[robot.actuated]
    motors[:, hinges] = np.unwrap(motors[:, hinges], axis=0)  # pieces may differ by whole turns
    return LocusCurve(
        q=points.q,
        x=x,
        motors=motors,
        modes=leg_signs(robot, linearised),
        kind=kind,
        closed=curve.ends[0] == "closed",
        ends=curve.ends,
        cusps=tuple(_locus_point(robot, cusp.q[0]) for cusp in cusps if cusp is not None),
        branch_points=tuple(_locus_point(robot, crossing.q[0]) for crossing in crossings),
    )


def _cusp(equations: LocusEquations, first: Points, second: Points) -> Points | None:
    """Find the cusp between two neighbours."""
    if first.eta[0] @ second.eta[0] < 0:
        second = second._replace(eta=-second.eta, cusp=-second.cusp)
    return root_between(equations, first, second, lambda point: float(point.cusp[0]))


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
    """Find the point between two neighbours (S = 1) at which a measure of opposite signs vanishes.

    False position (the Illinois variant) on the share of the way, until the measure is `small`. Where the
    corrector fails, as near a branch point, the last point it led to; None if to none.
    """
    chord = float(np.linalg.norm(equations.offsets(first.q[0], second.q[0])))
    bend = (second.tangent - first.tangent) / chord
    low, high, at_low, at_high = 0.0, 1.0, measure(first), measure(second)
    root, last = None, 0  # which end was replaced last
    for _ in range(MAX_ROOT_STEPS):
        share = (low * at_high - high * at_low) / (at_high - at_low)
        point, good = advance(equations, first, np.array([share * chord]), bend)
        if not good[0]:
            return root
        root, value = point, measure(point)
        if abs(value) < small or high - low < ROOT_SIZE:
            break
        if value * at_low > 0:
            low, at_low, at_high, last = share, value, at_high * (0.5 if last == -1 else 1.0), -1
        else:
            high, at_high, at_low, last = share, value, at_low * (0.5 if last == 1 else 1.0), 1
    return root


def branch_point(equations: LocusEquations, first: Points, second: Points) -> Points:
    """Find the point between two neighbours at which another curve crosses, to 1e-6 of their distance."""

    def measure(point: Points) -> float:
        return float(point.orientation[0])

    small = BRANCH_POINT_RATIO * max(abs(measure(first)), abs(measure(second)))
    root = root_between(equations, first, second, measure, small=small)
    if root is not None:
        return root
    return first if abs(measure(first)) < abs(measure(second)) else second


def branches_at(equations: LocusEquations, crossing: Points) -> list[Points]:
    """Return points of the curve that crosses at a `branch_point`, one on each side."""
    tangent = _second_tangent(equations, crossing)
    points = []
    for direction in () if tangent is None else (tangent, -tangent):
        start = crossing._replace(tangent=direction[None])
        point, good = advance(equations, start, np.array([BRANCH_STEP]), np.zeros_like(start.tangent))
        points += [point] if good[0] else []
    return points


def _second_tangent(equations: LocusEquations, crossing: Points) -> Array | None:
    """Compute the unit tangent (k,) of the other curve at a branch point; None if not real."""
    evaluated = equations.evaluate(crossing.q, crossing.border)
    left, _, right = np.linalg.svd(evaluated.slopes[0])
    tangent = crossing.tangent[0]
    a, b = right[-2:] @ tangent
    normal = a * right[-1] - b * right[-2]  # in the plane of both tangents
    normal /= np.linalg.norm(normal)

    def second(w: Array) -> float:
        """Compute the second derivative along w of the equation without slope: y . F''(w, w).

        y is the left null vector of the slopes; the derivative is a central difference.
        """
        ends = equations.move(np.repeat(crossing.q, 2, axis=0), DIFFERENCE_STEP * np.stack([w, -w]))
        values = equations.evaluate(ends, select(crossing.border, np.zeros(2, dtype=np.intp))).values
        return float(left[:, -1] @ (values[0] + values[1] - 2 * evaluated.values[0]) / DIFFERENCE_STEP**2)

    along, across = second(tangent), second(normal)
    mixed = 0.25 * (second(tangent + normal) - second(tangent - normal))
    # w = tangent + r normal with along + 2 mixed r + across r^2 = 0; one root is the curve itself, r = 0
    roots = np.roots([across, 2 * mixed, along])
    if not len(roots) or np.abs(roots.imag).max() > DISTINCT_SOLUTIONS:
        return None
    second_tangent = tangent + roots.real[np.argmax(np.abs(roots))] * normal
    return second_tangent / np.linalg.norm(second_tangent)


class Region(NamedTuple):
    """The part of the configuration space in which curves are followed."""

    equations: LocusEquations
    q: Array  # (nq,) its centre
    x: Array  # (n,)
    reach: float  # [m]
    mode: Array | None  # (legs,) signs of the only working mode that counts

    def contains(self, q: Array) -> BoolArray:
        """Whether configurations (T, nq) are in the region, (T,)."""
        robot = self.equations.robot
        x = robot.platform.coordinates(frames_at(robot, q))
        turns = x[:, ~robot.translations]
        inside = (turns.shape[1] < 3) | (np.linalg.norm(turns, axis=1) < MAX_ROTATION)
        off = (x - self.x)[:, robot.translations]
        if self.equations.in_motors:
            moving = self.equations.robot.actuated[list(self.equations.free)]
            off = difference(robot, self.q, q)[:, moving[robot.sliding[moving]]]
        inside &= np.abs(off).max(axis=1, initial=0.0) < self.reach
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
        """Return the part of a curve in the working mode, which ends next to a Type 1 singularity."""
        points = curve.points
        if self.mode is None or len(points.q) < 2:
            return curve
        clear = self.clearance(points.q)
        clipped = points
        for end, last, inner in ((0, 0, 1), (1, -1, -2)):
            if curve.ends[end] != "left" or clear[last] >= 0 or clear[inner] <= 0:
                continue
            inside, outside = points.single(inner), points.single(last)
            if end == 0:  # the region is entered: seen from its inside, the other way round
                inside, outside = inside.reverse(), outside.reverse()
            edge = self._edge(inside, outside, CUT_CLEARANCE_RATIO * float(clear[inner]))
            clipped = select(clipped, slice(None, -1) if end else slice(1, None))
            if edge is not None:
                clipped = join([clipped, edge] if end else [edge.reverse(), clipped])
        return Curve(clipped, curve.ends)

    def _edge(self, inside: Points, outside: Points, margin: float) -> Points | None:
        """Find the point between two neighbours at which the clearance is a margin."""

        def excess(point: Points) -> float:
            return float(self.clearance(point.q)[0]) - margin

        return root_between(self.equations, inside, outside, excess, small=0.1 * margin)


def draw_in_mode(region: Region, count: int, seed: int) -> Array:
    """Draw configurations (count, nq) of the region's working mode, led from its centre to random targets.

    All take their steps together; a configuration that cannot take a step stays.
    """
    equations, robot = region.equations, region.equations.robot
    axes = list(equations.free) if not equations.in_motors else list(range(robot.n))
    spread = np.where(robot.translations[axes], region.reach, np.pi)
    x = np.repeat(region.x[None], count, axis=0)
    target = x.copy()
    target[:, axes] += np.random.default_rng(seed).uniform(-spread, spread, (count, len(axes)))
    q = np.repeat(region.q[None], count, axis=0)
    for k in range(1, WAY_STEPS + 1):
        step = x + k / WAY_STEPS * (target - x)
        reached, _, closed = close_each(robot, step, q, iterations=NEWTON_STEPS, farthest=MAX_JOINT_STEP)
        closed[closed] &= region.contains(reached[closed])
        q = np.where(closed[:, None], reached, q)
    return q


def draw_joints(equations: LocusEquations, q: Array, count: int, seed: int) -> Array:
    """Draw configurations (count, nq) to search from: hinges anywhere, slides about q (nq,)."""
    columns, rng = equations.robot.moving, np.random.default_rng(seed)
    spread = np.where(equations.robot.sliding[columns], 1.0, np.pi)
    offsets = rng.uniform(-spread, spread, (count, len(columns)))
    return equations.move(np.repeat(q[None], count, axis=0), offsets)
