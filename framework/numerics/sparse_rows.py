"""Sparse matrices as the entries of their rows: products, sums and selections in few calls of numpy.

A matrix of scipy takes some eighty calls to make, and its arithmetic makes several. Entries are kept in
ascending rows, and sums run in the order of the entries.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from framework.numerics.arrays import Array, BoolArray, IntArray


@dataclass(frozen=True, eq=False)
class SparseRows:
    """A matrix (M, n) by E entries at different places, in ascending rows; other entries are zero."""

    row: IntArray  # (E,)
    column: IntArray  # (E,)
    values: Array  # (E,)
    shape: tuple[int, int]

    __array_ufunc__ = None  # so that numpy leaves `weights @ rows` to `__rmatmul__`

    @staticmethod
    def of(matrix: Any) -> SparseRows:
        """Return a matrix (M, n) of numpy, of scipy, or of this class as one of this class."""
        if isinstance(matrix, SparseRows):
            return matrix
        if isinstance(matrix, np.ndarray):
            row, column = matrix.nonzero()
            return SparseRows(row, column, matrix[row, column], matrix.shape)
        by_rows = matrix.tocsr()
        row = np.repeat(np.arange(matrix.shape[0]), np.diff(by_rows.indptr))
        return SparseRows(row, by_rows.indices, by_rows.data, matrix.shape)

    @staticmethod
    def place_columns(columns: IntArray, values: Array, count: int) -> SparseRows:
        """Return the matrix (M, count) with W `values` (M, W) in each row, in `columns` (M, W)."""
        row = np.arange(len(values)).repeat(values.shape[1])
        return SparseRows(row, columns.ravel(), values.ravel(), (len(values), count))

    @staticmethod
    def sum_of_entries(row: IntArray, column: IntArray, values: Array, shape: tuple[int, int]) -> SparseRows:
        """Return the matrix of entries (E,) in any order, added where places repeat."""
        place = row * shape[1] + column
        order = place.argsort(kind="stable")
        place = place[order]
        is_first = np.ones(len(place), dtype=bool)
        is_first[1:] = place[1:] != place[:-1]
        number = is_first.cumsum() - 1  # (E,) of each entry's place
        sums = _sum_by(number, values[order], int(is_first.sum()))
        row, column = np.divmod(place[is_first], shape[1])
        return SparseRows(row, column, sums, shape)._drop_zeros()

    @staticmethod
    def sort_entries(row: IntArray, column: IntArray, values: Array, shape: tuple[int, int]) -> SparseRows:
        """Return the matrix of entries (E,) at different places, in any order."""
        order = row.argsort(kind="stable")
        return SparseRows(row[order], column[order], values[order], shape)

    @staticmethod
    def zeros(shape: tuple[int, int]) -> SparseRows:
        """Return the matrix of zeros."""
        none = np.empty(0, dtype=np.intp)
        return SparseRows(none, none, np.empty(0), shape)

    @staticmethod
    def identity(count: int) -> SparseRows:
        """Return the identity (count, count)."""
        index = np.arange(count)
        return SparseRows(index, index, np.ones(count), (count, count))

    def _drop_zeros(self) -> SparseRows:
        """Return the matrix without entries that are zero."""
        is_entry = self.values != 0.0
        return self if is_entry.all() else self._only(is_entry)

    def _only(self, mask: BoolArray) -> SparseRows:
        """Return the matrix with the entries of a mask (E,)."""
        return SparseRows(self.row[mask], self.column[mask], self.values[mask], self.shape)

    def _with_values(self, values: Array) -> SparseRows:
        """Return the matrix with other values (E,) at the same places."""
        return SparseRows(self.row, self.column, values, self.shape)

    def toarray(self) -> Array:
        """Return the dense matrix (M, n)."""
        dense = np.zeros(self.shape)
        dense[self.row, self.column] = self.values
        return dense

    def __matmul__(self, y: Array) -> Array:
        """Return the product (M,) or (M, k) with y (n,) or (n, k)."""
        if y.ndim == 2:
            return np.reshape([self @ column for column in y.T], (y.shape[1], self.shape[0])).T.copy()
        return _sum_by(self.row, self.values * y[self.column], self.shape[0])

    def __rmatmul__(self, weights: Array) -> Array:
        """Return the product (n,) or (k, n) of weights (M,) or (k, M) with this matrix."""
        if weights.ndim == 2:
            return np.reshape([row @ self for row in weights], (len(weights), self.shape[1]))
        return _sum_by(self.column, weights[self.row] * self.values, self.shape[1])

    def __mul__(self, factor: float) -> SparseRows:
        return self._with_values(self.values * factor)

    __rmul__ = __mul__

    def __truediv__(self, divisor: float) -> SparseRows:
        return self * (1.0 / divisor)

    def __neg__(self) -> SparseRows:
        return self._with_values(-self.values)

    def __add__(self, other: SparseRows) -> SparseRows:
        """Return the sum of two matrices (M, n)."""
        if np.array_equal(self.column, other.column) and np.array_equal(self.row, other.row):
            return self._with_values(self.values + other.values)._drop_zeros()
        row = np.concatenate([self.row, other.row])
        column = np.concatenate([self.column, other.column])
        values = np.concatenate([self.values, other.values])
        return SparseRows.sum_of_entries(row, column, values, self.shape)

    def __getitem__(self, rows: slice | IntArray) -> SparseRows:
        """Return the matrix (R, n) of some rows."""
        chosen = np.arange(self.shape[0])[rows]
        ends = self.row.searchsorted(chosen, side="right")
        counts = ends - self.row.searchsorted(chosen)
        new_row = np.arange(len(chosen)).repeat(counts)
        # entry number k of the result is number k - (its row's last one) from the row's end
        entries = np.arange(len(new_row)) + (ends - counts.cumsum()).repeat(counts)
        values, column = self.values[entries], self.column[entries]
        return SparseRows(new_row, column, values, (len(chosen), self.shape[1]))

    def append(self, rows: SparseRows) -> SparseRows:
        """Return the matrix with the `rows` (R, n) below."""
        count = self.shape[0]
        return SparseRows(
            np.concatenate([self.row, rows.row + count]),
            np.concatenate([self.column, rows.column]),
            np.concatenate([self.values, rows.values]),
            (count + rows.shape[0], self.shape[1]),
        )

    def scale(self, factors: Array) -> SparseRows:
        """Return the matrix with its rows multiplied by factors (M,)."""
        return self._with_values(self.values * factors[self.row])

    def subtract_multiples(self, shares: Array, rows: SparseRows) -> SparseRows:
        """Return the matrix less shares (M, k) @ rows (k, n)."""
        row, index = shares.nonzero()
        parts = [(self.row, self.column, self.values)]
        for k in range(rows.shape[0]):
            (entries,) = (rows.row == k).nonzero()
            (chosen,) = (index == k).nonzero()
            multiples = -shares[row[chosen], k, None] * rows.values[entries]  # (chosen, entries)
            columns = np.broadcast_to(rows.column[entries], multiples.shape)
            parts.append((row[chosen].repeat(len(entries)), columns.ravel(), multiples.ravel()))
        all_rows, all_columns, values = (np.concatenate(part) for part in zip(*parts, strict=True))
        return SparseRows.sum_of_entries(all_rows, all_columns, values, self.shape)

    def largest(self) -> Array:
        """Compute the largest size (M,) of an entry in each row."""
        largest = np.zeros(self.shape[0])
        np.maximum.at(largest, self.row, np.abs(self.values))
        return largest

    def gram(self) -> SparseRows:
        """Compute A'A (n, n) of the matrix A."""
        if 2 * len(self.values) > self.shape[0] * self.shape[1]:  # dense: products of columns
            dense = self.toarray()
            return SparseRows.of(np.einsum("ki,kj->ij", dense, dense))
        counts = np.bincount(self.row, minlength=self.shape[0])[self.row]  # of the entries of each one's row
        first = np.arange(len(self.row)).repeat(counts)
        number_in_row = np.arange(len(first)) - (counts.cumsum() - counts).repeat(counts)
        second = self.row.searchsorted(self.row)[first] + number_in_row
        size = self.shape[1]
        products = self.values[first] * self.values[second]
        return SparseRows.sum_of_entries(self.column[first], self.column[second], products, (size, size))

    def upper_triangle(self) -> SparseRows:
        """Return the matrix without the entries below its diagonal."""
        return self._only(self.row <= self.column)

    def column_major(self) -> Any:
        """Return the matrix in the compressed columns of scipy."""
        from scipy.sparse import csc_array

        order = np.lexsort((self.row, self.column))
        starts = self.column[order].searchsorted(np.arange(self.shape[1] + 1))
        return csc_array((self.values[order], self.row[order], starts), shape=self.shape)


def _sum_by(index: IntArray, values: Array, count: int) -> Array:
    """Sum values (E,) with the same index (E,), in their order: (count,)."""
    return np.asarray(np.bincount(index, values, minlength=count), dtype=float)
