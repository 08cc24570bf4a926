"""Plan a crossing: locate the singular points, meet condition (8) at each, prove that torques are finite.

The singular points are those of Type 2 on the path, where the measure g vanishes; at a near miss |g| is
least, but not zero. Condition (8) on s' and s" keeps the torques finite there (`condition`).

There are two kinds of law, the polynomial and the optimal one; `_plan_best` chooses between them. A third
kind would need a `PlannedLaw`, a function like `plan_polynomial`, a name in `options.LAWS`, and a reader in
`saved`.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from framework.dynamics.motor_limits import motor_limits
from framework.dynamics.result import SingularityCrossing
from framework.dynamics.singularity_crossings import rigid_crossings
from framework.errors import (
    LimitsExceeded,
    NoAnswer,
    NoLaw,
    NotAssembled,
    NotConverged,
    UnboundedTorque,
    UncontrolledMotions,
)
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import Law
from framework.laws.optimal_law import HIGHEST_SMOOTHNESS
from framework.laws.path import Path
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import TimeGrid
from framework.numerics.time_limit import SearchEnded, limit_time, seconds_ended
from framework.planning.crossing_points import PathToCross, path_to_cross
from framework.planning.feasibility import feasibility_on_path, is_crossable
from framework.planning.joint_path import JointPath, with_platform_joints
from framework.planning.motor_use import find_largest_use
from framework.planning.options import OPTIMAL_LAW, takes_options
from framework.planning.polynomial import plan_polynomial, undeformed_polynomial
from framework.planning.refusals import SearchEvidence, UnmetCondition
from framework.planning.request import Request, limit_excess, specification_of
from framework.planning.result import CrossingPlan, Optimality, certified_plan
from framework.singularity.points_on_path import SearchedPath, check_branch, search_path
from framework.singularity.rank_deficiency import NearMiss
from framework.tolerances import MIN_POLYNOMIAL_ADVANCE, NEAR_MISS_WIDTHS

FREE_LAW_CROSSINGS = 3  # from which the optimal law of a rigid robot comes before a search for a polynomial


@takes_options
def plan_crossing(robot: ParallelRobot, path: Path | JointPath, **options: Any) -> CrossingPlan:
    """Plan a rest-to-rest motion that crosses singular points with finite torques.

    Args:
        robot: as returned by `load_robot`; its `flexibility` says which springs exist.
        path: the platform's path: a `Line`, `Arc`, `Spline` or `Polyline`, or a function path(s, order) that
            returns (T, n) for s in [0, 1] and derivatives up to order 4, with attributes `n` and `knots`. The
            knots are the s inside (0, 1) at which pieces of the path join (an empty array for one piece). A
            `JointPath` is given in joints without motors: the robot of its plan has their positions as
            platform coordinates.
        {options}

    Returns:
        The plan: its law s(t), the crossings, motor torques, motor angles and deflections as functions of
        time, and the certificate that proves them (`CrossingPlan`).

    Raises:
        InvalidInput: invalid arguments, for instance more times than the path has crossings.
        NoLaw: no law can cross (the message says what would help), or none that advances was found.
        UncontrolledMotions: no law can cross a point where several motions are uncontrolled at once.
        UnboundedTorque: the law violates condition (8) at a singularity.
        LimitsExceeded: the motion exceeds limits; only with `keep_limits`.
        NotConverged, OutOfReach, Type1Singularity, SingularPath: see `inverse_dynamics`.
        `framework.planning.refusals` lists all refusals in the order in which they are checked.

    Example:
        >>> from framework import Line, load_robot, plan_crossing
        >>> plan = plan_crossing(load_robot("five_bar"), Line([0.1, 0.345], [-0.05, 0.195]), duration=1.5)
        >>> [round(crossing.s, 9) for crossing in plan.crossings], plan.torque(0.5).shape
        ([0.667006875], (2,))

    Source: Briot and Arakelian 2010, condition (8) and Eqs. (19)-(31).
    """
    if isinstance(path, JointPath):
        robot, path = with_platform_joints(robot, path.joints), path.path
    return plan_request(robot, Request.of(robot, path, **options))


def plan_request(
    robot: ParallelRobot,
    request: Request,
    *,
    searched: SearchedPath | None = None,
    explained: bool = True,
) -> CrossingPlan:
    """Plan a request of this robot, as `plan_crossing` does with its options.

    Args:
        searched: the path with its singular points, if they have been located already.
        explained: whether a refusal also searches for limits and a duration within which a law exists, which
            takes time.

    Raises:
        InvalidInput, NoAnswer: as `plan_crossing`.
    """
    started = time.perf_counter()
    if searched is None:
        searched = search_path(robot, request.path)
    check_branch(robot, request.path, searched.branch)  # that it is a branch of this robot and path
    to_cross = path_to_cross(searched, request, explained=explained)
    searched = to_cross.searched  # under the wrenches of the request
    try:
        with limit_time(request.time_limit):
            plan = _plan_best(to_cross, request)
    except NoAnswer as refusal:
        refusal.name = refusal.name or robot.name
        # of several uncontrolled motions one condition (8) explains nothing
        if isinstance(refusal, NoLaw) and not isinstance(refusal, UncontrolledMotions):
            at_points = feasibility_on_path(searched)
            refusal.adding(*(point.short_sentence for point in at_points if point is not None))
            refusal.advising(find_remedy(refusal, searched, request))
        elif isinstance(refusal, UnboundedTorque):
            refusal.advising(find_remedy(refusal, searched, request))
        raise
    check_limits(plan)
    return replace(plan, seconds=time.perf_counter() - started)


def _plan_best(to_cross: PathToCross, request: Request) -> CrossingPlan:
    """Plan with the kind of law that the request names, or choose the kind.

    A goal, or limits without a duration, ask for the optimal law; the polynomial replaces it if no optimal
    law is found. Otherwise the polynomial is tried first. The optimal law replaces a polynomial that is
    refused, exceeds the limits or, unless times or speeds are given, nearly stops or has its largest torque
    beside a near miss of the locus.
    """
    if request.law == "optimal":
        return _plan_optimal(to_cross, request, "it was asked for")
    if request.kind == "optimal":  # by a goal, or by limits without a duration
        has = "a goal" if request.optimize is not None else "a duration of its own"
        try:
            return _plan_optimal(to_cross, request, f"only the optimal law has {has}")
        except (NoLaw, NotAssembled, NotConverged, SearchEnded) as refusal:
            with limit_time(None):  # the time limit is for the search of the optimal law alone
                return _plan_polynomial_within_limits(to_cross, request, refusal)

    may_be_optimal = request.may_be_optimal
    # polynomials through several points seldom advance, and to search for one takes longer than a free law
    is_searched = (
        len(to_cross.crossing_points) < FREE_LAW_CROSSINGS
        or to_cross.branch.robot.n_e > 0
        or not may_be_optimal
    )
    try:
        plan = plan_polynomial(to_cross, request, searched=is_searched)
    except (NoLaw, NotConverged) as refusal:
        if not may_be_optimal:
            raise
        return _plan_after_refusal(to_cross, request, refusal, is_searched=is_searched)

    excess = _limit_ratio(plan)
    if excess > 1.0:
        needs = f"the polynomial needs {excess:.4g} times the limits"
        if may_be_optimal:
            return _plan_optimal(to_cross, request, needs)
        raise NoLaw(
            f"{needs}{_drives_text(plan)}",
            clauses=(
                "torque_limit and speed_limit none (inf in Python) lift those of the robot file, "
                "rms_torque_limit none that of RMS torques",
            ),
        )
    if not may_be_optimal or request.speeds is not None or request.times is not None:
        return plan
    return _improve_polynomial(to_cross, plan)


def _improve_polynomial(to_cross: PathToCross, plan: CrossingPlan) -> CrossingPlan:
    """Return the plan, or one with the optimal law if the plan nearly stops or peaks beside a near miss.

    Args:
        plan: with the polynomial, within the limits.
    """
    speed_ratio = plan.law.least_speed_ratio(plan.request.smoothness, plan.request.ends)
    if plan.crossings and speed_ratio < MIN_POLYNOMIAL_ADVANCE:
        nearly_stops = (
            f"the polynomial nearly stops: its least speed is {speed_ratio:.2g} of its mean, its largest "
            f"torque {_peak_text(plan)}"
        )
        try:
            return _plan_optimal(to_cross, plan.request, nearly_stops)
        except NoAnswer as refusal:
            return replace(plan, reason=f"{nearly_stops}; the optimal law is not found: {refusal.sentence}")
    miss = miss_of_peak(plan, to_cross.searched.near_misses)
    return plan if miss is None else _plan_lower_peak(to_cross, plan, miss)


def _plan_after_refusal(
    to_cross: PathToCross, request: Request, refusal: NoLaw | NotConverged, *, is_searched: bool
) -> CrossingPlan:
    """Plan with the optimal law after a refusal of the polynomial.

    Args:
        refusal: of the polynomial.
        is_searched: whether times and speeds of polynomials were searched; if not, this is the last resort.

    Raises:
        NoLaw, NotConverged: the optimal law is refused as well; the message has both reasons.
        UncontrolledMotions, SearchEnded: as for the optimal law.
    """
    is_unresolved = isinstance(refusal, NotConverged)
    failure = "the polynomial is not resolved" if is_unresolved else "there is no polynomial"
    why = f"optimal, as {failure} over {request.fixed_duration:g} s: {refusal.message}"
    try:
        return _plan_optimal(to_cross, request, why)
    except UncontrolledMotions:
        raise
    except SearchEnded as end:
        raise SearchEnded(refusal.message, clauses=(end.sentence,)) from None
    except (NoLaw, NotAssembled, NotConverged) as optimal_refusal:
        if not is_searched:
            return _plan_polynomial_within_limits(to_cross, request, optimal_refusal)
        refusal.adding(f"nor does the optimal law help: {optimal_refusal.sentence}")
        if isinstance(refusal, NoLaw):
            refusal.proof = refusal.proof or optimal_refusal.proof
            refusal.evidence = optimal_refusal.evidence
        # that the polynomial is resolved to another tolerance does not depend on the optimal law
        raise refusal.advising(refusal.remedy if "tolerance" in (refusal.remedy or {}) else None) from None


def _plan_polynomial_within_limits(
    to_cross: PathToCross, request: Request, refusal: NoAnswer
) -> CrossingPlan:
    """Plan with the polynomial after a refusal of the optimal law.

    Args:
        refusal: of the optimal law.

    Raises:
        NoAnswer: `refusal`, if there is no polynomial of a requested duration within the limits.
    """
    if request.duration is None:
        raise refusal
    try:
        plan = plan_polynomial(to_cross, request)
    except NoAnswer:
        raise refusal from None
    if _limit_ratio(plan) > 1.0:
        raise refusal
    return replace(plan, reason=f"the polynomial, as the optimal law is not found: {refusal.sentence}")


def _limit_ratio(plan: CrossingPlan) -> float:
    """Return the largest ratio of a torque or speed of a plan to its limit."""
    return limit_excess(plan.dynamics, specification_of(plan.robot, plan.request))


def _drives_text(plan: CrossingPlan) -> str:
    """Describe the largest use of motors if of a curve or RMS torque, else nothing."""
    use = find_largest_use(plan.dynamics, specification_of(plan.robot, plan.request))
    if use is None or use.limit in ("torque", "speed"):
        return ""
    return f": {use.sentence}"


def _plan_lower_peak(to_cross: PathToCross, polynomial: CrossingPlan, miss: NearMiss) -> CrossingPlan:
    """Plan with the optimal law; return the plan of lower peak torque, that one or the polynomial.

    Args:
        polynomial: the plan whose largest torque is beside the near miss.
        miss: the near miss.
    """
    why = (
        f"the polynomial's largest torque, {_peak_text(polynomial)}, is beside s = {miss.s:.6g}, where "
        f"the path misses a singularity by |g| = {abs(miss.g):.2g}"
    )
    try:
        optimal = _plan_optimal(to_cross, polynomial.request, f"{why}; this one's is lower")
    except NoAnswer as refusal:
        return replace(polynomial, reason=f"{why}; the optimal law is not found: {refusal.sentence}")
    assert optimal.optimality is not None
    reference = optimal.optimality.reference
    if max_torque_ratio(optimal, reference) < max_torque_ratio(polynomial, reference):
        return optimal
    return replace(polynomial, reason=f"{why}; the optimal law's is {_peak_text(optimal)}{_ended_text()}")


def miss_of_peak(plan: CrossingPlan, near_misses: Sequence[NearMiss]) -> NearMiss | None:
    """Return the one of the path's near misses beside which a plan has its largest torque, if any.

    Torques of different motors are divided by their limits, or compared in N m and N if a motor has none.

    Beside a near miss at s0, |g| is about g0 (1 + x^2) with x = (s - s0) / width. The motors need torques
    (c + d x) / |g|, where c + d x is the required force along t_s, to first order. For any c and d these
    torques are largest at some |x| <= 1. Other torques shift the peak outwards, so a peak counts as beside
    the near miss up to |x| = NEAR_MISS_WIDTHS.
    """
    if not near_misses:
        return None
    torques = plan.dynamics.torques
    times = TimeGrid(torques.edges, torques.coefficients.shape[1]).times  # dense where torques peak narrowly
    limits = motor_limits(plan.robot, "torque_limit", None)
    reference = limits if np.isfinite(limits).all() else 1.0
    largest = (np.abs(plan.torque(times)) / reference).max(axis=1)  # (T,) of all motors
    s_peak = plan.law(times[np.argmax(largest)])
    beside_peak = (miss for miss in near_misses if abs(s_peak - miss.s) <= NEAR_MISS_WIDTHS * miss.width)
    return next(beside_peak, None)


def max_torque_ratio(plan: CrossingPlan, reference: Array) -> float:
    """Return the largest ratio of a plan's peak torques to the reference (n_a,) [N m, N]."""
    peaks = np.array(list(plan.peak_torque.values()))
    return max(peaks / reference)


