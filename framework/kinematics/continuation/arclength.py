"""Curves of n equations F(u) = 0 for n + 1 unknowns: pseudo-arclength continuation and turning points.

Steps along the tangent are corrected by Newton's method across the curve (H. B. Keller 1977). With a border c
that completes the matrix F' = dF/du, Newton's step and the tangent du/dt for the parameter t = c . u solve

    [F']        [-F]        [F']         [0]
    [c'] step = [ 0],       [c'] du/dt = [1].

With c along the curve the matrix is regular also where the derivative of F by n of the unknowns is singular.

Mostly u = (y, s): joints y, in radians and robot lengths, follow while the share s of a motion or of a load
is prescribed. If the prescribed change excites the uncontrolled motion, the curve remains smooth where dF/dy
loses rank: only s turns back. Let c be a unit vector along dy/ds, so that t = c . y. The slope ds/dt is the
bordered measure of singularity with dF/ds as its border (Govaerts 2000, chapter 3). It is positive before the
turning point and zero at it. The secant method in t finds this root; each iterate also takes a Newton step
back to the curve. Near the root ds/dt is nearly linear in t, so a few secants suffice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from framework.kinematics.assembly import MAX_ITERATIONS
from framework.kinematics.continuation.predictor_corrector import MAX_PREDICTOR_MOVE, is_straight
from framework.kinematics.frames import difference, integrate, largest_motion
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import LEAST_DIVISOR, Array, BoolArray, IntArray, assign, select
from framework.numerics.ordered_sums import dot, solve
from framework.tolerances import BRANCH_STEP_SHARE, NEWTON_STEP

# [rad, lengths] norm over all joints; no farther turning point counts
MAX_ARC_LENGTH = 2 * MAX_PREDICTOR_MOVE
LOAD_STEP = 0.1  # [rad, lengths] largest motion of a joint in a step under load; deflections are smaller
UNCHECKED_MOTION = 1e-7  # [rad, lengths] shorter steps are too short for a fold, and are not halved
# Largest error of the gain in share predicted from the tangents, divided by the gain along the steeper
# tangent. Two folds of a cubic between the ends of a step leave an error of 1 / 6.
MAX_SHARE_GAP = 0.1


class EquationsWithSlopes(Protocol):
    """F and its derivatives at T points, dimensionless; implementations are named tuples of arrays."""

    @property
    def values(self) -> Array:
        """F (T, n)."""

    @property
    def slopes(self) -> Array:
        """dF/du (T, n, n + 1)."""


Point = TypeVar("Point", bound=tuple[Any, ...])  # a named tuple of arrays, one item each for T curves
AnyEquations = TypeVar("AnyEquations", bound=EquationsWithSlopes)


def solve_step_and_tangent(equations: EquationsWithSlopes, border: Array) -> tuple[Array, Array]:
    """Solve for Newton's step normal to the border c (T, n + 1), and for the tangent with c . du = 1.

    Returns:
        The steps and the tangents (T, n + 1), infinite where the matrix is singular.
    """
    right = np.zeros((*border.shape, 2))  # [-F; 0] and [0; 1]
    right[:, :-1, 0] = -equations.values
    right[:, -1, 1] = 1.0
    both = solve(np.concatenate([equations.slopes, border[:, None]], axis=1), right)
    return both[..., 0], both[..., 1]


class Correction(NamedTuple, Generic[Point, AnyEquations]):
    """T predicted points after Newton's method."""

    points: Point
    equations: AnyEquations  # before the last step, which is below NEWTON_STEP if converged
    step: Array  # (T, n + 1) sum of all steps
    converged: BoolArray  # (T,)


def correct_points(
    evaluate: Callable[[Point, IntArray], AnyEquations],
    move: Callable[[Point, Array, IntArray], Point],
    points: Point,
    border: Array,
    *,
    longest: Array,
    repeats: BoolArray,
    measured: slice = slice(None),
) -> Correction[Point, AnyEquations]:
    """Correct T predicted points to their curves by Newton's method, normal to borders (T, n + 1).

    A point whose corrections add up to more than `longest` is given up, since it may be on another branch.

    Args:
        evaluate: function of points and of the indices of their curves that returns the equations.
        move: function of points, steps (k, n + 1) and indices (k,) that returns the points after the steps.
        longest: (T,) largest sum of corrections, each measured by its largest entry.
        repeats: (T,) whether a step below NEWTON_STEP is followed by another one, to rounding.
        measured: the unknowns whose corrections count.
    """
    max_corrections = 8
    step = np.zeros_like(border)  # (T, n + 1)
    correction = np.zeros(len(border))  # (T,) sum of the largest entries
    was_small, converged = np.zeros((2, len(border)), dtype=bool)  # (T,) each
    live = np.arange(len(border))  # (k,) indices of the points that are still corrected
    all_equations = equations = evaluate(points, live)
    for k in range(max_corrections):
        if k:
            equations = evaluate(select(points, live), live)
            assign(all_equations, live, equations)  # type: ignore[type-var]
        newton, _ = solve_step_and_tangent(equations, border[live])  # (k, n + 1)
        size = np.abs(newton[:, measured]).max(axis=1, initial=0.0)
        correction[live] += size
        goes_on = correction[live] <= longest[live]  # not if the matrix is singular
        newton[~goes_on] = 0.0
        step[live] += newton
        assign(points, live, move(select(points, live), newton, live))

        is_small = goes_on & (size < NEWTON_STEP)
        is_last = is_small & (was_small[live] | ~repeats[live])
        was_small[live] = is_small
        converged[live[is_last]] = True
        live = live[goes_on & ~is_last]
        if not len(live):
            break
    return Correction(points, all_equations, step, converged)


