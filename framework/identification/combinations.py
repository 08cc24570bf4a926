"""The linear combinations of parameters that a regressor determines, each led by one parameter.

Columns of the regressor are examined in the order of the parameters. A column that is independent of the
columns before it leads a base parameter. A dependent column is a linear combination of leading ones, and its
parameter is added to their base parameters with these coefficients (regrouping by Khalil and Gautier):

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

# of a coefficient over the largest of its combination, both times the sizes of their parameters
COEFFICIENT_ROUNDING = 1e-7
MAX_TERMS = 8  # of a combination in a text


@dataclass(frozen=True, eq=False)
class Combinations(ReadOnlyArrays):
    """The combinations of p parameters that a regressor (rows, p) determines.

    rank: number of base parameters.
    singular_values: of the regressor with columns of unit length, without zero columns.
    leading: (rank,) the parameters that lead the base parameters, ascending.
    coefficients: (rank, p) base parameters = coefficients @ parameters, in the units of the parameters; the
        column of a leading parameter is a unit vector.
    without_effect: the parameters whose column is zero.
    """

    rank: int
    singular_values: Array
    leading: IntArray
    coefficients: Array
    without_effect: IntArray

    @property
    def gap(self) -> float:
        """Last singular value within the rank over the next one; infinite at full rank."""
        if self.rank == len(self.singular_values) or not self.rank:
            return np.inf
        least = max(float(self.singular_values[self.rank]), float(np.finfo(float).tiny))
        return float(self.singular_values[self.rank - 1]) / least

    @property
    def unseen(self) -> Array:
        """Directions (p - rank, p) of the parameters that change no base parameter.

        In each of them one parameter that leads no base parameter changes by 1, and the leading ones
        compensate.
        """
        others = np.setdiff1d(np.arange(self.coefficients.shape[1]), self.leading)
        directions = np.zeros((len(others), self.coefficients.shape[1]))
        directions[np.arange(len(others)), others] = 1.0
        directions[:, self.leading] = -self.coefficients[:, others].T
        return directions


def find_combinations(regressor: Array, sizes: Array) -> Combinations:
    """Find the combinations of parameters that a regressor (rows, p) determines.

    Args:
        sizes: (p,) typical sizes of the parameters, which make the columns comparable.
    """
    columns = regressor * sizes
    lengths = np.linalg.norm(columns, axis=0)
    seen = np.flatnonzero(lengths > RANK_ROUNDING * lengths.max(initial=0.0))
    R = np.asarray(np.linalg.qr(columns[:, seen] / lengths[seen], mode="r"))  # of columns of unit length
    values = singular_values(R)
    rank = int(np.sum(values > RANK_ROUNDING * values.max(initial=0.0)))
    of_rank = _independent_columns(R, rank)  # among the seen
    others = np.setdiff1d(np.arange(len(seen)), of_rank)
    leading = seen[of_rank]
    dependent = seen[others]

    # each dependent column is a sum of leading ones: R_dependent = R_leading shares
    weights = np.linalg.lstsq(R[:, of_rank], R[:, others], rcond=None)[0]  # (rank, dependent)
    in_sizes = weights * lengths[dependent] / lengths[leading, None]  # of columns in sizes of the parameters
    largest = np.abs(in_sizes).max(axis=0, initial=0.0)
    weights[np.abs(in_sizes) <= COEFFICIENT_ROUNDING * np.maximum(largest, 1.0)] = 0.0

    # in the units of the parameters: a column of unit length is the column of the regressor over its length
    unit_lengths = lengths / sizes
    coefficients = np.zeros((rank, len(sizes)))
    coefficients[np.arange(rank), leading] = 1.0
    coefficients[:, dependent] = weights * unit_lengths[dependent] / unit_lengths[leading, None]
    return Combinations(rank, values, leading, coefficients, np.setdiff1d(np.arange(len(sizes)), seen))


def _independent_columns(matrix: Array, rank: int) -> IntArray:
    """Return the first independent columns (rank,) of a matrix, by index.

    Columns have unit length. Gram and Schmidt: a column is independent if it is not in the span of the
    independent columns before it. Where rounding makes their number differ from the rank, a QR decomposition
    with column pivoting chooses them.
    """
    basis = np.empty((len(matrix), 0))
    independent = []
    for k, column in enumerate(matrix.T):
        remainder = column - basis @ (basis.T @ column)
        remainder -= basis @ (basis.T @ remainder)  # once more, against rounding
        length = np.linalg.norm(remainder)
        if length > RANK_ROUNDING:
            basis = np.column_stack([basis, remainder / length])
            independent.append(k)
    if len(independent) == rank:
        return np.array(independent, dtype=np.intp)
    return np.sort(pivot_rows(matrix.T)[:rank])


def format_combination(names: Sequence[str], coefficients: Array) -> str:
    """Format a combination (p,) of parameters as text: `a + 0.25 b - c`."""
    used = np.flatnonzero(coefficients)
    terms = []
    for k in used[:MAX_TERMS]:
        value = coefficients[k]
        factor = "" if abs(abs(value) - 1.0) < COEFFICIENT_ROUNDING else f"{abs(value):.4g} "
        terms.append(("- " if value < 0 else "+ ") + factor + names[k])
    ending = f" and {len(used) - MAX_TERMS} more terms" if len(used) > MAX_TERMS else ""
    return (" ".join(terms) + ending).removeprefix("+ ") if terms else "0"
