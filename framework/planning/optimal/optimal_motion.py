"""The best motion along a path: the law of a cone program and certified inverse dynamics in turn.

A rigid robot needs each once. An elastic one follows the series nearest to the law whose deflections are in
balance; then the law is sought again with these, as functions of the path parameter, as long as the certified
motion becomes better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from framework.dynamics.inverse_dynamics import resolve
from framework.dynamics.known_deflections import KnownDeflections
from framework.dynamics.result import InverseDynamics
from framework.errors import NoAnswer, NoLaw, NotConverged, SpringsTooSoft, UnboundedTorque
from framework.laws.optimal_law import HIGHEST_SMOOTHNESS, OptimalLaw
from framework.numerics.time_limit import SearchEnded, report_result
from framework.planning.condition import CrossingPoint
from framework.planning.optimal.best_law import LIMIT_TIGHTENING, Best
from framework.planning.optimal.elastic_balance import find_law_in_balance
from framework.planning.optimal.optimal_task import (
    Task,
    check_speeds,
    check_unfolded,
    find_crossing_points,
    other_law,
)
from framework.planning.optimal.phase_plane import DeflectionsOnPath
from framework.planning.optimal.rest_of_springs import check_rest
from framework.planning.optimal.undeformed_law import adapt_found_law, find_law
from framework.planning.specification import limit_excess, motor_peaks
from framework.tolerances import PEAK_TORQUE_MISMATCH

MAX_PASSES = 8  # of optimising and resolving in turn
ENERGY_SAMPLES = 2001
RIGID_SHARES = (2e-2, 8e-2, 0.3)  # of the least cost, for laws smooth enough to be resolved, in turn
# Of elastic robots: the share of the least cost that smoothness may take, in turn, until deflections are
# resolved and at rest at both ends, with the degree of z as one series. A higher degree takes three times as
# long and is tried before much of the cost is paid.
ELASTIC_LAWS = ((4e-3, 40), (2e-2, 40), (8e-2, 40), (8e-2, 60), (0.3, 40), (1.0, 40), (3.0, 40))


class OptimalMotion(NamedTuple):
    """The certified motion of the best law, with the search that found the law."""

    dynamics: InverseDynamics
    law: OptimalLaw
    best: Best


def optimal_motion(task: Task) -> OptimalMotion:
    """Find the best law within all limits, and certify the motion.

    Raises:
        NoLaw: none was found within the limits; says what stands against it.
        NotConverged: deflections and law do not settle together, or the solver gave up.
        As `resolve`.
    """
    check_unfolded(task)
    points = find_crossing_points(task, None, None)
    robot = task.branch.robot
    if robot.n_e and robot.is_damped:
        raise NoLaw(
            f"{robot.name}: optimal laws of elastic robots with damping are not supported; use "
            f"{other_law(task)}flexibility rigid"
        )
    check_speeds(task, points)
    if robot.n_e:
        return _ElasticSearch(task, task, points).run()
    best = find_law(task, points)
    for share in (None, *RIGID_SHARES):
        if share is not None:
            best = adapt_found_law(task, points, best, share=share)
        try:
            return _certify_law(task, points, best)
        except NotConverged as failure:
            unresolved = failure
        except UnboundedTorque as failure:  # condition (8) is met but for rounding
            unresolved = NotConverged(str(failure), residual=abs(failure.wrench), s=failure.s)
    raise unresolved


def _certify_law(task: Task, points: Sequence[CrossingPoint], best: Best) -> OptimalMotion:
    """Certify the motion of a rigid robot's law, lowering limits that the motion exceeds.

    Raises:
        NotConverged: limits are exceeded still; as `resolve`.
    """
    for _ in range(MAX_PASSES):
        dynamics = _resolve_law(task, best.law, None)
        excess = limit_excess(dynamics, task.specification)
        if excess <= 1.0:
            return OptimalMotion(dynamics, best.law, best)
        best = adapt_found_law(task, points, best, excess=excess)
    raise NotConverged(
        f"{task.branch.robot.name}: no law within all limits is resolved in {MAX_PASSES} passes",
        residual=abs(excess - 1.0),
    )


@dataclass
class _ElasticSearch:
    """The search for the law of an elastic robot: optimise and resolve in turn, while the motion improves.

    Each law is sought with the deflections of the last motion, as functions of the path parameter. Where a
    law's motion is not resolved, or not at rest at its ends, a smoother law follows, with more of its
    derivatives zero there: rates of springs with inertia follow the fifth and their accelerations the sixth.
    The first law knows no deflections: where its motion exceeds limits, a smoother law follows. Later ones
    have limits scaled by the excess of the last motion.

    next_task: the task with the limits and the smoothness of the next law.
    points: the crossing points with the deflections of the last motion.
    stage: index into `ELASTIC_LAWS` for the next law.
    fits_splines: whether a series is fitted to splines, because no series was found twice.
    last_law: the last law with the present `deflections`.
    deflections: of the last motion, along the path; None before the first.
    known: deflections that were in balance last, from which the next balance begins.
    best_motion: the best certified motion within the limits.
    first_failure: raised if no stage succeeds.
    """

    task: Task
    next_task: Task
    points: Sequence[CrossingPoint]
    stage: int = 0
    fits_splines: bool = False
    last_law: Best | None = None
    deflections: DeflectionsOnPath | None = None
    known: KnownDeflections | None = None
    best_motion: OptimalMotion | None = None
    first_failure: NoAnswer | None = None

    def run(self) -> OptimalMotion:
        """Return the best motion; raise as `optimal_motion`."""
        for _ in range(MAX_PASSES):
            try:
                motion = self._find_motion()
            except (NoLaw, NotConverged, UnboundedTorque, SearchEnded) as failure:
                if self.best_motion is not None:
                    return self.best_motion
                self._choose_smoother(failure)
                continue
            if motion is self.best_motion:
                return motion
            excess = limit_excess(motion.dynamics, self.task.specification)
            if excess <= 1.0:
                if self.best_motion is not None and not self._improves(_cost(self.task, motion)):
                    return min(motion, self.best_motion, key=partial(_cost, self.task))
                self.best_motion = motion
                report_result()
            self._prepare_next(motion, excess)
        if self.best_motion is not None:
            return self.best_motion
        raise self.first_failure or NotConverged(
            f"{self.task.branch.robot.name}: law and deflections do not settle together in {MAX_PASSES} "
            f"passes; use {other_law(self.task)}stiffer springs, or geometry rigid",
            residual=abs(excess - 1.0),
        )

    def _find_motion(self) -> OptimalMotion:
        """Find the next law and certify its motion; return the best motion if the law costs no less."""
        best = self._find_law()
        if self.best_motion is not None and not self._improves(best.cost):
            return self.best_motion
        law = best.law
        known = None
        robot = self.task.branch.robot
        if self.task.geometry == "deformed" and robot.n_a == robot.n:
            law, known = find_law_in_balance(self.task, law, self.known)
        dynamics = _resolve_law(self.task, law, known)
        self.known = known
        check_rest(dynamics, law.smoothness)
        return OptimalMotion(dynamics, law, best)

    def _find_law(self) -> Best:
        """Find the law of this stage, from the law found before if only the share has changed since."""
        share, series_degree = ELASTIC_LAWS[self.stage]
        degree = None if self.fits_splines else series_degree
        if self.last_law is not None:
            problem = self.last_law.program.problem
            if problem.task is self.next_task and problem.degree == degree:
                self.last_law = adapt_found_law(self.next_task, self.points, self.last_law, share=share)
                return self.last_law
        self.last_law = find_law(
            self.next_task, self.points, deflections=self.deflections, share=share, degree=degree
        )
        return self.last_law

    def _improves(self, cost: float) -> bool:
        """Whether a cost is below that of the best motion by more than the error of peaks."""
        assert self.best_motion is not None
        return cost < (1.0 - PEAK_TORQUE_MISMATCH) * _cost(self.task, self.best_motion)

    def _choose_smoother(self, failure: NoAnswer) -> None:
        """Go on to the next stage; raise the failure if no smoother law can help, or no stage is left."""
        if isinstance(failure, SearchEnded | SpringsTooSoft):
            raise failure
        self.first_failure = self.first_failure or failure
        self.stage += 1
        if self.stage == 2 and self.last_law is None:  # no series twice: one is fitted to splines
            self.fits_splines = True
            self.first_failure = None
        if self.stage == len(ELASTIC_LAWS):
            raise self.first_failure or failure from None
        if self.next_task.specification.smoothness < HIGHEST_SMOOTHNESS:
            smoother = replace(self.next_task.specification, smoothness=HIGHEST_SMOOTHNESS)
            self.next_task = self.next_task._replace(specification=smoother)

    def _prepare_next(self, motion: OptimalMotion, excess: float) -> None:
        """Take over the deflections of a motion, and limits scaled by its excess.

        A motion of least time is at a limit: limits follow its excess up and down.
        """
        if self.deflections is None and excess > 1.0:  # a smoother law shakes the springs less
            self.stage = max(self.stage, 1)
        if self.deflections is not None and (excess > 1.0 or self.task.specification.goal == "time"):
            scaled = self.next_task.specification.scale_limits((1.0 - LIMIT_TIGHTENING) / excess)
            self.next_task = self.next_task._replace(specification=scaled)
        self.deflections = DeflectionsOnPath(motion.law, motion.dynamics.deflections)
        self.last_law = None
        self.points = find_crossing_points(self.task, self.deflections, self.points)


def _cost(task: Task, motion: OptimalMotion) -> float:
    """Return the cost of a certified motion by the goal of the task.

    The duration [s], the peak torque over the reference, or the integral of (torque / reference)^2 [s].
    """
    goal = task.specification.goal
    reference = motion.best.reference
    if goal == "time":
        return motion.dynamics.duration
    if goal == "peak_torque":
        return float((motor_peaks(motion.dynamics)[0] / reference).max())
    t = np.linspace(0.0, motion.dynamics.duration, ENERGY_SAMPLES)
    return float(np.trapezoid(((motion.dynamics.torque(t) / reference) ** 2).sum(axis=1), t))


def _resolve_law(task: Task, law: OptimalLaw, known: KnownDeflections | None) -> InverseDynamics:
    """Compute and certify the torques of a law, with deflections that are in balance if known."""
    return resolve(
        task.to_cross.searched,
        lambda *_: law,
        geometry=task.geometry,
        tolerance=task.request.tolerance,
        friction=task.request.friction,
        known=known,
    )
