"""The law of the paper: one polynomial with given s, s' and s" at its crossings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from framework.dynamics.inverse_dynamics import resolve
from framework.dynamics.known_deflections import KnownDeflections
from framework.dynamics.restoration import solve_balance
from framework.dynamics.result import SingularityCrossing
from framework.dynamics.singularity_crossings import LAW_ROOT_ROUNDING, panel_edges
from framework.errors import InvalidInput, NoAnswer, NoLaw, NotConverged, UnboundedTorque
from framework.laws.clock import InTime
from framework.laws.law import Law, MotionLaw, advances_and_peaks, conditions_at_instants
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import TimeFunction
from framework.planning.condition import (
    Condition8,
    CrossingPoint,
    Deflection,
    condition_at,
    crossing_point,
    require_effect,
)
from framework.planning.crossing_points import PathToCross, check_one_condition_each
from framework.planning.options import OPTIMAL_LAW
from framework.planning.refusals.turning_back import check_advance
from framework.planning.request import Request
from framework.planning.result import CrossingPlan, certified_plan
from framework.planning.timing import CrossingTime, choose_timing
from framework.singularity.points_on_path import SingularPoint

PlannedCrossing = tuple[CrossingPoint, Condition8]

ACCELERATION_STEP = 1e-4  # of differences in s" at a crossing, times the duration squared
MAX_BALANCES = 12  # of law and deflections, until the polynomial passes the crossings

OF_A_SCENE = (
    "times and speeds of a scene belong to its own duration: give others for this one, or take law optimal, "
    "which finds its own"
)


def plan_polynomial(to_cross: PathToCross, request: Request) -> CrossingPlan:
    """Plan with the polynomial of least degree; choose times and speeds left open.

    Deflections shift the crossing points, so each pass of the deflections solves for a law of its own. The
    first law and the last one must advance.

    Raises:
        InvalidInput, NoAnswer: as `plan_crossing`.
    """
    name = to_cross.branch.robot.name
    timing = timing_of(to_cross, request)
    conditions_of: dict[MotionLaw, list[Condition8]] = {}  # by the law of each pass

    def choose_law(deflections: TimeFunction | None, previous: MotionLaw | None) -> Law:
        """Solve for the law at given deflections; check the first law."""
        if deflections is None or request.geometry != "deformed":
            crossings = _undeformed_crossings(to_cross)
        else:
            crossings = _deformed_crossings(to_cross, timing, deflections, previous)
        law = _solve_law(crossings, timing, request, name)
        if previous is None:
            _check_advance(law, request, to_cross.points, name)
        conditions_of[law] = [condition for _, condition in crossings]
        return law

    resolve_with = partial(
        resolve,
        to_cross.searched,
        geometry=request.geometry,
        tolerance=request.tolerance,
        friction=request.friction,
    )
    try:
        dynamics = resolve_with(choose_law)
        conditions = conditions_of[dynamics.law]
    except (NotConverged, UnboundedTorque) as failure:
        if request.geometry != "deformed":
            raise
        try:
            balanced, deflections, conditions = _find_balanced_law(to_cross, request, timing)
            dynamics = resolve_with(lambda *_: balanced, known=deflections)
        except NoAnswer:
            raise failure from None  # it says more
    law = dynamics.law
    assert isinstance(law, Law)
    if request.geometry == "deformed":  # otherwise it is the first law, already checked
        _check_advance(law, request, dynamics.crossings, name)
    return certified_plan(to_cross, request, dynamics, law, timing, conditions=conditions)


class BalancedLaw(NamedTuple):
    """A polynomial, deflections in balance under it, and its conditions (8)."""

    law: Law
    deflections: KnownDeflections
    conditions: list[Condition8]


def _find_balanced_law(
    to_cross: PathToCross, request: Request, timing: Sequence[CrossingTime]
) -> BalancedLaw:
    """Solve for law and deflections together, where passes of the deflections do not converge.

    The scalars of the law are changes of its s" at the crossings. Deflections move the crossings along the
    path, so that the polynomial is solved for again until it passes them at their times.

    Raises:
        NoAnswer: no deflections in balance were found, or the polynomial misses the crossings.
    """
    name = to_cross.branch.robot.name
    times = np.array([time for time, _ in timing])
    crossings = _undeformed_crossings(to_cross)
    deflections: KnownDeflections | None = None
    for _ in range(MAX_BALANCES):
        law, deflections = _balance_accelerations(to_cross, request, timing, crossings, deflections)
        crossings = _deformed_crossings(to_cross, timing, deflections.at, law)
        places = np.array([point.s for point, _ in crossings])
        miss = float(np.abs(law(times) - places).max(initial=0.0))
        if miss <= LAW_ROOT_ROUNDING:
            return BalancedLaw(law, deflections, [condition for _, condition in crossings])
    raise NotConverged(f"{name}: the polynomial misses the crossings by {miss:.2g} in s", residual=miss)


def _balance_accelerations(
    to_cross: PathToCross,
    request: Request,
    timing: Sequence[CrossingTime],
    crossings: Sequence[PlannedCrossing],
    start: KnownDeflections | None,
) -> tuple[Law, KnownDeflections]:
    """Solve for deflections in balance, and for s" at the crossings, at given s and s'.

    Raises:
        NoAnswer: as `solve_balance`.
    """
    branch = to_cross.branch

    def law_of(shifts: Array) -> Law:
        """Return the polynomial with s" at the crossings shifted by (k,) [1/s^2]."""
        return _solve_law(crossings, timing, request, branch.robot.name, shifts)

    at_rest = np.zeros(len(crossings))
    edges = panel_edges(branch, law_of(at_rest))
    steps = at_rest + ACCELERATION_STEP / request.fixed_duration**2
    balance = solve_balance(branch, lambda shifts: InTime(law_of(shifts), edges), steps, start)
    return law_of(balance.scalars), balance.deflections