def _peak_text(plan: CrossingPlan) -> str:
    """Return the largest torque [N m] of turning motors and force [N] of sliding ones, in words."""
    largest: dict[str, float] = {}
    for torque, unit in zip(plan.peak_torque.values(), plan.robot.torque_units, strict=True):
        largest[unit] = max(torque, largest.get(unit, 0.0))
    return ", ".join(f"{torque:.4g} {unit}" for unit, torque in largest.items())


def _plan_optimal(to_cross: PathToCross, request: Request, reason: str) -> CrossingPlan:
    """Plan with the optimal law.

    Args:
        reason: for the choice of this law, in words.

    Raises:
        NoAnswer: as `plan_crossing`.
    """
    from framework.planning.optimal.optimal_motion import optimal_motion  # slow to import, seldom needed
    from framework.planning.optimal.optimal_task import Task

    specification = specification_of(to_cross.branch.robot, request)
    dynamics, law, best = optimal_motion(Task(to_cross, request, specification))
    optimality = Optimality(specification, best.reference, best.gap)
    reason += _ended_text()
    return certified_plan(to_cross, request, dynamics, law, timing=(), reason=reason, optimality=optimality)


def _ended_text() -> str:
    """Return the clause of a search that was ended after its first result; empty if it was not."""
    seconds = seconds_ended()
    return "" if seconds is None else f"; the search was ended after {seconds:g} s, there may be better laws"


