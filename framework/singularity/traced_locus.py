"""The singular locus of a robot in two of its freedoms, traced curve by curve, over all modes.

The locus of a robot with two freedoms is traced as a whole, that of other robots in a slice. In a slice
either the other coordinates of the platform are fixed (a 3-RPR at one orientation, a Gough-Stewart platform
at one orientation and height, or at one position and turn), or the other motors (the sections of joint space
in which cusps are usually drawn). Curves are traced from starts that the caller gives or that are drawn in
joint space with a fixed seed, and from the branch points of traced curves. A curve to which no start and no
branch leads is missed: completeness is not claimed.

Curves are followed in a `Region` about a pose, in one working mode or in all. At a cusp the slope of g along
the uncontrolled motion changes its sign. If det [dF/du ; t'] changes its sign between two points, another
curve crosses between them. The simple branch point is bracketed, and the tangent of the other curve follows
from the algebraic bifurcation equation psi' F"(w, w) = 0 over the plane of both tangents (Allgower and
Georg, Introduction to Numerical Continuation Methods, SIAM 2003, chapter 8).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.kinematics.assembly import MAX_NEWTON_STEP
from framework.kinematics.frames import difference, frames_at
from framework.kinematics.inverse_kinematics import close_each
from framework.kinematics.linearised_loops import assembled_at, linearised_at, passive_matrix, type1_matrix
from framework.kinematics.modes import leg_signs, legs
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike, BoolArray, ReadOnlyArrays, join, select
from framework.numerics.fields import positive, whole
from framework.numerics.ordered_sums import least_singular_values, singular_values
from framework.singularity.bordered_system import DIFFERENCE_STEP
from framework.singularity.curve_tracing import (
    FIRST_STEP,
    MAX_STEP,
    Curve,
    LocusEquations,
    Points,
    advance,
    curve_points,
    find_solutions,
    passes_point,
    trace_curves,
)
from framework.singularity.type2 import uncontrolled_motion
from framework.tolerances import DISTINCT_SOLUTIONS, RANK_LOST, RANK_ROUNDING

REGION_REACH = 1.2  # [robot lengths] half the width of the region about the pose
# |det [dF/du ; t']| at a branch point over that of its neighbours. Closer by, the corrector loses digits.
BRANCH_POINT_RATIO = 1e-6
# A curve is cut at the edge of a working mode where a leg's least singular value has dropped to this share
# of its value at the last point inside the mode.
CUT_CLEARANCE_RATIO = 1e-3
SHARE_ROUNDING = 2e-12  # of the chord between two points: steps towards a root that are rounding


class LocusPoint(NamedTuple):
    """A cusp or branch point of the locus."""

    q: Array  # (nq,)
    x: Array  # (n,)
    motors: Array  # (n_a,) joint side


@dataclass(frozen=True, eq=False)
class LocusCurve(ReadOnlyArrays):
    """A curve of the locus through m points; a closed curve ends with its first point.

    All points but the cusps are folds of the forward kinematics, where two assembly modes meet. Three meet at
    a cusp: its image in the space of the motors is the corner around which assembly modes are changed without
    a singularity (Wenger and El Omri 1996; McAree and Daniel 1999).
    """

    q: Array  # (m, nq)
    x: Array  # (m, n)
    motors: Array  # (m, n_a) joint side, continuous over whole turns
    modes: Array  # (m, legs) working mode: the sign of each leg's determinant, which changes at Type 1
    # type_2; closure, constraint or leg_passive as in `type2.PRECEDENCE`; self_motion if the motors rest all
    # along; joints_only if the platform rests all along
    kind: str
    closed: bool
    # why tracing stopped at the first and last point: closed; left (the region); stalled (the equations lose
    # rank); or long (too many points)
    ends: tuple[str, str]
    cusps: tuple[LocusPoint, ...]
    branch_points: tuple[LocusPoint, ...]  # where another curve of the locus crosses


@dataclass(frozen=True, eq=False)
class TracedLocus:
    """The traced part of the locus; `curves` are distinct, in the order of tracing.

    Each point is singular, but further curves may exist.
    """

    robot: ParallelRobot
    free: tuple[str, str]  # the two freedoms of the slice
    curves: tuple[LocusCurve, ...]
    starts: int  # number of points of the locus that the search found, each on one of the curves

    @property
    def cusps(self) -> tuple[LocusPoint, ...]:
        """All cusps of all curves."""
        return tuple(point for curve in self.curves for point in curve.cusps)


def trace_locus(
    robot: ParallelRobot,
    q: ArrayLike,
    *,
    free: tuple[str, str] | None = None,
    reach: float = REGION_REACH,
    starts: int = 40,
    one_mode: bool = False,
    near: Sequence[Array] = (),
    longest: float = MAX_STEP,
    with_cusps: bool = True,
) -> TracedLocus:
    """Trace the singular locus in the slice through an assembled configuration q (nq,).

    Args:
        free: the two freedoms of the slice, axes of the platform or actuators; the others keep their values
            at q. The platform's two translations by default.
        reach: half the width of the region in which curves are followed [robot lengths], for translations of
            the platform and sliding motors about q. Hinges turn without bound.
        starts: number of random configurations, with a fixed seed, from which the search begins.
        one_mode: follow curves in the working mode of q only, which is faster.
        near: further configurations (nq,) from which the search begins.
        longest: the longest step along a curve [rad, robot lengths].
        with_cusps: whether the cusps are located, which takes as long as the curves.

    Raises:
        InvalidInput: see `LocusEquations.of`; or q is not an assembled configuration.
    """
    positive("reach", reach)
    whole("starts", starts)  # none where `near` suffices
    closed = assembled_at(robot, q)
    equations = LocusEquations.of(robot, closed.q[0], closed.x[0], free)
    mode = leg_signs(robot, closed)[0] if one_mode else None
    region = Region(equations, closed.q[0], reach * robot.length, mode)
    if one_mode:
        guesses = draw_in_mode(region, starts)  # (starts, nq)
    else:
        # hinges are drawn by up to half a turn, slides by up to a robot length; the loops are not closed
        spread = np.where(robot.sliding[robot.moving], 1.0, np.pi)  # (k,) [robot lengths, rad]
        steps = np.random.default_rng(0).uniform(-spread, spread, (starts, len(spread)))
        guesses = equations.move(closed.q[0], steps)
    solutions = find_solutions(equations, np.vstack([guesses, *near]))
    solutions = solutions[region.contains(solutions)]
    curves = list[tuple[Curve, list[Points]]]()
    if len(solutions):
        least = singular_values(passive_matrix(robot, linearised_at(robot, solutions)))
        coranks = np.maximum((least < RANK_LOST).sum(axis=1), 1)  # numbers of uncontrolled motions
        for corank in np.unique(coranks).tolist():
            curves += _trace_branches(equations, region, solutions[coranks == corank], longest, corank)
    described = tuple(
        _describe_curve(equations, region.clip(curve), crossings, with_cusps=with_cusps)
        for curve, crossings in curves
    )
    return TracedLocus(robot, equations.free_names, described, starts=len(solutions))


def _trace_branches(
    equations: LocusEquations, region: Region, solutions: Array, longest: float, corank: int
) -> list[tuple[Curve, list[Points]]]:
    """Trace the distinct curves through solutions (S, nq), and all curves that branch off.

    Args:
        region: where curves are followed.
        longest: longest step along a curve [rad, robot lengths].
        corank: number of uncontrolled motions at the solutions, and along the curves.

    Returns:
        Each curve with its branch points (S = 1 each).
    """
    max_curves = 100  # after which no further branches are traced
    max_starts = 16  # traced in one stack: more would mostly be on the same curves
    if corank > 1:  # g, with a multiple root, has led to them slowly
        solutions = find_solutions(equations, solutions, corank=corank)
    points = curve_points(solutions, equations.evaluate(solutions, corank=corank), previous=None)
    starts = [points.single(k) for k in range(len(solutions))]
    curves = list[tuple[Curve, list[Points]]]()
    while len(curves) < max_curves:
        starts = [
            point
            for point in starts
            if not any(passes_point(equations, traced.points.q, point.q[0]) for traced, _ in curves)
        ]
        if not starts:
            break
        stride = -(-len(starts) // max_starts)
        tried = starts[::stride]
        del starts[::stride]
        for curve in trace_curves(equations, join(tried), region.contains, longest):
            along = curve.points
            determinant = along.determinant  # of [dF/du ; t']
            crossings = []  # where another curve crosses: the determinant is zero there
            for k in np.flatnonzero(determinant[1:] * determinant[:-1] < 0):
                ends = along.single(k), along.single(k + 1)
                sizes = np.abs(determinant[[k, k + 1]])
                # to this size only, as the corrector loses digits closer by
                small = BRANCH_POINT_RATIO * float(sizes.max())
                root = root_between(equations, *ends, lambda point: float(point.determinant[0]), small=small)
                crossings.append(ends[int(sizes[1] <= sizes[0])] if root is None else root)
            curves.append((curve, crossings))
            for crossing in crossings:
                branches = _points_on_crossing_curve(equations, crossing)
                starts += [point for point in branches if region.contains(point.q)[0]]
    return curves


def _describe_curve(
    equations: LocusEquations, curve: Curve, crossings: list[Points], *, with_cusps: bool
) -> LocusCurve:
    """Describe a traced curve by platform, motors, modes, cusps and branch points.

    `crossings` are the branch points (S = 1 each).
    """
    robot = equations.robot
    points = curve.points
    linearised = linearised_at(robot, points.q)
    x = robot.platform.coordinates(linearised.frames)
    motors = robot.actuated_coordinates(points.q)
    hinges = ~robot.sliding[robot.actuated]
    motors[:, hinges] = np.unwrap(motors[:, hinges], axis=0)  # a closed curve may turn motors by whole turns

    motor_steps = equations.offsets(points.q[:-1], points.q[1:])[:, : robot.n_a]  # (m - 1, n_a)
    platform_extent = np.ptp(x / robot.platform_scale, axis=0)  # (n,)
    kind = uncontrolled_motion(robot, linearised.select(len(x) // 2)).kind
    if platform_extent.max() < DISTINCT_SOLUTIONS:
        kind = "joints_only"
    elif np.abs(motor_steps).max(initial=0.0) < DISTINCT_SOLUTIONS:
        kind = "self_motion"

    return LocusCurve(
        q=points.q,
        x=x,
        motors=motors,
        modes=leg_signs(robot, linearised),
        kind=kind,
        closed=curve.ends[0] == "closed",
        ends=curve.ends,
        cusps=_find_cusps(equations, points) if with_cusps and kind == "type_2" else (),
        branch_points=tuple(_locus_point(robot, crossing.q[0]) for crossing in crossings),
    )


def _find_cusps(equations: LocusEquations, points: Points) -> tuple[LocusPoint, ...]:
    """Find the cusps of a curve of m points, where the slope of g along the uncontrolled motion changes sign.

    The motion itself, with passive rates eta, may have opposite signs at two neighbours. Then eta and the
    slope of the second one are negated. Intervals with a branch point are left out: a second motion is
    uncontrolled there, and the sign of the slope is arbitrary.
    """
    cosine = np.sum(points.eta[1:] * points.eta[:-1], axis=1)  # (m - 1,) of the angle between neighbours
    changes_sign = points.eta_slope[1:] * points.eta_slope[:-1] * cosine < 0
    has_branch = points.determinant[1:] * points.determinant[:-1] <= 0
    cusps = []
    for k in np.flatnonzero(changes_sign & ~has_branch):
        end = points.single(k + 1)
        if cosine[k] < 0:
            end = end._replace(eta=-end.eta, eta_slope=-end.eta_slope)
        cusp = root_between(equations, points.single(k), end, lambda point: float(point.eta_slope[0]))
        if cusp is not None:
            cusps.append(_locus_point(equations.robot, cusp.q[0]))
    return tuple(cusps)


def _locus_point(robot: ParallelRobot, q: Array) -> LocusPoint:
    """Return the locus point at a configuration q (nq,)."""
    x = robot.platform.coordinates(frames_at(robot, q[None]))[0]
    return LocusPoint(q, x, robot.actuated_coordinates(q[None])[0])


def root_between(
    equations: LocusEquations,
    start: Points,
    end: Points,
    measure: Callable[[Points], float],
    *,
    small: float = 0.0,
) -> Points | None:
    """Find the point between neighbours `start` and `end` (S = 1) where a measure changes its sign.

    The Illinois method finds the share of the chord at which |measure| is at most `small`: a secant between
    both ends of the bracket, where the value of an end that stays twice in turn is halved. If the corrector
    fails, as near a branch point, the last corrected point is returned, or None without any.

    Args:
        measure: computes the measure of a point (S = 1).
        small: |measure| that counts as zero, in the unit of the measure.
    """
    iterations = 100  # largest number of points between both
    chord = float(np.linalg.norm(equations.offsets(start.q[0], end.q[0])))  # length [rad, robot lengths]
    curvature = (end.tangent - start.tangent) / chord  # (1, k) of the curve between both, for the predictor
    shares, values = [0.0, 1.0], [measure(start), measure(end)]  # of the bracket's two ends
    share, moved_end = 0.0, -1
    root = None
    for _ in range(iterations):
        last, share = share, shares[0] - values[0] * (shares[1] - shares[0]) / (values[1] - values[0])
        point, arrives = advance(equations, start, np.array([share * chord]), curvature)
        if not arrives or abs(share - last) < SHARE_ROUNDING:
            break
        root, value = point, measure(point)
        if abs(value) <= small:
            break
        end_to_move = 0 if value * values[0] > 0.0 else 1
        shares[end_to_move], values[end_to_move] = share, value
        if end_to_move == moved_end:
            values[1 - end_to_move] *= 0.5
        moved_end = end_to_move
    return root


def _points_on_crossing_curve(equations: LocusEquations, crossing: Points) -> list[Points]:
    """Compute points of the curve that crosses at a branch point `crossing`, at most one on each side.

    Both tangents w lie in the two-dimensional null space of the slopes F' and solve y . F"(w, w) = 0, with y
    the left null vector of F'. On the null space this is a symmetric form of two variables. With its values
    -a^2 and b^2 along the principal axes n_1, n_2 it is zero along b n_1 + a n_2 and b n_1 - a n_2. A
    definite form has no such directions: the other curve is not real.
    """
    svd = np.linalg.svd(equations.evaluate(crossing.q, crossing).slopes[0])
    left_null = svd.U[:, -1]  # y (k - 1,)
    null_space = svd.Vh[-2:]  # (2, k) orthonormal
    steps = DIFFERENCE_STEP * np.vstack([null_space, -null_space])  # (4, k) ahead, then back
    centre = select(crossing, np.zeros(len(steps), dtype=int))  # the branch point for each step
    slopes = equations.evaluate(equations.move(centre.q, steps), centre).slopes
    changes = (slopes[:2] - slopes[2:]) / (2 * DIFFERENCE_STEP)  # F"(n, .) (2, k - 1, k) for n of the basis
    form = left_null @ changes @ null_space.T  # (2, 2) symmetric up to the error of the differences
    (negative, positive), axes = np.linalg.eigh(form)
    if negative >= 0.0 or positive <= 0.0:
        return []
    n_1, n_2 = axes.T @ null_space  # (k,) unit vectors
    a, b = np.sqrt([-negative, positive])
    tangents = [b * n_1 + a * n_2, b * n_1 - a * n_2]
    other = min(tangents, key=lambda w: abs(w @ crossing.tangent[0]))
    other /= np.linalg.norm(other)

    starts = join([crossing._replace(tangent=direction[None]) for direction in (other, -other)])
    points, arrives = advance(equations, starts, np.full(2, FIRST_STEP), np.zeros_like(starts.tangent))
    return [points.single(k) for k in np.flatnonzero(arrives)]


class Region(NamedTuple):
    """The part of the configuration space in which curves are followed."""

    equations: LocusEquations
    q: Array  # (nq,) configuration at the centre, a pose of the slice with platform coordinates `equations.x`
    reach: float  # [m] largest offset of each translation from the centre
    mode: Array | None  # (legs,) signs of the working mode; None for all modes

    def contains(self, q: Array) -> BoolArray:
        """Return whether configurations (T, nq) are in the region, (T,).

        The translations must be within `reach` of the centre: those of the motors if the motors are the
        freedoms of the slice, else those of the platform. The working mode must be `mode`, if there is one.
        """
        equations = self.equations
        robot = equations.robot
        x = robot.platform.coordinates(frames_at(robot, q))
        if equations.in_motors:
            motors = robot.actuated[list(equations.free)]
            sliding = motors[robot.sliding[motors]]  # hinges turn without bound
            offset = difference(robot, self.q, q)[:, sliding]
        else:
            offset = (x - equations.x)[:, robot.translations]
        inside = np.abs(offset).max(axis=1, initial=0.0) < self.reach
        turns = x[:, ~robot.translations]
        if turns.shape[1] == 3:  # a rotation vector, whose chart ends at an angle of pi: stop a step earlier
            inside &= np.linalg.norm(turns, axis=1) < np.pi - MAX_STEP
        if self.mode is not None:
            inside &= (self.leg_clearances(q, self.mode) > -RANK_ROUNDING).all(axis=1)
        return inside

    def leg_clearances(self, q: Array, mode: Array) -> Array:
        """Compute the legs' least singular values (T, legs) at q (T, nq), positive in the mode.

        Each, zero at Type 1, is multiplied by the sign of the leg's determinant and by that in the `mode`
        (legs,).
        """
        robot = self.equations.robot
        M = type1_matrix(robot, linearised_at(robot, q))
        blocks = [M[:, leg.rows][:, :, leg.columns] for leg in legs(robot)]
        signed = [np.linalg.slogdet(block).sign * least_singular_values(block) for block in blocks]  # (T,)
        return np.stack(signed, axis=1) * mode

    def clip(self, curve: Curve) -> Curve:
        """Return the part of a curve in the region's working mode.

        A curve that left the region may have left its mode through a Type 1 singularity. There it is cut. In
        a region of all modes the curve stays whole.
        """
        if self.mode is None or len(curve.points.q) < 2:
            return curve
        points = curve.points
        for end in curve.ends:  # the first end, then the last one, each as the last of the points
            points = points.reverse_order()
            if end == "left":  # tracing stopped outside the region, or the mode
                points = self._clip_end(points, self.mode)
        return Curve(points, curve.ends)

    def _clip_end(self, points: Points, mode: Array) -> Points:
        """Move the last of the points, if outside the working mode, back to the edge of the mode.

        Other legs may be at Type 1 all along the curve.
        """
        last_inside, outside = self.leg_clearances(points.q[-2:], mode)  # (legs,) each
        leaves = (outside < -RANK_ROUNDING) & (last_inside > RANK_ROUNDING)
        if not leaves.any():  # the curve does not leave the mode between these two points
            return points
        at_edge = CUT_CLEARANCE_RATIO * last_inside[leaves]  # where the curve is cut, just inside

        def excess(point: Points) -> float:
            """Compute the least clearance of these legs over that at the edge, less 1."""
            return float((self.leg_clearances(point.q, mode)[0, leaves] / at_edge).min()) - 1.0

        inside = points.single(-2)
        # a tenth is accurate enough, and keeps the edge inside the mode
        edge = root_between(self.equations, inside, points.single(-1), excess, small=0.1)
        points = select(points, slice(None, -1))
        return points if edge is None else join([points, edge])


def draw_in_mode(region: Region, count: int) -> Array:
    """Draw configurations (count, nq) of the region's working mode.

    The platform moves from the region's centre to random targets in steps. A configuration rests in a step
    after which the loops do not close or the region is left.
    """
    steps = 10  # from the centre to a target
    equations = region.equations
    robot = equations.robot
    # platform axes to move; if two motors are the freedoms, the platform may move along all of its axes
    axes = list(range(robot.n)) if equations.in_motors else list(equations.free)
    spread = np.where(robot.translations[axes], region.reach, np.pi)  # [m, rad] farthest target on each axis
    displacement = np.zeros((count, robot.n))  # from the centre to the targets
    displacement[:, axes] = np.random.default_rng(0).uniform(-spread, spread, (count, len(axes)))
    q = np.tile(region.q, (count, 1))
    for k in range(1, steps + 1):
        x = equations.x + k / steps * displacement
        next_q, _, closed = close_each(robot, x, q, farthest=MAX_NEWTON_STEP)
        closed[closed] &= region.contains(next_q[closed])  # from here on: closed and in the region
        q = np.where(closed[:, None], next_q, q)
    return q
