"""Deflections that hold the forces they cause, with the least change of the law that lets them be smooth.

Near the singular point of the loaded robot, deflections in balance look like l^2 + (s - s_0) l = eps; only
eps = 0 lets a smooth l through: for that the law has one scalar a crossing. Both are found together by the
method of Gauss and Newton on `balance_equations`. Nothing is divided by the measure of the singularity, and
no second derivative is fed back from pass to pass. What a step cannot make better for want of coefficients
gets more of them; where no step helps, springs are stiffer first and then softened.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.dynamics.balance_equations import BalanceEquations, BalanceState, Family, Slopes, Step, longer
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

MAX_MISFIT_RATIO = 0.5  # of the misfits after and before a step that is taken; above, more coefficients are
MAX_MISFIT_RATIO_OF_OLD_SLOPES = 0.1  # the same, for slopes that are used once more
MAX_MISFIT_OF_SLOPES = 1e-2  # of their state: above, what a step with them leaves is no want of coefficients
MAX_LINEAR_MISFIT_RATIO = 2.0  # of what a step leaves to what it was to leave: slopes are good enough
SETTLED_MISFIT = 2e-14  # that is rounding
ENOUGH_MISFIT, MIN_LAST_GAIN = 1e-12, 10.0  # below, more coefficients have to make it that many times less
FIRST_COEFFICIENTS = 48
COEFFICIENTS_PER_DEGREE = 1.25  # of an optimal law, at first
MIN_COEFFICIENT_GROWTH, MAX_COEFFICIENT_GROWTH = 1.25, 2.0  # where some are added
MAX_UNKNOWNS = 4000
MAX_COEFFICIENTS = 400
MAX_NEEDED_RATIO = 1.5  # of coefficients that would settle if the misfit went on falling, over the most
MAX_STEPS = 12  # with the same coefficients
MIN_STEP_SHARE = 1 / 16  # of a step of Newton's method that is halved
MAX_STIFFENING = 32.0  # times the stiffness of the springs
SOFTENING, MIN_SOFTENING = 2.0, 1.1  # from one stiffness to the next


class Settled(NamedTuple):
    """A state that steps do not make better."""

    state: BalanceState
    held: bool  # only more coefficients can
    slopes: Slopes | None  # of a state near it


class Restored(NamedTuple):
    """Deflections, and the scalars of the law that they belong to."""

    deflections: KnownDeflections
    scalars: Array  # (k,)


def restored(
    branch: Branch, family: Family, steps: Array, first: int, start: KnownDeflections | None = None
) -> Restored:
    """Find deflections and scalars of the law in balance.

    Args:
        family: the law by its scalars, zero at first.
        steps: by how much to change these for a difference (k,).
        first: coefficients of the deflections at first.
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
        series = longer(start.series / spring_units(robot), first)
    state = _resolved(equations := BalanceEquations(branch, family, steps), _held(equations, series, scalars))
    deflections = KnownDeflections(state.points.clock, state.series * equations.units)
    return Restored(deflections, state.scalars)


def deflections_of(branch: Branch, law: MotionLaw) -> KnownDeflections:
    """Find the deflections that a law makes as it is.

    Raises:
        As `restored`.
    """
    clock: Clock = InTime(law, panel_edges(branch, law))
    first = FIRST_COEFFICIENTS
    if isinstance(law, OptimalLaw):
        clock, first = OnParameter(law, branch.knots), coefficients_for(law.degree)
    return restored(branch, lambda _: clock, np.zeros(0), first).deflections


def coefficients_for(degree: int) -> int:
    """How many coefficients the deflections of an optimal law of this degree have at first."""
    return int(COEFFICIENTS_PER_DEGREE * degree) + 10


