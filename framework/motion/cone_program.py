"""The best speed along a path as a second-order cone program.

The unknown is the squared speed z along a path parameter, written in any linear basis: z = V y at points of
the path. Then torques and squared motor speeds are affine in y, and with speeds w^2 <= z and slownesses
v w >= 1, both second-order cones, the duration is the integral of v. This file knows no robot, and it is the
only one that knows the solver (Clarabel: Goulart and Chen 2024, arXiv 2405.12762).

Equality rows (the conditions that a crossing puts on the law) are eliminated, y = y_p + N x with N an
orthonormal basis of their null space, so that they hold to rounding whatever the solver's tolerance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sparse

from framework.arrays import Array

RANK = 1e-12  # singular value of normed equalities below which they say nothing new
GOALS = ("time", "peak_torque", "energy")


class Affine(NamedTuple):
    """The numbers matrix @ y + offset."""

    matrix: Array  # (k, n)
    offset: Array  # (k,)

    def __call__(self, y: Array) -> Array:
        return np.asarray(self.matrix @ y + self.offset)


@dataclass(frozen=True, eq=False)
class ConeProgram:
    """What to optimise over the coefficients y (n,) of the squared speed.

    speeds: (P, n) values of z at the points where the duration is integrated.
    average: (C, P), what each slowness v (C,) is the inverse of, in terms of the square roots of `speeds`.
    weights: (C,) of v in the duration.
    positive: (M, n) further places where z is to stay above `floor`.
    torque: (K,) over their limits; |torque| <= 1, or the peak that is minimised.
    below_one: (S, n) what may not be more than 1, such as squared motor speeds over their limits.
    power: (P m,) torques of m motors over their limits at the points of `speeds`; of the energy.
    equalities: (k,) that vanish.
    kept: share of the limits that is left free.
    roughness: (n, n) the matrix R of |R y|^2, which is added to what is minimised.
    """

    speeds: Array
    average: Any
    weights: Array
    positive: Array
    torque: Affine
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


class Infeasible(NamedTuple):
    """No y is admissible: A x + s = b, s in the cone K; `proof` is a q in K's dual, A' q = 0, b' q < 0."""

    proof: Array
    matrix: Any  # A
    right: Array  # b
    cones: tuple[
        int, ...
    ]  # sizes of the second-order cones, the last rows of A; the rest of K is nonnegative


class Unsolved(NamedTuple):
    """The solver gave up."""

    status: str


def solve(
    program: ConeProgram,
    goal: str,
    *,
    limited: bool,
    longest: float | None = None,
    about: Array | None = None,
) -> Optimum | Infeasible | Unsolved:
    """The best admissible y.

    Args:
        goal: "time", "peak_torque" (the largest |torque|), "energy" (the integral of the sum of torque^2) or
            "slowest" (the least integral of z z0^(-3/2), the longest duration to first order about z0).
        limited: |torque| <= 1 is to hold; else the torques are free.
        longest: bound on the duration.
        about: y of z0.
    """
    start, free = eliminate(program.equalities)
    parts = _Parts(free.shape[1], len(program.speeds), len(program.weights), goal == "energy")

    def affine(rows: Array, offset: Array | float = 0.0) -> _Values:
        """Rows on the coefficients, in terms of the unknowns."""
        return _Values(parts.of("x", rows @ free), rows @ start + offset)

    torque = affine(program.torque.matrix, program.torque.offset)
    peak, w, v = (parts.all_of(name) for name in ("peak", "w", "v"))
    linear = [affine(program.positive, -program.floor)]
    linear.append(affine(-program.below_one, (1.0 - program.kept) ** 2))
    if limited:
        linear.append(_Values(-peak.matrix, np.array([1.0 - program.kept])))
    if longest is not None:
        linear.append(_Values(parts.of("v", -program.weights[None]), np.array([longest])))
    z, one, two = affine(program.speeds), np.ones(len(w.offset)), np.full(len(v.offset), 2.0)
    mean = parts.of("w", program.average)
    cones = [
        [z.plus(one), z.plus(-one), _Values(2.0 * w.matrix, 0.0 * one)],  # w^2 <= z
        [
            _Values(v.matrix + mean, 0 * two),
            _Values(v.matrix - mean, 0 * two),
            _Values(0 * mean, two),
        ],  # v w >= 1
    ]
    if limited or goal == "peak_torque":
        largest = _Values(peak.matrix[np.zeros(len(torque.offset), dtype=int)], 0.0 * torque.offset)
        cones.append(
            [largest, torque]
        )  # a cone of two is |torque| <= peak, and has the row of the torque once
    if goal == "energy":  # e w >= the sum of power^2
        power = affine(program.power.matrix, program.power.offset)
        e, motors = parts.all_of("e"), len(power.offset) // len(one)
        each = [_Values(2.0 * power.matrix[k::motors], 2.0 * power.offset[k::motors]) for k in range(motors)]
        cones.append([e + w, e - w, *each])
    cost = np.zeros(parts.size)
    if goal == "time":
        cost[parts.place("v")] = program.weights
    elif goal == "peak_torque":
        cost[parts.place("peak")] = 1.0
    elif goal == "energy":
        cost[parts.place("e")] = program.weights
    else:
        speeds = program.average @ program.speeds
        slowness = np.maximum(speeds @ (start if about is None else about), program.floor) ** -1.5
        cost[parts.place("x")] = (program.weights * slowness / slowness.max()) @ speeds @ free
    rough = program.roughness @ free
    cost[parts.place("x")] += 2.0 * rough.T @ (program.roughness @ start)
    return _optimum(program, parts, (start, free), 2.0 * rough.T @ rough, cost, linear, cones)


