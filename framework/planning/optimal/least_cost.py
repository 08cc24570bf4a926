"""The least cost of a problem, whatever the smoothness of the law: on refined cells, in units of the optimum.

A law is a squared speed z with coefficients y in xi(sigma), a parameter that is steep at the crossings; cells
are intervals of xi. Non-negative B-splines on cells of width h cannot come nearer to zero than h^2 z", nor
follow a kink. Cells are therefore cut in two where coefficients are nearly zero or bend sharply, until the
cost settles.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.numerics.arrays import Array, BoolArray
from framework.numerics.cone_program import TOLERANCE, Unsolved
from framework.numerics.sparse_rows import SparseRows
from framework.planning.optimal.law_problem import LawProblem
from framework.planning.optimal.path_series import cells_about
from framework.planning.optimal.speed_program import Bounds, Speed, SpeedProgram, Units
from framework.tolerances import LIMIT_MARGIN

FIRST_CELLS, MAX_CELLS = 60, 180  # of xi, for splines
CELLS_PER_DEGREE = 0.5  # of a series
# rounds of cutting cells; relative change of the cost below which the cost is settled
MAX_REFINEMENTS, MIN_REFINEMENT_CHANGE = 5, 2e-3
LOW_COEFFICIENT = 1e-5  # of the median; lower coefficients would keep falling on smaller cells
MAX_BEND = 0.1  # second difference of coefficients over the least of the three, above which cells are cut
# relative, of the least cost of a series: smoothness adds a hundred times as much. An energy has a hundred
# cones, each of which may miss its share: at 1e-5 it is up to 20 % above the least, at 1e-7 up to 0.4 %
SERIES_TOLERANCE, SERIES_ENERGY_TOLERANCE = 1e-5, 1e-7
# corrections of the units; ratio of the optimum to its unit, or inverse, above which the unit is corrected
MAX_UNIT_CHANGES, MAX_UNIT_RATIO = 8, 5.0


class LeastCost(NamedTuple):
    """The squared speed of least cost of a program, and the units of this optimum."""

    program: SpeedProgram
    speed: Speed
    units: Units


class NoneFound(NamedTuple):
    """A program for which no law was found, and the solver's status or another reason."""

    program: SpeedProgram
    status: str

    @property
    def infeasible(self) -> bool:
        """Whether the solver reports that the rows of the program contradict each other."""
        return self.status == "PrimalInfeasible"


def cost_of(goal: str, speed: Speed) -> float:
    """Return the cost of a speed by a goal.

    "time": the duration [s]; "peak_torque": the peak over the reference; "energy": the energy of torques over
    the reference [s]; "peak_speed": the peak of motor speeds over their limits; "limits": the larger of the
    peaks of torques and of squared speeds.
    """
    return {
        "time": speed.duration,
        "peak_torque": speed.peak,
        "energy": speed.energy,
        "peak_speed": speed.peak_speed,
        "limits": max(speed.peak, speed.peak_speed**2),
    }[goal]


def first_cells(problem: LawProblem) -> Array:
    """Return edges (k + 1,) of cells in xi, with each condition in the middle of a cell.

    Cells of splines are uniform. Cells of a series are uniform in the angle acos(xi), and so as dense as the
    zeros of a Chebyshev polynomial. The cell about a condition is as wide as its neighbours, or narrower near
    an end. Edges within this cell, or nearer to its edges than 0.35 widths, are left out.
    """
    if problem.degree is None:
        count = FIRST_CELLS
        edges = np.linspace(-1.0, 1.0, count + 1)
    else:
        count = int(CELLS_PER_DEGREE * problem.degree)
        edges = -np.cos(np.linspace(0.0, np.pi, count + 1))
    crossings = np.unique(problem.crossing_xi)
    for xi in crossings:
        # of the neighbouring cells; d xi = sin(angle) d angle for a series
        width = 2.0 / count if problem.degree is None else np.pi / count * np.sqrt(1.0 - xi**2)
        distances = np.abs(crossings - xi)
        # two crossings leave a third of their distance between their cells
        width = min(width, 2.0 / 3.0 * distances[distances > 0.0].min(initial=np.inf))
        half_width = min(0.5 * width, 0.7 * (1.0 - abs(xi)))  # ends in front of the end of the path
        # leave out edges that would make narrow cells
        is_end = np.abs(edges) == 1.0
        is_far = np.abs(edges - xi) > half_width + 0.35 * width
        edges = np.unique(np.concatenate([edges[is_far | is_end], [xi - half_width, xi + half_width]]))
    return edges


