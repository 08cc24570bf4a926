"""Pseudo-arclength continuation of curves F(u) = 0, one equation less than unknowns, many curves at once.

The predictor follows the tangent and its bend; the corrector is Newton's method in the plane normal to the
tangent (H. B. Keller 1977). The step is shortened if the corrector moves far or the tangent turns much. All
pieces of curves are traced together, in both directions from every start, until they meet the next start,
leave a region or cannot be continued. Then the pieces are joined to curves.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from framework.numerics.arrays import Array, BoolArray, IntArray, join, select
from framework.numerics.ordered_sums import solve
from framework.singularity.bordered_system import Border
from framework.singularity.locus_equations import Evaluated, LocusEquations
from framework.tolerances import NEWTON_STEP, RANK_ROUNDING

MAX_CURVE_OFFSET = 0.05  # of a point of a curve from a chord, over its length; the curve itself has 0.02
MIN_CURVE_COSINE = 0.7  # between tangents of one curve; different curves usually cross at larger angles
MAX_STEP, MIN_STEP, FIRST_STEP = 0.2, 1e-7, 0.03  # [rad, lengths]
MAX_TANGENT_TURN = 0.15  # [rad] in a step: 40 points per full turn, chords 3e-3 of the radius off the curve
TURN_SHARE = 0.8  # of the largest turn, at which the next step aims
MIN_GROWTH, MAX_GROWTH = 0.5, 2.0  # of a step over the one before
MAX_CORRECTIONS = 6  # Newton steps
MAX_CORRECTION_RATIO = 0.25  # of all corrections to the step
MAX_POINTS = 3000  # of a piece
MAX_SEARCH_STEPS = 25  # Newton steps from a random configuration
MAX_SEARCH_STEP = 0.5  # [rad, lengths] largest joint motion in one of these
MIN_START_DISTANCE = 1e-5  # [rad, lengths]; of closer starts, which are on one curve, only the first is used


class Points(NamedTuple):
    """S points of curves."""

    q: Array  # (S, nq)
    tangent: Array  # (S, k) unit vector in the direction of tracing
    orientation: Array  # (S,) det [dF/du ; t']; its sign changes at branch points
    cusp: Array  # (S,) slope of g along the escaping motion, without dimension
    eta: Array  # (S, m) the escaping motion, of unit size, with the sign that makes `cusp` continuous
    border: Border  # (S, m, 1) of P

    def reverse(self) -> Points:
        """Return the points in the same order, with the direction of tracing reversed."""
        return self._replace(tangent=-self.tangent, orientation=-self.orientation)

    def backwards(self) -> Points:
        """Return the points of one curve in reverse order, traced the other way."""
        return select(self.reverse(), slice(None, None, -1))

    def single(self, k: int) -> Points:
        """Return the k-th of the points, S = 1."""
        return select(self, np.array([k]))


class Curve(NamedTuple):
    """A traced curve."""

    points: Points  # in order; a closed curve ends with its first
    ends: tuple[str, str]  # closed, left (the region), stalled (the equations lose rank) or long (MAX_POINTS)


def find_solutions(equations: LocusEquations, q: Array) -> Array:
    """Find solutions (s, nq), possibly none, by bounded least-norm Newton steps from q (S, nq)."""
    for _ in range(MAX_SEARCH_STEPS):
        evaluated = equations.evaluate(q)
        inverse = np.linalg.pinv(evaluated.slopes, rcond=RANK_ROUNDING)
        change = -np.matvec(inverse, evaluated.values)
        size = np.abs(change).max(axis=1)
        is_finite = np.isfinite(size)
        size = size[is_finite]
        step = change[is_finite] / np.maximum(size / MAX_SEARCH_STEP, 1.0)[:, None]
        q = equations.move(q[is_finite], step)
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
        inside: computes which configurations (T, nq) are in the region; a curve includes its first point
            outside.
        longest: largest step [rad, lengths].
    """
    distance = np.linalg.norm(equations.offsets(starts.q[:, None], starts.q), axis=2)
    starts = select(starts, ~np.tril(distance < MIN_START_DISTANCE, -1).any(axis=1))
    pieces = _trace_pieces(equations, starts, inside, min(longest, MAX_STEP))
    curves = list[Curve]()
    done = set[int]()  # starts on these curves
    for first in range(len(starts.q)):
        if first in done:
            continue
        along, end = _chain_pieces(pieces, first, done)
        if end == "closed":
            curves.append(Curve(join(along), (end, end)))
            continue
        against, begin = _chain_pieces(pieces, first + len(starts.q), done)
        head = select(join(against).backwards(), slice(-1))  # without the start
        curves.append(Curve(join([head, *along]), (begin, end)))
    return curves