@takes_options
def uncertified_law(
    robot: ParallelRobot, path: Path, **options: Any
) -> tuple[Law, tuple[SingularityCrossing, ...]]:
    """Compute the law of `plan_crossing` for the undeformed robot, before its proof.

    Returns:
        The law, and its crossings: the instants at singular points, each with t_s . W_p, which need not be
        zero.

    Raises:
        InvalidInput, NoAnswer: as `plan_crossing`, except UnboundedTorque and NotConverged.
    """
    return law_before_proof(search_path(robot, path), Request.of(robot, path, **options))


def law_before_proof(searched: SearchedPath, request: Request) -> tuple[Law, tuple[SingularityCrossing, ...]]:
    """Compute the law of a request before its proof, and its crossings, as `uncertified_law` does.

    Args:
        searched: the path with its singular points.

    Raises:
        InvalidInput, NoAnswer: as `uncertified_law`.
    """
    to_cross = path_to_cross(searched, request)
    try:
        law, _timing = undeformed_polynomial(to_cross, request)
    except NoLaw as refusal:
        raise refusal.naming(searched.branch.robot.name) from None
    return law, rigid_crossings(to_cross.branch, to_cross.points, law)


# ------------------------------------------------------------------ explanations and remedies of refusals


def check_limits(plan: CrossingPlan) -> None:
    """Raise LimitsExceeded if a plan with `keep_limits` exceeds limits."""
    exceeded = plan.exceeded if plan.request.keep_limits else {}
    if exceeded:
        listed = "; ".join(f"{joint}: {excess}" for joint, excess in exceeded.items())
        raise LimitsExceeded(f"the motion leaves limits: {listed}", name=plan.robot.name, exceeded=exceeded)