# ------------------------------------------------------------------ curves of joints and a share


class CurveEquations(NamedTuple):
    """F (T, k) and its derivatives (T, k, k + 1) by k joints and the share, dimensionless."""

    values: Array
    slopes: Array


class CurvePoints(NamedTuple):
    """Points of T curves."""

    q: Array  # (T, nq)
    share: Array  # (T,) s


class CurveReason(IntEnum):
    """Why a curve ends."""

    ARRIVED = 0  # at s = 1
    TURNED = 1  # s turns back, or stability is lost
    LEFT = 2  # of the region in which curves are followed
    STALLED = 3  # no step further is accepted, however short


class CurveSteps(NamedTuple, Generic[AnyEquations]):
    """The ends of R steps along curves."""

    rows: IntArray  # (R,) indices of the curves
    points: CurvePoints
    tangent: Array  # (R, k + 1) d(y, s)/dt
    equations: AnyEquations
    size: Array  # (R,) [rad, lengths] largest motion of a joint along the tangent at the start
    is_straight: BoolArray  # (R,) whether the tangent turns little on the way


class TurningPoints(NamedTuple):
    """The turning points of T curves; the values of a curve are meaningless unless `found`."""

    found: BoolArray  # (T,) whether the curve has a turning point ahead
    share: Array  # (T,) s
    q: Array  # (T, nq)
    length: Array  # (T,) t along the curve [rad, lengths]


