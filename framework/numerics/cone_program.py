"""Second-order cone programs in named unknowns, and least squares over semidefinite matrices.

This file knows no robot, and it is the only one that knows the solver (Clarabel: Goulart and Chen 2024,
arXiv 2405.12762).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from framework.numerics.arrays import Array
from framework.numerics.time_limit import check_time

# Regularization of the solver's linear systems and number of refinements of their solutions, tried in turn:
# most programs end at the first, in half the time of the others.
REGULARIZATIONS = ((1e-8, 0), (3e-8, 2), (1e-7, 10))
MAX_ITERATIONS = 200
TOLERANCE = 1e-8  # of the solver, in the units of the optimum
STALLED_RATIO = 10.0  # of the tolerance with which a solution is accepted where the solver stalls
SOLVED = ("Solved", "AlmostSolved")  # statuses of a solution within one of these tolerances


class Affine(NamedTuple):
    """The affine function matrix @ y + offset (k,) of y (n,)."""

    matrix: Any  # (k, n), sparse or not
    offset: Array  # (k,)

    def __call__(self, y: Array) -> Array:
        return self.matrix @ y + self.offset


class AffineRows(NamedTuple):
    """The affine function (k,): offset plus the sum of parts[name] @ unknowns[name] over the names."""

    parts: Mapping[str, Any]  # sparse matrices (k, size)
    offset: Array  # (k,)


def linear_rows(**parts: Any) -> AffineRows:
    """Return the linear function (k,) of sparse matrices (k, size) by names of unknowns."""
    count, _ = next(iter(parts.values())).shape
    return AffineRows(parts, np.zeros(count))


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

    @cached_property
    def columns(self) -> dict[str, slice]:
        """Positions of the unknowns of each name in the vector x (n,) of all unknowns."""
        columns = {}
        first = 0
        for name, size in self.sizes.items():
            columns[name] = slice(first, first + size)
            first += size
        return columns


def product_cone(
    first: Mapping[str, Any], second: Mapping[str, Any], others: Sequence[AffineRows]
) -> list[AffineRows]:
    """Return the cone 4 first * second >= |others|^2, row by row, as rows of a `ConeProgram`.

    It is first + second >= |(first - second, others)|, with sparse matrices of `first` and `second` by name
    of their unknowns.
    """
    zero = np.zeros(len(others[0].offset))
    negative = {name: -matrix for name, matrix in second.items()}
    return [AffineRows({**first, **second}, zero), AffineRows({**first, **negative}, zero), *others]


class Unsolved(NamedTuple):
    """No optimum, by the solver's status."""

    status: str

    @property
    def infeasible(self) -> bool:
        """Whether the solver found the rows to contradict each other."""
        return self.status == "PrimalInfeasible"


def solve_cone_program(
    program: ConeProgram, *, tolerance: float = TOLERANCE
) -> Mapping[str, Array] | Unsolved:
    """Compute the unknowns of least cost by name, else the solver's status.

    Clarabel minimises x' P x / 2 + q' x subject to A x + slack = b, with the slack in cones.

    Args:
        tolerance: relative, of the cost and of the rows.
    """
    import clarabel

    check_time()
    objective = _objective(program)
    constraints = _constraints(program)
    for regularization, refinements in REGULARIZATIONS:
        settings = _cone_settings(regularization, refinements, tolerance)
        solution = clarabel.DefaultSolver(*objective, *constraints, settings).solve()
        status = str(solution.status)
        if status in SOLVED or status == "PrimalInfeasible":
            break
    if status not in SOLVED:
        return Unsolved(status)
    x = np.array(solution.x)
    return {name: x[column] for name, column in program.columns.items()}


def _objective(program: ConeProgram) -> tuple[Any, Array]:
    """Return P (n, n) and q (n,) of the cost x' P x / 2 + q' x.

    P is given by its upper triangle. A square is |R x + r|^2 = x' R'R x + 2 r'R x + |r|^2; its constant |r|^2
    is left out.
    """
    from scipy import sparse

    q = np.zeros(sum(program.sizes.values()))
    for name, cost in program.cost.items():
        q[program.columns[name]] += cost
    if program.square is None:
        return sparse.csc_array((len(q), len(q))), q
    R, r = _interleave(program, [[program.square]])
    return sparse.csc_array(sparse.triu(2.0 * R.T @ R)), q + 2.0 * R.T @ r


