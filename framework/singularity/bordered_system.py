"""Bordered matrices: how near square matrices are to losing rank, smoothly and with a sign.

With n x k borders b, c the k x k block G of

    [M  b] [eta]   [0]
    [c' 0] [ G ] = [1]

has the rank deficiency of M, however many singular values of M vanish at once, as long as k is no
less. det G has the sign of det M and, unlike det M, a scale; unlike the smallest singular value it has
no kink. For k = 1 it is the bordered scalar g.
Source: Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria, SIAM 2000, chapter 3.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.linalg.ordered_sums import solve_or_fit


class Border(NamedTuple):
    """The border (b, c): the last `size` singular vectors of one matrix, for all near the matrix."""

    b: Array  # (n, size) left, or (T, n, size) of T matrices
    c: Array  # (n, size) right, likewise

    @staticmethod
    def of(matrix: Array, size: int = 1) -> Border:
        """Return the border for matrices near this one (..., n, n); det G then has the determinant's sign."""
        left, _, right = np.linalg.svd(matrix)
        b, c = left[..., -size:].copy(), right[..., -size:, :].swapaxes(-1, -2)
        # for the matrix itself G = -diag(sigma) with this border; det decides which sign it should have
        orientation = (-1) ** size * np.linalg.det(left) * np.linalg.det(right)
        b[..., -1] *= np.sign(orientation)[..., None]
        return Border(b, c)


class BorderedSolution(NamedTuple):
    """Solution of the bordered systems of T matrices."""

    eta: Array  # (T, n, size), c' eta = 1; spans the null space where G = 0
    G: Array  # (T, size, size)

    @property
    def g(self) -> Array:
        """Return det G (T,): the measure of singularity, zero where and only where the matrix is singular."""
        return determinant(self.G)


def solve_bordered(matrices: Array, border: Border) -> BorderedSolution:
    """Solve the bordered systems of matrices (T, n, n), with one border or T."""
    count, n = matrices.shape[:2]
    size = border.b.shape[-1]
    bordered = np.zeros((count, n + size, n + size))
    bordered[:, :n, :n] = matrices
    bordered[:, :n, n:] = border.b
    bordered[:, n:, :n] = border.c.swapaxes(-1, -2)
    unit = np.zeros((count, n + size, size))
    unit[:, n:] = np.eye(size)
    # by least squares with more null vectors than borders, to the last bit: G is singular there
    solution = solve_or_fit(bordered, unit)
    return BorderedSolution(solution[:, :n], solution[:, n:])


def solve_near(matrices: Array, k: int, size: int = 1) -> BorderedSolution:
    """Solve the bordered systems of matrices (T, n, n) with the border of the k-th."""
    return solve_bordered(matrices, Border.of(matrices[k], size))


def determinant(G: Array) -> Array:
    """Compute det G (T,) of blocks (T, size, size)."""
    return G[:, 0, 0] if G.shape[1] == 1 else np.linalg.det(G)
