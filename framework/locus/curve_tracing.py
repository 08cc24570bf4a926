"""Curves of F(u) = 0, one equation less than unknowns, by pseudo-arclength continuation, many at once.

Predictor along the tangent and its bend, corrector by Newton's method in the plane normal to the tangent
(H. B. Keller 1977), the step shortened where the corrector moves far or the tangent turns much. All curves
are traced in step from all their known points, both ways, until they meet the next one, leave a region or
cannot be followed; the pieces are then put together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray, IntArray
from framework.locus.locus_equations import Borders, Evaluated, LocusEquations
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
    border: Borders  # of P there

    def take(self, which: IntArray | BoolArray | slice) -> Points:
        """Return some of the points, (s,) of them."""
        q, tangent, orientation, cusp, eta, border = self
        return Points(
            q[which],
            tangent[which],
            orientation[which],
            cusp[which],
            eta[which],
            Borders(border.b[which], border.c[which]),
        )

    def turned(self) -> Points:
        """Return the same points of curves that are followed the other way."""
        return self._replace(tangent=-self.tangent, orientation=-self.orientation)

    @staticmethod
    def joined(parts: list[Points]) -> Points:
        """Return points one after the other."""
        return Points(
            q=np.concatenate([part.q for part in parts]),
            tangent=np.concatenate([part.tangent for part in parts]),
            orientation=np.concatenate([part.orientation for part in parts]),
            cusp=np.concatenate([part.cusp for part in parts]),
            eta=np.concatenate([part.eta for part in parts]),
            border=Borders(
                np.concatenate([part.border.b for part in parts]),
                np.concatenate([part.border.c for part in parts]),
            ),
        )

    def single(self, k: int) -> Points:
        """Return the k-th of the points, S = 1."""
        return self.take(np.array([k]))


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve as it was traced."""

    points: Points  # in order; a closed curve ends with its first
    ends: tuple[str, str]  # closed, left (the region), stalled (where the equations lose rank) or long


def solutions_near(equations: LocusEquations, q: Array) -> Array:
    """Search solutions (s, nq), maybe none, by Newton's method with least, bounded steps from q (S, nq)."""
    size = np.full(len(q), np.inf)
    for _ in range(MAX_SEARCH_STEPS):
        linearised = equations.at(q)
        change = -(np.linalg.pinv(linearised.slopes, rcond=RANK_ROUNDING) @ linearised.values[:, :, None])[
            :, :, 0
        ]
        size = np.abs(change).max(axis=1)
        sound = np.isfinite(size)
        q, change, size = q[sound], change[sound], size[sound]
        q = equations.moved(q, change / np.maximum(size / MAX_SEARCH_STEP, 1.0)[:, None])
        if not len(q) or size.max() < NEWTON_STEP:
            break
    return q[size < NEWTON_STEP]


def points_at(equations: LocusEquations, q: Array) -> Points:
    """Return the points of curves at solutions q (S, nq)."""
    return _points(equations, q, equations.at(q), None, None)


def whole_curves(
    equations: LocusEquations,
    starts: Points,
    inside: Callable[[Array], BoolArray],
    longest: float = MAX_STEP,
) -> list[Curve]:
    """Trace the distinct curves through starts (S of them).

    Args:
        inside: which configurations (T, nq) are in the region; the first point outside is kept.
        longest: step [rad, lengths].
    """
    starts = starts.take(_distinct(equations, starts.q))
    pieces = _pieces(equations, starts, inside, min(longest, MAX_STEP))
    curves, done = list[Curve](), set[int]()
    for first in range(len(starts.q)):
        if first in done:
            continue
        ahead, end = _chained(pieces, first, 0, done)
        if end == "closed":
            curves.append(Curve(Points.joined(ahead), (end, end)))
            continue
        back, begin = _chained(pieces, first, 1, done)
        before = Points.joined(back).take(slice(None, 0, -1)).turned()
        curves.append(Curve(Points.joined([before, *ahead]), (begin, end)))
    return curves


class _Piece(NamedTuple):
    """A curve from a start, one way, to where it ends."""

    points: Points  # the start itself is the first
    end: str  # met (another start, which is the last point), or see `Curve`
    start: int  # that was met
    side: int  # the side of it that leads on: 0 along its tangent, 1 against it


