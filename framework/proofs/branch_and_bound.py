"""Branch and bound: tests drop, prove, narrow or cut boxes, or leave them undecided.

The test is a function from a stack of boxes to `Examined`. The queue of boxes and their cutting are the same
for all tests and stand here. Three modules bring a test: `leg_paving` (a leg has no other solutions),
`singular_paving` (all singular poses) and `regular_ball` (no singular pose).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from framework.numerics.arrays import Array, BoolArray, IntArray, Stack, join, select
from framework.proofs.rounding import ROUND_UP, gamma

NO_AXIS = -1  # stands for an axis where a test names none to cut across

Record = TypeVar("Record")  # of the proved pieces


@dataclass(frozen=True, eq=False)
class Examined(Generic[Stack, Record]):
    """The pieces of a region after tests: proved, undecided and pending ones; all others are dropped."""

    proved: Record  # the proved pieces and what the test has proved about them; a list for several batches
    undecided: Stack  # too small to be cut
    pending: Stack  # narrowed or cut, to be tested again


def branch_and_bound(
    test: Callable[[Stack], Examined[Stack, Record]],
    region: Stack,
    *,
    max_examined: int,
    distance: Callable[[Stack], Array] | None = None,
    limit: float = np.inf,
) -> tuple[Examined[Stack, list[Record]], float]:
    """Test the pieces of a region until all are decided or `max_examined` are tested.

    Pieces are the rows of a stack of arrays.

    Args:
        region: the first pieces.
        max_examined: number of pieces tested at most; the last batch may exceed it.
        distance: computes the distances (S,) of pieces. If given, the nearest pieces are tested first, and
            pieces no nearer than `limit` or than an undecided piece are not tested. By default the newest
            pieces are tested first, and all are tested.
        limit: distance beyond which no piece is of interest.

    Returns:
        The pieces, pending if they were not tested; the distance up to which all pieces are decided.
    """
    batch = 1024  # pieces tested at a time
    pending = region
    proved = list[Record]()
    undecided = [select(region, slice(0))]  # a region without pieces leaves none undecided
    examined = 0
    while len(pending[0]) and examined < max_examined:  # pending[0] is the first array of the stack
        if distance is not None:
            pending = select(pending, np.argsort(distance(pending), kind="stable"))
        result = test(select(pending, slice(batch)))
        examined += min(batch, len(pending[0]))
        pending = join([result.pending, select(pending, slice(batch, None))])
        proved.append(result.proved)
        undecided.append(result.undecided)
        if distance is not None:  # only pieces nearer than all undecided ones are of interest
            limit = float(distance(result.undecided).min(initial=limit))
            pending = select(pending, distance(pending) < limit)
    if distance is not None:
        limit = float(distance(pending).min(initial=limit))
    return Examined(proved, join(undecided), pending), limit


class Boxes(NamedTuple):
    """S boxes in k coordinates, by middles and radii."""

    middle: Array  # (S, k)
    radii: Array  # (S, k) half the widths

    @property
    def size(self) -> int:
        """Number S of boxes."""
        return len(self.middle)

    def sub_boxes(self, lower: Array, upper: Array) -> Boxes:
        """Return the boxes between offsets lower and upper (S, k) from the middles.

        Radii are rounded up, so that no point between the offsets is lost.
        """
        middle = self.middle + 0.5 * (lower + upper)
        rounding = gamma(2) * (1.0 + np.abs(self.middle))  # of the middle
        return Boxes(middle, ROUND_UP * 0.5 * (upper - lower) + rounding)

    def halve(self, axis: IntArray) -> Boxes:
        """Halve each box across its axis (S,); return lower halves, then upper halves.

        The halves overlap by the rounding of their middles, so that no point between them is lost.
        """
        is_cut = np.arange(self.middle.shape[1]) == axis[:, None]  # (S, k)
        half_radii = 0.5 * ROUND_UP * self.radii + gamma(2) * np.abs(self.middle)
        radii = np.where(is_cut, half_radii, self.radii)
        shift = np.where(is_cut, 0.5 * self.radii, 0.0)
        return join([Boxes(self.middle - shift, radii), Boxes(self.middle + shift, radii)])


def narrow_or_halve(wide: Boxes, boxes: Boxes, axis: IntArray, is_small: BoolArray) -> tuple[Boxes, Boxes]:
    """Return the boxes to leave undecided, and the boxes to test next.

    A box with an axis is always halved. A box without one is tested again if narrowing has taken half of its
    volume; otherwise it is halved across its longest side, or left undecided if it is small.

    Args:
        wide: the S `boxes` before they were narrowed.
        axis: (S,) coordinate across which a box must be halved, or NO_AXIS.
        is_small: (S,) whether a box is too small to be halved.
    """
    has_no_axis = axis == NO_AXIS
    volume_ratio = np.prod(boxes.radii / wide.radii, axis=1)
    has_shrunk = has_no_axis & (2 * volume_ratio < 1)
    is_undecided = has_no_axis & is_small & ~has_shrunk
    is_cut = ~(has_shrunk | is_undecided)
    cut_axis = np.where(has_no_axis, boxes.radii.argmax(axis=1), axis)
    halves = select(boxes, is_cut).halve(cut_axis[is_cut])
    return select(boxes, is_undecided), join([select(boxes, has_shrunk), halves])
