"""Second-order cone programs in named unknowns, and least squares over semidefinite matrices.

This file knows no robot, and it is the only one that knows the solver (Clarabel: Goulart and Chen 2024,
arXiv 2405.12762).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from framework.numerics.arrays import Array
from framework.numerics.time_limit import check_time

# Of the solver's linear systems, and how often their solutions are refined, in turn: most programs end at the
# first, in half the time of the others.
REGULARIZATIONS = ((1e-8, 0), (3e-8, 2), (1e-7, 10))
MAX_ITERATIONS = 200
# of the solver, in the units of the optimum; and that with which a solution is accepted where it stalls
TOLERANCE, STALLED_TOLERANCE = 1e-8, 1e-7


class Affine(NamedTuple):
    """The affine function matrix @ y + offset (k,) of y (n,)."""

    matrix: Any  # (k, n), sparse or not
    offset: Array  # (k,)

    def __call__(self, y: Array) -> Array:
        return np.asarray(self.matrix @ y + self.offset)


class AffineRows(NamedTuple):
    """The affine function (k,): offset plus the sum of parts[name] @ unknowns[name] over the names."""

    parts: Mapping[str, Any]  # sparse matrices (k, size)
    offset: Array  # (k,)


@dataclass(frozen=True, eq=False)
class ConeProgram:
    """Minimise a linear cost plus a sum of squares over unknowns that satisfy rows and cones.

    sizes: numbers of unknowns, by name.
    cost: linear costs (size,), by name.
    square: rows whose sum of squares is added to the cost, if any.
    equal, nonnegative: rows that must be zero; rows that must not be negative.
    cones: each a list of rows (k,); in each of the k rows the first must be at least the norm of the others.
    """

    sizes: Mapping[str, int]
    cost: Mapping[str, Array] = field(default_factory=dict)
    square: AffineRows | None = None
    equal: Sequence[AffineRows] = ()
    nonnegative: Sequence[AffineRows] = ()
    cones: Sequence[Sequence[AffineRows]] = ()


class Optimum(NamedTuple):
    """The unknowns by name, and the least cost."""

    unknowns: Mapping[str, Array]
    value: float


class Unsolved(NamedTuple):
    """No optimum, by the solver's status."""

    status: str

    @property
    def infeasible(self) -> bool:
        """Whether the solver found the rows to contradict each other."""
        return self.status == "PrimalInfeasible"


def solve_cone_program(program: ConeProgram) -> Optimum | Unsolved:
    """Compute the unknowns of least cost, or the status with which the solver ends.

    Clarabel minimises x' P x / 2 + q' x subject to A x + slack = b with the slack in cones: rows that vanish
    first, then rows that are not negative, then second-order cones.
    """
    import clarabel
    from scipy import sparse

    check_time()
    names, ends = list(program.sizes), np.cumsum([0, *program.sizes.values()])
    columns = {name: slice(ends[k], ends[k + 1]) for k, name in enumerate(names)}
    cones: list[Any] = [
        clarabel.ZeroConeT(sum(len(rows.offset) for rows in program.equal)),
        clarabel.NonnegativeConeT(sum(len(rows.offset) for rows in program.nonnegative)),
    ]
    groups = [[rows] for rows in [*program.equal, *program.nonnegative]]
    for members in program.cones:
        groups.append(list(members))
        cones += [clarabel.SecondOrderConeT(len(members))] * len(members[0].offset)
    rows = _interleave(groups, columns, ends[-1])
    cost = np.zeros(ends[-1])
    for name, values in program.cost.items():
        cost[columns[name]] += values
    quadratic = sparse.csc_array((ends[-1], ends[-1]))
    if program.square is not None:  # |R x + r|^2 = x' R'R x + 2 r'R x + constant
        root = _interleave([[program.square]], columns, ends[-1])
        quadratic = sparse.csc_array(sparse.triu(2.0 * root.matrix.T @ root.matrix))
        cost += 2.0 * root.matrix.T @ root.offset
    problem = quadratic, cost, -rows.matrix, rows.offset, cones
    for regularization, refinements in REGULARIZATIONS:
        settings = _cone_settings(regularization, refinements)
        solution = clarabel.DefaultSolver(*problem, settings).solve()
        status = str(solution.status)
        if status in ("Solved", "AlmostSolved", "PrimalInfeasible"):
            break
    if status not in ("Solved", "AlmostSolved"):
        return Unsolved(status)
    x = np.array(solution.x)
    unknowns = {name: x[column] for name, column in columns.items()}
    return Optimum(unknowns, float(solution.obj_val))


