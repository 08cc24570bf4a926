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
class Sparsity(ReadOnlyArrays):
    """E entries of matrices (m, nv): equation `row`, joint column `column`, each (E,).

    `sign` is 1 where the joint carries the second body of the equation, -1 where it carries the first.
    `constant` is the entry of an equation between joints themselves, 0 of others.
    """

    shape: tuple[int, int]
    row: IntArray
    column: IntArray
    sign: Array
    constant: Array

    @staticmethod
    def of(signs: Array, constants: Array | None = None) -> Sparsity:
        """Return the pattern of matrices of signs and of constants (m, nv), 0 where there is no entry."""
        constants = np.zeros_like(signs) if constants is None else constants
        row, column = np.nonzero((signs != 0) | (constants != 0))
        shape = (signs.shape[0], signs.shape[1])
        return Sparsity(shape, row, column, signs[row, column], constants[row, column])

    def entries(self, wrench: Array, screws: Array) -> Array:
        """Compute entries (T, E) of the Jacobians for wrenches (T, m, 6) and joint screws (T, nv, 6)."""
        if self.shape[0] * self.shape[1] <= 8 * len(self.row):  # so full that all products are quicker
            everywhere = (wrench @ screws.swapaxes(1, 2)).reshape(len(wrench), self.shape[0] * self.shape[1])
            of_frames = everywhere.take(self.place, axis=1) * self.sign
        else:
            of_frames = np.einsum("tei,tei->te", wrench[:, self.row], screws[:, self.column]) * self.sign
        return of_frames + self.constant if self.has_constants else of_frames

    @cached_property
    def has_constants(self) -> bool:
        """Whether some equations are between joints themselves."""
        return bool(self.constant.any())

    @cached_property
    def place(self) -> IntArray:
        """Index of each entry (E,) in the memory of a matrix."""
        return read_only(self.row * self.shape[1] + self.column)

    def dense(self, values: Array) -> Array:
        """Return the matrices (T, m, nv) with these entries (T, E)."""
        return _scattered(values, self.place, self.shape)

    def part(self, rows: IntArray, columns: IntArray) -> Part:
        """Return the entries in some rows and columns, in their order."""
        place_of_row, place_of_column = (np.full(size, -1) for size in self.shape)
        place_of_row[rows], place_of_column[columns] = np.arange(len(rows)), np.arange(len(columns))
        row, column = place_of_row[self.row], place_of_column[self.column]
        inside = np.flatnonzero((row >= 0) & (column >= 0))
        return Part((len(rows), len(columns)), inside, row[inside], column[inside])


@dataclass(frozen=True, eq=False)
class Part(ReadOnlyArrays):
    """The part of a pattern in some of its rows and columns."""

    shape: tuple[int, int]
    entry: IntArray  # (K,) entries of the whole pattern
    row: IntArray  # (K,) places among the chosen rows
    column: IntArray  # (K,) places among the chosen columns

    @cached_property
    def place(self) -> IntArray:
        """Index of each entry (K,) in the memory of a matrix."""
        return read_only(self.row * self.shape[1] + self.column)

    def dense(self, values: Array) -> Array:
        """Return the part (T, rows, columns) of matrices with entries `values` (T, E)."""
        return _scattered(values.take(self.entry, axis=1), self.place, self.shape)

    def times(self, values: Array, right: Array) -> Array:
        """Multiply the part of matrices with entries `values` (T, E) by vectors (T, columns)."""
        return _sums(values[:, self.entry] * right[:, self.column], self.row, self.shape[0])

    def transposed_times(self, values: Array, right: Array) -> Array:
        """Multiply the transposed part by vectors (T, rows)."""
        return _sums(values[:, self.entry] * right[:, self.row], self.column, self.shape[1])


def _scattered(values: Array, place: IntArray, shape: tuple[int, int]) -> Array:
    """Return matrices (T, *shape) with values (T, K) at places (K,) of their memory, zero elsewhere."""
    matrices = np.zeros((len(values), shape[0] * shape[1]))
    matrices[:, place] = values
    return matrices.reshape(len(values), *shape)


def _sums(terms: Array, place: IntArray, size: int) -> Array:
    """Compute sums (T, size) of terms (T, K) that belong to the same place."""
    where = np.arange(len(terms))[:, None] * size + place
    sums = np.bincount(where.ravel(), weights=terms.ravel(), minlength=len(terms) * size)
    return np.asarray(sums.reshape(len(terms), size), dtype=float)