def find_least_cost(
    problem: LawProblem,
    cells: Array | None = None,
    *,
    torque_limits: bool = True,
    units: Units | None = None,
) -> LeastCost | NoneFound:
    """Find the least cost on cells that are cut where coefficients are nearly zero or bend sharply.

    The least peak is first sought without torque limits. A peak above the limits has two reasons. It may
    belong to a motor without a limit: then the program is solved with the limits. Otherwise no law keeps
    them.

    Args:
        cells: (k + 1,) edges in xi, at first; by default, `first_cells` chooses them.
        torque_limits: whether the torque limits of the specification hold.
        units: units of a similar program, from which the solution begins.
    """
    goal = problem.specification.goal
    cells = first_cells(problem) if cells is None else cells
    # the least peak is within the torque limits, or a program with them is solved
    if goal == "peak_torque" and problem.specification.limited and torque_limits:
        unlimited = find_least_cost(problem, cells, torque_limits=False, units=units)
        has_drives = problem.specification.drives is not None
        if isinstance(unlimited, NoneFound) or (unlimited.speed.peak <= 1.0 and not has_drives):
            return unlimited
        return solve_least_cost(SpeedProgram.on_cells(problem, unlimited.program.cells))

    # solve on cells that are cut until the cost settles
    best: LeastCost | None = None
    for _ in range(MAX_REFINEMENTS + 1):
        program = SpeedProgram.on_cells(problem, cells)
        solved = solve_least_cost(program, best.units if best else units, torque_limits=torque_limits)
        if isinstance(solved, NoneFound):
            return best or _solve_on_cells_of_least_peak(problem, cells, solved)
        # smaller cells may also raise the cost: the limits were exceeded between the points of larger ones
        is_settled = best is not None and (
            abs(1.0 - cost_of(goal, solved.speed) / cost_of(goal, best.speed)) < MIN_REFINEMENT_CHANGE
        )
        best = solved
        to_cut = _cells_to_cut(program, solved.speed.y)
        if is_settled or not to_cut.any() or len(cells) > MAX_CELLS:
            break
        low, high = cells[:-1][to_cut], cells[1:][to_cut]  # edges in xi of cells to cut in two, or in three
        in_three = cells_about(cells, problem.crossing_xi)[to_cut]  # about a crossing
        middle = 0.5 * (low + high)[~in_three]
        third = ((high - low) / 3.0)[in_three]
        cells = np.unique(np.concatenate([cells, middle, low[in_three] + third, high[in_three] - third]))
    return solved


def _solve_on_cells_of_least_peak(
    problem: LawProblem, cells: Array, none: NoneFound
) -> LeastCost | NoneFound:
    """Find the least cost on the cells of the least peak; return `none` if that does not help.

    There may be a law within the limits on refined cells although there is none on the first cells.

    Args:
        cells: (k + 1,) the first cells, in xi.
        none: the failed search on these cells.
    """
    if problem.specification.goal == "peak_torque":
        return none
    least_peak = find_least_cost(problem.with_goal("peak_torque"), cells, torque_limits=False)
    if isinstance(least_peak, NoneFound) or len(least_peak.program.cells) == len(cells):
        return none
    return solve_least_cost(SpeedProgram.on_cells(problem, least_peak.program.cells))


def solve_least_cost(
    program: SpeedProgram,
    units: Units | None = None,
    *,
    torque_limits: bool = True,
    limit_share: float = 1.0,
) -> LeastCost | NoneFound:
    """Solve a program for its goal within a share of the limits, in units corrected by the optimum.

    A solver ends early or stalls if the optimum is far from 1. Units are therefore replaced by those of the
    optimum until both agree within a factor of MAX_UNIT_RATIO. If the solver gives up, the units of a quicker
    law are tried.

    Args:
        units: the first units; by default an estimate.
        torque_limits: whether the torque limits of the specification hold.
        limit_share: share of the limits that may be used.
    """
    specification = program.problem.specification
    goal = specification.goal
    # callers compare the least duration
    longest = program.problem.bound_stages(None if goal == "time" else specification.longest)
    share = limit_share * (1.0 if goal == "peak_torque" else 1.0 - LIMIT_MARGIN)
    bounds = Bounds(longest, torque_limits=torque_limits, share=share)
    units = units or _first_units(program)
    series_tolerance = SERIES_ENERGY_TOLERANCE if goal == "energy" else SERIES_TOLERANCE
    tolerance = TOLERANCE if program.basis.is_spline else series_tolerance
    for _ in range(MAX_UNIT_CHANGES):
        speed = program.minimise(goal, bounds, units, tolerance=tolerance)
        if isinstance(speed, Unsolved):
            if speed.infeasible:
                return NoneFound(program, speed.status)
            if tolerance < SERIES_TOLERANCE and not program.basis.is_spline:
                tolerance *= 10.0
            if goal == "time":
                units = units._replace(time=0.1 * units.time)
            else:  # inertial torques grow as the time gets shorter
                units = Units(0.5 * units.time, 2.0 * units.torque)
            continue
        optimal = optimum_units(goal, speed, units)
        # the cost is a time or a torque: only the unit of the cost needs correction
        new, old = (optimal.time, units.time) if goal == "time" else (optimal.torque, units.torque)
        if max(new / old, old / new) < MAX_UNIT_RATIO:
            return LeastCost(program, speed, optimal)
        units = optimal if goal == "time" else units._replace(torque=optimal.torque)
    if isinstance(speed, Unsolved):
        return NoneFound(program, speed.status)
    return LeastCost(program, speed, optimal)


