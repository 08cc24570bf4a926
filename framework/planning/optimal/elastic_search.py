"""The best motion of an elastic robot: motions in balance, each better than the one before.

An elastic robot cannot follow every law. A law is replaced by the nearest series with deflections in balance
(`elastic_balance`), and its motion is certified by inverse dynamics.

The first law is a smooth one of the undeformed robot. Several are tried in turn, each smoother than the last
one, until deflections are resolved and springs are at rest at both ends. About a motion in balance, torques
and the motion of springs at the ends are linear in the law to first order (`torque_response`). Quadratic
programs with these rows give the next law (`next_law`), as long as the motion gains by it. The first motion
that is allowed by its response is certified, and the best one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from framework.dynamics.deflection_splines import KnownDeflections
from framework.dynamics.loaded_balance import springs_carry_inertia
from framework.dynamics.restoration import LEAST_MISFIT, BalanceSolution, refine_balance
from framework.dynamics.static_fold import find_static_fold
from framework.dynamics.torque_response import (
    foresee_deflections,
    peaks_at_nodes,
    renew_cells,
    respond_to_law,
)
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
from framework.laws.optimal_law import HIGHEST_SMOOTHNESS, OptimalLaw
from framework.numerics.time_limit import SearchEnded, report_result
from framework.planning.optimal.best_law import Best
from framework.planning.optimal.certified_motion import OptimalMotion, certify_motion
from framework.planning.optimal.elastic_balance import find_law_in_balance, measure_rest
from framework.planning.optimal.law_problem import LawProblem
from framework.planning.optimal.least_cost import NoneFound, cost_of, find_least_cost
from framework.planning.optimal.least_softening import find_least_softening
from framework.planning.optimal.next_law import evaluate_in_balance, find_next_law
from framework.planning.optimal.optimal_task import Task
from framework.planning.optimal.path_series import SampledDemand, sample_demand
from framework.planning.optimal.smooth_search import SAME_DURATION
from framework.planning.optimal.undeformed_law import (
    adapt_found_law,
    problem_of,
    require_law,
    rms_ratio,
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
# of deflections in balance inside the search: the first, and others; those of a certificate are settled
COARSE_MISFIT, LOOSE_MISFIT = 1e-6, 1e-8
# over the cells of the first deflections, 79 to 96, which hold one of three or four vibrations: under one law
# rest is 50, 4.4 and 1.2 on these, but 25, 1.1 and 1.2 on any 150 to 340 (delta, three_rrr, agile_eye)
CELLS_OF_VIBRATIONS = 2.0
MAX_PLACE_STEPS = 8  # of moving required times and speeds to where the deflected robot is singular
# share of z by which a law may differ from that about which torques are linear: at first, and the least;
# factor after a failure
FIRST_TRUST, LEAST_TRUST, TRUST_LOSS = 0.5, 0.05, 0.4
# to correct a motion that is not allowed: vibrations turn by half a radian. With 0.1 steps of delta foresaw a
# rest of 0.5 and found 1.2 to 4; with 0.03 it falls from 25 to 6.2, 2.8, 1.1 and 0.8
CORRECTION_TRUST = 0.03
MAX_FOLLOWED_REST = 50.0  # motion of springs at the ends (`measure_rest`) above which a law is given up
EXCESS_PENALTY, REST_PENALTY = 3.0, 0.02  # of the logarithm of the cost
MAX_DETOURS = 2  # steps to motions that are worse than those before
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


class Iterate(NamedTuple):
    """A law, and how far its motion is within what is allowed.

    best: the law; with a balance, its program has torques linear in the law.
    excess: the largest ratio of a torque or speed to its limit; by these torques without a certified motion.
    rest: likewise, the largest motion of a spring at an end (`measure_rest`).
    motion: the certified motion, if there is one.
    balance: deflections nearly in balance.
    places: s of the required times and speeds; None for the crossing points.
    """

    best: Best
    excess: float
    rest: float
    motion: OptimalMotion | None = None
    balance: BalanceSolution | None = None
    places: Sequence[float] | None = None

    @property
    def worst(self) -> float:
        """The excess or the motion at an end, whichever is larger; at most 1 is allowed."""
        return max(self.excess, self.rest)

    @property
    def merit(self) -> float:
        """The logarithm of the cost, and penalties of what is not allowed."""
        over = max(self.excess - 1.0, 0.0)
        unrest = max(self.rest - 1.0, 0.0)
        return float(np.log(self.best.cost)) + EXCESS_PENALTY * over + REST_PENALTY * unrest


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
    springs_vibrate: bool

    @staticmethod
    def of(task: Task) -> ElasticSearch:
        """Prepare the search of a task."""
        is_quickest = task.follows_balance and task.specification.goal == "time"
        starts: Sequence[Start] = QUICK if is_quickest else FREE
        is_damped = task.robot.is_damped and task.robot.elastic_inertia
        springs_vibrate = task.follows_balance and (is_damped or springs_carry_inertia(task.branch))
        if springs_vibrate:
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
        return ElasticSearch(task, starts, sampled, first_law, springs_vibrate)

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
        least_cost = np.inf
        longest = self.task.specification.longest or np.inf  # [s]
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
            is_found = is_yielded = False
            try:
                for iterate in self._improve(law) if is_deformed else self._keep_limits(start, law):
                    least_excess = min(least_excess, iterate.excess)
                    if iterate.worst > 1.0 or iterate.motion is None:
                        continue
                    is_found = True
                    cost = iterate.motion.cost(self.task.specification.goal)
                    duration = iterate.motion.dynamics.duration
                    if cost < least_cost:
                        least_cost = cost
                        is_yielded = duration <= longest * (1.0 + SAME_DURATION)
                        if is_yielded:
                            yield iterate.motion
            except FAILURES as reason:
                if isinstance(reason, SpringsTooSoft):
                    raise
                if failure is None and is_deformed and not isinstance(reason, NoLaw):
                    self._check_ends()
                    self._check_softening(law)
                failure = failure or reason
            if is_found and not is_yielded:  # the quickest motion; other goals keep to this duration
                most, quickest = format_distinct(longest, duration)
                raise NotConverged(
                    f"no law was found that takes at most {most} s: the quickest found with springs takes "
                    f"{quickest} s",
                    name=self.task.robot.name,
                    residual=duration / longest - 1.0,
                )
            if is_found:
                return
        if failure is not None and not 1.0 < least_excess < np.inf:  # no motion exceeded limits
            raise failure
        excess, _ = format_distinct(least_excess, 1.0)
        raise NotConverged(
            f"no law was found whose motion with springs keeps the limits: "
            f"the nearest motion found takes {excess} times the limits",
            name=self.task.robot.name,
            residual=least_excess - 1.0,
        )

    # ------------------------------------------------------------------ laws

    def _find_first_law(self, start: Start, similar: Best | None) -> Best:
        """Find the law of the undeformed robot that a start asks for.

        Args:
            similar: the law of another start.

        Raises:
            NoLaw, NotConverged: as `solve_problem`; explained only for starts that are open.
        """
        problem = self._problem(is_explained=start.is_open)._replace(degree=start.degree)
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

    def _problem(self, places: Sequence[float] | None = None, *, is_explained: bool = False) -> LawProblem:
        """Return the problem of the task.

        Args:
            places: s of the required times and speeds; by default the crossing points.
            is_explained: whether a refusal may be explained, if the task asks for that.
        """
        to_cross = self.task.to_cross
        to_cross = replace(to_cross, explained=to_cross.explained and is_explained)
        return problem_of(self.task._replace(to_cross=to_cross), places)._replace(sampled=self.sampled)

    # ------------------------------------------------------------------ motions

    def _keep_limits(self, start: Start, law: Best) -> Iterator[Iterate]:
        """Yield motions with geometry rigid: of a law, and of others with limits lowered by the excess.

        Durations grow as the root of what torques are divided by. The search ends where the next start, which
        costs its share, is cheaper, or where the excess does not fall.
        """
        following = self.starts[self.starts.index(start) + 1 :]
        next_cost = following[0].share if following else np.inf  # share of the least
        former = np.inf  # excess
        for _ in range(MAX_STEPS):
            iterate = self._certify(law.law, law, None)
            if iterate.rest > 1.0:
                raise self._refuse_rest(iterate.rest)
            yield iterate
            if iterate.excess <= 1.0 or np.sqrt(iterate.excess) - 1.0 > next_cost or iterate.excess >= former:
                return
            former = iterate.excess
            law = adapt_found_law(law, excess=former)

    def _improve(self, first: Best) -> Iterator[Iterate]:
        """Yield motions in balance: under the law nearest to a first one, and under better laws.

        The best iterate is that of least merit, or the last allowed one that costs less than those before.
        Torques are linearised about the last iterate, also if it is worse than the best: the next steps may
        correct it. If they do not, the search ends if any motion is allowed. Else, and after a step without a
        motion, the next law is sought nearer to the best iterate.

        Certified are the first law if no better one is expected, the first motion after a step that is
        allowed by its response, and the best one of all. Where a certificate does not allow the motion, the
        search goes on with lower limits, up to MAX_STEPS.
        """
        goal = self.task.specification.goal
        start = self._balance_law(first, None)
        assert start.balance is not None
        friction = self.task.specification.friction
        peak = (peaks_at_nodes(start.balance, friction) / first.reference).max()
        # whether no better motion is expected: deflections change nothing, or the last step gained too little
        is_last = abs(peak / first.peak - 1.0) < PEAK_TORQUE_MISMATCH and _is_near_least(first)
        certified = self._certify_balance(start) if is_last else None
        if certified is not None and certified.worst <= 1.0:
            yield certified
            return
        about = best = self._linearise_motion(start)
        if certified is not None:
            is_last = False
            about = best = best._replace(
                excess=certified.excess, rest=certified.rest, motion=certified.motion
            )
        new: Iterate | None = best
        least_cost = np.inf  # of certified motions that are allowed
        trust = FIRST_TRUST
        share = 1.0 - 2.0 * LIMIT_MARGIN  # of the limits; the rest is left for torques that are not linear
        detours = 0  # steps that made it worse since the best iterate
        for step in range(MAX_STEPS + 1):
            cost = np.inf  # of a certified motion that is allowed
            if new is not None:
                yield new
            if new is not None and new.motion is not None:
                cost = new.motion.cost(goal) if new.worst <= 1.0 else np.inf
                # limits may be exceeded between points: half the margin is left
                learnt = share * (1.0 - 0.5 * LIMIT_MARGIN) / max(new.excess, 0.5)
                share = min(learnt, 1.0 - 2.0 * LIMIT_MARGIN)
            if new is not None and (cost < least_cost or new.merit <= best.merit):
                about = best = new
                least_cost = min(least_cost, cost)
                detours = 0
            elif new is not None and (new.merit < about.merit or detours < MAX_DETOURS):
                detours += new.merit >= about.merit
                about = new
            elif new is not None and (least_cost < np.inf or best.worst <= 1.0):
                is_last = True
            else:
                about = best
                detours = 0
                trust *= TRUST_LOSS
            must_certify = best.motion is None and best.worst <= 1.0
            if (
                step == MAX_STEPS
                or trust < LEAST_TRUST
                or (is_last and least_cost < np.inf and not must_certify)
            ):
                break
            new = None
            try:
                if is_last and must_certify:
                    loose, best = best, best._replace(excess=np.inf)  # not allowed without a certificate
                    new = best = self._certify_balance(loose)
                    is_last = new.worst <= 1.0  # else the search goes on with less of the limits
                    continue
                is_correction = self.springs_vibrate and about.worst > 1.0
                found = find_next_law(about.best, CORRECTION_TRUST if is_correction else trust, share)
                if is_correction and about is best and not isinstance(found, Best):  # none is nearby
                    found = find_next_law(best.best, trust, share)
                next_law = require_law(about.best.program.problem, found)
                worthwhile = 1.0 - WORTHWHILE_GAIN
                if next_law.cost < worthwhile * min(
                    least_cost, best.best.cost if best.worst <= 1.0 else np.inf
                ):
                    new = self._linearise_motion(self._balance_law(next_law, about))
                    is_last |= about.worst <= 1.0 and new.best.cost > worthwhile * about.best.cost
                    if least_cost == np.inf and new.worst <= 1.0:
                        new = self._certify_balance(new)
                elif about is best:
                    is_last = True
            except FAILURES:
                if least_cost == np.inf and not must_certify and TRUST_LOSS * trust < LEAST_TRUST:
                    raise
        if must_certify:
            best = self._certify_balance(best)
            yield best
        if least_cost == np.inf and best.rest > 1.0:
            raise self._refuse_rest(best.rest)

    def _linearise_motion(self, iterate: Iterate) -> Iterate:
        """Linearise torques about a law in balance; measure the excess of limits and the springs' rest."""
        best, balance = iterate.best, iterate.balance
        assert balance is not None
        response = respond_to_law(balance)
        problem = self._problem(iterate.places)
        if problem.averages_open_duration:
            problem = problem._replace(average_over=suggest_time(best))
        problem = problem._replace(response=response, degree=len(response.y) - 1)
        in_balance = evaluate_in_balance(best, balance.law, problem)
        rest = float(np.abs(response.rest(response.y)).max(initial=0.0)) / MAX_END_RATE
        if rest > MAX_FOLLOWED_REST:
            raise self._refuse_rest(rest)
        rows, specification = in_balance.program.rows, problem.specification
        y, x, duration = in_balance.speed.y, in_balance.speed.x, in_balance.speed.duration
        excess = float(rows.largest_limit_ratio(y, x, specification.torque_limit).max())
        if specification.drives is not None:
            excess = max(excess, rms_ratio(in_balance, problem.stated_time or duration))
        return iterate._replace(best=in_balance, excess=excess, rest=rest)

    def _certify_balance(self, iterate: Iterate) -> Iterate:
        """Settle the deflections of an iterate, and certify its motion."""
        assert iterate.balance is not None
        settled = refine_balance(iterate.balance)
        certified = self._certify(settled.law, iterate.best, settled.deflections)
        return certified._replace(balance=iterate.balance, places=iterate.places)

    def _balance_law(self, best: Best, about: Iterate | None) -> Iterate:
        """Find the law in balance nearest to an optimum, its deflections, and the places it must meet.

        Deflections shift the crossings along the path. If times or speeds are required, the law is found
        again until it has them at the shifted crossings, which are those of a certified motion.

        Args:
            about: a similar motion, about which deflections are foreseen.

        Raises:
            NotConverged: times and speeds are not met.
        """
        is_coarse = about is None and self.springs_vibrate
        misfit = COARSE_MISFIT if is_coarse else LOOSE_MISFIT
        law = best.law
        previous: KnownDeflections | None = None
        places: Sequence[float] | None = None
        if about is not None and about.balance is not None:
            response = about.best.program.problem.response
            assert response is not None
            previous = foresee_deflections(about.balance, response, law.coefficients)
            if self.springs_vibrate:
                previous = renew_cells(previous, 1.0)
            places = about.places
        request = self.task.request
        is_certified = request.times is not None or request.speeds is not None
        for _ in range(MAX_PLACE_STEPS):
            law, balance = find_law_in_balance(
                self.task, law, previous, places, misfit=LEAST_MISFIT if is_certified else misfit
            )
            if not is_certified:
                break
            previous = balance.deflections
            motion = certify_motion(self.task, law, best, previous)
            crossings = motion.dynamics.crossings
            times = [crossing.time for crossing in crossings]
            speeds = [law(time, 1) for time in times]
            has_times = request.times is None or np.allclose(times, request.times, REQUIRED_TIME_ERROR, 0.0)
            has_speeds = request.speeds is None or np.allclose(
                speeds, request.speeds, REQUIRED_SPEED_ERROR, 0.0
            )
            if has_times and has_speeds:
                break
            places = [crossing.s for crossing in crossings]
        else:
            raise NotConverged(
                f"no law found has the required times and speeds where the deflected robot is singular, "
                f"in {MAX_PLACE_STEPS} passes",
                name=self.task.robot.name,
                residual=np.inf,
            )
        if is_coarse:
            fine = renew_cells(balance.deflections, CELLS_OF_VIBRATIONS)
            law, balance = find_law_in_balance(self.task, law, fine, places, misfit=LOOSE_MISFIT)
        return Iterate(best, np.inf, np.inf, None, balance, places)

    def _certify(self, law: OptimalLaw, best: Best, known: KnownDeflections | None) -> Iterate:
        """Certify the motion of a law, and measure how far it is within limits and at rest at the ends."""
        motion = certify_motion(self.task, law, best, known)
        excess = limit_excess(motion.dynamics, self.task.specification)
        return Iterate(best, excess, measure_rest(motion.dynamics, law), motion)

    def _refuse_rest(self, rest: float) -> NotConverged:
        """Return the refusal of a motion whose springs are not at rest at the ends."""
        return NotConverged(
            f"springs start or stop with {rest:.2g} times what counts as rest "
            f"({MAX_END_RATE:g} of their largest rate and {MAX_END_ACCELERATION:g} of their largest "
            f"acceleration), though {self.task.specification.smoothness} derivatives of the law vanish there",
            name=self.task.robot.name,
            residual=rest,
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
        problem = self._problem()._replace(degree=SERIES_DEGREE)
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
