"""Pseudo-arclength continuation of many curves F(u) = 0 at once, with one equation less than unknowns.

The predictor follows the tangent and the curvature of a curve; the corrector is Newton's method in the plane
normal to the tangent (H. B. Keller 1977). The step is shortened if the corrector moves far or the tangent
turns much. All pieces of curves are traced together, in both directions from every start, until they meet the
next start, leave a region or cannot be continued. Then the pieces are joined to curves.

Lengths and offsets of curves are those of the unknowns u, the k moving joints in radians and robot lengths.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, SupportsIndex

import numpy as np

from framework.numerics.arrays import Array, BoolArray, IntArray, join, select
from framework.numerics.ordered_sums import solve
from framework.singularity.bordered_system import Border
from framework.singularity.locus_equations import MAX_JOINT_STEP, Evaluated, LocusEquations
from framework.tolerances import NEWTON_STEP, RANK_ROUNDING

# A point counts as on a curve if its distance from a chord is at most this share of the chord's length. A
# step in which the tangent turns by MAX_TANGENT_TURN gives 0.02.
MAX_CURVE_OFFSET = 0.05
MIN_CURVE_COSINE = 0.7  # between tangents of one curve; different curves usually cross at larger angles
MAX_STEP, MIN_STEP, FIRST_STEP = 0.2, 1e-7, 0.03  # [rad, robot lengths] along a curve
MAX_TANGENT_TURN = 0.15  # [rad] in a step: 40 points per full turn, chords 3e-3 of the radius off the curve
TURN_SHARE = 0.8  # share of MAX_TANGENT_TURN at which the next step aims
MIN_GROWTH, MAX_GROWTH = 0.5, 2.0  # ratio of a step to the previous one
MAX_CORRECTIONS = 6  # Newton steps
MAX_CORRECTION_RATIO = 0.25  # ratio of the sum of all corrections to the step
MAX_POINTS = 3000  # of a piece
MAX_SEARCH_STEPS = 25  # Newton steps from a random configuration
MIN_START_DISTANCE = 1e-5  # [rad, robot lengths]; of starts that are closer only the first is used


class Points(NamedTuple):
    """S points of curves, for k moving and m passive joints."""

    q: Array  # (S, nq)
    tangent: Array  # (S, k) unit vector t in the direction of tracing
    determinant: Array  # (S,) det [dF/du ; t']; its sign changes at branch points
    escape_slope: Array  # (S,) derivative of g along the escaping motion; its sign changes at cusps
    eta: Array  # (S, m) unit passive rates of the escaping motion, with a sign continuous along the curve
    border: Border  # (S, m, 1) of P, the passive columns of the loops

    def reverse(self) -> Points:
        """Return the points in the same order with opposite tangents."""
        return self._replace(tangent=-self.tangent, determinant=-self.determinant)

    def backwards(self) -> Points:
        """Return the points of one curve in reverse order, with opposite tangents."""
        return select(self.reverse(), slice(None, None, -1))

    def single(self, k: SupportsIndex) -> Points:
        """Return the k-th of the points, S = 1."""
        return select(self, np.array([k]))


class Curve(NamedTuple):
    """A traced curve."""

    points: Points  # in order along the curve; a closed curve ends with its first point
    # why tracing stopped at the first and last point: closed; left (the region); stalled (the equations lose
    # rank); or long (MAX_POINTS)
    ends: tuple[str, str]


def find_solutions(equations: LocusEquations, q: Array) -> Array:
    """Find solutions (R, nq) of the equations, R <= S, by least-norm Newton steps from q (S, nq).

    The joint motions of a step are at most MAX_JOINT_STEP. Configurations from which Newton's method does not
    converge are left out.
    """
    for _ in range(MAX_SEARCH_STEPS):
        evaluated = equations.evaluate(q)
        inverse = np.linalg.pinv(evaluated.slopes, rcond=RANK_ROUNDING)
        change = -np.matvec(inverse, evaluated.values)  # (S, k)
        size = np.abs(change).max(axis=1)

        is_finite = np.isfinite(size)
        q, change, size = q[is_finite], change[is_finite], size[is_finite]
        q = equations.move(q, change / np.maximum(size / MAX_JOINT_STEP, 1.0)[:, None])
        if not len(q) or size.max() < NEWTON_STEP:
            break
    return q[size < NEWTON_STEP]


def trace_curves(
    equations: LocusEquations,
    starts: Points,
    inside: Callable[[Array], BoolArray],
    longest: float,
) -> list[Curve]:
    """Trace the distinct curves through S starts.

    Args:
        inside: returns whether each of T configurations (T, nq) is in the region, (T,). A curve ends with its
            first point outside.
        longest: largest step [rad, robot lengths]; at most MAX_STEP in any case.
    """
    distance = np.linalg.norm(equations.offsets(starts.q[:, None], starts.q), axis=2)  # (S, S)
    is_repeated = np.tril(distance < MIN_START_DISTANCE, -1).any(axis=1)  # close to an earlier start
    starts = select(starts, ~is_repeated)

    pieces = _trace_pieces(equations, starts, inside, min(longest, MAX_STEP))
    curves = list[Curve]()
    done = set[int]()  # indices of starts on the curves so far
    for first in range(len(starts.q)):
        if first in done:
            continue
        forward, end = _chain_pieces(pieces, first, done)
        if end == "closed":
            curves.append(Curve(join(forward), (end, end)))
            continue
        backward, begin = _chain_pieces(pieces, first + len(starts.q), done)
        # both begin with the start, which is taken from `forward`
        other_half = select(join(backward).backwards(), slice(-1))
        curves.append(Curve(join([other_half, *forward]), (begin, end)))
    return curves


class _Piece(NamedTuple):
    """A part of a curve from a start, in one direction, to where tracing stopped."""

    points: Points  # from the start to the end
    end: str  # met (the last point is another start), or as in `Curve.ends`
    following: int  # number of the piece that continues from the start that was met; -1 if none was met


class _Fronts(NamedTuple):
    """The last points of the F pieces that are being traced."""

    points: Points
    curvature: Array  # (F, k) derivatives of the tangents with respect to arc length
    step: Array  # (F,) [rad, robot lengths] to be tried next
    piece: IntArray  # (F,) number of the piece, see `_trace_pieces`

    def move_to(self, ahead: Points, accepted: BoolArray, step: Array, longest: float) -> _Fronts:
        """Return the fronts after a step, with the lengths of the next steps.

        After an accepted step the next one aims at `TURN_SHARE` of the largest turn of the tangent.

        Args:
            ahead: points reached; where the step is rejected, the points at which it began.
            accepted: (F,) whether the step is accepted.
            step: (F,) length of the accepted step, or half the length of the rejected one [rad, lengths].
            longest: largest step [rad, lengths].
        """
        change = ahead.tangent - self.points.tangent
        turn = np.linalg.norm(change, axis=1)  # [rad] in this step
        aim = TURN_SHARE * MAX_TANGENT_TURN
        growth = np.clip(aim / np.maximum(turn, MIN_STEP), MIN_GROWTH, MAX_GROWTH)
        return _Fronts(
            points=ahead,
            curvature=np.where(accepted[:, None], change / step[:, None], self.curvature),
            step=np.where(accepted, np.minimum(step * growth, longest), step),
            piece=self.piece,
        )


def _trace_pieces(
    equations: LocusEquations, starts: Points, inside: Callable[[Array], BoolArray], longest: float
) -> dict[int, _Piece]:
    """Trace a piece in each direction from each of S starts; return the pieces by number.

    Piece k goes along the tangent of start k, piece S + k against it. All pieces take their steps together;
    a piece that ends leaves the `fronts`.
    """
    first_points = join([starts, starts.reverse()])  # of all 2 S pieces
    count = len(first_points.q)
    fronts = _Fronts(
        points=first_points,
        curvature=np.zeros_like(first_points.tangent),
        step=np.full(count, min(FIRST_STEP, longest)),
        piece=np.arange(count),
    )
    traced = [[first_points.single(k)] for k in range(count)]  # the points of each piece so far
    pieces: dict[int, _Piece] = {}
    while len(fronts.piece):
        ahead, accepted = advance(equations, fronts.points, fronts.step, fronts.curvature)
        step = np.where(accepted, fronts.step, 0.5 * fronts.step)
        stalled = ~accepted & (step < MIN_STEP)
        following = _find_following(equations, fronts.points, ahead, step, starts)

        # why each piece ends; "" if the piece goes on. The first true condition decides.
        conditions = [stalled, ~accepted, following >= 0, ~inside(ahead.q)]
        ends = np.select(conditions, ["stalled", "", "met", "left"], "")
        for k in np.flatnonzero(accepted | stalled):
            piece = int(fronts.piece[k])
            if ends[k] == "met":
                traced[piece].append(first_points.single(int(following[k])))
            elif accepted[k]:
                traced[piece].append(ahead.single(k))
                if not ends[k] and len(traced[piece]) == MAX_POINTS:
                    ends[k] = "long"
            if ends[k]:
                pieces[piece] = _Piece(join(traced[piece]), str(ends[k]), int(following[k]))
        fronts = select(fronts.move_to(ahead, accepted, step, longest), ends == "")
    return pieces


def _find_following(
    equations: LocusEquations, points: Points, ahead: Points, step: Array, starts: Points
) -> IntArray:
    """Find the numbers (F,) of the pieces that continue from starts passed in the last steps, else -1.

    A step from `points` to the points `ahead` passes a start if the start lies between the planes normal to
    the tangents at both ends of the step, is close to the chord of the step, and has a similar tangent.
    Pieces are numbered as in `_trace_pieces`.

    Args:
        points, ahead: F points at the beginning and at the end of the steps.
        step: (F,) lengths of the steps [rad, robot lengths].
        starts: the S starts of all pieces.
    """
    from_front = equations.offsets(points.q[:, None], starts.q)  # (F, S, k) from fronts to starts
    from_end = equations.offsets(ahead.q[:, None], starts.q)  # from the ends of the steps to starts
    chord = from_front - from_end  # of the step, measured modulo turns about each start

    # all (F, S): distances of each start along the tangent, ahead of the front and of the step's end
    distance = np.matvec(from_front, points.tangent)
    remaining = np.matvec(from_end, ahead.tangent)
    length = np.linalg.norm(chord, axis=2)
    chord_distance = np.linalg.norm(chord_offsets(from_front, chord), axis=2)
    cosine = ahead.tangent @ starts.tangent.T
    passes = (distance > MIN_START_DISTANCE) & (remaining <= 0)
    passes &= length < 2 * step[:, None]  # a longer chord is a jump of a hinge by a whole turn
    passes &= chord_distance < MAX_CURVE_OFFSET * length + MIN_START_DISTANCE
    passes &= np.abs(cosine) > MIN_CURVE_COSINE

    first = np.argmin(np.where(passes, distance, np.inf), axis=1)  # (F,) the nearest start ahead
    is_against = cosine[np.arange(len(first)), first] <= 0  # the curve runs against the start's tangent
    return np.where(passes.any(axis=1), first + len(starts.q) * is_against, -1)


def chord_offsets(offset: Array, chord: Array) -> Array:
    """Compute offsets (..., k) of points from the nearest points of their chords.

    Args:
        offset: vectors (..., k) from the starts of the chords to the points.
        chord: vectors (..., k) from the starts to the ends of the chords.
    """
    square = np.maximum(np.sum(chord**2, axis=-1), np.finfo(float).tiny)  # chords may have length zero
    share = np.clip(np.sum(offset * chord, axis=-1) / square, 0.0, 1.0)
    return offset - share[..., None] * chord


def _chain_pieces(pieces: dict[int, _Piece], first: int, done: set[int]) -> tuple[list[Points], str]:
    """Collect the points of the piece numbered `first` and of all following pieces.

    The starts of all these pieces are added to `done`.

    Returns:
        The points of each piece; why the last piece ends, as in `Curve.ends`.
    """
    count = len(pieces) // 2
    piece = pieces[first]
    parts = [piece.points]
    done.add(first % count)
    while piece.end == "met":
        start = piece.following % count
        if start == first % count:
            return parts, "closed"
        if start in done:  # two starts are so close to each other that pieces disagree on their order
            return parts, "long"
        done.add(start)
        piece = pieces[piece.following]
        parts.append(select(piece.points, slice(1, None)))  # the previous part ends with the start
    return parts, piece.end


def advance(
    equations: LocusEquations, points: Points, step: Array, curvature: Array
) -> tuple[Points, BoolArray]:
    """Compute the points a step (S,) ahead of S points, and whether each step is accepted (S,).

    The predictor is quadratic, with the derivatives `curvature` (S, k) of the tangents by arc length.
    Newton's method corrects all points together. A step is rejected if its system is singular, its
    corrections are long compared with the step, or its tangent turns too far. The point of a rejected step
    does not move.
    """
    predicted = step[:, None] * points.tangent + 0.5 * step[:, None] ** 2 * curvature
    q = equations.move(points.q, predicted)
    q, converged = _correct(equations, points, q, MAX_CORRECTION_RATIO * step)
    rows = np.flatnonzero(converged)
    start = select(points, rows)
    corrected = curve_points(q[rows], equations.evaluate(q[rows], start.border), start)
    turn = np.linalg.norm(corrected.tangent - start.tangent, axis=1)
    is_smooth = turn < MAX_TANGENT_TURN
    accepted = np.zeros(len(q), dtype=bool)
    accepted[rows] = is_smooth
    return _replace_rows(points, rows[is_smooth], select(corrected, is_smooth)), accepted


def _correct(
    equations: LocusEquations, points: Points, predicted: Array, farthest: Array
) -> tuple[Array, BoolArray]:
    """Correct predicted configurations (S, nq) by Newton's method, normal to the tangents of S points.

    Args:
        farthest: (S,) bounds on the sum of all Newton steps [rad, robot lengths].

    Returns:
        The configurations (S, nq) after the last step; which of them converged, (S,).
    """
    q = predicted.copy()
    correction = np.zeros(len(q))  # [rad, robot lengths] by all Newton steps so far
    converged = np.zeros(len(q), dtype=bool)
    live = np.arange(len(q))  # indices of the points that have neither converged nor been rejected
    for _ in range(MAX_CORRECTIONS):
        evaluated = equations.evaluate(q[live], select(points.border, live))
        change, is_regular = _newton_correction(evaluated, points.tangent[live])
        q[live] = equations.move(q[live], change)
        size = np.abs(change).max(axis=1)
        correction[live] += size
        is_regular &= correction[live] < farthest[live]
        converged[live] = is_regular & (size < NEWTON_STEP)
        live = live[is_regular & ~converged[live]]
        if not len(live):
            break
    return q, converged


def _replace_rows(points: Points, rows: IntArray, new: Points) -> Points:
    """Return a copy of S points in which rows (R,) are replaced by R `new` points."""
    index = np.arange(len(points.q))  # of each row, in the stack of old and new points
    index[rows] = len(index) + np.arange(len(rows))
    return select(join([points, new]), index)


def _newton_correction(evaluated: Evaluated, tangent: Array) -> tuple[Array, BoolArray]:
    """Compute Newton steps (S, k) normal to tangents (S, k), and which systems are regular (S,).

    The step of a singular system is zero.
    """
    values = np.concatenate([evaluated.values, np.zeros((len(tangent), 1))], axis=1)
    change = -solve(_append_tangent(evaluated.slopes, tangent), values)
    regular = np.asarray(np.isfinite(change).all(axis=1))
    return np.where(regular[:, None], change, 0.0), regular


def _append_tangent(slopes: Array, tangent: Array) -> Array:
    """Return the square matrices [dF/du ; t'] (S, k, k) of slopes (S, k - 1, k)."""
    return np.concatenate([slopes, tangent[:, None]], axis=1)


def _turn_along(vectors: Array, directions: Array) -> Array:
    """Negate vectors (S, k) that point against directions (S, k)."""
    return np.where(np.sum(vectors * directions, axis=1, keepdims=True) < 0, -vectors, vectors)


def curve_points(q: Array, evaluated: Evaluated, previous: Points | None) -> Points:
    """Return the points of curves at q (S, nq).

    Args:
        evaluated: the equations at q.
        previous: points whose tangents and escaping motions decide the signs of the new ones; None if the
            signs are arbitrary.
    """
    slopes = evaluated.slopes
    tangent = np.linalg.svd(slopes).Vh[:, -1]  # (S, k) the null vectors
    motion = evaluated.eta / np.linalg.norm(evaluated.eta, axis=1, keepdims=True)
    if previous is not None:
        tangent = _turn_along(tangent, previous.tangent)
        motion = _turn_along(motion, previous.eta)
    return Points(
        q=q,
        tangent=tangent,
        determinant=np.linalg.det(_append_tangent(slopes, tangent)),
        escape_slope=np.sum(evaluated.passive_g_slopes * motion, axis=1),
        eta=motion,
        border=Border.of(evaluated.P),
    )