@dataclass(frozen=True, eq=False)
class Curves(Generic[AnyEquations]):
    """T curves F(y, s) = 0 of joints y while the share s of a prescribed motion or load grows."""

    robot: ParallelRobot
    columns: IntArray  # (k,) columns of the joints y
    turn: Array  # (T, nv) prescribed motion of the other joints from s = 0 to 1
    # evaluates F at configurations (r, nq) and shares (r,) of the curves with indices (r,)
    evaluate: Callable[[Array, Array, IntArray], AnyEquations]

    def follow(
        self,
        q: Array,
        share: Array,
        first: AnyEquations,
        *,
        longest: Array,
        to_rounding: bool = False,
        accept: Callable[[CurveSteps[AnyEquations]], tuple[BoolArray, BoolArray]],
    ) -> tuple[CurvePoints, NDArray[np.uint8]]:
        """Follow T curves from points q (T, nq) at s = `share` (T,) until they end, at most to s = 1.

        Each curve takes steps of its own. An accepted step doubles the next one, a refused step is halved and
        tried again. A step is accepted if its correction is small, if the gain in s agrees with the slopes of
        s at both ends, so that no fold lies between, and if its end is on the same branch. Where s turns back
        the turning point is solved for. Where the branch ends otherwise, as at a bifurcation, the place is
        bracketed. Returns the ends, and why each curve ends, `CurveReason` (T,).

        Args:
            first: the equations at the starts.
            longest: (T,) [rad, lengths] the largest motion of a joint in a step; `accept` may change it.
            to_rounding: whether each point gets one more correction, which tangents of soft robots need.
            accept: returns which steps without a fold end on their branch, (R,), and which are in the region
                where curves are followed, (R,). It may take note of the steps that it accepts.
        """
        max_steps = 10000  # most curves take one, and a turn of a motor takes a hundred
        points = CurvePoints(q.copy(), share.copy())
        reason = np.full(len(q), CurveReason.STALLED, dtype=np.uint8)
        step = longest.copy()
        live = np.arange(len(q))  # indices of the curves still followed
        tangent = self._scale_tangents(_tangents_of_growing_share(first), live)
        for _ in range(max_steps):
            if not len(live):
                break
            start = select(points, live)
            with np.errstate(all="ignore"):  # a step that fails gives numbers that are not finite
                ends, on_curve, turns_back = self._take_steps(
                    start, tangent[live], step[live], live, to_rounding=to_rounding
                )
            is_accepted = on_curve & ~turns_back
            accepted = select(ends, is_accepted)
            keeps_branch, is_inside = accept(accepted)
            is_accepted[is_accepted] = keeps_branch
            is_lost = on_curve & ~is_accepted
            size = ends.size
            rows, reached = accepted.rows[keeps_branch], select(accepted.points, keeps_branch)
            assign(points, rows, reached)
            tangent[rows] = accepted.tangent[keeps_branch]
            reason[rows[reached.share == 1.0]] = CurveReason.ARRIVED
            reason[rows[~is_inside[keeps_branch] & (reached.share <= 1.0)]] = CurveReason.LEFT
            step[live] = np.where(is_accepted, np.minimum(2.0 * size, longest[live]), 0.5 * size)
            reason[live[is_lost & (size <= UNCHECKED_MOTION)]] = CurveReason.TURNED

            folding = np.flatnonzero(on_curve & turns_back)
            if len(folding):
                ahead = self.find_turning_points(start.q[folding], start.share[folding], live[folding])
                rows = live[folding[ahead.found]]
                assign(points, rows, CurvePoints(ahead.q[ahead.found], ahead.share[ahead.found]))
                reason[rows] = CurveReason.TURNED
            can_halve = size > UNCHECKED_MOTION  # not where there is no tangent
            live = live[(is_accepted | can_halve) & (reason[live] == CurveReason.STALLED)]
        return points, reason

    def _take_steps(
        self, start: CurvePoints, tangent: Array, step: Array, rows: IntArray, *, to_rounding: bool
    ) -> tuple[CurveSteps[AnyEquations], BoolArray, BoolArray]:
        """Step along R curves by at most `step` (R,), the largest motion of a joint [rad, lengths].

        A step ends at s = 1 if that is nearer, and is then corrected at constant s; if s has passed 1 the
        step leads back. Any other step is corrected across the tangent. The parameter t is the length along
        the tangents, of all joints.

        Args:
            tangent: (R, k + 1) d(y, s)/dt at the starts.
            rows: indices (R,) of the curves.
            to_rounding: as in `follow`.

        Returns:
            The ends of the steps; whether they are on the curve; whether s turns back on the way to them.
        """
        speed = largest_motion(self.robot, self._joint_motions(tangent, rows))
        limit = step / np.maximum(speed, LEAST_DIVISOR)  # of the length in t
        to_end = (1.0 - start.share) / tangent[:, -1]
        is_whole = np.abs(to_end) <= limit
        length = np.clip(to_end, -limit, limit)
        size = np.abs(length) * speed
        predicted = self._move(start, length[:, None] * tangent, rows)
        predicted.share[is_whole] = 1.0

        across = self._gradients_of_length(tangent, rows)
        constant_share = np.eye(tangent.shape[1])[-1]
        points, equations, change, converged = correct_points(
            lambda points, which: self.evaluate(*points, rows[which]),
            lambda points, change, which: self._move(points, change, rows[which]),
            predicted,
            np.where(is_whole[:, None], constant_share, across),
            longest=np.maximum(BRANCH_STEP_SHARE * size, UNCHECKED_MOTION),
            repeats=to_rounding & ~is_whole,
            measured=slice(-1),
        )
        _, end_tangent = solve_step_and_tangent(equations, across)

        length = length + dot(across, change)
        mean_slope = 0.5 * (tangent[:, -1] + end_tangent[:, -1])  # of s
        largest_slope = np.maximum(np.abs(tangent[:, -1]), np.abs(end_tangent[:, -1]))
        gap = np.abs(points.share - start.share - length * mean_slope)
        # the shortest steps have no room for a fold
        has_room = size > UNCHECKED_MOTION
        on_curve = converged & ~(has_room & ~(gap <= MAX_SHARE_GAP * np.abs(length) * largest_slope))
        turned = np.abs(length[:, None] * (end_tangent - tangent))[:, :-1].max(axis=1, initial=0.0)
        correction = np.abs(change[:, :-1]).max(axis=1, initial=0.0)
        ends = CurveSteps(
            rows=rows,
            points=points,
            tangent=self._scale_tangents(end_tangent, rows),
            equations=equations,
            size=size,
            is_straight=is_straight(turned, correction, size),
        )
        return ends, on_curve, tangent[:, -1] * end_tangent[:, -1] < 0.0

    def _gradients_of_length(self, tangent: Array, rows: IntArray) -> Array:
        """Compute the gradients (R, k + 1) of the length along tangents in y and s, of unit length.

        A change of s moves the other joints by `turn`, whose square is the weight of s. Without any motion s
        itself is the length.
        """
        turn = self.turn[rows] / self.robot.column_scale
        gradient = tangent.copy()
        gradient[:, -1] *= dot(turn, turn)
        gradient[~gradient.any(axis=1), -1] = 1.0
        return gradient

    def _scale_tangents(self, tangent: Array, rows: IntArray) -> Array:
        """Scale tangents (R, k + 1) to unit length of the motion of all joints [rad, lengths]."""
        length = np.sqrt(dot(tangent, self._gradients_of_length(tangent, rows)))
        return tangent / length[:, None]

    def find_turning_points(self, q: Array, share: Array, rows: IntArray) -> TurningPoints:
        """Find the turning points of R curves ahead of configurations q (R, nq) at s = `share` (R,).

        The secant method follows the curves to ds/dt = 0; t (R,) is the length along them so far, dt (R,) the
        next secant step [rad, lengths]. A curve that has converged or become too long rests while the others
        go on. A turning point counts as found only if the curve to it is nearly a parabola in t. On a
        parabola the chord is t times the mean of both end tangents, and s gains t/2 times its slope at the
        start.

        Args:
            rows: indices (R,) of the curves.
        """
        first_secant_length = 1e-3  # [rad, lengths] along the curve, for the first secant of ds/dt
        max_chord_deviation = 0.1  # from a parabola, over the chord
        max_gain_deviation = 0.25  # from a parabola, over the gain in s
        points = CurvePoints(q, share)
        t = np.zeros(len(q))
        dt = np.full(len(q), first_secant_length)
        converged = np.zeros(len(q), dtype=bool)
        with np.errstate(all="ignore"):  # a curve without a turning point ahead diverges
            equations = self.evaluate(q, share, rows)
            c = _tangents_of_growing_share(equations)
            c[:, -1] = 0.0
            correction, tangent = solve_step_and_tangent(equations, c)
            first_tangent = tangent
            for _ in range(MAX_ITERATIONS):
                step = correction + dt[:, None] * tangent  # (R, k + 1) back to the curve and along it
                # negated, so that a t that is not a number diverges
                diverges = ~((np.abs(t + dt) < MAX_ARC_LENGTH) & np.isfinite(step).all(axis=1))
                rests = converged | diverges
                step[rests] = 0.0
                points = self._move(points, step, rows)
                t = t + np.where(rests, 0.0, dt)
                converged |= ~diverges & (np.abs(step).max(axis=1) < NEWTON_STEP)

                last_slope = tangent[:, -1]  # ds/dt
                correction, tangent = solve_step_and_tangent(self.evaluate(*points, rows), c)
                if (converged | diverges).all():
                    break
                dt = -dt * tangent[:, -1] / (tangent[:, -1] - last_slope)  # to the secant's zero of ds/dt

            chord = difference(self.robot, q, points.q)  # (R, nv)
            first_motion = self._joint_motions(t[:, None] * first_tangent, rows)
            mean_motion = self._joint_motions(0.5 * t[:, None] * (first_tangent + tangent), rows)
            deviation = largest_motion(self.robot, chord - mean_motion)
            expected_gain = 0.5 * t * first_tangent[:, -1]
            gain_error = np.abs(points.share - share - expected_gain)
            found = converged & (t > 0) & (points.share < 1.0)
            found &= deviation <= max_chord_deviation * largest_motion(self.robot, first_motion)
            found &= gain_error <= max_gain_deviation * expected_gain
        return TurningPoints(found, points.share, points.q, t)

    def _joint_motions(self, step: Array, rows: IntArray) -> Array:
        """Return joint motions (R, nv) [rad, m] for `step` (R, k + 1) in y and s."""
        motion = step[:, -1:] * self.turn[rows]
        motion[:, self.columns] = step[:, :-1] * self.robot.column_scale[self.columns]
        return motion

    def _move(self, points: CurvePoints, step: Array, rows: IntArray) -> CurvePoints:
        """Return the points after `step` (R, k + 1) in y and s."""
        q = integrate(self.robot, points.q, self._joint_motions(step, rows))
        return CurvePoints(q, points.share + step[:, -1])


def _tangents_of_growing_share(equations: EquationsWithSlopes) -> Array:
    """Compute the tangents d(y, s)/dt (T, k + 1) along which s grows, of unit length in y.

    Where y does not depend on s, y rests and s grows at the rate 1.
    """
    tangent = np.ones((len(equations.values), equations.slopes.shape[2]))  # (T, k + 1) d(y, s)/ds
    tangent[:, :-1] = solve(equations.slopes[:, :, :-1], -equations.slopes[:, :, -1])
    length = np.linalg.norm(tangent[:, :-1], axis=1, keepdims=True)
    return tangent / np.where(length > 0.0, length, 1.0)
