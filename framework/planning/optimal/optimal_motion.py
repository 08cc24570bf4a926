"""The best motion along a path: the law of a cone program and certified inverse dynamics in turn.

A rigid robot needs each once. An elastic one follows the series nearest to the law whose deflections are in
balance. Its torques are linear in the law about this motion. With these a better law is sought, as long as
the certified motion becomes better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from framework.dynamics.inverse_dynamics import resolve
from framework.dynamics.known_deflections import KnownDeflections
from framework.dynamics.loaded_balance import springs_carry_inertia
from framework.dynamics.restoration import BalanceSolution
from framework.dynamics.result import InverseDynamics
from framework.dynamics.static_fold import find_static_fold
from framework.dynamics.torque_response import TorqueResponse, respond_to_law
from framework.errors import (
    NoAnswer,
    NoLaw,
    NotAssembled,
    NotConverged,
    SpringsTooSoft,
    UnboundedTorque,
    round_up,
)
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
from framework.planning.optimal.rest_of_springs import check_rest
from framework.planning.optimal.sampled_demand import SampledDemand, sample_demand
from framework.planning.optimal.undeformed_law import adapt_found_law, find_law, problem_of, solve_problem
from framework.planning.refusals.refusal_proofs import StaticFold
from framework.planning.specification import limit_excess, motor_peaks
from framework.tolerances import PEAK_TORQUE_MISMATCH, REQUIRED_SPEED_ERROR, STIFFER_THAN_FOLD

MAX_PASSES = 12  # of optimising and resolving in turn
MAX_SPEED_STEPS = 4  # of placing required speeds where the deflected robot is singular
ENERGY_SAMPLES = 2001
RIGID_SHARES = (2e-2, 8e-2, 0.3)  # of the least cost, for laws smooth enough to be resolved, in turn
SERIES_DEGREE = 40  # of z as one series
WORTHWHILE_GAP, GAP_REDUCTION = 1.5e-2, 8.0  # of the cost above the least, from which an eighth is tried


class ElasticStage(NamedTuple):
    """How calm the law of an elastic robot is.

    share: of the least cost, which smoothness may take.
    max_coefficients: of a deflection; more are not worth their time where a calmer law will do.
    max_squared_speed: of z times the duration squared. A law that is quick in sigma at its ends shakes
        springs that carry inertia.
    """

    share: float
    max_coefficients: int
    max_squared_speed: float = np.inf


# in turn, until deflections are resolved and at rest at both ends
CAPPED_STAGES: tuple[ElasticStage, ...] = (
    ElasticStage(4e-3, 240, 100.0),
    ElasticStage(1e-2, 240, 20.0),
    ElasticStage(2e-2, 240, 8.0),
    ElasticStage(0.3, 240, 4.0),
    ElasticStage(0.8, 400, 4.0),
    ElasticStage(3.0, 400, 4.0),
)
MASSLESS_STAGES = (ElasticStage(4e-3, 240), *CAPPED_STAGES)  # of springs that carry no inertia
# of redundant motors, whose deflections passes alone have to resolve
CALM_STAGES = (ElasticStage(0.2, 400, 4.0), *CAPPED_STAGES[4:])
SPLINE_STAGES = tuple(ElasticStage(share, 400) for share in (2e-2, 8e-2, 0.3, 3.0))


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
    points = find_crossing_points(task)
    robot = task.robot
    if robot.n_e and robot.is_damped and not task.follows_balance:
        raise NoLaw(
            f"{robot.name}: optimal laws of elastic robots with damping are not supported with geometry "
            f"rigid or redundant motors; use {other_law(task)}flexibility rigid"
        )
    check_speeds(task, points)
    if robot.n_e:
        stages = MASSLESS_STAGES
        if task.geometry == "deformed" and springs_carry_inertia(task.branch):
            stages = CAPPED_STAGES if task.follows_balance else CALM_STAGES
            # rates of these springs follow the fifth derivative of the law, their accelerations the sixth
            task = task._replace(specification=replace(task.specification, smoothness=HIGHEST_SMOOTHNESS))
        return _ElasticSearch(task, task, points, sample_demand(task), stages).run()
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
        f"{task.robot.name}: no law within all limits is resolved in {MAX_PASSES} passes",
        residual=abs(excess - 1.0),
    )


@dataclass
class _ElasticSearch:
    """The search for the law of an elastic robot.

    First for a law whose motion is resolved, and at rest at its ends: stage by stage a calmer one. Then for
    better ones, by the torques that are linear in the law about the last motion. Until then viscous damping
    is left out of the law, not of its motion.

    next_task: the task with the limits of the next law.
    points: the crossing points of the undeformed robot.
    sampled: the demand on its motors.
    stages: how calm laws are, in turn; those of splines, which a series is fitted to, if no series is found.
    stage: index of the next law's.
    share: of the least cost, in place of the stage's.
    is_near_end: whether the next failure ends the search.
    last_law: the last law found.
    balance: of the last motion at this stage; None where deflections are those of `resolve`.
    response: of the torques to the law, about that motion.
    speed_places: s of the crossings of that motion, at which speeds may be required.
    best_motion: the best certified motion within the limits.
    first_failure: raised if no stage succeeds.
    """

    task: Task
    next_task: Task
    points: Sequence[CrossingPoint]
    sampled: SampledDemand | None
    stages: tuple[ElasticStage, ...]
    stage: int = 0
    share: float | None = None
    is_near_end: bool = False
    last_law: Best | None = None
    balance: BalanceSolution | None = None
    response: TorqueResponse | None = None
    speed_places: list[float] | None = None
    best_motion: OptimalMotion | None = None
    first_failure: NoAnswer | None = None

    def run(self) -> OptimalMotion:
        """Return the best motion; raise as `optimal_motion`."""
        for _ in range(MAX_PASSES):
            try:
                motion = self._find_motion()
            except (NoLaw, NotAssembled, NotConverged, UnboundedTorque, SearchEnded) as failure:
                if self.best_motion is None:
                    self._choose_smoother(failure)
                    continue
                if isinstance(failure, SearchEnded) or self.is_near_end:
                    return self.best_motion
                self.is_near_end = True
                gap = self.best_motion.best.gap
                if self.share is None:  # a calmer law may still be better
                    self.stage = min(self.stage + 1, len(self.stages) - 1)
                elif self.share < 0.5 * gap:
                    self.share = float(np.sqrt(self.share * gap))
                else:
                    return self.best_motion
                continue
            excess = limit_excess(motion.dynamics, self.task.specification)
            is_settled = motion is self.best_motion  # the law costs no less
            if not is_settled and excess <= 1.0 and self._has_required_speeds(motion.law, motion.dynamics):
                if self.best_motion is not None and not self._improves(_cost_of_motion(self.task, motion)):
                    return min(motion, self.best_motion, key=partial(_cost_of_motion, self.task))
                self.best_motion = motion
                report_result()
                is_settled = self.balance is None or _has_predicted_peak(motion)
            if is_settled:
                gap = motion.best.gap
                share = gap / GAP_REDUCTION
                is_tried = self.share is not None and self.share <= share
                if self.balance is None or gap < WORTHWHILE_GAP or is_tried or self.stages is SPLINE_STAGES:
                    return motion
                self.share = share
            self._prepare_next(motion, excess)
        if self.best_motion is not None:
            return self.best_motion
        raise self.first_failure or NotConverged(
            f"{self.task.robot.name}: law and deflections do not settle together in {MAX_PASSES} "
            f"passes; use {other_law(self.task)}stiffer springs, or geometry rigid",
            residual=abs(excess - 1.0),
        )

    def _find_motion(self) -> OptimalMotion:
        """Find the next law and certify its motion; return the best motion if the law costs no less."""
        best = self._find_law()
        self.last_law = best
        if self.best_motion is not None and not self._improves(best.cost):
            return self.best_motion
        law = best.law
        if not self.task.follows_balance:
            dynamics = _resolve_law(self.task, law, None)
        else:
            law, dynamics = self._balance_law(law)
        check_rest(dynamics, law.smoothness)
        return OptimalMotion(dynamics, law, best)

    def _balance_law(self, law: OptimalLaw) -> tuple[OptimalLaw, InverseDynamics]:
        """Return the nearest law in balance, and its motion, again where deflections move required speeds."""
        for _ in range(MAX_SPEED_STEPS):
            previous = None if self.balance is None else self.balance.deflections
            law, self.balance = find_law_in_balance(
                self.next_task,
                law,
                previous,
                self.speed_places,
                most=self.stages[self.stage].max_coefficients,
            )
            dynamics = _resolve_law(self.task, law, self.balance.deflections)
            if self._has_required_speeds(law, dynamics):
                break
            self.speed_places = [crossing.s for crossing in dynamics.crossings]
        return law, dynamics

    def _find_law(self) -> Best:
        """Find the law of this stage, in the units of the last law."""
        stage = self.stages[self.stage]
        task = self.next_task
        if self.last_law is None and self.stages is not SPLINE_STAGES:  # splines follow if there is no series
            task = task._replace(to_cross=replace(task.to_cross, explained=False))
        problem = problem_of(task, self.points, self.speed_places)
        problem = problem._replace(sampled=self.sampled, response=self.response)
        if self.response is not None:
            problem = problem._replace(degree=len(self.response.y) - 1)
        elif self.stages is not SPLINE_STAGES:
            problem = problem._replace(degree=SERIES_DEGREE)
        duration = self.task.specification.duration
        if duration is None and self.last_law is not None:
            duration = self.last_law.law.duration
        if duration is not None:
            problem = problem._replace(max_squared_speed=stage.max_squared_speed / duration**2)
        return solve_problem(problem, share=self.share or stage.share, similar=self.last_law)

    def _improves(self, cost: float) -> bool:
        """Whether a cost is below that of the best motion by more than the error of peaks."""
        assert self.best_motion is not None
        return cost < (1.0 - PEAK_TORQUE_MISMATCH) * _cost_of_motion(self.task, self.best_motion)

    def _choose_smoother(self, failure: NoAnswer) -> None:
        """Go on to the next stage; raise the failure if no smoother law can help, or no stage is left."""
        if isinstance(failure, SearchEnded | SpringsTooSoft):
            raise failure
        self.first_failure = self.first_failure or failure
        self.balance = self.response = self.speed_places = None
        self.stage += 1
        if self.last_law is None and self.stages is not SPLINE_STAGES:  # no series is such a law
            self.stages = SPLINE_STAGES
            self.stage = 0
            self.first_failure = None
        if self.stage == 3:
            self._check_ends()
        if self.stage == len(self.stages):
            raise self.first_failure or failure from None

    def _check_ends(self) -> None:
        """Raise NoLaw if deflections at rest at an end of the path do not reach the robot's springs."""
        branch = self.task.branch
        if not self.task.follows_balance:
            return
        for s in (0.0, 1.0):
            compliance = find_static_fold(branch, s)
            if compliance is not None:
                stiffer = round_up(STIFFER_THAN_FOLD / compliance, 3)
                raise NoLaw(
                    f"{branch.robot.name}: at rest at s = {s:g} the springs give way: as they get softer, "
                    f"deflections turn back at {1.0 / compliance:.3g} times their stiffness, so that no law "
                    f"was found on the branch of the rigid robot; springs {stiffer:.3g} times as stiff hold "
                    f"at this end",
                    evidence=StaticFold(s, compliance),
                )

    def _has_required_speeds(self, law: OptimalLaw, dynamics: InverseDynamics) -> bool:
        """Whether a law has the required speeds at the crossings of its motion, if any are."""
        required = self.task.request.speeds
        if required is None:
            return True
        speeds = [law(crossing.time, 1) for crossing in dynamics.crossings]
        return bool(np.allclose(speeds, required, rtol=REQUIRED_SPEED_ERROR, atol=0.0))

    def _prepare_next(self, motion: OptimalMotion, excess: float) -> None:
        """Linearise torques about a motion, or lower limits by its excess where nothing is known.

        What failed before tells nothing of the laws that follow.
        """
        self.first_failure = None
        self.speed_places = [crossing.s for crossing in motion.dynamics.crossings]
        if self.balance is not None:
            self.response = respond_to_law(self.balance)
            return
        scaled = self.next_task.specification.scale_limits((1.0 - LIMIT_TIGHTENING) / excess)
        self.next_task = self.next_task._replace(specification=scaled)


def _has_predicted_peak(motion: OptimalMotion) -> bool:
    """Whether the peak torque of a motion is that which its law was found with."""
    peak = float((motor_peaks(motion.dynamics)[0] / motion.best.reference).max())
    return abs(peak / motion.best.peak - 1.0) < PEAK_TORQUE_MISMATCH


def _cost_of_motion(task: Task, motion: OptimalMotion) -> float:
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
