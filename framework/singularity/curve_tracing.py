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
from framework.singularity.locus_equations import Border, Evaluated, LocusEquations

LONGEST, SHORTEST = 0.2, 1e-7  # steps [rad, lengths]
FIRST = 0.03
TURN = 0.15  # [rad] that the tangent may turn in a step: 40 points a full turn, chords 3e-3 of the radius off
CORRECTOR = 6  # Newton steps
# Newton's steps converge quadratically until differences limit them, a step to 1e-9 of the one before: what
# a step as small as this leaves is rounding.
LAST_STEP = 1e-7
FARTHEST = 0.25  # of a step: what the corrector may move
MOST_POINTS = 3000  # of a piece
ON_CHORD = 0.05  # of a chord: a known point of the curve is no farther from it
ALIKE = 0.7  # cosine between tangents that belong to one curve there
SEARCH = 25  # Newton steps from a start drawn at random
LONGEST_SEARCH = 0.5  # [rad, lengths] that one of them may move a joint
SAME = 1e-5  # [rad, lengths]: starts that are nearer are one


class Points(NamedTuple):
    """S points of curves."""

    q: Array  # (S, nq)
    tangent: Array  # (S, k) unit, the way that the curve is followed
    orientation: Array  # (S,) det [dF/du ; t']: its sign changes at branch points
    cusp: Array  # (S,) slope of g along the motion that locked motors do not hold, without dimension
    eta: Array  # (S, m) that motion, of unit size, turned so that `cusp` is continuous
    border: Border  # of P there

    def take(self, which: IntArray | BoolArray | slice) -> Points:
        """Some of the points, (s,) of them."""
        q, tangent, orientation, cusp, eta, border = self
        return Points(
            q[which],
            tangent[which],
            orientation[which],
            cusp[which],
            eta[which],
            Border(border.b[which], border.c[which]),
        )

    def turned(self) -> Points:
        """The same points of curves that are followed the other way."""
        return self._replace(tangent=-self.tangent, orientation=-self.orientation)

    @staticmethod
    def joined(parts: list[Points]) -> Points:
        """Points one after the other."""
        q, tangent, orientation, cusp, eta = (
            np.concatenate([part[k] for part in parts]) for k in range(len(Points._fields) - 1)
        )
        border = Border(*(np.concatenate([part.border[k] for part in parts]) for k in range(2)))
        return Points(q, tangent, orientation, cusp, eta, border)

    def one(self, k: int) -> Points:
        """The k-th of the points, S = 1."""
        return self.take(np.array([k]))


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve as it was traced."""

    points: Points  # in order; a closed curve ends with its first
    ends: tuple[str, str]  # closed, left (the region), stalled (where the equations lose rank) or long


def solutions_near(equations: LocusEquations, q: Array) -> Array:
    """Solutions (s, nq), maybe none, that Newton's method with least, bounded steps finds from q (S, nq)."""
    size = np.full(len(q), np.inf)
    for _ in range(SEARCH):
        here = equations.at(q)
        change = -(np.linalg.pinv(here.slopes, rcond=1e-9) @ here.values[:, :, None])[:, :, 0]
        size = np.abs(change).max(axis=1)
        sound = np.isfinite(size)
        q, change, size = q[sound], change[sound], size[sound]
        q = equations.moved(q, change / np.maximum(size / LONGEST_SEARCH, 1.0)[:, None])
        if not len(q) or size.max() < LAST_STEP:
            break
    return q[size < LAST_STEP]


def points_at(equations: LocusEquations, q: Array) -> Points:
    """The points of curves at solutions q (S, nq)."""
    return _points(equations, q, equations.at(q), None, None)


def whole_curves(
    equations: LocusEquations,
    starts: Points,
    inside: Callable[[Array], BoolArray],
    longest: float = LONGEST,
) -> list[Curve]:
    """The distinct curves through starts (S of them).

    Args:
        inside: which configurations (T, nq) are in the region; the first point outside is kept.
        longest: step [rad, lengths].
    """
    starts = starts.take(_distinct(equations, starts.q))
    pieces = _pieces(equations, starts, inside, min(longest, LONGEST))
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


