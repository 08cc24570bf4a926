"""Deflections in balance with the forces that they cause, and the scalars of the law that make them smooth.

Near the singular point of the loaded robot, deflections in balance look like l^2 + (s - s_0) l = eps, and
only eps = 0 has a smooth solution through the point. For that the law has one scalar a crossing. Both are
found together by Gauss-Newton on `balance_equations`. Nothing is divided by the measure of the singularity,
and no second derivative is fed back from pass to pass.

If the truncation of the series limits the misfit, the series gets more coefficients. If no step lowers the
misfit, the problem is solved for stiffer springs first, which are then softened stepwise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.dynamics.balance_equations import (
    BalanceEquations,
    BalanceState,
    Family,
    LoadSlopes,
    Step,
    resize_series,
)
from framework.dynamics.known_deflections import KnownDeflections
from framework.dynamics.loaded_balance import spring_units
from framework.dynamics.singularity_crossings import panel_edges
from framework.errors import InvalidInput, NoAnswer, NotConverged, SpringsTooSoft
from framework.kinematics.continuation.tracking import Branch
from framework.laws.clock import Clock, InTime, OnParameter
from framework.laws.law import MotionLaw
from framework.laws.optimal_law import OptimalLaw
from framework.numerics.arrays import Array
from framework.numerics.time_limit import check_time
from framework.tolerances import MAX_DEFLECTION, MAX_UNRESOLVED_MISFIT

MAX_MISFIT_RATIO = 0.5  # predicted misfit of a step over the last; above, truncation limits the misfit
MAX_MISFIT_RATIO_OF_OLD_SLOPES = 0.1  # misfit after a step over the one before: else slopes are renewed
MAX_MISFIT_OF_SLOPES = 1e-2  # of the state of slopes: above, they tell nothing of truncation
MAX_LINEAR_MISFIT_RATIO = 2.0  # misfit after a step over the predicted one, of slopes that are good enough
SETTLED_MISFIT = 2e-14  # rounding
ENOUGH_MISFIT = 1e-12  # below, neither further coefficients nor fresh slopes are worth their time
MIN_LAST_GAIN = 10.0  # factor by which the misfit falls, or it is left where it is nearly enough
FIRST_COEFFICIENTS = 48
COEFFICIENTS_PER_DEGREE = 1.25  # of an optimal law, at first
MIN_COEFFICIENT_GROWTH, MAX_COEFFICIENT_GROWTH = 1.25, 2.0  # factors of the number, where it grows
MAX_UNKNOWNS = 4000
MAX_COEFFICIENTS = 400
MAX_NEEDED_RATIO = 1.5  # coefficients needed for a settled misfit, extrapolated, over the largest number
MAX_STEPS = 12  # with the same coefficients
MIN_STEP_SHARE = 1 / 16  # of a step of Newton's method that is halved
MAX_STIFFENING = 32.0  # times the stiffness of the springs
SOFTENING, MIN_SOFTENING = 2.0, 1.1  # from one stiffness to the next


class GaussNewtonResult(NamedTuple):
    """The last iterate of Gauss-Newton at one truncation of the deflections."""

    state: BalanceState
    is_solved: bool  # whether the misfit is as small as this truncation allows
    slopes: LoadSlopes | None  # of a state near the iterate


class BalanceSolution(NamedTuple):
    """Deflections in balance, and the scalars of their law."""

    deflections: KnownDeflections
    scalars: Array  # (k,)
    equations: BalanceEquations
    state: BalanceState


def solve_balance(
    branch: Branch,
    family: Family,
    steps: Array,
    first: int,
    start: KnownDeflections | None = None,
    *,
    most: int = MAX_COEFFICIENTS,
) -> BalanceSolution:
    """Solve F(l, c) = 0 for deflections l and law scalars c by Gauss-Newton.

    Args:
        family: the law by its scalars, zero at first.
        steps: of the scalars, for differences (k,).
        first, most: number of coefficients of the deflections, at first and at most.
        start: deflections to begin with.

    Raises:
        NotConverged: no step brings them into balance, or the robot has redundant motors.
        NotAssembled: the first deflections tear the loops.
    """
    robot, scalars = branch.robot, np.zeros(len(steps))
    if robot.n_a > robot.n:
        raise NotConverged(
            f"{robot.name}: deflections under redundant motors are not unique where the passes do not settle",
            residual=np.inf,
        )
    series = np.zeros((len(family(scalars).edges) - 1, first, robot.n_e))
    if start is not None:
        series = resize_series(start.series / spring_units(robot), first)
    equations = BalanceEquations(branch, family, steps)
    state = _refine_series(equations, _solve_by_softening(equations, series, scalars), most)
    deflections = KnownDeflections(state.samples.clock, state.series * equations.units)
    return BalanceSolution(deflections, state.scalars, equations, state)


def deflections_of(branch: Branch, law: MotionLaw) -> KnownDeflections:
    """Find the deflections in balance under a given law.

    Raises:
        As `solve_balance`.
    """
    clock: Clock = InTime(law, panel_edges(branch, law))
    first = FIRST_COEFFICIENTS
    if isinstance(law, OptimalLaw):
        clock, first = OnParameter(law, branch.knots), first_coefficient_count(law.degree)
    return solve_balance(branch, lambda _: clock, np.zeros(0), first).deflections


def first_coefficient_count(degree: int) -> int:
    """Return the first number of coefficients of deflections under an optimal law of this degree."""
    return int(COEFFICIENTS_PER_DEGREE * degree) + 10


def _solve_by_softening(equations: BalanceEquations, series: Array, scalars: Array) -> GaussNewtonResult:
    """Solve at this truncation, if need be by stepwise softer springs.

    Springs are MAX_STIFFENING times as stiff at first. A step divides their stiffness by `softening`, and by
    its root where that is too much.

    Raises:
        SpringsTooSoft: springs MAX_STIFFENING times as stiff are still far too soft.
        NotConverged: softening stalls, or the stiffest springs do not converge.
    """
    result = _gauss_newton(equations, equations.evaluate(series, scalars))
    if result.is_solved:
        return result
    stiffest = equations.evaluate(0.0 * series, scalars, stiffer=MAX_STIFFENING)
    if np.abs(stiffest.balance.F).max() > MAX_STIFFENING * equations.stiffness * MAX_DEFLECTION:
        raise SpringsTooSoft(
            f"{equations.branch.robot.name}: the springs are too soft for so quick a motion: the forces of "
            f"the undeformed robot would deflect springs {MAX_STIFFENING:g} times as stiff by more than "
            f"{MAX_DEFLECTION:g} rad or {MAX_DEFLECTION:g} robot length",
            residual=stiffest.misfit,
        )
    solved = _gauss_newton(equations, stiffest)  # of springs `stiffer` times as stiff
    converges, stiffer, softening = solved.is_solved, MAX_STIFFENING, SOFTENING
    while converges and softening > MIN_SOFTENING:
        softer, state = max(stiffer / softening, 1.0), solved.state
        start = equations.evaluate(state.series * (stiffer / softer), state.scalars, stiffer=softer)
        result = _gauss_newton(equations, start)
        if result.is_solved and softer == 1.0:
            return result
        if result.is_solved:
            solved, stiffer = result, softer
        else:
            softening = np.sqrt(softening)
    springs = f"springs {stiffer:.2g} times as stiff {'do' if converges else 'do not either'}"
    raise NotConverged(
        f"{equations.branch.robot.name}: no deflections found that hold the forces they cause, under the law "
        f"tried or one near it; {springs}",
        residual=result.state.misfit,
    )


def _gauss_newton(
    equations: BalanceEquations, state: BalanceState, coarser: GaussNewtonResult | None = None
) -> GaussNewtonResult:
    """Iterate until the misfit is rounding, or as small as the truncation of the series allows.

    Slopes and their factorisation are used again as long as the misfit falls quickly. The first are those of
    the `coarser` result, of fewer coefficients.
    """
    slopes, linear = None if coarser is None else coarser.slopes, None
    for _ in range(MAX_STEPS):
        check_time()
        if state.misfit <= SETTLED_MISFIT and slopes is not None:
            return GaussNewtonResult(state, True, slopes)
        are_fresh = slopes is None
        slopes = equations.slopes(state) if slopes is None else slopes
        linear = equations.linearise(state, slopes) if linear is None else linear
        step = linear.step(state)
        is_enough = state.misfit <= ENOUGH_MISFIT  # fresh slopes would not be worth their cost
        stalls = step.predicted_misfit > MAX_MISFIT_RATIO * state.misfit
        if stalls and state.misfit <= MAX_UNRESOLVED_MISFIT:
            if coarser is None or is_enough or slopes.misfit <= MAX_MISFIT_OF_SLOPES:
                return GaussNewtonResult(state, True, slopes)
            slopes, linear = equations.slopes(coarser.state), None  # those used were of a state too far away
            continue
        new = _take_damped_step(equations, state, step)
        if new is None and (are_fresh or is_enough):
            return GaussNewtonResult(state, is_enough, slopes)
        good_misfit = max(
            MAX_MISFIT_RATIO_OF_OLD_SLOPES * state.misfit,
            MAX_LINEAR_MISFIT_RATIO * step.predicted_misfit,
            ENOUGH_MISFIT,
        )
        if new is None or new.misfit > good_misfit:
            slopes = linear = None
        state = new or state
    return GaussNewtonResult(state, False, slopes)


def _refine_series(equations: BalanceEquations, result: GaussNewtonResult, most: int) -> BalanceState:
    """Add coefficients until the misfit is enough, or falls too slowly to be so by the most."""
    state = result.state
    largest = min(most, MAX_UNKNOWNS // (equations.branch.robot.n_e * len(state.series)))
    count = state.series.shape[1]
    while result.is_solved and state.misfit > ENOUGH_MISFIT and count < largest:
        last_misfit, last_count = state.misfit, count
        # a misfit that falls geometrically, e^(-r count), is settled at count log(settled) / log(misfit)
        growth = np.log(SETTLED_MISFIT) / np.log(last_misfit)
        growth = np.clip(growth, MIN_COEFFICIENT_GROWTH, MAX_COEFFICIENT_GROWTH)
        count = min(int(growth * count) + 1, largest)
        start = equations.evaluate(resize_series(state.series, count), state.scalars)
        result = _gauss_newton(equations, start, result)
        state = result.state
        gain = np.log(last_misfit / state.misfit)
        is_nearly_enough = state.misfit <= MIN_LAST_GAIN * ENOUGH_MISFIT
        if gain < np.log(MIN_LAST_GAIN if is_nearly_enough else 1.0 / MAX_MISFIT_RATIO):
            break
        needed = count + (count - last_count) * np.log(state.misfit / ENOUGH_MISFIT) / gain
        if needed > MAX_NEEDED_RATIO * largest:
            break
    return state


def _take_damped_step(equations: BalanceEquations, state: BalanceState, step: Step) -> BalanceState | None:
    """Halve a step until the misfit falls; return the state after the step, or None.

    A misfit that is hardly more than rounding is not worth half a step.
    """
    share = 1.0
    least_share = 1.0 if state.misfit <= ENOUGH_MISFIT else MIN_STEP_SHARE
    while share >= least_share:
        try:
            new = equations.evaluate(
                state.series + share * step.series,
                state.scalars + share * step.scalars,
                stiffer=state.balance.stiffer,
                near=state.balance.motion.q,
            )
            if new.misfit < (1.0 - 0.1 * share) * state.misfit:
                return new
        except (NoAnswer, InvalidInput):  # loops are torn, or the law stands still
            pass
        share *= 0.5
    return None
