"""Functions on cells as Bernstein polynomials, whose coefficients bound their values.

On a cell, scaled to u in [0, 1], a polynomial of degree n is the sum of c_i B_i(u) with the Bernstein
polynomials B_i = binom(n, i) u^i (1 - u)^(n - i). The polynomial lies between its least and its largest
coefficient. Its mean over the cell is the mean of the c_i, and its mean absolute value is at most the mean of
the |c_i|.

Source: Farouki, The Bernstein polynomial basis: a centennial retrospective, CAGD 29 (2012).
"""

from __future__ import annotations

from functools import lru_cache
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from framework.numerics.arrays import Array, BoolArray, read_only

# degree of the polynomials; number of nodes of a cell, which is even so that no node is in the middle
DEGREE, NODES = 3, 6
# A function is resolved if its last two Chebyshev coefficients sum up to less than this share of the largest:
# twice the last one, if each coefficient is half of the one before.
MAX_TAIL = 2.0 ** (1 - DEGREE - 2)


class Bernstein(NamedTuple):
    """Functions on k cells: coefficients (k, DEGREE + 1, ...), and bounds (k, ...) of their error.

    The bounds rely on the decay of Chebyshev coefficients, as the certificate of a plan does. If each
    coefficient is at most half of the one before, all those that are not computed sum up to no more than the
    last two.
    """

    coefficients: Array
    error: Array


@lru_cache(maxsize=1)
def cell_nodes() -> Array:
    """Return the Chebyshev points (NODES,) of the first kind in (0, 1)."""
    return read_only(0.5 - 0.5 * np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES))


def fit_bernstein(values: Array) -> tuple[Bernstein, BoolArray]:
    """Fit polynomials to values (k, NODES, ...) at `cell_nodes`; return a mask (k,) of resolved cells.

    A cell is resolved if all components of the function are. The Chebyshev series through all nodes is
    truncated after `DEGREE`. The error bound is the sum of three parts: the truncated coefficients; the last
    two coefficients, which bound those that are not computed, see `Bernstein`; and rounding.
    """
    value_rounding = 1e-11  # error of values at nodes, relative to the largest coefficient
    count, _, *shape = values.shape
    polynomials = chebyshev.chebvander(2.0 * cell_nodes() - 1.0, NODES - 1)  # (node, j) T_j at the nodes
    # the interpolating series: polynomials @ series = values
    series = np.linalg.inv(polynomials) @ values.reshape(count, NODES, -1)  # (k, NODES, all components)
    largest = np.abs(series).max(axis=1)
    truncated = np.abs(series[:, DEGREE + 1 :]).sum(axis=1)
    last_two = np.abs(series[:, -2:]).sum(axis=1)
    error = truncated + last_two + value_rounding * largest
    coefficients = _from_chebyshev() @ series[:, : DEGREE + 1]

    is_resolved = (last_two <= MAX_TAIL * largest).all(axis=1)
    function = Bernstein(coefficients.reshape(count, DEGREE + 1, *shape), error.reshape(count, *shape))
    return function, is_resolved


@lru_cache(maxsize=1)
def _from_chebyshev() -> Array:
    """Return the matrix from Chebyshev to Bernstein coefficients of degree `DEGREE`.

    A polynomial has the same values in both bases at DEGREE + 1 points u: B c = T a, so c = B^-1 T a.
    """
    points = np.linspace(0.0, 1.0, DEGREE + 1)
    u = points[:, None]
    i = np.arange(DEGREE + 1)
    binomials = np.array([comb(DEGREE, k) for k in i])
    bernstein_values = np.asarray(binomials * u**i * (1.0 - u) ** (DEGREE - i), dtype=float)
    chebyshev_values = chebyshev.chebvander(2.0 * points - 1.0, DEGREE)
    return read_only(np.linalg.solve(bernstein_values, chebyshev_values))


@lru_cache(maxsize=8)
def product_weights(m: int, n: int) -> Array:
    """Return the weights w (m + n + 1, m + 1, n + 1) of products of coefficients.

    The product of polynomials of degrees m and n with coefficients a and b has the coefficients c_k = sum of
    w_kij a_i b_j, where w_kij = binom(m, i) binom(n, j) / binom(m + n, k) for k = i + j, and 0 for other k.
    """
    weights = np.zeros((m + n + 1, m + 1, n + 1))
    for i, j in np.ndindex(m + 1, n + 1):
        k = i + j
        weights[k, i, j] = comb(m, i) * comb(n, j) / comb(m + n, k)
    return read_only(weights)


def multiply(first: Array, second: Array) -> Array:
    """Return coefficients (k, m + n + 1, ...) of the products of polynomials on k cells.

    The factors have degrees m and n and coefficients `first` (k, m + 1, ...) and `second` (k, n + 1, ...).
    With the weights w (m + n + 1, m + 1, n + 1) of `product_weights`, coefficient j of the product is the sum
    over a and b of w_jab first_a second_b.
    """
    weights = product_weights(first.shape[1] - 1, second.shape[1] - 1)
    return np.einsum("jab,ka...,kb...->kj...", weights, first, second)


def elevation_matrix(degree: int, to: int) -> Array:
    """Return the matrix (to + 1, degree + 1) that raises the degree of coefficients.

    Raising the degree multiplies by the constant 1, written as a polynomial of degree to - degree whose
    coefficients are all 1. So the weights of the product are summed over these coefficients.
    """
    return product_weights(to - degree, degree).sum(axis=1)


def bound_mean_size(coefficients: Array, halvings: int) -> Array:
    """Bound the mean absolute values (k, ...) of polynomials (k, degree + 1, ...) from above.

    The bound is the mean of the absolute coefficients. Halving the cells, `halvings` times, tightens it.
    Cells are halved by de Casteljau's algorithm: neighbouring coefficients are averaged until one is left.
    The first averages of all rounds are the coefficients of the left half, the last ones, in reverse order,
    those of the right half.
    """
    count, size, *shape = coefficients.shape
    for _ in range(halvings):
        halves = np.empty((len(coefficients), 2, size, *shape))
        averages = coefficients
        for k in range(size):
            halves[:, 0, k] = averages[:, 0]
            halves[:, 1, size - 1 - k] = averages[:, -1]
            averages = 0.5 * (averages[:, 1:] + averages[:, :-1])
        coefficients = halves.reshape(-1, size, *shape)
    return np.abs(coefficients).reshape(count, -1, *shape).mean(axis=1)
