"""Interval Newton steps for stacks of boxes: linear equations with errors, and bordered systems.

A box has a middle and radii; a `LinearEnclosure` encloses m equations in S boxes of k unknowns. `contract`
narrows boxes by linear equations (Hansen and Sengupta 1981; Neumaier, Interval Methods for Systems of
Equations, 1990, chapter 5), and `enclose_bordered_solutions` encloses Govaerts' measure of singularity.
`krawczyk` proves the existence of solutions. All rounding errors are bounded, see `rounding`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.numerics.arrays import Array, BoolArray
from framework.proofs.rounding import ROUND_UP, approximate_inverses, gamma, identity_defect


class LinearEnclosure(NamedTuple):
    """A linear form of m equations over S boxes, with its error.

    At an offset d from the middle of a box an equation differs from values + slopes d by at most `errors`.
    """

    values: Array  # (S, m) at the middle
    slopes: Array  # (S, m, k)
    errors: Array  # (S, m) rounding included

    def combine(self, mixers: Array, radii: Array) -> LinearEnclosure:
        """Enclose the combinations mixers (S, p, m) of the equations, in boxes of radii (S, k)."""
        largest = np.abs(self.values) + np.matvec(np.abs(self.slopes), radii)  # (S, m) in the box
        rounding = gamma(self.values.shape[1]) * ROUND_UP * largest
        errors = ROUND_UP * np.matvec(np.abs(mixers), self.errors + rounding)
        return LinearEnclosure(np.matvec(mixers, self.values), mixers @ self.slopes, errors)

    def concatenate(self, other: LinearEnclosure) -> LinearEnclosure:
        """Return the equations (S, m + m', k) of two enclosures over the same boxes."""
        return LinearEnclosure(*map(np.hstack, zip(self, other, strict=True)))


class Contracted(NamedTuple):
    """The parts of S boxes that may hold solutions, as offsets from the middles."""

    lower: Array  # (S, k)
    upper: Array  # (S, k) less than `lower` in some coordinate if the box provably holds no solution

    @property
    def empty(self) -> BoolArray:
        """Whether each box provably holds no solution, (S,)."""
        return np.asarray((self.lower > self.upper).any(axis=1))


def contract(equations: LinearEnclosure, radii: Array, mixers: Array) -> Contracted:
    """Bound all solutions d of the equations in boxes, |d| <= r with radii r (S, k).

    Each equation, and each combination of the equations by `mixers` (S, p, m) (`pivoted_inverses` or
    `damped_inverses`), is solved for each unknown in turn (hull consistency). Where values_i + sum_j
    slopes_ij d_j is within errors_i of 0, the unknown j satisfies

        |d_j + values_i / slopes_ij| <= (sum over l != j of |slopes_il| r_l + errors_i) / |slopes_ij|.
    """
    values, slopes, errors = equations.concatenate(equations.combine(mixers, radii))

    # the largest terms slopes_ij d_j, and their sums without the term of the unknown itself
    terms = np.abs(slopes) * radii[:, None]  # (S, m + p, k)
    totals = ROUND_UP * (terms.sum(axis=2) + errors)  # (S, m + p)
    others = ROUND_UP * totals[:, :, None] - terms / ROUND_UP  # (S, m + p, k) the errors and all terms but j

    # each equation bounds each unknown; the intersection of all intervals remains
    with np.errstate(all="ignore"):  # an unknown with the slope 0 has infinite bounds, or NaN
        root = -values[:, :, None] / slopes  # middle of the interval
        half_width = ROUND_UP * others / np.abs(slopes) + gamma(1) * np.abs(root)
        lowest = np.fmax.reduce(root - half_width, axis=1)  # fmax and fmin skip NaN
        highest = np.fmin.reduce(root + half_width, axis=1)
    lower = np.fmax(lowest, -radii)
    upper = np.fmin(highest, radii)

    is_impossible = (np.abs(values) > ROUND_UP * totals).any(axis=1)  # an equation is zero nowhere in the box
    lower[is_impossible] = 1.0  # lower > upper marks an empty box
    upper[is_impossible] = -1.0
    return Contracted(lower, upper)


def pivoted_inverses(slopes: Array, radii: Array) -> Array:
    """Invert m independent columns of slopes (S, m, k), m <= k; return mixers (S, m, m).

    In the mixed equations the matrix of these m unknowns is the identity. The columns are those with the
    largest terms slopes * radii in the box, chosen by Gaussian elimination with complete pivoting.
    """
    S, m, k = slopes.shape
    remaining = slopes * radii[:, None]  # terms that are not eliminated yet
    pivots = np.empty((S, m), dtype=np.intp)  # columns
    box = np.arange(S)  # `box`, `row` and `column` (S,) pick one entry of every box
    for step in range(m):
        # the largest remaining entry is the pivot; its row and column are eliminated
        row, column = np.divmod(np.abs(remaining).reshape(S, m * k).argmax(axis=1), k)
        pivots[:, step] = column
        pivot = remaining[box, row, column]
        multiples = remaining[box, :, column] / np.where(pivot != 0, pivot, 1.0)[:, None]  # (S, m)
        remaining -= multiples[:, :, None] * remaining[box, row][:, None]
        remaining[box, row] = 0.0
        remaining[box, :, column] = 0.0
    return approximate_inverses(np.take_along_axis(slopes, pivots[:, None], axis=2))


def damped_inverses(equations: LinearEnclosure, radii: Array) -> Array:
    """Compute mixers (S, k + m, m), m >= k, from slopes (S, m, k) that may lose rank.

    The mixers combine `equations` in boxes of `radii` (S, k), for `contract`. Divided by the errors and
    multiplied by the radii, the slopes are J = U diag(s) V'. The first k mixers are the damped inverse V
    diag(s / (s^2 + 1)) U' (Levenberg): it inverts large singular values and suppresses small ones. The other
    mixers are U'.
    """
    weights = 1.0 / equations.errors  # (S, m)
    J = equations.slopes * radii[:, None] * weights[:, :, None]
    U, s, V_rows = np.linalg.svd(J, full_matrices=False)
    U_rows = U.swapaxes(1, 2)
    damping = (s / (s**2 + 1.0))[:, None]
    inverse = V_rows.swapaxes(1, 2) * damping @ U_rows
    return np.hstack([inverse, U_rows]) * weights[:, None]


class LastColumns(NamedTuple):
    """Enclosed solutions z of M z = e for S interval matrices M (k, k).

    e is the last unit vector, so z is the last column of the inverse.
    """

    valid: BoolArray  # (S,) whether all matrices of the interval are regular
    z: Array  # (S, k) approximate solution for the middle of the interval
    error: Array  # (S, k) bound on the error of z, for all matrices of the interval
    last_error: Array  # (S,) bound on the error of the last entry of z, for the middle alone


def enclose_bordered_solutions(P: Array, errors: Array, rounding: float) -> tuple[LastColumns, LastColumns]:
    """Enclose the solutions of the bordered systems of P (S, s, s) and P'.

    The bordered matrix is M = [P b; c' 0], with the singular vectors b (left) and c (right) of the least
    singular value of P. With e = (0, ..., 0, 1), M z = e has the solution z = (eta, g), and M' z = e the
    solution (psi, g). Where M is regular, P is singular if and only if g = 0 (Govaerts 2000).

    Args:
        P: (S, s, s) matrices at the middles of S boxes.
        errors: (S, s, s) bounds on the change of the entries of P within a box.
        rounding: bound on the error of the entries of P as computed at the middle.

    Returns:
        The enclosures of (eta, g) and of (psi, g).
    """
    U, _, V_rows = np.linalg.svd(P)  # singular values descend, so the least one is the last
    b = U[:, :, -1:]  # (S, s, 1)
    c_row = V_rows[:, -1:]  # (S, 1, s)
    M = np.block([[P, b], [c_row, np.zeros((len(P), 1, 1))]])  # (S, s + 1, s + 1)
    X = approximate_inverses(M)
    M_errors = np.pad(errors + rounding, ((0, 0), (0, 1), (0, 1)))  # the border is exact
    right = _enclose_last_column(M, X, M_errors, rounding)
    left = _enclose_last_column(M.swapaxes(1, 2), X.swapaxes(1, 2), M_errors.swapaxes(1, 2), rounding)
    return right, left


def _enclose_last_column(M: Array, X: Array, M_errors: Array, rounding: float) -> LastColumns:
    """Enclose the last column z of M^-1 for all M (S, k, k) within errors.

    With X near the inverse of M, z~ its last column and N = |1 - X M| + |X| errors, the exact z satisfies
    |z - z~| <= |X| (|e - M z~| + errors |z~|) + N |z - z~|. This bounds |z - z~| if N has a norm below 1
    (Rump, Acta Numerica 2010, section 10).

    Args:
        X: (S, k, k) near the inverse of M.
        M_errors: (S, k, k) bounds on the change of M within a box.
        rounding: bound on the error of the entries of M at the middle.
    """
    k = M.shape[1]
    z = X[:, :, -1]  # (S, k) z~
    e = np.eye(k)[-1]
    z_size = np.abs(z)
    X_size = np.abs(X)

    row_sums = ROUND_UP * (identity_defect(X, M) + X_size @ M_errors).sum(axis=2)  # (S, k) of N
    norm = row_sums.max(axis=1)
    valid = norm < 1.0

    residual_rounding = gamma(k) * (np.matvec(np.abs(M), z_size) + e)
    residual = np.abs(e - np.matvec(M, z)) + residual_rounding

    def solution_error(product_error: Array) -> Array:
        """Bound |z - z~| (S, k) given the error (S, k) of the product M z~."""
        direct = ROUND_UP * np.matvec(X_size, residual + product_error)  # without the term with N
        largest = ROUND_UP * direct.max(axis=1) / np.where(valid, 1.0 - norm, 1.0)
        return direct + row_sums * largest[:, None]

    middle_error = solution_error(rounding * z_size.sum(axis=1, keepdims=True))
    return LastColumns(valid, z, solution_error(np.matvec(M_errors, z_size)), middle_error[:, -1])
