"""Linear algebra of stacks, in which each item is the same, to the last bit, as when computed alone.

BLAS chooses its kernels by shapes and addresses, and numpy chooses the order of a sum by the layout of an
array. So the same numbers may be rounded differently in another stack. Here each sum runs in the order of its
index, and all other operations are element by element. So the result of an item depends neither on the stack
nor on the BLAS. A study needs this to reproduce a single run from its seed. `np.linalg.solve`, `inv` and
`svd` have the same property, as they pass each matrix of a stack to LAPACK by itself.

`split_row_space` is about one matrix.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from framework.numerics.arrays import Array, BoolArray

# the indices of both factors in the six products of a cross product: (a x b)_1 = a_2 b_3 - a_3 b_2 and so on;
# the first three products have the sign +, the last three -
_INDICES_IN_A, _INDICES_IN_B = np.array([1, 2, 0, 2, 0, 1]), np.array([2, 0, 1, 1, 2, 0])
SMALL_STACK = 300  # numbers in both arguments together, below which numpy's calls take most of the time


def dot(a: Array, b: Array) -> Array:
    """Compute the sums (...) of products a b (..., n) over the last axis; other axes are broadcast.

    Small and large stacks are summed in the same order, in the way that is faster for each.
    """
    if not a.shape[-1]:
        return np.zeros(np.broadcast(a, b).shape[:-1])
    if a.size + b.size < SMALL_STACK:  # as few calls of numpy as possible
        terms = a * b
        total = terms[..., 0]
        for k in range(1, terms.shape[-1]):
            total = total + terms[..., k]
        return total
    # in place, since fresh memory for each term takes longer than the sum
    total = np.asarray(a[..., 0] * b[..., 0])
    term = np.empty_like(total)
    for k in range(1, a.shape[-1]):
        total += np.multiply(a[..., k], b[..., k], out=term)
    return total


def matvec(matrix: Array, vector: Array) -> Array:
    """Compute products (..., m) of matrices (..., m, n) and vectors (..., n)."""
    return dot(matrix, vector[..., None, :])


def matmul(a: Array, b: Array) -> Array:
    """Compute products (..., m, p) of matrices (..., m, n) and (..., n, p)."""
    columns = np.swapaxes(b, -1, -2)  # (..., p, n)
    return dot(a[..., :, None, :], columns[..., None, :, :])


def solve(matrix: Array, right: Array) -> Array:
    """Solve systems `matrix` (R, n, n) for right sides (R, n) or (R, n, k); infinite where singular."""
    if right.ndim < matrix.ndim:
        return solve(matrix, right[..., None])[..., 0]
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:  # one singular matrix fails the whole stack
        if len(matrix) == 1:
            return np.full_like(right, np.inf)
        return np.concatenate([solve(matrix[[k]], right[[k]]) for k in range(len(matrix))])


def singular_values(matrices: NDArray[Any]) -> Array:
    """Compute the singular values (..., k) of matrices (..., m, n), the largest first."""
    return np.linalg.svd(matrices, compute_uv=False)


def least_singular_values(matrices: NDArray[Any]) -> Any:
    """Compute the least singular values (...) of matrices (..., m, n); a number for a single matrix."""
    return singular_values(matrices)[..., -1]


def are_regular(matrices: Array, level: float) -> BoolArray:
    """Return which matrices (T, m, n) have no singular value below a level, at most `cholesky_level`.

    Usually all are regular. The Cholesky factorisation of M M' - c^2 I, or of M'M - c^2 I if M has more rows,
    proves this at a tenth of the cost of singular values: it succeeds only if they are all above c.
    """
    cholesky_level = 1e-4  # whose square is well above the rounding of a product of unit size
    transposed = matrices.swapaxes(1, 2)
    squares = matrices @ transposed if matrices.shape[1] <= matrices.shape[2] else transposed @ matrices
    try:
        np.linalg.cholesky(squares - cholesky_level**2 * np.eye(squares.shape[2]))
    except np.linalg.LinAlgError:  # of some matrix: compute the singular values of all
        return np.asarray(singular_values(matrices).min(axis=1, initial=np.inf) >= level)
    return np.ones(len(matrices), dtype=bool)


def solve_or_fit(matrices: NDArray[Any], right: NDArray[Any]) -> NDArray[Any]:
    """Solve systems (S, n, n) with right sides (S, n, k), all by least squares if one is singular.

    A single matrix that is singular to the last bit makes `np.linalg.solve` fail for the whole stack. The
    solution of least squares is the shortest of those with the least residual.
    """
    try:
        return np.linalg.solve(matrices, right)
    except np.linalg.LinAlgError:
        return np.array([np.linalg.lstsq(m, r, rcond=None)[0] for m, r in zip(matrices, right, strict=True)])


def cross(a: Array, b: Array) -> Array:
    """Compute cross products (..., 3) over the last axis.

    Small stacks take a tenth of the time of np.cross, large ones half of it, with the same result.
    """
    if a.size + b.size < SMALL_STACK:  # as few calls of numpy as possible
        products = a.take(_INDICES_IN_A, axis=-1) * b.take(_INDICES_IN_B, axis=-1)  # (..., 6)
        return products[..., :3] - products[..., 3:]
    a_1, a_2, a_3 = a[..., 0], a[..., 1], a[..., 2]
    b_1, b_2, b_3 = b[..., 0], b[..., 1], b[..., 2]
    result = np.empty(np.broadcast(a, b).shape, np.result_type(a, b))  # also complex steps
    np.subtract(a_2 * b_3, a_3 * b_2, out=result[..., 0])
    np.subtract(a_3 * b_1, a_1 * b_3, out=result[..., 1])
    np.subtract(a_1 * b_2, a_2 * b_1, out=result[..., 2])
    return result


def factor_transposed(J: Array) -> tuple[Array, Array, Array]:
    """Factor the transposed Jacobian J' = Q R of J (T, m, f).

    Returns:
        Q (T, f, m), R (T, m, m), and an orthonormal basis (T, f, f - m) of the null space of J.
    """
    Q, R = np.linalg.qr(J.swapaxes(1, 2), mode="complete")
    count = J.shape[1]
    return Q[:, :, :count], R[:, :count], Q[:, :, count:]


def split_row_space(
    matrix: Array, level: float, *, scale: tuple[float, float] = (0.0, np.inf), at_least: int = 0
) -> tuple[Array, Array]:
    """Compute orthonormal bases of row space (r, c) and null space (c - r, c) of a matrix (m, c).

    The rank r counts the singular values above `level` times the largest one.

    Args:
        matrix: (m, c).
        level: least singular value that counts, over the largest one.
        scale: bounds to which the largest singular value is clipped first; (1, 1) makes the level absolute.
        at_least: least dimension of the null space, even if more singular values are above the level.
    """
    _, values, V_rows = np.linalg.svd(matrix)
    lower, upper = scale
    largest = min(values.max(initial=lower), upper)
    rank = min(np.count_nonzero(values > level * largest), len(V_rows) - at_least)
    return V_rows[:rank], V_rows[rank:]
