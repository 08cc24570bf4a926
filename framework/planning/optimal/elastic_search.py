"""The best motion of an elastic robot: motions in balance, each better than the one before.

An elastic robot cannot follow every law. A law is replaced by the nearest series with deflections in balance
(`elastic_balance`), and its motion is certified by inverse dynamics.

The first law is a smooth one of the undeformed robot. Several are tried in turn, each smoother than the last
one, until deflections are resolved and springs are at rest at both ends. About a motion in balance, torques
and the motion of springs at the ends are linear in the law to first order (`torque_response`). Quadratic
programs with these rows give the next law (`next_law`), as long as the certified motion gains by it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from framework.dynamics.deflection_splines import KnownDeflections
from framework.dynamics.loaded_balance import springs_carry_inertia
from framework.dynamics.restoration import BalanceSolution
from framework.dynamics.static_fold import find_static_fold
from framework.dynamics.torque_response import TorqueResponse, foresee_deflections, respond_to_law
from framework.errors import (
    NoAnswer,
    NoLaw,
    NotAssembled,
    NotConverged,
    SpringsTooSoft,
    UnboundedTorque,
    format_distinct,
    round_up,
)
from framework.laws.optimal_law import HIGHEST_SMOOTHNESS
from framework.numerics.time_limit import SearchEnded, report_result
from framework.planning.optimal.best_law import LIMIT_TIGHTENING, Best
from framework.planning.optimal.certified_motion import OptimalMotion, certify_motion
from framework.planning.optimal.elastic_balance import find_law_in_balance, measure_rest
from framework.planning.optimal.law_problem import LawProblem
from framework.planning.optimal.least_cost import NoneFound, cost_of, find_least_cost
from framework.planning.optimal.least_softening import find_least_softening
from framework.planning.optimal.next_law import find_next_law
from framework.planning.optimal.optimal_task import Task
from framework.planning.optimal.path_series import SampledDemand, sample_demand
from framework.planning.optimal.undeformed_law import (
    problem_of,
    require_law,
    settle_tangents,
    solve_problem,
    suggest_time,
)
from framework.planning.refusals import StaticFold
from framework.planning.request import limit_excess
from framework.tolerances import (
    LIMIT_MARGIN,
    MAX_END_ACCELERATION,
    MAX_END_RATE,
    MAX_SOFTENING,
    PEAK_TORQUE_MISMATCH,
    REQUIRED_SPEED_ERROR,
    REQUIRED_TIME_ERROR,
    SMOOTHNESS_COST,
    STIFFER_THAN_FOLD,
)

SERIES_DEGREE = 40  # of z as one series
MAX_STEPS = 12  # from one start
MAX_PLACE_STEPS = 8  # of moving required times and speeds to where the deflected robot is singular
# share of z by which a law may differ from that about which torques are linear: at first, where springs
# move at the ends, and the least; factor after a failure
FIRST_TRUST, CORRECTION_TRUST, LEAST_TRUST, TRUST_LOSS = 0.5, 0.1, 0.05, 0.4
MAX_FOLLOWED_REST = 50.0  # motion of springs at the ends (`measure_rest`) above which a law is given up
EXCESS_PENALTY, REST_PENALTY = 3.0, 0.02  # of the logarithm of the cost
MAX_DETOURS = 2  # steps on from motions that are worse than the best
# relative gap of a cost to the least, and gain of a step, above which a better law is sought
WORTHWHILE_GAP, WORTHWHILE_GAIN = 1.5e-2, 5e-3
CAP_REACHED = 0.98  # largest squared speed of a first law over its cap, from which the cap may raise the cost
FAILURES = (NoLaw, NotAssembled, NotConverged, UnboundedTorque)  # of a law; another one may do


class Start(NamedTuple):
    """How smooth the first law has to be.

    share: share of the least cost by which the cost of the law may exceed it.
    max_squared_speed: limit of z times the duration squared. A law that is quick in sigma at its ends shakes
        springs that carry inertia.
    degree: degree of z as one series; None for splines, to which a series is fitted.
    """

    share: float
    max_squared_speed: float = np.inf
    degree: int | None = SERIES_DEGREE

    @property
    def is_open(self) -> bool:
        """Whether no law is left out, so that a refusal can be explained."""
        return self.degree is None and self.max_squared_speed == np.inf


# tried in turn until deflections are resolved and at rest at both ends
SPLINES = tuple(Start(share, degree=None) for share in (4e-2, 0.15, 0.5, 3.0))
SERIES = (Start(2e-2, 8.0), Start(2e-2, 4.0), Start(0.3, 4.0), Start(3.0, 4.0))
CAPPED_SPLINES = tuple(start._replace(max_squared_speed=30.0) for start in SPLINES[1:])
SMOOTH = (*SERIES, SPLINES[0], *CAPPED_SPLINES, *SPLINES[1:])
CAPPED = (Start(SMOOTHNESS_COST, 30.0), *SMOOTH)
# of springs whose rates cause no forces
FREE = (Start(SMOOTHNESS_COST), CAPPED[0], Start(1e-2, 12.0), *SERIES, *SPLINES)
# of these, where a law is improved: the quickest one would exceed limits most under deflections
QUICK = (Start(2e-2), *FREE[1:])


@dataclass(frozen=True)
class Iterate:
    """A certified motion and its balance.

    balance: deflections in balance; None with geometry rigid, where `resolve` finds the deflections.
    excess: the largest ratio of a torque or speed to its limit.
    rest: the largest motion of a spring at an end (`measure_rest`).
    """

    motion: OptimalMotion
    balance: BalanceSolution | None
    excess: float
    rest: float

    @property
    def worst(self) -> float:
        """The excess or the motion at an end, whichever is larger; at most 1 is allowed."""
        return max(self.excess, self.rest)

    def merit(self, goal: str) -> float:
        """Return the logarithm of the cost by a goal, and penalties of what is not allowed."""
        over = max(self.excess - 1.0, 0.0)
        unrest = max(self.rest - 1.0, 0.0)
        return float(np.log(self.motion.cost(goal))) + EXCESS_PENALTY * over + REST_PENALTY * unrest

    @cached_property
    def response(self) -> TorqueResponse:
        """Torques linear in the law about this motion."""
        assert self.balance is not None
        return respond_to_law(self.balance)


@dataclass(frozen=True)
class ElasticSearch:
    """The search for the best motion of an elastic robot.

    starts: tried in turn.
    sampled: the demand on the motors of the undeformed robot, if resolved.
    first_law: the law about which limits of drives are linearised before the first motion; None without.
    """

    task: Task
    starts: Sequence[Start]
    sampled: SampledDemand | None
    first_law: Best | None

    @staticmethod
    def of(task: Task) -> ElasticSearch:
        """Prepare the search of a task."""
        is_quickest = task.follows_balance and task.specification.goal == "time"
        starts: Sequence[Start] = QUICK if is_quickest else FREE
        is_damped = task.robot.is_damped and task.robot.elastic_inertia
        if task.follows_balance and (is_damped or springs_carry_inertia(task.branch)):
            # redundant motors shake the springs between them, so that few quick laws leave these at rest
            starts = SMOOTH if is_quickest or task.robot.n_a > task.robot.n else CAPPED
            # rates of springs follow the fifth derivative of the law, their accelerations the sixth
            task = task._replace(specification=replace(task.specification, smoothness=HIGHEST_SMOOTHNESS))
        sampled = sample_demand(task)
        first_law = None
        # first laws of elastic robots leave damping out
        if task.specification.drives is not None and not task.robot.is_damped:
            result = settle_tangents(problem_of(task)._replace(sampled=sampled))
            first_law = result if isinstance(result, Best) else None
        return ElasticSearch(task, starts, sampled, first_law)

    def find_motion(self) -> OptimalMotion:
        """Return the best motion; raise NoLaw or NotConverged if there is none."""
        best = None
        try:
            for best in self.find_motions():
                report_result(best.describe_cost(self.task.specification.goal))
        except SearchEnded:
            if best is None:
                raise
        assert best is not None
        return best

    def find_motions(self) -> Iterator[OptimalMotion]:
        """Yield motions within the limits, each better than the one before, from the first start with any.

        Raises:
            NoAnswer: no start has any.
        """
        failure: NoAnswer | None = None  # the first one
        least_excess = np.inf
        former_start: Start | None = None
        former_law: Best | None = None
        is_deformed = self.task.follows_balance
        is_series = True  # whether z may be one series; lower caps leave no more of these
        for start in self.starts:
            if start.degree is not None and not is_series:
                continue
            try:
                law = self._find_first_law(start, former_law)
            except (NoLaw, NotConverged) as reason:
                if not start.is_open:
                    is_series = False
                    continue
                failure = failure or reason
                break
            # with a larger share alone, a law of the same cost is the former one, whose motion failed
            if former_start is not None and former_law is not None:
                differs_in_share = start._replace(share=former_start.share) == former_start
                if differs_in_share and abs(law.cost / former_law.cost - 1.0) < PEAK_TORQUE_MISMATCH:
                    continue
            former_start, former_law = start, law
            is_found = False
            try:
                for iterate in self._improve(law) if is_deformed else self._keep_limits(start, law):
                    least_excess = min(least_excess, iterate.excess)
                    if iterate.worst <= 1.0:
                        is_found = True
                        yield iterate.motion
            except FAILURES as reason:
                if isinstance(reason, SpringsTooSoft):
                    raise
                if failure is None and is_deformed and not isinstance(reason, NoLaw):
                    self._check_ends()
                    self._check_softening(law)
                failure = failure or reason
            if is_found:
                return
        raise self._refuse(failure, least_excess)

    def _refuse(self, failure: NoAnswer | None, least_excess: float) -> NoAnswer:
        """Return the refusal: limits are named only if a motion exceeded them.

        Args:
            failure: the first failure of a start.
            least_excess: of all certified motions; infinite without one.
        """
        if failure is not None and not 1.0 < least_excess < np.inf:
            return failure
        excess, _ = format_distinct(least_excess, 1.0)
        return NotConverged(
            f"no law was found whose motion with springs keeps the limits: "
            f"the nearest motion found takes {excess} times the limits",
            name=self.task.robot.name,
            residual=least_excess - 1.0,
        )

    # ------------------------------------------------------------------ laws

    def _find_first_law(self, start: Start, similar: Best | None, share: float = 1.0) -> Best:
        """Find the law of the undeformed robot that a start asks for.

        Args:
            similar: the law of another start, or of other limits.
            share: of the limits that may be used.

        Raises:
            NoLaw, NotConverged: as `solve_problem`; explained only for starts that are open.
        """
        is_explained = start.is_open and share == 1.0
        problem = self._problem(share, None, is_explained=is_explained)._replace(degree=start.degree)
        about = similar or self.first_law  # about which drives are linearised
        if self.first_law is not None:
            problem = problem._replace(z0=self.first_law.law.squared_speed)
        if about is not None and problem.averages_open_duration:
            problem = problem._replace(average_over=suggest_time(about))
        duration = self.task.specification.duration
        if duration is None and start.max_squared_speed < np.inf:
            similar = similar or solve_problem(problem, share=start.share)
            duration = similar.law.duration
        if duration is not None:
            problem = problem._replace(max_squared_speed=start.max_squared_speed / duration**2)
        return solve_problem(problem, share=start.share, similar=similar)

    def _find_next_law(self, about: Iterate, trust: float, share: float) -> Best:
        """Find the best law near a motion in balance, with torques linear in the law.

        Args:
            trust: share of z by which the law may differ.
            share: of the limits that may be used.
        """
        best = about.motion.best
        places = [crossing.s for crossing in about.motion.dynamics.crossings]
        problem = self._problem(share, places, is_explained=False)
        if problem.averages_open_duration:
            problem = problem._replace(average_over=suggest_time(best))
        degree = len(about.response.y) - 1
        problem = problem._replace(response=about.response, degree=degree)
        result = None
        if about.rest > 1.0:  # nearby, if there is such a law
            result = find_next_law(best, problem, min(trust, CORRECTION_TRUST))
        if not isinstance(result, Best):
            result = find_next_law(best, problem, trust)
        return require_law(problem, result)

    def _problem(self, share: float, places: Sequence[float] | None, *, is_explained: bool) -> LawProblem:
        """Return the problem of the task within a share of its limits.

        Args:
            places: s of the required times and speeds; by default the crossing points.
            is_explained: whether a refusal may be explained, if the task asks for that.
        """
        to_cross = self.task.to_cross
        to_cross = replace(to_cross, explained=to_cross.explained and is_explained)
        specification = self.task.specification
        if share < 1.0:
            specification = specification.scale_limits(share)
        task = self.task._replace(to_cross=to_cross, specification=specification)
        return problem_of(task, places)._replace(sampled=self.sampled)

    # ------------------------------------------------------------------ motions

    def _keep_limits(self, start: Start, law: Best) -> Iterator[Iterate]:
        """Yield motions with geometry rigid: of a law, and of others with limits lowered by the excess.

        Durations grow as the root of what torques are divided by. The search ends where the next start, which
        costs its share, is cheaper, or where the excess does not fall.
        """
        following = self.starts[self.starts.index(start) + 1 :]
        next_cost = following[0].share if following else np.inf  # share of the least
        share = 1.0
        former = np.inf  # excess
        for _ in range(MAX_STEPS):
            iterate = self._measure(certify_motion(self.task, law.law, law), None)
            if iterate.rest > 1.0:
                raise self._refuse_rest(iterate.rest)
            yield iterate
            if iterate.excess <= 1.0 or np.sqrt(iterate.excess) - 1.0 > next_cost or iterate.excess >= former:
                return
            share *= (1.0 - LIMIT_TIGHTENING) / iterate.excess
            former = iterate.excess
            law = self._find_first_law(start, law, share)

    def _improve(self, law: Best) -> Iterator[Iterate]:
        """Yield motions in balance: under the law nearest to a first one, and under better laws.

        The best motion is that of least merit, or the last allowed one that costs less than those before.
        Torques are linearised about the last motion, also if it is worse than the best: the next step may
        correct it. After MAX_DETOURS such steps the search ends if any motion is allowed. Else, and after a
        step without a motion, the next law is sought nearer to the best motion.
        """
        goal = self.task.specification.goal
        about = best = self._balance_law(law, None)
        yield about
        if best.worst <= 1.0 and best.motion.has_predicted_peak and _is_near_least(law):
            return  # deflections change nothing
        trust = FIRST_TRUST
        share = 1.0 - LIMIT_MARGIN  # what is left for torques that are not linear
        detours = 0  # steps since the best motion
        least_cost = best.motion.cost(goal) if best.worst <= 1.0 else np.inf  # of allowed motions
        for _ in range(MAX_STEPS):
            new = None
            try:
                law = self._find_next_law(about, trust, share)
                if best.worst > 1.0 or law.cost < (1.0 - WORTHWHILE_GAIN) * best.motion.cost(goal):
                    new = self._balance_law(law, about)
                elif about is best:
                    return
            except FAILURES:
                if least_cost == np.inf and TRUST_LOSS * trust < LEAST_TRUST:
                    raise
            # the linear torques are right, and limits are exceeded between points: half the margin is left
            if new is not None and new.excess > 1.0 and new.motion.has_predicted_peak:
                share *= (1.0 - 0.5 * LIMIT_MARGIN) / new.excess
            is_least = new is not None and new.worst <= 1.0 and new.motion.cost(goal) < least_cost
            if new is not None and (is_least or new.merit(goal) < best.merit(goal)):
                yield new
                about = best = new
                least_cost = new.motion.cost(goal) if is_least else least_cost
                detours = 0
                trust = min(trust / TRUST_LOSS, FIRST_TRUST)
            elif new is not None and detours < MAX_DETOURS:
                about = new
                detours += 1
            elif new is not None and least_cost < np.inf:
                return
            else:
                about = best
                detours = 0
                trust *= TRUST_LOSS
                if trust < LEAST_TRUST:
                    break
        if least_cost == np.inf and best.rest > 1.0:
            raise self._refuse_rest(best.rest)

    def _balance_law(self, best: Best, about: Iterate | None) -> Iterate:
        """Find the law in balance nearest to an optimum, and certify its motion.

        Deflections shift the crossings along the path. If times or speeds are required, the law is found
        again until it has them at the shifted crossings.

        Args:
            about: a similar motion, about which deflections are foreseen.

        Raises:
            NotConverged: springs are not at rest at the ends, or times and speeds are not met.
        """
        law = best.law
        previous: KnownDeflections | None = None
        places: list[float] | None = None
        if about is not None and about.balance is not None:
            previous = foresee_deflections(about.balance, about.response, law.coefficients)
            places = [crossing.s for crossing in about.motion.dynamics.crossings]
        for _ in range(MAX_PLACE_STEPS):
            law, balance = find_law_in_balance(self.task, law, previous, places)
            previous = balance.deflections
            motion = certify_motion(self.task, law, best, previous)
            if self._meets_requirements(motion):
                iterate = self._measure(motion, balance)
                if iterate.rest > MAX_FOLLOWED_REST:
                    raise self._refuse_rest(iterate.rest)
                return iterate
            places = [crossing.s for crossing in motion.dynamics.crossings]
        raise NotConverged(
            f"no law found has the required times and speeds where the deflected robot is singular, "
            f"in {MAX_PLACE_STEPS} passes",
            name=self.task.robot.name,
            residual=np.inf,
        )

    def _measure(self, motion: OptimalMotion, balance: BalanceSolution | None) -> Iterate:
        """Measure how far a motion is within limits, and at rest at the ends."""
        excess = limit_excess(motion.dynamics, self.task.specification)
        return Iterate(motion, balance, excess, measure_rest(motion.dynamics, motion.law))

    def _refuse_rest(self, rest: float) -> NotConverged:
        """Return the refusal of a motion whose springs are not at rest at the ends."""
        return NotConverged(
            f"springs start or stop with {rest:.2g} times what counts as rest "
            f"({MAX_END_RATE:g} of their largest rate and {MAX_END_ACCELERATION:g} of their largest "
            f"acceleration), though {self.task.specification.smoothness} derivatives of the law vanish there",
            name=self.task.robot.name,
            residual=rest,
        )

    def _meets_requirements(self, motion: OptimalMotion) -> bool:
        """Return whether a motion has the required times and speeds at its crossings."""
        request = self.task.request
        times = [crossing.time for crossing in motion.dynamics.crossings]
        speeds = [motion.law(time, 1) for time in times]
        return all(
            required is None or bool(np.allclose(found, required, rtol=allowed, atol=0.0))
            for found, required, allowed in (
                (times, request.times, REQUIRED_TIME_ERROR),
                (speeds, request.speeds, REQUIRED_SPEED_ERROR),
            )
        )

    # ------------------------------------------------------------------ explanations

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
                    f"at rest at s = {s:g} the springs give way: as they get softer, deflections turn back "
                    f"at {1.0 / compliance:.3g} times their stiffness, so that no law was found on the "
                    f"branch of the rigid robot; springs {stiffer:.3g} times as stiff hold at this end",
                    name=self.task.robot.name,
                    evidence=StaticFold(s, compliance),
                )

    def _check_softening(self, law: Best) -> None:
        """Raise NoLaw if even the law of least softening has no deflections in balance, to first order.

        Args:
            law: whose duration the laws take if none is required.
        """
        duration = self.task.specification.duration or law.law.duration
        problem = self._problem(1.0, None, is_explained=False)._replace(degree=SERIES_DEGREE)
        least = find_least_softening(problem, duration)
        if least is not None and least.rho > MAX_SOFTENING:
            raise NoLaw(
                f"the springs give way at s = {least.s:.6g}: under the best law "
                f"found, to first order, loads take {least.rho:.3g} of what keeps the robot from being "
                f"singular there (above {MAX_SOFTENING:g}, to that order, no deflections are in balance)",
                name=self.task.robot.name,
                evidence=least,
            )


def _is_near_least(law: Best) -> bool:
    """Return whether a first law costs little more than the least, also than without a cap of its speed."""
    if law.gap >= WORTHWHILE_GAP:
        return False
    problem = law.program.problem
    cap = problem.max_squared_speed
    if (law.program.positive_rows @ law.speed.y).max() < CAP_REACHED * cap:
        return True
    least = find_least_cost(problem._replace(max_squared_speed=np.inf), units=law.search.units)
    return isinstance(least, NoneFound) or law.cost < (1.0 + WORTHWHILE_GAP) * cost_of(
        law.search.goal, least.speed
    )
