"""The paper's law: one polynomial through the times, speeds and accelerations of its crossings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from framework.crossing.condition import (
    Condition8,
    CrossingPoint,
    Deflection,
    condition_at,
    crossing_point,
    effective,
)
from framework.crossing.request import Request
from framework.crossing.targets import TargetedPath
from framework.crossing.timing import CrossingTime, check_advance, choose_timing
from framework.dynamics.inverse_dynamics import resolve
from framework.dynamics.result import InverseDynamics
from framework.errors import InvalidInput, NoLaw
from framework.motion.chebyshev import TimeFunction
from framework.motion.law import Condition, Law, MotionLaw, advance_through
from framework.singularity.points_on_path import SingularPoint

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


def polynomial_motion(targeted: TargetedPath, request: Request) -> PolynomialMotion:
    """The certified motion with the polynomial of least degree; what is open of its timing is chosen.

    Raises:
        As `plan_crossing`.
    """
    branch, points, targets = targeted.branch, targeted.points, targeted.targets
    robot, choice = branch.robot, timing_of(targeted, request)

    def crossings(
        deflections: TimeFunction | None, before: MotionLaw | None
    ) -> list[tuple[CrossingPoint, Condition8]]:
        if deflections is None or request.geometry != "deformed":
            return _at_rest(targeted)
        found = []
        for target, crossing_time in zip(targets, choice, strict=True):
            here = Deflection(*(deflections(crossing_time.time, order) for order in range(3)))
            if isinstance(target, SingularPoint):
                near = target.s if before is None else float(before(crossing_time.time))
                place = crossing_point(branch, target, here, near)
            else:
                place = target
            found.append((place, condition_at(branch, place, here)))
        return found

    def choose_law(deflections: TimeFunction | None, before: MotionLaw | None) -> Law:
        met = crossings(deflections, before)
        law = _law(met, choice, request)
        if before is None:
            check_advance(law, [point.s for point in points], robot.name)
        chosen.append((law, [condition for _, condition in met]))
        return law

    chosen: list[tuple[Law, list[Condition8]]] = []
    dynamics = resolve(targeted.searched, choose_law, geometry=request.geometry, tolerance=request.tolerance)
    law, conditions = next(one for one in reversed(chosen) if one[0] is dynamics.law)
    if len(chosen) > 1:  # else it is the first law, which has been checked
        check_advance(law, [found.s for found in dynamics.crossings], robot.name)
    return PolynomialMotion(dynamics, law, choice, conditions)


def polynomial_at_rest(targeted: TargetedPath, request: Request) -> Law:
    """The law of the undeformed robot before anything is proved.

    Raises:
        As `plan_crossing`, but no UnboundedTorque and no NotConverged.
    """
    crossings = _at_rest(targeted)
    law = _law(crossings, timing_of(targeted, request), request)
    check_advance(law, [point.s for point in targeted.points], targeted.branch.robot.name)
    return law


def _at_rest(targeted: TargetedPath) -> list[tuple[CrossingPoint, Condition8]]:
    """The crossing points of the undeformed robot, and what condition (8) asks there."""
    return [
        (place, effective(targeted.branch, place, coefficients, None))
        for place, coefficients in targeted.at_rest
    ]


def _law(
    crossings: list[tuple[CrossingPoint, Condition8]],
    crossing_times: Sequence[CrossingTime],
    request: Request,
) -> Law:
    inner = _inner(crossings, crossing_times)
    duration = request.fixed_duration
    try:
        return Law.rest_to_rest(duration, request.smoothness, inner)
    except InvalidInput as problem:
        through = ", ".join(f"t = {one.time:g} s (s' = {one.speed:g} 1/s)" for one in crossing_times)
        raise InvalidInput(
            f"times: no polynomial over {duration:g} s through {through or 'the ends'} could be computed: "
            f"{problem}; {OF_A_SCENE}"
        ) from None


def _inner(
    crossings: list[tuple[CrossingPoint, Condition8]], crossing_times: Sequence[CrossingTime]
) -> list[Condition]:
    """What the law has to meet at the crossings: s, s' and the s" that condition (8) asks for."""
    return [
        Condition(crossing_time.time, order, value)
        for (place, condition), crossing_time in zip(crossings, crossing_times, strict=True)
        for order, value in enumerate(
            (place.s, crossing_time.speed, condition.acceleration(crossing_time.speed))
        )
    ]


def timing_of(targeted: TargetedPath, request: Request) -> tuple[CrossingTime, ...]:
    """Times and speeds of the crossings on the undeformed robot, those left open chosen."""
    duration = request.fixed_duration
    if not targeted.targets:
        return ()
    check_contacts(targeted)
    for t in request.times or ():
        if not 0 < t < duration:
            raise InvalidInput(
                f"times: a crossing at t = {t:g} s must lie inside the motion, (0, {duration:g}) s; "
                f"{OF_A_SCENE}"
            )
    crossings = _at_rest(targeted)

    def advance(crossing_times: Sequence[CrossingTime]) -> float:
        return advance_through(duration, request.smoothness, _inner(crossings, crossing_times))

    return choose_timing([place.s for place, _ in crossings], request, advance, targeted.branch.robot.name)


def check_contacts(targeted: TargetedPath) -> None:
    """Raise NoLaw where a law has to meet more than one condition, which the polynomial does not.

    At a tangential touch these are condition (8) and its derivative; else one for each motion that escapes.
    """
    for target in targeted.targets:
        if not isinstance(target, SingularPoint):
            continue
        where = f"{targeted.branch.robot.name}: at s = {target.s:.6g}"
        if target.corank > 1:
            raise NoLaw(
                f"{where} {target.corank} motions are uncontrolled at once, each with a condition (8) of "
                f"its own, and the polynomial meets one; use law optimal"
            )
        if target.contact == "tangential":
            raise NoLaw(
                f"{where} the path touches the locus without crossing it; finite torques ask for condition "
                f"(8) and its time derivative at once, and the polynomial meets the first; use law optimal, "
                f"or move the path off the locus or across it"
            )
