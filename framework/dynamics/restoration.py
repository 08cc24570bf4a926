"""Deflections in balance with the forces that they cause, and scalars of the law that make them smooth.

Near a singular point of the loaded robot, deflections in balance behave like l^2 + (s - s_0) l = eps. Only
eps = 0 has a smooth solution through the point. The law therefore has one free scalar for each crossing.
Gauss-Newton on `balance_equations` finds deflections and scalars together. Nothing is divided by the
singularity measure, and no second derivative is fed back from one pass to the next.

If the truncation of the series limits the misfit, coefficients are added. If no step lowers the misfit, the
problem is first solved for stiffer springs, which are then softened stepwise.
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
from framework.dynamics.singularity_crossings import panel_edges
from framework.errors import InvalidInput, NoAnswer, NotConverged, SpringsTooSoft
from framework.kinematics.continuation.tracking import Branch
from framework.laws.law import MotionLaw
from framework.laws.optimal_law import Clock, InTime, OnParameter, OptimalLaw
from framework.numerics.arrays import Array
from framework.numerics.time_limit import check_time
from framework.tolerances import MAX_DEFLECTION, MAX_UNRESOLVED_MISFIT

MAX_MISFIT_RATIO = 0.5  # predicted misfit after a step over that before; above, truncation limits the misfit
MAX_MISFIT_RATIO_OF_OLD_SLOPES = 0.1  # misfit after a step over that before; above, slopes are renewed
MAX_MISFIT_OF_SLOPES = 1e-2  # of the state at which slopes are computed; above, they do not reveal truncation
MAX_LINEAR_MISFIT_RATIO = 2.0  # misfit after a step over the predicted one; above, slopes are renewed
SETTLED_MISFIT = 2e-14  # rounding
ENOUGH_MISFIT = 1e-12  # fresh slopes would not be worth their time below
MIN_LAST_GAIN = 10.0  # factor by which a small enough misfit must fall for further coefficients
FIRST_COEFFICIENTS = 48
COEFFICIENTS_PER_DEGREE = 1.25  # of an optimal law, at first
MIN_COEFFICIENT_GROWTH, MAX_COEFFICIENT_GROWTH = 1.25, 2.0  # factors of the number, where it grows
MAX_UNKNOWNS = 4000
MAX_COEFFICIENTS = 400
MAX_NEEDED_RATIO = 1.5  # extrapolated number of coefficients for a settled misfit, over the largest number
MAX_STEPS = 12  # with the same number of coefficients
MIN_STEP_SHARE = 1 / 16  # of a Gauss-Newton step in the line search
MAX_STIFFENING = 32.0  # times the stiffness of the springs
SOFTENING, MIN_SOFTENING = 2.0, 1.1  # from one stiffness to the next


class GaussNewtonResult(NamedTuple):
    """The last iterate of Gauss-Newton at one truncation of the deflections."""

    state: BalanceState
    is_solved: bool  # whether the misfit is as small as this truncation allows
    slopes: LoadSlopes | None  # at a state near the last iterate


class BalanceSolution(NamedTuple):
    """Deflections in balance, the scalars of their law, and the equations with their last state."""

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
        family: laws by their scalars; the search begins at zero scalars.
        steps: (k,) of differences in the scalars.
        first, most: number of coefficients of the deflections, at first and at most.
        start: deflections from which the search begins.

    Raises:
        NotConverged: no deflections in balance were found, or the robot has redundant motors.
        NotAssembled: the first deflections tear the loops.
    """
    robot = branch.robot
    if robot.n_a > robot.n:
        raise NotConverged(
            f"{robot.name}: deflections under redundant motors are not unique where the passes do not settle",
            residual=np.inf,
        )
    equations = BalanceEquations(branch, family, steps)
    scalars = np.zeros(len(steps))
    if start is None:
        series = np.zeros((len(family(scalars).edges) - 1, first, robot.n_e))
    else:
        series = resize_series(start.series / equations.units, first)
    result = _solve_by_softening(equations, series, scalars)
    state = _refine_series(equations, result, most)
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
    """Return the initial number of coefficients of deflections, under an optimal law of a degree."""
    return int(COEFFICIENTS_PER_DEGREE * degree) + 10