def _held(equations: BalanceEquations, series: Array, scalars: Array) -> Settled:
    """A state that only more coefficients can make better; by way of stiffer springs if need be.

    Raises:
        SpringsTooSoft: springs MAX_STIFFENING times as stiff are still far too soft.
        NotConverged: none is found.
    """
    settled = _settled(equations, equations.at(series, scalars))
    if settled.held:
        return settled
    stiffest = equations.at(0.0 * series, scalars, stiffer=MAX_STIFFENING)
    if np.abs(stiffest.balance.F).max() > MAX_STIFFENING * equations.stiffness * MAX_DEFLECTION:
        raise SpringsTooSoft(
            f"{equations.branch.robot.name}: the springs are too soft for so quick a motion: the forces of "
            f"the undeformed robot would deflect springs {MAX_STIFFENING:g} times as stiff by more than "
            f"{MAX_DEFLECTION:g} rad or {MAX_DEFLECTION:g} robot length",
            residual=stiffest.misfit,
        )
    known = _settled(equations, stiffest)
    held, stiffer, softening = known.held, MAX_STIFFENING, SOFTENING
    while held and softening > MIN_SOFTENING:
        softer, state = max(stiffer / softening, 1.0), known.state
        start = equations.at(state.series * (stiffer / softer), state.scalars, stiffer=softer)
        settled = _settled(equations, start)
        if settled.held and softer == 1.0:
            return settled
        if settled.held:
            known, stiffer = settled, softer
        else:
            softening = np.sqrt(softening)
    springs = f"springs {stiffer:.2g} times as stiff {'do' if held else 'do not either'}"
    raise NotConverged(
        f"{equations.branch.robot.name}: no deflections found that hold the forces they cause, under the law "
        f"tried or one near it; {springs}",
        residual=settled.state.misfit,
    )


def _settled(equations: BalanceEquations, state: BalanceState, before: Settled | None = None) -> Settled:
    """The state after all steps that help, and whether only more coefficients can help it.

    Slopes of a state near by, and what is factored of them, are taken as long as steps with them help much:
    at first those of a state `before` with fewer coefficients.
    """
    slopes, linear = None if before is None else before.slopes, None
    for _ in range(MAX_STEPS):
        check_time()
        if state.misfit <= SETTLED_MISFIT and slopes is not None:
            return Settled(state, True, slopes)
        fresh = slopes is None
        slopes = equations.slopes(state) if slopes is None else slopes
        linear = equations.linearised(state, slopes) if linear is None else linear
        step = linear.step(state)
        enough = state.misfit <= ENOUGH_MISFIT  # for better slopes not to be worth it
        if step.left > MAX_MISFIT_RATIO * state.misfit and state.misfit <= MAX_UNRESOLVED_MISFIT:
            if before is None or enough or slopes.misfit <= MAX_MISFIT_OF_SLOPES:
                return Settled(state, True, slopes)
            slopes, linear = equations.slopes(before.state), None
            continue
        new = _moved(equations, state, step)
        if new is None and (fresh or enough):
            return Settled(state, enough, slopes)
        if new is None or new.misfit > max(
            MAX_MISFIT_RATIO_OF_OLD_SLOPES * state.misfit, MAX_LINEAR_MISFIT_RATIO * step.left, ENOUGH_MISFIT
        ):
            slopes = linear = None
        state = new or state
    return Settled(state, False, slopes)


def _resolved(equations: BalanceEquations, settled: Settled) -> BalanceState:
    """The state with more coefficients, until its balance is settled or more are not going to settle it."""
    state = settled.state
    most = min(MAX_COEFFICIENTS, MAX_UNKNOWNS // (equations.branch.robot.n_e * len(state.series)))
    count = state.series.shape[1]
    while settled.held and state.misfit > SETTLED_MISFIT and count < most:
        before, few = state.misfit, count
        more = np.clip(
            np.log(SETTLED_MISFIT) / np.log(before), MIN_COEFFICIENT_GROWTH, MAX_COEFFICIENT_GROWTH
        )
        count = min(int(more * count) + 1, most)
        start = equations.at(longer(state.series, count), state.scalars)
        settled = _settled(equations, start, settled)
        state = settled.state
        gain = np.log(before / state.misfit)
        least = MIN_LAST_GAIN if state.misfit <= ENOUGH_MISFIT else 1.0 / MAX_MISFIT_RATIO
        if gain < np.log(least):
            break
        if count + (count - few) * np.log(state.misfit / SETTLED_MISFIT) / gain > MAX_NEEDED_RATIO * most:
            break
    return state


def _moved(equations: BalanceEquations, state: BalanceState, step: Step) -> BalanceState | None:
    """The state after a step, halved until it helps; None if it does not."""
    share = 1.0
    while share >= MIN_STEP_SHARE:
        try:
            new = equations.at(
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
