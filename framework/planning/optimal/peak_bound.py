"""Bounds of every law: of its peak of torque or duration, and the proof that there is none within limits.

They hold for rigid robots with as many motors as axes whose path crosses the locus, and for all laws that
advance from rest to rest, however fine. Elsewhere there is no bound, and nothing is proved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.laws.optimal_law import Smoothstep
from framework.numerics.arrays import Array, IntArray, ReadOnlyArrays
from framework.planning.crossing_points import PathToCross
from framework.planning.optimal.dual_program import DualProgram, Evidence, Multipliers
from framework.planning.optimal.optimal_task import Task
from framework.planning.optimal.path_series import PathSeries, cut_cells, resolve_series, uniform_cells
from framework.planning.optimal.phase_plane import demand
from framework.planning.result import CrossingPlan
from framework.singularity.points_on_path import search_path
from framework.tolerances import BOUND_MARGIN

FIRST_CELLS, MAX_CELLS, MAX_REFINEMENTS = 100, 400, 6
MIN_GAIN = 1e-3  # of a bound by more cells
MAX_MARGINS = 3  # with which a program is solved until its factor is proved
ERROR_GROWTH = 1.5  # of the factor's error, over the error with the multipliers of the last cells
CUT_SHARES = (1.5, 6.0)  # of |nu|_1 on a cell over the mean, above which it is cut in two and in four


@dataclass(frozen=True, eq=False)
class PeakBound(ReadOnlyArrays):
    """A bound of every law's peak or duration, with its multipliers.

    by_duality: the peak of torque over the reference that no law is below, or the duration [s].
    at_rest: the peak that every law has at its ends, where s' = s" = 0; zero where s" need not vanish.
    reference: (n_a,) [N m]; torques of motors where it is infinite do not count.
    edges: (k + 1,) of cells in s, on which the multipliers are constant or polynomials in Bernstein form.
    p: (k, 3) and across: (k, 3, m) give nu = 2 p cu / |cu|^2 + across - cu (cu . across) / |cu|^2, of the m
        motors whose torques count, over the reference.
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
    proof = _find_proof(task, reference, timed=False)
    return proof and _bound_with_multipliers(proof, reference, _peak_at_rest(task, reference))


def bound_duration(task: Task) -> PeakBound | None:
    """Compute a bound of the duration [s] within the limits of torque and speed."""
    limit = task.specification.torque_limit
    proof = _find_proof(task, limit, timed=True)
    return proof and _bound_with_multipliers(proof, limit, at_rest=0.0)


def find_refuting_bound(task: Task) -> PeakBound | None:
    """Find a bound above 1 of the undeformed robot's relative peak, by which no law exists; None without."""
    bound = bound_peak(task, task.specification.torque_limit)
    return bound if bound is not None and bound.value > 1.0 + BOUND_MARGIN else None


def bound_plan(plan: CrossingPlan) -> PeakBound | None:
    """Compute a bound of the duration or peak that a plan's law minimises.

    None for other goals.
    """
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
    """A bound proved by multipliers on the cells of a series."""

    series: PathSeries
    multipliers: Multipliers
    evidence: Evidence

    @property
    def complete(self) -> bool:
        return self.evidence.value > 0.0 and not self.evidence.lacking.any()


def _bound_with_multipliers(proof: _Proof, reference: Array, at_rest: float) -> PeakBound:
    """Return the bound that a proof gives, with its multipliers in the form of `PeakBound`.

    p = x_0, and across is the sum of x_i e_i over i > 0, with e_i the directions of the series.

    Args:
        at_rest: the relative peak at the ends, zero for a bound of the duration.
    """
    series = proof.series
    x, mu, _, lam = proof.multipliers
    return PeakBound(
        proof.evidence.value,
        at_rest,
        reference,
        series.edges,
        p=x[..., 0],
        across=x[..., 1:] @ series.directions,
        mu=mu,
        lam=lam,
    )


def _find_proof(task: Task, reference: Array, *, timed: bool) -> _Proof | None:
    """Find the best proof on cells that are refined in turn.

    None where none is complete. Cells are cut where |nu| is large, since its integral is the denominator of
    the bound, and where the factor is not proved to be positive.
    """
    if not _has_bound(task, reference):
        return None
    longest = None if timed else task.specification.max_duration
    best: _Proof | None = None
    proof: _Proof | None = None
    edges = uniform_cells(task, FIRST_CELLS)
    for _ in range(MAX_REFINEMENTS):
        series = resolve_series(task, reference, edges)
        proof = series and _solve_program(DualProgram(series, longest, timed), proof)
        if proof is None:
            break
        if proof.complete:
            gain = np.inf if best is None else proof.evidence.value / best.evidence.value - 1.0
            best = proof if best is None or gain > 0.0 else best
            if gain < MIN_GAIN:
                break
        parts = _choose_parts(proof.evidence)
        if parts.sum() > MAX_CELLS:
            break
        edges = cut_cells(task, proof.series.edges, parts)
    return best


def _has_bound(task: Task, reference: Array) -> bool:
    """Whether a task has bounds.

    It has for a rigid robot with as many motors as axes, and transversal, single crossings.
    """
    robot = task.branch.robot
    points = task.to_cross.points
    are_crossed = all(point.corank == 1 and point.contact != "tangential" for point in points)
    return not robot.n_e and robot.n_a == robot.n and are_crossed and bool(np.isfinite(reference).any())


def _choose_parts(evidence: Evidence) -> IntArray:
    """Choose into how many parts each cell is cut, (k,): 1, 2 or 4.

    A cell is cut for a large share of the integral of |nu|_1, or where the factor is not proved to be
    positive; and into no fewer parts than its neighbours on their own.
    """
    share_over_mean = evidence.shares * len(evidence.shares)
    halving_share, quartering_share = CUT_SHARES
    parts = 1 + (share_over_mean > halving_share) + 2 * (share_over_mean > quartering_share)
    parts = np.where(evidence.lacking > 0.0, np.maximum(parts, 2), parts)
    padded = np.pad(parts, 1, constant_values=1)
    return np.maximum(parts, np.maximum(padded[:-2], padded[2:]))


def _solve_program(program: DualProgram, previous: _Proof | None) -> _Proof | None:
    """Solve with growing margins until the factor is proved positive.

    None without a solution. The first margin is the solver's error and, with a proof on the previous cells,
    the error of the series times the multipliers there.
    """
    series = program.series
    margin = 2.0 * program.factor_error
    if previous is not None:
        middles = 0.5 * (series.edges[1:] + series.edges[:-1])
        previous_cell = np.searchsorted(previous.series.edges, middles) - 1
        x_size = np.abs(previous.multipliers.x).max(axis=1)[previous_cell]  # (k, m)
        margin = margin + ERROR_GROWTH * (x_size * series.per_z.error).sum(axis=1)
    proof = None
    for _ in range(MAX_MARGINS):
        multipliers = program.solve(margin)
        if multipliers is None:
            break
        proof = _Proof(series, multipliers, program.evaluate_bound(multipliers))
        if proof.complete:
            break
        margin = margin + 2.0 * proof.evidence.lacking
    return proof


def _peak_at_rest(task: Task, reference: Array) -> float:
    """Return the largest holding torque over the reference at both ends of the path.

    Laws whose s' and s" vanish there need it; 0 where s" need not vanish.
    """
    if task.specification.smoothness < 2:
        return 0.0
    required = demand(task.branch, Smoothstep(0), np.array([0.0, 1.0]))
    torque = required.torque.constant + required.friction(task.specification.friction)
    return float(np.abs(torque / reference).max())
