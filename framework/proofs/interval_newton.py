"""Interval steps for stacks of boxes: linear equations with errors, existence, and bordered systems.

A box is a middle and radii; `LinearEnclosure` holds what equations are in it. `contract` narrows boxes by
linear equations (Hansen and Sengupta 1981; Neumaier, Interval Methods for Systems of Equations, 1990, chapter
5), `existence` is the test of Krawczyk, and `bordered_bounds` encloses Govaerts' measure of singularity.
Rounding is bounded as `rounding` says.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray, IntArray
from framework.proofs.rounding import ROUND_UP, UNIT_ROUNDOFF, gamma, identity_defect, inverses, times

MIN_TERM_RATIO = 1e-12  # of an equation's terms in a box: a smaller one is not solved for
MAX_CONTRACTION = 0.99  # norm of what an approximate inverse leaves: above it matrices may be singular


class LinearEnclosure(NamedTuple):
    """m equations in S boxes: within errors of values + slopes d, d from the middle."""

    values: Array  # (S, m) at the middle
    slopes: Array  # (S, m, k)
    errors: Array  # (S, m) of all else in the box, rounding too

    def combine(self, mixers: Array, radii: Array) -> LinearEnclosure:
        """Enclose the combinations mixers (S, p, m) of the equations in boxes of radii (S, k)."""
        size = np.abs(mixers)
        terms = np.abs(self.values) + times(np.abs(self.slopes), radii)
        rounding = gamma(self.values.shape[1]) * ROUND_UP * terms
        return LinearEnclosure(
            times(mixers, self.values), mixers @ self.slopes, ROUND_UP * times(size, self.errors + rounding)
        )

    def join(self, other: LinearEnclosure) -> LinearEnclosure:
        """Return both enclosures of equations in the same boxes as one."""
        return LinearEnclosure(*(np.concatenate(pair, axis=1) for pair in zip(self, other, strict=True)))


class Contracted(NamedTuple):
    """The parts of S boxes that may hold solutions."""

    lower: Array  # (S, k) off the middle
    upper: Array  # (S, k)

    @property
    def empty(self) -> BoolArray:
        """Whether each holds no solution, (S,)."""
        return np.asarray((self.lower > self.upper).any(axis=1))


def contract(equations: LinearEnclosure, radii: Array, mixers: Array) -> Contracted:
    """Enclose all d with |d| <= radii (S, k) that meet the equations in boxes.

    Each equation is solved for each unknown (hull consistency), as it stands and in the combinations of
    `mixers` (S, p, m), of which `pivoting_mixers` and `damped_mixers` are two kinds.
    """
    values, slopes, errors = equations.join(equations.combine(mixers, radii))
    size = np.abs(slopes)
    terms = size * radii[:, None]  # (S, m + p, k)
    totals = ROUND_UP * (terms.sum(axis=2) + errors)
    rest = ROUND_UP * totals[:, :, None] - terms / ROUND_UP
    useful = terms > MIN_TERM_RATIO * totals[:, :, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.where(useful, -values[:, :, None] / slopes, 0.0)
        half = np.where(useful, ROUND_UP * rest / size + 8 * UNIT_ROUNDOFF * np.abs(root), np.inf)
    lower = np.maximum((root - half).max(axis=1), -radii)
    upper = np.minimum((root + half).min(axis=1), radii)
    impossible = (np.abs(values) > ROUND_UP * totals).any(axis=1)
    lower[impossible], upper[impossible] = 1.0, -1.0
    return Contracted(lower, upper)


def pivoting_mixers(slopes: Array, radii: Array) -> Array:
    """Compute matrices (S, m, m) that make slopes (S, m, k), m <= k, one on m columns.

    The columns are those of the largest terms in the box that are independent, by elimination.
    """
    S, m, k = slopes.shape
    left = slopes * radii[:, None]
    pivots = np.empty((S, m), dtype=np.intp)
    each = np.arange(S)
    for step in range(m):
        row, column = np.divmod(np.abs(left).reshape(S, m * k).argmax(axis=1), k)
        pivots[:, step] = column
        pivot = left[each, row, column]
        shares = left[each, :, column] / np.where(pivot != 0, pivot, 1.0)[:, None]
        left = left - shares[:, :, None] * left[each, row][:, None]
        left[each, row] = 0.0
        left[each, :, column] = 0.0
    return inverses(np.take_along_axis(slopes, pivots[:, None], axis=2))


def damped_mixers(equations: LinearEnclosure, radii: Array) -> Array:
    """Compute the mixers (S, k + m, m), m >= k, of equations that may lose rank in their boxes.

    In units of errors and radii, J = U s V': V s / (s^2 + 1) U', the inverse where s is large, and U'.
    """
    weights = 1.0 / equations.errors
    U, s, Vt = np.linalg.svd(equations.slopes * radii[:, None] * weights[:, :, None], full_matrices=False)
    Ut, V = U.swapaxes(1, 2), Vt.swapaxes(1, 2)
    damped = V * (s / (s**2 + 1.0))[:, None] @ Ut
    return np.concatenate([damped, Ut], axis=1) * weights[:, None]


class LastColumns(NamedTuple):
    """Solutions z of M z = e, e the last unit vector, for M in boxes."""

    valid: BoolArray  # (S,) all matrices are regular
    z: Array  # (S, k)
    error: Array  # (S, k) for all matrices within the errors
    last_error: Array  # (S,) of the last entry for the middle itself


def bordered_bounds(P: Array, errors: Array, rounding: float) -> tuple[LastColumns, LastColumns]:
    """Enclose the bordered systems of P (S, s, s) and of P', for all P within errors (S, s, s).

    M = [P b; c' 0], and b, c are the last singular vectors of P; z is (eta, g), and (psi, g) for M'. Every
    matrix that is singular has g = 0, and where M is regular no other has.
    """
    S, s = P.shape[:2]
    left, _, right = np.linalg.svd(P)
    M = np.block([[P, left[:, :, -1:]], [right[:, -1:], np.zeros((S, 1, 1))]])
    X, E = inverses(M), np.zeros_like(M)
    E[:, :s, :s] = errors + rounding
    Mt, Xt, Et = (stack.swapaxes(1, 2) for stack in (M, X, E))
    return _last_columns(M, X, E, rounding), _last_columns(Mt, Xt, Et, rounding)


def _last_columns(M: Array, X: Array, E: Array, rounding: float) -> LastColumns:
    """Enclose the last columns of the inverses of all matrices within E of M (S, k, k).

    With X near the inverse of M,
    |z - z~| <= |X| (|e - M z~| + E |z~|) + N |z - z~| with N = |1 - X M| + |X| E.
    """
    k, z, size = M.shape[1], X[:, :, -1], np.abs(X)
    N = identity_defect(X, M) + size @ E
    norm = ROUND_UP * N.sum(axis=2).max(axis=1)
    valid = norm < MAX_CONTRACTION
    remaining = np.where(valid, 1.0 - norm, 1.0)
    unit = np.eye(k)[-1]
    residual = np.abs(unit - times(M, z)) + gamma(k) * (times(np.abs(M), np.abs(z)) + unit)
    middle_error = ROUND_UP * times(size, residual + rounding * np.abs(z).sum(axis=1, keepdims=True))
    error = ROUND_UP * times(size, residual + times(E, np.abs(z)))
    largest = ROUND_UP * error.max(axis=1) / remaining
    error = error + ROUND_UP * N.sum(axis=2) * largest[:, None]
    last_error = middle_error[:, -1] + ROUND_UP * N[:, -1].sum(axis=1) * middle_error.max(axis=1) / remaining
    return LastColumns(valid, z, error, last_error)


class Existence(NamedTuple):
    """Existence of one solution for each value of the parameter, in S boxes."""

    proved: BoolArray  # (S,)
    lower: Array  # (S, k) off the middle: all solutions in the box are within
    upper: Array
    along: Array  # (S, k) their slope along the parameter, 1 there itself; 0 without a parameter
    spread: Array  # (S, k) how far they are from middle + along * parameter, 0 for the parameter


def existence(
    values: Array, slopes: Array, changes: Array, errors: Array, radii: Array, parameter: IntArray | None
) -> Existence:
    """Test by Krawczyk's map whether m equations have one solution in each box.

    The k unknowns are m, or m + 1 of which one is a parameter.

    Args:
        values: (S, m) at the middle, with `errors` (S, m).
        slopes: (S, m, k) there; within the radii (S, k) they change by at most `changes` (S, m, k).
        parameter: (S,) the unknown that is one.
    """
    m, is_parameter = values.shape[1], np.zeros(radii.shape, dtype=bool)
    if parameter is not None:
        is_parameter = np.arange(radii.shape[1]) == parameter[:, None]
    others = np.argsort(is_parameter, axis=1, kind="stable")[:, :m]
    Y = inverses(np.take_along_axis(slopes, others[:, None], axis=2))
    root = -times(Y, values)
    error = _krawczyk_error(Y, others, values, slopes, changes, errors, radii)
    error = ROUND_UP * error + gamma(m) * np.abs(root)
    along, spread = np.zeros((2, *radii.shape))
    reach = error
    if parameter is not None:
        slope = -times(Y, slopes[np.arange(len(slopes)), :, parameter])
        np.put_along_axis(along, others, slope, axis=1)
        along[is_parameter] = 1.0
        reach = error + ROUND_UP * np.abs(slope) * radii[is_parameter][:, None]
    inside = ROUND_UP * (np.abs(root) + reach) < np.take_along_axis(radii, others, axis=1)
    lower, upper = -radii.copy(), radii.copy()
    np.put_along_axis(lower, others, root - ROUND_UP * reach, axis=1)
    np.put_along_axis(upper, others, root + ROUND_UP * reach, axis=1)
    np.put_along_axis(spread, others, ROUND_UP * error + np.abs(root), axis=1)
    proved = np.asarray(inside.all(axis=1) & Y.any(axis=(1, 2)))
    return Existence(proved, lower, upper, along, spread)


def _krawczyk_error(
    Y: Array, others: IntArray, values: Array, slopes: Array, changes: Array, errors: Array, radii: Array
) -> Array:
    """Bound the part (S, m) of Krawczyk's map beside root and parameter, see `existence`."""
    m, size = Y.shape[1], np.abs(Y)
    square = np.take_along_axis(slopes, others[:, None], axis=2)
    slack = gamma(m) * (size @ np.abs(slopes)) + size @ changes  # (S, m, k)
    rest = np.abs(np.eye(m) - Y @ square) + gamma(m) * np.eye(m)
    error = times(size, errors + gamma(m) * np.abs(values)) + times(slack, radii)
    return error + times(rest, np.take_along_axis(radii, others, axis=1))
