"""Branch and bound: boxes are dropped, proved or left undecided by a test, or narrowed or cut for another.

What decides is the test, a function from a stack of boxes to `Examined`; what there is to do with boxes that
it does not decide is the same for all tests and stands here. Three tests use it: `completeness` (equations
have no other solutions), `singular_paving` (all singular poses) and `regular_ball` (no singular pose).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from framework.numerics.arrays import Array, BoolArray, IntArray, Stack, join, select
from framework.proofs.rounding import ROUND_UP, UNIT_ROUNDOFF

SHRUNK_VOLUME_RATIO = 0.5  # a box that has lost more is tested again before it is cut
MIDDLE_ROUNDING = 10 * UNIT_ROUNDOFF  # of the middle of a box, added to its radii
NO_AXIS = -1


K = TypeVar("K")


@dataclass(frozen=True, eq=False)
class Examined(Generic[Stack, K]):
    """The result of a test: pieces proved, undecided or pending; all others are dropped."""

    proved: K  # with whatever the proof says of them
    undecided: Stack  # too small to be cut
    pending: Stack  # narrowed or cut, to be tested again


@dataclass(frozen=True, eq=False)
class Partition(Generic[Stack, K]):
    """The pieces of a region that were not dropped."""

    proved: list[K]
    undecided: Stack
    pending: Stack  # not tested, for want of work allowed or because they are no nearer than `limit`
    limit: float  # all pieces nearer than this are decided


def branch_and_bound(
    test: Callable[[Stack], Examined[Stack, K]],
    region: Stack,
    *,
    batch: int,
    max_examined: int,
    distance: Callable[[Stack], Array] | None = None,
    limit: float = np.inf,
) -> Partition[Stack, K]:
    """Test pieces of a region until each is decided, or `max_examined` are tested.

    Pieces are rows of a stack of arrays. The newest are tested first, or the nearest.

    Args:
        batch: pieces tested at a time.
        max_examined: pieces tested at most, up to a batch.
        distance: (S,) of the pieces. The nearest are tested first. Pieces are not tested if they are no
            nearer than `limit`, or than an undecided piece. Without distances all are tested.
    """
    pending = region
    proved = list[K]()
    undecided = list[Stack]()
    examined = 0

    def least_distance(pieces: Stack) -> float:
        """Return the distance of the nearest piece; infinite without distances or pieces."""
        return np.inf if distance is None else float(distance(pieces).min(initial=np.inf))

    while len(pending[0]) and examined < max_examined:
        if distance is not None:
            pending = select(pending, np.argsort(distance(pending), kind="stable"))
        result = test(select(pending, slice(batch)))
        examined += min(batch, len(pending[0]))
        pending = join([result.pending, select(pending, slice(batch, None))])
        proved.append(result.proved)
        undecided.append(result.undecided)
        limit = min(limit, least_distance(result.undecided))
        if distance is not None:
            pending = select(pending, distance(pending) < limit)
    limit = min(limit, least_distance(pending))
    no_piece = select(region, slice(0))
    return Partition(proved, join([no_piece, *undecided]), pending, limit)


class Boxes(NamedTuple):
    """S boxes in k coordinates, by their middles and radii."""

    middle: Array  # (S, k)
    radii: Array  # (S, k)

    @property
    def size(self) -> int:
        """Number S of boxes."""
        return len(self.middle)

    def sub_boxes(self, lower: Array, upper: Array) -> Boxes:
        """Return the boxes between offsets lower and upper (S, k) from the middles."""
        middle = self.middle + 0.5 * (lower + upper)
        rounding = MIDDLE_ROUNDING * (1.0 + np.abs(self.middle))
        return Boxes(middle, ROUND_UP * 0.5 * (upper - lower) + rounding)

    def halve(self, axis: IntArray) -> Boxes:
        """Cut each box in two across its axis (S,); return lower halves, then upper halves."""
        is_cut = np.arange(self.middle.shape[1]) == axis[:, None]  # (S, k)
        radii = np.where(is_cut, 0.5 * ROUND_UP * self.radii, self.radii)
        shift = np.where(is_cut, 0.5 * self.radii, 0.0)
        return join([Boxes(self.middle - shift, radii), Boxes(self.middle + shift, radii)])


def narrow_or_halve(wide: Boxes, boxes: Boxes, axis: IntArray, is_small: BoolArray) -> tuple[Boxes, Boxes]:
    """Return the boxes to leave undecided, and the parts of the others to test next.

    Args:
        wide: the S boxes before they were narrowed.
        boxes: the same, narrowed.
        axis: (S,) to cut across. NO_AXIS stands for the longest side; a box that has lost half of its volume
            is then not cut but tested again.
        is_small: (S,) which boxes are too small for another cut.
    """
    is_free = axis == NO_AXIS
    has_shrunk = is_free & (np.prod(boxes.radii / wide.radii, axis=1) < SHRUNK_VOLUME_RATIO)
    stays = is_free & is_small & ~has_shrunk
    is_cut = ~(has_shrunk | stays)
    across = np.where(is_free, boxes.radii.argmax(axis=1), axis)
    halves = select(boxes, is_cut).halve(across[is_cut])
    return select(boxes, stays), join([select(boxes, has_shrunk), halves])
