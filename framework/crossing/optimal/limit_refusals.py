"""Why no law was found within the limits, and which limits and duration would do.

A search on cells proves nothing. Two bounds of every law do: at rest at its ends the robot has to be held,
and the peak of torque has a bound by duality (`peak_bound`). What is advised was planned first.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from framework.arrays import Array
from framework.crossing.optimal.best_law import Best, find_best_law
from framework.crossing.optimal.law_problem import LawProblem
from framework.crossing.optimal.least_cost import NoneFound, find_least_cost
from framework.crossing.optimal.optimal_task import Task
from framework.crossing.optimal.peak_bound import prove_no_law
from framework.crossing.optimal.phase_plane import demand
from framework.crossing.refusals.refusal_proofs import HoldingTorque, LeastLimits, SearchEvidence, advice_of
from framework.errors import NoLaw, NotConverged, format_distinct

ADVISED_RESERVE = 1.02  # of a duration over the quickest found, which is met at its limits alone


def refuse_law(problem: LawProblem, none: NoneFound) -> NoLaw | NotConverged:
    """Return the reason why a problem has no law, with what was found instead."""
    task, specification = problem.task, problem.specification
    robot, cells = task.branch.robot, len(none.program.basis.cells) - 1
    holding = _overloaded_at_rest(problem)
    least = find_least_limits(problem)
    if holding is None and not none.infeasible and least.torque_peak is None and least.speed_peak is None:
        return NotConverged(
            f"{robot.name}: no optimal law was found on {cells} cells: {none.status}",
            residual=np.inf,
        )
    quickest = None
    if holding is None and specification.most and (specification.limited or specification.limited_speeds):
        quickest = _find_quickest(problem)
    limits = next((raised for raised in least.options if _has_law(problem, raised)), None)
    evidence = SearchEvidence(cells, least, quickest, limits)
    would_do = "" if limits is None else f"; {advice_of(robot, limits)}"
    if holding is not None:
        where, unit = "start" if holding.s == 0 else "end", _unit(task, holding.joint)
        needed, allowed = format_distinct(holding.torque, holding.limit)
        rubs = robot.joint_friction.any()
        uncounted = " (dry friction, which may hold some of it, not counted)" if rubs else ""
        return NoLaw(
            f"{robot.name}: no law is admissible: at the {where} {holding.joint} must hold {needed} "
            f"{unit} at rest{uncounted}, and may {allowed}{would_do}",
            proof=holding,
            evidence=evidence,
        )
    bound = prove_no_law(problem)
    none_is = "no law of free shape was found"
    if bound is not None:
        needed, _ = format_distinct(bound.value, 1.0)
        none_is = f"no law is admissible: the torque of each peaks at {needed} times the limits or more"
    return NoLaw(f"{robot.name}: {none_is}: {evidence.sentence}{would_do}", proof=bound, evidence=evidence)


def find_least_limits(problem: LawProblem) -> LeastLimits:
    """Find limits within which there is a law, in proportion to those of a problem that has none."""
    specification = problem.specification
    torque = _find_multiples(problem, "peak_torque")[0] if specification.limited else None
    speed = _find_multiples(problem, "peak_speed")[1] if specification.limited_speeds else None
    together = torque is None and speed is None and specification.limited and specification.limited_speeds
    if together:
        torque, speed = _find_multiples(problem, "limits")
    return LeastLimits.of(specification, torque, speed, together=together and torque is not None)


def _find_multiples(problem: LawProblem, goal: str) -> tuple[float | None, float | None]:
    """Return the multiples of torque and of speed limits that the law of least peaks needs."""
    limit = problem.specification.torque_limit
    weighed = problem._replace(weighing=np.where(np.isfinite(limit), limit, np.inf))
    valued = find_least_cost(weighed.with_goal(goal), torque_limits=goal != "peak_torque")
    return (None, None) if isinstance(valued, NoneFound) else (valued[1].peak, valued[1].peak_speed)


def _has_law(problem: LawProblem, limits: dict[str, Array]) -> bool:
    """Return whether a law is found within raised limits (n_a,)."""
    margin = 1.0 - problem.task.request.margin
    within: dict[str, Any] = {name: margin * limit for name, limit in limits.items()}
    raised = replace(problem.specification, **within)
    return isinstance(find_best_law(problem._replace(task=problem.task._replace(specification=raised))), Best)


def _find_quickest(problem: LawProblem) -> float | None:
    """Return a duration [s] in which a law within the limits was found, near the least; None if none was."""
    specification = replace(problem.specification, duration=None, longest=None)
    free = problem._replace(task=problem.task._replace(specification=specification))
    best = find_best_law(free.with_goal("time"))
    return best.law.duration if isinstance(best, Best) else None


def _overloaded_at_rest(problem: LawProblem) -> HoldingTorque | None:
    """Return a motor whose limit does not even hold the robot at an end of its path."""
    task, limit = problem.task, problem.specification.torque_limit
    ends = np.array([0.0, 1.0])
    weight = demand(task.branch, task.phi, ends, problem.deflections, task.geometry).torque.constant
    over = np.argwhere(np.abs(weight) > limit)
    if not len(over):
        return None
    end, motor = map(int, over[0])
    joint = task.branch.robot.actuator_names[motor]
    return HoldingTorque(joint, float(end), float(abs(weight[end, motor])), float(limit[motor]))


def _unit(task: Task, joint: str) -> str:
    robot = task.branch.robot
    return str(robot.torque_units[list(robot.actuator_names).index(joint)])
