"""Advice beside the reason of a refusal, and the check of limits that a plan must keep.

A remedy is a set of options with which the answer becomes another. A law that was refused is not advised
again, the other one only where condition (8) and the limits leave it a duration. Limits and durations are
those of a law that the search found (`SearchEvidence`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from framework.arrays import Array
from framework.crossing.durations import OptimalDurations, optimal_durations
from framework.crossing.feasibility import feasibility_on_path
from framework.crossing.options import OPTIMAL_LAW
from framework.crossing.refusals.refusal_proofs import SearchEvidence, UnmetCondition
from framework.crossing.request import Request
from framework.crossing.result import CrossingPlan
from framework.errors import LimitsExceeded, NoAnswer, NoLaw, UnboundedTorque, round_up
from framework.kinematics.parallel_robot import ParallelRobot
from framework.singularity.points_on_path import SearchedPath

DURATION_RESERVE = 1.02  # over the least duration, which is met at its limits alone


def with_explanation(refusal: NoLaw, searched: SearchedPath, request: Request) -> NoLaw:
    """Return the refusal with condition (8) at each singular point, durations and a remedy appended."""
    sentences = [str(refusal)]
    sentences += [
        feasibility.short_sentence for feasibility in feasibility_on_path(searched) if feasibility is not None
    ]
    optimal = _untried_durations(searched, request)
    if optimal is not None and optimal.shortest != 0.0:  # without limits nothing bounds it
        sentences.append(optimal.sentence)
    remedy = remedy_of(refusal, searched.branch.robot, request, optimal)
    return NoLaw("; ".join(sentences), proof=refusal.proof, evidence=refusal.evidence).advising(remedy)


def with_remedy(pole: UnboundedTorque, searched: SearchedPath, request: Request) -> UnboundedTorque:
    """Return the refusal of a law that does not meet condition (8), with the remedy."""
    optimal = _untried_durations(searched, request)
    return pole.advising(remedy_of(pole, searched.branch.robot, request, optimal))


def _untried_durations(searched: SearchedPath, request: Request) -> OptimalDurations | None:
    """Return the durations of the optimal law if the request excludes that law, else None."""
    return None if request.may_be_optimal else optimal_durations(searched, request)


def check_limits(plan: CrossingPlan) -> None:
    """Raise LimitsExceeded where a plan with `keep_limits` exceeds limits."""
    exceeded = plan.exceeded if plan.request.keep_limits else {}
    if exceeded:
        listed = "; ".join(f"{joint}: {excess}" for joint, excess in exceeded.items())
        raise LimitsExceeded(f"{plan.robot.name}: the motion leaves limits: {listed}", exceeded=exceeded)


def remedy_of(
    refusal: NoAnswer, robot: ParallelRobot, request: Request, optimal: OptimalDurations | None
) -> dict[str, Any] | None:
    """Return options of `plan_crossing` to give instead, None for one to leave out; None without remedy.

    `bend` among them stands for `plan_with_modified_path`.

    Args:
        optimal: durations of the optimal law, if it was not tried and there is any.
    """
    if request.at is not None:  # an imposed point: what was said of the located ones does not hold there
        return None
    if not request.may_be_optimal:
        if optimal is None or optimal.shortest is None or request.duration is None:
            return None
        least = DURATION_RESERVE * optimal.shortest
        return OPTIMAL_LAW | ({"duration": round_up(least, 3)} if least > request.duration else {})
    if isinstance(getattr(refusal, "proof", None), UnmetCondition):
        return None if refusal.proof.stop else {"bend": True}  # type: ignore[attr-defined]
    evidence = getattr(refusal, "evidence", None)
    if robot.n_e or not isinstance(evidence, SearchEvidence):  # its numbers are of the undeformed robot
        return None
    if evidence.quickest is not None:
        return {"longest" if request.duration is None else "duration": evidence.quickest}
    return None if evidence.limits is None else _limits_by_joint(robot, evidence.limits)


def _limits_by_joint(robot: ParallelRobot, limits: dict[str, Array]) -> dict[str, Any]:
    """Return limits (n_a,) by option and joint, infinite ones left out."""
    names = robot.actuator_names
    return {
        option: {name: float(limit) for name, limit in zip(names, values, strict=True) if np.isfinite(limit)}
        for option, values in limits.items()
    }
