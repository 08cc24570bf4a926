"""Curves of F(u) = 0, one equation less than unknowns, by pseudo-arclength continuation, many at once.

Predictor along the tangent and its bend, corrector by Newton's method in the plane normal to the tangent
(H. B. Keller 1977), the step shortened where the corrector moves far or the tangent turns much. All curves
are traced in step from all their known points, both ways, until they meet the next one, leave a region or
cannot be followed; the pieces are then put together.
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

MAX_CURVE_OFFSET = 0.05  # of a chord, from it to a point on the curve; chords leave the curve by 0.02
MIN_CURVE_COSINE = 0.7  # of tangents there; curves cross at larger angles as a rule
MAX_STEP, MIN_STEP, FIRST_STEP = 0.2, 1e-7, 0.03  # [rad, lengths]
MAX_TANGENT_TURN = 0.15  # [rad] in a step: 40 points a full turn, chords 3e-3 of the radius off
TURN_SHARE = 0.8  # of that turn at which the next step aims
MIN_GROWTH, MAX_GROWTH = 0.5, 2.0  # of the step, from one to the next
MAX_CORRECTIONS = 6  # Newton steps
MAX_CORRECTION_RATIO = 0.25  # of a step: what the corrector may move
MAX_POINTS = 3000  # of a piece
MAX_SEARCH_STEPS = 25  # Newton steps from a start drawn at random
MAX_SEARCH_STEP = 0.5  # [rad, lengths] that one of them may move a joint
MIN_START_DISTANCE = 1e-5  # [rad, lengths]: of nearer starts, all on one curve, the first is followed


class Points(NamedTuple):
    """S points of curves."""

    q: Array  # (S, nq)
    tangent: Array  # (S, k) unit, the way that the curve is followed
    orientation: Array  # (S,) det [dF/du ; t']: its sign changes at branch points
    cusp: Array  # (S,) slope of g along the motion that locked motors do not hold, without dimension
    eta: Array  # (S, m) that motion, of unit size, turned so that `cusp` is continuous
    border: Border  # (S, m, 1) of P

    def reverse(self) -> Points:
        """Return the same points of curves that are followed the other way.

        Their order stays.
        """
        return self._replace(tangent=-self.tangent, orientation=-self.orientation)

    def backwards(self) -> Points:
        """Return the points of one curve in reverse order, followed the other way."""
        return select(self.reverse(), slice(None, None, -1))

    def single(self, k: int) -> Points:
        """Return the k-th of the points, S = 1."""
        return select(self, np.array([k]))


class Curve(NamedTuple):
    """A traced curve."""

    points: Points  # in order; a closed curve ends with its first
    ends: tuple[str, str]  # closed, left (the region), stalled (where the equations lose rank) or long


def find_solutions(equations: LocusEquations, q: Array) -> Array:
    """Find solutions (s, nq), maybe none, by least-norm Newton steps of bounded size from q (S, nq)."""
    size = np.full(len(q), np.inf)
    for _ in range(MAX_SEARCH_STEPS):
        evaluated = equations.evaluate(q)
        inverse = np.linalg.pinv(evaluated.slopes, rcond=RANK_ROUNDING)
        change = -np.matvec(inverse, evaluated.values)
        size = np.abs(change).max(axis=1)
        is_finite = np.isfinite(size)
        q, change, size = q[is_finite], change[is_finite], size[is_finite]
        q = equations.move(q, change / np.maximum(size / MAX_SEARCH_STEP, 1.0)[:, None])
        if not len(q) or size.max() < NEWTON_STEP:
            break
    return q[size < NEWTON_STEP]


def curve_points_at(equations: LocusEquations, q: Array) -> Points:
    """Return the points of curves at solutions q (S, nq)."""
    return _points_of(equations, q, equations.evaluate(q), None)


def trace_curves(
    equations: LocusEquations,
    starts: Points,
    inside: Callable[[Array], BoolArray],
    longest: float = MAX_STEP,
) -> list[Curve]:
    """Trace the distinct curves through S starts.

    Args:
        inside: which configurations (T, nq) are in the region; the first point outside is kept.
        longest: step [rad, lengths].
    """
    distance = np.linalg.norm(equations.offsets(starts.q[:, None], starts.q[None]), axis=2)
    starts = select(starts, ~np.tril(distance < MIN_START_DISTANCE, -1).any(axis=1))
    pieces = _trace_pieces(equations, starts, inside, min(longest, MAX_STEP))
    curves, done = list[Curve](), set[int]()
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
    """A curve from a start, one way, to its end."""

    points: Points  # the start itself is the first
    end: str  # met (another start, which is the last point), or see `Curve`
    following: int  # number of the piece that leads on from the start that was met


class _Fronts(NamedTuple):
    """The last points of the F pieces that are being traced, all at once."""

    points: Points
    bend: Array  # (F, k) rates of the tangents
    step: Array  # (F,) [rad, lengths] to be tried next
    piece: IntArray  # (F,) the start's number, plus their count against its tangent

    def advance(self, ahead: Points, accepted: BoolArray, step: Array, longest: float) -> _Fronts:
        """Return the fronts after steps (F,), moved where accepted to the points ahead.

        The next step aims at a share of the largest turn of the tangent.
        """
        turning = (ahead.tangent - self.points.tangent) / step[:, None]
        turn = np.linalg.norm(turning, axis=1) * step  # [rad] in this step
        growth = np.clip(TURN_SHARE * MAX_TANGENT_TURN / np.maximum(turn, MIN_STEP), MIN_GROWTH, MAX_GROWTH)
        return _Fronts(
            points=_replace_rows(self.points, np.flatnonzero(accepted), select(ahead, accepted)),
            bend=np.where(accepted[:, None], turning, self.bend),
            step=np.where(accepted, np.minimum(step * growth, longest), step),
            piece=self.piece,
        )


def _trace_pieces(
    equations: LocusEquations, starts: Points, inside: Callable[[Array], BoolArray], longest: float
) -> dict[int, _Piece]:
    """Trace two pieces from each of S starts, one either way.

    Piece k goes along the tangent of start k, piece S + k against. All pieces take a step together; a piece
    that has ended is left out of the `fronts`.
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
        conditions = [stalled, ~accepted, following >= 0, ~inside(ahead.q)]  # the first that holds decides
        ends = np.select(conditions, ["stalled", "", "met", "left"], "")
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
    """Find the start that each front passes in its step.

    Returned is the piece (F,) that goes on from there, or -1. A start is passed if it lies between the planes
    normal to the tangents at both ends of the step, beside the chord of the step, with a similar tangent.
    """
    from_front = equations.offsets(points.q[:, None], starts.q[None])  # (F, S, k) from fronts to starts
    from_end = equations.offsets(ahead.q[:, None], starts.q[None])  # from the ends of the steps
    chord = from_front - from_end  # of the step, as seen from each start
    length = np.linalg.norm(chord, axis=2)  # (F, S)
    distance = np.matvec(from_front, points.tangent)  # (F, S) along the tangents
    remaining = np.matvec(from_end, ahead.tangent)
    chord_distance = np.linalg.norm(chord_offsets(from_front, chord), axis=2)
    cosine = ahead.tangent @ starts.tangent.T  # (F, S)
    passes = (distance > MIN_START_DISTANCE) & (remaining <= 0) & (length < 2 * step[:, None])
    passes &= chord_distance < MAX_CURVE_OFFSET * length + MIN_START_DISTANCE
    passes &= np.abs(cosine) > MIN_CURVE_COSINE
    first = np.argmin(np.where(passes, distance, np.inf), axis=1)  # (F,) the nearest start ahead
    is_against = np.take_along_axis(cosine, first[:, None], axis=1)[:, 0] <= 0
    return np.where(passes.any(axis=1), first + len(starts.q) * is_against, -1)


