"""The least cost of a problem, of laws however restless: on cells that follow the law, in units of its own.

Non-negative B-splines on a cell of width h cannot come nearer to zero than h^2 z", nor follow a kink: cells
are cut in two under coefficients that are nearly zero or bend sharply, until the cost changes no more.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray
from framework.crossing.optimal.law_problem import LawProblem
from framework.crossing.optimal.speed_program import Bounds, Speed, SpeedProgram, Units
from framework.motion.cone_program import Unsolved
from framework.tolerances import LIMIT_MARGIN

FIRST_CELLS, MAX_CELLS = 60, 180
MAX_REFINEMENTS, MIN_REFINEMENT_CHANGE = (
    5,
    2e-3,
)  # of the cells; of the cost, below which it is not worth another
LOW_COEFFICIENT = 1e-5  # of the median: lower ones would go on falling on smaller cells
MAX_BEND = 0.1  # second difference of coefficients over the least of the three, above which cells are cut
MAX_UNIT_CHANGES, MAX_UNIT_RATIO = (
    8,
    5.0,
)  # of units that are corrected: of the optimum to its unit, or inverse


class NoneFound(NamedTuple):
    """No law was found: the program that has none, with the solver's status or the reason."""

    program: SpeedProgram
    status: str

    @property
    def infeasible(self) -> bool:
        """Whether the rows of the program contradict each other, as the solver says."""
        return self.status == "PrimalInfeasible"


def cost_of(goal: str, speed: Speed) -> float:
    """Return what a goal counts: duration [s], peak of torques over the reference, energy over it [s].

    Or the peak of speeds over their limits, or the larger of the peaks of torques and squared speeds.
    """
    return {
        "time": speed.duration,
        "peak_torque": speed.peak,
        "energy": speed.energy,
        "peak_speed": speed.peak_speed,
        "limits": max(speed.peak, speed.peak_speed**2),
    }[goal]


def first_cells(problem: LawProblem) -> Array:
    """Return edges of uniform cells in xi, moved so that each condition is in the middle of one."""
    count = FIRST_CELLS if problem.degree is None else problem.degree
    edges, width = np.linspace(-1.0, 1.0, count + 1), 2.0 / count
    for place in np.unique(problem.places):
        half = min(0.5 * width, 0.7 * (1.0 - abs(place)))
        apart = (np.abs(edges - place) > half + 0.35 * width) | (np.abs(edges) == 1.0)
        edges = np.unique(np.concatenate([edges[apart], [place - half, place + half]]))
    return edges


def find_least_cost(
    problem: LawProblem, cells: Array | None = None, *, torque_limits: bool = True
) -> tuple[SpeedProgram, Speed, Units] | NoneFound:
    """Find the least cost on cells that are cut where the coefficients of z are nearly zero, or bend sharply.

    The least peak is sought without torque limits, which it meets where any law does if all motors have one.
    Where limits have no law on the first cells, those on which the least peak was found are tried.
    """
    goal, best, limited = problem.specification.goal, None, problem.specification.limited
    cells = first_cells(problem) if cells is None else cells
    if goal == "peak_torque" and limited and torque_limits:
        free = find_least_cost(problem, cells, torque_limits=False)
        if isinstance(free, NoneFound) or free[1].peak <= 1.0:
            return free
        return _solve_on(problem, free[0].cells)
    for _ in range(MAX_REFINEMENTS + 1):
        program = SpeedProgram.on_cells(problem, cells)
        found = solve_least_cost(program, None if best is None else best[2], torque_limits=torque_limits)
        if isinstance(found, NoneFound):
            if best is not None or goal == "peak_torque":
                return best or found
            peaks = find_least_cost(problem.with_goal("peak_torque"), cells, torque_limits=False)
            if isinstance(peaks, NoneFound):
                return found
            finer = peaks[0].cells
            return found if len(finer) == len(cells) else _solve_on(problem, finer)
        # a higher cost on smaller cells is right too: of more points, between which the limits were exceeded
        change = np.inf if best is None else abs(1.0 - cost_of(goal, found[0]) / cost_of(goal, best[1]))
        best = program, *found
        cut = _cells_to_cut(program, found[0].y)
        if change < MIN_REFINEMENT_CHANGE or not cut.any() or len(cells) > MAX_CELLS:
            break
        cells = _cut_cells(problem, cells, cut)
    assert best is not None
    return best


def _solve_on(problem: LawProblem, cells: Array) -> tuple[SpeedProgram, Speed, Units] | NoneFound:
    """Find the least cost on cells (k + 1,) of xi."""
    program = SpeedProgram.on_cells(problem, cells)
    found = solve_least_cost(program)
    return found if isinstance(found, NoneFound) else (program, *found)


