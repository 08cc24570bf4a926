"""B-splines by the recurrence of Cox and de Boor, and least squares with them.

Knots have any multiplicity. Between the knots t_k and t_(k+1) only the splines k - degree to k are not zero.
The functions here return the values of these alone, so that rows of least squares have entries in a few
adjacent columns. `scipy.interpolate` has B-splines too, but importing it takes as long as finding a law.

Source: de Boor, A Practical Guide to Splines, Springer 2001, chapters IX and X.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from framework.numerics.arrays import Array, IntArray, ReadOnlyArrays
from framework.numerics.sparse_rows import SparseRows


def find_intervals(knots: Array, degree: int, x: Array) -> IntArray:
    """Return indices k (T,) with t_k <= x < t_(k+1) at x (T,), and the last interval at the end."""
    last = int(np.searchsorted(knots, knots[-1])) - 1  # the last interval that is not empty
    return np.clip(np.searchsorted(knots, x, side="right") - 1, degree, last)


def spline_values(knots: Array, degree: int, intervals: IntArray, x: Array, order: int = 0) -> Array:
    """Compute the B-splines that are not zero at x, or a derivative: (T, degree + 1).

    The recurrence raises the degree step by step: a spline of degree p is a sum of two splines of degree
    p - 1, with shares that are linear in x. For a derivative, the last `order` steps use the slopes of these
    shares, times p, instead of the shares.

    Args:
        knots: t, ascending.
        intervals: (T,) indices k with t_k <= x <= t_(k+1).
        x: (T,) points.
        order: of the derivative.
    """
    values = np.ones((len(x), 1))
    for p in range(1, degree + 1):
        # (T, p) first and last knots of the splines of degree p - 1 that are not zero at x
        start = knots[intervals[:, None] + np.arange(1 - p, 1)]
        end = knots[intervals[:, None] + np.arange(1, p + 1)]
        # a spline of degree p - 1 contributes to the p-th splines of the same index and of the one before
        if p <= degree - order:
            to_same = (x[:, None] - start) / (end - start)
            to_previous = 1.0 - to_same
        else:  # derivatives of both shares
            to_same = p / (end - start)
            to_previous = -to_same
        raised = np.zeros((len(x), p + 1))
        raised[:, :-1] = values * to_previous
        raised[:, 1:] += values * to_same
        values = raised
    return values


@dataclass(frozen=True, eq=False)
class Splines(ReadOnlyArrays):
    """B-splines of one degree on ascending knots (count + degree + 1,)."""

    knots: Array
    degree: int

    @staticmethod
    def on_cells(edges: Array, degree: int) -> Splines:
        """Return the c + degree splines on c cells with edges (c + 1,), as smooth as their degree allows."""
        first, last = np.repeat(edges[[0, -1]], degree).reshape(2, -1)
        return Splines(np.concatenate([first, edges, last]), degree)

    @property
    def centres(self) -> Array:
        """Centres (count,) of the splines: the means of their inner knots (Greville abscissae)."""
        inner_knots = np.lib.stride_tricks.sliding_window_view(self.knots[1:-1], self.degree)
        return np.asarray(inner_knots.mean(axis=1), dtype=float)

    def matrix(self, x: Array, order: int = 0) -> SparseRows:
        """Compute the matrix (T, count) of all splines, or a derivative of an order, at x (T,)."""
        x = x.clip(self.knots[0], self.knots[-1])
        intervals = find_intervals(self.knots, self.degree, x)
        values = spline_values(self.knots, self.degree, intervals, x, order)
        # on an interval the degree + 1 splines up to its index are not zero
        columns = intervals[:, None] + np.arange(-self.degree, 1)
        return SparseRows.place_columns(columns, values, len(self.knots) - self.degree - 1)


# ------------------------------------------------------------------ least squares with banded rows


def banded_rows(values: Array, columns: IntArray, count: int) -> Any:
    """Return a sparse matrix (T R, count) whose rows have W entries each.

    Args:
        values: (T, R, W) entries of T groups of R rows.
        columns: (T, W) ascending columns of the entries, the same for all rows of a group.
        count: number of columns.
    """
    from scipy.sparse import csr_array

    T, R, W = values.shape
    all_columns = np.repeat(columns, R, axis=0)  # (T R, W)
    row_starts = np.arange(0, T * R * W + 1, W)  # index of each row's first entry, then the count of all
    return csr_array((values.ravel(), all_columns.ravel(), row_starts), shape=(T * R, count))


def column_sizes(rows: Any) -> Array:
    """Compute the Euclidean norms (C,) of the columns of a sparse matrix."""
    squares = np.bincount(rows.indices, rows.data**2, minlength=rows.shape[1])  # summed by column
    return np.sqrt(squares)


class BandedFactor(NamedTuple):
    """The Cholesky factor L (C, C) of a symmetric matrix L L' with W diagonals from the main one down."""

    diagonals: Array  # (W, C) of L, in scipy's lower form: row d is the d-th diagonal below the main one

    @staticmethod
    def factor_squares(rows: Any, added: float) -> BandedFactor:
        """Factor B'B + added I (C, C) of rows B (rows, C) by Cholesky's method.

        Rows with entries in the same columns form a group, whose products of entries are added at once.

        Args:
            rows: B as `banded_rows` returns it, with ascending first columns.
            added: number that is added to the diagonal of B'B.
        """
        from scipy.linalg import cholesky_banded

        width = int(rows.indptr[1])  # W, the number of entries of a row
        entries = rows.data.reshape(-1, width)
        # of each group, rows in the same columns: its first column, and its first row
        columns, first_rows = np.unique(rows.indices[::width], return_index=True)
        groups = np.split(entries, first_rows[1:])
        products = np.stack([group.T @ group for group in groups])  # (groups, W, W)
        diagonals = np.zeros((width, rows.shape[1]))  # diagonal d below the main one in row d
        diagonals[0] = added
        # entry (i, k) of a group's product, i >= k, is i - k below the diagonal, in the group's column k
        for k in range(width):  # no two groups share their k-th column, so that += adds each product
            diagonals[: width - k, columns + k] += products[:, k:, k].T
        return BandedFactor(cholesky_banded(diagonals, lower=True, check_finite=False))

    def solve(self, right: Array) -> Array:
        """Solve L L' y = right for y (C, k), with k right sides (C, k)."""
        from scipy.linalg import cho_solve_banded

        is_lower = True  # the factor is L, not its transpose
        return np.asarray(cho_solve_banded((self.diagonals, is_lower), right, check_finite=False))