def optimum_units(goal: str, speed: Speed, units: Units) -> Units:
    """Return the units of time and torque in which an optimum's duration and torque are 1.

    The torque is the root mean square for the goal "energy", and the peak for all others. Without a finite
    duration the units are returned.
    """
    # the solver sees the duration by the program's own quadrature, where it is an unknown
    time = speed.least_duration if np.isfinite(speed.least_duration) else speed.duration
    if not np.isfinite(time):
        return units
    if goal in ("limits", "peak_speed"):  # the cost is a multiple of limits, without a unit of torque
        return Units(time, 1.0)
    torque = float(np.sqrt(speed.energy / time)) if goal == "energy" else speed.peak
    return Units(time, torque)


def _first_units(program: SpeedProgram) -> Units:
    """Estimate time [s] and torque (share of `reference`) of the optimum, before a law is known.

    Condition (8), t_s . W_p = constant + per_z z + per_u u = 0, is met at z or u of about constant / per_z;
    z = 1 / time^2. If the constant vanishes at all crossings, the time is the shortest that speed limits, or
    inertia at the reference torque, allow. The torque is the limit; without limits it is that of weight, and
    without weight that of inertia at this time.
    """
    problem = program.problem
    specification = problem.specification
    # time of a law that meets condition (8)
    constant, per_z, per_u, _ = np.abs(problem.conditions.T)
    with np.errstate(divide="ignore", invalid="ignore"):
        condition_times = np.sqrt(np.maximum(per_z, per_u) / constant)  # infinite or NaN without a constant
    time = min(specification.max_duration or np.inf, float(np.nanmin(condition_times, initial=np.inf)))

    # inertia [s^2]: torque over the reference per z, of the motor that needs most
    torques = list(zip(program.rows.torque, problem.reference, strict=True))
    inertia = max(_median_largest(torque.matrix) / reference for torque, reference in torques)
    if not 0.0 < time < np.inf:
        rows_per_z = [inertia, *map(_median_largest, program.rows.squared_speed)]  # of limits, in s^2
        time = float(np.sqrt(max(rows_per_z))) or 1.0

    if specification.limited:
        return Units(time, 1.0)
    weight = max(float(np.abs(torque.offset / reference).max()) for torque, reference in torques)
    return Units(time, weight or inertia / time**2 or 1.0)


def _median_largest(matrix: SparseRows) -> float:
    """Return the median over rows of the largest size of an entry of each row."""
    return float(np.median(matrix.largest()))


def _cells_to_cut(program: SpeedProgram, y: Array) -> BoolArray:
    """Return the mask (k,) of cells under coefficients that are nearly zero or bend sharply.

    The bend of a coefficient is its second difference y_(i-1) - 2 y_i + y_(i+1). Spline i of degree p is not
    zero between the knots i and i + p + 1. Under a low coefficient all these cells are cut. Under a bend,
    only the inner cells of the middle spline are cut, without two at either end.

    Args:
        program: the program on the present cells.
        y: (n,) coefficients of its solution.
    """
    basis = program.basis
    if not basis.is_spline:
        return np.zeros(len(program.cells) - 1, dtype=bool)
    lowest = LOW_COEFFICIENT * np.median(y)
    low = np.flatnonzero(y <= lowest)
    # three successive coefficients (n - 2, 3); low ones, which are cut anyway, are raised to `lowest`
    triples = np.lib.stride_tricks.sliding_window_view(np.maximum(y, lowest), 3)
    second_difference = np.abs(triples @ [1.0, -2.0, 1.0])
    first_of_bend = np.flatnonzero(second_difference > MAX_BEND * triples.min(axis=1))
    knots = basis.splines.knots
    degree = basis.degree
    # ends of the stretches to cut; the middle spline of a bend has the number first_of_bend + 1
    start = np.concatenate([knots[low], knots[first_of_bend + 3]])
    end = np.concatenate([knots[low + degree + 1], knots[first_of_bend + degree]])
    is_covered = (basis.cells[:-1, None] >= start) & (basis.cells[1:, None] <= end)  # (k, coefficients)
    return np.asarray(is_covered.any(axis=1))
