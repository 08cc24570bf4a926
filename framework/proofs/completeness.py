"""Proof that equations have no other solutions in boxes than the known ones.

A box is dropped where its linear enclosure has no solution, or where it lies within a region in which a known
solution is the only one; it is narrowed by the enclosure, or cut. The equations are those of `leg_paving`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from framework.numerics.arrays import Array, BoolArray, select
from framework.proofs.branch_and_bound import NO_AXIS, Boxes, Examined, branch_and_bound, narrow_or_halve
from framework.proofs.interval_newton import LinearEnclosure, contract, damped_inverses

MAX_BOXES = 60_000
BOXES_PER_BATCH = 4096
MIN_RADIUS = 1e-6  # of a box that is cut: solutions that are single are known before
MAX_UNIQUE_RADIUS = 0.5  # [rad, lengths] of a region in which a solution is the only one
UNIQUENESS_SHARE = 0.9  # of the radius at which slopes may lose rank
MAX_INVERSE_ERROR = 1e-6  # of a pseudo-inverse: above it no region is claimed

Equations = Callable[[Array, Array], LinearEnclosure]  # of boxes: middles and radii (B, n)


class KnownSolutions(NamedTuple):
    """Known solutions, each alone in the box of its radius about its point."""

    points: Array  # (k, n)
    radii: Array  # (k,)
    period: Array  # (n,) of the coordinates, inf for those on a line

    @staticmethod
    def of(equations: Equations, points: Array, period: Array) -> KnownSolutions:
        """Return points (k, n) with the radii in which each is the only solution."""
        radii = np.array([unique_radius(equations, point) for point in points])
        return KnownSolutions(points, radii, period)

    def contains(self, boxes: Boxes) -> BoolArray:
        """Return whether each of B boxes lies in the box of one solution, (B,).

        Coordinates count modulo their period, so angles up to whole turns.
        """
        offset = np.mod(np.abs(boxes.middle[:, None] - self.points), self.period)  # (B, k, n)
        distance = np.minimum(offset, self.period - offset)
        is_inside = np.all(distance + boxes.radii[:, None] < self.radii[:, None], axis=2)
        return np.any(is_inside, axis=1)


def unique_radius(equations: Equations, point: Array) -> float:
    """Compute the radius of a box about a point (n,) with at most one solution.

    With J at the point and Y its inverse, the mean Jacobian between two points of the box is regular if
    |Y| |its change| < 1. The change is proportional to the radius.
    """
    n = len(point)
    linear = equations(point[None], np.ones((1, n)))
    Y = np.linalg.pinv(linear.slopes[0])
    if np.abs(Y @ linear.slopes[0] - np.eye(n)).sum(axis=1).max() > MAX_INVERSE_ERROR:
        return 0.0
    change = 2 * np.abs(Y) @ linear.errors[0]  # in a box of radius 1
    return min(UNIQUENESS_SHARE / float(change.max()), MAX_UNIQUE_RADIUS)


def has_no_others(equations: Equations, boxes: Boxes, known: KnownSolutions) -> bool:
    """Return whether boxes provably hold no solutions but the known; False if undecided."""

    def test(boxes: Boxes) -> Examined[Boxes, None]:
        """Contract boxes; drop boxes without solutions or inside known ones; halve the others."""
        linear = equations(*boxes)
        remaining = contract(linear, boxes.radii, damped_inverses(linear, boxes.radii))
        is_possible = ~remaining.empty
        boxes = select(boxes, is_possible)
        narrow = boxes.sub_boxes(*select(remaining, is_possible))
        is_open = ~known.contains(narrow)
        boxes = select(boxes, is_open)
        narrow = select(narrow, is_open)
        is_small = narrow.radii.max(axis=1) < MIN_RADIUS
        no_axis = np.full(narrow.size, NO_AXIS)
        return Examined(None, *narrow_or_halve(boxes, narrow, no_axis, is_small))

    # one undecided box ends the search: all are as near as it is
    end = branch_and_bound(
        test,
        boxes,
        batch=BOXES_PER_BATCH,
        max_examined=MAX_BOXES,
        distance=lambda boxes: np.zeros(boxes.size),
    )
    return not (end.undecided.size or end.pending.size)