def _constraints(program: ConeProgram) -> tuple[Any, Array, list[Any]]:
    """Return A (m, n), b (m,) and the cones that the slack b - A x lies in.

    The slack is the value of the rows. Their order is: rows that vanish, rows that are not negative,
    second-order cones.
    """
    import clarabel

    vanishing, nonnegative = ([[rows] for rows in part] for part in (program.equal, program.nonnegative))
    rows = _interleave(program, [*vanishing, *nonnegative, *program.cones])
    cones: list[Any] = [
        clarabel.ZeroConeT(sum(len(rows.offset) for rows in program.equal)),
        clarabel.NonnegativeConeT(sum(len(rows.offset) for rows in program.nonnegative)),
    ]
    for members in program.cones:
        cones += [clarabel.SecondOrderConeT(len(members))] * len(members[0].offset)
    return -rows.matrix, rows.offset, cones


def _interleave(program: ConeProgram, groups: Sequence[Sequence[AffineRows]]) -> Affine:
    """Return groups of rows as one matrix (m, n) on all unknowns.

    Row i of member k stands in row m i + k of a group with m members: first the first row of every member,
    then the second row of every member. So the rows of one second-order cone are neighbours.
    """
    from scipy import sparse

    entries = []
    offsets = []
    group_start = 0
    for members in groups:
        offsets.append(np.stack([rows.offset for rows in members], axis=1).ravel())
        for k, rows in enumerate(members):
            for name, matrix in rows.parts.items():
                part = matrix.tocoo()
                row = group_start + k + len(members) * part.row
                entries.append((part.data, row, program.columns[name].start + part.col))
        group_start += len(offsets[-1])
    data, row, column = (np.concatenate(values) for values in zip(*entries, strict=True))
    shape = (group_start, sum(program.sizes.values()))
    return Affine(sparse.csc_array((data, (row, column)), shape=shape), np.concatenate(offsets))


class LinearMatrix(NamedTuple):
    """The symmetric matrix (k, k): offset plus the sum of slopes[..., i] y_i, affine in y (n,)."""

    slopes: Array  # (k, k, n)
    offset: Array  # (k, k)


def semidefinite_least_squares(matrices: Sequence[LinearMatrix], positive: Affine) -> Array | Unsolved:
    """Compute the shortest y (n,) with positive semidefinite `matrices` and `positive`(y) >= 0.

    Returns:
        y, or `Unsolved` if the solver gives up.
    """
    import clarabel
    from scipy import sparse

    cones = [
        clarabel.NonnegativeConeT(len(positive.offset)),
        *(clarabel.PSDTriangleConeT(len(matrix.offset)) for matrix in matrices),
    ]
    slack = [positive, *map(_upper_triangle, matrices)]
    # Solve for y / scale, so that the largest slope of every matrix is at least 1: the solver stops too early
    # where slopes are small.
    largest_slopes = [float(np.abs(matrix.slopes).max(initial=0.0)) or 1.0 for matrix in matrices]
    scale = 1.0 / min(largest_slopes, default=1.0)
    A = sparse.csc_array(-scale * np.concatenate([part.matrix for part in slack]))
    b = np.concatenate([part.offset for part in slack])
    squares = sparse.csc_array(np.eye(A.shape[1]))
    solution = clarabel.DefaultSolver(squares, np.zeros(A.shape[1]), A, b, cones, _settings()).solve()
    status = str(solution.status)
    return scale * np.array(solution.x) if status in SOLVED else Unsolved(status)


def _upper_triangle(matrix: LinearMatrix) -> Affine:
    """Return the upper triangle of a symmetric matrix by columns, in Clarabel's form.

    Entries off the diagonal are multiplied by sqrt(2), so that the norm is that of the matrix.
    """
    column, row = np.tril_indices(len(matrix.offset))  # of the lower triangle by rows, transposed
    weight = np.where(row == column, 1.0, np.sqrt(2.0))
    return Affine(weight[:, None] * matrix.slopes[row, column], weight * matrix.offset[row, column])


def _cone_settings(regularization: float, refinements: int, tolerance: float) -> Any:
    """Return settings for cone programs: regularization of linear systems, and refinements of solutions."""
    settings = _settings()
    settings.max_iter = MAX_ITERATIONS
    settings.iterative_refinement_enable = refinements > 0
    settings.iterative_refinement_max_iter = refinements
    settings.static_regularization_constant = regularization
    for prefix, share in (("", tolerance), ("reduced_", STALLED_RATIO * tolerance)):
        for measure in ("gap_abs", "gap_rel", "feas"):
            setattr(settings, f"{prefix}tol_{measure}", share)
    return settings


def _settings() -> Any:
    """Return settings of the solver without output and with one thread."""
    import clarabel

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.direct_solve_method = "qdldl"  # the other method starts threads and is not faster
    return settings
