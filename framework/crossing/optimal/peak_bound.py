"""Bounds of every law: of its peak of torque or duration, and the proof that there is none within limits.

They hold for rigid robots with as many motors as axes whose path crosses the locus, and for all laws that
advance from rest to rest, however fine. Elsewhere there is no bound, and nothing is proved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, IntArray, ReadOnlyArrays
from framework.crossing.crossing_points import PathToCross
from framework.crossing.optimal.dual_program import DualProgram, Evidence, Multipliers
from framework.crossing.optimal.law_problem import LawProblem
from framework.crossing.optimal.optimal_task import Task
from framework.crossing.optimal.path_series import PathSeries, cut_cells, resolve_series, uniform_cells
from framework.crossing.optimal.phase_plane import demand
from framework.crossing.result import CrossingPlan
from framework.motion.optimal_law import Smoothstep
from framework.singularity.points_on_path import search_path
from framework.tolerances import BOUND_MARGIN

FIRST_CELLS, MAX_CELLS, MAX_REFINEMENTS = 100, 400, 6
MIN_GAIN = 1e-3  # of a bound by more cells
MAX_MARGINS = 3  # with which a program is solved until its factor is proved
ERROR_GROWTH = 1.5  # of errors on a part of a cell over what its last multipliers make of them
CUT_SHARES = (1.5, 6.0)  # of |nu|_1 on a cell over the mean, above which it is cut in two and in four


@dataclass(frozen=True, eq=False)
class PeakBound(ReadOnlyArrays):
    """A bound of every law, with the multipliers from which it follows (`dual_program`).

    by_duality: the peak of torque over the reference that no law is below, or the duration [s].
    at_rest: the peak that every law has at its ends, where s' = s" = 0; zero where s" need not vanish.
    reference: (n_a,) [N m]; torques of motors where it is infinite do not count.
    edges: (k + 1,) of cells in s, on which the multipliers are constant or polynomials in Bernstein form.
    p: (k, 3) and across: (k, 3, m) give nu = 2 p cu / |cu|^2 + across less its share along cu, of the torques
        of the m motors that count, over the reference.
    mu: (k, n) of the n motors with a limit of speed. lam: lambda.
    """

    by_duality: float
    at_rest: float
    reference: Array
    edges: Array
    p: Array
    across: Array
    mu: Array
    lam: float

    @property
    def value(self) -> float:
        """The number that no law is below."""
        return max(self.by_duality, self.at_rest)


def bound_peak(task: Task, reference: Array) -> PeakBound | None:
    """Compute a bound of the peak of torque over a reference (n_a,).

    Limits of speed and the duration count, limits of torque do not.
    """
    proof = _prove(task, reference, timed=False)
    return proof and _bound_of(proof, reference, _peak_at_rest(task, reference))


def bound_duration(task: Task) -> PeakBound | None:
    """Compute a bound of the duration [s] within the limits of torque and speed."""
    limit = task.specification.torque_limit
    proof = _prove(task, limit, timed=True)
    return proof and _bound_of(proof, limit, 0.0)


def prove_no_law(problem: LawProblem) -> PeakBound | None:
    """Return a bound of the peak over the limits that is above 1, if there is one: no law keeps them."""
    return None if problem.deflections is not None else find_refuting_bound(problem.task)


def find_refuting_bound(task: Task) -> PeakBound | None:
    """Return the same for the task of an undeformed robot."""
    bound = bound_peak(task, task.specification.torque_limit)
    return bound if bound is not None and bound.value > 1.0 + BOUND_MARGIN else None


def bound_plan(plan: CrossingPlan) -> PeakBound | None:
    """Compute a bound of what the law of a plan was optimised for, duration [s] or peak; None for others."""
    if plan.optimality is None or plan.optimality.specification.goal == "energy":
        return None
    specification = plan.optimality.specification
    searched = search_path(plan.robot, plan.path).under(plan.dynamics.wrenches)
    task = Task(PathToCross(searched, searched.points), plan.request, specification)
    if specification.goal == "time":
        return bound_duration(task)
    limited = specification.limited_motors
    return bound_peak(task, np.where(limited, specification.torque_limit, plan.optimality.reference))


class _Proof(NamedTuple):
    """Multipliers on the cells of a series, and what they prove."""

    series: PathSeries
    multipliers: Multipliers
    evidence: Evidence

    @property
    def complete(self) -> bool:
        return self.evidence.value > 0.0 and not self.evidence.lacking.any()


def _bound_of(proof: _Proof, reference: Array, at_rest: float) -> PeakBound:
    """Return the bound of a proof."""
    series, found = proof.series, proof.multipliers
    across = found.x[..., 1:] @ series.directions
    multipliers = found.x[..., 0], across, found.mu, found.lam
    return PeakBound(proof.evidence.value, at_rest, reference, series.edges, *multipliers)


def _prove(task: Task, reference: Array, *, timed: bool) -> _Proof | None:
    """Find multipliers on ever smaller cells where |nu| is large, and return those of the best bound."""
    robot, points = task.branch.robot, task.to_cross.points
    crossed = all(point.corank == 1 and point.contact != "tangential" for point in points)
    if robot.n_e or robot.n_a != robot.n or not crossed or not np.isfinite(reference).any():
        return None
    best: _Proof | None = None
    last: _Proof | None = None
    edges = uniform_cells(task, FIRST_CELLS)
    for _ in range(MAX_REFINEMENTS):
        series = resolve_series(task, reference, edges)
        last = series and _solve(DualProgram(series, None if timed else task.specification.most, timed), last)
        if last is None:
            break
        shares = last.evidence.shares * len(last.evidence.shares)
        if last.complete:
            gain = np.inf if best is None else last.evidence.value / best.evidence.value - 1.0
            best = last if best is None or gain > 0.0 else best
            if gain < MIN_GAIN:
                break
        parts = 1 + (shares > CUT_SHARES[0]) + 2 * (shares > CUT_SHARES[1])
        parts = _with_neighbours(np.where(last.evidence.lacking > 0.0, np.maximum(parts, 2), parts))
        if parts.sum() > MAX_CELLS:
            break
        edges = cut_cells(task, last.series.edges, parts)
    return best


def _with_neighbours(parts: IntArray) -> IntArray:
    """Return into how many parts (k,) cells are cut that are not to be much wider than their neighbours."""
    padded = np.pad(parts, 1, constant_values=1)
    return np.maximum(parts, np.maximum(padded[:-2], padded[2:]))


def _solve(program: DualProgram, before: _Proof | None) -> _Proof | None:
    """Solve with growing margins until the factor is proved; the first is what `before` lets expect."""
    series = program.series
    margin = 2.0 * program.rounding
    if before is not None:
        middle = 0.5 * (series.edges[1:] + series.edges[:-1])
        cell = np.searchsorted(before.series.edges, middle) - 1
        size = np.abs(before.multipliers.x).max(axis=1)[cell]
        margin = margin + ERROR_GROWTH * (size * series.per_z.error).sum(axis=1)
    proof = None
    for _ in range(MAX_MARGINS):
        found = program.solve(margin)
        if found is None:
            break
        proof = _Proof(series, found, program.evaluate(found))
        if proof.complete:
            break
        margin = margin + 2.0 * proof.evidence.lacking
    return proof


def _peak_at_rest(task: Task, reference: Array) -> float:
    """Return the largest torque over the reference at the ends of laws whose s' and s" vanish there."""
    if task.specification.smoothness < 2:
        return 0.0
    asked = demand(task.branch, Smoothstep(0), np.array([0.0, 1.0]), None, task.geometry)
    torque = asked.torque.constant + asked.friction(task.specification.friction)
    return float(np.abs(torque / reference).max())