def _solve_by_softening(equations: BalanceEquations, series: Array, scalars: Array) -> GaussNewtonResult:
    """Solve at this truncation, if necessary by continuation in the stiffness of the springs.

    The continuation begins with springs MAX_STIFFENING times as stiff. Each step divides this factor by
    `softening`, which is replaced by its square root if the step fails.

    Raises:
        SpringsTooSoft: springs MAX_STIFFENING times as stiff are still far too soft.
        NotConverged: the continuation stalls, or fails already for the stiffest springs.
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
    solved = _gauss_newton(equations, stiffest)
    softening = SOFTENING
    while solved.is_solved and softening > MIN_SOFTENING:
        state = solved.state
        stiffer = state.balance.stiffer
        softer = max(stiffer / softening, 1.0)
        start = equations.evaluate(state.series * (stiffer / softer), state.scalars, stiffer=softer)
        result = _gauss_newton(equations, start)
        if result.is_solved and softer == 1.0:
            return result
        if result.is_solved:
            solved = result
        else:
            softening = np.sqrt(softening)
    verb = "do" if solved.is_solved else "do not either"
    raise NotConverged(
        f"{equations.branch.robot.name}: no deflections found that hold the forces they cause, under the law "
        f"tried or one near it; springs {solved.state.balance.stiffer:.2g} times as stiff {verb}",
        residual=result.state.misfit,
    )


def _gauss_newton(
    equations: BalanceEquations, state: BalanceState, coarser: GaussNewtonResult | None = None
) -> GaussNewtonResult:
    """Iterate until the misfit is rounding, or as small as the truncation of the series allows.

    Slopes and their factorisation are reused as long as the misfit falls quickly. The first slopes are those
    of the `coarser` result, with fewer coefficients.
    """
    slopes = None if coarser is None else coarser.slopes
    linear = None
    for _ in range(MAX_STEPS):
        check_time()
        if state.misfit <= SETTLED_MISFIT and slopes is not None:
            return GaussNewtonResult(state, True, slopes)
        are_fresh = slopes is None
        slopes = slopes or equations.slopes(state)
        linear = linear or equations.linearise(state, slopes)
        step = linear.step(state)
        is_enough = state.misfit <= ENOUGH_MISFIT  # fresh slopes would not be worth their cost
        stalls = step.predicted_misfit > MAX_MISFIT_RATIO * state.misfit
        if stalls and state.misfit <= MAX_UNRESOLVED_MISFIT:
            if coarser is None or is_enough or slopes.misfit <= MAX_MISFIT_OF_SLOPES:
                return GaussNewtonResult(state, True, slopes)
            # the slopes were computed too far from this state to show whether truncation limits the misfit
            slopes = equations.slopes(coarser.state)
            linear = None
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
    """Add coefficients until the misfit is settled, or `most` would not suffice.

    A misfit that falls by less than MIN_LAST_GAIN counts as settled when it is small enough.
    """
    state = result.state
    largest = min(most, MAX_UNKNOWNS // (equations.branch.robot.n_e * len(state.series)))
    count = state.series.shape[1]
    while result.is_solved and state.misfit > MIN_LAST_GAIN * SETTLED_MISFIT and count < largest:
        last_misfit, last_count = state.misfit, count
        # a misfit that falls as e^(-r count) is settled at count log(settled) / log(misfit)
        growth = np.log(SETTLED_MISFIT) / np.log(last_misfit)
        growth = np.clip(growth, MIN_COEFFICIENT_GROWTH, MAX_COEFFICIENT_GROWTH)
        count = min(int(growth * count) + 1, largest)
        start = equations.evaluate(resize_series(state.series, count), state.scalars)
        result = _gauss_newton(equations, start, result)
        state = result.state
        gain = np.log(last_misfit / state.misfit)
        least_ratio = MIN_LAST_GAIN if state.misfit <= ENOUGH_MISFIT else 1.0 / MAX_MISFIT_RATIO
        if gain < np.log(least_ratio):
            break
        needed = count + (count - last_count) * np.log(state.misfit / SETTLED_MISFIT) / gain
        if needed > MAX_NEEDED_RATIO * largest:
            break
    return state


def _take_damped_step(equations: BalanceEquations, state: BalanceState, step: Step) -> BalanceState | None:
    """Halve a step until the misfit falls; return the state after the step, or None.

    For a misfit that is hardly more than rounding, only the full step is tried.
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
