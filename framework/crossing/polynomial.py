"""The paper's law: one polynomial through the times, speeds and accelerations of its crossings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.crossing.condition import (
    Condition8,
    CrossingPoint,
    Deflection,
    condition_at,
    crossing_point,
    effective,
)
from framework.crossing.crossing_points import PathToCross
from framework.crossing.refusals.remedies import OPTIMAL_LAW
from framework.crossing.refusals.turning_back import check_advance
from framework.crossing.refusals.uncrossable_points import check_one_condition_each
from framework.crossing.request import Request
from framework.crossing.timing import CrossingTime, choose_timing
from framework.dynamics.inverse_dynamics import resolve
from framework.dynamics.result import InverseDynamics
from framework.errors import InvalidInput, NoLaw
from framework.motion.chebyshev import TimeFunction
from framework.motion.law import Law, MotionLaw, conditions_at_instants, laws_through

OF_A_SCENE = (
    "times and speeds of a scene belong to its own duration: give others for this one, or take law optimal, "
    "which finds its own"
)


class PolynomialMotion(NamedTuple):
    """The certified motion, its law, and what that was made to meet, when and how fast."""

    dynamics: InverseDynamics
    law: Law
    timing: tuple[CrossingTime, ...]
    conditions: list[Condition8]


def polynomial_motion(to_cross: PathToCross, request: Request) -> PolynomialMotion:
    """Certify the motion with the polynomial of least degree; choose what is open of its timing.

    Raises:
        As `plan_crossing`.
    """
    branch, points = to_cross.branch, to_cross.points
    robot, choice = branch.robot, timing_of(to_cross, request)

    def crossings(
        deflections: TimeFunction | None, before: MotionLaw | None
    ) -> list[tuple[CrossingPoint, Condition8]]:
        if deflections is None or request.geometry != "deformed":
            return _at_rest(to_cross)
        crossings_found = []
        for target, crossing_time in zip(to_cross.crossing_points, choice, strict=True):
            deflection = Deflection.at(deflections, crossing_time.time)
            near = target.s if before is None else float(before(crossing_time.time))
            place = crossing_point(branch, target, deflection, near)
            crossings_found.append((place, condition_at(branch, place, deflection)))
        return crossings_found

    def choose_law(deflections: TimeFunction | None, before: MotionLaw | None) -> Law:
        conditions_met = crossings(deflections, before)
        law = _law(conditions_met, choice, request, robot.name)
        if before is None:
            _check_advance(law, request, [point.s for point in points], robot.name)
        chosen[law] = law, [condition for _, condition in conditions_met]
        return law

    chosen: dict[MotionLaw, tuple[Law, list[Condition8]]] = {}
    dynamics = resolve(
        to_cross.searched,
        choose_law,
        geometry=request.geometry,
        tolerance=request.tolerance,
        friction=request.friction,
    )
    law, conditions = chosen[dynamics.law]
    if len(chosen) > 1:  # else it is the first law, which has been checked
        _check_advance(law, request, [crossing.s for crossing in dynamics.crossings], robot.name)
    return PolynomialMotion(dynamics, law, choice, conditions)


def polynomial_at_rest(to_cross: PathToCross, request: Request) -> Law:
    """Compute the law of the undeformed robot before anything is proved.

    Raises:
        As `plan_crossing`, but no UnboundedTorque and no NotConverged.
    """
    crossings = _at_rest(to_cross)
    name = to_cross.branch.robot.name
    law = _law(crossings, timing_of(to_cross, request), request, name)
    _check_advance(law, request, [point.s for point in to_cross.points], name)
    return law


def _check_advance(law: Law, request: Request, s: Sequence[float], name: str) -> None:
    """Refuse what `check_advance` refuses; a law that always advances needs no look at its samples."""
    if law.advance(request.smoothness) <= 0:
        check_advance(law, s, name)


def _at_rest(to_cross: PathToCross) -> list[tuple[CrossingPoint, Condition8]]:
    """Return the crossing points of the undeformed robot, and condition (8) there."""
    return [
        (place, effective(to_cross.branch, place, condition, None)) for place, condition in to_cross.at_rest
    ]


def _law(
    crossings: list[tuple[CrossingPoint, Condition8]],
    crossing_times: Sequence[CrossingTime],
    request: Request,
    name: str,
) -> Law:
    duration = request.fixed_duration
    values = [
        (place.s, crossing_time.speed, condition.acceleration(crossing_time.speed))
        for (place, condition), crossing_time in zip(crossings, crossing_times, strict=True)
    ]
    inner = conditions_at_instants([crossing_time.time for crossing_time in crossing_times], values)
    try:
        return Law.rest_to_rest(duration, request.smoothness, inner)
    except InvalidInput as problem:
        through = ", ".join(
            f"t = {crossing_time.time:g} s (s' = {crossing_time.speed:g} 1/s)"
            for crossing_time in crossing_times
        )
        why = (
            f"no polynomial over {duration:g} s through {through or 'the ends'} could be computed: {problem}"
        )
        if request.times is None:
            raise NoLaw(f"{name}: {why}") from None
        raise InvalidInput(f"times: {why}; {OF_A_SCENE}").advising(OPTIMAL_LAW) from None


def timing_of(to_cross: PathToCross, request: Request) -> tuple[CrossingTime, ...]:
    """Return times and speeds of the crossings of the undeformed robot; choose those left open."""
    duration = request.fixed_duration
    if not to_cross.crossing_points:
        return ()
    check_one_condition_each(to_cross.branch.robot, to_cross.crossing_points)
    for t in request.times or ():
        if not 0 < t < duration:
            raise InvalidInput(
                f"times: a crossing at t = {t:g} s must lie inside the motion, (0, {duration:g}) s; "
                f"{OF_A_SCENE}"
            ).advising(OPTIMAL_LAW)
    crossings = _at_rest(to_cross)

    s = [place.s for place, _ in crossings]

    def laws(times: Array, speeds: Array) -> tuple[Array, Array]:
        accelerations = [
            condition.acceleration(v) for (_, condition), v in zip(crossings, speeds.T, strict=True)
        ]
        values = np.stack(np.broadcast_arrays(s, speeds, np.transpose(accelerations)), axis=2)
        return laws_through(duration, request.smoothness, times, values)

    return choose_timing(s, request, laws, to_cross.branch.robot.name)
