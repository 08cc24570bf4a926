"""Products of stacks in which an item does not feel its neighbours, to the last bit.

BLAS chooses its kernels by shapes and addresses, and numpy the order of a sum by the layout of an array, so
the same numbers may be rounded in another way in another stack. Here each sum runs in the order of its
index, and all else is done element by element: an item comes out the same alone, among others, and with
every BLAS. A study of runs needs that, to give one of them back by its seed. `np.linalg.solve`, `inv` and
`svd` may be used beside these: they copy each matrix of a stack and hand it to LAPACK by itself.
"""

from __future__ import annotations

import numpy as np

from framework.arrays import Array

FEW = 300  # numbers: up to here the calls of numpy cost, beyond it the numbers


def dot(a: Array, b: Array) -> Array:
    """Sums of a b (..., n) over the last axis, (...)."""
    if not a.shape[-1]:
        return np.zeros(np.broadcast(a, b).shape[:-1])
    if a.size + b.size < FEW:
        terms = a * b
        total = terms[..., 0]
        for k in range(1, terms.shape[-1]):
            total = total + terms[..., k]
        return np.asarray(total)
    total = np.asarray(a[..., 0] * b[..., 0])
    term = np.empty_like(total)
    for k in range(1, a.shape[-1]):
        total += np.multiply(a[..., k], b[..., k], out=term)
    return total


def matvec(matrix: Array, vector: Array) -> Array:
    """Products (..., m) of matrices (..., m, n) and vectors (..., n)."""
    return dot(matrix, vector[..., None, :])


def matmul(a: Array, b: Array) -> Array:
    """Products (..., m, p) of matrices (..., m, n) and (..., n, p)."""
    columns = np.swapaxes(b, -1, -2)  # (..., p, n)
    return dot(a[..., :, None, :], columns[..., None, :, :])


def solve(matrix: Array, vector: Array) -> Array:
    """Solutions (R, n) of systems with matrices (R, n, n) and vectors (R, n), infinite where singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, vector[..., None])[..., 0])
    except np.linalg.LinAlgError:
        return np.array([_solve_one(a, b) for a, b in zip(matrix, vector, strict=True)])


def _solve_one(matrix: Array, vector: Array) -> Array:
    try:
        return np.asarray(np.linalg.solve(matrix, vector[:, None])[:, 0])
    except np.linalg.LinAlgError:
        return np.full(len(vector), np.inf)
