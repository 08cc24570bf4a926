"""The search for the smoothest law near the least cost, and for laws that take a given duration.

A law is a squared speed z = (d sigma/dt)^2 along the path's parameter sigma, with coefficients y. Its
duration is T(z) = integral of z^(-1/2). Laws come from cone programs (`speed_program`) with a lower bound of
z, the floor.

The smoothest law has the least integral of (d2z/dsigma2)^2. A required duration D may be longer than that of
the smoothest law. The constraint T(z) >= D is not convex, but T(z) is: its tangent T_lin at a slow law is
below T, so that laws with T_lin(z) >= D take D or longer. A blend of such a law with a quick one takes D
exactly.

Required times of crossings cut the path in stages, each with a duration, but for the last one if the end is
open. No blend meets several at once: programs with the tangents of all are solved until these touch the
durations.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from operator import attrgetter
from typing import Any, NamedTuple, TypeGuard

import numpy as np

from framework.errors import InvalidInput
from framework.numerics.arrays import Array, BoolArray
from framework.numerics.cone_program import Unsolved
from framework.planning.optimal.law_problem import motor_rows
from framework.planning.optimal.least_cost import NoneFound, cost_of, solve_least_cost
from framework.planning.optimal.speed_program import Bounds, Speed, SpeedProgram, Units
from framework.tolerances import LIMIT_MARGIN, SAME_PLACE, SQUARED_SPEED_FLOORS

SAME_DURATION = 1e-5  # relative difference of equal durations
BLENDED_DURATION = 1e-4  # share of a duration by which the tangent of T may fall short
# towards required instants: steps with the tangents of all stages; share of a duration by which the last law
# may differ, to be adjusted; share at which a law is near, but for its cost; of the least cost, tried next
MAX_SETTLING_STEPS, SETTLED_DURATION, NEARLY_SETTLED, TIMED_SHARE = 30, 1e-3, 2e-2, 0.1
# of descents at required instants: largest relative change of z in a step, its part after a failure and the
# least; relative gains of cost and of squared curvature that are worth a further step
FIRST_TRUST, TRUST_LEFT, LEAST_TRUST = 0.3, 0.3, 0.02
MIN_COST_GAIN, MIN_SMOOTHING = 3e-4, 0.1
# excess over a required duration that the first step admits; its part in each further one; part of its own
# excess that a step may leave: z^(-1/2) keeps up to 1 / sqrt(3) of it at the zero of its tangent
FIRST_SLACK, SLACK_LEFT, EXCESS_LEFT = 0.5, 0.5, 0.6
LOWER_FLOORS = np.array([1.0, 1e-2])  # over that of a quick law, of laws that wait
BLENDS = 65  # of a slow and a quick law that are compared
MAX_SLOW_STEPS = 6  # with the tangent of T(z), towards slow laws
MAX_INNER_COST = 0.9  # cost of holding the robot at an inner point over that at an end, to wait there
# of the least peak, tried in turn: between two ends in motion holding back costs more than a quicker law
LARGER_SHARES = (0.1, 0.3, 1.0, 4.0)
# in sigma, or of a stage, of the intervals where a law may wait; the second if the first fails
WAITING_WIDTHS = (0.15, 0.05)
LIFTED_SHARE = 1e-2  # of a quick law's z, below which a slow law counts as standing still
# places between two neighbouring points where limits are checked, as shares of their interval
PLACES_BETWEEN_POINTS = np.arange(1, 6) / 6
NEARLY_REACHED = 0.98  # ratio of a torque or squared speed to its limit; the next law may exceed it


class SmoothSearch(NamedTuple):
    """The search for a smooth law near the least cost of a program.

    program: the cone program, with rows at the points where limits are kept.
    units: units of time and torque in which its optimum is near 1.
    least: the speed of least cost.
    share: share of the least cost by which the cost of a smooth law may exceed it.
    limit_share: share of the limits that may be used; lowered if a certified motion exceeds a limit.
    duration_limit: longest duration [s] of a smooth law if none is required; None without a bound.
    """

    program: SpeedProgram
    units: Units
    least: Speed
    share: float
    limit_share: float = 1.0
    duration_limit: float | None = None

    @property
    def goal(self) -> str:
        return self.program.problem.specification.goal

    @property
    def least_cost(self) -> float:
        """The least cost; a duration by the quadrature of the program."""
        return self.least.least_duration if self.goal == "time" else cost_of(self.goal, self.least)

    @property
    def bounds(self) -> Bounds:
        """The bounds of a smooth law: the limits, and the least cost enlarged by the share for smoothness."""
        problem = self.program.problem
        specification = problem.specification
        cost_factor = 1.0 + self.share
        limit_share = self.limit_share * (1.0 - LIMIT_MARGIN)
        longest = specification.max_duration
        if self.goal == "time":  # the cost is the duration, by the program's quadrature
            longest = min(cost_factor * self.least.least_duration, longest or np.inf)
            return Bounds(problem.bound_stages(longest), share=limit_share)
        if longest is None:
            longest = self.duration_limit
        else:
            longest = min(longest * (1.0 - SAME_DURATION), self.duration_limit or np.inf)
        stages = problem.bound_stages(longest)
        if self.goal == "energy":
            return Bounds(stages, energy=cost_factor * self.least.energy, share=limit_share)
        # the cost of the other goals is the peak; a law within the torque limits stays within them
        largest_peak = cost_factor * self.least.peak
        if specification.limited and self.least.peak <= 1.0:
            largest_peak = min(largest_peak, 1.0)
        return Bounds(stages, self.limit_share * largest_peak, share=self.limit_share)

    def limit_duration(self) -> SmoothSearch:
        """Return the search for laws of at most twice the least duration, unless a duration is required."""
        specification = self.program.problem.specification
        if self.goal == "time" or specification.duration is not None:
            return self
        bounds = self.bounds._replace(longest=self.program.problem.bound_stages(None))
        quick = self.program.minimise("time", bounds, self.units)
        if isinstance(quick, Unsolved):
            return self
        last_stop = sum(specification.times[-1:])
        duration_limit = min(specification.longest or np.inf, last_stop + 2.0 * float(quick.durations[-1]))
        return self._replace(duration_limit=duration_limit, units=self.units._replace(time=duration_limit))

    def find_smooth(self, similar: Speed | None = None) -> tuple[SmoothSearch, Speed | NoneFound]:
        """Find a smooth law within the bounds, with the required instants, if any.

        Args:
            similar: the speed of a similar law.

        Returns:
            The search, with the least cost at the required instants where it had to be found, and the law.
        """
        duration = self.program.problem.specification.duration
        if similar is not None:  # with the costs of this program
            similar = self.program.evaluate_speed(similar.y, similar.x)._replace(floor=similar.floor)
        if self.program.problem.stops:
            return self._find_timed(similar)
        if duration is not None:
            return self, self.find_lasting(duration, similar)
        return self, self._solve_above_floor(self.bounds, similar=similar)[0]

    def find_lasting(self, duration: float, similar: Speed | None = None) -> Speed | NoneFound:
        """Find a smooth law within the bounds that takes a duration [s].

        If the smoothest law is too quick, a law of this duration is found by the tangent of the duration T(z)
        about the smoothest law, or else by a blend with a slow law. It is then improved by the tangent of
        T(z) about itself.

        Args:
            similar: a law of this duration, if one is known.
        """
        if self.goal == "energy":
            return self._find_smooth_of_little_energy(duration, similar)
        law = self._find_slowed(duration, similar)
        if self.goal != "time" and all(self.program.problem.specification.ends.moving):
            for share in LARGER_SHARES:
                if not isinstance(law, NoneFound):
                    break
                law = self._replace(share=share)._find_slowed(duration, similar)
        return law

    def _find_slowed(self, duration: float, similar: Speed | None) -> Speed | NoneFound:
        """Find a smooth law as `find_lasting`, within the peak of these bounds."""
        smooth, floor = self._solve_above_floor(self.bounds, similar=similar)
        if isinstance(smooth, NoneFound) or smooth.duration >= duration * (1.0 - 2.0 * SAME_DURATION):
            return smooth

        # the smoothest law is too quick: begin with the similar law, the smoothest law, or a slow law
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
        return self._improve("curvature", law, smooth, bounds, floor, duration)

    # -------------------------------------------------------------- required times of crossings

    def _find_timed(self, similar: Speed | None) -> tuple[SmoothSearch, Speed | NoneFound]:
        """Find a smooth law as `find_smooth` that passes all crossings at the required instants.

        The bounds count that no stage takes longer than required. If the smoothest law within them has too
        quick a stage, a law is settled whose stages take exactly what is required. Where this costs more,
        bounds of the cost are loosened, and the least cost of laws so settled replaces that of the bounds.

        Args:
            similar: a law with these instants, if one is known.
        """
        problem = self.program.problem
        own = self.bounds
        longest = own.longest
        if self.goal == "time":
            longest = problem.bound_stages(problem.specification.longest or 2.0 * self.least.least_duration)
        limits = Bounds(longest, share=own.share)
        if similar is not None:
            law = self._descend_at_instants(similar, "curvature", own)
            if law is not None:
                return self, law
        start = similar
        law = None
        for bounds in (own, self._replace(share=TIMED_SHARE).bounds, limits):
            quick, _floor = self._solve_above_floor(bounds, similar=similar)
            if isinstance(quick, Speed):
                start = self._settle_first(start, quick, bounds)
                law = self._adjust(start)
            elif self.goal == "time":
                return self, quick
            if law is not None:
                break
        if law is None:
            listed = ", ".join(f"{t:.4g}" for t in problem.specification.times)
            return self, NoneFound(self.program, f"no law that crosses at t = {listed} s was found")
        if bounds is own:
            return self, law
        best = self._descend_at_instants(law, self.goal, limits) or law
        search = self._replace(least=best._replace(least_duration=best.duration))
        return search, search._descend_at_instants(best, "curvature", search.bounds) or best

    def _descend_at_instants(self, law: Speed, goal: str, bounds: Bounds) -> Speed | None:
        """Lower the cost of a law with the required instants, in a trust region about each law.

        Args:
            law: the law; it may be beyond the bounds, so that the first step within them may cost more.
            goal: of `SpeedProgram.minimise`.
            bounds: the bounds; those of stages with a required duration do not count.
        """
        program = self.program
        bounds = self._bound_required(bounds, np.inf)
        best = None
        trust = FIRST_TRUST
        for _ in range(MAX_SETTLING_STEPS):
            z = program.positive_rows @ law.y
            floor, cap = np.maximum((1.0 - trust) * z, law.floor), (1.0 + trust) * z
            about = (law.y, program.problem.stages, True)
            found = program.minimise(goal, bounds, self.units, floor=floor, cap=cap, about=about)
            step = None
            if isinstance(found, Speed):
                step = self._adjust(found._replace(floor=law.floor), NEARLY_SETTLED)
            if step is not None and (best is None or self._is_gain(goal, step, law)):
                law = best = step
                continue
            trust *= TRUST_LEFT
            if trust < LEAST_TRUST:
                break
        return best

    def _is_gain(self, goal: str, step: Speed, law: Speed) -> bool:
        """Return whether a step costs so much less than a law that a further one is worth its program."""
        if goal == "curvature":
            rows = self.program.curvature.parts["y"]
            return bool(np.sum((rows @ step.y) ** 2) < (1.0 - MIN_SMOOTHING) * np.sum((rows @ law.y) ** 2))
        return cost_of(goal, step) < (1.0 - MIN_COST_GAIN) * cost_of(goal, law)

    def _adjust(self, law: Speed, allowed: float = SETTLED_DURATION) -> Speed | None:
        """Adjust a law that nearly has the required instants to these; None if it is farther off.

        Args:
            allowed: share of a stage's duration by which the law may be off.
        """
        program = self.program
        if self._mismatch(law) > allowed:
            return None
        try:
            y = program.space.adjust(law.y, program.conditions, program.problem.instants)
        except InvalidInput:  # z is nearly zero
            return None
        return program.evaluate_speed(y, law.x)._replace(floor=law.floor)

    def _bound_required(self, bounds: Bounds, excess: Array | float) -> Bounds:
        """Return bounds with those of required stages at a relative excess (m,) over these; inf for none."""
        stages = self.program.problem.stages
        longest = np.full(len(stages), np.inf) if bounds.longest is None else bounds.longest
        longest = np.where(np.isfinite(stages), (1.0 + excess) * stages, longest)
        return bounds._replace(longest=longest if np.isfinite(longest).any() else None)

    def _mismatch(self, law: Speed) -> float:
        """Return the largest relative error of a required stage's duration."""
        ratio = law.durations / self.program.problem.stages  # zero where open
        return float(np.abs(ratio - 1.0)[ratio > 0.0].max(initial=0.0))

    def _settle_first(self, similar: Speed | None, quick: Speed, bounds: Bounds) -> Speed:
        """Settle the smoothest law from several starts; return the first that is nearly settled, or the last.

        Other starts lead no nearer than that: the law misses the durations because it may not cost more.

        Args:
            similar: a law with the required instants, if one is known.
            quick: a law of which no stage takes longer than required.
            bounds: as of `_settle`.
        """
        law = quick
        if self._mismatch(quick) <= BLENDED_DURATION:  # its adjustment costs no more than that
            return quick
        for start in self._starts_of_stages(similar, quick, bounds):
            law = self._settle(start, bounds)
            if self._mismatch(law) <= NEARLY_SETTLED:
                break
        return law

    def _starts_of_stages(self, similar: Speed | None, quick: Speed, bounds: Bounds) -> Iterator[Speed]:
        """Yield laws from which stages may be settled: similar, quick, and waiting ones.

        Waiting ones wait in each stage, and are blended with the quick one. A tangent of T is nowhere above
        1.5 T, so that the one about a quick law may exclude what is required. A stage waits at its end at
        rest, or in its middle. The blend is the quickest without a stage quicker than required. Above a lower
        floor laws may wait for longer. The arguments are those of `_settle_first`.
        """
        problem = self.program.problem
        required = np.isfinite(problem.stages)
        stages = problem.stages[required]
        if similar is not None:
            yield similar
        if np.all(stages < 1.5 * quick.durations[required]):
            yield quick
        sigma = self._positive_sigma
        edges = np.array([0.0, *problem.stops, 1.0])
        is_moving = problem.specification.ends.moving
        places = 0.5 * (edges[:-1] + edges[1:])
        places[0] *= is_moving[0]
        places[-1] = places[-1] if is_moving[1] else 1.0
        fine_z, weights = self.program.fine_quadrature
        for floor, share in product(LOWER_FLOORS * quick.floor, WAITING_WIDTHS):
            widths = share * np.diff(edges)
            caps = [
                _cap_speed(np.abs(sigma - place) < width, width, stage, floor)
                for place, width, stage in zip(places[required], widths[required], stages, strict=True)
            ]
            waits = bounds._replace(longest=None)
            cap = np.min(caps, axis=0)
            slow = self.program.minimise("curvature", waits, self.units, floor=floor, cap=cap)
            if isinstance(slow, Unsolved) or not np.isfinite(slow.duration):
                continue
            shares = np.linspace(0.0, 1.0, BLENDS)
            z = np.outer(1.0 - shares, fine_z @ slow.y) + np.outer(shares, fine_z @ quick.y)  # (BLENDS, F)
            is_slow = np.all((z**-0.5 @ weights.T)[:, required] >= stages, axis=1)
            last = max(int(np.append(is_slow, False).argmin()) - 1, 0)
            y, x = (a + shares[last] * (b - a) for a, b in ((slow.y, quick.y), (slow.x, quick.x)))
            yield self.program.evaluate_speed(y, x)._replace(floor=floor)

    def _settle(self, law: Speed, bounds: Bounds) -> Speed:
        """Find a smooth law whose stages take what is required; return the nearest to that.

        Each program requires it of the tangents about the law before, which are below the durations. Where
        the excess of the durations then does not fall, as tangents may lead from one slow place to another,
        programs bound the durations themselves.

        Args:
            law: the first law, above whose floor others are sought.
            bounds: the bounds; those of stages with a required duration do not count.
        """
        program = self.program
        stages = program.problem.stages
        required = np.isfinite(stages)
        excess = np.abs(law.durations / stages - 1.0)  # (m,) 1 where open
        slack = FIRST_SLACK
        bounded = False  # whether programs bound the durations
        for _ in range(MAX_SETTLING_STEPS):
            allowed = np.maximum(EXCESS_LEFT * excess, max(slack, BLENDED_DURATION))
            found = program.minimise(
                "curvature",
                self._bound_required(bounds, allowed if bounded else np.inf),
                self.units,
                floor=law.floor,
                about=(law.y, stages, not bounded),
            )
            if isinstance(found, Unsolved) or not np.isfinite(found.duration):
                if bounded:
                    break
                bounded = True
                continue
            excess_found = np.abs(found.durations / stages - 1.0)
            if not bounded and np.any((excess_found > allowed)[required]):
                bounded = True
                continue
            law = found
            excess = excess_found
            slack *= SLACK_LEFT
            if self._mismatch(law) <= (2.0 * BLENDED_DURATION if bounded else SAME_DURATION):
                break
        return law

    # -------------------------------------------------------------- a required duration

    def _solve_above_floor(
        self, bounds: Bounds, goal: str = "curvature", similar: Speed | None = None
    ) -> tuple[Speed | NoneFound, float]:
        """Solve with a lower bound of z; return the law and this floor [1/s^2].

        The floors SQUARED_SPEED_FLOORS are tried in turn, the highest first, in units of
        1 / longest duration^2. With a similar law that has a floor, only the one nearest to its own is tried;
        if it has no solution, callers search again without the similar law. A series whose z dips below zero
        between the points ends the search: above a lower floor it would dip deeper.

        Args:
            bounds: bounds of duration, peak and energy.
            goal: of `SpeedProgram.minimise`.
            similar: the speed of a similar law, with its floor.
        """
        if bounds.longest is None:
            return NoneFound(self.program, "no duration was found"), 0.0
        status = ""
        floors = np.array(SQUARED_SPEED_FLOORS) / bounds.longest.sum() ** 2  # the highest first
        if similar is not None and similar.floor > 0.0:
            floors = floors[np.argmin(np.abs(np.log(floors / similar.floor)), keepdims=True)]
        for floor in floors:
            law = self.program.minimise(goal, bounds, self.units, floor=floor)
            if isinstance(law, Unsolved):
                status = law.status
            elif np.isfinite(law.duration):
                return law, floor
            else:
                return NoneFound(self.program, "z is not positive"), 0.0
        return NoneFound(self.program, status), 0.0

    def _blend(self, quick: Speed, slow: Speed, duration: float) -> Speed:
        """Blend a quick and a slow speed to a duration [s]; return the slow one if that is not between."""
        if not quick.duration < duration < slow.duration:
            return slow
        y = self.program.space.blend(quick.y, slow.y, duration)
        direction = quick.y - slow.y
        share = (y - slow.y) @ direction / (direction @ direction)
        blend = self.program.evaluate_speed(y, slow.x + share * (quick.x - slow.x))
        return blend._replace(floor=min(quick.floor, slow.floor))

    def _minimise_slow(self, quick: Speed, goal: str, bounds: Bounds, **options: Any) -> Speed | Unsolved:
        """Find a slow law of least cost, with `options` of `SpeedProgram.minimise`.

        A law that stands still between the points is blended with a quick law, so that its z is at least
        LIFTED_SHARE of the quick law's.

        Args:
            quick: a quick law, whose z is positive everywhere.
            goal: goal of `SpeedProgram.minimise`.
            bounds: bounds of duration, peak and energy.
        """
        slow = self.program.minimise(goal, bounds, self.units, **options)
        if isinstance(slow, Unsolved) or np.isfinite(slow.duration):
            return slow
        values, _weights = self.program.fine_quadrature
        z = values @ slow.y
        z_quick = values @ quick.y
        # the share of the quick law in the blend at which z is LIFTED_SHARE z_quick, at each point
        share = (LIFTED_SHARE * z_quick - z) / (z_quick - z)
        largest_share = share[z < LIFTED_SHARE * z_quick].max()
        y = slow.y + largest_share * (quick.y - slow.y)
        x = slow.x + largest_share * (quick.x - slow.x)
        return self.program.evaluate_speed(y, x)._replace(floor=slow.floor)

    def _find_slow(self, duration: float, quick: Speed, bounds: Bounds, floor: float) -> Speed | NoneFound:
        """Find a law that takes at least a duration [s], if possible smooth and waiting at its ends.

        Between two ends in motion it waits in the middle of the longest gap between crossings.

        Args:
            quick: a law that is too quick.
            bounds: bounds of duration, peak and energy.
            floor: lower bound of z [1/s^2].
        """
        sigma = self._positive_sigma
        problem = self.program.problem
        is_at_rest = ~np.array(problem.specification.ends.moving)
        places = np.array([0.0, 1.0])[is_at_rest]
        if not len(places):
            stops = np.unique([0.0, *problem.crossings, 1.0])
            longest = np.diff(stops).argmax()
            places = 0.5 * (stops[[longest]] + stops[[longest + 1]])
        distance = np.abs(sigma[:, None] - places).min(axis=1)
        for width in WAITING_WIDTHS:
            cap = _cap_speed(distance < width, width, duration, floor)
            slow = self._minimise_slow(quick, "curvature", bounds, floor=floor, cap=cap)
            if _takes_at_least(slow, duration):
                return slow
        return self._slow_down(duration, quick, bounds, floor)

    def _slow_down(self, duration: float, quick: Speed, bounds: Bounds, floor: float) -> Speed | NoneFound:
        """Find a law that takes at least a duration [s] by minimising integrals of weights times z.

        The weights are z^(-3/2) of the last law. The derivative of the duration T = integral of z^(-1/2) is
        proportional to them, so each law is slower than the last one. At first they are 1.

        Args:
            quick: a law that is too quick.
            bounds: bounds of duration, peak and energy.
            floor: lower bound of z [1/s^2].
        """
        weights = np.ones(self.program.z.shape[0])
        for _ in range(MAX_SLOW_STEPS):
            slow = self._minimise_slow(quick, "slowness", bounds, floor=floor, weights=weights)
            if _takes_at_least(slow, duration):
                return slow
            if isinstance(slow, Unsolved):
                return NoneFound(self.program, slow.status)
            z = self.program.z @ slow.y
            weights = (z / z.max()) ** -1.5  # at least 1
        return self._refuse_duration(duration)

    def _refuse_duration(self, duration: float) -> NoneFound:
        """Return the result that no law of a duration [s] was found."""
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
        """Lower the cost of a law at a duration [s] by the tangent of T(z) at this law.

        The law itself is returned if the program has no solution, or one that is too quick all the same.

        Args:
            goal: "curvature" or "energy".
            quick: a quicker law; a solution that is too slow is blended with it to the duration.
            bounds: bounds of duration, peak and energy.
            floor: lower bound of z [1/s^2].
            duration: by default that of the law.
        """
        duration = duration or law.duration
        bounds = bounds._replace(longest=np.array([4.0 * duration]))  # far above what a solution takes
        about = (law.y, np.array([duration]), False)
        slow = self._minimise_slow(quick, goal, bounds, floor=floor, about=about)
        if _takes_at_least(slow, duration * (1.0 - BLENDED_DURATION)):
            return self._blend(quick, slow, duration)
        return law

    # -------------------------------------------------------------- energy at a duration

    def _find_smooth_of_little_energy(self, duration: float, similar: Speed | None) -> Speed | NoneFound:
        """Find a smooth law of little energy that takes a duration [s].

        If the law of least energy is quicker than the duration, the best of several laws of this duration is
        improved. Finally, the smoothest law within a share of this energy is slowed to the duration.

        Args:
            similar: a law of this duration, which takes the place of the law of least energy.
        """
        limits = Bounds(share=self.bounds.share)  # without a bound of duration, peak or energy
        quick, floor = self._solve_above_floor(
            limits._replace(longest=np.array([duration])), "energy", similar
        )
        if isinstance(quick, NoneFound):
            return quick
        law = similar or quick
        least_duration = duration * (1.0 - SAME_DURATION)
        if law.duration < least_duration:
            starts = list(self._find_starts(quick, duration, floor))
            if not starts:
                return self._refuse_duration(duration)
            law = min(starts, key=attrgetter("energy"))
            if law.energy > (1.0 + 0.5 * self.share) * quick.energy:  # smoothness adds `share` of it anyway
                law = self._descend_at_instants(law, "energy", limits) or law

        # the smoothest law within a share of this energy
        bounds = Bounds(np.array([duration]), energy=(1.0 + self.share) * law.energy, share=limits.share)
        smooth = self.program.minimise("curvature", bounds, self.units, floor=floor)
        if _takes_at_least(smooth, least_duration):
            return smooth
        if _takes_at_least(smooth, 0.0):  # a law, though a quicker one
            quick = smooth
        smooth = self._improve("curvature", law, quick, bounds, floor)
        if similar is not None and smooth is similar:
            return self._find_smooth_of_little_energy(duration, None)
        return smooth

    def _find_starts(self, quick: Speed, duration: float, floor: float) -> Iterator[Speed]:
        """Yield laws of a duration [s]: laws that wait where holding is cheap, and the law of least peak.

        Args:
            quick: the law of least energy, which is quicker.
            floor: lower bound of z [1/s^2].
        """
        limits = Bounds(share=self.bounds.share)
        for width in WAITING_WIDTHS:
            laws = []
            for waits in self._choose_waits(width):
                cap = _cap_speed(waits, width, duration, floor)
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
        return self.program.problem.task.stretch.inverse(np.clip(self.program.positive_xi, -1.0, 1.0))

    def _choose_waits(self, width: float) -> Iterator[BoolArray]:
        """Yield masks (m,) of intervals to wait in: at the cheaper end, and at cheap points inside the path.

        The cost of holding is the sum of (torque at rest over the reference)^2. Inside the path, its local
        minima are candidates.

        Args:
            width: width of the intervals, in sigma.
        """
        sigma = self._positive_sigma
        cost = self._holding_cost(sigma)
        yield sigma < width if cost[0] < cost[-1] else sigma > 1.0 - width
        inner_cost = cost[1:-1]
        is_minimum = (inner_cost <= cost[:-2]) & (inner_cost <= cost[2:])
        is_cheap = inner_cost < MAX_INNER_COST * min(cost[0], cost[-1])
        for middle in sigma[1:-1][is_minimum & is_cheap]:
            yield np.abs(sigma - middle) < 0.5 * width

    def _holding_cost(self, sigma: Array) -> Array:
        """Interpolate the sum of (torque at rest over the reference)^2 at sigma (m,).

        Args:
            sigma: points of the path.
        """
        program = self.program
        points = program.problem.task.stretch.inverse(program.xi)  # sigma (M,)
        torque_at_rest = [torque.offset[: len(points)] for torque in program.rows.torque]  # where z = u = 0
        ratio = np.stack(torque_at_rest, axis=1) / program.problem.reference
        return np.interp(sigma, points, (ratio**2).sum(axis=1))


