"""The best motion along a path: the law of a cone program, alternating with certified inverse dynamics.

A law s = phi(sigma(t)) is given by its squared speed z = (d sigma/dt)^2, splines or one series. A rigid robot
usually needs one round. An elastic robot cannot follow every law: `elastic_loop` improves a law about its own
motion in balance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from framework.errors import InvalidInput, NoAnswer, NoLaw, NotConverged, UnboundedTorque, round_up
from framework.planning.optimal.best_law import Best
from framework.planning.optimal.elastic_balance import check_rest
from framework.planning.optimal.elastic_loop import find_elastic_motion
from framework.planning.optimal.optimal_task import (
    OptimalMotion,
    Task,
    check_single_crossings,
    check_speeds,
    find_crossing_points,
    resolve_planned_law,
)
from framework.planning.optimal.undeformed_law import adapt_found_law, find_law
from framework.planning.refusals import PRINTED_DIGITS, SearchEvidence, advice_of
from framework.planning.request import limit_excess
from framework.singularity.points_on_path import SingularPoint

MAX_PASSES = 12  # of optimising a law and resolving its motion
# shares of the least cost that smoothness may take, tried in turn until the motion is resolved
RIGID_SHARES = (2e-2, 8e-2, 0.3)


def optimal_motion(task: Task) -> OptimalMotion:
    """Find the best law within all limits, and certify its motion.

    A refusal of limits advises others after a motion was certified with them.

    Raises:
        NoLaw: no law was found within the limits; the message says why.
        NotConverged: deflections and law do not settle together, or the solver gave up.
        As `resolve`.
    """
    try:
        return _find_motion(task)
    except NoLaw as refusal:
        if isinstance(refusal.evidence, SearchEvidence) and task.to_cross.explained:
            refusal.evidence = evidence = _try_remedies(task, refusal.evidence)
            if evidence.limits is not None:
                refusal.args = (f"{refusal}; {advice_of(task.robot, evidence.limits)}",)
        raise


def _try_remedies(task: Task, evidence: SearchEvidence) -> SearchEvidence:
    """Return the evidence with those of its limits and durations for which a motion is certified.

    Args:
        task: the task that was refused.
        evidence: the search for the least limits and the least duration.
    """

    def has_motion(**changes: Any) -> bool:
        """Return whether a motion is certified with changes of the specification."""
        to_cross = replace(task.to_cross, explained=False)
        specification = replace(task.specification, **changes)
        try:
            _find_motion(task._replace(to_cross=to_cross, specification=specification))
        except (NoAnswer, InvalidInput):
            return False
        return True

    if evidence.start_speed is not None:
        slower = task.specification.ends._replace(start=evidence.start_speed)
        if has_motion(ends=slower):
            return evidence
        evidence = evidence._replace(start_speed=None)
    if evidence.quickest is not None:
        duration = round_up(evidence.quickest, PRINTED_DIGITS)
        bound = "longest" if task.specification.duration is None else "duration"
        if has_motion(**{bound: duration}):
            evidence = evidence._replace(duration=duration)
            if task.robot.n_e:  # the least limits are those of the undeformed robot, and seldom suffice
                return evidence
    share = 1.0 - task.request.margin
    for raised in evidence.least.options:
        if has_motion(**{name: share * limit for name, limit in raised.items()}):
            return evidence._replace(limits=raised)
    return evidence


def _find_motion(task: Task) -> OptimalMotion:
    """Find the best law within all limits, and certify its motion; raise as `optimal_motion`."""
    check_single_crossings(task)
    points = find_crossing_points(task)
    robot = task.robot
    if robot.n_e and robot.is_damped and not task.follows_balance:
        raise NoLaw(
            f"{robot.name}: optimal laws of elastic robots with damping are not supported with geometry rigid"
        )
    check_speeds(task, points)
    if robot.n_e and task.follows_balance:
        return find_elastic_motion(task, points)
    best = find_law(task, points)
    for share in RIGID_SHARES:
        try:
            return _certify_law(task, points, best)
        except NotConverged:
            best = adapt_found_law(task, points, best, share=share)
    return _certify_law(task, points, best)


def _certify_law(task: Task, points: Sequence[SingularPoint], best: Best) -> OptimalMotion:
    """Certify the motion of an undeformed robot's law; lower limits that the motion exceeds.

    Args:
        points: where condition (8) must hold.
        best: the law, with the search that found it.

    Raises:
        NotConverged: limits are still exceeded, or a torque is not resolved; as `resolve`.
    """
    for _ in range(MAX_PASSES):
        try:
            dynamics = resolve_planned_law(task, best.law, None)
        except UnboundedTorque as failure:  # condition (8) is met, but for rounding
            raise NotConverged(str(failure), residual=abs(failure.wrench), s=failure.s) from None
        excess = limit_excess(dynamics, task.specification)
        if excess <= 1.0:
            if task.robot.n_e:
                check_rest(dynamics, best.law)
            return OptimalMotion(dynamics, best.law, best.reference, best.gap)
        best = adapt_found_law(task, points, best, excess=excess)
    raise NotConverged(
        f"{task.robot.name}: no law within all limits is resolved in {MAX_PASSES} passes",
        residual=abs(excess - 1.0),
    )
