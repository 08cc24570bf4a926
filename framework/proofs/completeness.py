"""Proof that equations have no solutions in given boxes besides the known ones.

A box is dropped if its linear enclosure has no solution, or if it lies in a region where a known solution is
the only one. Otherwise the enclosure narrows it, or it is cut. The equations come from `leg_paving`.
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
MIN_RADIUS = 1e-6  # smaller boxes are not cut; boxes about a regular solution are dropped at larger radii
MAX_UNIQUE_RADIUS = 0.5  # [rad, lengths] largest radius of a region in which a solution is the only one
UNIQUENESS_SHARE = 0.9  # share of the radius at which the Jacobian may lose rank
MAX_INVERSE_ERROR = 1e-6  # largest row sum of |Y J - 1| for a pseudo-inverse Y that a proof uses

Equations = Callable[[Array, Array], LinearEnclosure]  # takes the middles and radii (B, n) of boxes


class KnownSolutions(NamedTuple):
    """Known solutions, each alone in a box about its point."""

    points: Array  # (k, n)
    radii: Array  # (k,) of the boxes
    period: Array  # (n,) of the coordinates: a whole turn of angles, inf of lengths

    @staticmethod
    def of(equations: Equations, points: Array, period: Array) -> KnownSolutions:
        """Return points (k, n) with the radii in which each is the only solution."""
        radii = np.array([unique_radius(equations, point) for point in points])
        return KnownSolutions(points, radii, period)

    def contains(self, boxes: Boxes) -> BoolArray:
        """Return whether each of B boxes lies in the box of one solution, (B,).

        Angles are compared modulo whole turns, so distances are the shortest ones modulo the period.
        """
        offset = np.mod(np.abs(boxes.middle[:, None] - self.points), self.period)  # (B, k, n)
        distance = np.minimum(offset, self.period - offset)
        farthest = (distance + boxes.radii[:, None]).max(axis=2)  # (B, k) points of the boxes
        return np.any(farthest < self.radii, axis=1)


def unique_radius(equations: Equations, point: Array) -> float:
    """Compute the radius of a box about a point (n,) with at most one solution.

    Let J be the Jacobian at the point, Y its pseudo-inverse and dJ a bound on the change of J within the box.
    Two solutions in the box are impossible if the mean Jacobian between any two of its points has full rank,
    which holds if |Y| dJ has row sums below 1. The bound dJ is proportional to the radius r. Since the errors
    of the equations bound second-order terms, dJ r is twice these errors.
    """
    n = len(point)
    linear = equations(point[None], np.ones((1, n)))  # in a box of radius 1
    J = linear.slopes[0]
    Y = np.linalg.pinv(J)
    if np.abs(Y @ J - np.eye(n)).sum(axis=1).max() > MAX_INVERSE_ERROR:
        return 0.0
    change = 2 * np.abs(Y) @ linear.errors[0]  # (n,) row sums of |Y| dJ at radius 1
    return min(UNIQUENESS_SHARE / float(change.max()), MAX_UNIQUE_RADIUS)


def has_only_known_solutions(equations: Equations, boxes: Boxes, known: KnownSolutions) -> bool:
    """Return whether boxes provably hold only known solutions; False if undecided."""

    def test(boxes: Boxes) -> Examined[Boxes, None]:
        """Narrow boxes; drop boxes without other solutions; test again or halve the rest."""
        linear = equations(*boxes)
        remaining = contract(linear, boxes.radii, damped_inverses(linear, boxes.radii))
        all_narrow = boxes.sub_boxes(remaining.lower, remaining.upper)
        is_open = ~remaining.empty & ~known.contains(all_narrow)

        narrow = select(all_narrow, is_open)
        is_small = narrow.radii.max(axis=1) < MIN_RADIUS
        no_axis = np.full(narrow.size, NO_AXIS)
        undecided, pending = narrow_or_halve(select(boxes, is_open), narrow, no_axis, is_small)
        return Examined(None, undecided, pending)

    # One undecided box spoils the proof. With equal distances no box is nearer than it, so the search ends.
    end = branch_and_bound(
        test,
        boxes,
        batch=BOXES_PER_BATCH,
        max_examined=MAX_BOXES,
        distance=lambda boxes: np.zeros(boxes.size),
    )
    return not (end.undecided.size or end.pending.size)