class _Piece(NamedTuple):
    """A part of a curve from a start, in one direction, to its end."""

    points: Points  # from the start on
    end: str  # met (another start, which is the last point), or an end of `Curve`
    following: int  # number of the piece that continues from the start that was met


class _Fronts(NamedTuple):
    """The last points of the F pieces that are being traced."""

    points: Points
    bend: Array  # (F, k) derivatives of the tangents along the curves
    step: Array  # (F,) [rad, lengths] to be tried next
    piece: IntArray  # (F,) number of the piece, see `_trace_pieces`

    def advance(self, ahead: Points, accepted: BoolArray, step: Array, longest: float) -> _Fronts:
        """Return the fronts after steps (F,), at the points ahead.

        After an accepted step the next one aims at a share of the largest turn of the tangent.
        """
        bend = (ahead.tangent - self.points.tangent) / step[:, None]
        turn = np.linalg.norm(bend, axis=1) * step  # [rad] in this step
        growth = np.clip(TURN_SHARE * MAX_TANGENT_TURN / np.maximum(turn, MIN_STEP), MIN_GROWTH, MAX_GROWTH)
        return _Fronts(
            points=ahead,
            bend=np.where(accepted[:, None], bend, self.bend),
            step=np.where(accepted, np.minimum(step * growth, longest), step),
            piece=self.piece,
        )


def _trace_pieces(
    equations: LocusEquations, starts: Points, inside: Callable[[Array], BoolArray], longest: float
) -> dict[int, _Piece]:
    """Trace two pieces from each of S starts, one in each direction.

    Piece k goes along the tangent of start k, piece S + k against it. All pieces take their steps together;
    ended pieces leave the `fronts`.
    """
    starts_both_ways = join([starts, starts.reverse()])
    step = np.full(len(starts_both_ways.q), min(FIRST_STEP, longest))
    fronts = _Fronts(starts_both_ways, np.zeros_like(starts_both_ways.tangent), step, np.arange(len(step)))
    traced = [[starts_both_ways.single(k)] for k in range(len(step))]  # the points of each piece so far
    pieces: dict[int, _Piece] = {}
    while len(fronts.piece):
        ahead, accepted = advance(equations, fronts.points, fronts.step, fronts.bend)
        step = np.where(accepted, fronts.step, 0.5 * fronts.step)
        stalled = ~accepted & (step < MIN_STEP)
        following = _find_following(equations, fronts.points, ahead, step, starts)
        conditions = [stalled, ~accepted, following >= 0, ~inside(ahead.q)]  # the first true one decides
        ends = np.select(conditions, ["stalled", "", "met", "left"], "")  # "": the piece goes on
        for k in np.flatnonzero(accepted | stalled).tolist():
            piece = int(fronts.piece[k])
            if ends[k] == "met":
                traced[piece].append(starts_both_ways.single(int(following[k])))
            elif accepted[k]:
                traced[piece].append(ahead.single(k))
                if not ends[k] and len(traced[piece]) == MAX_POINTS:
                    ends[k] = "long"
            if ends[k]:
                pieces[piece] = _Piece(join(traced[piece]), str(ends[k]), int(following[k]))
        fronts = select(fronts.advance(ahead, accepted, step, longest), ends == "")
    return pieces


def _find_following(
    equations: LocusEquations, points: Points, ahead: Points, step: Array, starts: Points
) -> IntArray:
    """Find the piece (F,) that continues from the start passed in each front's step, or -1.

    A start is passed if it lies between the planes normal to the tangents at both ends of the step, is close
    to the chord of the step, and has a similar tangent.
    """
    from_front = equations.offsets(points.q[:, None], starts.q)  # (F, S, k) from fronts to starts
    from_end = equations.offsets(ahead.q[:, None], starts.q)  # from the ends of the steps to starts
    chord = from_front - from_end  # of the step, measured modulo turns about each start
    length = np.linalg.norm(chord, axis=2)  # (F, S)
    distance = np.matvec(from_front, points.tangent)  # (F, S) of the start ahead of the front
    remaining = np.matvec(from_end, ahead.tangent)  # (F, S) of the start ahead of the step's end
    chord_distance = np.linalg.norm(chord_offsets(from_front, chord), axis=2)
    cosine = ahead.tangent @ starts.tangent.T  # (F, S)
    passes = (distance > MIN_START_DISTANCE) & (remaining <= 0) & (length < 2 * step[:, None])
    passes &= chord_distance < MAX_CURVE_OFFSET * length + MIN_START_DISTANCE
    passes &= np.abs(cosine) > MIN_CURVE_COSINE
    first = np.argmin(np.where(passes, distance, np.inf), axis=1)  # (F,) the nearest start ahead
    is_against = cosine[np.arange(len(first)), first] <= 0
    return np.where(passes.any(axis=1), first + len(starts.q) * is_against, -1)