def chord_offsets(offset: Array, chord: Array) -> Array:
    """Compute offsets (..., k) of points from the nearest points of their chords.

    Points and ends of chords are offsets from the chords' starts.
    """
    square = np.maximum(np.sum(chord**2, axis=-1), np.finfo(float).tiny)
    share = np.clip(np.sum(offset * chord, axis=-1) / square, 0.0, 1.0)
    return offset - share[..., None] * chord


def _chain_pieces(pieces: dict[int, _Piece], first: int, done: set[int]) -> tuple[list[Points], str]:
    """Collect the points of a piece and its followers, and the end of the last.

    Pieces are numbered as in `_trace_pieces`; the starts that are passed are added to `done`.
    """
    count, parts, piece = len(pieces) // 2, list[Points](), pieces[first]
    done.add(first % count)
    while True:
        parts.append(piece.points if not parts else select(piece.points, slice(1, None)))
        if piece.end != "met":
            return parts, piece.end
        start, piece = piece.following % count, pieces[piece.following]
        if start == first % count:
            return parts, "closed"
        if start in done:  # starts so near to one another that their pieces disagree
            return parts, "long"
        done.add(start)


def advance(equations: LocusEquations, points: Points, step: Array, bend: Array) -> tuple[Points, BoolArray]:
    """Compute the points a step (S,) ahead, and whether each is accepted (S,).

    The predictor is quadratic, with the tangents' rates `bend` (S, k); Newton's method corrects it. Points
    are corrected together until each is `ready`, or given up: its system is singular, its corrections are
    long against the step, or its tangent turns too far. A point that is not accepted stays as it was.
    """
    length = step[:, None]
    q = equations.move(points.q, length * points.tangent + 0.5 * length**2 * bend)
    ahead, accepted = points, np.zeros(len(q), dtype=bool)
    live, correction = np.arange(len(q)), np.zeros(len(q))  # [rad, lengths] by all Newton steps so far
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
            corrected = _points_of(equations, q[live[ready]], select(evaluated, ready), select(start, ready))
            turns = np.linalg.norm(corrected.tangent - start.tangent[ready], axis=1)
            accepted[live[ready]] = turns < MAX_TANGENT_TURN
            ahead = _replace_rows(ahead, live[ready], corrected)
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
    square = np.concatenate([evaluated.slopes, tangent[:, None]], axis=1)
    values = np.concatenate([evaluated.values, np.zeros((len(tangent), 1))], axis=1)
    change = -solve(square, values)
    regular = np.asarray(np.isfinite(change).all(axis=1))
    return np.where(regular[:, None], change, 0.0), regular


def _turn_along(vectors: Array, directions: Array) -> Array:
    """Turn vectors (S, k) over where against directions (S, k)."""
    return np.where(np.sum(vectors * directions, axis=1, keepdims=True) < 0, -vectors, vectors)


def _points_of(equations: LocusEquations, q: Array, evaluated: Evaluated, previous: Points | None) -> Points:
    """Return the points of curves at q (S, nq).

    Tangents and motions are turned as at the previous points.

    Args:
        evaluated: the equations at q, or within `NEWTON_STEP` of q.
    """
    tangent = np.linalg.svd(evaluated.slopes)[2][:, -1]
    motion = evaluated.eta / np.linalg.norm(evaluated.eta, axis=1, keepdims=True)
    if previous is not None:
        tangent, motion = _turn_along(tangent, previous.tangent), _turn_along(motion, previous.eta)
    return Points(
        q=q,
        tangent=tangent,
        orientation=np.linalg.det(np.concatenate([evaluated.slopes, tangent[:, None]], axis=1)),
        cusp=np.sum(evaluated.slopes[:, -1, -motion.shape[1] :] * motion, axis=1),
        eta=motion,
        border=Border.of(evaluated.P),
    )
