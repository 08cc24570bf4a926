"""Proof that leg conditions in space have no other real solutions: all dual quaternions are paved.

z = (x, y) with one of x at 1 and the others in [-1, 1], which are all turns in four charts. The condition
with |p|^2 bounds p, and |y| = |p| |x| / 2. What is proved is proved for all coefficients within their slack.
"""

from __future__ import annotations

import numpy as np

from framework.arrays import Array
from framework.proofs.branch_and_bound import Boxes
from framework.proofs.completeness import KnownSolutions, has_no_others, unique_radius
from framework.proofs.interval_newton import LinearEnclosure
from framework.proofs.rounding import REACH_MARGIN, gamma
from framework.proofs.study_quadric import Displacements

MAX_BOXES = 3_000_000  # in each chart, some 40 s
CHART_OVERLAP = 1.3  # |x| of known solutions that are looked at in a chart, 1 being its edge


def are_all_real(group: Displacements, coefficients: Array, slack: Array, z: Array) -> bool:
    """Whether z (k, 8) are proved to be all real solutions of conditions (K, M).

    The first condition has |p|^2 once and the others have none (`Displacements.eliminate_square`).
    """
    reach = farthest_displacement(group, coefficients, slack)
    if group.family.size != 8 or reach is None:
        return False
    return all(Chart(group, coefficients, slack, k).has_no_others(z, reach) for k in range(4))


def farthest_displacement(group: Displacements, coefficients: Array, slack: Array) -> float | None:
    """Bound |p| by the first condition: |p|^2 <= b |p| + c, no entry of R exceeding one."""
    first, off = np.zeros(17), np.zeros(17)
    first[group.chosen], off[group.chosen] = coefficients[0], slack[0]
    if first[1] != 1.0:
        return None
    size = np.abs(first) + off
    b = float(np.linalg.norm(size[2:5]) + np.linalg.norm(size[5:8]))
    c = float(size[0] + size[8:].sum())
    return REACH_MARGIN * (b / 2 + float(np.sqrt(b * b / 4 + c)))


class Chart:
    """The conditions where one coordinate of z is 1, in the other seven."""

    def __init__(self, group: Displacements, coefficients: Array, slack: Array, unit_coordinate: int) -> None:
        self.unit_coordinate, self.free = unit_coordinate, np.delete(np.arange(8), unit_coordinate)
        self.Q = group.family.quadrics(coefficients).real
        off = np.tensordot(slack, np.abs(group.family.members), axes=1)
        off = np.concatenate([off, np.zeros_like(group.family.fixed)])
        size, rows = np.abs(self.Q), len(self.Q)
        self.curvature = size[:, self.free][:, :, self.free].reshape(rows, -1)
        self.uncertainty = (off + gamma(16) * size).reshape(rows, -1)

    def __call__(self, middle: Array, radii: Array) -> LinearEnclosure:
        """Enclose the conditions in boxes (B, 7)."""
        count = len(middle)
        z, size = np.ones((count, 8)), np.ones((count, 8))
        z[:, self.free], size[:, self.free] = middle, np.abs(middle) + radii
        slopes = (self.Q.reshape(-1, 8) @ z.T).T.reshape(count, -1, 8)
        square = (radii[:, :, None] * radii[:, None]).reshape(count, -1)
        products = (size[:, :, None] * size[:, None]).reshape(count, -1)
        values = (slopes @ z[:, :, None])[:, :, 0]
        errors = square @ self.curvature.T + products @ self.uncertainty.T
        return LinearEnclosure(values, 2 * slopes[:, :, self.free], errors)

    def has_no_others(self, z: Array, reach: float) -> bool:
        """Whether the chart holds no real solutions but z (k, 8), |p| at most reach."""
        near = np.abs(z[:, :4]).max(axis=1) <= CHART_OVERLAP * np.abs(z[:, self.unit_coordinate])
        points = (z[near] / z[near, self.unit_coordinate][:, None])[:, self.free]
        radii = np.array([unique_radius(self, point) for point in points])
        solutions = KnownSolutions(points, radii, np.full(7, np.inf))
        region = Boxes(np.zeros((1, 7)), np.where(self.free < 4, 1.0, reach)[None])
        return has_no_others(self, region, solutions, MAX_BOXES)
