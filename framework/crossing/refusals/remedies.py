"""What to ask for instead: options of a plan with which a refusal becomes another answer.

Nothing is tried for it. A law that was refused is not advised again, the other one only where condition (8)
and the limits leave it a duration, and numbers are those of the proof.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from framework.crossing.durations import OptimalDurations
from framework.crossing.refusals.refusal_proofs import (
    HoldingTorque,
    LeastLimits,
    NoAdmissibleSpeed,
    UnmetCondition,
)
from framework.crossing.request import Request
from framework.errors import NoAnswer
from framework.kinematics.parallel_robot import ParallelRobot

OPTIMAL_LAW: dict[str, Any] = {"law": "optimal", "times": None, "speeds": None}
DURATION_RESERVE = 1.02  # over the least duration, which is met at its limits alone


def remedy_of(
    refusal: NoAnswer, robot: ParallelRobot, request: Request, optimal: OptimalDurations | None
) -> dict[str, Any] | None:
    """Return options of `plan_crossing` to give instead, None for one to leave out; None where none is known.

    `bend` among them stands for `plan_with_modified_path`.

    Args:
        optimal: durations of the optimal law, if it was not tried and there is any.
    """
    if request.at is not None:  # an imposed point: what was said of the located ones does not hold there
        return None
    if not request.may_be_optimal:
        return _with_optimal_law(request, optimal)
    proof = getattr(refusal, "proof", None)
    if isinstance(proof, UnmetCondition):
        return None if proof.stop else {"bend": True}
    if robot.n_e:  # the numbers below are of the undeformed robot
        return None
    if isinstance(proof, NoAdmissibleSpeed):
        if proof.least_duration is not None and request.duration is not None:
            return {"duration": rounded_up(DURATION_RESERVE * proof.least_duration)}
        return _with_limits(proof.least, robot, request)
    if isinstance(proof, HoldingTorque) and proof.least is not None:
        return _with_limits(proof.least, robot, request)
    return None


def _with_optimal_law(request: Request, optimal: OptimalDurations | None) -> dict[str, Any] | None:
    if optimal is None or optimal.shortest is None or request.duration is None:
        return None
    least = DURATION_RESERVE * optimal.shortest
    return OPTIMAL_LAW | ({"duration": rounded_up(least)} if least > request.duration else {})


def _with_limits(least: LeastLimits, robot: ParallelRobot, request: Request) -> dict[str, Any] | None:
    """Return the limits that would do: of torque, of speed, or of both where neither is enough alone."""
    limits = {
        name: {
            joint: rounded_up(limit)
            for joint, limit in zip(robot.actuator_names, values / (1.0 - request.margin), strict=True)
            if np.isfinite(limit)
        }
        for name, values in (("torque_limit", least.torque), ("speed_limit", least.speed))
        if values is not None
    }
    return limits if least.together else dict(list(limits.items())[:1]) or None


def rounded_up(value: float) -> float:
    """Return a positive number with three digits that is not below it."""
    unit = 10.0 ** (np.floor(np.log10(value)) - 2)
    return float(f"{np.ceil(value / unit) * unit:.3g}")
