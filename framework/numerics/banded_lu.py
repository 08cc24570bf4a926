"""Square systems of one sparsity pattern at many instants, solved as a single banded system.

The matrices of all instants, placed along a diagonal, form one banded matrix, which LAPACK factorises with
partial pivoting in one call. A pivot never leaves its instant, since all entries outside of it are zero. Rows
and columns are ordered for a small bandwidth (reverse Cuthill-McKee). If legs are coupled only to their
neighbours, the bandwidth is that of a leg, and the cost of an instant is proportional to the number of legs.
If all legs meet in one platform, the band is nearly full, but still no slower than separate dense solutions.

Systems of at most MAX_DENSE unknowns need no band, because numpy solves them equally fast. This avoids the
import of scipy, which takes longer than planning for a small robot.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from framework.numerics.arrays import Array, BoolArray, IntArray, ReadOnlyArrays

MAX_DENSE = 8  # largest number of unknowns that numpy solves as fast as LAPACK does in a band


@dataclass(frozen=True, eq=False)
class DenseFactors:
    """Square matrices (T, k, k) of few unknowns, solved without a band; the same methods as `BandFactors`."""

    matrices: Array

    def solve(self, right: Array, *, transposed: bool = False) -> Array:
        """Compute solutions (..., T, k) for right-hand sides (..., T, k) of the matrices, or transposed ones.

        Raises:
            numpy.linalg.LinAlgError: one of the matrices is singular to the last bit.
        """
        # Any, as numpy types solutions as numbers of unknown precision
        matrices: Any = self.matrices.transpose(0, 2, 1) if transposed else self.matrices
        if not right.size:
            return np.empty(right.shape)
        if right.ndim == 2:
            return np.linalg.solve(matrices, right[..., None])[..., 0]
        # numpy solves each matrix for all its right-hand sides at once: the columns of (T, k, sides)
        columns = right.reshape(-1, *matrices.shape[:2]).transpose(1, 2, 0)
        solution = np.linalg.solve(matrices, columns).transpose(2, 0, 1)
        return solution.reshape(right.shape)  # back to (..., T, k)

    @cached_property
    def slogdet(self) -> tuple[Array, Array]:
        """Signs and logarithms of the absolute determinants, (T,) each; 0 and -inf where singular."""
        with np.errstate(all="ignore"):
            return np.linalg.slogdet(self.matrices)


@dataclass(frozen=True, eq=False)
class Band(ReadOnlyArrays):
    """A square part (k, k) of sparse matrices, and the positions of its E entries in a band."""

    entries: IntArray  # (E,) indices of the entries that can differ from zero, in the flattened whole matrix
    size: int  # k
    row: IntArray  # (E,) of each entry in the matrix
    column: IntArray  # (E,)
    lower: int  # number of diagonals below the main one
    upper: int  # number of diagonals above it
    row_order: IntArray  # (k,) rows of the matrix in the order of the band
    column_order: IntArray  # (k,)
    row_position: IntArray  # (k,) position of each row of the matrix in the band
    column_position: IntArray  # (k,)
    index: IntArray  # (E,) of each entry in the memory of one instant, k columns of the band

    @staticmethod
    def of(pattern: BoolArray, rows: IntArray, columns: IntArray) -> Band | None:
        """Make the band of the part in `rows` and `columns` (k,) each; None if not square or empty.

        `pattern` (r, c) says which entries of the whole matrix can differ from zero.
        """
        size = len(rows)
        if size != len(columns) or not size:
            return None
        row, column = np.nonzero(pattern[rows][:, columns])  # (E,) each, indices into the part
        entries = rows[row] * pattern.shape[1] + columns[column]  # row-major
        # rows, numbered 0 .. size - 1, and columns, numbered size .. 2 size - 1, in the order of the band
        order = np.arange(2 * size) if size <= MAX_DENSE else _order_by_bandwidth(row, column, size)
        row_order = order[order < size]
        column_order = order[order >= size] - size
        row_position = np.argsort(row_order)  # inverse permutation
        column_position = np.argsort(column_order)

        i = row_position[row]  # row of each entry in the band
        j = column_position[column]
        lower = int(np.max(i - j, initial=0))
        upper = int(np.max(j - i, initial=0))
        # LAPACK stores entry (i, j) in column j of the band at row lower + upper + i - j of its
        # 2 lower + upper + 1 rows, column by column. The first `lower` rows are space for pivoting.
        index = j * (2 * lower + upper + 1) + lower + upper + i - j
        return Band(
            entries=entries,
            size=size,
            row=row,
            column=column,
            lower=lower,
            upper=upper,
            row_order=row_order,
            column_order=column_order,
            row_position=row_position,
            column_position=column_position,
            index=index,
        )

    @property
    def height(self) -> int:
        """Number of rows of the band in LAPACK's storage."""
        return 2 * self.lower + self.upper + 1

    def fill(self, values: Array) -> Array:
        """Return the dense matrices (T, k, k) with `values` (T, E) of the pattern's E entries."""
        matrices = np.zeros((len(values), self.size, self.size))
        matrices[:, self.row, self.column] = values
        return matrices

    def factor(self, values: Array) -> Factors:
        """Factorise the T matrices with `values` (T, E) of the pattern's E entries."""
        if self.size <= MAX_DENSE:
            return DenseFactors(self.fill(values))
        from scipy.linalg.lapack import dgbtrf

        count = len(values)
        # LAPACK's storage of an instant: the k columns of the band one by one, each of `height` numbers
        band = np.zeros((count, self.size * self.height))
        band[:, self.index] = values
        storage = band.reshape(count * self.size, self.height).T  # (height, T k) with adjacent columns
        lu, pivots, first_zero_pivot = dgbtrf(storage, self.lower, self.upper, overwrite_ab=1)
        return BandFactors(self, values, lu, pivots, first_zero_pivot)