def _pieces(
    equations: LocusEquations, starts: Points, inside: Callable[[Array], BoolArray], longest: float
) -> dict[tuple[int, int], _Piece]:
    """The pieces from every start (S of them) along its tangent (side 0) and against it (side 1), in step."""
    count = len(starts.q)
    here = Points.joined([starts, starts.turned()])
    bend = np.zeros_like(here.tangent)
    step = np.full(2 * count, min(FIRST, longest))
    live = np.arange(2 * count)
    way = [[here.one(k)] for k in range(2 * count)]
    pieces: dict[tuple[int, int], _Piece] = {}

    def ended(front: int, end: str, start: int = -1, side: int = 0) -> None:
        pieces[front % count, front // count] = _Piece(Points.joined(way[front]), end, start, side)

    while len(live):
        there, good = advanced(equations, here, step, bend)
        step = np.where(good, step, 0.5 * step)
        stalled = ~good & (step < SHORTEST)
        met, side = _met(equations, here, there, step, starts)
        left = ~inside(there.q)
        for k in np.flatnonzero(good | stalled):
            if stalled[k]:
                ended(live[k], "stalled")
            elif met[k] >= 0:
                reached = starts.one(int(met[k]))
                way[live[k]].append(reached if side[k] == 0 else reached.turned())
                ended(live[k], "met", int(met[k]), int(side[k]))
            else:
                way[live[k]].append(there.one(int(k)))
                if left[k] or len(way[live[k]]) == MOST_POINTS:
                    ended(live[k], "left" if left[k] else "long")
                    met[k] = 0
        turning = (there.tangent - here.tangent) / step[:, None]
        bend = np.where(good[:, None], turning, bend)
        turn = np.linalg.norm(turning, axis=1) * step
        grown = np.minimum(step * np.clip(0.8 * TURN / (turn + 1e-9), 0.5, 2.0), longest)
        step = np.where(good, grown, step)
        here = Points.joined([there, here]).take(np.where(good, 0, len(live)) + np.arange(len(live)))
        on = ~stalled & ~(good & (met >= 0))
        here, bend, step, live = here.take(on), bend[on], step[on], live[on]
    return pieces


def _met(
    equations: LocusEquations, here: Points, there: Points, step: Array, starts: Points
) -> tuple[IntArray, IntArray]:
    """The start (F,) that each front passes in a step, -1 for none, and the side of it (F,) that leads on."""
    before = equations.apart(here.q[:, None], starts.q[None])  # (F, S, k)
    behind = equations.apart(there.q[:, None], starts.q[None])
    chord = before - behind
    length = np.maximum(np.linalg.norm(chord, axis=2), 1e-100)
    along_before = np.einsum("fsk,fk->fs", before, here.tangent)
    along_behind = np.einsum("fsk,fk->fs", behind, there.tangent)
    share = np.clip(np.sum(before * chord, axis=2) / length**2, 0.0, 1.0)
    aside = np.linalg.norm(before - share[:, :, None] * chord, axis=2)
    cosine = there.tangent @ starts.tangent.T  # (F, S)
    passed = (along_before > SAME) & (along_behind <= 0) & (length < 2 * step[:, None])
    passed &= (aside < ON_CHORD * length + SAME) & (np.abs(cosine) > ALIKE)
    first = np.argmin(np.where(passed, along_before, np.inf), axis=1)
    each = np.arange(len(first))
    return np.where(passed.any(axis=1), first, -1), np.where(cosine[each, first] > 0, 0, 1)


def _chained(
    pieces: dict[tuple[int, int], _Piece], first: int, side: int, done: set[int]
) -> tuple[list[Points], str]:
    """The pieces from one start on, one way, and how they end; `closed` if that is the start itself."""
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
    """Indices of configurations (S, nq) that are not one of those before them."""
    apart = np.linalg.norm(equations.apart(q[:, None], q[None]), axis=2)
    return np.flatnonzero(~(np.tril(apart < SAME, -1)).any(axis=1))


def advanced(equations: LocusEquations, here: Points, step: Array, bend: Array) -> tuple[Points, BoolArray]:
    """The points a step (S,) further, predicted with the tangents' rates `bend` (S, k), and which count.

    Those that do not count are the points themselves: their step is too long.
    """
    q = equations.moved(here.q, step[:, None] * here.tangent + 0.5 * step[:, None] ** 2 * bend)
    good, live, moved = np.zeros(len(q), dtype=bool), np.arange(len(q)), np.zeros(len(q))
    found = here
    for _ in range(CORRECTOR):
        border = Border(here.border.b[live], here.border.c[live])
        now = equations.at(q[live], border)
        square = np.concatenate([now.slopes, here.tangent[live][:, None]], axis=1)
        values = np.concatenate([now.values, np.zeros((len(live), 1))], axis=1)
        sound = np.linalg.slogdet(square)[0] != 0
        square[~sound] = np.eye(square.shape[1])
        change = -np.linalg.solve(square, values[:, :, None])[:, :, 0]
        largest = np.abs(change).max(axis=1)
        moved[live] += largest
        q[live] = equations.moved(q[live], change)
        sound &= moved[live] < FARTHEST * step[live]
        ready = sound & (largest < LAST_STEP)
        if ready.any():
            which = live[ready]
            near = Evaluated(*(part[ready] for part in now))
            there = _points(equations, q[which], near, here.tangent[which], here.eta[which])
            turn = np.linalg.norm(there.tangent - here.tangent[which], axis=1)
            good[which] = turn < TURN
            place = np.arange(len(q))
            place[which] = len(q) + np.arange(len(which))
            found = Points.joined([found, there]).take(place)
        live = live[sound & ~ready]
        if not len(live):
            break
    return found, good


def _points(
    equations: LocusEquations, q: Array, near: Evaluated, towards: Array | None, eta: Array | None
) -> Points:
    """Points q (S, nq) with the equations at them, or nearer than `LAST_STEP`; the last two give signs."""
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