def _takes_at_least(law: Speed | Unsolved, duration: float) -> TypeGuard[Speed]:
    """Return whether a law was found that takes at least a duration [s], and not infinitely long."""
    return isinstance(law, Speed) and duration <= law.duration < np.inf


def _cap_speed(waits: BoolArray, width: float, duration: float, floor: float) -> Array:
    """Return caps (m,) of z [1/s^2] with which an interval in sigma takes longer than a duration [s].

    At the constant speed width / duration the interval takes exactly the duration. The cap is 0.7 of this
    speed, so that the interval takes even longer. Caps are 1 % above the floor, so that the program has a
    solution. They are infinite where the law does not wait.

    Args:
        waits: mask (m,) of the interval.
        width: width of the interval, in sigma.
        duration: [s].
        floor: lower bound of z [1/s^2].
    """
    highest = max((0.7 * width / duration) ** 2, 1.01 * floor)
    return np.where(waits, highest, np.inf)


def find_exceeded_places(program: SpeedProgram, speed: Speed, bounds: Bounds) -> Array:
    """Find xi (R,) between the points at which a limit or the peak bound is exceeded.

    Only intervals beside a point that nearly reaches a limit are searched. If a limit is exceeded anywhere,
    local maxima that nearly reach one are added, since the next law would exceed the limit there.

    Args:
        program: the program, whose rows keep the limits at its points.
        speed: its solution.
        bounds: the bounds of this solution.
    """
    problem = program.problem
    allowed = problem.specification.torque_limit  # (n_a,) [N m]
    if bounds.peak is not None:
        # what the torque may reach between points, beyond the bound at the points
        allowed = np.minimum(allowed, bounds.peak * (1.0 + LIMIT_MARGIN) * problem.reference)

    # intervals with a large ratio to a limit at one of their ends; the first rows are those of the points
    ratio_at_points = program.rows.largest_limit_ratio(speed.y, speed.x, allowed)[: len(program.xi)]
    intervals = np.flatnonzero(np.maximum(ratio_at_points[1:], ratio_at_points[:-1]) > NEARLY_REACHED)
    if not len(intervals):
        return np.empty(0)
    starts = program.xi[intervals, None]
    widths = np.diff(program.xi)[intervals, None]
    xi = (starts + widths * PLACES_BETWEEN_POINTS).ravel()

    # rows cannot be computed on a crossing, where torques are 0 / 0
    distance = np.abs(xi[:, None] - problem.crossing_xi).min(axis=1, initial=np.inf)
    xi = xi[distance > SAME_PLACE]
    rows = motor_rows(problem, program.basis, program.conditions, xi, program.frames)
    ratio = rows.largest_limit_ratio(speed.y, speed.x, allowed)
    if not ratio.max(initial=0.0) > 1.0:
        return np.empty(0)
    padded = np.pad(ratio, 1, constant_values=-np.inf)
    is_maximum = (ratio >= padded[:-2]) & (ratio >= padded[2:])
    # internal torques give way at other places, and their rows are many
    nearly_reached = NEARLY_REACHED if program.frames is None else 1.0
    return xi[is_maximum & (ratio > nearly_reached)]