def _optimum(
    program: ConeProgram,
    parts: _Parts,
    eliminated: tuple[Array, Array],
    quadratic: Array,
    cost: Array,
    linear: list[_Values],
    cones: list[list[_Values]],
) -> Optimum | Infeasible | Unsolved:
    """Hand it to the solver, which takes A x + s = b with s in the cone K."""
    import clarabel

    groups = [*linear, *(_interleaved(group) for group in cones)]
    matrix = sparse.vstack([-group.matrix for group in groups], format="csc")
    right = np.concatenate([group.offset for group in groups])
    kinds: list[Any] = [clarabel.NonnegativeConeT(sum(len(group.offset) for group in linear))]
    for members in cones:
        kinds += [clarabel.SecondOrderConeT(len(members))] * len(members[0].offset)
    rest = parts.size - len(quadratic)
    upper = sparse.block_diag([np.triu(quadratic), sparse.csc_array((rest, rest))], format="csc")
    for careful in (
        False,
        True,
    ):  # refining each step's solution takes a third of the time, and is rarely needed
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.direct_solve_method = "qdldl"  # the other one takes threads, and no less time
        settings.iterative_refinement_enable = careful
        found = clarabel.DefaultSolver(upper, cost, matrix, right, kinds, settings).solve()
        status = str(found.status)
        if status in ("Solved", "PrimalInfeasible"):
            break
    if status in ("PrimalInfeasible", "AlmostPrimalInfeasible"):
        sizes = tuple(len(members) for members in cones for _ in range(len(members[0].offset)))
        return Infeasible(np.array(found.z), matrix, right, sizes)
    if status not in ("Solved", "AlmostSolved"):
        return Unsolved(status)
    x = np.array(found.x)
    start, free = eliminated
    y = start + free @ x[parts.place("x")]
    peak = float(np.abs(program.torque(y)).max(initial=0.0))
    return Optimum(y, peak, float(program.weights @ x[parts.place("v")]), float(found.obj_val))


class _Values(NamedTuple):
    """The numbers matrix @ unknowns + offset."""

    matrix: Any  # (k, unknowns), sparse
    offset: Array  # (k,)

    def __add__(self, other: _Values) -> _Values:  # type: ignore[override]
        return _Values(self.matrix + other.matrix, self.offset + other.offset)

    def __sub__(self, other: _Values) -> _Values:
        return _Values(self.matrix - other.matrix, self.offset - other.offset)

    def plus(self, offset: Array) -> _Values:
        """With a constant added."""
        return _Values(self.matrix, self.offset + offset)


class _Parts:
    """Where the unknowns are: x of the coefficients, the peak, w and v, and e where energy counts."""

    def __init__(self, n: int, points: int, cells: int, energy: bool) -> None:
        sizes = {"x": n, "peak": 1, "w": points, "v": cells, "e": points if energy else 0}
        self._sizes = sizes
        ends = np.cumsum(list(sizes.values()))
        self._ends = dict(zip(sizes, map(int, ends), strict=True))
        self.size = int(ends[-1])

    def place(self, name: str) -> slice:
        """The columns of a part."""
        return slice(self._ends[name] - self._sizes[name], self._ends[name])

    def of(self, name: str, rows: Any) -> Any:
        """Rows on one part as rows on all unknowns."""
        rows, place = sparse.coo_array(rows), self.place(name)
        return sparse.csr_array(
            (rows.data, (rows.coords[0], rows.coords[1] + place.start)), shape=(rows.shape[0], self.size)
        )

    def all_of(self, name: str) -> _Values:
        """A part itself."""
        return _Values(self.of(name, sparse.eye_array(self._sizes[name])), np.zeros(self._sizes[name]))


def _interleaved(members: list[_Values]) -> _Values:
    """The members (k,) of k cones, cone by cone."""
    k = len(members[0].offset)
    order = np.arange(k * len(members)).reshape(len(members), k).T.ravel()
    matrix = sparse.vstack([member.matrix for member in members], format="csr")
    return _Values(matrix[order], np.concatenate([member.offset for member in members])[order])


def eliminate(equalities: Affine) -> tuple[Array, Array]:
    """y_p (n,) of least size and N (n, n - k) with matrix @ (y_p + N x) + offset = 0 for all x.

    Rows (k, n) that say the same, or nothing, are left out; contradictions are met as well as can be.
    """
    size = np.linalg.norm(equalities.matrix, axis=1)
    size[size == 0] = 1.0
    matrix, offset = equalities.matrix / size[:, None], equalities.offset / size
    left, values, right = np.linalg.svd(matrix)
    rank = int(np.count_nonzero(values > RANK))
    start = -right[:rank].T @ ((left.T @ offset)[:rank] / values[:rank])
    return start, right[rank:].T