def find_remedy(refusal: NoAnswer, searched: SearchedPath, request: Request) -> dict[str, Any] | None:
    """Return the options of `plan_crossing` with which to try again; None without a remedy.

    An option with the value None is to be left out. A kind of law that was refused is not advised again. The
    optimal law is advised only if condition (8) admits a law. A motion was certified with each advised limit
    and duration (`SearchEvidence`). The option `bend` stands for `path_modification`.

    Args:
        refusal: of the request.
        searched: the path with its singular points.
    """
    robot = searched.branch.robot
    if request.at is not None:  # imposed points: the proofs are about the located ones
        return None
    if not request.may_be_optimal:
        has_optimal_form = request.smoothness <= HIGHEST_SMOOTHNESS and request.duration is not None
        return OPTIMAL_LAW if has_optimal_form and is_crossable(searched) else None
    if isinstance(refusal, NoLaw) and isinstance(refusal.proof, UnmetCondition):
        return None if refusal.proof.stop else {"bend": True}  # a bend keeps the ends of the path
    evidence = refusal.evidence
    if not isinstance(evidence, SearchEvidence):
        return OPTIMAL_LAW if request.times and request.law == "auto" and is_crossable(searched) else None
    if evidence.start_speed is not None:
        return {"start_speed": list(evidence.start_speed)}
    if evidence.duration is not None:
        return {"longest" if request.duration is None else "duration": evidence.duration}
    if evidence.limits is None:
        return None
    remedy = {}
    for option, limits in evidence.limits.items():
        by_joint = zip(robot.actuator_names, limits.tolist(), strict=True)
        remedy[option] = {joint: limit for joint, limit in by_joint if np.isfinite(limit)}
    return remedy
