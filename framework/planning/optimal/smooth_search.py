"""The search for the smoothest law near the least cost, and for laws that take a given duration.

The smoothest law has the least integral of (d2z/dsigma2)^2. A required duration D may be longer than that of
the smoothest law. T(z) >= D is no convex constraint, but T(z) is convex: its tangent T_lin at a slow law is
below T, and laws with T_lin(z) >= D take D or longer. A blend of such a law with a quick one takes D exactly.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple, TypeGuard

import numpy as np

from framework.numerics.arrays import Array, BoolArray
from framework.numerics.cone_program import Unsolved
from framework.planning.optimal.law_problem import motor_rows
from framework.planning.optimal.least_cost import NoneFound, solve_least_cost
from framework.planning.optimal.speed_program import Bounds, Speed, SpeedProgram, Units
from framework.tolerances import LIMIT_MARGIN, SAME_PLACE, SQUARED_SPEED_FLOORS

SAME_DURATION = 1e-5  # of a duration
BLENDED_DURATION = 1e-4  # of a duration by which the tangent of T may fall short
MAX_SLOW_STEPS, MAX_ENERGY_STEPS = 6, 6  # of the tangent of T(z), towards slow laws and little energy
MIN_ENERGY_GAIN = 1e-3
MAX_INNER_COST = 0.9  # of holding the robot inside its path, over that at an end, where a law may wait
# in sigma, of stretches where a law may wait; the second where the first has no law
WAITING_WIDTHS = (0.15, 0.05)
LIFTED_SHARE = 1e-2  # of a quick law's z, below which a slow law stands still
BETWEEN = np.arange(1, 6) / 6  # of the way from a point to the next, where limits are checked
NEARLY_REACHED = 0.98  # of what is allowed


class SmoothSearch(NamedTuple):
    """The search for a smooth law near the least cost of a program.

    share: of the least cost, which smoothness may take.
    limit_share: of the limits, to which the certificate has led.
    pace: the longest duration [s] of a smooth law where none is given; None without a bound.
    """

    program: SpeedProgram
    units: Units
    least: Speed
    share: float
    limit_share: float = 1.0
    pace: float | None = None

    @property
    def goal(self) -> str:
        return self.program.problem.specification.goal

    @property
    def bounds(self) -> Bounds:
        """The limits, and the least cost with the share that smoothness may take."""
        specification = self.program.problem.specification
        cost_factor = 1.0 + self.share
        limit_share = self.limit_share * (1.0 - LIMIT_MARGIN)
        longest = specification.max_duration
        if self.goal == "time":
            return Bounds(min(cost_factor * self.least.value, longest or np.inf), share=limit_share)
        if longest is None:
            longest = self.pace
        else:
            longest = min(longest * (1.0 - SAME_DURATION), self.pace or np.inf)
        if self.goal == "energy":
            return Bounds(longest, energy=cost_factor * self.least.energy, share=limit_share)
        largest_peak = cost_factor * self.least.peak
        if specification.limited and self.least.peak <= 1.0:
            largest_peak = min(largest_peak, 1.0)
        return Bounds(longest, self.limit_share * largest_peak, share=self.limit_share)

    def limit_duration(self) -> SmoothSearch:
        """Return the search for laws of at most twice the least duration, unless the duration is given."""
        if self.goal == "time" or self.program.problem.specification.duration is not None:
            return self
        quick = self.program.minimise("time", self.bounds._replace(longest=None), self.units)
        if isinstance(quick, Unsolved):
            return self
        pace = min(self.program.problem.specification.max_duration or np.inf, 2.0 * quick.duration)
        return self._replace(pace=pace, units=self.units._replace(time=pace))

    def find_smoothest(self, similar: Speed | None = None) -> Speed | NoneFound:
        """Find the smoothest law within the bounds, its floor at most ten times that of a similar law."""
        return self._solve_above_floor(self.bounds, similar=similar)[0]

    def find_lasting(self, duration: float, similar: Speed | None = None) -> Speed | NoneFound:
        """Find a smooth law within the bounds that takes a duration [s].

        If the smoothest law is too quick, the tangent of T(z) there leads to a law of this duration; or
        a blend with a slow law does. It is improved by the tangent of T(z) about itself.

        Args:
            similar: a law of this duration, if one is known.
        """
        if self.goal == "energy":
            return self._find_smooth_of_little_energy(duration, similar)
        smooth, floor = self._solve_above_floor(self.bounds, similar=similar)
        if isinstance(smooth, NoneFound) or smooth.duration >= duration * (1.0 - 2.0 * SAME_DURATION):
            return smooth
        bounds = self.bounds._replace(longest=None)
        if similar is not None:
            law = self._improve("curvature", similar, smooth, bounds, floor)
            if law is not similar:
                return law
        law = self._improve("curvature", smooth, smooth, bounds, floor, duration)
        if law is smooth:
            slow = self._find_slow(duration, smooth, bounds, floor)
            if isinstance(slow, NoneFound):
                return slow
            law = self._improve("curvature", self._blend(smooth, slow, duration), smooth, bounds, floor)
        return self._improve("curvature", law, smooth, bounds, floor)

    def _solve_above_floor(
        self, bounds: Bounds, goal: str = "curvature", similar: Speed | None = None
    ) -> tuple[Speed | NoneFound, float]:
        """Solve with the highest floor under z that has a solution; return the law and the floor [1/s^2].

        Floors more than ten times that of a similar law are not tried: they had no solution.
        """
        assert bounds.longest is not None
        status = ""
        floors = np.array(SQUARED_SPEED_FLOORS) / bounds.longest**2  # the highest first
        if similar is not None and similar.floor > 0.0:
            floors = floors[floors <= 10.0 * similar.floor]
        for floor in floors:
            law = self.program.minimise(goal, bounds, self.units, floor=floor)
            if _takes_at_least(law, 0.0):
                return law, floor
            status = law.status if isinstance(law, Unsolved) else "z is not positive"
        return NoneFound(self.program, status), 0.0

    def _blend(self, quick: Speed, slow: Speed, duration: float) -> Speed:
        """Blend a quick and a slow speed to a duration [s] between theirs; else return the slow one."""
        if not quick.duration < duration < slow.duration:
            return slow
        blend = self.program.speed(self.program.space.blend(quick.y, slow.y, duration))
        return blend._replace(floor=min(quick.floor, slow.floor))

    def _minimise_slow(self, quick: Speed, goal: str, bounds: Bounds, **options: Any) -> Speed | Unsolved:
        """Find a slow law of least cost, with `options` of `SpeedProgram.minimise`.

        A law that stands still between the points is blended with a quick one, until z is at least
        LIFTED_SHARE of the quick one's.
        """
        slow = self.program.minimise(goal, bounds, self.units, **options)
        if isinstance(slow, Unsolved) or np.isfinite(slow.duration):
            return slow
        values, _ = self.program.fine_quadrature
        z, z_quick = values @ slow.y, values @ quick.y
        share = (LIFTED_SHARE * z_quick - z) / (z_quick - z)
        blend = slow.y + share[z < LIFTED_SHARE * z_quick].max() * (quick.y - slow.y)
        return self.program.speed(blend)._replace(floor=slow.floor)

    def _find_slow(self, duration: float, quick: Speed, bounds: Bounds, floor: float) -> Speed | NoneFound:
        """Find a law that takes at least a duration [s]: a smooth one that waits at its ends, else any."""
        sigma = self._positive_sigma
        for width in WAITING_WIDTHS:
            cap = _cap_speed(np.minimum(sigma, 1.0 - sigma) < width, width, duration, floor)
            slow = self._minimise_slow(quick, "curvature", bounds, floor=floor, cap=cap)
            if _takes_at_least(slow, duration):
                return slow
        return self._slow_down(duration, quick, bounds, floor)

    def _slow_down(self, duration: float, quick: Speed, bounds: Bounds, floor: float) -> Speed | NoneFound:
        """Find a law that takes at least a duration [s], by least integrals of weights times z.

        The weights are z^(-3/2) of the last law, to which the change of T = integral of z^(-1/2) is
        proportional.
        """
        weights = np.ones(self.program.z.shape[0])
        for _ in range(MAX_SLOW_STEPS):
            slow = self._minimise_slow(quick, "slowness", bounds, floor=floor, weights=weights)
            if _takes_at_least(slow, duration):
                return slow
            if isinstance(slow, Unsolved):
                return NoneFound(self.program, slow.status)
            z = self.program.z @ slow.y
            weights = (z / z.max()) ** -1.5
        return self._refuse_duration(duration)

    def _refuse_duration(self, duration: float) -> NoneFound:
        """Return the result that no law takes so long."""
        return NoneFound(self.program, f"no law that takes {duration:.4g} s was found")

    def _improve(
        self,
        goal: str,
        law: Speed,
        quick: Speed,
        bounds: Bounds,
        floor: float,
        duration: float | None = None,
    ) -> Speed:
        """Lower the cost of a law at a duration [s], its own by default, by a tangent of T(z).

        Where the program has no solution, or one that is too quick all the same, the law itself is returned.
        """
        duration = duration or law.duration
        bounds = bounds._replace(longest=4.0 * duration)
        slow = self._minimise_slow(quick, goal, bounds, floor=floor, about=(law.y, duration))
        if _takes_at_least(slow, duration * (1.0 - BLENDED_DURATION)):
            return self._blend(quick, slow, duration)
        return law

    # -------------------------------------------------------------- energy at a duration

    def _find_smooth_of_little_energy(self, duration: float, similar: Speed | None) -> Speed | NoneFound:
        """Find a smooth law of little energy that takes a duration [s].

        The law of least energy may be quicker than the duration. Then the best of several laws that take it
        is improved. Last, the smoothest law within a share of that energy is slowed to the duration.

        Args:
            similar: a law of this duration, which is improved in place of the best of several.
        """
        limits = Bounds(share=self.bounds.share)
        quick, floor = self._solve_above_floor(limits._replace(longest=duration), "energy", similar)
        if isinstance(quick, NoneFound):
            return quick
        law = similar or quick
        least_duration = duration * (1.0 - SAME_DURATION)
        if law.duration < least_duration:
            starts = list(self._find_starts(quick, duration, floor))
            if not starts:
                return self._refuse_duration(duration)
            law = self._descend(min(starts, key=_energy_of), quick, floor)
        bounds = limits._replace(energy=(1.0 + self.share) * law.energy)
        smooth = self.program.minimise(
            "curvature", bounds._replace(longest=duration), self.units, floor=floor
        )
        if _takes_at_least(smooth, least_duration):
            return smooth
        return self._improve(
            "curvature", law, smooth if _takes_at_least(smooth, 0.0) else quick, bounds, floor
        )

    def _descend(self, law: Speed, quick: Speed, floor: float) -> Speed:
        """Lower the energy of a law step by step, as long as that pays.

        No law of its duration has less energy than the quick one.
        """
        for _ in range(MAX_ENERGY_STEPS):
            if law.energy <= (1.0 + 0.5 * self.share) * quick.energy:
                break
            better = self._improve("energy", law, quick, Bounds(share=self.bounds.share), floor)
            gain = law.energy - better.energy
            law = min(law, better, key=_energy_of)
            if gain < MIN_ENERGY_GAIN * law.energy:
                break
        return law

    def _find_starts(self, quick: Speed, duration: float, floor: float) -> Iterator[Speed]:
        """Find laws of a duration [s] that wait where holding is cheap, and the law of least peak."""
        limits = Bounds(share=self.bounds.share)
        for width in WAITING_WIDTHS:
            laws = []
            for waiting in self._choose_waits(width):
                cap = _cap_speed(waiting, width, duration, floor)
                slow = self.program.minimise("energy", limits, self.units, floor=floor, cap=cap)
                if _takes_at_least(slow, duration):
                    laws.append(self._blend(quick, slow, duration))
            yield from laws
            if laws:
                break
        of_peak = replace(self.program, problem=self.program.problem.with_goal("peak_torque"))
        least = solve_least_cost(of_peak)
        if not isinstance(least, NoneFound):
            search = SmoothSearch(of_peak, least.units, least.speed, self.share)
            law = search.find_lasting(duration)
            if isinstance(law, Speed) and law.duration >= duration * (1.0 - SAME_DURATION):
                yield law

    @property
    def _positive_sigma(self) -> Array:
        """The points sigma (m,) of the rows that keep z positive."""
        return self.program.problem.task.stretch.inverse(np.clip(self.program.positive[1], -1.0, 1.0))

    def _choose_waits(self, width: float) -> Iterator[BoolArray]:
        """Yield masks (m,) of stretches to wait: at the cheaper end, and where inside holding costs less.

        Holding costs the sum of (torque at rest over the reference)^2. Inside, its local minima count.
        """
        program = self.program
        sigma = self._positive_sigma
        points = program.problem.task.stretch.inverse(program.xi)
        torque_at_rest = [torque.offset[: len(points)] for torque in program.rows.torque]
        ratio = np.stack(torque_at_rest, axis=1) / program.problem.reference
        cost = np.interp(sigma, points, (ratio**2).sum(axis=1))
        yield sigma < width if cost[0] < cost[-1] else sigma > 1.0 - width
        minima = 1 + np.flatnonzero((cost[1:-1] <= cost[:-2]) & (cost[1:-1] <= cost[2:]))
        for k in minima[cost[minima] < MAX_INNER_COST * min(cost[0], cost[-1])]:
            yield np.abs(sigma - sigma[k]) < 0.5 * width


def _takes_at_least(law: Speed | Unsolved, duration: float) -> TypeGuard[Speed]:
    """Whether a law was found that takes at least a duration [s], and not forever."""
    return isinstance(law, Speed) and duration <= law.duration < np.inf


def _cap_speed(waiting: BoolArray, width: float, duration: float, floor: float) -> Array:
    """Return caps (m,) of z [1/s^2] with which a width in sigma takes longer than a duration [s].

    They are above the floor, and infinite where the law does not wait, outside the mask (m,).
    """
    return np.where(waiting, max((0.7 * width / duration) ** 2, 1.01 * floor), np.inf)


def _energy_of(speed: Speed) -> float:
    return speed.energy


def find_exceeded_places(program: SpeedProgram, speed: Speed, bounds: Bounds) -> Array:
    """Find xi (R,) between the points where a limit or the bound of the peak is exceeded.

    If any is, further ones where a limit is nearly reached are added: the next law would exceed it there. Of
    neighbouring ones only the local maxima are returned.
    """
    limit = program.problem.specification.torque_limit
    reference = program.problem.reference
    peak_bound = np.inf if bounds.peak is None else bounds.peak * (1.0 + LIMIT_MARGIN) * reference
    allowed = np.minimum(limit, peak_bound)
    used = program.rows.used_share(speed.y, allowed)[: len(program.xi)]  # at the points
    intervals = np.flatnonzero(np.maximum(used[1:], used[:-1]) > NEARLY_REACHED)
    if not len(intervals):
        return np.empty(0)
    between = (program.xi[intervals, None] + np.diff(program.xi)[intervals, None] * BETWEEN).ravel()
    distance = np.abs(between[:, None] - program.problem.crossing_xi).min(axis=1, initial=np.inf)
    between = between[distance > SAME_PLACE]
    rows = motor_rows(program.problem, program.basis, program.conditions, between)
    used = rows.used_share(speed.y, allowed)
    if not used.max(initial=0.0) > 1.0:
        return np.empty(0)
    padded = np.pad(used, 1, constant_values=-np.inf)
    highest = (used >= padded[:-2]) & (used >= padded[2:])
    return between[highest & (used > NEARLY_REACHED)]
