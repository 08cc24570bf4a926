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
from contextlib import suppress
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
from framework.numerics.time_limit import SearchEnded, limit_time, seconds_ended
from framework.planning.crossing_points import PathToCross, path_to_cross
from framework.planning.feasibility import feasibility_on_path, is_crossable
from framework.planning.joint_path import JointPath, with_platform_joints
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
    else:
        check_branch(robot, request.path, searched.branch)  # that it is a branch of this robot and path
    to_cross = path_to_cross(searched, request, explained=explained)
    try:
        with limit_time(request.time_limit):
            plan = _plan_best(to_cross, request)
    except NoAnswer as refusal:
        named = refusal.naming(refusal.name or robot.name)
        if isinstance(named, UncontrolledMotions):  # of several motions one condition (8) explains nothing
            raise named from None
        if isinstance(named, NoLaw):
            at_points = feasibility_on_path(to_cross.searched)
            named = named.adding(*(point.short_sentence for point in at_points if point is not None))
        if isinstance(named, NoLaw | UnboundedTorque):
            named = named.advising(find_remedy(named, to_cross.searched, request))
        raise named from None
    check_limits(plan)
    return replace(plan, seconds=time.perf_counter() - started)


# ------------------------------------------------------------------ the choice between the kinds of law


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
        wish = "a duration left open" if request.optimize is None else f"optimize {request.optimize}"
        try:
            return _plan_optimal(to_cross, request, f"{wish} asks for it")
        except (NoLaw, NotAssembled, NotConverged, SearchEnded) as refusal:
            with limit_time(None):  # the time limit is for the search of the optimal law alone
                return _plan_polynomial_instead(to_cross, request, refusal)
    # Polynomials through several points seldom advance, s' > 0. Without springs, n_e = 0, an optimal law is
    # found sooner than times and speeds with which a polynomial advances.
    may_be_optimal = request.may_be_optimal
    is_few = len(to_cross.crossing_points) < FREE_LAW_CROSSINGS
    is_searched = is_few or to_cross.branch.robot.n_e > 0 or not may_be_optimal
    try:
        plan = plan_polynomial(to_cross, request, searched=is_searched)
    except (NoLaw, NotConverged) as no_polynomial:
        if not may_be_optimal:
            raise
        return _plan_without_polynomial(to_cross, request, no_polynomial, is_searched=is_searched)
    excess = _limit_ratio(plan)
    if excess <= 1.0:
        is_chosen = request.speeds is None and request.times is None
        return _improve_polynomial(to_cross, plan) if may_be_optimal and is_chosen else plan
    if may_be_optimal:
        return _plan_optimal(to_cross, request, f"the polynomial needs {excess:.4g} times the limits")
    use = max(plan.motor_use, key=lambda use: use.ratio)
    raise NoLaw(
        f"the polynomial needs {use.ratio:.4g} times the limits: {use.sentence}",
        clauses=(
            "torque_limit and speed_limit none (inf in Python) lift those of the robot file, "
            "rms_torque_limit none that of RMS torques",
        ),
    )


def _plan_without_polynomial(
    to_cross: PathToCross, request: Request, no_polynomial: NoLaw | NotConverged, *, is_searched: bool
) -> CrossingPlan:
    """Plan with the optimal law or, if none is found, with a polynomial whose times and speeds are searched.

    Args:
        no_polynomial: the refusal of the polynomial.
        is_searched: whether times and speeds of the polynomial were searched before.

    Raises:
        NoLaw, NotConverged: neither law is found; the message has both reasons.
        NoAnswer: the refusal of the optimal law, if times and speeds are searched only now.
    """
    is_none = isinstance(no_polynomial, NoLaw)
    failure = "there is no polynomial" if is_none else "the polynomial is not resolved"
    why = f"optimal, as {failure} over {request.fixed_duration:g} s: {no_polynomial.message}"
    try:
        return _plan_optimal(to_cross, request, why)
    except UncontrolledMotions:  # which no law can cross
        raise
    except SearchEnded as end:
        raise SearchEnded(no_polynomial.message, clauses=(end.sentence,)) from None
    except (NoLaw, NotAssembled, NotConverged) as no_optimal:
        if is_searched:
            both = no_polynomial.adding(f"nor does the optimal law help: {no_optimal.sentence}")
            if isinstance(both, NoLaw):
                proof = both.proof or no_optimal.proof
                raise both.with_changes(proof=proof, evidence=no_optimal.evidence) from None
            # another tolerance resolves the polynomial whatever the optimal law; other remedies were tried
            raise both.advising(both.remedy if "tolerance" in (both.remedy or {}) else None) from None
        return _plan_polynomial_instead(to_cross, request, no_optimal)


def _plan_polynomial_instead(to_cross: PathToCross, request: Request, no_optimal: NoAnswer) -> CrossingPlan:
    """Plan with a polynomial of the requested duration within the limits, or raise `no_optimal`."""
    if request.duration is not None:
        with suppress(NoAnswer):
            plan = plan_polynomial(to_cross, request)
            if _limit_ratio(plan) <= 1.0:
                reason = f"the polynomial, as the optimal law is not found: {no_optimal.sentence}"
                return replace(plan, reason=reason)
    raise no_optimal


def _improve_polynomial(to_cross: PathToCross, plan: CrossingPlan) -> CrossingPlan:
    """Return the plan, or a better one with the optimal law if the plan nearly stops or peaks at a near miss.

    If it nearly stops, any optimal law is better. If its largest torque is beside a near miss of the locus,
    one of lower peak torque is.
    """
    speed_ratio = plan.law.least_speed_ratio(plan.request.smoothness, plan.request.ends)
    nearly_stops = bool(plan.crossings) and speed_ratio < MIN_POLYNOMIAL_ADVANCE
    miss = miss_of_peak(plan, to_cross.searched.near_misses)
    if nearly_stops:
        why = (
            f"the polynomial nearly stops: its least speed is {speed_ratio:.2g} of its mean, its largest "
            f"torque {_peak_text(plan)}"
        )
    elif miss is not None:
        why = (
            f"the polynomial's largest torque, {_peak_text(plan)}, is beside s = {miss.s:.6g}, where "
            f"the path misses a singularity by |g| = {abs(miss.g):.2g}"
        )
    else:
        return plan
    reason = why if nearly_stops else f"{why}; this one's is lower"
    try:
        optimal = _plan_optimal(to_cross, plan.request, reason)
    except NoAnswer as refusal:
        return replace(plan, reason=f"{why}; the optimal law is not found: {refusal.sentence}")
    assert optimal.optimality is not None
    reference = optimal.optimality.reference
    if nearly_stops or max_torque_ratio(optimal, reference) < max_torque_ratio(plan, reference):
        return optimal
    return replace(plan, reason=f"{why}; the optimal law's is {_peak_text(optimal)}{_ended_text()}")


def _limit_ratio(plan: CrossingPlan) -> float:
    """Return the largest ratio of a torque or speed of a plan to its limit."""
    return limit_excess(plan.dynamics, specification_of(plan.robot, plan.request))


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
    times = plan.dynamics.torques.grid.times  # dense where torques peak narrowly
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
    """Plan with the optimal law, for a reason in words."""
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
    if evidence.without_times:
        return {"times": None}
    if evidence.limits is None:
        return None
    remedy = {}
    for option, limits in evidence.limits.items():
        by_joint = zip(robot.actuator_names, limits.tolist(), strict=True)
        remedy[option] = {joint: limit for joint, limit in by_joint if np.isfinite(limit)}
    return remedy
