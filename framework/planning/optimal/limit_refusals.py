"""The refusal of a law within the limits, with limits and a duration for which a law was found.

A failed search on cells proves nothing. Two bounds of every law do: the torque that holds the robot at rest
at the ends, and the bound of the peak torque by duality (`peak_bound`). Limits and durations are advised only
after a law was planned with them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from framework.errors import NoLaw, NotConverged, format_distinct
from framework.numerics.arrays import Array
from framework.planning.optimal.best_law import Best, find_best_law
from framework.planning.optimal.law_problem import LawProblem
from framework.planning.optimal.least_cost import NoneFound, find_least_cost
from framework.planning.optimal.peak_bound import find_refuting_bound
from framework.planning.optimal.phase_plane import demand
from framework.planning.refusals import HoldingTorque, LeastLimits, SearchEvidence, advice_of


def refuse_law(problem: LawProblem, none: NoneFound) -> NoLaw | NotConverged:
    """Return the refusal of a problem without a law, with a proof or the evidence of a search."""
    name = problem.task.robot.name
    cells = len(none.program.basis.cells) - 1
    holding = _overloaded_at_rest(problem)
    not_found = NotConverged(
        f"{name}: no optimal law was found on {cells} cells: {none.status}", residual=np.inf
    )
    if problem.response is not None or not problem.task.to_cross.explained:
        return not_found  # torques linearised about another motion prove nothing about limits
    least = find_least_limits(problem)
    if holding is None and not none.infeasible and least.torque_peak is None and least.speed_peak is None:
        return not_found
    evidence = _search_remedies(problem, cells, least, is_held=holding is None)
    if holding is not None:
        return _refuse_holding(problem, holding, evidence)
    proof = find_refuting_bound(problem.task)
    reason = "no law of free shape was found"
    if proof is not None:
        peak, _ = format_distinct(proof.value, 1.0)
        reason = f"no law is admissible: the torque of each peaks at {peak} times the limits or more"
    advice = _limits_advice(problem, evidence)
    return NoLaw(f"{name}: {reason}: {evidence.sentence}{advice}", proof=proof, evidence=evidence)


def _search_remedies(problem: LawProblem, cells: int, least: LeastLimits, *, is_held: bool) -> SearchEvidence:
    """Search for a duration and for limits with which a refused problem has a law.

    Args:
        cells: number of cells of the search that failed.
        is_held: whether motors can hold the robot at both ends of the path; otherwise no duration helps.
    """
    specification = problem.specification
    limited = specification.limited or specification.limited_speeds
    quickest = _find_quickest(problem) if is_held and specification.max_duration and limited else None
    limits = next((raised for raised in least.options if _has_law(problem, raised)), None)
    return SearchEvidence(cells, least, quickest, limits)


def _refuse_holding(problem: LawProblem, holding: HoldingTorque, evidence: SearchEvidence) -> NoLaw:
    """Return the refusal of a path at whose start or end a motor cannot hold the robot."""
    robot = problem.task.robot
    end = "start" if holding.s == 0 else "end"
    unit = dict(zip(robot.actuator_names, robot.torque_units, strict=True))[holding.joint]
    needed, allowed = format_distinct(holding.torque, holding.limit)
    has_friction = robot.joint_friction.any()
    uncounted = " (dry friction, which may hold some of it, not counted)" if has_friction else ""
    return NoLaw(
        f"{robot.name}: no law is admissible: at the {end} {holding.joint} must hold {needed} "
        f"{unit} at rest{uncounted}, and may {allowed}{_limits_advice(problem, evidence)}",
        proof=holding,
        evidence=evidence,
    )


def _limits_advice(problem: LawProblem, evidence: SearchEvidence) -> str:
    """Return the clause that advises limits for which a law was planned; empty without such limits."""
    limits = evidence.limits
    return "" if limits is None else f"; {advice_of(problem.task.robot, limits)}"


def find_least_limits(problem: LawProblem) -> LeastLimits:
    """Find the least multiples of the limits with which a problem has a law.

    First, torque limits and speed limits are raised alone, within the limits of the other kind. If neither
    suffices, both are raised together.
    """
    specification = problem.specification
    torque = _find_peaks(problem, "peak_torque").torque if specification.limited else None
    speed = _find_peaks(problem, "peak_speed").speed if specification.limited_speeds else None
    together = torque is None and speed is None and specification.limited and specification.limited_speeds
    if together:
        torque, speed = _find_peaks(problem, "limits")
    return LeastLimits.of(specification, torque, speed, together=together and torque is not None)


class _RelativePeaks(NamedTuple):
    """The peaks of torque and speed over their limits; None if no law was found."""

    torque: float | None
    speed: float | None


def _find_peaks(problem: LawProblem, goal: str) -> _RelativePeaks:
    """Find the peaks of torque and speed over their limits, for the law of least peaks.

    Args:
        goal: "peak_torque" within the speed limits, "peak_speed" within the torque limits, or "limits", the
            larger of both peaks, without limits.
    """
    # peaks are relative to the reference: infinite for a motor without a limit, which then does not count
    over_limits = problem._replace(chosen_reference=problem.specification.torque_limit)
    least = find_least_cost(over_limits.with_goal(goal), torque_limits=goal != "peak_torque")
    if isinstance(least, NoneFound):
        return _RelativePeaks(None, None)
    return _RelativePeaks(least.speed.peak, least.speed.peak_speed)


def _has_law(problem: LawProblem, limits: dict[str, Array]) -> bool:
    """Return whether a law is found within raised limits (n_a,), less the margin of the request."""
    share = 1.0 - problem.task.request.margin
    within: dict[str, Any] = {name: share * limit for name, limit in limits.items()}
    task = problem.task._replace(specification=replace(problem.specification, **within))
    return isinstance(find_best_law(problem._replace(task=task)), Best)


def _find_quickest(problem: LawProblem) -> float | None:
    """Find a duration [s] near the least within the limits; None if no law was found."""
    best = find_best_law(problem.with_goal("time", duration=None, longest=None))
    return best.law.duration if isinstance(best, Best) else None


def _overloaded_at_rest(problem: LawProblem) -> HoldingTorque | None:
    """Find a holding torque above its limit at an end of the path; None without one."""
    task = problem.task
    limit = problem.specification.torque_limit
    holding = np.abs(demand(task.branch, task.phi, np.array([0.0, 1.0])).torque.constant)  # (2, n_a)
    overloaded = np.argwhere(holding > limit)
    if not len(overloaded):
        return None
    end, motor = overloaded[0]
    joint = task.robot.actuator_names[motor]
    return HoldingTorque(joint, float(end), float(holding[end, motor]), float(limit[motor]))
