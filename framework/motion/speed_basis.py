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

from framework.arrays import Array, ReadOnlyArrays, read_only
from framework.motion.chebyshev import coefficients, derivative_matrix, nodes

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
        """Places (size,) in xi where the functions are centred: the averages of their inner knots."""
        windows = np.lib.stride_tricks.sliding_window_view(self.knots[1:-1], SPLINE_DEGREE)
        return read_only(windows.mean(axis=1))

    def matrix(self, xi: Array, order: int = 0) -> Any:
        """Return derivatives in xi of this order at xi (T,) as a sparse matrix (T, size)."""
        from scipy import sparse
        from scipy.interpolate import BSpline

        if not self.is_spline:
            values = np.asarray(chebyshev.chebvander(xi, self.size - 1), dtype=float)
            return sparse.csr_array(values @ derivative_matrix(self.size, order) if order else values)

        if not len(xi):  # which the library refuses
            return sparse.csr_array((0, self.size))
        knots, combined = self.knots, sparse.identity(self.size, format="csr")
        for degree in range(SPLINE_DEGREE, SPLINE_DEGREE - order, -1):
            width = knots[degree + 1 : -1] - knots[1 : -degree - 1]
            weight = degree / width
            shape = len(width), len(width) + 1
            combined = sparse.diags_array([-weight, weight], offsets=[0, 1], shape=shape) @ combined
            knots = knots[1:-1]
        inside = np.minimum(np.maximum(xi, -1.0), 1.0)
        return sparse.csr_array(BSpline.design_matrix(inside, knots, SPLINE_DEGREE - order) @ combined)

    def series(self, y: Array) -> Array:
        """Return the Chebyshev series (k, degree + 1) on cells of the function with coefficients y."""
        if not self.is_spline:
            return y[None]
        half = 0.5 * np.diff(self.cells)[:, None]
        xi = self.cells[:-1, None] + half * (nodes(SPLINE_DEGREE + 1) + 1.0)
        values = np.reshape(self.matrix(xi.ravel()) @ y, xi.shape)
        return coefficients(values[..., None])[..., 0]
