"""Plan a crossing: locate the singular points, meet condition (8) in each, prove the torques finite."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import NamedTuple

from framework.crossing.durations import optimal_durations, polynomial_durations
from framework.crossing.feasibility import feasibility_on_path
from framework.crossing.finish import finished_plan
from framework.crossing.optimal_motion import optimal_motion
from framework.crossing.optimal_task import Task
from framework.crossing.polynomial import polynomial_at_rest, polynomial_motion
from framework.crossing.request import Request
from framework.crossing.result import CrossingPlan, Optimality
from framework.crossing.specification import specification_of
from framework.crossing.targets import TargetedPath, targeted_path
from framework.dynamics.crossings import rigid_crossings
from framework.dynamics.inverse_dynamics import TOLERANCE
from framework.dynamics.motor_limits import Limit
from framework.dynamics.result import SingularityCrossing
from framework.errors import LimitsExceeded, NoLaw, NotConverged, UncontrolledMotions
from framework.kinematics.parallel_robot import ParallelRobot
from framework.motion.law import Law
from framework.motion.path import Path
from framework.singularity.points_on_path import SearchedPath, check_of, search_path

CREEPING = 0.1  # least speed over its mean (the ends divided out) below which a polynomial is given up


def plan_crossing(
    robot: ParallelRobot,
    path: Path,
    *,
    duration: float | None = None,
    times: Sequence[float] | None = None,
    speeds: Sequence[float] | None = None,
    at: Sequence[float] | None = None,
    geometry: str | None = None,
    smoothness: int | None = None,
    tolerance: float = TOLERANCE,
    law: str = "auto",
    optimize: str | None = None,
    longest: float | None = None,
    torque_limit: Limit = None,
    speed_limit: Limit = None,
    margin: float = 0.0,
    keep_limits: bool = False,
    searched: SearchedPath | None = None,
) -> CrossingPlan:
    """A rest-to-rest law along the path that crosses its singular points with finite torques.

    Args:
        duration: of the motion [s]; not with optimize="time", which finds the least.
        times: instants of the crossings [s], ascending, one for each singular point; chosen when
            None. An empty list asks for a law without crossing conditions.
        speeds: s' at the crossings [1/s]; chosen when None.
        at: path coordinates to impose condition (8) at, instead of the located singular points.
        geometry: "rigid" takes forces on the undeformed robot (the paper's small displacements);
            "deformed", the default for elastic robots, on the deformed one, whose singular points
            are elsewhere.
        smoothness: derivatives of s that vanish at both ends; 2 for rigid, 4 for elastic robots.
        tolerance: tail of the torques that counts as resolved.
        law: "polynomial" through `times` and `speeds`, "optimal" (see `optimal_law`), or "auto": the
            polynomial where one exists that advances comfortably, and else the optimal law. The plan's
            `reason` says which it was and why.
        optimize: what the optimal law is best at: "time"; "peak_torque", the default: the largest torque
            over its limit, or in N m if no motor has one; "energy": the integral over the motion of the sum
            of (torque over limit)^2. There a motor without a limit is weighed with the largest of the others,
            and never bounded by it. A small weight on the roughness of the law is added.
        longest: duration [s] that the optimal law may not exceed, instead of `duration`.
        torque_limit, speed_limit: of the motors [N m], [rad/s], motor side, a number for all or one for
            each; the robot file's by default. The optimal law never exceeds them.
        margin: share of all limits that is left to the controllers.
        keep_limits: refuse a plan that leaves the limits of its motors or of the URDF's joints, which is
            otherwise returned and says so (`CrossingPlan.exceeded`).
        searched: what `search_path` found on this path, if at hand.

    Raises:
        InvalidInput: an argument that cannot be right; says what is valid.
        NoLaw: no law can cross (a stop on the locus, a path orthogonal to t_s that no speed crosses, a
            singularity that is not of Type 2), or none that always advances was found.
        UncontrolledMotions: several motions are uncontrolled at once, and no law meets what each asks for.
        UnboundedTorque: the law meets a singularity without condition (8); no torque is returned.
        LimitsExceeded: only with `keep_limits`.
        NotConverged, OutOfReach, Type1Singularity, SingularPath: see `inverse_dynamics`.

    Source: Briot and Arakelian 2010, condition (8) and Eqs. (19)-(31).
    """
    request = Request.of(
        robot,
        path,
        duration=duration,
        times=times,
        speeds=speeds,
        at=at,
        geometry=geometry,
        smoothness=smoothness,
        tolerance=tolerance,
        law=law,
        optimize=optimize,
        longest=longest,
        torque_limit=torque_limit,
        speed_limit=speed_limit,
        margin=margin,
        keep_limits=keep_limits,
    )
    return plan_request(robot, request, searched=searched)


def plan_request(
    robot: ParallelRobot, request: Request, *, searched: SearchedPath | None = None
) -> CrossingPlan:
    """`plan_crossing` for a request of this robot.

    Raises:
        As `plan_crossing`.
    """
    started = time.perf_counter()
    if searched is None:
        searched = search_path(robot, request.path)
    check_of(robot, request.path, searched.branch)
    work = _Work(targeted_path(searched, request), request, started)
    try:
        plan = _best(work)
    except UncontrolledMotions:
        raise
    except NoLaw as refusal:
        raise NoLaw(
            "; ".join([str(refusal), *_explanations(searched, request)]), proof=refusal.proof
        ) from None
    exceeded = plan.exceeded if request.keep_limits else {}
    if exceeded:
        listed = "; ".join(f"{joint}: {excess}" for joint, excess in exceeded.items())
        raise LimitsExceeded(f"{robot.name}: the motion leaves limits: {listed}", exceeded=exceeded)
    return plan


def _explanations(searched: SearchedPath, request: Request) -> list[str]:
    """What condition (8) asks for at each singular point, and the durations of laws that were not refused."""
    sentences = [found.sentence for found in feasibility_on_path(searched) if found is not None]
    polynomial = polynomial_durations(searched, request.smoothness)
    if polynomial is not None:
        sentences.append(polynomial.sentence)
    optimal = None if request.may_be_optimal else optimal_durations(searched, request)
    return sentences if optimal is None else [*sentences, optimal.sentence]


def _best(work: _Work) -> CrossingPlan:
    """The plan with the law that is asked for, or with the polynomial or what it falls back on."""
    request = work.request
    if request.kind == "optimal":
        return _optimal(work, "it was asked for")
    try:
        plan, advance = _polynomial(work)
    except NoLaw as refusal:
        if not request.may_be_optimal:
            raise
        try:
            return _optimal(work, f"there is no polynomial: {refusal}")
        except UncontrolledMotions:
            raise
        except (NoLaw, NotConverged) as second:
            proof = refusal.proof or getattr(second, "proof", None)
            raise NoLaw(f"{refusal}; nor does the optimal law help: {second}", proof=proof) from None
    if not request.may_be_optimal or not plan.crossings or request.speeds is not None or advance >= CREEPING:
        return plan
    nearly_stops = f"the polynomial nearly stops: its least speed is {advance:.2g} of its mean"
    try:
        return _optimal(work, nearly_stops)
    except (NoLaw, NotConverged):
        return plan


class _Work(NamedTuple):
    """What planning with either law needs to know."""

    targeted: TargetedPath
    request: Request
    started: float


def _polynomial(work: _Work) -> tuple[CrossingPlan, float]:
    """The plan with the polynomial law, and how well that advances."""
    targeted, request, started = work
    dynamics, law, timing, conditions = polynomial_motion(targeted, request)
    advance = law.advance(request.smoothness)
    reason = "the polynomial advances" if advance > 0 else "the polynomial, though it overshoots its ends"
    if request.kind == "polynomial":
        reason = "it was asked for" if request.law == "polynomial" else "times of the crossings are given"
    seconds = time.perf_counter() - started
    plan = finished_plan(
        targeted, request, dynamics, law, timing, seconds=seconds, reason=reason, conditions=conditions
    )
    return plan, advance


def _optimal(work: _Work, reason: str) -> CrossingPlan:
    """The plan with the optimal law."""
    targeted, request, started = work
    specification = specification_of(targeted.branch.robot, request)
    dynamics, law, best = optimal_motion(Task(targeted, request, specification))
    seconds, optimality = time.perf_counter() - started, Optimality(specification, best.reference)
    return finished_plan(
        targeted, request, dynamics, law, (), seconds=seconds, reason=reason, optimality=optimality
    )


def uncertified_law(
    robot: ParallelRobot,
    path: Path,
    *,
    duration: float,
    times: Sequence[float] | None = None,
    speeds: Sequence[float] | None = None,
    at: Sequence[float] | None = None,
    smoothness: int | None = None,
) -> tuple[Law, tuple[SingularityCrossing, ...]]:
    """The law of `plan_crossing` on the undeformed robot before anything is proved, for raw sampling.

    With it the instants at singular points and t_s . W_p there, zero or not.

    Raises:
        As `plan_crossing`, but no UnboundedTorque and no NotConverged.
    """
    request = Request.of(
        robot, path, duration=duration, times=times, speeds=speeds, at=at, smoothness=smoothness
    )
    return law_before_proof(search_path(robot, path), request)


def law_before_proof(searched: SearchedPath, request: Request) -> tuple[Law, tuple[SingularityCrossing, ...]]:
    """`uncertified_law` of a request, on a path that has been searched.

    Raises:
        As `uncertified_law`.
    """
    law = polynomial_at_rest(targeted_path(searched, request), request)
    return law, rigid_crossings(searched.branch, searched.points, law)
