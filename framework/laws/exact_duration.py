"""A squared speed that takes exactly so long: the integral of z^(-1/2) and how it is met.

z has coefficients y on a `SpeedBasis` in xi(sigma), see `optimal_law`. Its integral is taken on the panels
that resolve z^(-1/2), however near to zero z comes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev, legendre

from framework.laws.optimal_law import PANEL_NODES, Stretch, slowness_on_panels
from framework.laws.speed_basis import SpeedBasis
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import COEFFICIENT_ROUNDING, nodes
from framework.numerics.cone_program import Affine

MAX_ADJUSTMENT_STEPS = 12  # of the adjustment, from a duration that is nearly right
MAX_BLEND_STEPS = 60  # of Newton's method from the slow side, which converges from there however far it is
BLEND_DURATION_ERROR = 1e-9  # of the duration, what a blend may miss: the adjustment does the rest
FREE_DEGREE = 8.0  # up to which a coefficient is free to change in proportion
DEGREE_WEIGHT_POWER = 4.0  # power of the degree with which a coefficient resists being adjusted
MIN_EASE = 1e-3  # of the mean coefficient of a spline, by which a smaller one may change as easily


class SpeedSpace(NamedTuple):
    """The squared speeds that a basis can write along xi(sigma)."""

    basis: SpeedBasis
    stretch: Stretch

    def duration(self, y: Array) -> float:
        """Compute the integral of z^(-1/2) over [0, 1] [s] for coefficients (size,) of a positive z."""
        values, weights = self._quadrature(y)
        return float(weights @ (values @ y) ** -0.5)

    def blend(self, quick: Array, slow: Array, duration: float) -> Array:
        """Compute the coefficients between two (size,) that take `duration` [s], between theirs.

        Duration is convex along the blend, so Newton's method from the slow end never leaves the interval.
        """
        y, toward = slow, quick - slow
        share = 0.0  # of the quick one
        for _ in range(MAX_BLEND_STEPS):
            values, weights = self._quadrature(y)
            z = values @ y
            missing = float(weights @ z**-0.5) - duration
            if missing <= BLEND_DURATION_ERROR * duration:
                break
            share += missing / float(0.5 * weights @ (z**-1.5 * (values @ toward)))
            y = slow + share * toward
        return np.asarray(y)

    def adjust(
        self, y: Array, equalities: Affine, duration: float | None = None, *, relative: bool = False
    ) -> Array:
        """Compute the nearest coefficients (size,) that meet the equalities and take exactly `duration` [s].

        Args:
            duration: any if None.
            relative: near in z over the z of `y`, so that it changes little where it is nearly zero. So it is
                for splines in any case.

        Raises:
            InvalidInput: Newton's method on the duration finds no positive z.
        """
        ease = self._ease(y, relative)
        for _ in range(MAX_ADJUSTMENT_STEPS):
            rows, miss = np.asarray(equalities.matrix @ np.eye(len(y))), equalities(y)  # (c, size), (c,)
            if duration is not None:
                values, weights = self._quadrature(y)
                z = values @ y
                rows = np.concatenate([rows, -0.5 * ((weights * z**-1.5) @ values)[None]])
                miss = np.append(miss, weights @ z**-0.5 - duration)
            norms = np.linalg.norm(rows, axis=1)
            norms[norms == 0] = 1.0  # a condition that holds anyway
            rows = rows / norms[:, None]
            directions = ease @ rows.T  # (size, c) in which coefficients change
            step = directions @ np.linalg.lstsq(rows @ directions, miss / norms, rcond=None)[0]
            y = y - step
            if np.abs(step).max() <= COEFFICIENT_ROUNDING * np.abs(y).max():
                break
        return y

    def _ease(self, y: Array, relative: bool) -> Array:
        """Return a matrix (size, size) of how easily coefficients change: a step costs step' ease^-1 step.

        Those of splines in proportion to their size; of one polynomial the more easily, the lower its
        degree. Relative to z: the inverse of the matrix of |change of z|^2 / z^2, with a resistance that
        grows with the degree.
        """
        if self.basis.is_spline:
            return np.diag(np.maximum(np.abs(y), MIN_EASE * np.abs(y).mean()) ** 2)
        size = len(y)
        if not relative:  # the lower the degree, the more
            return np.diag((1.0 + np.arange(size)) ** -DEGREE_WEIGHT_POWER)
        values = chebyshev.chebvander(nodes(4 * size), size - 1)
        z = values @ y
        share = values.T * (z.mean() / z) ** 2 @ values / len(z)
        resistance = np.diag((np.arange(size) / FREE_DEGREE) ** DEGREE_WEIGHT_POWER)
        return np.asarray(np.linalg.inv(share + resistance))

    def _quadrature(self, y: Array) -> tuple[Any, Array]:
        """Return values (P, size) of the basis and weights (P,) in sigma that integrate z^(-1/2).

        They are those of Gauss and Legendre on the panels that resolve this function.
        """
        edges = slowness_on_panels(self.basis.cells, self.basis.series(y), self.stretch).edges
        points, weights = legendre.leggauss(PANEL_NODES)
        half = 0.5 * np.diff(edges)[:, None]
        sigma = (edges[:-1, None] + half * (points + 1.0)).ravel()
        return self.basis.matrix(self.stretch(sigma)), (half * weights).ravel()
