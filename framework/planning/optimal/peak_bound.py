"""Lower bounds of the peak torque or the duration of every law, and the proof that no law keeps its limits.

The bounds are found by multipliers nu of the torques, mu of the speed limits and lambda of the duration
(`dual_program`), on cells of the path coordinate s. They hold for rigid robots, however redundant motors
share the load, on paths that cross the locus transversally, and for all laws that advance and have the same
speeds at both ends, whatever their discretisation. Otherwise there is no bound, and nothing is proved.
Required times and speeds of crossings do not count: laws with them are some of all laws, so that the bound
holds for them too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.dynamics.torque_distribution import least_peak_torques
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.optimal_law import Smoothstep
from framework.numerics.arrays import Array, IntArray, ReadOnlyArrays
from framework.planning.crossing_points import PathToCross
from framework.planning.optimal.dual_program import DualProgram, Evidence, Multipliers
from framework.planning.optimal.optimal_task import Task
from framework.planning.optimal.path_series import PathSeries, cut_cells, resolve_series, uniform_cells
from framework.planning.optimal.phase_plane import demand
from framework.planning.result import CrossingPlan
from framework.singularity.points_on_path import SingularPoint, search_path
from framework.tolerances import BOUND_MARGIN

FIRST_CELLS, MAX_CELLS = 100, 400
MIN_GAIN = 1e-3  # relative gain of the bound by more cells, below which the search ends
MAX_MARGINS = 3  # number of margins tried on the same cells
ERROR_GROWTH = 1.5  # of the factor's error, over the error with the multipliers of the previous cells
CUT_SHARES = (1.5, 6.0)  # |nu|_1 on a cell over the mean, above which the cell is cut in two and in four


@dataclass(frozen=True, eq=False)
class PeakBound(ReadOnlyArrays):
    """A lower bound of the peak or the duration of every law, with its multipliers.

    The symbols are those of `dual_program`.

    by_duality: the bound of the peak torque over the reference, or of the duration [s].
    at_ends: the relative peak of every law at its ends, where s' and s" are given.
    reference: torques (n_a,) [N m]; motors with an infinite reference do not count.
    edges: edges (k + 1,) of the cells in s, on which the multipliers are constant or in Bernstein form.
    p: (k, 3) and across: (k, 3, m) give nu = 2 p cu / |cu|^2 + across - cu (cu . across) / |cu|^2 of the m
        motors whose torques count, over the reference; with redundant motors, cu and `across` are projected
        on the complement of internal torques.
    mu: multipliers (k, n) of the n motors with a speed limit.
    lam: the multiplier lambda of the duration.
    """

    by_duality: float
    at_ends: float
    reference: Array
    edges: Array
    p: Array
    across: Array
    mu: Array
    lam: float

    @property
    def value(self) -> float:
        """The larger of both bounds."""
        return max(self.by_duality, self.at_ends)


def bound_peak(task: Task, reference: Array) -> PeakBound | None:
    """Compute a bound of the peak torque over a reference (n_a,) [N m]; None if no bound is known.

    Laws keep the speed limits and the longest duration; torque limits do not count.
    """
    return _bound_laws(task, reference, timed=False)


def bound_duration(task: Task) -> PeakBound | None:
    """Compute a bound of the duration [s] within all limits; None if no bound is known."""
    return _bound_laws(task, task.specification.torque_limit, timed=True)


def find_refuting_bound(task: Task) -> PeakBound | None:
    """Find a bound above 1 of the peak over the limits, which excludes every law; None without one."""
    bound = bound_peak(task, task.specification.torque_limit)
    return bound if bound is not None and bound.value > 1.0 + BOUND_MARGIN else None


def bound_plan(plan: CrossingPlan) -> PeakBound | None:
    """Compute a bound of the duration or peak that a plan's law minimises; None for other goals.

    It counts neither torque-speed curves nor RMS torques: without them there are more laws.
    """
    if plan.optimality is None or plan.optimality.specification.goal == "energy":
        return None
    specification = plan.optimality.specification
    searched = search_path(plan.robot, plan.path).under(plan.dynamics.wrenches)
    task = Task(PathToCross(searched, searched.points), plan.request, specification)
    if specification.goal == "time":
        return bound_duration(task)
    # peaks are relative to the limits; motors without a limit have the reference of the plan
    limited = specification.limited_motors
    return bound_peak(task, np.where(limited, specification.torque_limit, plan.optimality.reference))


class _Proof(NamedTuple):
    """Multipliers on the cells of a series, with the bound of all laws."""

    series: PathSeries
    multipliers: Multipliers
    evidence: Evidence

    @property
    def complete(self) -> bool:
        """Whether the bound is positive, and proved on all cells."""
        return self.evidence.value > 0.0 and not self.evidence.shortfall.any()


def _bound_laws(task: Task, reference: Array, *, timed: bool) -> PeakBound | None:
    """Compute a bound of all laws with its multipliers; None if no bound is known.

    p = x_0, and `across` is the sum of x_i e_i over i > 0, with the directions e_i of the series.

    Args:
        reference: torques (n_a,) [N m]; motors with an infinite reference do not count.
        timed: whether the duration is bounded instead of the peak.
    """
    proof = _find_proof(task, reference, timed=timed)
    if proof is None:
        return None
    x = proof.multipliers.x
    return PeakBound(
        by_duality=proof.evidence.value,
        at_ends=0.0 if timed else _bound_at_ends(task, reference),
        reference=reference,
        edges=proof.series.edges,
        p=x[..., 0],
        across=x[..., 1:] @ proof.series.directions,
        mu=proof.multipliers.mu,
        lam=proof.multipliers.lam,
    )


def _find_proof(task: Task, reference: Array, *, timed: bool) -> _Proof | None:
    """Find multipliers that prove the best bound of all laws; None if none prove one.

    Multipliers nu(s) of the torques prove a bound if the factor of the squared speed z that they leave is not
    negative along the path (`dual_program`). They are series on cells of s, which are refined step by step:
    where |nu| is large, since its integral is the denominator of the bound, and where the factor is not
    proved positive.

    Args:
        reference: torques (n_a,) [N m]; motors with an infinite reference do not count.
        timed: whether the duration is bounded instead of the peak.
    """
    robot = task.robot
    counts_enough = np.isfinite(reference).sum() > robot.n_a - robot.n  # more motors than redundant ones
    if not counts_enough or _find_exclusion(robot, task.to_cross.points):
        return None
    longest = None if timed else task.specification.max_duration
    start_speed, goal_speed = task.specification.ends.derivatives(1)[:, 0]
    end_z = (start_speed**2, goal_speed**2)
    best: _Proof | None = None
    proof: _Proof | None = None
    edges = uniform_cells(task, FIRST_CELLS)
    while True:
        series = resolve_series(task, reference, edges)  # of torques and speeds, with bounds of their errors
        if series is None:
            return best
        proof = _solve_program(DualProgram(series, longest, timed, end_z), previous=proof)
        if proof is None:
            return best
        if proof.complete:
            gain = np.inf if best is None else proof.evidence.value / best.evidence.value - 1.0
            if gain > 0.0:
                best = proof
            if gain < MIN_GAIN:
                return best
        parts = _choose_parts(proof.evidence)  # an incomplete proof has a cell to cut, so the search ends
        if parts.sum() > MAX_CELLS:
            return best
        edges = cut_cells(task, proof.series.edges, parts)


def explain_missing_bound(plan: CrossingPlan) -> str:
    """Return why no bound of a plan's law is known, in words."""
    if plan.optimality is not None and plan.optimality.specification.goal == "energy":
        return "laws of least energy"
    return (
        _find_exclusion(plan.robot, search_path(plan.robot, plan.path).points)
        or "this path: it is not proved"
    )


