"""Squared speeds z of an exact duration T = integral of z^(-1/2).

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

MAX_ADJUSTMENT_STEPS = 12  # of Newton's method, from a duration that is nearly right
MAX_BLEND_STEPS = 60  # of Newton's method from the slow side, which converges from there however far it is
BLEND_DURATION_ERROR = 1e-9  # of the duration, that a blend may miss: the adjustment does the rest
FREE_DEGREE = 8.0  # of Chebyshev coefficients, up to which their changes cost little
DEGREE_WEIGHT_POWER = 4.0  # power of the degree with which changes of a coefficient cost more
MIN_RELATIVE_SIZE = 1e-3  # of the mean coefficient of a spline: smaller ones may change as much as this size


class SpeedSpace(NamedTuple):
    """The squared speeds that a basis can write along xi(sigma)."""

    basis: SpeedBasis
    stretch: Stretch

    def duration(self, y: Array) -> float:
        """Compute the integral of z^(-1/2) over [0, 1] [s] for coefficients y (size,) of a positive z."""
        values, weights = self._quadrature(y)
        return float(weights @ (values @ y) ** -0.5)

    def blend(self, quick: Array, slow: Array, duration: float) -> Array:
        """Combine coefficients `quick` and `slow` (size,) to a law of a duration [s].

        It is slow + share (quick - slow), with a duration between those of both. Duration is convex along the
        blend, so Newton's method from the slow end never leaves the interval.
        """
        y = slow
        direction = quick - slow
        share = 0.0
        for _ in range(MAX_BLEND_STEPS):
            values, weights = self._quadrature(y)
            z = values @ y
            excess = float(weights @ z**-0.5) - duration
            if excess <= BLEND_DURATION_ERROR * duration:
                break
            share += excess / float(0.5 * weights @ (z**-1.5 * (values @ direction)))
            y = slow + share * direction
        return y

    def adjust(
        self, y: Array, equalities: Affine, duration: float | None = None, *, relative: bool = False
    ) -> Array:
        """Compute the nearest coefficients (size,) of an exact `duration` [s] that meet the equalities.

        Newton's method: with the linearised equations A step = -values, the step of least step' W step is
        -W^-1 A' (A W^-1 A')^-1 values, see `_inverse_weights`.

        Args:
            duration: any if None.
            relative: near in z over the z of `y`, so that it changes little where it is nearly zero. So it is
                for splines in any case.

        Raises:
            InvalidInput: Newton's method on the duration finds no positive z.
        """
        inverse_weights = self._inverse_weights(y, relative)
        for _ in range(MAX_ADJUSTMENT_STEPS):
            slopes, values = self._linearise(y, equalities, duration)
            norms = np.linalg.norm(slopes, axis=1)
            norms[norms == 0] = 1.0  # a condition that holds anyway
            A = slopes / norms[:, None]
            directions = inverse_weights @ A.T  # (size, c) in which coefficients change
            step = directions @ np.linalg.lstsq(A @ directions, values / norms, rcond=None)[0]
            y = y - step
            if np.abs(step).max() <= COEFFICIENT_ROUNDING * np.abs(y).max():
                break
        return y

    def _linearise(self, y: Array, equalities: Affine, duration: float | None) -> tuple[Array, Array]:
        """Return slopes (c, size) and values (c,) of the equations at y.

        They are the equalities and, if a duration is given, T(y) - duration. T = integral of z^(-1/2), so
        that dT/dy = -1/2 integral of z^(-3/2) dz/dy.
        """
        slopes = equalities.matrix @ np.eye(len(y))
        values = equalities(y)
        if duration is None:
            return slopes, values
        basis_values, weights = self._quadrature(y)
        z = basis_values @ y
        slopes = np.concatenate([slopes, -0.5 * ((weights * z**-1.5) @ basis_values)[None]])
        return slopes, np.append(values, weights @ z**-0.5 - duration)

    def _inverse_weights(self, y: Array, relative: bool) -> Array:
        """Return W^-1 (size, size) of the cost step' W step.

        It is the cost of changing coefficients y by a step. Splines: W = 1 / y^2, so that they change in
        proportion. One polynomial: W grows with the degree, or, relative to z, W = mean of (change of z)^2 /
        z^2 and a resistance that grows with the degree.
        """
        size = len(y)
        if self.basis.is_spline:
            return np.diag(np.maximum(np.abs(y), MIN_RELATIVE_SIZE * np.abs(y).mean()) ** 2)
        if not relative:
            return np.diag((1.0 + np.arange(size)) ** -DEGREE_WEIGHT_POWER)
        values = chebyshev.chebvander(nodes(4 * size), size - 1)
        z = values @ y
        mean_square = values.T * (z.mean() / z) ** 2 @ values / len(z)
        resistance = np.diag((np.arange(size) / FREE_DEGREE) ** DEGREE_WEIGHT_POWER)
        return np.linalg.inv(mean_square + resistance)

    def _quadrature(self, y: Array) -> tuple[Any, Array]:
        """Return values (P, size) of the basis and weights (P,) in sigma that integrate z^(-1/2).

        Points and weights are those of Gauss and Legendre on the panels that resolve this function.
        """
        edges = slowness_on_panels(self.basis.cells, self.basis.series(y), self.stretch).edges
        points, weights = legendre.leggauss(PANEL_NODES)
        half_widths = 0.5 * np.diff(edges)[:, None]
        sigma = (edges[:-1, None] + half_widths * (points + 1.0)).ravel()
        return self.basis.matrix(self.stretch(sigma)), (half_widths * weights).ravel()
