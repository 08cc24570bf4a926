"""The functions in which an optimal law writes its squared speed z: quintic B-splines on cells of xi.

On a single cell they are Chebyshev polynomials: a law that is smooth all along, as deflections need it.
B-splines are never negative and overlap only with five neighbours on either side. So z is positive wherever
its coefficients are, and all that is linear in z is sparse.

Source: de Boor, A Practical Guide to Splines, Springer 2001, chapters IX and X.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from framework.numerics.arrays import Array, ReadOnlyArrays, read_only
from framework.numerics.chebyshev import coefficients, derivative_matrix, nodes

SPLINE_DEGREE = 5  # z is continuous to its fourth derivative, which the torque's second one contains
ONE_CELL = (-1.0, 1.0)


@dataclass(frozen=True, eq=False)
class SpeedBasis(ReadOnlyArrays):
    """A basis of `size` functions on `cells` (k + 1,) of xi in [-1, 1]."""

    cells: Array
    size: int

    @staticmethod
    def from_cells(cells: Array) -> SpeedBasis:
        """Return the quintic B-splines on cells (k + 1,), k > 1."""
        return SpeedBasis(cells, len(cells) - 1 + SPLINE_DEGREE)

    @property
    def is_spline(self) -> bool:
        """Whether the functions are B-splines."""
        return len(self.cells) > 2

    @property
    def degree(self) -> int:
        """The degree of the functions on a cell."""
        return SPLINE_DEGREE if self.is_spline else self.size - 1

    @cached_property
    def knots(self) -> Array:
        """The knots (size + degree + 1,) of the B-splines."""
        ends = np.ones(SPLINE_DEGREE)
        return read_only(np.concatenate([-ends, self.cells, ends]))

    @cached_property
    def centres(self) -> Array:
        """Centres (size,) in xi of the B-splines: the averages of their inner knots (Greville abscissae)."""
        inner_knots = np.lib.stride_tricks.sliding_window_view(self.knots[1:-1], SPLINE_DEGREE)
        return read_only(inner_knots.mean(axis=1))

    def matrix(self, xi: Array, order: int = 0) -> Any:
        """Return the values or derivatives of all functions at xi (T,).

        They are a sparse matrix (T, size). The derivative of a spline of degree p with coefficients y is a
        spline of degree p - 1 on the knots t without the first and the last, with coefficients p (y_(i+1) -
        y_i) / (t_(i+p+1) - t_(i+1)).
        """
        from scipy import sparse

        if not self.is_spline:
            values = chebyshev.chebvander(xi, self.size - 1)
            return sparse.csr_array(values @ derivative_matrix(self.size, order) if order else values)

        from scipy.interpolate import BSpline  # takes time to import

        if not len(xi):  # `design_matrix` refuses an empty array
            return sparse.csr_array((0, self.size))
        knots = self.knots
        to_derivative = sparse.identity(self.size, format="csr")
        for degree in range(SPLINE_DEGREE, SPLINE_DEGREE - order, -1):
            factor = degree / (knots[degree + 1 : -1] - knots[1 : -degree - 1])  # p / (t_(i+p+1) - t_(i+1))
            shape = len(factor), len(factor) + 1
            differences = sparse.diags_array([-factor, factor], offsets=[0, 1], shape=shape)
            to_derivative = differences @ to_derivative
            knots = knots[1:-1]
        inside = np.minimum(np.maximum(xi, -1.0), 1.0)
        values = BSpline.design_matrix(inside, knots, SPLINE_DEGREE - order)
        return sparse.csr_array(values @ to_derivative)

    def series(self, y: Array) -> Array:
        """Return Chebyshev series (k, degree + 1) on the cells of the function with coefficients y."""
        if not self.is_spline:
            return y[None]
        half_widths = 0.5 * np.diff(self.cells)[:, None]
        xi = self.cells[:-1, None] + half_widths * (nodes(SPLINE_DEGREE + 1) + 1.0)  # (k, degree + 1)
        values = np.reshape(self.matrix(xi.ravel()) @ y, xi.shape)
        return coefficients(values[..., None])[..., 0]  # of one component