def _find_exclusion(robot: ParallelRobot, points: Sequence[SingularPoint]) -> str:
    """Return the robots or paths without known bounds to which these belong, in words; empty if to none."""
    if robot.n_e:
        return "robots with springs"
    if any(point.corank > 1 for point in points):
        return "paths through points where several motions are uncontrolled"
    if any(point.contact == "tangential" for point in points):
        return "paths that touch the locus"
    return ""


def _choose_parts(evidence: Evidence) -> IntArray:
    """Choose the number of parts (k,) of each cell: 1, 2 or 4.

    A cell is cut if it has a large share of the integral of |nu|_1, or if the factor is not proved positive
    on it. Each cell then gets at least as many parts as its neighbours.
    """
    share_over_mean = evidence.shares * len(evidence.shares)
    halving_share, quartering_share = CUT_SHARES
    parts = 1 + (share_over_mean > halving_share) + 2 * (share_over_mean > quartering_share)
    parts = np.where(evidence.shortfall > 0.0, np.maximum(parts, 2), parts)
    beside = np.pad(parts, 1)  # 0 beyond the ends
    return np.maximum(parts, np.maximum(beside[:-2], beside[2:]))


def _solve_program(program: DualProgram, previous: _Proof | None) -> _Proof | None:
    """Solve with growing margins until the multipliers prove a bound; return the last proof, if any.

    The proof needs a factor of z that is above a line, the minorant, on each of k cells. The margin (k,) is
    the least distance between them that the program asks for. At first it covers the error of the solver
    and, with a proof on the previous cells, the error of the series times the multipliers x of that proof.
    Then it grows by twice the shortfall of the last solution: by how much its factor may be negative.
    """
    series = program.series
    margin = 2.0 * program.factor_error
    if previous is not None:
        middles = 0.5 * (series.edges[1:] + series.edges[:-1])
        previous_cell = np.searchsorted(previous.series.edges, middles) - 1  # of each cell of the series
        x_size = np.abs(previous.multipliers.x).max(axis=1)[previous_cell]  # (k, m) bound of |x_i(s)|
        series_error = (x_size * series.per_z.error).sum(axis=1)  # (k,) of the factor's term nu . cz
        margin = margin + ERROR_GROWTH * series_error

    proof = None
    for _ in range(MAX_MARGINS):
        multipliers = program.solve(margin)
        if multipliers is None:
            break
        proof = _Proof(series, multipliers, program.evaluate_bound(multipliers))
        if proof.complete:
            break
        margin = margin + 2.0 * proof.evidence.shortfall
    return proof


def _bound_at_ends(task: Task, reference: Array) -> float:
    """Compute the least peak over a reference (n_a,) of the torques at start and goal."""
    torques = torques_at_ends(task)
    if not task.specification.shares_freely:
        return float(np.abs(torques / reference).max())
    projectors = demand(task.branch, Smoothstep(0), np.array([0.0, 1.0])).internal
    assert projectors is not None
    least = least_peak_torques(torques, projectors, reference, task.robot.n_a - task.robot.n)
    return float((1.0 - BOUND_MARGIN) * np.abs(least / reference).max())  # less an error of the solver


def torques_at_ends(task: Task) -> Array:
    """Compute the motors' torques (2, n_a) [N m, N] at start and goal, where s' and s" are given."""
    specification = task.specification
    required = demand(task.branch, Smoothstep(0), np.array([0.0, 1.0]))  # sigma = s: z = s'^2, u = s"
    speed, acceleration = specification.ends.derivatives(2).T[:, :, None]
    constant, per_z, per_u = required.torque
    torque = constant + per_z * speed**2 + per_u * acceleration + required.damping * speed
    return np.asarray(torque + required.friction(specification.friction))
