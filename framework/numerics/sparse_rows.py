"""Rows of sparse matrices in few calls: a product of scipy with a diagonal matrix takes some hundreds."""

from __future__ import annotations

from typing import Any

import numpy as np

from framework.numerics.arrays import Array, IntArray


def rows_of_entries(matrix: Any) -> IntArray:
    """Return the row (E,) of each of the E entries of a matrix in CSR format."""
    return np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))


def scale_rows(matrix: Any, factors: Array) -> Any:
    """Return a sparse matrix (M, n) in CSR format with its rows multiplied by factors (M,)."""
    matrix = matrix.tocsr()
    scaled = matrix.copy()
    scaled.data *= factors[rows_of_entries(matrix)]
    return scaled


def row_maxima(matrix: Any) -> Array:
    """Compute the largest size (M,) of an entry in each row of a sparse matrix."""
    matrix = matrix.tocsr()
    largest = np.zeros(matrix.shape[0])
    np.maximum.at(largest, rows_of_entries(matrix), np.abs(matrix.data))
    return largest