def _interleave(groups: Sequence[Sequence[AffineRows]], columns: Mapping[str, slice], size: int) -> Affine:
    """Return all groups, one below the other, as rows on the vector of all unknowns (size,).

    Members of a group are interleaved: first the first row of every member, then the second row of every
    member. So the rows of one second-order cone are neighbours.
    """
    from scipy import sparse

    entries, offsets, first = [], [], 0
    for members in groups:
        offsets.append(np.stack([rows.offset for rows in members], axis=1).ravel())
        for k, rows in enumerate(members):
            for name, matrix in rows.parts.items():
                part = matrix.tocoo()
                row = first + k + len(members) * part.row
                entries.append((part.data, row, columns[name].start + part.col))
        first += len(offsets[-1])
    data, row, column = (np.concatenate(values) for values in zip(*entries, strict=True))
    return Affine(sparse.csc_array((data, (row, column)), shape=(first, size)), np.concatenate(offsets))


class LinearMatrix(NamedTuple):
    """The symmetric matrix (k, k): offset plus the sum of slopes[..., i] y_i, affine in y (n,)."""

    slopes: Array  # (k, k, n)
    offset: Array  # (k, k)


def semidefinite_least_squares(matrices: Sequence[LinearMatrix], positive: Affine) -> Array | Unsolved:
    """Compute the shortest y (n,) with positive semidefinite `matrices` and `positive`(y) >= 0.

    The solver takes a symmetric matrix as its upper triangle by columns, entries off the diagonal times
    sqrt(2).

    Returns:
        y, or `Unsolved` if the solver gives up.
    """
    import clarabel
    from scipy import sparse

    rows, offsets = [-positive.matrix], [positive.offset]
    cones: list[Any] = [clarabel.NonnegativeConeT(len(positive.offset))]
    for slopes, offset in matrices:
        column, row = np.tril_indices(len(offset))  # transposed: the upper triangle by columns
        weight = np.where(row == column, 1.0, np.sqrt(2.0))
        rows.append(-weight[:, None] * slopes[row, column])
        offsets.append(weight * offset[row, column])
        cones.append(clarabel.PSDTriangleConeT(len(offset)))
    count = positive.matrix.shape[1]
    squares = sparse.csc_array(np.eye(count))
    # Solve for y / scale, so that the largest slope of every matrix is at least 1: the solver stops too early
    # where slopes are small.
    largest_slopes = [float(np.abs(slopes).max(initial=0.0)) or 1.0 for slopes, _ in matrices]
    scale = 1.0 / min(largest_slopes, default=1.0)
    scaled_rows = sparse.csc_array(scale * np.concatenate(rows))
    problem = (squares, np.zeros(count), scaled_rows, np.concatenate(offsets), cones, _settings())
    solution = clarabel.DefaultSolver(*problem).solve()
    status = str(solution.status)
    return scale * np.array(solution.x) if status in ("Solved", "AlmostSolved") else Unsolved(status)


def _cone_settings(regularization: float, refinements: int) -> Any:
    """Return settings for cone programs: regularization of linear systems, and refinements of solutions."""
    settings = _settings()
    settings.max_iter = MAX_ITERATIONS
    settings.iterative_refinement_enable = refinements > 0
    settings.iterative_refinement_max_iter = refinements
    settings.static_regularization_constant = regularization
    for prefix, tolerance in (("", TOLERANCE), ("reduced_", STALLED_TOLERANCE)):
        for measure in ("gap_abs", "gap_rel", "feas"):
            setattr(settings, f"{prefix}tol_{measure}", tolerance)
    return settings


def _settings() -> Any:
    """Return settings of the solver without output and with one thread."""
    import clarabel

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.direct_solve_method = "qdldl"  # the other method starts threads and is not faster
    return settings
