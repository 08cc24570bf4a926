"""Functions on cells as Bernstein polynomials, whose coefficients bound all values.

A polynomial on a cell lies between its least and its largest Bernstein coefficient. Its integral is the mean
of the coefficients times the width; the integral of its size is at most the mean of their sizes times the
width.

Source: Farouki, The Bernstein polynomial basis: a centennial retrospective, CAGD 29 (2012).
"""

from __future__ import annotations

from functools import lru_cache
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from framework.arrays import Array, BoolArray, read_only

DEGREE, NODES = 3, 6  # of the polynomials; of a cell, an even number: none is in the middle
# of the last two coefficients over the largest, for a function to be resolved
MIN_DECAY = 2.0 ** (1 - DEGREE - 2)
VALUE_ROUNDING = 1e-11  # of the largest coefficient, that values at nodes may be off


class Bernstein(NamedTuple):
    """Functions on k cells: coefficients (k, DEGREE + 1, ...), and bounds (k, ...) of their error.

    The bounds rest on the decay of Chebyshev coefficients, as the certificate of a plan does: where each is
    at most half of the one before, those not computed change values by no more than the last two.
    """

    coefficients: Array
    error: Array


@lru_cache(maxsize=1)
def cell_nodes() -> Array:
    """Return the Chebyshev points (NODES,) of the first kind in (0, 1)."""
    return read_only(0.5 - 0.5 * np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES))


def fit(values: Array) -> tuple[Bernstein, BoolArray]:
    """Return the functions with values (k, NODES, ...) at nodes, and a mask (k,): resolved."""
    count, shape = len(values), values.shape[2:]
    series = np.linalg.inv(chebyshev.chebvander(2.0 * cell_nodes() - 1.0, NODES - 1)) @ values.reshape(
        count, NODES, -1
    )
    size = np.abs(series).max(axis=1)
    last = np.abs(series[:, -2:]).sum(axis=1)
    error = np.abs(series[:, DEGREE + 1 :]).sum(axis=1) + last + VALUE_ROUNDING * size
    coefficients = _from_chebyshev() @ series[:, : DEGREE + 1]
    function = Bernstein(coefficients.reshape(count, DEGREE + 1, *shape), error.reshape(count, *shape))
    return function, np.asarray((last <= MIN_DECAY * size).all(axis=1))


@lru_cache(maxsize=1)
def _from_chebyshev() -> Array:
    """Return the matrix from Chebyshev to Bernstein coefficients of degree `DEGREE`."""
    x, j = np.linspace(0.0, 1.0, DEGREE + 1)[:, None], np.arange(DEGREE + 1)
    choices = np.array([comb(DEGREE, k) for k in j])
    polynomials = np.asarray(choices * x**j * (1.0 - x) ** (DEGREE - j), dtype=float)
    return read_only(np.linalg.solve(polynomials, chebyshev.chebvander(2.0 * x[:, 0] - 1.0, DEGREE)))


@lru_cache(maxsize=8)
def product_weights(first: int, second: int) -> Array:
    """Return weights (first + second + 1, first + 1, second + 1) of products of coefficients."""
    weights = np.zeros((first + second + 1, first + 1, second + 1))
    for i in range(first + 1):
        for j in range(second + 1):
            weights[i + j, i, j] = comb(first, i) * comb(second, j) / comb(first + second, i + j)
    return read_only(weights)


def multiply(first: Array, second: Array) -> Array:
    """Multiply functions of degrees a and b: coefficients (k, a + b + 1, ...) of the products."""
    weights = product_weights(first.shape[1] - 1, second.shape[1] - 1)
    return np.asarray(np.einsum("jab,ka...,kb...->kj...", weights, first, second))


def elevation(degree: int, to: int) -> Array:
    """Return the matrix (to + 1, degree + 1) that raises the degree of coefficients."""
    return np.asarray(product_weights(to - degree, degree).sum(axis=1))


def mean_size(coefficients: Array, halvings: int) -> Array:
    """Bound the mean sizes (k, ...) of functions (k, size, ...), on halved cells."""
    count, shape = len(coefficients), coefficients.shape[2:]
    for _ in range(halvings):
        current, left, right = coefficients, [], []
        while current.shape[1]:
            left.append(current[:, 0])
            right.append(current[:, -1])
            current = 0.5 * (current[:, 1:] + current[:, :-1])
        halves = np.stack([np.stack(left, axis=1), np.stack(right[::-1], axis=1)], axis=1)
        coefficients = halves.reshape(-1, *coefficients.shape[1:])
    return np.asarray(np.abs(coefficients).reshape(count, -1, *shape).mean(axis=1))
