"""What is told of a finished motion: its crossings and its certificate, whoever chose the law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from framework.crossing.condition import (
    Condition8,
    Deflection,
    coefficients_at,
    crossing_point,
)
from framework.crossing.request import Request
from framework.crossing.result import Crossing, CrossingPlan, Optimality
from framework.crossing.targets import TargetedPath
from framework.crossing.timing import CrossingTime
from framework.dynamics.result import InverseDynamics, SingularityCrossing
from framework.motion.law import PlannedLaw
from framework.singularity.points_on_path import SingularPoint

SAME_TIME = 1e-9  # of the duration, and of the speed: a crossing this near to one asked for is that one
SAME_PLACE = 1e-9  # in s: an imposed place this near to a singular point is that point


def finished_plan(
    targeted: TargetedPath,
    request: Request,
    dynamics: InverseDynamics,
    law: PlannedLaw,
    timing: Sequence[CrossingTime],
    *,
    seconds: float,
    reason: str,
    optimality: Optimality | None = None,
    conditions: Sequence[Condition8] = (),
) -> CrossingPlan:
    """The plan of a motion that has its torques.

    Args:
        timing: when and how fast the law was made to cross; a crossing that is found so to rounding has these
            numbers, any other its own.
        seconds, reason, optimality: of the plan.
        conditions: those that the law was made to meet, one for each target; measured if not at hand.
    """
    asked = _asked(targeted, dynamics.crossings)
    crossings = []
    for found, k in zip(dynamics.crossings, asked, strict=True):
        time, speed = _timing(found.time, law, timing)
        condition = None
        if k is not None:
            condition = conditions[k] if conditions else _condition(targeted, request, dynamics, k, time)
        crossings.append(
            Crossing(
                s=found.s,
                time=time,
                speed=speed,
                acceleration=float(law(time, 2)),
                kind=found.kind,
                twist=found.twist,
                platform=found.platform,
                residual=found.residual,
                condition=condition,
            )
        )
    certificate = replace(dynamics.certificate, monotone=law.advance(request.smoothness) > 0)
    return CrossingPlan(
        robot=dynamics.robot,
        request=request,
        law=law,
        crossings=tuple(crossings),
        dynamics=dynamics,
        certificate=certificate,
        seconds=seconds,
        reason=reason,
        optimality=optimality,
    )


def _timing(found: float, law: PlannedLaw, timing: Sequence[CrossingTime]) -> CrossingTime:
    """When and how fast the law crosses near an instant that was found."""
    for asked in timing:
        if abs(asked.time - found) < SAME_TIME * law.duration:
            speed = float(law(asked.time, 1))
            return asked if abs(asked.speed - speed) < SAME_TIME * speed else asked._replace(speed=speed)
    return CrossingTime(found, float(law(found, 1)))


def _asked(targeted: TargetedPath, found: Sequence[SingularityCrossing]) -> list[int | None]:
    """Which target was asked for where the motion crosses; None where nothing was."""
    targets = targeted.targets
    if len(targets) == len(found) and all(isinstance(one, SingularPoint) for one in targets):
        return list(range(len(found)))  # both in the order of the path; springs may have moved the crossings
    return [
        next((k for k, target in enumerate(targets) if abs(target.s - one.s) < SAME_PLACE), None)
        for one in found
    ]


def _condition(
    targeted: TargetedPath, request: Request, dynamics: InverseDynamics, k: int, time: float
) -> Condition8:
    """The coefficients of condition (8) where and when the motion crosses, with its own deflections."""
    if request.geometry != "deformed" or not dynamics.robot.n_e:
        _, coefficients = targeted.at_rest[k]
        return coefficients[0]
    target = targeted.targets[k]
    here = Deflection(*(dynamics.deflection(time, order) for order in range(3)))
    place = (
        crossing_point(targeted.branch, target, here, float(dynamics.law(np.array(time))))
        if isinstance(target, SingularPoint)
        else target
    )
    return coefficients_at(targeted.branch, place, here)[0]
