"""Interval steps for stacks of boxes: linear equations with errors, and bordered systems.

A box is a middle and radii; `LinearEnclosure` holds what equations are in it. `contract` narrows boxes by
linear equations (Hansen and Sengupta 1981; Neumaier, Interval Methods for Systems of Equations, 1990, chapter
5), and `enclose_bordered_solutions` encloses Govaerts' measure of singularity. Existence of solutions is
proved by `krawczyk`. Rounding is bounded as `rounding` says.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.numerics.arrays import Array, BoolArray
from framework.proofs.rounding import (
    ROUND_UP,
    UNIT_ROUNDOFF,
    approximate_inverses,
    gamma,
    identity_defect,
)

MIN_TERM_RATIO = 1e-12  # of an equation's terms in a box: a smaller one is not solved for
MAX_CONTRACTION = 0.99  # norm of what an approximate inverse leaves: above it matrices may be singular


class LinearEnclosure(NamedTuple):
    """m equations over S boxes: values + slopes d, up to errors, d from the middle."""

    values: Array  # (S, m) at the middle
    slopes: Array  # (S, m, k)
    errors: Array  # (S, m) of all else in the box, rounding too

    def combine(self, mixers: Array, radii: Array) -> LinearEnclosure:
        """Enclose the linear combinations mixers (S, p, m) of the equations.

        Boxes have radii (S, k).
        """
        largest = np.abs(self.values) + np.matvec(np.abs(self.slopes), radii)  # (S, m) in the box
        rounding = gamma(self.values.shape[1]) * ROUND_UP * largest
        errors = ROUND_UP * np.matvec(np.abs(mixers), self.errors + rounding)
        return LinearEnclosure(np.matvec(mixers, self.values), mixers @ self.slopes, errors)

    def concatenate(self, *others: LinearEnclosure) -> LinearEnclosure:
        """Return all equations of several enclosures over the same boxes."""
        return LinearEnclosure(*(np.concatenate(parts, axis=1) for parts in zip(self, *others, strict=True)))


class Contracted(NamedTuple):
    """The parts of S boxes that may hold solutions."""

    lower: Array  # (S, k) off the middle
    upper: Array  # (S, k)

    @property
    def empty(self) -> BoolArray:
        """Whether each box holds no solution, (S,)."""
        return np.asarray((self.lower > self.upper).any(axis=1))


def contract(equations: LinearEnclosure, radii: Array, mixers: Array) -> Contracted:
    """Bound all solutions d, |d| <= radii (S, k), of the equations in boxes.

    Each equation is solved for each unknown (hull consistency), as it stands and in the combinations of
    `mixers` (S, p, m), of which `pivoted_inverses` and `damped_inverses` are two kinds: for the unknown j of
    values_i + sum_j slopes_ij d_j within errors_i of 0,

        |d_j + values_i / slopes_ij| <= (sum over the others of |slopes_il| r_l + errors_i) / |slopes_ij|.
    """
    values, slopes, errors = equations.concatenate(equations.combine(mixers, radii))
    terms = np.abs(slopes) * radii[:, None]  # (S, m + p, k)
    totals = ROUND_UP * (terms.sum(axis=2) + errors)  # (S, m + p)
    others = ROUND_UP * totals[:, :, None] - terms / ROUND_UP
    is_useful = terms > MIN_TERM_RATIO * totals[:, :, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.where(is_useful, -values[:, :, None] / slopes, 0.0)
        rounding = 8 * UNIT_ROUNDOFF * np.abs(root)
        half_width = np.where(is_useful, ROUND_UP * others / np.abs(slopes) + rounding, np.inf)
    lower = np.maximum((root - half_width).max(axis=1), -radii)
    upper = np.minimum((root + half_width).min(axis=1), radii)
    is_impossible = (np.abs(values) > ROUND_UP * totals).any(axis=1)
    lower[is_impossible] = 1.0
    upper[is_impossible] = -1.0
    return Contracted(lower, upper)


def pivoted_inverses(slopes: Array, radii: Array) -> Array:
    """Invert m columns of slopes (S, m, k), m <= k: mixers (S, m, m).

    The columns are those of the largest terms in the box that are independent, by Gaussian elimination with
    complete pivoting.
    """
    S, m, k = slopes.shape
    remaining = slopes * radii[:, None]
    pivots = np.empty((S, m), dtype=np.intp)  # columns
    each = np.arange(S)
    for step in range(m):
        # the largest entry left is the pivot; its row and column are eliminated
        row, column = np.divmod(np.abs(remaining).reshape(S, m * k).argmax(axis=1), k)
        pivots[:, step] = column
        pivot = remaining[each, row, column]
        shares = remaining[each, :, column] / np.where(pivot != 0, pivot, 1.0)[:, None]  # (S, m)
        remaining = remaining - shares[:, :, None] * remaining[each, row][:, None]
        remaining[each, row] = 0.0
        remaining[each, :, column] = 0.0
    return approximate_inverses(np.take_along_axis(slopes, pivots[:, None], axis=2))


def damped_inverses(equations: LinearEnclosure, radii: Array) -> Array:
    """Compute mixers (S, k + m, m), m >= k, of slopes that may lose rank.

    In units of errors and radii the slopes are J = U diag(s) V'. The first k mixers are the damped inverse
    V diag(s / (s^2 + 1)) U', which is the inverse where s is large and small where it is not (Levenberg); the
    others are U'.
    """
    weights = 1.0 / equations.errors  # (S, m)
    J = equations.slopes * radii[:, None] * weights[:, :, None]
    U, s, V_rows = np.linalg.svd(J, full_matrices=False)
    U_rows = U.swapaxes(1, 2)
    damping = (s / (s**2 + 1.0))[:, None]
    inverse = V_rows.swapaxes(1, 2) * damping @ U_rows
    return np.concatenate([inverse, U_rows], axis=1) * weights[:, None]


class LastColumns(NamedTuple):
    """Solutions z of M z = e, e the last unit vector, for S intervals of matrices M."""

    valid: BoolArray  # (S,) all matrices are regular
    z: Array  # (S, k)
    error: Array  # (S, k) for all matrices within the errors
    last_error: Array  # (S,) of the last entry for the middle itself


def enclose_bordered_solutions(P: Array, errors: Array, rounding: float) -> tuple[LastColumns, LastColumns]:
    """Enclose the bordered systems of P (S, s, s) and of P', P up to errors.

    M = [P b; c' 0] with the last singular vectors b, c of P. Its solution z of M z = e is (eta, g), that of
    M' z = e is (psi, g). Where M is regular, P is singular exactly if g = 0 (Govaerts 2000).
    """
    S, s = P.shape[:2]
    left, _, right = np.linalg.svd(P)
    b = left[:, :, -1:]
    c = right[:, -1:]
    M = np.block([[P, b], [c, np.zeros((S, 1, 1))]])
    X = approximate_inverses(M)
    M_errors = np.zeros_like(M)
    M_errors[:, :s, :s] = errors + rounding
    M_t, X_t, errors_t = (stack.swapaxes(1, 2) for stack in (M, X, M_errors))
    return _enclose_last_column(M, X, M_errors, rounding), _enclose_last_column(M_t, X_t, errors_t, rounding)


def _enclose_last_column(M: Array, X: Array, M_errors: Array, rounding: float) -> LastColumns:
    """Enclose the last column of M^-1 for all M (S, k, k) within errors.

    X is near the inverse of M, z~ is its last column, and N = |1 - X M| + |X| errors. The exact z has
    |z - z~| <= |X| (|e - M z~| + errors |z~|) + N |z - z~|, so that N with a norm below 1 bounds it
    (Rump, Acta Numerica 2010, section 10).
    """
    k = M.shape[1]
    z = X[:, :, -1]
    unit = np.eye(k)[-1]
    z_size = np.abs(z)
    X_size = np.abs(X)
    row_sums = ROUND_UP * (identity_defect(X, M) + X_size @ M_errors).sum(axis=2)  # (S, k) of N
    norm = row_sums.max(axis=1)
    valid = norm < MAX_CONTRACTION
    residual = np.abs(unit - np.matvec(M, z)) + gamma(k) * (np.matvec(np.abs(M), z_size) + unit)

    def solution_error(product_error: Array) -> Array:
        """Bound |z - z~| (S, k) by the error (S, k) of the product M z~."""
        direct = ROUND_UP * np.matvec(X_size, residual + product_error)
        largest = ROUND_UP * direct.max(axis=1) / np.where(valid, 1.0 - norm, 1.0)
        return direct + row_sums * largest[:, None]

    of_middle = solution_error(rounding * z_size.sum(axis=1, keepdims=True))
    return LastColumns(valid, z, solution_error(np.matvec(M_errors, z_size)), of_middle[:, -1])
