"""The basis of the squared speed z of an optimal law: quintic B-splines on cells of xi.

On a single cell the basis consists of Chebyshev polynomials instead. They give a law that is smooth
everywhere, which deflections require. B-splines are never negative, and each overlaps only with five
neighbours on either side. So z is positive if its coefficients are, and rows linear in z are sparse.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from framework.numerics.arrays import Array, ReadOnlyArrays, read_only
from framework.numerics.chebyshev import coefficients, derivative_matrix, nodes
from framework.numerics.splines import find_intervals, spline_values

SPLINE_DEGREE = 5  # four derivatives of z are continuous; the second one of the torque contains all of them
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
        """Knots (size + degree + 1,) of the B-splines."""
        ends = np.ones(SPLINE_DEGREE)
        return read_only(np.concatenate([-ends, self.cells, ends]))

    @cached_property
    def centres(self) -> Array:
        """Centres (size,) in xi of the B-splines: the means of their inner knots (Greville abscissae)."""
        inner_knots = np.lib.stride_tricks.sliding_window_view(self.knots[1:-1], SPLINE_DEGREE)
        return read_only(inner_knots.mean(axis=1))

    def matrix(self, xi: Array, order: int = 0) -> Any:
        """Return the sparse matrix (T, size) of all functions, or derivatives, at xi (T,)."""
        from scipy import sparse

        if not self.is_spline:
            values = chebyshev.chebvander(xi, self.size - 1)
            return sparse.csr_array(values @ derivative_matrix(self.size, order) if order else values)

        xi = np.clip(xi, -1.0, 1.0)
        intervals = find_intervals(self.knots, SPLINE_DEGREE, xi)
        values = spline_values(self.knots, SPLINE_DEGREE, intervals, xi, order)
        columns = intervals[:, None] + np.arange(-SPLINE_DEGREE, 1)
        rows = np.arange(0, columns.size + 1, SPLINE_DEGREE + 1)
        return sparse.csr_array((values.ravel(), columns.ravel(), rows), shape=(len(xi), self.size))

    def series(self, y: Array) -> Array:
        """Return Chebyshev series (k, degree + 1) on the cells, for coefficients y (size,)."""
        if not self.is_spline:
            return y[None]
        half_widths = 0.5 * np.diff(self.cells)[:, None]
        xi = self.cells[:-1, None] + half_widths * (nodes(SPLINE_DEGREE + 1) + 1.0)  # (k, degree + 1)
        values = np.reshape(self.matrix(xi.ravel()) @ y, xi.shape)
        return coefficients(values[..., None])[..., 0]  # `coefficients` expects a trailing axis of components
