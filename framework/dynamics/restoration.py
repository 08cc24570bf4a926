"""Deflections in balance with the forces that they cause, and scalars of the law that make them smooth.

Near a singular point of the loaded robot, deflections in balance behave like l^2 + (s - s_0) l = eps. Only
eps = 0 has a smooth solution through the point. The law therefore has one free scalar for each crossing.
Gauss-Newton on `balance_equations` finds deflections and scalars together. Nothing is divided by the
singularity measure, and no second derivative is fed back from one pass to the next.

If the cells of the splines limit the misfit, those with the largest misfits are halved. If that does not
suffice, the problem is first solved for stiffer springs, which are then softened stepwise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.dynamics.balance_equations import BalanceEquations, BalanceState, Family, Step
from framework.dynamics.deflection_splines import DeflectionSplines, KnownDeflections
from framework.dynamics.singularity_crossings import panel_edges
from framework.errors import InvalidInput, NoAnswer, NotAssembled, NotConverged, SpringsTooSoft
from framework.kinematics.continuation.tracking import Branch
from framework.laws.law import MotionLaw
from framework.laws.optimal_law import Clock, InTime, OnParameter, OptimalLaw
from framework.numerics.arrays import Array
from framework.numerics.time_limit import check_time
from framework.tolerances import MAX_DEFLECTION, MAX_UNRESOLVED_MISFIT

MAX_MISFIT_RATIO = 0.5  # predicted misfit after a step over that before; above, the cells limit the misfit
MAX_MISFIT_RATIO_OF_OLD_SLOPES = 0.1  # misfit after a step over that before; above, slopes are renewed
MAX_LINEAR_MISFIT_RATIO = 2.0  # misfit after a step over the predicted one; above, slopes are renewed
ROUNDING_MISFIT = 1e-12  # below, a misfit that no step lowers is due to rounding on its cells
MISFIT_OF_CELLS = 0.1  # above, a misfit that stalls is not due to the cells
MIN_GAIN = 4.0  # factor by which the misfit must fall for further cells
LEAST_MISFIT = 4e-13  # |F| over the largest load of settled deflections; steps aim at a quarter of it
FIRST_CELLS = 48  # of the splines of the deflections, on all panels together
MAX_CELLS = 600
MAX_STEPS = 12  # on the same cells
MIN_STEP_SHARE = 1 / 4  # of a Gauss-Newton step in the line search
MAX_STIFFENING = 32.0  # times the stiffness of the springs
SOFTENING, MIN_SOFTENING = 4.0, 1.3  # from one stiffness to the next


class BalanceSolution(NamedTuple):
    """Deflections in balance and the scalars of their law: the last state of the equations."""

    equations: BalanceEquations
    state: BalanceState

    @property
    def law(self) -> OptimalLaw:
        """The law of the last scalars, which is an optimal one."""
        law = self.state.clock.law
        assert isinstance(law, OptimalLaw)
        return law

    @property
    def deflections(self) -> KnownDeflections:
        """The deflections [rad, m] of the last state."""
        state = self.state
        return KnownDeflections(state.clock, state.splines, state.series * self.equations.units)


def solve_balance(
    branch: Branch,
    family: Family,
    steps: Array,
    start: KnownDeflections | None = None,
    *,
    misfit: float = LEAST_MISFIT,
) -> BalanceSolution:
    """Solve F(l, c) = 0 for deflections l and law scalars c by Gauss-Newton.

    From deflections of zero, springs that cannot be solved for directly are softened stepwise.

    Args:
        family: function that returns the law, as a `Clock`, of scalars c (k,); the search begins at c = 0.
        steps: (k,) half-widths of the central differences in the scalars.
        start: deflections from which the search begins, on the cells that they need.
        misfit: |F| over the largest load at which deflections are accepted.

    Raises:
        NotConverged: no deflections in balance were found. If more cells do not help, the returned
            deflections may still be unsettled; the certificate of their motion shows it.
        NotAssembled: the first deflections tear the loops.
    """
    robot = branch.robot
    equations = BalanceEquations(branch, family, steps)
    scalars = np.zeros(len(steps))
    if start is None:
        clock = family(scalars)
        # the highest derivative that does not jump at the knots of a path: springs without inertia jump with
        # the forces; with inertia deflections are continuous, under laws that have rest at both ends also two
        # derivatives. Else continuous accelerations would make springs vibrate where the path jumps
        continuity = -1
        if robot.elastic_inertia:
            continuity = 2 if isinstance(clock, OnParameter) else 0
        splines = DeflectionSplines.uniform(clock.edges, FIRST_CELLS, continuity=continuity)
        series = np.zeros((splines.size, robot.n_e))
    else:
        splines, series = start.splines, start.series / equations.units
    first = equations.evaluate(splines, series, scalars)
    solution = _solve(equations, first, misfit)
    if solution.state.misfit > MAX_UNRESOLVED_MISFIT and start is None:
        softened = _soften(equations, first, solution.state.misfit)
        solution = _solve(equations, softened, misfit)
    return solution


def deflections_of(branch: Branch, law: MotionLaw) -> KnownDeflections:
    """Find the deflections in balance under a given law.

    Raises:
        NotConverged, NotAssembled: as `solve_balance`.
    """
    clock: Clock = InTime(law, panel_edges(branch, law))
    if isinstance(law, OptimalLaw):
        clock = OnParameter(law, branch.knots)
    return solve_balance(branch, lambda _: clock, np.zeros(0)).deflections


def _solve(equations: BalanceEquations, first: BalanceState, misfit: float) -> BalanceSolution:
    """Solve from a state, at first on its cells, until a misfit is reached or cells do not help."""
    state, is_solved = _gauss_newton(equations, first, misfit / MIN_GAIN)
    solution = BalanceSolution(equations, state)
    return refine_balance(solution, misfit) if is_solved else solution


def refine_balance(solution: BalanceSolution, misfit: float = LEAST_MISFIT) -> BalanceSolution:
    """Halve cells and solve again, until a misfit is reached or further cells do not help.

    The cells of the largest misfits are halved. Where deflections are smooth, this divides the misfit of a
    cell by thousands. A misfit that falls by less than MIN_GAIN is not due to the cells.

    Args:
        solution: deflections nearly in balance on their cells, of which the first are halved at once.
        misfit: |F| over the largest load at which the solution is accepted.
    """
    settled = misfit / MIN_GAIN
    equations, state = solution
    is_solved = True
    while is_solved and state.misfit > misfit:
        # the cells above the geometric mean of the largest misfit and a settled one
        splines = state.splines.halve(state.cell_misfits > np.sqrt(state.misfit * settled))
        if len(splines.cells) > MAX_CELLS:
            break
        series = splines.insert(state.splines, state.series)
        start = equations.evaluate(splines, series, state.scalars, stiffer=state.balance.stiffer)
        coarse_misfit = state.misfit
        state, is_solved = _gauss_newton(equations, start, settled)
        is_solved = is_solved and MIN_GAIN * state.misfit < coarse_misfit
    return BalanceSolution(equations, state)


def _soften(equations: BalanceEquations, start: BalanceState, misfit: float) -> BalanceState:
    """Solve by continuation in the stiffness of the springs, down to the robot's own.

    The continuation begins with springs MAX_STIFFENING times as stiff. Each step divides this factor by
    `softening`, which is replaced by its square root if the step fails.

    Args:
        start: a state with the splines and scalars to begin with; the deflections begin from zero.
        misfit: |F| over the largest load that is left without continuation.

    Raises:
        SpringsTooSoft: springs MAX_STIFFENING times as stiff are still far too soft.
        NotConverged: the continuation stalls, or fails already for the stiffest springs.
    """
    stiffest = equations.evaluate(start.splines, 0.0 * start.series, start.scalars, stiffer=MAX_STIFFENING)
    # at zero deflections F is the spring forces that balance the load; F / stiffness estimates deflections
    if np.abs(stiffest.balance.F).max() > MAX_STIFFENING * equations.stiffness * MAX_DEFLECTION:
        raise SpringsTooSoft(
            f"the springs are too soft for so quick a motion: the forces of "
            f"the undeformed robot would deflect springs {MAX_STIFFENING:g} times as stiff by more than "
            f"{MAX_DEFLECTION:g} rad or {MAX_DEFLECTION:g} robot length",
            name=equations.branch.robot.name,
            residual=stiffest.misfit,
        )
    solved = _solve(equations, stiffest, MAX_UNRESOLVED_MISFIT).state  # of the softest springs so far
    if solved.misfit > MAX_UNRESOLVED_MISFIT:
        raise _no_balance(equations, f"springs {MAX_STIFFENING:g} times as stiff do not either", np.inf)
    stiffer, softening = MAX_STIFFENING, SOFTENING
    while stiffer > 1.0 and softening > MIN_SOFTENING:
        softening = min(softening, stiffer)  # the last step ends at the robot's own springs
        softer = stiffer / softening
        try:  # deflections are nearly proportional to compliance
            first = equations.evaluate(
                solved.splines, softening * solved.series, solved.scalars, stiffer=softer
            )
            following = _solve(equations, first, MAX_UNRESOLVED_MISFIT).state
            is_solved = following.misfit <= MAX_UNRESOLVED_MISFIT
        except NotAssembled:  # the deflections tear the loops
            is_solved = False
        if is_solved:
            solved, stiffer = following, softer
        else:
            softening = np.sqrt(softening)
    if stiffer > 1.0:
        raise _no_balance(equations, f"springs {stiffer:.2g} times as stiff do", misfit)
    return solved


def _no_balance(equations: BalanceEquations, stiffer_springs: str, residual: float) -> NotConverged:
    """Return the error that no deflections in balance are found.

    Args:
        stiffer_springs: clause on the outcome with stiffer springs, such as "springs 32 times as stiff do".
        residual: |F| over the largest load, of the robot's own springs.
    """
    return NotConverged(
        "no deflections found that hold the forces they cause, under the law tried or one near it",
        clauses=(stiffer_springs,),
        name=equations.branch.robot.name,
        residual=residual,
    )


def _gauss_newton(
    equations: BalanceEquations, state: BalanceState, settled: float
) -> tuple[BalanceState, bool]:
    """Iterate until the misfit is rounding, or as small as the cells allow.

    The misfit is |F| over the largest load. Slopes of F and their factorisation, `linear`, are reused as long
    as the misfit falls quickly. They are renewed if a step with old slopes fails or gains too little.

    Args:
        equations: the equations F = 0.
        state: the first iterate, with the splines of the solution.
        settled: misfit at which the iteration ends, after a step at least: it lets springs rest at the ends.

    Returns:
        The last iterate; whether its misfit is as small as the cells allow.
    """
    linear = None
    for step_count in range(MAX_STEPS):
        check_time()
        if step_count > 0 and state.misfit <= settled:
            return state, True
        are_fresh = linear is None  # whether the slopes are those at this iterate
        linear = linear or equations.linearise(state, settled)
        step = linear.step(state)
        # the cells limit the misfit if not even the linear equations can reduce it much
        stalls = step.predicted_misfit > MAX_MISFIT_RATIO * state.misfit
        if stalls and state.misfit <= MISFIT_OF_CELLS:
            return state, True
        new = _take_damped_step(equations, state, step)
        if new is None and are_fresh:  # new slopes cannot help; a small misfit is rounding
            return state, state.misfit <= ROUNDING_MISFIT
        good_misfit = max(
            MAX_MISFIT_RATIO_OF_OLD_SLOPES * state.misfit,
            MAX_LINEAR_MISFIT_RATIO * step.predicted_misfit,
            settled,
        )
        if new is None or new.misfit > good_misfit:
            linear = None
        state = new or state
    return state, False


def _take_damped_step(equations: BalanceEquations, state: BalanceState, step: Step) -> BalanceState | None:
    """Halve a step until the misfit falls; return the state after the step, or None.

    Args:
        state: the last iterate.
        step: the Gauss-Newton step at this state.
    """
    share = 1.0
    while share >= MIN_STEP_SHARE:
        try:
            new = equations.evaluate(
                state.splines,
                state.series + share * step.series,
                state.scalars + share * step.scalars,
                stiffer=state.balance.stiffer,
                near=state.balance.motion.q,
            )
            # a tenth of the decrease that the linear equations promise (Armijo's condition)
            if new.misfit < (1.0 - 0.1 * share) * state.misfit:
                return new
        except (NoAnswer, InvalidInput):  # loops are torn, or the law stands still
            pass
        share *= 0.5
    return None
