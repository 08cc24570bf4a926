"""The singular locus in two freedoms of a robot: its equations in joint space, and the tracing of its curves.

The unknowns u are the positions of all k moving joints: motors, then passive joints, in radians and robot
lengths. The k - 1 equations F(u) = 0 are the loop equations, fixed values of all freedoms but two, and g = 0.
The solutions are curves that are smooth in joint space even where their image in the platform's plane has an
end, a corner or an isolated point. They pass through Type 1 singularities from one working mode to the next,
through legs of zero length, and around self-motions.

A curve is traced by pseudo-arclength continuation (H. B. Keller 1977). The predictor follows the tangent and
the curvature of the curve; the corrector is Newton's method in the plane normal to the tangent. The step is
shortened if the corrector moves far or the tangent turns much. A curve is traced from a start in both
directions until it returns to the start, leaves a region or cannot be continued. Lengths along curves and
offsets from them are those of u.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, SupportsIndex

import numpy as np

from framework.errors import InvalidInput, check_choice, short
from framework.kinematics.assembly import MAX_ITERATIONS, MAX_NEWTON_STEP
from framework.kinematics.continuation.arclength import correct_points
from framework.kinematics.frames import difference, integrate_columns
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.linearised_loops import (
    LinearisedLoops,
    independent_loops_matrix,
    linearised_at,
    passive_matrix,
)
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import LEAST_DIVISOR, Array, BoolArray, IntArray, join, select
from framework.numerics.ordered_sums import solve
from framework.numerics.rotations import wrap_angles
from framework.singularity.bordered_system import Border
from framework.singularity.type2 import has_signed_measure, measure_gradient
from framework.tolerances import NEWTON_STEP, RANK_LOST, RANK_ROUNDING

# A point is on a curve if its distance from a chord is at most this share of the chord's length. A step in
# which the tangent turns by MAX_TANGENT_TURN gives 0.02.
MAX_CURVE_OFFSET = 0.05
MAX_STEP, MIN_STEP, FIRST_STEP = 0.2, 1e-7, 0.03  # [rad, robot lengths] along a curve
MAX_TANGENT_TURN = 0.15  # [rad] in a step: 40 points per full turn, chords 3e-3 of the radius off the curve


class Evaluated(NamedTuple):
    """The equations of the locus and their derivatives at S configurations, for k moving joints."""

    values: Array  # F (S, k - 1), dimensionless: m loop equations, offsets of the fixed freedoms, then g
    slopes: Array  # dF/du (S, k - 1, k)
    largest: Array  # (S,) largest entry of the bordered block G
    weights: Array  # (S, size^2) of the entries of G in the last equation
    P: Array  # (S, m, m) passive columns of the loop equations, dimensionless; singular on the locus
    eta: Array  # (S, m) passive rates closest to a motion that locked motors do not hold, c' eta = 1
    bases: Array  # (S, R, m) of the ranges of the loops' rows, to which P refers; see `LinearisedLoops.bases`


@dataclass(frozen=True, eq=False)
class LocusEquations:
    """The equations of the locus in a slice: two freedoms of the robot vary, the others are fixed."""

    robot: ParallelRobot
    x: Array  # (n,) platform coordinates of a pose in the slice
    motors: Array  # (n_a,) motor joints of this pose, joint side
    in_motors: bool  # whether the freedoms are the motors; else they are the platform's coordinates
    free_names: tuple[str, str]  # names of the two varying freedoms
    free: tuple[int, int]  # indices of the two varying freedoms among the motors or the coordinates
    fixed: IntArray  # (n - 2,) indices of the fixed freedoms

    @staticmethod
    def of(robot: ParallelRobot, q: Array, x: Array, free: tuple[str, str] | None) -> LocusEquations:
        """Return the equations of the slice through an assembled pose in two freedoms.

        Args:
            q, x: configuration (nq,) and platform coordinates (n,) of the pose.
            free: two axes of the platform or two actuators; the other axes or actuators are fixed. By default
                the two translations of the platform.

        Raises:
            InvalidInput: the robot has no such freedoms; the platform does not determine the joints; or g has
                no sign, because motors are redundant or no joint is passive.
        """
        require_square(robot)
        if not has_signed_measure(robot):
            raise InvalidInput(f"{robot.name}: a locus needs passive joints and one motor for each freedom")

        names = robot.axis_names + robot.actuator_names
        if free is None:
            chosen = (0, 1) if robot.n == 2 else tuple(np.flatnonzero(robot.translations).tolist())
            if len(chosen) != 2:
                raise InvalidInput(f"free: name two axes or two motors of {robot.name}: {', '.join(names)}")
            free = (robot.axis_names[chosen[0]], robot.axis_names[chosen[1]])
        pair: object = free
        if not isinstance(pair, tuple | list) or len(pair) != 2:
            raise InvalidInput(f"free: needs two axes or two motors, got {short(pair)}")
        for name in pair:
            check_choice("freedom", name, names)
        first, second = pair
        in_motors = first in robot.actuator_names
        freedoms = robot.actuator_names if in_motors else robot.axis_names
        if first == second or second not in freedoms:
            raise InvalidInput(f"free: needs two axes or two motors, got {first}, {second}")
        indices = freedoms.index(first), freedoms.index(second)
        return LocusEquations(
            robot=robot,
            x=x,
            motors=robot.actuated_coordinates(q[None])[0],
            in_motors=in_motors,
            free_names=free,
            free=indices,
            fixed=np.delete(np.arange(robot.n), indices),
        )

    def move(self, q: Array, u: Array) -> Array:
        """Return the configurations (S, nq) after steps u (S, k) [rad, lengths] from q (S, nq)."""
        columns = self.robot.moving
        return integrate_columns(self.robot, q, columns, u * self.robot.column_scale[columns])

    def offsets(self, start: Array, q: Array) -> Array:
        """Compute offsets (..., k) of q (..., nq) from start (..., nq), angles within half a turn."""
        columns = self.robot.moving
        offset = difference(self.robot, start, q)[..., columns] / self.robot.column_scale[columns]
        turning = ~self.robot.sliding[columns]
        offset[..., turning] = wrap_angles(offset[..., turning])
        return offset

    def evaluate(self, q: Array, near: Points | None = None, *, corank: int = 1) -> Evaluated:
        """Evaluate the equations and their derivatives at S configurations q (S, nq).

        Along some curves several motions are uncontrolled. The bordered block G is zero there, and det G to a
        higher order, without a slope. The last equation is the sum of the entries of G that grows most across
        the curve.

        Args:
            near: S points whose borders, bases and weights are used; by default each configuration has its
                own border of size `corank`.
        """
        robot = self.robot
        linearised = linearised_at(robot, q, bases=None if near is None else near.bases)
        border = Border.of(passive_matrix(robot, linearised), corank) if near is None else near.border
        measure = measure_gradient(robot, linearised, border)
        gaps = (linearised.residual / robot.equation_sizes)[:, robot.n :]  # (S, m) of the loops
        offsets, offset_slopes = self._fixed_offsets(linearised)
        # (S, ., nv) each, in the order of `Evaluated.values`, along dimensionless joints
        slopes = [independent_loops_matrix(robot, linearised), offset_slopes * robot.column_scale]
        held = np.concatenate(slopes, axis=1)[:, :, robot.moving]  # (S, k - 2, k)
        entries = measure.G.reshape(len(q), -1)  # (S, size^2)
        entry_slopes = (measure.G_by_q * robot.column_scale)[..., robot.moving].reshape(*entries.shape, -1)
        weights = _weigh_entries(held, entry_slopes) if near is None else near.weights
        return Evaluated(
            values=np.concatenate([gaps, offsets, np.vecdot(weights, entries)[:, None]], axis=1),
            slopes=np.concatenate([held, np.vecmat(weights, entry_slopes)[:, None]], axis=1),
            largest=np.abs(entries).max(axis=1),
            weights=weights,
            P=passive_matrix(robot, linearised),
            eta=measure.eta,
            bases=linearised.bases,
        )

    def _fixed_offsets(self, linearised: LinearisedLoops) -> tuple[Array, Array]:
        """Compute dimensionless offsets (S, n - 2) of the fixed freedoms, and slopes (S, n - 2, nv).

        The slopes by q [1/rad, 1/m] are exact where the loops are closed.
        """
        robot = self.robot
        if self.in_motors:
            units, is_sliding = robot.column_scale[robot.actuated], robot.sliding[robot.actuated]
            offset = robot.actuated_coordinates(linearised.frames.q) - self.motors
            slopes = np.repeat(np.eye(robot.nv)[None, robot.actuated], len(offset), axis=0)
        else:
            units, is_sliding = robot.platform_scale, robot.translations
            x = robot.platform.coordinates(linearised.frames)
            offset = x - self.x
            slopes = solve(robot.platform.rate_matrix(x), linearised.platform)  # dx/dq, of v = E dx
        offset = offset / units
        offset[:, ~is_sliding] = wrap_angles(offset[:, ~is_sliding])  # equal up to whole turns
        return offset[:, self.fixed], (slopes / units[:, None])[:, self.fixed]


def _weigh_entries(held: Array, entry_slopes: Array) -> Array:
    """Return unit weights (S, size^2) of the entries of G whose sum grows most on a surface.

    On the surface the other equations, with slopes `held` (S, k - 2, k), stay zero.
    """
    if entry_slopes.shape[1] == 1:
        return np.ones(entry_slopes.shape[:2])
    surface = np.linalg.svd(held).Vh[:, -2:]  # (S, 2, k) orthonormal
    return np.linalg.svd(entry_slopes @ surface.swapaxes(1, 2)).U[:, :, 0]


# ------------------------------------------------------------------ tracing


class Points(NamedTuple):
    """S points of curves, for k moving and m passive joints."""

    q: Array  # (S, nq)
    tangent: Array  # (S, k) unit vector t in the direction of tracing
    # (S,) det [dF/du ; t']; its sign changes at branch points. 0 for a corank above 1, where it has no sign
    determinant: Array
    eta_slope: Array  # (S,) derivative of g along the uncontrolled motion; its sign changes at cusps
    eta: Array  # (S, m) unit passive rates of the uncontrolled motion, with a sign continuous along the curve
    border: Border  # (S, m, corank) of P, the passive columns of the loops
    bases: Array  # (S, R, m) of the ranges of the loops' rows, to which border and determinant refer
    weights: Array  # (S, corank^2) of the entries of G in the last equation

    def negate_tangents(self) -> Points:
        """Return the points in the same order with opposite tangents."""
        return self._replace(tangent=-self.tangent, determinant=-self.determinant)

    def reverse_order(self) -> Points:
        """Return the points of one curve in reverse order, with opposite tangents."""
        return select(self.negate_tangents(), slice(None, None, -1))

    def single(self, k: SupportsIndex) -> Points:
        """Return the k-th of the points, S = 1."""
        return select(self, np.array([k]))


class _Poses(NamedTuple):
    """Configurations of S curves."""

    q: Array  # (S, nq)


STALLED = ("stalled", "stalled")  # ends of a curve
STALL_RATIO = 0.25  # of a step to the one that failed


class Curve(NamedTuple):
    """A traced curve."""

    points: Points  # in order along the curve; a closed curve ends with its first point
    # why tracing stopped at the first and last point: closed; left (the region); stalled (the equations lose
    # rank); or long (`max_points` of `trace_curves`)
    ends: tuple[str, str]


def find_solutions(equations: LocusEquations, q: Array, *, corank: int = 1) -> Array:
    """Find solutions (R, nq) of the equations, R <= S, by least-norm Newton steps from q (S, nq).

    The joint motions of a step are at most MAX_NEWTON_STEP. Configurations from which Newton's method does
    not converge are left out.
    """
    for _ in range(MAX_ITERATIONS):
        evaluated = equations.evaluate(q, corank=corank)
        inverse = np.linalg.pinv(evaluated.slopes, rcond=RANK_ROUNDING)
        change = -np.matvec(inverse, evaluated.values)  # (S, k) [rad, robot lengths]
        step_size = np.abs(change).max(axis=1)  # (S,)

        # leave out configurations without a step
        is_finite = np.isfinite(step_size)
        q, change, step_size = q[is_finite], change[is_finite], step_size[is_finite]
        q = equations.move(q, change / np.maximum(step_size / MAX_NEWTON_STEP, 1.0)[:, None])
        if not len(q) or step_size.max() < NEWTON_STEP:
            break
    return q[step_size < NEWTON_STEP]


def trace_curves(
    equations: LocusEquations, starts: Points, inside: Callable[[Array], BoolArray], longest: float
) -> list[Curve]:
    """Trace the distinct curves through S starts, all in both directions in one stack.

    A curve on whose start another one arrives is the same, and is given up. Each step aims at a turn of the
    tangent by `turn_share` of MAX_TANGENT_TURN; one that fails is quartered.

    Args:
        inside: returns whether each of T configurations (T, nq) is in the region, (T,). A curve ends with its
            first point outside.
        longest: largest step [rad, robot lengths]; a value above MAX_STEP counts as MAX_STEP.
    """
    turn_share = 0.8  # share of MAX_TANGENT_TURN at which the next step aims
    max_growth = 2.0  # ratio of a step to the previous one
    max_points = 3000  # from a start in one direction
    longest = min(longest, MAX_STEP)
    count = len(starts.q)  # S: directions k and k + S belong to the k-th start
    points = join([starts, starts.negate_tangents()])  # the newest ones of the directions that go on, `live`
    live = np.arange(2 * count)
    computed = [points]  # all points, and their numbers along each direction
    total = 2 * count
    numbers = [[k] for k in range(total)]
    ends = [""] * (2 * count)  # why they end, as in `Curve.ends`; empty for a direction that goes on
    step = np.full(2 * count, min(FIRST_STEP, longest))
    curvature = np.zeros(points.tangent.shape)  # (2 S, k) unknown at the start
    offsets = equations.offsets(starts.q, points.q[:, None])  # (live, S, k) of the points from all starts
    while len(live):
        ahead, arrives = advance(equations, points, step[live], curvature[live])
        is_inside = inside(ahead.q)
        next_offsets = equations.offsets(starts.q, ahead.q[:, None])
        arrives_at = _passes(offsets, next_offsets)  # (live, S) whether a start is on the chord
        for row in np.argsort(live % count, kind="stable").tolist():
            k = int(live[row])
            own = k % count
            if ends[k]:  # this curve is given up, or has closed
                continue
            if not arrives[row]:
                step[k] *= STALL_RATIO
                ends[k] = "stalled" if step[k] < MIN_STEP else ""
                continue
            for other in np.flatnonzero(arrives_at[row]).tolist():
                if other != own:
                    ends[other] = ends[other + count] = "same"
            if arrives_at[row, own] and len(numbers[k]) > 1:
                ends[own] = ends[own + count] = "closed"
                numbers[own] = [*numbers[k], numbers[k][0]]
                continue
            numbers[k].append(total + row)
            if not is_inside[row]:
                ends[k] = "left"
            elif len(numbers[k]) == max_points:
                ends[k] = "long"

            # the turn of the tangent grows with the step: choose the next one for the turn aimed at
            change = ahead.tangent[row] - points.tangent[row]
            curvature[k] = change / step[k]
            turn = max(float(np.linalg.norm(change)), LEAST_DIVISOR)  # [rad] in this step
            step[k] = min(step[k] * min(turn_share * MAX_TANGENT_TURN / turn, max_growth), longest)
        total += len(live)
        computed.append(ahead)
        goes_on = np.array([not ends[k] for k in live])
        stays, moves = np.flatnonzero(goes_on & ~arrives), np.flatnonzero(goes_on & arrives)
        live = np.concatenate([live[stays], live[moves]])
        points = join([select(points, stays), select(ahead, moves)])
        offsets = np.concatenate([offsets[stays], next_offsets[moves]])

    traced = join(computed)
    curves = list[Curve]()
    for k in range(count):
        if ends[k] == "same" or any(passes_point(equations, curve.points.q, starts.q[k]) for curve in curves):
            continue
        along = select(traced, numbers[k])
        if ends[k] != "closed":
            along = join([select(traced, numbers[k + count][1:]).reverse_order(), along])
        curves.append(Curve(along, (ends[k + count], ends[k])))
    return curves


def passes_point(equations: LocusEquations, curve: Array, point: Array) -> bool:
    """Return whether a curve through configurations (m, nq) passes one (nq,), judged by its chords."""
    offsets = equations.offsets(point, curve)  # (m, k) from the point to those of the curve
    return bool(_passes(offsets[:-1], offsets[1:]).any())


def _passes(first: Array, second: Array) -> BoolArray:
    """Return whether chords pass through a point, from which their ends are at offsets (..., k).

    The distance of the point from the chord must be below MAX_CURVE_OFFSET chord lengths.
    """
    chord = second - first
    length = np.linalg.norm(chord, axis=-1)
    distance = np.linalg.norm(chord_offsets(-first, chord), axis=-1)
    # a chord longer than two steps is a jump of a hinge by a whole turn
    return np.asarray((distance < MAX_CURVE_OFFSET * length) & (length < 2 * MAX_STEP))


def chord_offsets(offset: Array, chord: Array) -> Array:
    """Compute offsets (..., k) of points from the nearest points of their chords.

    All vectors have the same unit, as does the result.

    Args:
        offset: vectors (..., k) from the starts of the chords to the points.
        chord: vectors (..., k) from the starts to the ends of the chords.
    """
    square = np.maximum(np.sum(chord**2, axis=-1), np.finfo(float).tiny)  # chords may have length zero
    # share of the chord at the foot of the perpendicular; beyond an end, the end is nearest
    share = np.clip(np.sum(offset * chord, axis=-1) / square, 0.0, 1.0)
    return offset - share[..., None] * chord


def advance(
    equations: LocusEquations, points: Points, step: Array, curvature: Array
) -> tuple[Points, BoolArray]:
    """Compute the points of curves one `step` (S,) [rad, robot lengths] ahead of S points.

    The predictor is quadratic. Newton's method corrects the prediction normal to the tangent of the point. A
    corrector fails if its system is singular, its corrections are long compared with the step, or the tangent
    turns too far.

    Args:
        curvature: derivatives (S, k) of the unit tangents by arc length; zeros if unknown.

    Returns:
        The points; which correctors have not failed, (S,).
    """
    max_correction_ratio = 0.25  # ratio of the sum of all corrections to the step
    ahead = step[:, None]
    poses, evaluated, _, converged = correct_points(
        # one border and one basis along a step, so that g is one smooth function
        lambda poses, rows: equations.evaluate(poses.q, select(points, rows)),
        lambda poses, change, _: _Poses(equations.move(poses.q, change)),
        _Poses(equations.move(points.q, ahead * points.tangent + 0.5 * ahead**2 * curvature)),
        points.tangent,
        longest=max_correction_ratio * step,
        repeats=np.zeros(len(step), dtype=bool),
    )
    # `evaluated`, before a last step below NEWTON_STEP, holds at the poses as well
    corank = points.border.b.shape[-1]
    if corank > 1:  # the weights refer to one border
        evaluated = equations.evaluate(poses.q, corank=corank)
    next_points = curve_points(poses.q, evaluated, points)
    turn = np.linalg.norm(next_points.tangent - points.tangent, axis=1)
    return next_points, converged & (turn < MAX_TANGENT_TURN) & (evaluated.largest < RANK_LOST)


def _turn_along(vectors: Array, directions: Array) -> Array:
    """Negate the vectors (S, k) that point against their directions (S, k)."""
    return np.where(np.sum(vectors * directions, axis=1, keepdims=True) < 0, -vectors, vectors)


def curve_points(q: Array, evaluated: Evaluated, previous: Points | None) -> Points:
    """Return the points of curves at S configurations q (S, nq) that solve F = 0.

    The tangent is the null vector of dF/du. The uncontrolled motion is the null vector eta of P, the
    passive columns of the loop equations.

    Args:
        evaluated: F, dF/du, P and eta at q, or up to NEWTON_STEP away from q, where they are as good.
        previous: S points whose tangents and uncontrolled motions decide the signs of the new ones; None if
            the signs are arbitrary.
    """
    slopes = evaluated.slopes
    tangent = np.linalg.svd(slopes).Vh[:, -1]  # (S, k) null vectors of dF/du
    eta = evaluated.eta / np.linalg.norm(evaluated.eta, axis=1, keepdims=True)  # (S, m)
    if previous is not None:  # null vectors have an arbitrary sign
        tangent = _turn_along(tangent, previous.tangent)
        eta = _turn_along(eta, previous.eta)
    g_slopes = slopes[:, -1, -eta.shape[1] :]  # (S, m) of g, the last equation, by the passive joints
    determinant = np.linalg.det(np.concatenate([slopes, tangent[:, None]], axis=1))  # of [dF/du ; t']
    corank = math.isqrt(evaluated.weights.shape[1])
    return Points(
        q=q,
        tangent=tangent,
        determinant=determinant if corank == 1 else np.zeros(len(q)),
        eta_slope=np.sum(g_slopes * eta, axis=1),
        eta=eta,
        border=Border.of(evaluated.P, corank),
        bases=evaluated.bases,
        weights=evaluated.weights,
    )
