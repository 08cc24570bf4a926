"""Second-order cone programs in named unknowns, and vectors of least norm under semidefinite constraints.

This is the only module that calls the solver (Clarabel: Goulart and Chen 2024, arXiv 2405.12762).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np

from framework.numerics.arrays import Array
from framework.numerics.sparse_rows import SparseRows
from framework.numerics.time_limit import check_time

# regularization of the solver's linear systems, number of refinements of their solutions, and whether rows
# and columns are equilibrated first; tried in turn. The first three solve most programs, and the very first
# takes half the time of the others. The fourth serves programs whose rows the regularization itself keeps
# from closing, the last one sums of squares beside cones of small weight: equilibrated, these stall at once
ATTEMPTS = ((1e-8, 0, True), (3e-8, 2, True), (1e-7, 10, True), (1e-9, 10, True), (1e-8, 0, False))
TOLERANCE = 1e-8  # of a solution, in the units of the optimum
STALLED_RATIO = 10.0  # tolerance of a solution that is accepted although the solver stalls, over `tolerance`
SOLVED = ("Solved", "AlmostSolved")  # statuses of solutions within the first and the second tolerance


class Affine(NamedTuple):
    """The affine function matrix @ y + offset (k,) of y (n,), or a matrix (k, k) that is affine in y."""

    matrix: Any  # (k, n), `SparseRows` or an array; (k, k, n)
    offset: Array  # (k,); (k, k)

    def __call__(self, y: Array) -> Array:
        """Return the values (k,) at y (n,)."""
        return self.matrix @ y + self.offset


class AffineRows(NamedTuple):
    """The affine function (k,): offset plus the sum of parts[name] @ unknowns[name] over all names."""

    parts: Mapping[str, Any]  # sparse matrices (k, size) by name of unknowns
    offset: Array  # (k,)


def linear_rows(**parts: Any) -> AffineRows:
    """Return the linear function (k,) of sparse matrices (k, size) by names of unknowns."""
    count, _ = next(iter(parts.values())).shape
    return AffineRows(parts, np.zeros(count))


@dataclass(frozen=True, eq=False)
class ConeProgram:
    """Minimise a linear cost plus a sum of squares over unknowns that satisfy rows and cones.

    Each item of `cones` is a list of functions (k,) and stands for k second-order cones: in every row the
    value of the first function must be at least the norm of the values of the others.
    """

    sizes: dict[str, int] = field(default_factory=dict)  # number of unknowns by name
    cost: dict[str, Array] = field(default_factory=dict)  # (size,) by name
    square: AffineRows | None = None  # rows whose sum of squares is added to the cost
    equal: list[AffineRows] = field(default_factory=list)  # rows that must be zero
    nonnegative: list[AffineRows] = field(default_factory=list)  # rows that must not be negative
    cones: list[list[AffineRows]] = field(default_factory=list)

    @cached_property
    def columns(self) -> dict[str, slice]:
        """Positions of the unknowns of each name in the vector x (n,) of all unknowns."""
        ends = dict(zip(self.sizes, accumulate(self.sizes.values()), strict=True))
        return {name: slice(end - self.sizes[name], end) for name, end in ends.items()}


def product_cone(
    first: Mapping[str, Any], second: Mapping[str, Any], others: Sequence[AffineRows]
) -> list[AffineRows]:
    """Return the cones 4 first * second >= |others|^2, row by row, for `ConeProgram.cones`.

    They are equivalent to first + second >= |(first - second, others)|.

    Args:
        first, second: linear functions (k,) as sparse matrices (k, size) by name of unknowns, without a
            common name.
        others: affine functions (k,).
    """
    zero = np.zeros(len(others[0].offset))
    minus_second = {name: -matrix for name, matrix in second.items()}
    return [AffineRows({**first, **second}, zero), AffineRows({**first, **minus_second}, zero), *others]


class Unsolved(NamedTuple):
    """The status of a solver that found no optimum."""

    status: str

    @property
    def infeasible(self) -> bool:
        """Whether the solver proved that the rows contradict each other."""
        return self.status == "PrimalInfeasible"


def solve_cone_program(
    program: ConeProgram, *, tolerance: float = TOLERANCE, stalled_gap: float = 0.0
) -> Mapping[str, Array] | Unsolved:
    """Compute the unknowns of least cost by name, or return the solver's status.

    Clarabel minimises x' P x / 2 + q' x subject to A x + slack = b, with the slack in a product of cones.

    Args:
        tolerance: largest duality gap of the cost, absolute and relative, and largest residual of the rows;
            those of a solution at which the solver stalls may be STALLED_RATIO times as large.
        stalled_gap: duality gap that such a solution may also have.
    """
    import clarabel

    check_time()
    objective = _objective(program)
    constraints = _constraints(program)
    for attempt in ATTEMPTS:
        settings = _cone_settings(*attempt, tolerance, max(stalled_gap, STALLED_RATIO * tolerance))
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

    P is returned as its upper triangle. The squares are |R x + r|^2 = x' R'R x + 2 r'R x + |r|^2. The
    constant |r|^2 does not affect the solution and is left out.
    """
    q = np.zeros(sum(program.sizes.values()))
    for name, cost in program.cost.items():
        q[program.columns[name]] += cost
    if program.square is None:
        return SparseRows.zeros((len(q), len(q))).column_major(), q
    R, r = _interleave(program, [[program.square]])  # one group of one member: its matrix and offset
    return (2.0 * R.gram()).upper_triangle().column_major(), q + 2.0 * r @ R


