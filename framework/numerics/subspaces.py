"""The row space and the null space of a matrix, by its singular values."""

from __future__ import annotations

import numpy as np

from framework.numerics.arrays import Array


def split_row_space(
    matrix: Array, level: float, *, scale: tuple[float, float] = (0.0, np.inf), at_least: int = 0
) -> tuple[Array, Array]:
    """Compute orthonormal bases of the row space (r, c) and the null space (c - r, c) of a matrix.

    It is (m, c). The rank r counts the singular values above `level` times the largest one.

    Args:
        scale: range to which the largest is moved before: (1, 1) makes the level absolute.
        at_least: number of vectors of the null space, however large their singular values are.
    """
    _, values, right = np.linalg.svd(matrix)
    smallest, largest = scale
    rank = int(np.sum(values > level * min(values.max(initial=smallest), largest)))
    rank = min(rank, len(right) - at_least)
    return right[:rank], right[rank:]