@dataclass(frozen=True, eq=False)
class BandFactors:
    """LU factors of T matrices (k, k)."""

    band: Band  # the positions of their entries
    values: Array  # (T, E) entries of the matrices
    lu: Array  # (height, T k) LU factors in LAPACK's storage
    pivots: IntArray  # (T k,)
    first_zero_pivot: int  # its column, counted from 1; 0 if no pivot is zero

    def solve(self, right: Array, *, transposed: bool = False) -> Array:
        """Compute solutions (..., T, k) for right-hand sides (..., T, k) of the matrices, or transposed ones.

        Raises:
            numpy.linalg.LinAlgError: one of the matrices is singular to the last bit.
        """
        from scipy.linalg.lapack import dgbtrs

        band = self.band
        if self.first_zero_pivot:
            instant = (self.first_zero_pivot - 1) // band.size
            raise np.linalg.LinAlgError(f"singular matrix at instant {instant}")
        if not right.size:
            return np.empty(right.shape)
        # (k,) the equation of each row of the band; the row of each unknown in the solution of the band
        order, position = band.row_order, band.column_position
        if transposed:
            order, position = band.column_order, band.row_position
        # all instants in the order of the band, (T k, right-hand sides)
        stacked = right.take(order, axis=-1).reshape(-1, self.lu.shape[1]).T
        solution, _ = dgbtrs(
            self.lu, band.lower, band.upper, stacked, self.pivots, trans=transposed, overwrite_b=1
        )
        return solution.T.reshape(right.shape).take(position, axis=-1)

    @cached_property
    def slogdet(self) -> tuple[Array, Array]:
        """Signs and logarithms of the absolute determinants, (T,) each; 0 and -inf where singular.

        The pivots of these factors decide which matrices are singular: rounding may differ in dense factors.
        """
        sign, logarithm = DenseFactors(self.band.fill(self.values)).slogdet
        diagonal_of_U = self.lu[self.band.lower + self.band.upper]  # (T k,)
        is_singular = (diagonal_of_U.reshape(-1, self.band.size) == 0.0).any(axis=1)
        return np.where(is_singular, 0.0, sign), np.where(is_singular, -np.inf, logarithm)


def _order_by_bandwidth(row: IntArray, column: IntArray, size: int) -> IntArray:
    """Order the rows and columns of matrices (k, k) for a small bandwidth.

    Rows and columns are the 2 k nodes of a graph, in which each entry connects its row with its column. The
    graph's reverse Cuthill-McKee order mixes rows and columns; the caller takes the order of each from it.
    Entries are at (row, column), (E,) each, and `size` is k.

    Returns:
        The nodes (2 k,) in their order: rows are 0 .. k - 1, columns k .. 2 k - 1.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    column_node = size + column
    ends = (np.concatenate([row, column_node]), np.concatenate([column_node, row]))
    graph = coo_array((np.ones(2 * len(row)), ends), shape=(2 * size, 2 * size)).tocsr()
    return reverse_cuthill_mckee(graph, symmetric_mode=True).astype(np.intp)


Factors = BandFactors | DenseFactors