def _constraints(program: ConeProgram) -> tuple[Any, Array, list[Any]]:
    """Return A (m, n), b (m,) and the cones of the slack b - A x.

    The slack consists of the values of the rows: first the rows that must vanish, then those that must not be
    negative, then those of second-order cones.
    """
    import clarabel

    single_rows = [[rows] for rows in (*program.equal, *program.nonnegative)]
    all_rows = _interleave(program, [*single_rows, *program.cones])
    cones: list[Any] = [
        clarabel.ZeroConeT(_count_rows(program.equal)),
        clarabel.NonnegativeConeT(_count_rows(program.nonnegative)),
    ]
    for members in program.cones:
        cones += [clarabel.SecondOrderConeT(len(members))] * _count_rows(members[:1])
    return (-all_rows.matrix).column_major(), all_rows.offset, cones


def _count_rows(functions: Sequence[AffineRows]) -> int:
    """Count the rows of all functions."""
    return sum(len(rows.offset) for rows in functions)


def _interleave(program: ConeProgram, groups: Sequence[Sequence[AffineRows]]) -> Affine:
    """Return groups of rows as one affine function (m,) of all unknowns of a program.

    Each group is a list of members with equally many rows. The result lists the first row of every member of
    the group, then the second row of every member, and so on, so that the rows of one second-order cone are
    neighbours. Row i of member k is row (number of members) * i + k of its group.
    """
    entries = []  # triples of row, column and value, as arrays
    offsets = []
    group_start = 0
    for members in groups:
        offsets.append(np.stack([rows.offset for rows in members], axis=1).ravel())  # row by row
        for k, rows in enumerate(members):
            for name, matrix in rows.parts.items():
                part = SparseRows.of(matrix)
                row = group_start + len(members) * part.row + k
                entries.append((row, program.columns[name].start + part.column, part.values))
        group_start += len(offsets[-1])
    row, column, values = (np.concatenate(parts) for parts in zip(*entries, strict=True))
    shape = (group_start, sum(program.sizes.values()))
    return Affine(SparseRows.sort_entries(row, column, values, shape), np.concatenate(offsets))


def least_norm_semidefinite(matrices: Sequence[Affine], not_negative: Affine) -> Array | Unsolved:
    """Compute the y (n,) of least norm at which symmetric `matrices` (k, k) are positive semidefinite.

    The values of `not_negative` must not be negative at y, either. If the solver finds no such y, its status
    is returned.
    """
    import clarabel
    from scipy import sparse

    # affine functions of y whose values Clarabel calls the slack b - A y, one for each of these cones
    slack = [not_negative, *map(_upper_triangle, matrices)]
    # solve for y / scale, so that the largest slope of every matrix is at least 1: the solver would stop too
    # early with small slopes
    largest_slopes = [float(np.abs(part.matrix).max(initial=0.0)) or 1.0 for part in matrices]
    scale = 1.0 / min(largest_slopes, default=1.0)
    slopes = scale * np.concatenate([part.matrix for part in slack])
    n = slopes.shape[1]
    # the last unknown is the norm, which bounds (y / scale) in a cone: as a quadratic cost the solver cycles
    A = sparse.csc_array(
        -np.block([[slopes, np.zeros((len(slopes), 1))], [np.eye(n + 1)[-1:]], [np.eye(n, n + 1)]])
    )
    b = np.concatenate([*(part.offset for part in slack), np.zeros(n + 1)])
    cones = [
        clarabel.NonnegativeConeT(len(not_negative.offset)),
        *(clarabel.PSDTriangleConeT(len(matrix.offset)) for matrix in matrices),
        clarabel.SecondOrderConeT(n + 1),
    ]
    no_squares = sparse.csc_array((n + 1, n + 1))
    solution = clarabel.DefaultSolver(no_squares, np.eye(n + 1)[-1], A, b, cones, _settings()).solve()
    status = str(solution.status)
    return scale * np.array(solution.x[:-1]) if status in SOLVED else Unsolved(status)


def _upper_triangle(symmetric: Affine) -> Affine:
    """Return the upper triangle of a symmetric matrix by columns, in Clarabel's form.

    Entries off the diagonal are multiplied by sqrt(2), so that the vector has the norm of the matrix.
    """
    # the upper triangle by columns is the lower triangle by rows, transposed
    column, row = np.tril_indices(len(symmetric.offset))
    weight = np.where(row == column, 1.0, np.sqrt(2.0))
    slopes = symmetric.matrix[row, column]  # (entries, n)
    return Affine(weight[:, None] * slopes, weight * symmetric.offset[row, column])


def _cone_settings(
    regularization: float, refinements: int, equilibrated: bool, tolerance: float, stalled_gap: float
) -> Any:
    """Return settings for cone programs, of one of ATTEMPTS, with the tolerances of `solve_cone_program`."""
    max_iterations = 200
    settings = _settings()
    settings.max_iter = max_iterations
    settings.iterative_refinement_enable = refinements > 0
    settings.iterative_refinement_max_iter = refinements
    settings.static_regularization_constant = regularization
    settings.equilibrate_enable = equilibrated
    # fields such as tol_gap_abs of a solution, and reduced_tol_gap_abs of one at which the solver stalls
    gaps = {"gap_abs": stalled_gap, "gap_rel": stalled_gap}
    for measure, stalled in {**gaps, "feas": STALLED_RATIO * tolerance}.items():
        setattr(settings, f"tol_{measure}", tolerance)
        setattr(settings, f"reduced_tol_{measure}", stalled)
    return settings


def _settings() -> Any:
    """Return settings of the solver for no output and one thread."""
    import clarabel

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.direct_solve_method = "qdldl"  # the other method starts threads and is no faster
    return settings
