"""Remedies of refusals: options of a plan that is found instead.

A law that was refused is not advised again. The other law is advised only where condition (8) and the limits
leave it a duration. Limits and durations are those of a law that the search found (`SearchEvidence`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from framework.arrays import Array
from framework.crossing.durations import OptimalDurations
from framework.crossing.refusals.refusal_proofs import SearchEvidence, UnmetCondition
from framework.crossing.request import Request
from framework.errors import NoAnswer, round_up
from framework.kinematics.parallel_robot import ParallelRobot

OPTIMAL_LAW: dict[str, Any] = {"law": "optimal", "times": None, "speeds": None}
DURATION_RESERVE = 1.02  # over the least duration, which is met at its limits alone


def remedy_of(
    refusal: NoAnswer, robot: ParallelRobot, request: Request, optimal: OptimalDurations | None
) -> dict[str, Any] | None:
    """Return options of `plan_crossing` to give instead, None for one to leave out; None without remedy.

    The optimal law, if it was not tried; a bend of the path (`plan_with_modified_path`) where no motion meets
    condition (8); else the duration or the limits of a law that the search found.

    Args:
        optimal: durations of the optimal law, if it was not tried and there is any.
    """
    if request.at is not None:  # what is known of the singular points does not hold at imposed ones
        return None
    if not request.may_be_optimal:
        return _with_optimal_law(request, optimal)
    if isinstance(getattr(refusal, "proof", None), UnmetCondition):
        return None if refusal.proof.stop else {"bend": True}  # type: ignore[attr-defined]
    evidence = getattr(refusal, "evidence", None)
    if robot.n_e or not isinstance(evidence, SearchEvidence):  # its numbers are of the undeformed robot
        return None
    if evidence.quickest is not None:
        return {"longest" if request.duration is None else "duration": evidence.quickest}
    return None if evidence.limits is None else _limits_by_joint(robot, evidence.limits)


def _with_optimal_law(request: Request, optimal: OptimalDurations | None) -> dict[str, Any] | None:
    """Return the options of the optimal law, with a longer duration if needed; None without a law."""
    if optimal is None or optimal.shortest is None or request.duration is None:
        return None
    least = DURATION_RESERVE * optimal.shortest
    return OPTIMAL_LAW | ({"duration": round_up(least, 3)} if least > request.duration else {})


def _limits_by_joint(robot: ParallelRobot, limits: dict[str, Array]) -> dict[str, Any]:
    """Return limits (n_a,) by option and joint, infinite ones left out."""
    return {
        name: {
            joint: float(limit)
            for joint, limit in zip(robot.actuator_names, values, strict=True)
            if np.isfinite(limit)
        }
        for name, values in limits.items()
    }
