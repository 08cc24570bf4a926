"""Bordered matrices: a smooth, signed measure of how close square matrices are to losing rank.

With n x k borders b, c the k x k block G of

    [M  b] [eta]   [0]
    [c' 0] [ G ] = [1]

has the same rank deficiency as M if at most k singular values of M vanish at once. det G has the sign of det
M. Unlike det M it has a scale, and unlike the smallest singular value it has no kink. For k = 1 it is the
bordered scalar g.

`root_of_g` finds a root of g along a parameter p: the path coordinate s of a robot at rest or with prescribed
deflections, or the time t of a motion. Each Newton step uses the border of the matrix at the current p, and
estimates the slope by central differences. So the border fits best, and g is smoothest, at the root itself.
Source: Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria, SIAM 2000, chapter 3.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from framework.kinematics.assembly import MAX_ITERATIONS
from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import solve_or_fit
from framework.tolerances import NEWTON_STEP

# Step of central differences: a share of the interval of p, or [rad, robot lengths] of joint motions.
DIFFERENCE_STEP = 1e-4


class Border(NamedTuple):
    """The border (b, c): singular vectors of one matrix, used for all matrices near this one."""

    b: Array  # (n, size) left singular vectors; (T, n, size) for T matrices
    c: Array  # (n, size) right singular vectors; (T, n, size) for T matrices
    values: Array  # (n,) all singular values of the matrix, descending; (T, n) for T matrices

    @staticmethod
    def of(M: Array, size: int = 1) -> Border:
        """Return the border b, c (..., n, size) for matrices near M (..., n, n).

        b and c are the left and right singular vectors of the `size` least singular values of M = U S V'. For
        M itself G is minus the diagonal matrix of these values. So det G has the sign (-1)^size, whereas
        det M has the sign of det U det V. If the signs differ, the last column of b is negated, which gives
        det G the sign of det M.
        """
        U, values, V_rows = np.linalg.svd(M)
        b = U[..., -size:].copy()
        c = V_rows[..., -size:, :].swapaxes(-1, -2)
        sign_of_product = np.sign((-1) ** size * np.linalg.det(U @ V_rows))
        b[..., -1] *= sign_of_product[..., None]  # -1 if the signs of det G and det M differ
        return Border(b, c, values)


class BorderedSolution(NamedTuple):
    """Solutions of the bordered systems of T matrices M (T, n, n)."""

    eta: Array  # (T, n, size), c' eta = 1; its columns span the null space of M where G = 0
    G: Array  # (T, size, size)

    @property
    def g(self) -> Array:
        """The measure of singularity det G (T,): zero if and only if the matrix is singular."""
        return determinant(self.G)


def append_border(matrices: Array, border: Border) -> Array:
    """Return the bordered matrices [M b; c' 0] (T, n + size, n + size) of M (T, n, n)."""
    n, size = border.b.shape[-2:]
    bordered = np.zeros((len(matrices), n + size, n + size))
    bordered[:, :n, :n] = matrices
    bordered[:, :n, n:] = border.b
    bordered[:, n:, :n] = border.c.swapaxes(-1, -2)
    return bordered


def solve_bordered(matrices: Array, border: Border) -> BorderedSolution:
    """Solve [M b; c' 0] [eta; G] = [0; 1] for T matrices M (T, n, n).

    The border is common to all matrices (b, c (n, size)), or each has its own (b, c (T, n, size)).
    """
    n, size = border.b.shape[-2:]
    bordered = append_border(matrices, border)
    unit = np.zeros((len(matrices), n + size, size))
    unit[:, range(n, n + size), range(size)] = 1.0
    # The system is singular if M has more null vectors than the border has columns. Least squares still
    # returns a solution then, and its G is singular.
    solution = solve_or_fit(bordered, unit)
    return BorderedSolution(solution[:, :n], solution[:, n:])


def determinant(G: Array) -> Array:
    """Compute det G (T,) of blocks (T, size, size)."""
    return G[:, 0, 0] if G.shape[1] == 1 else np.linalg.det(G)


# ------------------------------------------------------------------ roots


def stencil(p: float, low: float = 0.0, high: float = 1.0) -> Array:
    """Return the points (3,) of a central difference about p, clipped to [low, high].

    All have the unit of p. The outer points are a share `DIFFERENCE_STEP` of the interval away from p.
    """
    half = DIFFERENCE_STEP * (high - low)
    return np.clip([p - half, p, p + half], low, high)


def differentiate_g(matrices: Array, p: Array, size: int = 1) -> tuple[float, float, float]:
    """Compute g and dg/dp from matrices on a `stencil`, by central differences.

    At an end of the interval of p the stencil is clipped, and the slope is one-sided.

    Args:
        matrices: (3, n, n) at the points of the stencil; the middle one determines the border.
        p: the points (3,) of the stencil.
        size: number of columns of the border.

    Returns:
        g and dg/dp at p; g at the upper end of the stencil, which has a sign also where p is a root.
    """
    g_below, g, g_above = map(float, solve_bordered(matrices, Border.of(matrices[1], size)).g)
    p_below, _, p_above = p.tolist()
    return g, (g_above - g_below) / (p_above - p_below), g_above


def root_of_g(
    matrices: Callable[[Array], Array],
    start: float,
    *,
    low: float = 0.0,
    high: float = 1.0,
    size: int = 1,
    longest: float = np.inf,
) -> tuple[float, bool]:
    """Find the root of g near p = `start` within [low, high] by Newton's method.

    Args:
        matrices: computes the matrices (3, n, n) at three values (3,) of p.
        size: number of columns of the border; more than 1 if several singular values are small.
        longest: largest Newton step in p. A longer one would lead to another root, so the iteration stops
            without convergence.

    Returns:
        The last iterate p; whether it has converged.
    """
    p = start
    for _ in range(MAX_ITERATIONS):
        points = stencil(p, low, high)
        g, slope, _ = differentiate_g(matrices(points), points, size)
        step = -g / slope if slope else np.inf
        if not abs(step) < longest:  # also if the step is not finite
            break
        p = float(np.clip(p + step, low, high))
        if abs(step) < NEWTON_STEP * (high - low):
            return p, True
    return p, False
