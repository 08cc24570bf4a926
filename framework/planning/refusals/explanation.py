"""Advice beside the reason of a refusal, and the check of limits that a plan must keep.

A remedy is a set of options with which the answer becomes another. A law that was refused is not advised
again, the optimal law only where condition (8) does not forbid every law. Limits and durations are those of a
law that the search found (`SearchEvidence`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from framework.errors import LimitsExceeded, NoAnswer, NoLaw, UnboundedTorque
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.optimal_law import HIGHEST_SMOOTHNESS
from framework.numerics.arrays import Array
from framework.planning.feasibility import feasibility_on_path, is_crossable
from framework.planning.options import OPTIMAL_LAW
from framework.planning.refusals.refusal_proofs import SearchEvidence, UnmetCondition
from framework.planning.request import Request
from framework.planning.result import CrossingPlan
from framework.singularity.points_on_path import SearchedPath


def with_explanation(refusal: NoLaw, searched: SearchedPath, request: Request) -> NoLaw:
    """Return the refusal with condition (8) at each singular point and a remedy appended."""
    conditions = [feasibility for feasibility in feasibility_on_path(searched) if feasibility is not None]
    sentences = [str(refusal), *(feasibility.short_sentence for feasibility in conditions)]
    explained = NoLaw("; ".join(sentences), proof=refusal.proof, evidence=refusal.evidence)
    return explained.advising(find_remedy(refusal, searched, request))


def with_remedy(pole: UnboundedTorque, searched: SearchedPath, request: Request) -> UnboundedTorque:
    """Return the refusal of a law that does not meet condition (8), with the remedy."""
    return pole.advising(find_remedy(pole, searched, request))


def check_limits(plan: CrossingPlan) -> None:
    """Raise LimitsExceeded where a plan with `keep_limits` exceeds limits."""
    exceeded = plan.exceeded if plan.request.keep_limits else {}
    if exceeded:
        listed = "; ".join(f"{joint}: {excess}" for joint, excess in exceeded.items())
        raise LimitsExceeded(f"{plan.robot.name}: the motion leaves limits: {listed}", exceeded=exceeded)


def find_remedy(refusal: NoAnswer, searched: SearchedPath, request: Request) -> dict[str, Any] | None:
    """Return options of `plan_crossing` to give instead, None for one to leave out; None without remedy.

    `bend` among them stands for `plan_with_modified_path`.
    """
    robot = searched.branch.robot
    if request.at is not None:  # an imposed point: what was said of the located ones does not hold there
        return None
    if not request.may_be_optimal:
        may_cross = request.smoothness <= HIGHEST_SMOOTHNESS and is_crossable(searched)
        return OPTIMAL_LAW if may_cross and request.duration is not None else None
    if isinstance(refusal, NoLaw) and isinstance(refusal.proof, UnmetCondition):
        return None if refusal.proof.stop else {"bend": True}
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
