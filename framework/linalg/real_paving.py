"""Proof that leg conditions in space have no other real solutions: all dual quaternions are paved.

z = (x, y) with one of x at 1 and the others in [-1, 1], which are all turns in four charts. The condition
with |p|^2 bounds p, and |y| = |p| |x| / 2. What is proved is proved for all coefficients within their slack.
"""

from __future__ import annotations

import numpy as np

from framework.arrays import Array
from framework.linalg.displacements import Displacements
from framework.linalg.paving import GAMMA, Known, Linearised, has_no_others

MOST_BOXES = 3_000_000  # in each chart, some 40 s
WITHIN = 1.3  # x of known solutions that are looked at in a chart
WIDEST = 0.5  # of a region in which a solution is the only one


def are_all_real(group: Displacements, coefficients: Array, slack: Array, z: Array) -> bool:
    """Whether z (k, 8) are proved to be all real solutions of conditions (K, M); False if it is not known.

    The first condition has |p|^2 once and the others have none (`Displacements.eliminated`).
    """
    reach = _farthest(group, coefficients, slack)
    if group.family.size != 8 or reach is None:
        return False
    return all(_Chart(group, coefficients, slack, k).has_no_others(z, reach) for k in range(4))


def _farthest(group: Displacements, coefficients: Array, slack: Array) -> float | None:
    """A bound on |p|: |p|^2 <= b |p| + c by the first condition, as no entry of R is larger than one."""
    first, off = np.zeros(17), np.zeros(17)
    first[group.chosen], off[group.chosen] = coefficients[0], slack[0]
    if first[1] != 1.0:
        return None
    size = np.abs(first) + off
    b, c = float(np.linalg.norm(size[2:5]) + np.linalg.norm(size[5:8])), float(size[0] + size[8:].sum())
    return 1.01 * (b / 2 + float(np.sqrt(b * b / 4 + c)))


class _Chart:
    """The conditions where one coordinate of z is 1, in the other seven."""

    def __init__(self, group: Displacements, coefficients: Array, slack: Array, one: int) -> None:
        self.one, self.free = one, np.delete(np.arange(8), one)
        self.Q = group.family.quadrics(coefficients).real
        off = np.tensordot(slack, np.abs(group.family.members), axes=1)
        off = np.concatenate([off, np.zeros_like(group.family.fixed)])
        self.bend = np.abs(self.Q)[:, self.free][:, :, self.free].reshape(len(self.Q), -1)
        self.unsure = (off + GAMMA * np.abs(self.Q)).reshape(len(self.Q), -1)

    def __call__(self, c: Array, r: Array) -> Linearised:
        """The conditions in boxes c, r (B, 7)."""
        z, size = np.ones((len(c), 8)), np.ones((len(c), 8))
        z[:, self.free], size[:, self.free] = c, np.abs(c) + r
        slopes = (self.Q.reshape(-1, 8) @ z.T).T.reshape(len(c), -1, 8)
        square = (r[:, :, None] * r[:, None]).reshape(len(c), -1)
        whole = (size[:, :, None] * size[:, None]).reshape(len(c), -1)
        values = (slopes @ z[:, :, None])[:, :, 0]
        return Linearised(values, 2 * slopes[:, :, self.free], square @ self.bend.T + whole @ self.unsure.T)

    def has_no_others(self, z: Array, reach: float) -> bool:
        """Whether the chart holds no real solutions but z (k, 8), |p| at most reach."""
        seen = np.abs(z[:, :4]).max(axis=1) <= WITHIN * np.abs(z[:, self.one])
        points = (z[seen] / z[seen, self.one][:, None])[:, self.free]
        known = Known(points, np.array([self.lonely_radius(point) for point in points]), np.full(7, np.inf))
        radii = np.where(self.free < 4, 1.0, reach)[None]
        return has_no_others(self, np.zeros((1, 7)), radii, known, MOST_BOXES)

    def lonely_radius(self, point: Array) -> float:
        """The radius of a box about a point (7,) in which there is one solution at most."""
        lines = self(point[None], np.ones((1, 7)))
        Y = np.linalg.pinv(lines.slopes[0])
        if np.abs(Y @ lines.slopes[0] - np.eye(7)).sum(axis=1).max() > 1e-6:
            return 0.0
        return min(0.9 / float((2 * np.abs(Y) @ lines.bends[0]).max()), WIDEST)
