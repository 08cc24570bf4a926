"""Remedies of refused plans, each tried before it is advised."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields, replace
from typing import Any

from framework.errors import FrameworkError, NoAnswer
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.time_limit import SearchEnded
from framework.planning.plan import plan_request
from framework.planning.refusals import SearchEvidence
from framework.planning.request import Request
from framework.planning.result import CrossingPlan


def plan_or_advise(robot: ParallelRobot, request: Request) -> CrossingPlan:
    """Plan a request; a refusal has the first remedy with which a plan was found.

    Raises:
        InvalidInput, NoAnswer: as `plan_crossing`.
    """
    trial_time = 20.0  # [s] within which an optimal law has to be found
    try:
        return plan_request(robot, request)
    except SearchEnded:
        raise
    except FrameworkError as refusal:
        # the search has certified a motion with the limits or the duration of its evidence
        evidence = refusal.evidence if isinstance(refusal, NoAnswer) else None
        if refusal.remedy and isinstance(evidence, SearchEvidence):
            raise
        candidates = [refusal.remedy] if refusal.remedy else []
        if robot.n_e and request.geometry != "rigid":
            candidates.append({"geometry": "rigid"})
        trial = replace(request, time_limit=min(trial_time, request.time_limit or trial_time))
        tried = (remedy for remedy in candidates if _is_planned(robot, trial, remedy))
        raise refusal.advising(next(tried, None)) from None


def _is_planned(robot: ParallelRobot, request: Request, remedy: Mapping[str, Any]) -> bool:
    """Return whether a request changed by a remedy has a plan: by options, None for one to leave out."""
    with suppress(FrameworkError):
        if "bend" in remedy:
            from framework.planning.path_modification import plan_request_with_modified_path

            plan_request_with_modified_path(robot, request)
            return True
        defaults = {field.name: field.default for field in fields(request)}
        changes: dict[str, Any] = {
            name: defaults[name] if value is None else value for name, value in remedy.items()
        }
        plan_request(robot, replace(request, **changes), explained=False)
        return True
    return False
