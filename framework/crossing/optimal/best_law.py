"""The best law of a problem: its value on cells that follow it, then the smoothest law that costs hardly more.

The optimum is seldom unique, and the corner that a solver ends in is restless. So the least cost is found
first, with squared speeds that may come as near to zero as they like; then the law of least integral of
(d2z/dsigma2)^2 whose cost is within a share of that, within all limits.

A required duration D above that of the smoothest law is met from within: T(z) is convex, so that its tangent
T_lin(z) >= D at a slow law keeps T(z) >= D, and the blend of what is found with a quick law takes D exactly.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray
from framework.crossing.optimal.speed_program import Bounds, LawProblem, Speed, SpeedProgram, Units, motor_rows
from framework.errors import InvalidInput
from framework.motion.cone_program import Unsolved
from framework.motion.optimal_law import OptimalLaw
from framework.tolerances import LIMIT_MARGIN, SAME_PLACE, SQUARED_SPEED_FLOORS

FIRST_CELLS, MAX_CELLS = 60, 180
MAX_REFINEMENTS, MIN_REFINEMENT_CHANGE = 5, 2e-3  # of the cells; of the cost, below which it is not worth another
LOW_COEFFICIENT = 1e-5  # of the median: lower ones would go on falling on smaller cells
MAX_BEND = 0.1  # second difference of coefficients over the least of the three, above which cells are cut
COST_SHARE = 4e-3  # of the least cost, which smoothness may take
SAME_DURATION = 1e-6  # of a duration
MAX_UNIT_CHANGES, MAX_UNIT_RATIO = 8, 5.0  # of units that are corrected: of the optimum to its unit, or inverse
MAX_SLOW_STEPS, MAX_ENERGY_STEPS = 6, 6  # of the tangent of T(z), towards slow laws and little energy
MIN_ENERGY_GAIN = 1e-3
MAX_INNER_COST = 0.9  # of holding the robot inside its path, over that at an end, where a law may wait
WAITING_WIDTHS = (0.15, 0.05)  # in sigma, of stretches where a law may wait; the second where the first is none
MAX_ROW_ROUNDS = 3  # of solving with rows where a limit was exceeded between the points
BETWEEN = np.arange(1, 6) / 6  # places between two points, where a limit that is nearly reached is looked at
NEARLY_REACHED = 0.98  # of what is allowed
LIMIT_TIGHTENING = 1e-5  # share of a limit that is left free when it was exceeded


class Best(NamedTuple):
    """A law, the squared speed that it is made of, and the search that found it."""

    law: OptimalLaw
    search: _Search
    speed: Speed

    @property
    def program(self) -> SpeedProgram:
        return self.search.program

    @property
    def reference(self) -> Array:
        """Torques (n_a,) [N m] that peak and energy are relative to."""
        return self.program.problem.reference

    @property
    def peak(self) -> float:
        """The largest torque over the reference at the rows of the program."""
        return self.speed.peak

    @property
    def cost(self) -> float:
        """The duration [s], the peak over the reference, or the energy over its square [s]."""
        return cost_of(self.search.goal, self.speed)

    @property
    def gap(self) -> float:
        """The cost over the least that the program found, of laws however restless, less 1."""
        least = self.search.least
        found = least.value if self.search.goal == "time" else cost_of(self.search.goal, least)
        return max(self.cost / found - 1.0, 0.0)


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


def find_best_law(
    problem: LawProblem, cells: Array | None = None, *, share: float = COST_SHARE
) -> Best | NoneFound:
    """Find the smoothest law whose cost is within a share of the least.

    Args:
        cells: (k + 1,) of xi, which are refined; uniform ones unless given.
    """
    goal = problem.specification.goal
    valued = refine_value(problem, cells)
    if isinstance(valued, NoneFound):
        return valued if goal == "peak_torque" else _gentlest_within_limits(problem, valued, share)
    program, least, units = valued
    longest = problem.specification.longest
    if goal == "time" and longest is not None and least.value > longest:
        return NoneFound(program, f"the quickest found takes {least.duration:.4g} s")
    return _search_smooth(_Search(program, units, least, share))


def resume_law(best: Best, problem: LawProblem) -> Best | NoneFound:
    """Find the law of a problem that differs little from that of `best`, on the same cells and from its law."""
    program = SpeedProgram.on_cells(problem, best.program.cells)
    found = _least_cost(program, best.search.units)
    if isinstance(found, NoneFound):
        return found
    least, units = found
    return _search_smooth(best.search._replace(program=program, least=least, units=units), best.speed)


def adapt_law(best: Best, *, excess: float = 1.0, share: float | None = None) -> Best | NoneFound:
    """Find a smooth law again, within limits divided by an excess, or a smoother one at a larger share of the cost."""
    search = best.search._replace(share=share or best.search.share)
    if excess > 1.0:
        search = search._replace(kept=search.kept * (1.0 - LIMIT_TIGHTENING) / excess)
    found = _search_smooth(search, best.speed)
    if isinstance(found, Best) or search.goal == "peak_torque":
        return found
    return _gentlest_within_limits(search.program.problem, found, search.share)


def _gentlest_within_limits(problem: LawProblem, none: NoneFound, share: float) -> Best | NoneFound:
    """Find the law of least peak for another goal that has no law, if all limits hold; else return `none`."""
    if not problem.specification.limited:
        return none
    gentlest = find_best_law(problem.with_goal("peak_torque"), share=share)
    return gentlest if isinstance(gentlest, Best) and gentlest.peak <= 1.0 else none


def _search_smooth(search: _Search, near: Speed | None = None) -> Best | NoneFound:
    """Find the smooth law, with rows wherever a limit was exceeded between the points.

    Where these raise the least cost by more than the share, that is sought again.
    """
    duration, valued, smooth = search.program.problem.specification.duration, search.program, None
    try:
        for _ in range(MAX_ROW_ROUNDS + 1):
            found = search.smoothest() if duration is None else search.lasting(duration, near)
            if isinstance(found, NoneFound):
                least = found if search.program is valued else _least_cost(search.program, search.units)
                if isinstance(least, NoneFound):
                    break
                search, near, valued = search._replace(least=least[0], units=least[1]), None, search.program
                continue
            smooth, near = found, found
            exceeded = _exceeded_places(search.program, found, search.bounds)
            if not len(exceeded):
                break
            search = search._replace(program=search.program.extend(exceeded))
        return found if smooth is None else _best_of(search, smooth)
    except InvalidInput as reason:  # z comes too near to zero
        return NoneFound(search.program, str(reason))


def _best_of(search: _Search, found: Speed) -> Best:
    """Return the law of a speed; raises InvalidInput where it comes too near to zero."""
    program, specification = search.program, search.program.problem.specification
    y = found.y
    if specification.duration is not None:
        y = program.space.adjust(y, program.conditions, specification.duration)
    law = OptimalLaw(
        y,
        specification.smoothness,
        specification.duration or 0.0,
        program.problem.task.stretch.at,
        tuple(program.basis.cells),
    )
    return Best(law, search, program.speed(y))


# ------------------------------------------------------------------ value


def first_cells(problem: LawProblem) -> Array:
    """Return edges of uniform cells in xi, moved so that each condition is in the middle of one."""
    count = FIRST_CELLS if problem.degree is None else problem.degree
    edges, width = np.linspace(-1.0, 1.0, count + 1), 2.0 / count
    for place in np.unique(problem.places):
        half = min(0.5 * width, 0.7 * (1.0 - abs(place)))
        apart = (np.abs(edges - place) > half + 0.35 * width) | (np.abs(edges) == 1.0)
        edges = np.unique(np.concatenate([edges[apart], [place - half, place + half]]))
    return edges


def refine_value(
    problem: LawProblem, cells: Array | None = None, *, torque_limits: bool = True
) -> tuple[SpeedProgram, Speed, Units] | NoneFound:
    """Find the least cost on cells that are cut where the coefficients of z are nearly zero, or bend sharply.

    The least peak is sought without torque limits, which it meets where any law does if all motors have one.
    Where limits have no law on the first cells, those on which the least peak was found are tried.
    """
    goal, best, limited = problem.specification.goal, None, problem.specification.limited
    cells = first_cells(problem) if cells is None else cells
    if goal == "peak_torque" and limited and torque_limits:
        free = refine_value(problem, cells, torque_limits=False)
        if isinstance(free, NoneFound) or free[1].peak <= 1.0:
            return free
        return _value_on(problem, free[0].cells)
    for _ in range(MAX_REFINEMENTS + 1):
        program = SpeedProgram.on_cells(problem, cells)
        found = _least_cost(program, None if best is None else best[2], torque_limits=torque_limits)
        if isinstance(found, NoneFound):
            if best is not None or goal == "peak_torque":
                return best or found
            peaks = refine_value(problem.with_goal("peak_torque"), cells, torque_limits=False)
            if isinstance(peaks, NoneFound):
                return found
            finer = peaks[0].cells
            return found if len(finer) == len(cells) else _value_on(problem, finer)
        # a higher cost on smaller cells is right too: of more points, between which the limits were exceeded
        change = np.inf if best is None else abs(1.0 - cost_of(goal, found[0]) / cost_of(goal, best[1]))
        best = program, *found
        cut = _cells_to_cut(program, found[0].y)
        if change < MIN_REFINEMENT_CHANGE or not cut.any() or len(cells) > MAX_CELLS:
            break
        cells = _cut_cells(problem, cells, cut)
    assert best is not None
    return best


def _value_on(problem: LawProblem, cells: Array) -> tuple[SpeedProgram, Speed, Units] | NoneFound:
    """Find the least cost on these cells."""
    program = SpeedProgram.on_cells(problem, cells)
    found = _least_cost(program)
    return found if isinstance(found, NoneFound) else (program, *found)


def _least_cost(
    program: SpeedProgram, units: Units | None = None, *, torque_limits: bool = True
) -> tuple[Speed, Units] | NoneFound:
    """Solve for the goal with units corrected by the optimum, and return both."""
    specification = program.problem.specification
    goal = specification.goal
    most = None if goal == "time" else specification.most  # the quickest law, whatever bounds it
    share = 1.0 if goal == "peak_torque" else 1.0 - LIMIT_MARGIN
    bounds = Bounds(most, torque_limits=torque_limits, share=share)
    units = units or _first_units(program)
    for _ in range(MAX_UNIT_CHANGES):
        found = program.minimise(goal, bounds, units)
        if isinstance(found, Unsolved):
            if found.infeasible:
                return NoneFound(program, found.status)
            units = units._replace(time=0.1 * units.time) if goal == "time" else Units(0.5 * units.time, 2.0 * units.torque)
            continue
        own = units_of(goal, found, units)
        one, other = (own.time, units.time) if goal == "time" else (own.torque, units.torque)
        if max(one / other, other / one) < MAX_UNIT_RATIO:
            return found, own
        units = own if goal == "time" else units._replace(torque=own.torque)
    return NoneFound(program, found.status) if isinstance(found, Unsolved) else (found, own)


def units_of(goal: str, found: Speed, units: Units) -> Units:
    """Return units in which a speed is near 1."""
    time = found.value if np.isfinite(found.value) else found.duration
    if not np.isfinite(time):
        return units
    if goal == "limits":  # the least multiple is one of torques and of squared speeds
        return Units(time, 1.0)
    return Units(time, float(np.sqrt(found.energy / time)) if goal == "energy" else found.peak)


def _first_units(program: SpeedProgram) -> Units:
    """Return first units: of time by condition (8), the duration or the limits, of torque by limits or weight."""
    problem, specification = program.problem, program.problem.specification
    constant, per_z, per_u, _ = np.abs(problem.conditions.T)
    with np.errstate(divide="ignore", invalid="ignore"):
        pace = np.sqrt(np.maximum(per_z, per_u) / constant)
    time = min(specification.most or np.inf, float(np.nanmin(pace, initial=np.inf)))
    rows = [(torque.matrix, torque.offset / problem.reference[j]) for j, torque in enumerate(program.rows.torque)]
    inertia = max(float(np.median(np.abs(m).max(axis=1).toarray())) / problem.reference[j] for j, (m, _) in enumerate(rows))
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
        [basis.knots[np.flatnonzero(y <= low) + basis.degree + 1], basis.knots[np.flatnonzero(bent) + basis.degree]]
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


# ------------------------------------------------------------------ smooth laws


class _Search(NamedTuple):
    """The search for a smooth law near the least cost of a program."""

    program: SpeedProgram
    units: Units
    least: Speed
    share: float  # of the least cost, which smoothness may take
    kept: float = 1.0  # share of the limits to which the certificate has led

    @property
    def goal(self) -> str:
        return self.program.problem.specification.goal

    @property
    def bounds(self) -> Bounds:
        """What a smooth law keeps: the limits, and the least cost but for a share."""
        specification, share = self.program.problem.specification, 1.0 + self.share
        most, kept = specification.most, self.kept * (1.0 - LIMIT_MARGIN)
        if self.goal == "time":
            return Bounds(min(share * self.least.value, most or np.inf), share=kept)
        longest = None if most is None else most * (1.0 - SAME_DURATION)
        if self.goal == "energy":
            return Bounds(longest, energy=share * self.least.energy, share=kept)
        limited = specification.limited and self.least.peak <= 1.0
        peak = self.kept * min(share * self.least.peak, 1.0 if limited else np.inf)
        return Bounds(longest, peak, share=self.kept)

    def smoothest(self) -> Speed | NoneFound:
        """Find the smoothest law within the bounds, in twice the time that these take at least."""
        bounds = self.bounds
        if self.goal != "time":
            quick = self.program.minimise("time", bounds._replace(longest=None), self.units)
            if isinstance(quick, Speed):
                longest = min(bounds.longest or np.inf, 2.0 * quick.duration)
                own = self._replace(units=self.units._replace(time=longest))
                return own._above_floor(bounds._replace(longest=longest))[0]
        return self._above_floor(bounds)[0]

    def lasting(self, duration: float, near: Speed | None = None) -> Speed | NoneFound:
        """Find a smooth law within the bounds that takes a duration [s], of least energy that near one of it."""
        if self.goal == "energy":
            return self._least_energy(duration, near)
        smooth, floor = self._above_floor(self.bounds)
        if isinstance(smooth, NoneFound) or smooth.duration >= duration * (1.0 - 2.0 * SAME_DURATION):
            return smooth
        free = self.bounds._replace(longest=None)
        if near is not None:
            return self._step("bend", near, smooth, free, floor, 1)
        slow = self._slow(duration, free, floor)
        if isinstance(slow, NoneFound):
            return slow
        return self._step("bend", self._blend(smooth, slow, duration), smooth, free, floor, 2)

    def _above_floor(self, bounds: Bounds, goal: str = "bend") -> tuple[Speed | NoneFound, float]:
        """Solve with the highest floor under z that has a solution, and return that too."""
        assert bounds.longest is not None
        status = ""
        for share in SQUARED_SPEED_FLOORS:
            floor = share / bounds.longest**2
            found = self.program.minimise(goal, bounds, self.units, floor=floor)
            if isinstance(found, Speed) and np.isfinite(found.duration):
                return found, floor
            status = found.status if isinstance(found, Unsolved) else "z is not positive"
        return NoneFound(self.program, status), 0.0

    def _blend(self, quick: Speed, slow: Speed, duration: float) -> Speed:
        """Return the blend of two speeds that takes a duration [s] between theirs."""
        if not quick.duration < duration < slow.duration:
            return slow
        return self.program.speed(self.program.space.blend(quick.y, slow.y, duration))

    def _slow(self, duration: float, bounds: Bounds, floor: float) -> Speed | NoneFound:
        """Find a law that takes longer: a smooth one that waits at its ends, else slower ones by tangents of T."""
        sigma = self.program.problem.task.stretch.inverse(np.clip(self.program.positive[1], -1.0, 1.0))
        for width in WAITING_WIDTHS:
            cap = np.where(np.minimum(sigma, 1.0 - sigma) < width, _waiting_speed(width, duration, floor), np.inf)
            slow = self.program.minimise("bend", bounds, self.units, floor=floor, cap=cap)
            if isinstance(slow, Speed) and duration <= slow.duration < np.inf:
                return slow
        weights = np.ones(self.program.z.shape[0])
        for _ in range(MAX_SLOW_STEPS):
            slow = self.program.minimise("slowness", bounds, self.units, floor=floor, weights=weights)
            if isinstance(slow, Unsolved):
                return NoneFound(self.program, slow.status)
            if slow.duration >= duration:
                break
            z = self.program.z @ slow.y
            weights = (z / z.max()) ** -1.5
        if not duration <= slow.duration < np.inf:
            return NoneFound(self.program, f"the slowest law found takes {slow.duration:.4g} s")
        return slow

    def _step(
        self, goal: str, law: Speed, quick: Speed, bounds: Bounds, floor: float, count: int
    ) -> Speed:
        """Make a law of a duration better by tangents of T about it, each time blended with a quick law."""
        duration = law.duration
        for _ in range(count):
            bounded = bounds._replace(longest=4.0 * duration)
            found = self.program.minimise(goal, bounded, self.units, floor=floor, about=(law.y, duration))
            if isinstance(found, Unsolved) or not duration * (1.0 - 1e-4) <= found.duration < np.inf:
                break
            law = self._blend(quick, found, duration)
        return law

    # -------------------------------------------------------------- energy at a duration

    def _least_energy(self, duration: float, near: Speed | None) -> Speed | NoneFound:
        """Find a law of little energy that takes a duration [s], from several that do, then a smooth one."""
        limits = Bounds(share=self.bounds.share)
        quick, floor = self._above_floor(limits._replace(longest=duration), "energy")
        if isinstance(quick, NoneFound):
            return quick
        found: Speed | NoneFound = near or quick
        if near is None and quick.duration < duration * (1.0 - SAME_DURATION):
            found = self._from_slow_starts(quick, duration, floor)
            if isinstance(found, NoneFound):
                return found
        share = self.bounds._replace(longest=None, energy=(1.0 + self.share) * found.energy)
        smooth = self.program.minimise("bend", share._replace(longest=duration), self.units, floor=floor)
        if isinstance(smooth, Speed) and np.isfinite(smooth.duration):
            if smooth.duration >= duration * (1.0 - SAME_DURATION):
                return smooth
            quick = smooth
        return self._step("bend", found, quick, share, floor, 1)

    def _from_slow_starts(self, quick: Speed, duration: float, floor: float) -> Speed | NoneFound:
        """Find the law of least energy by tangents of T from laws of a duration [s] that wait somewhere.

        No law of this duration has less energy than the quick one, so that what is near to it ends the search.
        """
        starts, enough = [], (1.0 + 0.5 * self.share) * quick.energy
        for start in self._slow_starts(quick, duration, floor):
            starts.append(start)
            if start.energy <= enough:
                return start
        if not starts:
            return NoneFound(self.program, "no law slow enough was found")
        best = min(starts, key=_energy_of)
        return self._descend(best, quick, floor)

    def _descend(self, law: Speed, quick: Speed, floor: float) -> Speed:
        """Lower the energy of a law step by step, as long as that pays."""
        for _ in range(MAX_ENERGY_STEPS):
            better = self._step("energy", law, quick, Bounds(share=self.bounds.share), floor, 1)
            gain = law.energy - better.energy
            law = min(law, better, key=_energy_of)
            if gain < MIN_ENERGY_GAIN * law.energy:
                break
        return law

    def _slow_starts(self, quick: Speed, duration: float, floor: float) -> Iterator[Speed]:
        """Find laws of a duration [s] that wait somewhere, and the law of least peak in that duration."""
        for width in WAITING_WIDTHS:
            found = False
            for cap in self._caps(duration, width, floor):
                slow = self.program.minimise(
                    "energy", Bounds(share=self.bounds.share), self.units, floor=floor, cap=cap
                )
                if isinstance(slow, Speed) and duration <= slow.duration < np.inf:
                    found = True
                    yield self._blend(quick, slow, duration)
            if found:
                break
        gentle = replace(self.program, problem=self.program.problem.with_goal("peak_torque"))
        least = _least_cost(gentle)
        if not isinstance(least, NoneFound):
            slow = _Search(gentle, least[1], least[0], self.share).lasting(duration)
            if isinstance(slow, Speed) and slow.duration >= duration * (1.0 - SAME_DURATION):
                yield slow

    def _caps(self, duration: float, width: float, floor: float) -> Iterator[Array]:
        """Return bounds (m,) of positive rows with which a law waits where holding costs least.

        That is at one end, where it rests anyway, or at a place inside that costs less than either.
        """
        program = self.program
        sigma = program.problem.task.stretch.inverse(np.clip(program.positive[1], -1.0, 1.0))
        points = program.problem.task.stretch.inverse(program.xi)
        offsets = np.stack([torque.offset[: len(points)] for torque in program.rows.torque], axis=1)
        rest = np.interp(sigma, points, ((offsets / program.problem.reference) ** 2).sum(axis=1))
        inner = 1 + np.flatnonzero((rest[1:-1] <= rest[:-2]) & (rest[1:-1] <= rest[2:]))
        inner = inner[rest[inner] < MAX_INNER_COST * min(rest[0], rest[-1])]
        start, end = sigma < width, sigma > 1.0 - width
        ends = [start] if rest[0] < rest[-1] else [end]
        for waiting in (*ends, *(np.abs(sigma - sigma[k]) < 0.5 * width for k in inner)):
            yield np.where(waiting, _waiting_speed(width, duration, floor), np.inf)


def _waiting_speed(width: float, duration: float, floor: float) -> float:
    """Return the squared speed [1/s^2], above a floor, at which a width in sigma takes longer than a duration [s]."""
    return max((0.7 * width / duration) ** 2, 1.01 * floor)


def _energy_of(speed: Speed) -> float:
    return speed.energy


def _exceeded_places(program: SpeedProgram, found: Speed, bounds: Bounds) -> Array:
    """Return places in xi (R,) between the points where a limit or the bound of the peak is exceeded."""
    limit, reference = program.problem.specification.torque_limit, program.problem.reference
    bounded = np.inf if bounds.peak is None else bounds.peak * (1.0 + LIMIT_MARGIN) * reference
    allowed = np.minimum(limit, bounded)
    reached = program.rows.used_share(found.y, allowed)[: len(program.xi)]
    order = np.argsort(program.xi)
    xi, reached = program.xi[order], reached[order]
    gaps = np.flatnonzero(np.maximum(reached[1:], reached[:-1]) > NEARLY_REACHED)
    if not len(gaps):
        return np.empty(0)
    between = (xi[gaps, None] + (xi[gaps + 1] - xi[gaps])[:, None] * BETWEEN).ravel()
    between = between[np.abs(between[:, None] - program.problem.places).min(axis=1, initial=np.inf) > SAME_PLACE]
    rows = motor_rows(program.problem, program.basis, program.conditions, between)
    over = rows.used_share(found.y, allowed)
    padded = np.pad(over, 1, constant_values=-np.inf)
    highest = (over >= padded[:-2]) & (over >= padded[2:])
    return between[highest & (over > 1.0)]
