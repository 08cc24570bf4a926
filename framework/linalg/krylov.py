"""Linear equations of which only products are known, solved within the space of a few of them.

GMRES with the step of least size: what the small least-squares problem says about directions that the matrix
all but annihilates is not asked for (a truncated singular value decomposition, as in hybrid methods).

Source: Saad, Iterative Methods for Sparse Linear Systems, SIAM 2003, chapter 6; Hansen, Discrete Inverse
Problems, SIAM 2010, chapter 6.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from framework.arrays import Array

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
    basis = [right / size]
    hessenberg = np.zeros((most + 1, most))
    target = np.zeros(most + 1)
    target[0] = size
    history: list[float] = []
    for k in range(min(most, len(right))):
        new = product(basis[k])
        for _ in range(2):  # once more: what cancels in the first time loses its digits
            along = np.array(basis) @ new
            hessenberg[: k + 1, k] += along
            new = new - along @ np.array(basis)
        hessenberg[k + 1, k] = np.linalg.norm(new)
        small = hessenberg[: k + 2, : k + 1]
        weights = np.linalg.lstsq(small, target[: k + 2], rcond=weak)[0]
        remaining = float(np.linalg.norm(target[: k + 2] - small @ weights))
        history.append(remaining)
        stagnant = (
            k >= STAGNATION_PRODUCTS and remaining > STAGNATION_RATIO * history[-1 - STAGNATION_PRODUCTS]
        )
        if (
            remaining <= left * size
            or stagnant
            or hessenberg[k + 1, k] <= np.finfo(float).eps * np.abs(small).max()
        ):
            break
        basis.append(new / hessenberg[k + 1, k])
    return np.asarray(weights @ np.array(basis[: len(weights)]))
