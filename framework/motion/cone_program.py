"""The best speed along a path as a second-order cone program.

The unknown is the squared speed z along a path parameter, written in any linear basis: z = V y at points of
the path. Then torques and squared motor speeds are affine in y, and with speeds w^2 <= z and slownesses
v w >= 1, both second-order cones, the duration is the integral of v. This file knows no robot, and it is the
only one that knows the solver (Clarabel: Goulart and Chen 2024, arXiv 2405.12762).

Equality rows (the conditions that a crossing puts on the law) are eliminated, y = y_p + N x with N an
orthonormal basis of their null space, so that they hold to rounding whatever the solver's tolerance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray, IntArray
from framework.motion.infeasibility import Infeasible
from framework.tolerances import INDEPENDENT_CONDITIONS

GOALS = ("time", "peak_torque", "energy")
REGULARIZATIONS = (1e-9, 1e-7)  # of the solver's linear systems: little, and where that ends in rounding


class Affine(NamedTuple):
    """The numbers matrix @ y + offset."""

    matrix: Array  # (k, n)
    offset: Array  # (k,)

    def __call__(self, y: Array) -> Array:
        return np.asarray(self.matrix @ y + self.offset)


@dataclass(frozen=True, eq=False)
class ConeProgram:
    """A cone program over the coefficients y (n,) of the squared speed.

    speeds: (P, n) values of z at the points where the duration is integrated.
    average: (C, P), what each slowness v (C,) is the inverse of, in terms of the square roots of `speeds`.
    weights: (C,) of v in the duration.
    positive: (M, n) further places where z is to stay above `floor`, as it does at those of `speeds`.
    torque: (K,) over their limits, or over what they are weighed with in the peak that is minimised.
    bounded: (K,) whether |torque| <= 1 is to hold.
    below_one: (S, n) what may not be more than 1, such as squared motor speeds over their limits.
    power: (P m,) torques of m motors over their limits at the points of `speeds`; of the energy.
    equalities: (k,) that vanish.
    kept: share of the limits that is left free.
    roughness: (n, n) the matrix R of |R y|^2, which is added to what is minimised.
    """

    speeds: Array
    average: Array
    weights: Array
    positive: Array
    torque: Affine
    bounded: BoolArray
    below_one: Array
    power: Affine
    equalities: Affine
    roughness: Array
    floor: float = 0.0
    kept: float = 0.0


class Optimum(NamedTuple):
    """Coefficients y (n,) of the squared speed; `peak` of |torque| at the rows of the program."""

    y: Array
    peak: float
    duration: float
    value: float  # of what was minimised, roughness included


class Unsolved(NamedTuple):
    """The solver gave up."""

    status: str


def solve_cone_program(
    program: ConeProgram,
    goal: str,
    *,
    longest: float | None = None,
    about: Array | None = None,
) -> Optimum | Infeasible | Unsolved:
    """Compute the best admissible y, or a valid proof that there is none, or neither.

    Args:
        goal: "time", "peak_torque" (the largest |torque|), "energy" (the integral of the sum of torque^2) or
            "slowest" (the least integral of z z0^(-3/2), the longest duration to first order about z0).
        longest: bound on the duration.
        about: y of z0.
    """
    import clarabel

    formulation = _Formulation.of(program, goal)
    standard = _standard_form(formulation, longest, about)
    # Refined steps take a third of the time, and are needed where the first try ends in rounding; an almost
    # solved program they leave as it is. The solver's own regularisation, 1e-8, keeps coefficients small at
    # the price of up to 0.4 % of what is minimised; with 1e-10 laws are so sharp that springs end at rest to
    # 1e-4 of their largest rate only, with 1e-9 to 1e-6.
    for careful in (False, True):
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.direct_solve_method = "qdldl"  # the other one takes threads, and no less time
        settings.iterative_refinement_enable = careful
        settings.static_regularization_constant = REGULARIZATIONS[careful]
        solution = clarabel.DefaultSolver(
            standard.quadratic, standard.cost, standard.matrix, standard.right, standard.cones, settings
        ).solve()
        status = str(solution.status)
        if status in ("Solved", "AlmostSolved"):
            return formulation.optimum(np.array(solution.x), float(solution.obj_val))
        if status in ("PrimalInfeasible", "AlmostPrimalInfeasible"):
            refuted = Infeasible(np.array(solution.z), *standard[2:4], standard.sizes, standard.equalities)
            if not refuted.holds:
                refuted = refuted.refined()
            if refuted.holds:
                return refuted
    return Unsolved(status)


class _StandardForm(NamedTuple):
    """The solver's: minimise x' quadratic x / 2 + cost x with matrix x + s = right and s in the cones."""

    quadratic: Any  # its upper triangle, sparse
    cost: Array
    matrix: Any  # sparse
    right: Array
    cones: list[Any]
    sizes: tuple[int, ...]  # of the second-order cones
    equalities: int  # the first rows


def _standard_form(formulation: _Formulation, longest: float | None, about: Array | None) -> _StandardForm:
    import clarabel
    import scipy.sparse as sparse

    linear, cones = formulation.nonnegative(longest), formulation.second_order()
    speeds = formulation.speeds_in_unknowns()
    groups = [speeds, *linear, *(_interleaved(group) for group in cones)]
    starts = np.cumsum([0] + [len(group.offset) for group in groups])
    row = np.concatenate([group.row + start for group, start in zip(groups, starts, strict=False)])
    column = np.concatenate([group.column for group in groups])
    value = np.concatenate([group.value for group in groups])
    right = np.concatenate([group.offset for group in groups])
    size = formulation.parts.size
    matrix = sparse.csc_array((-value, (row, column)), shape=(len(right), size))
    sizes = tuple(len(members) for members in cones for _ in range(len(members[0].offset)))
    kinds: list[Any] = [clarabel.ZeroConeT(len(speeds.offset))]
    kinds += [clarabel.NonnegativeConeT(sum(len(group.offset) for group in linear))]
    kinds += [clarabel.SecondOrderConeT(members) for members in sizes]
    quadratic, cost = formulation.objective(about)
    above = np.triu_indices(len(quadratic))
    upper = sparse.csc_array((quadratic[above], above), shape=(size, size))
    return _StandardForm(upper, cost, matrix, right, kinds, sizes, len(speeds.offset))


@dataclass(frozen=True, eq=False)
class _Formulation:
    """A program in the solver's unknowns, `parts`; the coefficients are y = start + free @ x."""

    program: ConeProgram
    goal: str
    start: Array  # (n,)
    free: Array  # (n, n - k)
    parts: _Parts

    @staticmethod
    def of(program: ConeProgram, goal: str) -> _Formulation:
        start, free = eliminate(program.equalities)
        parts = _Parts(free.shape[1], len(program.speeds), len(program.weights), goal == "energy")
        return _Formulation(program, goal, start, free, parts)

    def affine(self, rows: Array, offset: Array | float = 0.0) -> _Values:
        """Return rows on the coefficients, in terms of the unknowns."""
        return self.parts.rows("x", rows @ self.free, rows @ self.start + offset)

    def speeds_in_unknowns(self) -> _Values:
        """Return z at the points less the unknowns that stand for it, which keep the cones sparse: zero."""
        return self.affine(self.program.speeds).and_(self.parts.each("z").times(-1.0))

    def torque_below(self, name: str, rows: BoolArray) -> list[_Values]:
        """Return |torque| <= the unknown of this name, at some rows."""
        largest = self.parts.rows(name, np.ones((int(np.count_nonzero(rows)), 1)))
        torque = self.program.torque
        return [largest, self.affine(torque.matrix[rows], torque.offset[rows])]

    def nonnegative(self, longest: float | None) -> list[_Values]:
        """Return the rows that may not be negative."""
        program, parts = self.program, self.parts
        linear = [self.affine(program.positive, -program.floor), parts.each("z").plus(-program.floor)]
        if self.goal in ("peak_speed", "peak"):
            largest = parts.rows("peak", np.ones((len(program.below_one), 1)))
            linear.append(largest.and_(self.affine(-program.below_one)))
        else:
            linear.append(self.affine(-program.below_one, (1.0 - program.kept) ** 2))
        bounded = program.bounded.any()
        if bounded:
            linear.append(parts.rows("bound", np.array([[-1.0]]), np.array([1.0 - program.kept])))
        if longest is not None:
            linear.append(parts.rows("v", -program.weights[None], np.array([longest])))
        if bounded and self.goal == "peak_torque":
            linear.append(parts.each("peak").and_(parts.each("bound").times(-1.0)))
        return linear

    def second_order(self) -> list[list[_Values]]:
        """Return stacks of cones: the first member of each is at least the norm of the others."""
        program, parts = self.program, self.parts
        w, v = parts.each("w"), parts.each("v")
        z, mean = parts.each("z"), parts.rows("w", program.average)
        cones = [
            [z.plus(1.0), z.plus(-1.0), w.times(2.0)],  # w^2 <= z
            [v.and_(mean), v.and_(mean.times(-1.0)), v.times(0.0).plus(2.0)],  # v w >= 1
        ]
        if program.bounded.any():
            cones.append(self.torque_below("bound", program.bounded))
        if self.goal in ("peak_torque", "peak"):  # each row of a torque is there but once
            cones.append(self.torque_below("peak", ~program.bounded))
        if self.goal == "energy":  # e w >= the sum of power^2
            e, (matrix, offset) = parts.each("e"), program.power
            motors = len(offset) // len(program.speeds)
            each = [self.affine(2.0 * matrix[k::motors], 2.0 * offset[k::motors]) for k in range(motors)]
            cones.append([e.and_(w), e.and_(w.times(-1.0)), *each])
        return cones

    def objective(self, about: Array | None) -> tuple[Array, Array]:
        """Return Q (k, k) on the part x, and c of all unknowns, of the objective x' Q x / 2 + c x."""
        program, parts, start, free = self.program, self.parts, self.start, self.free
        cost = np.zeros(parts.size)
        if self.goal == "time":
            cost[parts.place("v")] = program.weights
        elif self.goal in ("peak_torque", "peak_speed", "peak"):
            cost[parts.place("peak")] = 1.0
        elif self.goal == "energy":
            cost[parts.place("e")] = program.weights
        else:
            speeds = program.average @ program.speeds
            slowness = np.maximum(speeds @ (start if about is None else about), program.floor) ** -1.5
            cost[parts.place("x")] = (program.weights * slowness / slowness.max()) @ speeds @ free
        rough = program.roughness @ free
        cost[parts.place("x")] += 2.0 * rough.T @ (program.roughness @ start)
        return 2.0 * rough.T @ rough, cost

    def optimum(self, unknowns: Array, value: float) -> Optimum:
        """Return the coefficients of the solver's unknowns."""
        y = self.start + self.free @ unknowns[self.parts.place("x")]
        peak = float(np.abs(self.program.torque(y)).max(initial=0.0))
        duration = float(self.program.weights @ unknowns[self.parts.place("v")])
        return Optimum(y, peak, duration, value)


