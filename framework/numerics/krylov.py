"""Linear equations of which only products are known, solved within the space of a few of them.

GMRES with the step of least size: what the small least-squares problem says about directions that the matrix
all but annihilates is not asked for (a truncated singular value decomposition, as in hybrid methods).

Source: Saad, Iterative Methods for Sparse Linear Systems, SIAM 2003, chapter 6; Hansen, Discrete Inverse
Problems, SIAM 2010, chapter 6.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from framework.numerics.arrays import Array

STAGNATION_PRODUCTS, STAGNATION_RATIO = 12, 0.9  # after so many products, more than this share is left


def gmres(product: Callable[[Array], Array], right: Array, *, left: float, most: int, weak: float) -> Array:
    """Find x (n,) of least |right - A x| among combinations of right, A right, A A right, ...

    Args:
        product: A times a vector (n,) of length 1.
        right: (n,).
        left: share of |right| that may be left.
        most: products at most.
        weak: singular values below this share of the largest one, within that space, count as zero.
    """
    size = float(np.linalg.norm(right))
    if size == 0.0:
        return np.zeros_like(right)
    basis = [right / size]  # orthonormal
    hessenberg = np.zeros((most + 1, most))  # A basis[k] = sum of hessenberg[i, k] basis[i]
    target = np.zeros(most + 1)  # the right side in the basis
    target[0] = size
    history: list[float] = []
    for k in range(min(most, len(right))):
        vector = product(basis[k])
        for _ in range(2):  # once more: what cancels in the first time loses its digits
            along = np.array(basis) @ vector
            hessenberg[: k + 1, k] += along
            vector = vector - along @ np.array(basis)
        length = float(np.linalg.norm(vector))
        hessenberg[k + 1, k] = length
        small = hessenberg[: k + 2, : k + 1]
        weights = np.linalg.lstsq(small, target[: k + 2], rcond=weak)[0]
        remaining = float(np.linalg.norm(target[: k + 2] - small @ weights))
        history.append(remaining)
        is_exhausted = length <= np.finfo(float).eps * np.abs(small).max()  # the space holds A's image
        if remaining <= left * size or is_exhausted or _stagnates(history):
            break
        basis.append(vector / length)
    return np.asarray(weights @ np.array(basis[: len(weights)]))


def _stagnates(history: list[float]) -> bool:
    """Whether the last products have hardly reduced the residual."""
    if len(history) <= STAGNATION_PRODUCTS:
        return False
    return history[-1] > STAGNATION_RATIO * history[-1 - STAGNATION_PRODUCTS]