def solve_least_cost(
    program: SpeedProgram, units: Units | None = None, *, torque_limits: bool = True, kept: float = 1.0
) -> tuple[Speed, Units] | NoneFound:
    """Solve for the goal within a share `kept` of the limits, units corrected by the optimum; return both."""
    specification = program.problem.specification
    goal = specification.goal
    most = None if goal == "time" else specification.most  # the quickest law, whatever bounds it
    share = kept * (1.0 if goal == "peak_torque" else 1.0 - LIMIT_MARGIN)
    bounds = Bounds(most, torque_limits=torque_limits, share=share)
    units = units or _first_units(program)
    for _ in range(MAX_UNIT_CHANGES):
        found = program.minimise(goal, bounds, units)
        if isinstance(found, Unsolved):
            if found.infeasible:
                return NoneFound(program, found.status)
            units = (
                units._replace(time=0.1 * units.time)
                if goal == "time"
                else Units(0.5 * units.time, 2.0 * units.torque)
            )
            continue
        own = own_units(goal, found, units)
        one, other = (own.time, units.time) if goal == "time" else (own.torque, units.torque)
        if max(one / other, other / one) < MAX_UNIT_RATIO:
            return found, own
        units = own if goal == "time" else units._replace(torque=own.torque)
    return NoneFound(program, found.status) if isinstance(found, Unsolved) else (found, own)


def own_units(goal: str, found: Speed, units: Units) -> Units:
    """Return units in which a speed is near 1."""
    time = found.value if np.isfinite(found.value) else found.duration
    if not np.isfinite(time):
        return units
    if goal in ("limits", "peak_speed"):  # least multiples of squared speeds have no unit of torque
        return Units(time, 1.0)
    return Units(time, float(np.sqrt(found.energy / time)) if goal == "energy" else found.peak)


def _first_units(program: SpeedProgram) -> Units:
    """Return first units: of time by condition (8) or the limits, of torque by limits or weight."""
    problem, specification = program.problem, program.problem.specification
    constant, per_z, per_u, _ = np.abs(problem.conditions.T)
    with np.errstate(divide="ignore", invalid="ignore"):
        pace = np.sqrt(np.maximum(per_z, per_u) / constant)
    time = min(specification.most or np.inf, float(np.nanmin(pace, initial=np.inf)))
    rows = [
        (torque.matrix, torque.offset / problem.reference[j]) for j, torque in enumerate(program.rows.torque)
    ]
    inertia = max(
        float(np.median(np.abs(m).max(axis=1).toarray())) / problem.reference[j]
        for j, (m, _) in enumerate(rows)
    )
    if not 0.0 < time < np.inf:  # nothing falls: what limits or unit torques allow
        speeds = [float(np.median(m.max(axis=1).toarray())) for m in program.rows.squared_speed]
        time = float(np.sqrt(max([inertia, *speeds]))) or 1.0
    weight = max(float(np.abs(offset).max()) for _, offset in rows)
    return Units(time, 1.0 if specification.limited else weight or inertia / time**2 or 1.0)


def _cells_to_cut(program: SpeedProgram, y: Array) -> BoolArray:
    """Return a mask (k,) of the cells under coefficients that are nearly zero, or bend sharply."""
    basis = program.basis
    if not basis.is_spline:
        return np.zeros(len(program.cells) - 1, dtype=bool)
    low = LOW_COEFFICIENT * np.median(y)
    neighbours = np.lib.stride_tricks.sliding_window_view(np.maximum(y, low), 3)
    bent = np.abs(neighbours @ [1.0, -2.0, 1.0]) > MAX_BEND * neighbours.min(axis=1)
    start = np.concatenate([basis.knots[np.flatnonzero(y <= low)], basis.knots[np.flatnonzero(bent) + 3]])
    end = np.concatenate(
        [
            basis.knots[np.flatnonzero(y <= low) + basis.degree + 1],
            basis.knots[np.flatnonzero(bent) + basis.degree],
        ]
    )
    cells = basis.cells
    return np.asarray(((cells[:-1, None] >= start) & (cells[1:, None] <= end)).any(axis=1))


def _cut_cells(problem: LawProblem, cells: Array, cut: BoolArray) -> Array:
    """Return the cells with those of a mask cut in two, or in three about a condition."""
    low, high = cells[:-1][cut], cells[1:][cut]
    about = ((low[:, None] < problem.places) & (problem.places < high[:, None])).any(axis=1)
    third = (high - low) / 3.0
    return np.unique(
        np.concatenate([cells, (0.5 * (low + high))[~about], (low + third)[about], (high - third)[about]])
    )