def undeformed_polynomial(to_cross: PathToCross, request: Request) -> Law:
    """Compute the law of the undeformed robot; its torques are neither computed nor certified.

    Raises:
        InvalidInput: times or speeds of the request do not suit the path.
        NoAnswer: no law meets the conditions and advances, see `plan_crossing`.
    """
    name = to_cross.branch.robot.name
    law = _solve_law(_undeformed_crossings(to_cross), timing_of(to_cross, request), request, name)
    _check_advance(law, request, to_cross.points, name)
    return law


def _check_advance(
    law: Law, request: Request, crossings: Sequence[SingularPoint | SingularityCrossing], name: str
) -> None:
    """Refuse a law that turns back, leaves the path or repeats a crossing.

    Raises:
        NoLaw: as `check_advance`.
    """
    if law.advance(request.smoothness) <= 0:  # otherwise the law advances at all times
        check_advance(law, [crossing.s for crossing in crossings], name)


def _undeformed_crossings(to_cross: PathToCross) -> list[PlannedCrossing]:
    """Return the crossing points of the undeformed robot with their conditions (8).

    Raises:
        NoLaw: no law can meet the condition at some point.
    """
    return [
        (point, require_effect(to_cross.branch, point, condition, deflection=None))
        for point, condition in to_cross.undeformed_crossings
    ]


def _deformed_crossings(
    to_cross: PathToCross,
    timing: Sequence[CrossingTime],
    deflections: Callable[[float, int], Array],
    law: MotionLaw | None,
) -> list[PlannedCrossing]:
    """Compute the crossing points of the deflected robot, with their conditions (8).

    Args:
        deflections: deflections (n_e,) and their time derivatives as a function (t, order).
        law: the law of the last pass, near whose crossings the points are; None for the first pass.
    """
    branch, crossings = to_cross.branch, []
    for target, (time, _) in zip(to_cross.crossing_points, timing, strict=True):
        deflection = Deflection.evaluate(deflections, time)
        s_guess = target.s if law is None else float(law(time))
        point = crossing_point(branch, target, deflection, s_guess)
        crossings.append((point, condition_at(branch, point, deflection)))
    return crossings


def _solve_law(
    crossings: Sequence[PlannedCrossing],
    timing: Sequence[CrossingTime],
    request: Request,
    name: str,
    shifts: Array | None = None,
) -> Law:
    """Solve for the polynomial with the s, s' and s" of each crossing.

    Args:
        shifts: (k,) [1/s^2] of s" at the crossings, from those of the conditions.

    Raises:
        InvalidInput: there is no such polynomial with the user's times.
        NoLaw: there is no such polynomial with chosen times.
    """
    duration = request.fixed_duration
    shifts = np.zeros(len(crossings)) if shifts is None else shifts
    values = [
        (point.s, speed, condition.acceleration(speed) + shift)
        for (point, condition), (_, speed), shift in zip(crossings, timing, shifts, strict=True)
    ]
    inner = conditions_at_instants([time for time, _ in timing], values)
    try:
        return Law.rest_to_rest(duration, request.smoothness, inner)
    except InvalidInput as problem:
        through = ", ".join(f"t = {time:g} s (s' = {speed:g} 1/s)" for time, speed in timing)
        why = (
            f"no polynomial over {duration:g} s through {through or 'the ends'} could be computed: {problem}"
        )
        if request.times is None:
            raise NoLaw(f"{name}: {why}") from None
        raise InvalidInput(f"times: {why}; {OF_A_SCENE}").advising(OPTIMAL_LAW) from None


def timing_of(to_cross: PathToCross, request: Request) -> tuple[CrossingTime, ...]:
    """Return the times and speeds of the undeformed robot's crossings; choose the open ones.

    Raises:
        InvalidInput: a time is not inside the motion.
        NoLaw: no law can cross, or none that advances was found.
    """
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
    crossings = _undeformed_crossings(to_cross)
    s = [point.s for point, _ in crossings]

    def measure(times: Array, speeds: Array) -> tuple[Array, Array]:
        """Compute advance (m,) and peak |s"| (m,) of laws with crossings at times and speeds (m, k)."""
        accelerations = np.transpose(
            [condition.acceleration(v) for (_, condition), v in zip(crossings, speeds.T, strict=True)]
        )
        values = np.stack(np.broadcast_arrays(s, speeds, accelerations), axis=2)  # (m, k, 3): s, s', s"
        return advances_and_peaks(duration, request.smoothness, times, values)

    return choose_timing(s, request, measure, to_cross.branch.robot.name)
