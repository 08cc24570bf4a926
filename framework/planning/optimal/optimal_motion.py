"""The best motion along a path: the law of a cone program, alternating with certified inverse dynamics.

A law s = phi(sigma(t)) is given by its squared speed z = (d sigma/dt)^2, splines or one series. A rigid robot
usually needs one round. An elastic robot cannot follow every law: its law is replaced by the nearest series
with deflections in balance. About the resulting motion, torques are linear in the law. The next cone program
uses this linear model, as long as the certified motion becomes better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from framework.dynamics.deflection_splines import KnownDeflections
from framework.dynamics.drive_limits import curve_ratios
from framework.dynamics.inverse_dynamics import resolve
from framework.dynamics.loaded_balance import springs_carry_inertia
from framework.dynamics.restoration import BalanceSolution
from framework.dynamics.result import InverseDynamics
from framework.dynamics.static_fold import find_static_fold
from framework.dynamics.torque_response import TorqueResponse, respond_to_law
from framework.errors import (
    InvalidInput,
    NoAnswer,
    NoLaw,
    NotAssembled,
    NotConverged,
    SpringsTooSoft,
    UnboundedTorque,
    format_distinct,
    round_up,
)
from framework.laws.optimal_law import HIGHEST_SMOOTHNESS, OptimalLaw
from framework.numerics.time_limit import SearchEnded, report_result
from framework.planning.motor_use import find_largest_use, raise_drives
from framework.planning.optimal.best_law import LIMIT_TIGHTENING, Best
from framework.planning.optimal.elastic_balance import check_rest, find_law_in_balance
from framework.planning.optimal.least_softening import find_least_softening
from framework.planning.optimal.optimal_task import (
    Task,
    check_single_crossings,
    check_speeds,
    find_crossing_points,
)
from framework.planning.optimal.path_series import SampledDemand, sample_demand
from framework.planning.optimal.smooth_search import NEARLY_REACHED
from framework.planning.optimal.undeformed_law import (
    adapt_found_law,
    find_law,
    problem_of,
    settle_tangents,
    solve_problem,
    suggest_time,
)
from framework.planning.refusals import (
    PRINTED_DIGITS,
    HoldingTorque,
    LeastLimits,
    SearchEvidence,
    StaticFold,
    advice_of,
)
from framework.planning.request import limit_excess, motor_peaks, share_within
from framework.singularity.points_on_path import SingularPoint
from framework.tolerances import (
    MAX_SOFTENING,
    PEAK_TORQUE_MISMATCH,
    REQUIRED_SPEED_ERROR,
    REQUIRED_TIME_ERROR,
    STIFFER_THAN_FOLD,
)

# shares of z by which a law may differ from that about which torques are linear; the next one after a failure
TRUSTED_SHARES = (np.inf, 0.3, 0.1)
MAX_PASSES = 12  # of optimising a law and resolving its motion
LONGER_DURATIONS = (1.0, 1.02, 1.1)  # over the quickest, tried in turn as remedies
MAX_PLACE_STEPS = 8  # of moving required times and speeds to where the deflected robot is singular
ENERGY_SAMPLES = 2001  # instants, for the integral of squared torques by the trapezoidal rule
# shares of the least cost that smoothness may take, tried in turn until the motion is resolved
RIGID_SHARES = (2e-2, 8e-2, 0.3)
SERIES_DEGREE = 40  # of z as one series
# relative gap to the least cost above which a smaller share for smoothness is tried; gap over that share
WORTHWHILE_GAP, GAP_REDUCTION = 1.5e-2, 8.0


class ElasticStage(NamedTuple):
    """How smooth the law of an elastic robot has to be.

    share: share of the least cost by which the cost of a smooth law may exceed it.
    max_squared_speed: limit of z times the duration squared. A law that is quick in sigma at its ends shakes
        springs that carry inertia.
    degree: degree of z as one series; None for splines, to which a series is fitted.
    """

    share: float
    max_squared_speed: float = np.inf
    degree: int | None = SERIES_DEGREE


# tried in turn until deflections are resolved and at rest at both ends
SPLINE_STAGES = tuple(ElasticStage(share, degree=None) for share in (4e-2, 0.15, 0.5, 3.0))
CAPPED_STAGES: tuple[ElasticStage, ...] = (
    ElasticStage(4e-3, 100.0),
    ElasticStage(1e-2, 20.0),
    ElasticStage(2e-2, 8.0),
    ElasticStage(0.3, 4.0),
    ElasticStage(0.8, 4.0),
    ElasticStage(3.0, 4.0),
    *SPLINE_STAGES,
)
MASSLESS_STAGES = (ElasticStage(4e-3), *CAPPED_STAGES)  # for springs whose rates cause no forces


class OptimalMotion(NamedTuple):
    """A certified motion, its law, and the optimum from which the law was made."""

    dynamics: InverseDynamics
    law: OptimalLaw
    best: Best


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
            sought = _try_remedies(task, _count_drives(task, refusal.evidence))
            numbers = () if isinstance(refusal.proof, HoldingTorque) else sought.clauses
            advice = () if sought.limits is None else (advice_of(task.robot, sought.limits),)
            refusal.clauses, refusal.evidence = (*numbers, *advice), sought
        raise
    if counted is not task and limit_excess(motion.dynamics, task.specification) > 1.0:
        raise _refuse_drives(task, motion)
    return motion


def _count_drives(task: Task, evidence: SearchEvidence) -> SearchEvidence:
    """Return the evidence of a search without limits of drives with the least duration within these, too."""
    if task.specification.drives is None or evidence.quickest is None:
        return evidence
    motion = _try_motion(task, goal="time", duration=None, longest=None)
    return evidence._replace(quickest=None if motion is None else motion.dynamics.duration)


def _try_motion(task: Task, **changes: Any) -> OptimalMotion | None:
    """Return a certified motion of a task with changes of its specification; None without one."""
    to_cross = replace(task.to_cross, explained=False)
    specification = replace(task.specification, **changes)
    try:
        return _find_motion(task._replace(to_cross=to_cross, specification=specification))
    except (NoAnswer, InvalidInput):
        return None


def _refuse_drives(task: Task, plain: OptimalMotion) -> NoLaw:
    """Return the refusal of a task whose motion exceeds curves or RMS limits.

    Advised are the least duration found within all limits, or curves and RMS limits that hold the motion.

    Args:
        plain: the best motion within the other limits.
    """
    specification = task.specification
    drives = specification.drives
    assert drives is not None
    use = find_largest_use(plain.dynamics, specification)
    assert use is not None
    quickest = None
    # RMS torques alone leave the first law of least time without a bound
    if specification.max_duration is not None and (specification.limited or specification.limited_speeds):
        motion = _try_motion(task, goal="time", duration=None, longest=None)
        quickest = None if motion is None else motion.dynamics.duration
    share = 1.0 - task.request.margin
    raised = raise_drives(plain.dynamics, drives, share)
    least = LeastLimits(None, None, together=True, options=[raised])
    evidence = SearchEvidence(len(plain.best.program.cells) - 1, least, quickest)
    bound = "longest" if specification.duration is None else "duration"
    for ratio in LONGER_DURATIONS:
        if quickest is None:
            break
        duration = round_up(ratio * quickest, PRINTED_DIGITS)
        if _try_motion(task, **{bound: duration}) is not None:
            evidence = evidence._replace(duration=duration)
            break
    clauses = [] if quickest is None else [f"within all limits the quickest law found takes {quickest:.4g} s"]
    loosened: dict[str, Any] = {name: share * limit for name, limit in raised.items()}
    looser = drives._replace(**loosened)
    if evidence.duration is None and _try_motion(task, drives=looser) is not None:
        evidence = evidence._replace(limits=raised)
        clauses.append(advice_of(task.robot, raised))
    return NoLaw(
        f"no law of free shape was found within torque-speed curves and RMS torques: "
        f"under the best law within the other limits {use.sentence}",
        name=task.robot.name,
        clauses=tuple(clauses),
        evidence=evidence,
    )


def _try_remedies(task: Task, evidence: SearchEvidence) -> SearchEvidence:
    """Return the evidence with those of its limits and durations for which a motion is certified.

    Args:
        task: the task that was refused.
        evidence: the search for the least limits and the least duration.
    """

    def has_motion(**changes: Any) -> bool:
        """Return whether a motion is certified with changes of the specification."""
        return _try_motion(task, **changes) is not None

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
        changes = {name: share * limit for name, limit in raised.items()}
        drives = task.specification.drives
        if drives is not None:  # a curve reaches up to the torque limit
            drives = drives._replace(torque_limit=changes.get("torque_limit", drives.torque_limit))
        if has_motion(**changes, drives=drives):
            return evidence._replace(limits=raised)
        plain = None if drives is None else _try_motion(task, **changes, drives=None)
        if drives is not None and plain is not None:
            looser = raise_drives(plain.dynamics, drives, share)
            loosened: dict[str, Any] = {name: share * limit for name, limit in looser.items()}
            if has_motion(**changes, drives=drives._replace(**loosened)):
                return evidence._replace(limits=raised | looser)
    return evidence


def _find_motion(task: Task) -> OptimalMotion:
    """Find the best law within all limits, and certify its motion; raise as `optimal_motion`."""
    check_single_crossings(task)
    points = find_crossing_points(task)
    robot = task.robot
    if robot.n_e and robot.is_damped and not task.follows_balance:
        raise NoLaw(
            "optimal laws of elastic robots with damping are not supported with geometry rigid",
            name=robot.name,
        )
    check_speeds(task, points)
    if robot.n_e:
        stages = MASSLESS_STAGES
        is_damped = robot.is_damped and robot.elastic_inertia
        if task.follows_balance and (is_damped or springs_carry_inertia(task.branch)):
            # redundant motors shake the springs between them, so that few quick laws leave these at rest
            stages = CAPPED_STAGES[3:] if robot.n_a > robot.n else CAPPED_STAGES
            # rates of springs follow the fifth derivative of the law, their accelerations the sixth
            task = task._replace(specification=replace(task.specification, smoothness=HIGHEST_SMOOTHNESS))
        sampled = sample_demand(task)
        return _ElasticSearch(task, task, points, sampled, stages, _first_law(task, points, sampled)).run()
    best = find_law(task, points)
    for share in RIGID_SHARES:
        try:
            return _certify_law(task, points, best)
        except NotConverged:
            best = adapt_found_law(task, points, best, share=share)
    return _certify_law(task, points, best)


def _first_law(task: Task, points: Sequence[SingularPoint], sampled: SampledDemand | None) -> Best | None:
    """Return the law about which limits of drives are linearised first; None without.

    It is that of the undeformed robot. First laws of elastic robots leave damping out, so that with damping
    there is none.
    """
    if task.specification.drives is None or task.robot.is_damped:
        return None
    result = settle_tangents(problem_of(task, points)._replace(sampled=sampled), points)
    return result if isinstance(result, Best) else None


def _certify_law(task: Task, points: Sequence[SingularPoint], best: Best) -> OptimalMotion:
    """Certify the motion of a rigid robot's law; lower limits that the motion exceeds.

    Args:
        points: where condition (8) must hold.
        best: the law, with the search that found it.

    Raises:
        NotConverged: limits are still exceeded, or a torque is not resolved; as `resolve`.
    """
    for _ in range(MAX_PASSES):
        try:
            dynamics = _resolve_law(task, best.law, None)
        except UnboundedTorque as failure:  # condition (8) is met, but for rounding
            raise NotConverged(
                failure.sentence, name=failure.name, residual=abs(failure.wrench), s=failure.s
            ) from None
        excess = limit_excess(dynamics, task.specification)
        if excess <= 1.0:
            return OptimalMotion(dynamics, best.law, best)
        best = adapt_found_law(task, points, best, excess=excess)
    raise NotConverged(
        f"no law within all limits is resolved in {MAX_PASSES} passes",
        name=task.robot.name,
        residual=abs(excess - 1.0),
    )


@dataclass
class _ElasticSearch:
    """The search for the law of an elastic robot.

    The first aim is a law whose motion is resolved and at rest at its ends: each stage asks for a smoother
    law. Then better laws are sought with torques linear in the law about the last motion. These torques
    contain viscous damping. The first laws are found without damping, but their motions have it.

    task: the task as it was set.
    next_task: the task with the limits of the next law.
    points: the crossing points of the undeformed robot.
    sampled: the demand on the motors of the undeformed robot.
    stages: the stages of laws, those of splines last.
    first_law: the law about which limits of drives are linearised before the first motion.
    stage: index of the stage of the next law.
    share: share of the least cost by which a smooth law may exceed it; None for the stage's own.
    failures: number of failures since there is a best motion.
    last_law: the last law found, from which the next search resumes.
    last_stage: the stage of that law.
    balance: the balance of the last motion at this stage; None if `resolve` finds the deflections.
    response: the response of the torques to the law, about that motion.
    places: s of the crossings of that motion, where the required times and speeds, if any, must hold.
    best_motion: the best certified motion within the limits.
    least_excess: the least ratio of a certified motion's torques and speeds to the limits.
    first_failure: raised if no stage succeeds.
    """

    task: Task
    next_task: Task
    points: Sequence[SingularPoint]
    sampled: SampledDemand | None
    stages: tuple[ElasticStage, ...]
    first_law: Best | None = None
    stage: int = 0
    share: float | None = None
    failures: int = 0
    last_law: Best | None = None
    last_stage: ElasticStage | None = None
    balance: BalanceSolution | None = None
    response: TorqueResponse | None = None
    places: list[float] | None = None
    best_motion: OptimalMotion | None = None
    least_excess: float = np.inf
    first_failure: NoAnswer | None = None

    def run(self) -> OptimalMotion:
        """Return the best motion; raise as `optimal_motion`."""
        for _ in range(MAX_PASSES):
            try:
                motion = self._find_motion()
            except (NoLaw, NotAssembled, NotConverged, UnboundedTorque, SearchEnded) as failure:
                if self.best_motion is None:
                    self._choose_smoother(failure)
                elif isinstance(failure, SearchEnded) or not self._try_nearer():
                    return self.best_motion
                continue

            # keep the motion if it is within the limits and better than the best one
            excess = limit_excess(motion.dynamics, self.task.specification)
            self.least_excess = min(self.least_excess, excess)
            is_new = motion is not self.best_motion  # otherwise the new law costs no less
            is_settled = not is_new
            if is_new and excess <= 1.0 and self._meets_requirements(motion.law, motion.dynamics):
                if self.best_motion is not None and not self._improves(_cost_of_motion(self.task, motion)):
                    return min(motion, self.best_motion, key=partial(_cost_of_motion, self.task))
                self.best_motion = motion
                report_result(_describe_cost(self.task, motion))
                is_settled = self.balance is None or _has_predicted_peak(motion)

            if excess > 1.0 and self._is_smoother_cheaper(excess):
                self._choose_smoother(self._refuse_excess())
                continue

            # end, or linearise about the motion and search again
            if is_settled and not self._try_smaller_share(motion.best.gap):
                return motion
            if is_new:
                self._prepare_next(motion, excess)
        if self.best_motion is not None:
            return self.best_motion
        raise self._refuse(
            NotConverged(
                f"law and deflections do not settle together in {MAX_PASSES} passes",
                name=self.task.robot.name,
                residual=abs(self.least_excess - 1.0),
            )
        )

    def _refuse(self, failure: NoAnswer) -> NoAnswer:
        """Return the refusal after a failure: limits are named only if a motion exceeded them."""
        if 1.0 < self.least_excess < np.inf:
            return self._refuse_excess()
        return self.first_failure or failure

    def _refuse_excess(self) -> NotConverged:
        """Return the refusal that the motions found exceed the limits, with the least excess."""
        excess, _ = format_distinct(self.least_excess, 1.0)
        return NotConverged(
            f"no law was found whose motion with springs keeps the limits: "
            f"the nearest motion found takes {excess} times the limits",
            name=self.task.robot.name,
            residual=self.least_excess - 1.0,
        )

    def _is_smoother_cheaper(self, excess: float) -> bool:
        """Return whether the next stage costs less than limits divided by an excess, without a response.

        Durations grow as the root of what torques are divided by. The next stage costs its share.
        """
        if self.balance is not None or self.stage + 1 == len(self.stages):
            return False
        return np.sqrt(excess) - 1.0 > self.stages[self.stage + 1].share

    def _try_nearer(self) -> bool:
        """Lower the trusted share for one more law; return False after the least share."""
        self.failures += 1
        return self.failures < len(TRUSTED_SHARES)

    def _try_smaller_share(self, gap: float) -> bool:
        """Lower the share for smoothness if the gap to the least cost is large; return False if not.

        Args:
            gap: cost of the smooth law over the least cost, less 1.
        """
        share = gap / GAP_REDUCTION
        is_tried = self.share is not None and self.share <= share
        uses_splines = self.stages[self.stage].degree is None
        if self.balance is None or gap < WORTHWHILE_GAP or is_tried or uses_splines:
            return False
        self.share = share
        return True

    def _find_motion(self) -> OptimalMotion:
        """Find the next law and certify its motion; return the best motion if the law costs no less."""
        best = self._find_law()
        stage = self.stages[self.stage]
        if self.first_failure is not None and self._repeats_last_law(best, stage):
            raise self.first_failure
        self.last_law, self.last_stage = best, stage
        if self.best_motion is not None and not self._improves(best.cost):
            return self.best_motion
        law, balance = best.law, None
        if not self.task.follows_balance:
            dynamics = _resolve_law(self.task, law, None)
        else:
            law, balance, dynamics = self._balance_law(law)
        check_rest(dynamics, law)
        self.balance = balance  # of a certified motion: the cells of a failed one hold what it failed on
        return OptimalMotion(dynamics, law, best)

    def _repeats_last_law(self, best: Best, stage: ElasticStage) -> bool:
        """Return whether a stage's law is the last law once more, whose motion failed.

        A stage may differ from that of the last law in the share alone. If both laws cost the same, up to
        PEAK_TORQUE_MISMATCH, the smoothest law needs no larger share.
        """
        last = self.last_stage
        if self.last_law is None or last is None or stage._replace(share=last.share) != last:
            return False
        return abs(best.cost / self.last_law.cost - 1.0) < PEAK_TORQUE_MISMATCH

    def _balance_law(self, law: OptimalLaw) -> tuple[OptimalLaw, BalanceSolution, InverseDynamics]:
        """Find the law in balance nearest to `law`, the balance, and its certified motion.

        Deflections shift the crossings along the path. If times or speeds are required, the law is found
        again until it has them at the shifted crossings.
        """
        previous = self.balance and self.balance.deflections
        for _ in range(MAX_PLACE_STEPS):
            law, balance = find_law_in_balance(self.next_task, law, previous, self.places)
            previous = balance.deflections
            dynamics = _resolve_law(self.task, law, previous)
            if self._meets_requirements(law, dynamics):
                break
            self.places = [crossing.s for crossing in dynamics.crossings]
        return law, balance, dynamics

    def _find_law(self) -> Best:
        """Find the law of this stage by a search that resumes from the last law.

        If no law that is one series is found, the stages with lower caps of the speed are left out: the first
        stage of splines follows.
        """
        stage = self.stages[self.stage]
        task = self.next_task
        has_own_limits = task is self.task  # else lowered by the excess of this stage's last motion
        is_first_series = self.response is None and stage.degree is not None and has_own_limits
        if is_first_series or not has_own_limits:  # other laws are tried next: no explanation is needed yet
            task = task._replace(to_cross=replace(task.to_cross, explained=False))
        problem = problem_of(task, self.points, self.places)
        about = self.last_law or self.first_law  # drives are linearised about it
        if self.first_law is not None:
            problem = problem._replace(z0=self.first_law.law.squared_speed)
        if about is not None and problem.averages_open_duration:
            problem = problem._replace(average_over=suggest_time(about))
        degree = stage.degree if self.response is None else len(self.response.y) - 1
        problem = problem._replace(sampled=self.sampled, response=self.response, degree=degree)
        problem = problem._replace(trust=TRUSTED_SHARES[self.failures])
        duration = self.task.specification.duration
        if duration is None and self.last_law is not None:
            duration = self.last_law.law.duration
        if duration is not None:
            problem = problem._replace(max_squared_speed=stage.max_squared_speed / duration**2)

        # search; without a law as one series, begin with the stages of splines
        try:
            return solve_problem(problem, share=self.share or stage.share, similar=self.last_law)
        except (NoLaw, NotConverged):
            if not is_first_series:
                raise
        self.stage = self.stages.index(SPLINE_STAGES[0])
        return self._find_law()

    def _improves(self, cost: float) -> bool:
        """Return whether a cost [unit of the goal] is below the best one by more than the error of peaks."""
        assert self.best_motion is not None
        return cost < (1.0 - PEAK_TORQUE_MISMATCH) * _cost_of_motion(self.task, self.best_motion)

    def _choose_smoother(self, failure: NoAnswer) -> None:
        """Proceed to the next stage after a failure, without the results of the last stage.

        Limits lowered by the excess of its motions are such results: under other laws springs add other
        torques.

        Raises:
            NoAnswer: no smoother law can help, or no stage is left.
        """
        if isinstance(failure, SearchEnded | SpringsTooSoft):
            raise failure
        is_of_springs = self.task.follows_balance and not isinstance(failure, NoLaw)
        if self.first_failure is None and is_of_springs:
            self._check_ends()
            self._check_softening()
        if self.first_failure is None:
            self.first_failure = failure
        self.balance = self.response = self.places = None
        self.next_task = self.task
        self.stage += 1
        if self.stage == len(self.stages):
            raise self._refuse(failure) from None

    def _check_ends(self) -> None:
        """Raise NoLaw if the robot at rest has no equilibrium at an end of the path.

        The equilibrium is followed from rigid springs to those of the robot. If it turns back before, at a
        static fold, only stiffer springs hold the load.
        """
        for s in (0.0, 1.0):
            compliance = find_static_fold(self.task.branch, s)  # of the fold, over that of the robot
            if compliance is not None:
                stiffer = round_up(STIFFER_THAN_FOLD / compliance, 3)  # over the robot's stiffness
                raise NoLaw(
                    f"at rest at s = {s:g} the springs give way: as they get softer, "
                    f"deflections turn back at {1.0 / compliance:.3g} times their stiffness, so that no law "
                    f"was found on the branch of the rigid robot; springs {stiffer:.3g} times as stiff hold "
                    f"at this end",
                    name=self.task.robot.name,
                    evidence=StaticFold(s, compliance),
                )

    def _check_softening(self) -> None:
        """Raise NoLaw if even the law of least softening has no deflections in balance, to first order."""
        duration = self.task.specification.duration or (self.last_law and self.last_law.law.duration)
        if not duration:
            return
        problem = problem_of(self.task, self.points)._replace(sampled=self.sampled, degree=SERIES_DEGREE)
        least = find_least_softening(problem, duration)
        if least is not None and least.rho > MAX_SOFTENING:
            raise NoLaw(
                f"the springs give way at s = {least.s:.6g}: under the best law "
                f"found, to first order, loads take {least.rho:.3g} of what keeps the robot from being "
                f"singular there (above {MAX_SOFTENING:g}, to that order, no deflections are in balance)",
                name=self.task.robot.name,
                evidence=least,
            )

    def _meets_requirements(self, law: OptimalLaw, dynamics: InverseDynamics) -> bool:
        """Return whether a motion has the required times and speeds at its crossings."""
        request = self.task.request
        times = [crossing.time for crossing in dynamics.crossings]
        speeds = [law(time, 1) for time in times]
        return all(
            required is None or bool(np.allclose(found, required, rtol=allowed, atol=0.0))
            for found, required, allowed in (
                (times, request.times, REQUIRED_TIME_ERROR),
                (speeds, request.speeds, REQUIRED_SPEED_ERROR),
            )
        )

    def _prepare_next(self, motion: OptimalMotion, excess: float) -> None:
        """Linearise torques about a motion in balance; without one, lower the limits by the excess.

        Earlier failures say nothing about the laws that follow, and are dropped.

        Args:
            motion: the last motion, in balance if `self.balance` is set.
            excess: largest ratio of a torque or speed to its limit.
        """
        self.first_failure = None
        self.places = [crossing.s for crossing in motion.dynamics.crossings]
        if self.balance is not None:
            self.response = respond_to_law(self.balance)
            if excess <= 1.0 or not _has_predicted_peak(motion):
                return  # else the linear torques are right, and limits are exceeded between the points
        scaled = self.next_task.specification.scale_limits((1.0 - LIMIT_TIGHTENING) / excess)
        self.next_task = self.next_task._replace(specification=scaled)


def _has_predicted_peak(motion: OptimalMotion) -> bool:
    """Return whether a motion's peaks agree with the cone program's, within PEAK_TORQUE_MISMATCH.

    They are the peak torque and, of curves that are nearly reached, the largest ratio.
    """
    peak = float((motor_peaks(motion.dynamics)[0] / motion.best.reference).max())
    if abs(peak / motion.best.peak - 1.0) >= PEAK_TORQUE_MISMATCH:
        return False
    program, y = motion.best.program, motion.best.speed.y
    drives = program.problem.specification.drives
    if drives is None:
        return True
    ratios = curve_ratios(motion.dynamics, drives)[drives.has_curve]
    predicted = np.array([curve(y).max() for curve in program.rows.curve])
    is_off = np.abs(ratios - predicted) >= PEAK_TORQUE_MISMATCH
    return not (is_off & (predicted > NEARLY_REACHED)).any()


def _describe_cost(task: Task, motion: OptimalMotion) -> str:
    """Describe the cost of a certified motion, such as `0.231 s`."""
    robot, goal, cost = task.robot, task.specification.goal, _cost_of_motion(task, motion)
    if goal == "time":
        return f"{cost:.4g} s"
    if goal == "peak_torque":
        peaks = motor_peaks(motion.dynamics)[0]
        return f"peak torque {peaks.max():.4g} {robot.torque_units[int(peaks.argmax())]}"
    return f"energy {cost:.4g} s"


def _cost_of_motion(task: Task, motion: OptimalMotion) -> float:
    """Return the cost of a certified motion by the goal of the task.

    It is the duration [s], the peak torque over the reference, or the integral of (torque / reference)^2 [s].
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
    """Compute and certify the torques of a law along the path of a task.

    Args:
        known: deflections in balance; None to solve for the deflections.
    """
    dynamics = resolve(
        task.to_cross.searched,
        lambda _: law,
        geometry=task.geometry,
        tolerance=task.request.tolerance,
        friction=task.request.friction,
        known=known,
    )
    return share_within(dynamics, task.specification, optimal=True)
