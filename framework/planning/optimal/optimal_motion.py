"""The best motion along a path: the law of a cone program and its certified torques, and tried remedies.

A law s = phi(sigma(t)) is given by its squared speed z = (d sigma/dt)^2, splines or one series. A rigid robot
usually needs one law. For elastic robots see `elastic_search`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from framework.errors import InvalidInput, NoAnswer, NoLaw, NotConverged, UnboundedTorque, round_up
from framework.numerics.time_limit import seconds_ended
from framework.planning.motor_use import motor_uses, raise_drives
from framework.planning.optimal.best_law import Best
from framework.planning.optimal.certified_motion import OptimalMotion, certify_motion
from framework.planning.optimal.elastic_search import ElasticSearch
from framework.planning.optimal.optimal_task import Task, check_single_crossings, check_speeds
from framework.planning.optimal.undeformed_law import adapt_found_law, find_undeformed_law
from framework.planning.refusals import (
    ELASTIC_RATIO,
    LONGER_DURATIONS,
    PRINTED_DIGITS,
    HoldingTorque,
    SearchEvidence,
    advice_of,
)
from framework.planning.request import DRIVE_OPTIONS, limit_excess

MAX_PASSES = 12  # of optimising a law and resolving its motion
# shares of the least cost that smoothness may take, tried in turn until the motion is resolved
RIGID_SHARES = (2e-2, 8e-2, 0.3)
TRIAL_SHARE = 3.0  # the same, of a trial of an elastic robot


def optimal_motion(task: Task) -> OptimalMotion:
    """Find the best law within all limits, and certify its motion.

    A refusal of limits advises others after a motion was certified with them.

    Raises:
        NoLaw: no law was found within the limits; the message says why.
        NotConverged: deflections and law do not settle together, or the solver gave up.
        As `resolve`.
    """
    counted = task
    if task.specification.drives is not None and task.to_cross.explained:
        try:
            return _find_motion(task._replace(to_cross=replace(task.to_cross, explained=False)))
        except (NoLaw, NotConverged):
            counted = task._replace(specification=replace(task.specification, drives=None))
    try:
        motion = _find_motion(counted)  # whose refusal has other reasons than drives
    except NoLaw as refusal:
        if isinstance(refusal.evidence, SearchEvidence) and task.to_cross.explained:
            evidence = refusal.evidence
            if task.specification.drives is not None and evidence.quickest is not None:
                evidence = evidence._replace(quickest=_find_quickest(task))  # within drives, too
            sought = _try_remedies(task, evidence)
            numbers = () if isinstance(refusal.proof, HoldingTorque) else sought.clauses
            advice = () if sought.limits is None else (advice_of(task.robot, sought.limits),)
            ended = seconds_ended()  # a motion is tried no longer than that
            untried = () if ended is None else (f"what would do was sought for no longer than {ended:g} s",)
            refusal = refusal.with_changes(clauses=(*numbers, *advice, *untried), evidence=sought)
        raise refusal from None
    if counted is not task and limit_excess(motion.dynamics, task.specification) > 1.0:
        raise _refuse_drives(task, motion)
    return motion


def _find_quickest(task: Task) -> float | None:
    """Find the duration [s] of the quickest certified motion within all limits; None without one."""
    motion = _try_motion(task, {"goal": "time", "duration": None, "longest": None}, is_trial=False)
    return None if motion is None else motion.dynamics.duration


def _try_motion(task: Task, changes: dict[str, Any], *, is_trial: bool = True) -> OptimalMotion | None:
    """Return a certified motion of a task with changes of its specification; None without one.

    Args:
        changes: of fields of the specification, by name.
        is_trial: whether the first motion within the limits does, not the best.
    """
    to_cross = replace(task.to_cross, explained=False)
    specification = replace(task.specification, **changes)
    try:
        task = task._replace(to_cross=to_cross, specification=specification)
        return _find_motion(task, is_trial=is_trial)
    except (NoAnswer, InvalidInput):
        return None


def _refuse_drives(task: Task, plain: OptimalMotion) -> NoLaw:
    """Return the refusal of a task if the `plain` motion, planned without drives, exceeds their limits.

    Advised are the least duration found within all limits, or curves and RMS limits that hold the motion.
    """
    specification = task.specification
    drives = specification.drives
    assert drives is not None
    use = max(motor_uses(plain.dynamics, specification), key=lambda use: use.ratio)
    quickest = None
    # RMS torques alone leave the first law of least time without a bound
    if specification.max_duration is not None and (specification.limited or specification.limited_speeds):
        quickest = _find_quickest(task)
    share = 1.0 - task.request.margin
    raised = raise_drives(plain.dynamics, drives, share)
    cells = len(plain.best.program.cells) - 1
    evidence = _try_remedies(task, SearchEvidence(cells, options=[raised], quickest=quickest))
    clauses = [] if quickest is None else [f"within all limits the quickest law found takes {quickest:.4g} s"]
    if evidence.limits is not None:
        clauses.append(advice_of(task.robot, evidence.limits))
    return NoLaw(
        f"no law of free shape was found within torque-speed curves and RMS torques: "
        f"under the best law within the other limits {use.sentence}",
        name=task.robot.name,
        clauses=tuple(clauses),
        evidence=evidence,
    )


def _try_remedies(task: Task, evidence: SearchEvidence) -> SearchEvidence:
    """Return the evidence with those of its limits and durations for which a motion is certified."""
    if evidence.start_speed is not None:
        slower = task.specification.ends._replace(start=evidence.start_speed)
        if _try_motion(task, {"ends": slower}) is not None:
            return evidence
        evidence = evidence._replace(start_speed=None)
    bound = "longest" if task.specification.duration is None else "duration"
    if evidence.quickest is not None:
        ratios = (ELASTIC_RATIO,) if task.robot.n_e else LONGER_DURATIONS
        durations = (round_up(ratio * evidence.quickest, PRINTED_DIGITS) for ratio in ratios)
        found = (duration for duration in durations if _try_motion(task, {bound: duration}) is not None)
        evidence = evidence._replace(duration=next(found, None))
    # limits of an undeformed robot may not suffice, and raised curves are those of other motors
    if evidence.duration is not None and (task.robot.n_e or not evidence.has_peaks):
        return evidence
    share = 1.0 - task.request.margin
    for raised in evidence.options:
        changes: dict[str, Any] = {name: share * limit for name, limit in raised.items()}
        drives = task.specification.drives
        if drives is not None:  # a curve reaches up to the torque limit
            own = {name: changes.pop(name) for name in DRIVE_OPTIONS if name in changes}
            drives = drives._replace(torque_limit=changes.get("torque_limit", drives.torque_limit), **own)
        if _try_motion(task, changes | {"drives": drives}) is not None:
            return evidence._replace(limits=raised)
        plain = None if drives is None else _try_motion(task, changes | {"drives": None})
        if drives is not None and plain is not None:
            looser = raise_drives(plain.dynamics, drives, share)
            loosened: dict[str, Any] = {name: share * limit for name, limit in looser.items()}
            if _try_motion(task, changes | {"drives": drives._replace(**loosened)}) is not None:
                return evidence._replace(limits=raised | looser)
    if task.request.times:
        open_task = task._replace(request=replace(task.request, times=None))
        return evidence._replace(without_times=_try_motion(open_task, {"times": ()}) is not None)
    return evidence


def _find_motion(task: Task, *, is_trial: bool = False) -> OptimalMotion:
    """Find the best law within all limits, or any in a trial, and certify it; raise as `optimal_motion`."""
    check_single_crossings(task)
    robot = task.robot
    if robot.n_e and robot.is_damped and not task.follows_balance:
        raise NoLaw(
            "optimal laws of elastic robots with damping are not supported with geometry rigid",
            name=robot.name,
        )
    if robot.n_e:
        check_speeds(task)
        search = ElasticSearch.of(task)
        if not is_trial:
            return search.find_motion()
        # smoothness may cost all that the limits leave: the least cost need not be found
        starts = dict.fromkeys(start._replace(share=TRIAL_SHARE) for start in search.starts)
        return next(replace(search, starts=tuple(starts)).find_motions())
    best = find_undeformed_law(task)
    for share in RIGID_SHARES:
        try:
            return _certify_law(task, best)
        except NotConverged:
            best = adapt_found_law(best, share=share)
    return _certify_law(task, best)


def _certify_law(task: Task, best: Best) -> OptimalMotion:
    """Certify the motion of a rigid robot's law; lower limits that the motion exceeds.

    Raises:
        NotConverged: limits are still exceeded, or a torque is not resolved; as `resolve`.
    """
    for _ in range(MAX_PASSES):
        try:
            motion = certify_motion(task, best.law, best)
        except UnboundedTorque as failure:  # condition (8) is met, but for rounding
            raise NotConverged(
                failure.sentence, name=failure.name, residual=abs(failure.wrench), s=failure.s
            ) from None
        excess = limit_excess(motion.dynamics, task.specification)
        if excess <= 1.0:
            return motion
        best = adapt_found_law(best, excess=excess)
    raise NotConverged(
        f"no law within all limits is resolved in {MAX_PASSES} passes",
        name=task.robot.name,
        residual=abs(excess - 1.0),
    )
