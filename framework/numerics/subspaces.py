"""The row space and the null space of a matrix, from its singular values."""

from __future__ import annotations

import numpy as np

from framework.numerics.arrays import Array


def split_row_space(
    matrix: Array, level: float, *, scale: tuple[float, float] = (0.0, np.inf), at_least: int = 0
) -> tuple[Array, Array]:
    """Compute orthonormal bases of row space (r, c) and null space (c - r, c) of a matrix (m, c).

    The rank r counts the singular values above `level` times the largest one.

    Args:
        scale: range to which the largest singular value is clipped first; (1, 1) makes the level absolute.
        at_least: least dimension of the null space, even if more singular values are above the level.
    """
    _, values, right = np.linalg.svd(matrix)
    lower, upper = scale
    reference = min(values.max(initial=lower), upper)
    rank = min(np.count_nonzero(values > level * reference), len(right) - at_least)
    return right[:rank], right[rank:]