class _Values(NamedTuple):
    """The numbers sum of value * unknown[column] + offset, row by row."""

    row: IntArray
    column: IntArray
    value: Array
    offset: Array  # (k,)

    def and_(self, other: _Values) -> _Values:
        """Return the sum of both."""
        return _Values(
            np.concatenate([self.row, other.row]),
            np.concatenate([self.column, other.column]),
            np.concatenate([self.value, other.value]),
            self.offset + other.offset,
        )

    def times(self, factor: float) -> _Values:
        """Return all multiplied with a number."""
        return _Values(self.row, self.column, factor * self.value, factor * self.offset)

    def plus(self, offset: float) -> _Values:
        """Return all with a constant added."""
        return self._replace(offset=self.offset + offset)


class _Parts:
    """The places of the unknowns.

    They are x of the coefficients, the largest torque of those bounded and of all, w, z and v, and e of the
    energy.
    """

    def __init__(self, n: int, points: int, cells: int, energy: bool) -> None:
        sizes = {
            "x": n,
            "bound": 1,
            "peak": 1,
            "w": points,
            "z": points,
            "v": cells,
            "e": points if energy else 0,
        }
        self._sizes = sizes
        ends = np.cumsum(list(sizes.values()))
        self._ends = dict(zip(sizes, map(int, ends), strict=True))
        self.size = int(ends[-1])

    def place(self, name: str) -> slice:
        """Return the columns of a part."""
        return slice(self._ends[name] - self._sizes[name], self._ends[name])

    def rows(self, name: str, matrix: Array, offset: Array | None = None) -> _Values:
        """Return matrix @ part + offset."""
        row, column = np.nonzero(matrix)
        constant = np.zeros(len(matrix)) if offset is None else offset
        return _Values(row, column + self.place(name).start, matrix[row, column], constant)

    def each(self, name: str) -> _Values:
        """Return a part itself."""
        k = np.arange(self._sizes[name])
        return _Values(k, k + self.place(name).start, np.ones(len(k)), np.zeros(len(k)))


