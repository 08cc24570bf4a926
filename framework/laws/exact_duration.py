"""Adjust a squared speed z so that its duration T = integral of z^(-1/2) over sigma in [0, 1] is exact.

z has coefficients y on a `SpeedBasis` in xi(sigma), see `optimal_law`. The integral is taken on panels that
resolve z^(-1/2) even where z is nearly zero.
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

MAX_ADJUSTMENT_STEPS = 12  # Newton steps of `adjust`, which starts near the solution
MAX_BLEND_STEPS = 60  # Newton steps of `blend`, which converges from any distance on the slow side
BLEND_DURATION_ERROR = 1e-9  # relative error of the duration that `blend` leaves to `adjust`
FREE_DEGREE = 8.0  # Chebyshev coefficients up to this degree change at little cost
DEGREE_WEIGHT_POWER = 4.0  # the cost of changing a Chebyshev coefficient grows with this power of its degree
MIN_RELATIVE_SIZE = 1e-3  # over the mean: a smaller spline coefficient may change as much as one of this size


class SpeedSpace(NamedTuple):
    """The squared speeds z(xi(sigma)) that a basis represents."""

    basis: SpeedBasis
    stretch: Stretch

    def duration(self, y: Array) -> float:
        """Compute the duration [s] of a positive z with coefficients y (size,)."""
        values, weights = self._quadrature(y)
        return float(weights @ (values @ y) ** -0.5)

    def blend(self, quick: Array, slow: Array, duration: float) -> Array:
        """Blend coefficients `quick` and `slow` (size,) to a duration [s] between theirs.

        The blend is slow + share (quick - slow). Its duration is a convex function of the share. So Newton's
        method from share = 0 approaches the solution from the slow side, and the share stays in [0, 1].
        """
        y = slow
        direction = quick - slow
        share = 0.0
        for _ in range(MAX_BLEND_STEPS):
            values, weights = self._quadrature(y)
            z = values @ y
            excess = weights @ z**-0.5 - duration
            if excess <= BLEND_DURATION_ERROR * duration:
                break
            decrease = 0.5 * weights @ (z**-1.5 * (values @ direction))  # of the duration per unit of share
            share += excess / decrease
            y = slow + share * direction
        return y

    def adjust(
        self, y: Array, equalities: Affine, duration: float | None = None, *, relative: bool = False
    ) -> Array:
        """Compute the coefficients (size,) near y that meet the equalities and duration [s].

        Newton's method solves the equations. Of all steps with A step = -values, the linearised equations, it
        takes the one of least cost step' W step, see `_inverse_weights`. This is the step
        -W^-1 A' (A W^-1 A')^-1 values.

        Args:
            duration: required duration [s]; None leaves the duration free.
            relative: whether changes of z are measured relative to the z of `y`, so that z changes little
                where it is nearly zero. Changes of splines are always relative.

        Raises:
            InvalidInput: a Newton step on the duration leads to a z that is not positive.
        """
        inverse_weights = self._inverse_weights(y, relative)
        for _ in range(MAX_ADJUSTMENT_STEPS):
            slopes, values = self._linearise(y, equalities, duration)
            norms = np.linalg.norm(slopes, axis=1)
            norms[norms == 0] = 1.0  # of an equality that depends on no coefficient
            A = slopes / norms[:, None]  # (c, size) rows of unit length
            directions = inverse_weights @ A.T  # (size, c)
            step = directions @ np.linalg.lstsq(A @ directions, values / norms, rcond=None)[0]
            y = y - step
            if np.abs(step).max() <= COEFFICIENT_ROUNDING * np.abs(y).max():
                break
        return y

    def _linearise(self, y: Array, equalities: Affine, duration: float | None) -> tuple[Array, Array]:
        """Return slopes (c, size) and values (c,) of the equations at y.

        The equations are the equalities and, unless `duration` is None, T(y) - duration = 0. Here dT/dy is
        -1/2 times the integral of z^(-3/2) dz/dy.
        """
        slopes = equalities.matrix @ np.eye(len(y))  # dense, as the matrix may be sparse
        values = equalities(y)
        if duration is None:
            return slopes, values

        basis_values, weights = self._quadrature(y)  # (P, size), (P,)
        z = basis_values @ y
        duration_slope = -0.5 * ((weights * z**-1.5) @ basis_values)
        return np.vstack([slopes, duration_slope]), np.append(values, weights @ z**-0.5 - duration)

    def _inverse_weights(self, y: Array, relative: bool) -> Array:
        """Return W^-1 (size, size) of the cost step' W step of changing y by a step.

        Splines have W = diag(1 / y^2), so that coefficients change in proportion to their size. For a single
        polynomial W is diagonal and grows with the degree. If changes are relative to z, step' W step is the
        mean of (change of z / z)^2, times the squared mean of z, plus a term that grows with the degree.
        """
        size = len(y)
        if self.basis.is_spline:
            return np.diag(np.maximum(np.abs(y), MIN_RELATIVE_SIZE * np.abs(y).mean()) ** 2)
        if not relative:
            return np.diag((1.0 + np.arange(size)) ** -DEGREE_WEIGHT_POWER)
        values = chebyshev.chebvander(nodes(4 * size), size - 1)  # (4 size, size) T_k at the samples
        z = values @ y
        change_cost = values.T * (z.mean() / z) ** 2 @ values / len(z)
        degree_cost = np.diag((np.arange(size) / FREE_DEGREE) ** DEGREE_WEIGHT_POWER)
        return np.linalg.inv(change_cost + degree_cost)

    def _quadrature(self, y: Array) -> tuple[Any, Array]:
        """Return basis values (P, size) and weights (P,) of a quadrature over sigma.

        Gauss-Legendre points on the panels that resolve z^(-1/2), for the z of coefficients y, make the
        integral of z^(-1/2) accurate.
        """
        edges = slowness_on_panels(self.basis.cells, self.basis.series(y), self.stretch).edges
        points, weights = legendre.leggauss(PANEL_NODES)
        half_widths = 0.5 * np.diff(edges)[:, None]
        sigma = (edges[:-1, None] + half_widths * (points + 1.0)).ravel()
        return self.basis.matrix(self.stretch(sigma)), (half_widths * weights).ravel()
