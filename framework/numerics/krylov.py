"""GMRES: linear equations A x = right solved in a Krylov space, from products with A alone.

The small least-squares problem is solved by a truncated singular value decomposition, as in hybrid methods.
So the solution has no component along directions that A maps to almost zero.

Source: Saad, Iterative Methods for Sparse Linear Systems, SIAM 2003, chapter 6; Hansen, Discrete Inverse
Problems, SIAM 2010, chapter 6.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from framework.numerics.arrays import Array

# the search stagnates if so many products leave more than this share of the residual
STAGNATION_PRODUCTS, STAGNATION_RATIO = 12, 0.9


def gmres(
    product: Callable[[Array], Array], right: Array, *, tolerance: float, max_products: int, cutoff: float
) -> Array:
    """Find x (n,) of least |right - A x| in the Krylov space of A (n, n) and `right`.

    Arnoldi's method makes an orthonormal basis V of the vectors right, A right, A A right, ... with
    A V = V_next H and H of Hessenberg form. Then x = V w, where w minimises | |right| e_1 - H w |.

    Args:
        product: computes A times a vector (n,) of length 1.
        right: right-hand side (n,).
        tolerance: residual over |right| at which the search ends.
        max_products: largest number of products.
        cutoff: singular values of H below this share of the largest one count as zero.
    """
    size = float(np.linalg.norm(right))
    if size == 0.0:
        return np.zeros_like(right)
    basis = [right / size]  # v_k, columns of V
    H = np.zeros((max_products + 1, max_products))  # A v_k = sum of H[i, k] v_i
    target = np.zeros(max_products + 1)
    target[0] = size
    residuals: list[float] = []
    for k in range(min(max_products, len(right))):
        components, remainder = _orthogonalise(product(basis[k]), np.array(basis))
        length = float(np.linalg.norm(remainder))
        H[: k + 1, k] = components
        H[k + 1, k] = length
        H_k = H[: k + 2, : k + 1]
        target_k = target[: k + 2]
        weights = np.linalg.lstsq(H_k, target_k, rcond=cutoff)[0]
        residuals.append(float(np.linalg.norm(target_k - H_k @ weights)))
        is_exhausted = length <= np.finfo(float).eps * np.abs(H_k).max()  # A maps the space into itself
        if residuals[-1] <= tolerance * size or is_exhausted or _stagnates(residuals):
            break
        basis.append(remainder / length)
    return np.asarray(weights @ np.array(basis[: len(weights)]))


def _orthogonalise(vector: Array, basis: Array) -> tuple[Array, Array]:
    """Split a vector (n,) into components (k,) along an orthonormal basis (k, n) and a remainder (n,)."""
    components = np.zeros(len(basis))
    for _ in range(2):  # the second pass restores the orthogonality that cancellation spoils
        along = basis @ vector
        components += along
        vector = vector - along @ basis
    return components, vector


def _stagnates(residuals: list[float]) -> bool:
    """Return whether the last STAGNATION_PRODUCTS products have hardly reduced the residual."""
    if len(residuals) <= STAGNATION_PRODUCTS:
        return False
    return residuals[-1] > STAGNATION_RATIO * residuals[-1 - STAGNATION_PRODUCTS]
