"""Interval steps for stacks of boxes: bounds from linear equations with errors, existence, inverses.

A box is a middle and radii. All quantities are bounded from above: a product of computed numbers with k terms
is off by at most `gamma(k)` times the sum of their moduli, and sums of numbers without sign are rounded up by
`UP` (as `linalg.krawczyk`; Rump, Verification methods, Acta Numerica 19, 2010). No rounding mode is switched.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray, IntArray
from framework.linalg.krawczyk import UNIT, UP

LEAST = 1e-12  # a pivot below it, relative to the largest term, is no pivot


def gamma(terms: int) -> float:
    """Rounding of a sum of products, relative to the sum of their moduli, eight times over."""
    return 8 * (terms + 4) * UNIT


def inverses(matrices: Array) -> Array:
    """Approximate inverses (S, k, k); zero where there is none."""
    try:
        return np.asarray(np.linalg.inv(matrices))
    except np.linalg.LinAlgError:
        regular = np.linalg.matrix_rank(matrices) == matrices.shape[1]
        found = np.zeros_like(matrices)
        found[regular] = np.linalg.inv(matrices[regular])
        return found


class Contracted(NamedTuple):
    """What is left of boxes."""

    lower: Array  # (S, k) off the middle
    upper: Array  # (S, k)

    @property
    def empty(self) -> BoolArray:
        """Which hold no solution, (S,)."""
        return np.asarray((self.lower > self.upper).any(axis=1))


def contracted(values: Array, slopes: Array, errors: Array, radii: Array) -> Contracted:
    """All d with |d| <= radii (S, k) and |values + slopes d| <= errors (S, m), in boxes.

    Each equation is solved for each unknown (hull consistency), as it stands and after an elimination that
    pivots on the largest terms.
    """
    m = slopes.shape[1]
    Y = _eliminating(slopes, radii)
    mixed = Y @ slopes
    slack = gamma(m) * (np.abs(Y) @ np.abs(slopes))  # (S, m, k)
    off = gamma(m) * np.einsum("sij,sj->si", np.abs(Y), np.abs(values)) * UP
    error = np.einsum("sij,sj->si", np.abs(Y), errors) * UP + np.einsum("sij,sj->si", slack, radii) * UP + off
    values = np.concatenate([values, np.einsum("sij,sj->si", Y, values)], axis=1)
    slopes = np.concatenate([slopes, mixed], axis=1)
    errors = np.concatenate([errors, error], axis=1)
    terms = np.abs(slopes) * radii[:, None]  # (S, 2 m, k)
    whole = terms.sum(axis=2) * UP + errors
    rest = whole[:, :, None] * UP - terms * (1 - 1e-10)
    with np.errstate(divide="ignore", invalid="ignore"):
        middle, half = -values[:, :, None] / slopes, UP * rest / np.abs(slopes)
    useful = np.abs(slopes) * radii[:, None] > LEAST * whole[:, :, None]
    middle = np.where(useful, middle, 0.0)
    half = np.where(useful, half + np.abs(middle) * 1e-15, np.inf)
    lower = np.maximum((middle - half).max(axis=1), -radii)
    upper = np.minimum((middle + half).min(axis=1), radii)
    impossible = (np.abs(values) > whole * UP).any(axis=1)
    lower[impossible], upper[impossible] = 1.0, -1.0
    return Contracted(lower, upper)


def _eliminating(slopes: Array, radii: Array) -> Array:
    """Matrices Y (S, m, m) with Y slopes = 1 on the m columns of largest terms that are independent."""
    S, m, k = slopes.shape
    left = slopes * radii[:, None]
    chosen = np.empty((S, m), dtype=np.intp)
    every = np.arange(S)
    for step in range(m):
        place = np.abs(left).reshape(S, m * k).argmax(axis=1)
        row, column = np.divmod(place, k)
        chosen[:, step] = column
        pivot = left[every, row, column]
        safe = np.where(pivot != 0, pivot, 1.0)
        used = left[every, row].copy()
        left = left - (left[every, :, column] / safe[:, None])[:, :, None] * used[:, None]
        left[every, row] = 0.0
        left[every, :, column] = 0.0
    return inverses(np.take_along_axis(slopes, chosen[:, None], axis=2))


class Bordered(NamedTuple):
    """Solutions of M z = e and z' M = e' for all M within errors of the middle; e the last unit vector."""

    valid: BoolArray  # (S,) every M is regular
    right: Array  # (S, s + 1), at the middle: (eta, g)
    right_errors: Array  # (S, s + 1) for all M
    left: Array  # (S, s + 1), (psi, g)
    left_errors: Array
    g_error: Array  # (S,) of g at the middle itself


def bordered_bounds(P: Array, errors: Array, rounding: float) -> Bordered:
    """The bordered systems [P b; c' 0] of P (S, s, s), for all matrices within errors (S, s, s) of it.

    b, c are the last singular vectors of P. Every matrix that is singular has g = 0, and where M is regular
    only those have. |z - z~| <= |X| (|e - M z~| + E |z~|) + N |z - z~| with X near the inverse of M and
    N = |1 - X M| + |X| E.
    """
    S, s = P.shape[:2]
    left, _, right = np.linalg.svd(P)
    M = np.zeros((S, s + 1, s + 1))
    M[:, :s, :s], M[:, :s, s], M[:, s, :s] = P, left[:, :, -1], right[:, -1]
    X = inverses(M)
    E = np.zeros_like(M)
    E[:, :s, :s] = errors + rounding
    size = np.abs(X)
    off = np.abs(np.eye(s + 1) - X @ M) + gamma(s + 1) * (size @ np.abs(M) + np.eye(s + 1))
    off_left = np.abs(np.eye(s + 1) - M @ X) + gamma(s + 1) * (np.abs(M) @ size + np.eye(s + 1))
    found = []
    for z, own, by, N in (
        (X[:, :, s], M, size, off + size @ E),
        (X[:, s], M.swapaxes(1, 2), size.swapaxes(1, 2), (off_left + E @ size).swapaxes(1, 2)),
    ):
        unit = np.zeros(s + 1)
        unit[s] = 1.0
        moduli = np.einsum("sij,sj->si", np.abs(own), np.abs(z))
        residual = np.abs(unit - np.einsum("sij,sj->si", own, z)) + gamma(s + 1) * (moduli + unit)
        spread = E if own is M else E.swapaxes(1, 2)
        nu = UP * N.sum(axis=2).max(axis=1)
        least = np.einsum("sij,sj->si", by, residual + rounding * np.abs(z).sum(axis=1, keepdims=True)) * UP
        first = np.einsum("sij,sj->si", by, residual + np.einsum("sij,sj->si", spread, np.abs(z))) * UP
        whole = UP * first.max(axis=1) / np.maximum(1 - nu, 1e-3)
        error = first + UP * np.einsum("sij,s->si", N, whole)
        at_middle = least[:, s] + UP * N[:, s].sum(axis=1) * least.max(axis=1) / np.maximum(1 - nu, 1e-3)
        found.append((z, error, nu < 0.99, at_middle))
    (eta, eta_error, one, g_error), (psi, psi_error, two, _) = found
    return Bordered(one & two, eta, eta_error, psi, psi_error, g_error)


class Proved(NamedTuple):
    """Existence of one solution for each value of the parameter, in S boxes."""

    proved: BoolArray  # (S,)
    lower: Array  # (S, k) off the middle: all solutions in the box are within
    upper: Array
    along: Array  # (S, k) their slope along the parameter, 1 there itself; 0 without a parameter
    spread: Array  # (S, k) how far they are from middle + along * parameter, 0 for the parameter


def existence(
    values: Array, slopes: Array, changes: Array, errors: Array, radii: Array, parameter: IntArray | None
) -> Proved:
    """Krawczyk's test for m equations in k = m unknowns, or m + 1 of which one is a parameter.

    Args:
        values: (S, m) at the middle, with `errors` (S, m).
        slopes: (S, m, k) there; within the radii (S, k) they change by at most `changes` (S, m, k).
        parameter: (S,) the unknown that is one.
    """
    S, m, k = slopes.shape
    every = np.arange(S)
    if parameter is None:
        others = np.tile(np.arange(k), (S, 1))
    else:
        others = np.argsort(np.arange(k) == parameter[:, None], axis=1, kind="stable")[:, :m]
    square = np.take_along_axis(slopes, others[:, None], axis=2)
    Y = inverses(square)
    size = np.abs(Y)
    middle = -np.einsum("sij,sj->si", Y, values)
    slack = gamma(m) * (size @ np.abs(slopes)) + size @ changes  # (S, m, k)
    rest = np.abs(np.eye(m) - Y @ square) + gamma(m) * np.eye(m)
    own = np.take_along_axis(radii, others, axis=1)
    off = np.einsum("sij,sj->si", size, errors + gamma(m) * np.abs(values)) * UP
    off = off + UP * np.einsum("sij,sj->si", slack, radii) + UP * np.einsum("sij,sj->si", rest, own)
    off = off + gamma(m) * np.abs(middle)
    along, spread = np.zeros((2, S, k))
    reach = off
    if parameter is not None:
        slope = -np.einsum("sij,sj->si", Y, slopes[every, :, parameter])
        np.put_along_axis(along, others, slope, axis=1)
        along[every, parameter] = 1.0
        reach = off + UP * np.abs(slope) * radii[every, parameter][:, None]
    inside = (np.abs(middle) + reach) * UP < own
    proved = inside.all(axis=1) & (np.abs(Y).max(axis=(1, 2)) > 0)
    lower, upper = -radii.copy(), radii.copy()
    np.put_along_axis(lower, others, middle - UP * reach, axis=1)
    np.put_along_axis(upper, others, middle + UP * reach, axis=1)
    np.put_along_axis(spread, others, UP * off + np.abs(middle), axis=1)
    return Proved(proved, lower, upper, along, spread)