def _interleaved(members: list[_Values]) -> _Values:
    """Return the members (k,) of k cones, cone by cone."""
    count = len(members)
    return _Values(
        np.concatenate([count * member.row + place for place, member in enumerate(members)]),
        np.concatenate([member.column for member in members]),
        np.concatenate([member.value for member in members]),
        np.stack([member.offset for member in members], axis=1).ravel(),
    )


def eliminate(equalities: Affine) -> tuple[Array, Array]:
    """Find y_p (n,) of least size and N (n, n - k) with matrix @ (y_p + N x) + offset = 0 for all x.

    Rows (k, n) that say the same, or nothing, are left out; contradictions are met as well as can be.
    """
    size = np.linalg.norm(equalities.matrix, axis=1)
    size[size == 0] = 1.0
    matrix, offset = equalities.matrix / size[:, None], equalities.offset / size
    left, values, right = np.linalg.svd(matrix)
    rank = int(np.count_nonzero(values > INDEPENDENT_CONDITIONS))
    start = -right[:rank].T @ ((left.T @ offset)[:rank] / values[:rank])
    return start, right[rank:].T


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
    import scipy.sparse as sparse

    rows, right = [-positive.matrix], [positive.offset]
    cones: list[Any] = [clarabel.NonnegativeConeT(len(positive.offset))]
    for slopes, offset in matrices:
        column, row = np.tril_indices(len(offset))  # of the upper triangle, by columns
        weight = np.where(row == column, 1.0, np.sqrt(2.0))
        rows.append(-weight[:, None] * slopes[row, column])
        right.append(weight * offset[row, column])
        cones.append(clarabel.PSDTriangleConeT(len(offset)))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.direct_solve_method = "qdldl"
    count = positive.matrix.shape[1]
    squares = sparse.csc_array(np.eye(count))
    # unknowns that move each matrix by its own size at least: the solver stops short of smaller ones
    scale = 1.0 / min((float(np.abs(slopes).max(initial=0.0)) or 1.0 for slopes, _ in matrices), default=1.0)
    stacked = sparse.csc_array(scale * np.concatenate(rows))
    problem = (squares, np.zeros(count), stacked, np.concatenate(right), cones, settings)
    solution = clarabel.DefaultSolver(*problem).solve()
    status = str(solution.status)
    return scale * np.array(solution.x) if status in ("Solved", "AlmostSolved") else Unsolved(status)
