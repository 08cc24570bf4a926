"""Second-order cone programs in named unknowns, and least squares over semidefinite matrices.

This file knows no robot, and it is the only one that knows the solver (Clarabel: Goulart and Chen 2024,
arXiv 2405.12762).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from framework.arrays import Array

# Of the solver's linear systems, and how often their solutions are refined, in turn: most programs end at the
# first, in half the time of the others.
REGULARIZATIONS = ((1e-8, 0), (3e-8, 2), (1e-7, 10))
MAX_ITERATIONS = 200
TOLERANCE, ACCEPTED = (
    1e-8,
    1e-7,
)  # of the solver, in the units of the optimum; and what is taken where it stalls


class Affine(NamedTuple):
    """The numbers matrix @ y + offset."""

    matrix: Any  # (k, n), sparse or not
    offset: Array  # (k,)

    def __call__(self, y: Array) -> Array:
        return np.asarray(self.matrix @ y + self.offset)


class AffineRows(NamedTuple):
    """The numbers sum of matrix @ unknowns + offset, by the names of the unknowns."""

    parts: Mapping[str, Any]  # sparse matrices (k, size)
    offset: Array  # (k,)


@dataclass(frozen=True, eq=False)
class ConeProgram:
    """Unknowns with what is least, and what they have to keep.

    sizes: of the unknowns, by name.
    cost: linear costs (size,), by name.
    square: the rows whose sum of squares is added to the cost, if any.
    equal, nonnegative: rows that vanish, and rows that are not negative.
    cones: stacks of rows (k,): the first member at least the norm of the others, row by row.
    """

    sizes: Mapping[str, int]
    cost: Mapping[str, Array] = field(default_factory=dict)
    square: AffineRows | None = None
    equal: Sequence[AffineRows] = ()
    nonnegative: Sequence[AffineRows] = ()
    cones: Sequence[Sequence[AffineRows]] = ()


class Optimum(NamedTuple):
    """Unknowns by name, and what was least."""

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
    """Compute the unknowns of least cost, or the status with which the solver ends."""
    import clarabel
    from scipy import sparse

    names, ends = list(program.sizes), np.cumsum([0, *program.sizes.values()])
    places = {name: slice(ends[k], ends[k + 1]) for k, name in enumerate(names)}
    cones: list[Any] = [
        clarabel.ZeroConeT(sum(len(rows.offset) for rows in program.equal)),
        clarabel.NonnegativeConeT(sum(len(rows.offset) for rows in program.nonnegative)),
    ]
    groups = [[rows] for rows in [*program.equal, *program.nonnegative]]
    for members in program.cones:
        groups.append(list(members))
        cones += [clarabel.SecondOrderConeT(len(members))] * len(members[0].offset)
    rows = _interleave(groups, places, ends[-1])
    cost = np.zeros(ends[-1])
    for name, values in program.cost.items():
        cost[places[name]] += values
    quadratic = sparse.csc_array((ends[-1], ends[-1]))
    if program.square is not None:
        root = _interleave([[program.square]], places, ends[-1])
        quadratic = sparse.csc_array(sparse.triu(2.0 * root.matrix.T @ root.matrix))
        cost += 2.0 * root.matrix.T @ root.offset
    problem = quadratic, cost, -rows.matrix, rows.offset, cones
    for regularization, refinements in REGULARIZATIONS:
        settings = _settings()
        settings.max_iter = MAX_ITERATIONS
        settings.iterative_refinement_enable = refinements > 0
        settings.iterative_refinement_max_iter = refinements
        settings.static_regularization_constant = regularization
        for prefix, tolerance in (("", TOLERANCE), ("reduced_", ACCEPTED)):
            for measure in ("gap_abs", "gap_rel", "feas"):
                setattr(settings, f"{prefix}tol_{measure}", tolerance)
        solution = clarabel.DefaultSolver(*problem, settings).solve()
        status = str(solution.status)
        if status in ("Solved", "AlmostSolved", "PrimalInfeasible"):
            break
    if status not in ("Solved", "AlmostSolved"):
        return Unsolved(status)
    x = np.array(solution.x)
    return Optimum({name: x[place] for name, place in places.items()}, float(solution.obj_val))


def _interleave(groups: Sequence[Sequence[AffineRows]], places: Mapping[str, slice], size: int) -> Affine:
    """Return groups one below the other as rows on all unknowns (size,), the members of each row by row."""
    from scipy import sparse

    entries, offsets, first = [], [], 0
    for members in groups:
        offsets.append(np.stack([rows.offset for rows in members], axis=1).ravel())
        for k, rows in enumerate(members):
            for name, matrix in rows.parts.items():
                part = matrix.tocoo()
                row = first + k + len(members) * part.row
                entries.append((part.data, row, places[name].start + part.col))
        first += len(offsets[-1])
    data, row, column = (np.concatenate(values) for values in zip(*entries, strict=True))
    return Affine(sparse.csc_array((data, (row, column)), shape=(first, size)), np.concatenate(offsets))


class LinearMatrix(NamedTuple):
    """The symmetric matrix offset + sum of slopes[..., i] y_i."""

    slopes: Array  # (k, k, n)
    offset: Array  # (k, k)


def semidefinite_least_squares(matrices: Sequence[LinearMatrix], positive: Affine) -> Array | Unsolved:
    """Compute the shortest y (n,) for which matrices are semidefinite and `positive` is not negative.

    Returns:
        y, or `Unsolved` if the solver gives up.
    """
    import clarabel
    from scipy import sparse

    rows, right = [-positive.matrix], [positive.offset]
    cones: list[Any] = [clarabel.NonnegativeConeT(len(positive.offset))]
    for slopes, offset in matrices:
        column, row = np.tril_indices(len(offset))  # of the upper triangle, by columns
        weight = np.where(row == column, 1.0, np.sqrt(2.0))
        rows.append(-weight[:, None] * slopes[row, column])
        right.append(weight * offset[row, column])
        cones.append(clarabel.PSDTriangleConeT(len(offset)))
    count = positive.matrix.shape[1]
    squares = sparse.csc_array(np.eye(count))
    # unknowns that move each matrix by its own size at least: the solver stops short of smaller ones
    scale = 1.0 / min((float(np.abs(slopes).max(initial=0.0)) or 1.0 for slopes, _ in matrices), default=1.0)
    stacked = sparse.csc_array(scale * np.concatenate(rows))
    problem = (squares, np.zeros(count), stacked, np.concatenate(right), cones, _settings())
    solution = clarabel.DefaultSolver(*problem).solve()
    status = str(solution.status)
    return scale * np.array(solution.x) if status in ("Solved", "AlmostSolved") else Unsolved(status)


def _settings() -> Any:
    """Return quiet settings of the solver for one thread."""
    import clarabel

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.direct_solve_method = "qdldl"  # the other one takes threads, and no less time
    return settings
