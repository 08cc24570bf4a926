"""The linear combinations of parameters that a regressor determines, each led by one parameter.

Columns of the regressor are taken in the order of the parameters. A column that depends on its predecessors
is regrouped with them, as by Khalil and Gautier; the others lead the base parameters

    base = parameters[leading] + coefficients of the dependent ones.

Khalil and Dombre, "Modeling, Identification and Control of Robots", 2002, section 9.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from framework.arrays import Array, IntArray, ReadOnlyArrays
from framework.kinematics.loop_structure import row_pivots
from framework.linalg.ordered_sums import singular_values
from framework.tolerances import RANK_ROUNDING

COEFFICIENT_ROUNDING = (
    1e-7  # of a coefficient over the largest of its combination, in sizes of the parameters
)
MAX_TERMS = 8  # of a combination in a text


@dataclass(frozen=True, eq=False)
class Combinations(ReadOnlyArrays):
    """The combinations of p parameters that a regressor (rows, p) determines.

    rank: number of base parameters.
    singular_values: of the regressor with columns of unit length, those without effect left out.
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
        """The last singular value within the rank over the next one; infinite at full rank."""
        if self.rank == len(self.singular_values) or not self.rank:
            return np.inf
        least = max(float(self.singular_values[self.rank]), float(np.finfo(float).tiny))
        return float(self.singular_values[self.rank - 1]) / least

    @property
    def unseen(self) -> Array:
        """Return directions (p - rank, p) of the parameters that change no base parameter.

        Along each of them one parameter that leads none changes by 1, and leading ones compensate.
        """
        others = np.setdiff1d(np.arange(self.coefficients.shape[1]), self.leading)
        directions = np.zeros((len(others), self.coefficients.shape[1]))
        directions[np.arange(len(others)), others] = 1.0
        directions[:, self.leading] = -self.coefficients[:, others].T
        return directions


def determined_combinations(regressor: Array, sizes: Array) -> Combinations:
    """Compute the combinations of parameters that a regressor (rows, p) determines.

    Args:
        sizes: (p,) typical sizes of the parameters, which make the columns comparable.
    """
    columns = regressor * sizes
    lengths = np.linalg.norm(columns, axis=0)
    seen = np.flatnonzero(lengths > RANK_ROUNDING * lengths.max(initial=0.0))
    compact = np.asarray(np.linalg.qr(columns[:, seen] / lengths[seen], mode="r"))
    values = singular_values(compact)
    rank = int(np.sum(values > RANK_ROUNDING * values.max(initial=0.0)))
    leading = _leading(compact, rank)
    others = np.setdiff1d(np.arange(len(seen)), leading)
    regrouped = np.zeros((rank, regressor.shape[1]))
    regrouped[np.arange(rank), seen[leading]] = 1.0
    shares = np.linalg.lstsq(compact[:, leading], compact[:, others], rcond=None)[0]
    weights = lengths[seen] / sizes[seen]
    # columns in units of the parameters; shares at rounding are zero
    for_sizes = shares * lengths[seen[others]] / lengths[seen[leading], None]
    largest = np.abs(for_sizes).max(axis=0, initial=0.0)
    shares[np.abs(for_sizes) <= COEFFICIENT_ROUNDING * np.maximum(largest, 1.0)] = 0.0
    regrouped[:, seen[others]] = shares * weights[others] / weights[leading, None]
    without = np.setdiff1d(np.arange(regressor.shape[1]), seen)
    return Combinations(rank, values, seen[leading], regrouped, without)


def _leading(matrix: Array, rank: int) -> IntArray:
    """Return the first `rank` independent columns of a matrix with columns of unit length.

    A column is independent if it leaves the span of its predecessors. If rounding makes them too many or too
    few, they are those of a QR decomposition with column pivoting.
    """
    basis, leading = np.empty((len(matrix), 0)), []
    for k, column in enumerate(matrix.T):
        rest = column - basis @ (basis.T @ column)
        rest -= basis @ (basis.T @ rest)
        length = np.linalg.norm(rest)
        if length > RANK_ROUNDING:
            basis = np.column_stack([basis, rest / length])
            leading.append(k)
    if len(leading) == rank:
        return np.array(leading, dtype=np.intp)
    return np.sort(row_pivots(matrix.T)[:rank])


def combination_text(names: Sequence[str], coefficients: Array) -> str:
    """Return a combination (p,) of parameters as text: `a + 0.25 b - c`."""
    used = np.flatnonzero(coefficients)
    terms = []
    for k in used[:MAX_TERMS]:
        value = coefficients[k]
        size = "" if abs(abs(value) - 1.0) < COEFFICIENT_ROUNDING else f"{abs(value):.4g} "
        terms.append(("- " if value < 0 else "+ ") + size + names[k])
    rest = f" and {len(used) - MAX_TERMS} more terms" if len(used) > MAX_TERMS else ""
    return (" ".join(terms) + rest).removeprefix("+ ") if terms else "0"
