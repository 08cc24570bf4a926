"""The entries of a Jacobian that are not zero by construction, and products with them.

A loop equation feels only the joints between its two bodies. Everything here costs in proportion to
the number of such entries; only `dense` writes the zeros too.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from framework.arrays import Array, IntArray, ReadOnlyArrays, read_only


@dataclass(frozen=True, eq=False)
class _Entries(ReadOnlyArrays):
    """E entries of a matrix of a given shape, at `row` and `column`."""

    shape: tuple[int, int]
    row: IntArray  # (E,)
    column: IntArray  # (E,)

    @cached_property
    def index(self) -> IntArray:
        """Index of each entry (E,) in the memory of a matrix."""
        return read_only(self.row * self.shape[1] + self.column)

    def _scatter(self, values: Array) -> Array:
        """Return matrices (T, *shape) of entries (T, E), zero elsewhere."""
        matrices = np.zeros((len(values), self.shape[0] * self.shape[1]))
        matrices[:, self.index] = values
        return matrices.reshape(len(values), *self.shape)


@dataclass(frozen=True, eq=False)
class Sparsity(_Entries):
    """The entries of matrices (m, nv): equation `row`, joint column `column`.

    `sign` is 1 where the joint carries the second body of the equation, -1 where it carries the first.
    `constant` is the entry of an equation between joints themselves, 0 of others.
    """

    sign: Array  # (E,)
    constant: Array  # (E,)

    @staticmethod
    def of(signs: Array, constants: Array | None = None) -> Sparsity:
        """Return the pattern of matrices of signs and of constants (m, nv), 0 for no entry."""
        constants = np.zeros_like(signs) if constants is None else constants
        row, column = np.nonzero((signs != 0) | (constants != 0))
        shape = (signs.shape[0], signs.shape[1])
        return Sparsity(shape, row, column, signs[row, column], constants[row, column])

    def entries(self, wrench: Array, screws: Array) -> Array:
        """Compute entries (T, E) of the Jacobians for wrenches (T, m, 6) and joint screws (T, nv, 6)."""
        if self.shape[0] * self.shape[1] <= 8 * len(self.row):  # so full that all products are quicker
            everywhere = (wrench @ screws.swapaxes(1, 2)).reshape(len(wrench), self.shape[0] * self.shape[1])
            of_frames = everywhere.take(self.index, axis=1) * self.sign
        else:
            of_frames = np.einsum("tei,tei->te", wrench[:, self.row], screws[:, self.column]) * self.sign
        return of_frames + self.constant if self.has_constants else of_frames

    @cached_property
    def has_constants(self) -> bool:
        """Whether some equations are between joints themselves."""
        return bool(self.constant.any())

    def dense(self, values: Array) -> Array:
        """Return matrices (T, m, nv) with entries (T, E)."""
        return self._scatter(values)

    def part(self, rows: IntArray, columns: IntArray) -> Part:
        """Return the entries in some rows and columns, in their order."""
        position_of_row, position_of_column = (np.full(size, -1) for size in self.shape)
        position_of_row[rows], position_of_column[columns] = np.arange(len(rows)), np.arange(len(columns))
        row, column = position_of_row[self.row], position_of_column[self.column]
        inside = np.flatnonzero((row >= 0) & (column >= 0))
        return Part((len(rows), len(columns)), row[inside], column[inside], inside)


@dataclass(frozen=True, eq=False)
class Part(_Entries):
    """The K entries of a pattern in some of its rows and columns, which `row` and `column` count."""

    entry: IntArray  # (K,) entries of the whole pattern

    def dense(self, values: Array) -> Array:
        """Return the part (T, rows, columns) of matrices with entries `values` (T, E)."""
        return self._scatter(values.take(self.entry, axis=1))

    def times(self, values: Array, right: Array) -> Array:
        """Multiply the part of matrices with entries `values` (T, E) by vectors (T, columns)."""
        return _sums(values[:, self.entry] * right[:, self.column], self.row, self.shape[0])

    def transposed_times(self, values: Array, right: Array) -> Array:
        """Multiply the transposed part by vectors (T, rows)."""
        return _sums(values[:, self.entry] * right[:, self.row], self.column, self.shape[1])


def _sums(terms: Array, index: IntArray, size: int) -> Array:
    """Compute sums (T, size) of terms (T, K) of the same index."""
    where = np.arange(len(terms))[:, None] * size + index
    sums = np.bincount(where.ravel(), weights=terms.ravel(), minlength=len(terms) * size)
    return np.asarray(sums.reshape(len(terms), size), dtype=float)
