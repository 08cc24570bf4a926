"""The linear combinations of parameters that a regressor determines: the base parameters.

Columns of the regressor are examined in the order of the parameters. If a column is independent of the
columns before it, its parameter leads a base parameter. Otherwise the column is a linear combination of
leading columns, and its parameter is added to their base parameters with the same coefficients (regrouping by
Khalil and Gautier):

    base = parameters[leading] + coefficients @ parameters[dependent].

Khalil and Dombre, "Modeling, Identification and Control of Robots", 2002, section 9.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from framework.kinematics.loop_structure import pivot_rows
from framework.numerics.arrays import Array, IntArray, ReadOnlyArrays
from framework.numerics.ordered_sums import singular_values
from framework.tolerances import RANK_ROUNDING

# coefficients below this share of the largest of their column are zero, with parameters over their sizes
COEFFICIENT_ROUNDING = 1e-7


@dataclass(frozen=True, eq=False)
class Combinations(ReadOnlyArrays):
    """The combinations of p parameters that a regressor (rows, p) determines.

    rank: number of base parameters.
    singular_values: of the regressor with columns of unit length, without zero columns.
    leading: (rank,) indices of the leading parameters, ascending.
    coefficients: (rank, p) of base parameters = coefficients @ parameters, in the units of the parameters;
        the column of a leading parameter is a unit vector.
    without_effect: indices of the parameters whose column is zero.
    """

    rank: int
    singular_values: Array
    leading: IntArray
    coefficients: Array
    without_effect: IntArray

    @property
    def gap(self) -> float:
        """Last singular value within the rank over the next one; infinite at full rank or rank 0."""
        if self.rank == len(self.singular_values) or not self.rank:
            return np.inf
        least = max(self.singular_values[self.rank], np.finfo(float).tiny)
        return float(self.singular_values[self.rank - 1] / least)

    @property
    def unseen(self) -> Array:
        """Directions (p - rank, p) of the parameters that change no base parameter.

        In each direction one non-leading parameter changes by 1, and the leading ones compensate its effect.
        """
        identity = np.eye(self.coefficients.shape[1])
        directions = np.delete(identity, self.leading, axis=0)
        directions[:, self.leading] = -np.delete(self.coefficients, self.leading, axis=1).T
        return directions


def find_combinations(regressor: Array, sizes: Array) -> Combinations:
    """Find the combinations of parameters that a regressor (rows, p) determines.

    Args:
        regressor: derivatives of the data with respect to the p parameters.
        sizes: (p,) typical sizes of the parameters, which make the columns comparable.
    """
    columns = regressor * sizes  # for parameters in units of their typical sizes
    lengths = np.linalg.norm(columns, axis=0)
    has_effect = lengths > RANK_ROUNDING * lengths.max(initial=0.0)
    effective = np.flatnonzero(has_effect)

    # R of unit columns has the same linear dependences and singular values as these columns
    R = np.asarray(np.linalg.qr(columns[:, effective] / lengths[effective], mode="r"))
    values = singular_values(R)
    rank = int(np.sum(values > RANK_ROUNDING * values.max(initial=0.0)))
    independent = _independent_columns(R, rank)
    leading = effective[independent]
    dependent = np.delete(effective, independent)

    # each dependent column of unit length is a combination of leading ones, with weights (rank, dependent)
    weights = np.linalg.lstsq(R[:, independent], np.delete(R, independent, axis=1), rcond=None)[0]
    # parameters over their typical sizes make weights comparable, which shows which of them are rounding
    weights_by_size = weights * lengths[dependent] / lengths[leading, None]
    largest = np.abs(weights_by_size).max(axis=0, initial=0.0)
    weights[np.abs(weights_by_size) <= COEFFICIENT_ROUNDING * np.maximum(largest, 1.0)] = 0.0

    # coefficients are the weights of the regressor's own columns
    regressor_lengths = lengths / sizes
    coefficients = np.zeros((rank, len(sizes)))
    coefficients[:, leading] = np.eye(rank)
    coefficients[:, dependent] = weights * regressor_lengths[dependent] / regressor_lengths[leading, None]
    return Combinations(rank, values, leading, coefficients, without_effect=np.flatnonzero(~has_effect))


def _independent_columns(matrix: Array, rank: int) -> IntArray:
    """Return indices (rank,) of the first independent columns of a matrix, ascending.

    Columns have unit length. By Gram-Schmidt orthogonalisation a column is independent if it is not in the
    span of the independent columns before it. If rounding makes their number differ from the rank, a QR
    decomposition with column pivoting chooses them.
    """
    basis = np.empty((len(matrix), 0))
    independent = []
    for k, column in enumerate(matrix.T):
        remainder = column - basis @ (basis.T @ column)
        remainder -= basis @ (basis.T @ remainder)  # a second time, against rounding
        length = np.linalg.norm(remainder)
        if length > RANK_ROUNDING:
            basis = np.column_stack([basis, remainder / length])
            independent.append(k)
    if len(independent) == rank:
        return np.array(independent, dtype=np.intp)
    return np.sort(pivot_rows(matrix.T)[:rank])


def format_combination(names: Sequence[str], coefficients: Array) -> str:
    """Format a combination of p parameters as text: `a + 0.25 b - c`.

    `names` and `coefficients` (p,) are those of all parameters; at most `max_terms` terms are named.
    """
    max_terms = 8
    nonzero = np.flatnonzero(coefficients)
    if not nonzero.size:
        return "0"
    terms = []
    for k in nonzero[:max_terms]:
        value = coefficients[k]
        # a coefficient of 1 or -1 is not written
        factor = "" if abs(abs(value) - 1.0) < COEFFICIENT_ROUNDING else f"{abs(value):.4g} "
        terms.append(("- " if value < 0 else "+ ") + factor + names[k])
    if len(nonzero) > max_terms:
        terms.append(f"and {len(nonzero) - max_terms} more terms")
    return " ".join(terms).removeprefix("+ ")


def describe_unseen_direction(names: Sequence[str], direction: Array) -> str:
    """Describe a direction (p,) of the parameters `names` that the data do not determine.

    If only two parameters change, and by the same amount, the data determine their difference. If they change
    by opposite amounts, the data determine their sum.
    """
    changed = np.flatnonzero(direction).tolist()
    changed_names = [names[k] for k in changed]
    if len(changed) == 1:
        return f"{changed_names[0]} not at all"
    if len(changed) == 2:
        change_1, change_2 = direction[changed]
        if abs(abs(change_1) - abs(change_2)) < COEFFICIENT_ROUNDING * abs(change_1):
            kind = "difference" if change_1 * change_2 > 0 else "sum"
            return f"{' and '.join(changed_names)} only as their {kind}"
    return f"a change by {format_combination(names, direction)}"