def chord_offsets(offset: Array, chord: Array) -> Array:
    """Compute offsets (..., k) of points from the nearest points of their chords.

    `offset` of the points and `chord` are from the starts of the chords.
    """
    square = np.maximum(np.sum(chord**2, axis=-1), np.finfo(float).tiny)
    share = np.clip(np.sum(offset * chord, axis=-1) / square, 0.0, 1.0)
    return offset - share[..., None] * chord


def _chain_pieces(pieces: dict[int, _Piece], first: int, done: set[int]) -> tuple[list[Points], str]:
    """Collect the points of a piece and all following pieces, and the last end.

    Pieces are numbered as in `_trace_pieces`. Starts on the way are added to `done`.
    """
    count = len(pieces) // 2
    piece = pieces[first]
    parts = [piece.points]
    done.add(first % count)
    while piece.end == "met":
        start = piece.following % count
        if start == first % count:
            return parts, "closed"
        if start in done:  # starts so close to one another that their pieces disagree
            return parts, "long"
        done.add(start)
        piece = pieces[piece.following]
        parts.append(select(piece.points, slice(1, None)))  # the start is there already
    return parts, piece.end


def advance(equations: LocusEquations, points: Points, step: Array, bend: Array) -> tuple[Points, BoolArray]:
    """Compute the points a step (S,) ahead, and whether each step is accepted (S,).

    The predictor is quadratic with the derivatives `bend` (S, k) of the tangents; Newton's method corrects
    it. All points are corrected together. A step is rejected if its system is singular, its corrections are
    long against the step, or its tangent turns too far; its point stays.
    """
    q = equations.move(points.q, step[:, None] * points.tangent + 0.5 * step[:, None] ** 2 * bend)
    ahead = points
    accepted = np.zeros(len(q), dtype=bool)
    correction = np.zeros(len(q))  # [rad, lengths] by all Newton steps so far
    live = np.arange(len(q))  # points that are neither ready nor rejected
    for _ in range(MAX_CORRECTIONS):
        start = select(points, live)
        evaluated = equations.evaluate(q[live], start.border)
        change, is_regular = _newton_correction(evaluated, start.tangent)
        size = np.abs(change).max(axis=1)
        correction[live] += size
        q[live] = equations.move(q[live], change)
        is_regular &= correction[live] < MAX_CORRECTION_RATIO * step[live]
        ready = is_regular & (size < NEWTON_STEP)
        if ready.any():
            corrected = curve_points(q[live[ready]], select(evaluated, ready), select(start, ready))
            turns = np.linalg.norm(corrected.tangent - start.tangent[ready], axis=1)
            is_smooth = turns < MAX_TANGENT_TURN
            accepted[live[ready]] = is_smooth
            ahead = _replace_rows(ahead, live[ready][is_smooth], select(corrected, is_smooth))
        live = live[is_regular & ~ready]
        if not len(live):
            break
    return ahead, accepted


def _replace_rows(points: Points, rows: IntArray, new: Points) -> Points:
    """Return a copy of the points with `new` ones in some rows."""
    index = np.arange(len(points.q))  # into the points and the new ones
    index[rows] = len(index) + np.arange(len(rows))
    return select(join([points, new]), index)


def _newton_correction(evaluated: Evaluated, tangent: Array) -> tuple[Array, BoolArray]:
    """Compute Newton's step (S, k) normal to tangents (S, k), and whether the system is regular (S,)."""
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
    """Return the points of curves at q (S, nq), with the equations evaluated at q or almost.

    Tangents and escaping motions have the signs of those at the previous points.
    """
    slopes = evaluated.slopes
    tangent = np.linalg.svd(slopes)[2][:, -1]  # (S, k) the null vector
    motion = evaluated.eta / np.linalg.norm(evaluated.eta, axis=1, keepdims=True)
    if previous is not None:
        tangent = _turn_along(tangent, previous.tangent)
        motion = _turn_along(motion, previous.eta)
    dg = slopes[:, -1, -motion.shape[1] :]  # (S, m) along the passive joints
    return Points(
        q=q,
        tangent=tangent,
        orientation=np.linalg.det(_append_tangent(slopes, tangent)),
        cusp=np.sum(dg * motion, axis=1),
        eta=motion,
        border=Border.of(evaluated.P),
    )
