"""The search for an elastic robot's law: programs about motions in balance.

    start       a smooth law of the undeformed robot, the sharpest whose springs nearly rest at both ends
    balance     of that law, loosely
    program     of the law about the motion (`elastic_program`), in a trust region; balance of its law
    certificate of the best law: what it finds raises smoothness, margin or the weight of rest

Each certificate begins a new round. A law that worsens the merit may be followed by others if it exceeds
limits by less each time: torques are not linear in the law beside the ends, and the next program corrects
them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from framework.dynamics.balance_equations import CERTIFIED, Accuracy
from framework.dynamics.deflection_splines import DeflectionSplines, KnownDeflections
from framework.dynamics.loaded_balance import springs_carry_inertia
from framework.dynamics.restoration import FIRST_CELLS
from framework.dynamics.result import InverseDynamics
from framework.dynamics.static_fold import find_static_fold
from framework.errors import (
    InvalidInput,
    NoAnswer,
    NoLaw,
    NotConverged,
    SpringsTooSoft,
    UnboundedTorque,
    round_up,
)
from framework.laws.optimal_law import HIGHEST_SMOOTHNESS, OptimalLaw
from framework.numerics.arrays import Array
from framework.numerics.cone_program import Affine
from framework.numerics.time_limit import SearchEnded, limit_time, report_result
from framework.planning.optimal.elastic_balance import find_law_in_balance, fit_series, rest_excess
from framework.planning.optimal.elastic_program import (
    SERIES_DEGREE,
    ElasticProgram,
    GoalWeights,
    Iterate,
)
from framework.planning.optimal.law_problem import condition_rows
from framework.planning.optimal.least_softening import find_least_softening
from framework.planning.optimal.optimal_task import OptimalMotion, Task, resolve_planned_law
from framework.planning.optimal.path_series import sample_demand
from framework.planning.optimal.undeformed_law import adapt_found_law, find_law, problem_of
from framework.planning.refusals import StaticFold
from framework.planning.request import limit_excess
from framework.singularity.points_on_path import SingularPoint
from framework.tolerances import MAX_SOFTENING, MAX_UNRESOLVED_MISFIT, REQUIRED_SPEED_ERROR, STIFFER_THAN_FOLD

START_SHARES = (1e-2, 0.1, 0.5, 3.0)  # of the least cost, that the smoothness of a first law may take
# of a first law: rates of springs at the ends over what is allowed, and torques over their limits
MAX_START_REST, MAX_START_LIMIT = 1.0, 3.0  # begun outside of rest, the program shapes the input
LOOSE, LOOSE_OF_INERTIA = Accuracy(1e-8, 400), Accuracy(1e-10, 400)
# weights of smoothness, also of springs with inertia; the factor with which these begin
SMOOTHNESS, SMOOTHNESS_OF_INERTIA, CONTINUATION = 1e-4, 6e-4, 4.0
MAX_STEPS = (16, 8, 8, 8, 8)  # programs of each round
MIN_GAIN, FIRST_GAIN = 1e-3, 1e-2  # of the merit, worth a program, also where smoothness is continued
FIRST_TRUST, MAX_TRUST, MIN_TRUST = 0.3, 0.9, 5e-3  # share of z by which it may fall in a program
MAX_WATCHED = 3  # laws in turn that worsen the merit
WATCHED_EXCESS = 0.15  # of limits, by the first of these laws
MAX_CELLS_KEPT = 4 * FIRST_CELLS  # from one balance to the next; more hold vibrations of a past law


class _Search(NamedTuple):
    """What does not change in a round.

    points: the crossing points of the undeformed robot.
    accuracy: of the balances before the certificate.
    speed_places: s of the crossings, where the required speeds, if any, must hold.
    """

    task: Task
    points: Sequence[SingularPoint]
    program: ElasticProgram
    accuracy: Accuracy
    speed_places: Sequence[float] | None = None


def find_elastic_motion(task: Task, points: Sequence[SingularPoint]) -> OptimalMotion:
    """Find the best law of an elastic robot, and certify its motion.

    Args:
        points: the crossing points of the undeformed robot.

    Raises:
        NoLaw: no law was found within the limits; the message says why.
        NotConverged: deflections and law do not settle together, or the solver gave up.
        As `resolve_planned_law`.
    """
    robot = task.robot
    accuracy, weights = LOOSE, GoalWeights(SMOOTHNESS)
    if springs_carry_inertia(task.branch) or (robot.is_damped and robot.elastic_inertia):
        # rates of springs follow the fifth derivative of the law, their accelerations the sixth
        task = task._replace(specification=replace(task.specification, smoothness=HIGHEST_SMOOTHNESS))
        accuracy, weights = LOOSE_OF_INERTIA, GoalWeights(SMOOTHNESS_OF_INERTIA)
    search, iterate = _find_start(task, points, accuracy)
    _report(search, iterate, weights)
    if accuracy is LOOSE_OF_INERTIA:  # continuation in smoothness: sharp laws shake springs at the ends
        smoother = weights._replace(smoothness=CONTINUATION * weights.smoothness)
        iterate = _improve(search, iterate, smoother, MAX_STEPS[0], FIRST_GAIN)
    for steps in MAX_STEPS:
        iterate = _improve(search, iterate, weights, steps)
        try:
            with limit_time(None):  # of the search, not of the certificate
                law, dynamics = _certify(search, iterate)
        except (NotConverged, UnboundedTorque) as reason:
            failure: NoAnswer = reason
            weights = weights._replace(smoothness=8.0 * weights.smoothness)
            continue
        excess = limit_excess(dynamics, task.specification)
        unrest = rest_excess(dynamics, law)
        has_speeds = _has_required_speeds(task, law, dynamics)
        if excess <= 1.0 and unrest <= 1.0 and has_speeds:
            with limit_time(None):
                gap = _foresee_gap(search, iterate, weights)
            return OptimalMotion(dynamics, law, search.program.reference, gap)
        failure = NotConverged(
            f"{robot.name}: no law near the best keeps all limits, required speeds and springs at rest: "
            f"torques or speeds reach {excess:.6g} of their limits, springs at the ends {unrest:.3g} of what "
            f"they may move",
            residual=max(excess, unrest) - 1.0,
        )
        weights = weights.learn(iterate.costs, excess, unrest)
        if not has_speeds:
            search = search._replace(speed_places=[crossing.s for crossing in dynamics.crossings])
    raise failure


def _find_start(task: Task, points: Sequence[SingularPoint], accuracy: Accuracy) -> tuple[_Search, Iterate]:
    """Find a law of the undeformed robot with deflections in balance, the sharpest with springs near rest."""
    best = find_law(task, points)
    failure: NoAnswer | None = None
    least: tuple[float, _Search, Iterate] | None = None
    for share in START_SHARES:
        try:
            law = fit_series(task, adapt_found_law(task, points, best, share=share).law, SERIES_DEGREE)
        except NotConverged as reason:
            failure = failure or reason
            continue
        unit = float(law.squared_speed(np.linspace(0.0, 1.0, 201)).mean())
        search = _Search(task, points, ElasticProgram(task, best.reference, unit), accuracy)
        iterate = _balance(search, law.coefficients, None)
        if isinstance(iterate, NoAnswer):
            failure = failure or iterate
            if isinstance(iterate, SpringsTooSoft):
                break
            continue
        excess = max(iterate.costs.end_rate / MAX_START_REST, iterate.costs.limit_ratio / MAX_START_LIMIT)
        if least is None or excess < least[0]:
            least = excess, search, iterate
        if excess <= 1.0:
            break
    if least is None:
        assert failure is not None
        if not isinstance(failure, SpringsTooSoft):
            _check_ends(task)
            _check_softening(task, points, best.law.duration)
        raise failure
    return least[1:]


def _balance(search: _Search, y: Array, previous: KnownDeflections | None) -> Iterate | NoAnswer:
    """Balance a law, and linearise its torques; return the refusal if that fails.

    Args:
        y: (n,) coefficients of z.
        previous: deflections near the result.
    """
    task = search.task
    try:
        specification, stretch = task.specification, task.stretch
        law = OptimalLaw(
            y, specification.smoothness, dense_at=stretch.dense_at, moving=specification.ends.moving
        )
        law, balance = find_law_in_balance(task, law, previous, search.speed_places, search.accuracy)
        if balance.state.misfit > MAX_UNRESOLVED_MISFIT:
            return NotConverged(
                f"{task.robot.name}: deflections do not settle", residual=balance.state.misfit
            )
        return search.program.iterate(law, balance)
    except SearchEnded:
        raise
    except NoAnswer as failure:
        return failure
    except (InvalidInput, np.linalg.LinAlgError) as reason:  # the law stands still; a pose is singular
        return NotConverged(f"{task.robot.name}: {reason}", residual=np.inf)


def _improve(
    search: _Search, start: Iterate, weights: GoalWeights, steps: int, min_gain: float = MIN_GAIN
) -> Iterate:
    """Find a law of less merit by some steps of programs in a trust region.

    Args:
        min_gain: of the merit, by a program, or by three.
    """
    best = current = start
    trust, failed, watched = FIRST_TRUST, np.inf, 0
    gains = list[float]()
    program = search.program
    try:
        for _ in range(steps):
            if trust < MIN_TRUST:
                break
            best_merit = best.costs.merit(weights)
            proposal = program.propose(current, weights, trust, _equalities(search, current))
            if proposal is None:
                current, watched, failed, trust = best, 0, trust, 0.4 * trust
                continue
            step = min(proposal.step, trust)
            promise = best_merit - proposal.costs.merit(weights)
            has_stalled = len(gains) >= 3 and sum(gains[-3:]) < min_gain
            if best.costs.keeps_limits(weights) and (promise < min_gain or has_stalled):
                if current is best:
                    break
                current, watched, failed, trust = best, 0, step, 0.4 * step
                continue
            trial = _balance(search, proposal.y, _foresee_deflections(current, proposal.y))
            if isinstance(trial, NoAnswer):
                current, watched, failed, trust = best, 0, step, 0.4 * step
                continue
            gain = best_merit - trial.costs.merit(weights)
            excess = weights.limit_ratio * trial.costs.limit_ratio - 1.0
            last_excess = weights.limit_ratio * current.costs.limit_ratio - 1.0
            is_restless = weights.rest_ratio * trial.costs.end_rate > 1.0
            if gain > 0.1 * promise:
                gains.append(gain)
                best = current = trial
                watched = 0
                _report(search, best, weights)
                if gain > 0.7 * promise:
                    trust = min(2.5 * trust, max(trust, 0.7 * failed), MAX_TRUST)
            elif (
                watched < MAX_WATCHED
                and not is_restless
                and excess < (0.3 * last_excess if watched else WATCHED_EXCESS)
            ):
                current, watched = trial, watched + 1
            else:
                current, watched, failed, trust = best, 0, step, 0.4 * step
    except SearchEnded:
        if not best.costs.keeps_limits(weights):
            raise
    return best


def _report(search: _Search, iterate: Iterate, weights: GoalWeights) -> None:
    """Report the cost of a law within the limits, such as `0.231 s`; the search may end with the law."""
    if not iterate.costs.keeps_limits(weights):
        return
    peaks = np.abs(iterate.motors.torque).max(axis=0)  # (n_a,)
    unit = search.task.robot.torque_units[int(peaks.argmax())]
    cost = iterate.costs.goal
    words = {"time": f"{cost:.4g} s", "energy": f"energy {cost:.4g} s"}
    report_result(words.get(search.task.specification.goal, f"peak torque {peaks.max():.4g} {unit}"))


def _equalities(search: _Search, iterate: Iterate) -> Affine:
    """Return rows (k, n) on y of condition (8) of the loaded robot and of the required speeds."""
    rows = condition_rows(problem_of(search.task, search.points, search.speed_places), iterate.law.basis)
    slopes = iterate.response.scalar_slopes  # in place of condition (8) of the undeformed robot
    matrix = np.concatenate([slopes, rows.matrix.toarray()[len(slopes) :]])
    return Affine(matrix, np.append(-slopes @ iterate.response.y, rows.offset[len(slopes) :]))


def _foresee_deflections(iterate: Iterate, y: Array) -> KnownDeflections:
    """Return the deflections of another law of coefficients y (n,), to first order, on few cells."""
    state = iterate.balance.state
    series = state.series + iterate.response.series_slopes @ (y - iterate.response.y)
    series = series * iterate.balance.equations.units
    clock, splines = state.samples.clock, state.splines
    if len(splines.cells) <= MAX_CELLS_KEPT:
        return KnownDeflections(clock, splines, series)
    coarse = DeflectionSplines.uniform(splines.panels, FIRST_CELLS, continuity=splines.continuity)
    return KnownDeflections(clock, coarse, coarse.fit(splines.evaluate(series, coarse.nodes.p)))


def _certify(search: _Search, iterate: Iterate) -> tuple[OptimalLaw, InverseDynamics]:
    """Balance a law to rounding, and certify its motion; raise as both functions called."""
    near = _foresee_deflections(iterate, iterate.response.y)
    law, balance = find_law_in_balance(search.task, iterate.law, near, search.speed_places, CERTIFIED)
    return law, resolve_planned_law(search.task, law, balance.deflections)


def _foresee_gap(search: _Search, iterate: Iterate, weights: GoalWeights) -> float:
    """Return the goal over the least one that a program without smoothness foresees, less 1."""
    sharp = weights._replace(smoothness=0.01 * weights.smoothness)
    proposal = search.program.propose(iterate, sharp, MAX_TRUST, _equalities(search, iterate))
    return 0.0 if proposal is None else max(iterate.costs.goal / proposal.costs.goal - 1.0, 0.0)


def _has_required_speeds(task: Task, law: OptimalLaw, dynamics: InverseDynamics) -> bool:
    """Return whether a law has the required speeds, if any, at the crossings of its motion."""
    required = task.request.speeds
    if required is None:
        return True
    speeds = [law(crossing.time, 1) for crossing in dynamics.crossings]
    return bool(np.allclose(speeds, required, rtol=REQUIRED_SPEED_ERROR, atol=0.0))


def _check_ends(task: Task) -> None:
    """Raise NoLaw if the robot at rest has no equilibrium at an end of the path.

    The equilibrium is followed from rigid springs to those of the robot. If it turns back before, at a
    static fold, only stiffer springs hold the load.
    """
    for s in (0.0, 1.0):
        compliance = find_static_fold(task.branch, s)  # of the fold, over that of the robot
        if compliance is not None:
            stiffer = round_up(STIFFER_THAN_FOLD / compliance, 3)  # over the robot's stiffness
            raise NoLaw(
                f"{task.robot.name}: at rest at s = {s:g} the springs give way: as they get softer, "
                f"deflections turn back at {1.0 / compliance:.3g} times their stiffness, so that no law "
                f"was found on the branch of the rigid robot; springs {stiffer:.3g} times as stiff hold "
                f"at this end",
                evidence=StaticFold(s, compliance),
            )


def _check_softening(task: Task, points: Sequence[SingularPoint], duration: float) -> None:
    """Raise NoLaw if even the law of least softening has no deflections in balance, to first order.

    Args:
        duration: [s] of a law of the undeformed robot.
    """
    problem = problem_of(task, points)._replace(sampled=sample_demand(task))
    least = find_least_softening(problem, duration)
    if least is not None and least.rho > MAX_SOFTENING:
        raise NoLaw(
            f"{task.robot.name}: the springs give way at s = {least.s:.6g}: under the best law "
            f"found, to first order, loads take {least.rho:.3g} of what keeps the robot from being "
            f"singular there (above {MAX_SOFTENING:g}, to that order, no deflections are in balance)",
            evidence=least,
        )