class _Fronts(NamedTuple):
    """The last points of F pieces that are being traced."""

    points: Points
    bend: Array  # (F, k) rates of the tangents
    step: Array  # (F,) [rad, lengths] to be tried next
    piece: IntArray  # (F,) the start's number, plus their count against its tangent

    def take(self, which: BoolArray) -> _Fronts:
        """Return some of them."""
        return _Fronts(self.points.take(which), self.bend[which], self.step[which], self.piece[which])

    def moved(self, ahead: Points, good: BoolArray, step: Array, longest: float) -> _Fronts:
        """Return the fronts after steps (F,), at the points ahead where these are good."""
        count = len(step)
        turning = (ahead.tangent - self.points.tangent) / step[:, None]
        turn = np.linalg.norm(turning, axis=1) * step
        growth = np.clip(TURN_SHARE * MAX_TANGENT_TURN / np.maximum(turn, MIN_STEP), MIN_GROWTH, MAX_GROWTH)
        return _Fronts(
            points=Points.joined([ahead, self.points]).take(np.where(good, 0, count) + np.arange(count)),
            bend=np.where(good[:, None], turning, self.bend),
            step=np.where(good, np.minimum(step * growth, longest), step),
            piece=self.piece,
        )


def _pieces(
    equations: LocusEquations, starts: Points, inside: Callable[[Array], BoolArray], longest: float
) -> dict[tuple[int, int], _Piece]:
    """Trace pieces from every start (S of them) along its tangent (side 0) and against it (side 1)."""
    count = len(starts.q)
    first = Points.joined([starts, starts.turned()])
    step = np.full(2 * count, min(FIRST_STEP, longest))
    fronts = _Fronts(first, np.zeros_like(first.tangent), step, np.arange(2 * count))
    traced = [[first.single(k)] for k in range(2 * count)]
    pieces: dict[tuple[int, int], _Piece] = {}
    while len(fronts.piece):
        ahead, good = advanced(equations, fronts.points, fronts.step, fronts.bend)
        step = np.where(good, fronts.step, 0.5 * fronts.step)
        stalled = ~good & (step < MIN_STEP)
        meets, side = _met(equations, fronts.points, ahead, step, starts)
        left = ~inside(ahead.q)
        ended = np.zeros(len(step), dtype=bool)
        for k in np.flatnonzero(good | stalled).tolist():
            piece, end, start = int(fronts.piece[k]), "", -1
            if stalled[k]:
                end = "stalled"
            elif meets[k] >= 0:
                end, start = "met", int(meets[k])
                reached = starts.single(start)
                traced[piece].append(reached if side[k] == 0 else reached.turned())
            else:
                traced[piece].append(ahead.single(k))
                if left[k]:
                    end = "left"
                elif len(traced[piece]) == MAX_POINTS:
                    end = "long"
            ended[k] = bool(end)
            if end:
                points = Points.joined(traced[piece])
                pieces[piece % count, piece // count] = _Piece(points, end, start, int(side[k]))
        fronts = fronts.moved(ahead, good, step, longest).take(~ended)
    return pieces


def _met(
    equations: LocusEquations, points: Points, ahead: Points, step: Array, starts: Points
) -> tuple[IntArray, IntArray]:
    """Find the start (F,) that each front passes in a step, or -1, and the side of it (F,) that leads on."""
    before = equations.apart(points.q[:, None], starts.q[None])  # (F, S, k)
    behind = equations.apart(ahead.q[:, None], starts.q[None])
    chord = before - behind
    square = np.maximum(np.sum(chord**2, axis=2), np.finfo(float).tiny)
    length = np.sqrt(square)
    along_before = np.einsum("fsk,fk->fs", before, points.tangent)
    along_behind = np.einsum("fsk,fk->fs", behind, ahead.tangent)
    share = np.clip(np.sum(before * chord, axis=2) / square, 0.0, 1.0)
    aside = np.linalg.norm(before - share[:, :, None] * chord, axis=2)
    cosine = ahead.tangent @ starts.tangent.T  # (F, S)
    passed = (along_before > MIN_START_DISTANCE) & (along_behind <= 0) & (length < 2 * step[:, None])
    passed &= (aside < MAX_CURVE_OFFSET * length + MIN_START_DISTANCE) & (np.abs(cosine) > MIN_CURVE_COSINE)
    first = np.argmin(np.where(passed, along_before, np.inf), axis=1)
    each = np.arange(len(first))
    return np.where(passed.any(axis=1), first, -1), np.where(cosine[each, first] > 0, 0, 1)


def _chained(
    pieces: dict[tuple[int, int], _Piece], first: int, side: int, done: set[int]
) -> tuple[list[Points], str]:
    """Collect the pieces from one start on, one way, and how they end; `closed` if at the start itself."""
    done.add(first)
    parts, start = list[Points](), first
    while True:
        piece = pieces[start, side]
        parts.append(piece.points if not parts else piece.points.take(slice(1, None)))
        if piece.end != "met":
            return parts, piece.end
        start, side = piece.start, piece.side
        if start == first:
            return parts, "closed"
        if start in done:  # starts so near to one another that their pieces disagree
            return parts, "long"
        done.add(start)


def _distinct(equations: LocusEquations, q: Array) -> IntArray:
    """Return indices of configurations (S, nq) that are not one of those before them."""
    apart = np.linalg.norm(equations.apart(q[:, None], q[None]), axis=2)
    return np.flatnonzero(~(np.tril(apart < MIN_START_DISTANCE, -1)).any(axis=1))


def advanced(equations: LocusEquations, points: Points, step: Array, bend: Array) -> tuple[Points, BoolArray]:
    """Compute the points a step (S,) on, predicted with the tangents' rates `bend` (S, k), and which count.

    Those that do not count are the points themselves: their step is too long.
    """
    q = equations.moved(points.q, step[:, None] * points.tangent + 0.5 * step[:, None] ** 2 * bend)
    good, live, moved = np.zeros(len(q), dtype=bool), np.arange(len(q)), np.zeros(len(q))
    ahead = points
    for _ in range(MAX_CORRECTIONS):
        border = Borders(points.border.b[live], points.border.c[live])
        linearised = equations.at(q[live], border)
        square = np.concatenate([linearised.slopes, points.tangent[live][:, None]], axis=1)
        values = np.concatenate([linearised.values, np.zeros((len(live), 1))], axis=1)
        sound = np.linalg.slogdet(square)[0] != 0
        square[~sound] = np.eye(square.shape[1])
        change = -np.linalg.solve(square, values[:, :, None])[:, :, 0]
        largest = np.abs(change).max(axis=1)
        moved[live] += largest
        q[live] = equations.moved(q[live], change)
        sound &= moved[live] < MAX_CORRECTION_RATIO * step[live]
        ready = sound & (largest < NEWTON_STEP)
        if ready.any():
            accepted = live[ready]
            near = Evaluated(*(part[ready] for part in linearised))
            corrected = _points(equations, q[accepted], near, points.tangent[accepted], points.eta[accepted])
            turn = np.linalg.norm(corrected.tangent - points.tangent[accepted], axis=1)
            good[accepted] = turn < MAX_TANGENT_TURN
            place = np.arange(len(q))
            place[accepted] = len(q) + np.arange(len(accepted))
            ahead = Points.joined([ahead, corrected]).take(place)
        live = live[sound & ~ready]
        if not len(live):
            break
    return ahead, good


def _points(
    equations: LocusEquations, q: Array, near: Evaluated, towards: Array | None, eta: Array | None
) -> Points:
    """Return points q (S, nq), the equations at them or within `NEWTON_STEP`; the last two give signs."""
    tangent = np.linalg.svd(near.slopes)[2][:, -1]
    if towards is not None:
        tangent = np.where(np.sum(tangent * towards, axis=1, keepdims=True) < 0, -tangent, tangent)
    motion = near.eta / np.linalg.norm(near.eta, axis=1, keepdims=True)
    if eta is not None:
        motion = np.where(np.sum(motion * eta, axis=1, keepdims=True) < 0, -motion, motion)
    square = np.concatenate([near.slopes, tangent[:, None]], axis=1)
    return Points(
        q=q,
        tangent=tangent,
        orientation=np.linalg.det(square),
        cusp=np.sum(near.slopes[:, -1, -motion.shape[1] :] * motion, axis=1),
        eta=motion,
        border=equations.border(near.P),
    )
