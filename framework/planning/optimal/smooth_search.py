"""The search for the smoothest law near the least cost, and for laws with required durations.

A law is a squared speed z = (d sigma/dt)^2 along the path's parameter sigma, with coefficients y. Its
duration is T(z) = integral of z^(-1/2). Laws come from cone programs (`speed_program`) with a lower bound of
z, the floor. The smoothest law has the least integral of (d2z/dsigma2)^2.

Required instants, of crossings and of the end, cut the path in stages, each with a duration, but for the last
one if the end is open. The constraint T(z) >= D of a stage is not convex, but T(z) is: its tangent T_lin at a
slow law is below T, so that laws with T_lin(z) >= D take D or longer. A blend of such a law with a quick one
takes D exactly in one stage; with several, programs with the tangents of all are solved until these touch the
durations.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain, pairwise, product, tee
from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput
from framework.numerics.arrays import Array, BoolArray
from framework.numerics.cone_program import Unsolved
from framework.planning.optimal.law_problem import motor_rows
from framework.planning.optimal.least_cost import NoneFound, cost_of
from framework.planning.optimal.speed_program import Bounds, Speed, SpeedProgram, Units
from framework.tolerances import LIMIT_MARGIN, SAME_PLACE, SQUARED_SPEED_FLOORS

SAME_DURATION = 1e-5  # relative difference of equal durations
BLENDED_DURATION = 1e-4  # share of a duration that an adjustment changes at hardly any cost
# towards required instants: steps with the tangents of all stages; share of a duration by which the last law
# may differ, to be adjusted; share at which a law is near, but for its cost
MAX_SETTLING_STEPS, SETTLED_DURATION, NEARLY_SETTLED = 30, 1e-3, 2e-2
# of descents at required instants: largest relative change of z in a step, its part after a failure and the
# least; relative gains of cost and of squared curvature that are worth a further step
FIRST_TRUST, TRUST_LEFT, LEAST_TRUST = 0.3, 0.3, 0.02
MIN_COST_GAIN, MIN_SMOOTHING = 3e-4, 0.1
# excess over a required duration that the first step admits; its part in each further one; part of its own
# excess that a step may leave: z^(-1/2) keeps up to 1 / sqrt(3) of it at the zero of its tangent
FIRST_SLACK, SLACK_LEFT, EXCESS_LEFT = 0.5, 0.5, 0.6
LOWER_FLOORS = np.array([1.0, 1e-2])  # over that of a quick law, of laws that wait
LONGER_STEP = 1.4  # of a stage's duration in a step, by the tangent of T(z)
MAX_QUICK_RATIO = 4.0  # of a required duration to that of a quick law from which others are settled
MAX_BLEND_STEPS = 60  # of Newton's method, which converges from any distance on the slow side
MAX_INNER_COST = 0.9  # cost of holding the robot at an inner point over that at an end, to wait there
# in sigma, or of a stage, of the intervals where a law may wait; the second if the first fails
WAITING_WIDTHS = (0.15, 0.05)
LIFTED_SHARE = 1e-2  # of a quick law's z, below which a slow law counts as standing still
# places between two neighbouring points where limits are checked, as shares of their interval
PLACES_BETWEEN_POINTS = np.arange(1, 6) / 6
LEAST_DISTANCE = 0.1  # of a further point from the others, over that of two places
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

    def find_smooth(
        self, similar: Speed | None = None, *, is_least_known: bool = True
    ) -> tuple[SmoothSearch, Speed | NoneFound]:
        """Find a smooth law within the bounds, with the required instants, if any.

        Args:
            is_least_known: whether the least cost counts all rows of the program. If not, it may be too low
                for any law within the bounds, and is not raised here for the required instants.

        Returns:
            The search, with the least cost at the required instants where it had to be found, and the law.
        """
        if similar is not None:  # with the costs of this program
            similar = self.program.evaluate_speed(similar.y, similar.x)._replace(floor=similar.floor)
        own = self.bounds
        problem = self.program.problem
        if not np.isfinite(problem.stages).any():
            return self, self._solve_above_floor(own, similar=similar)
        own_starts, starts = tee(self._find_similar(similar))
        law = self._settle_within(own, own_starts, similar)
        if isinstance(law, Speed) or not is_least_known:
            return self, law

        # the required durations cost more than the least: find the least that they cost
        longest = own.longest
        if self.goal == "time":
            longest = problem.bound_stages(problem.specification.longest or 2.0 * self.least.least_duration)
        limits = Bounds(longest, share=own.share)
        law = self._settle_within(limits, starts, similar, self.goal)
        if isinstance(law, NoneFound):
            return self, law
        best = self._descend(law, self.goal, limits) or law
        search = self._replace(least=best._replace(least_duration=best.duration))
        smooth = search._settle_within(search.bounds, [best])
        return search, smooth if isinstance(smooth, Speed) else best

    def _find_similar(self, similar: Speed | None) -> Iterator[Speed]:
        """Yield a similar law, if any, and the one that meets the last required instant alone."""
        if similar is not None:
            yield similar
        problem = self.program.problem
        if problem.stops:  # it may nearly meet the others
            without_stops = problem.with_goal(self.goal, times=())._replace(stops=())
            _, law = self._replace(program=replace(self.program, problem=without_stops)).find_smooth()
            if isinstance(law, Speed):
                yield self.program.evaluate_speed(law.y, law.x)._replace(floor=law.floor)

    def _settle_within(
        self,
        bounds: Bounds,
        starts: Iterable[Speed],
        similar: Speed | None = None,
        goal: str = "curvature",
    ) -> Speed | NoneFound:
        """Find a law of least cost within bounds whose stages take what is required.

        It is settled from the first start, of those given and then of quick and waiting laws, from which one
        is found, or is the best of those from laws that wait in intervals of the same width.
        """
        quick = self._solve_above_floor(bounds, goal, similar)
        if isinstance(quick, NoneFound) and similar is not None:  # above another floor there may be one
            quick = self._solve_above_floor(bounds, goal)
        if isinstance(quick, NoneFound):
            return quick
        law = self.adjust(quick, BLENDED_DURATION)  # which costs no more than that
        if law is not None:
            return law
        for group in chain(([start] for start in starts), self._find_starts(quick, bounds, goal)):
            laws = list[Speed]()
            for start in group:
                for settled_goal in dict.fromkeys((goal, "curvature")):  # if the first fails, the second
                    settled = self._settle(start, quick, bounds, settled_goal)
                    law = self.adjust(settled)
                    if law is not None:
                        laws.append(law)
                        break
            if laws:
                return laws[0] if goal == "curvature" else min(laws, key=lambda law: cost_of(goal, law))
            # other starts lead no nearer: the law misses the durations because it may not cost more
            if goal == "curvature" and group and self._mismatch(settled) <= NEARLY_SETTLED:
                break
        listed = ", ".join(f"{t:.4g}" for t in self.program.problem.instants.times)
        return NoneFound(self.program, f"no law that passes at t = {listed} s was found")

    def _descend(self, law: Speed, goal: str, bounds: Bounds) -> Speed | None:
        """Lower the cost of a law with the required instants; None if no step is found.

        A step changes z = (d sigma/dt)^2 by at most the share `trust`, and keeps the required durations to
        first order. The law may be beyond the bounds: the first step may cost more. A step is then adjusted
        to have these exactly. Steps that gain too little are made smaller.
        """
        program = self.program
        bounds = self._bound_required(bounds, np.inf)
        best = None
        trust = FIRST_TRUST
        for _ in range(MAX_SETTLING_STEPS):
            z = program.positive_rows @ law.y
            floor, cap = np.maximum((1.0 - trust) * z, law.floor), (1.0 + trust) * z
            # True: the durations of the stages, linearised about y, equal the required ones
            tangents = (law.y, program.problem.stages, True)
            found = program.minimise(goal, bounds, self.units, floor=floor, cap=cap, about=tangents)
            step = None
            if isinstance(found, Speed):
                step = self.adjust(found._replace(floor=law.floor), NEARLY_SETTLED)
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

    def adjust(self, law: Speed, allowed: float = SETTLED_DURATION) -> Speed | None:
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

    def _bound_required(self, bounds: Bounds, required: Array | float) -> Bounds:
        """Return bounds with those of required stages replaced by durations (m,) [s]; inf for none."""
        stages = self.program.problem.stages
        longest = np.full(len(stages), np.inf) if bounds.longest is None else bounds.longest
        longest = np.where(np.isfinite(stages), required, longest)
        return bounds._replace(longest=longest if np.isfinite(longest).any() else None)

    def _mismatch(self, law: Speed) -> float:
        """Return the largest relative error of a required stage's duration."""
        ratio = law.durations / self.program.problem.stages  # zero where open
        return float(np.abs(ratio - 1.0)[ratio > 0.0].max(initial=0.0))

    def _find_starts(self, quick: Speed, bounds: Bounds, goal: str) -> Iterator[list[Speed]]:
        """Yield groups of laws from which stages may be settled: the quick one, and waiting ones.

        Those of a group wait in intervals of the same width, with the least cost, and are blended with the
        quick one. Above a lower floor laws may wait for longer.
        """
        required = np.isfinite(self.program.problem.stages)
        stages = self.program.problem.stages[required]
        lengths = np.diff([0.0, *self.program.problem.stops, 1.0])[required]  # in sigma
        # settled from a quick law, others find no cheaper place to wait
        is_quick_near = goal == "curvature" and np.all(stages < MAX_QUICK_RATIO * quick.durations[required])
        if is_quick_near:
            yield [quick]
        waiting = bounds._replace(longest=None)
        for floor, width in product(LOWER_FLOORS * quick.floor, WAITING_WIDTHS):
            if not is_quick_near and (floor, width) == (LOWER_FLOORS[1] * quick.floor, WAITING_WIDTHS[0]):
                yield [quick]
            laws = list[Speed]()
            for waits in self._choose_waits(width, goal):
                # at a constant speed of 0.7 of that with which a wait takes the whole stage
                highest = np.maximum((0.7 * width * lengths / stages) ** 2, 1.01 * floor)  # (m,) [1/s^2]
                cap = np.where(waits, highest[:, None], np.inf).min(axis=0)
                slow = self.program.minimise(goal, waiting, self.units, floor=floor, cap=cap)
                if isinstance(slow, Speed):
                    laws.append(self._blend(quick, slow)._replace(floor=floor))
            yield laws

    def _settle(self, law: Speed, quick: Speed, bounds: Bounds, goal: str) -> Speed:
        """Find a law of least cost whose stages take what is required; return the nearest to that.

        Each program requires it of the tangents about the law before, which are below the durations, or, as a
        tangent of T is nowhere above 1.5 T, LONGER_STEP times what a stage takes. A single stage that then
        takes too long is blended with the quick law, of which no stage takes longer than required. Where the
        excess of several does not fall, as tangents may lead from one slow place to another, programs bound
        the durations themselves.
        """
        program = self.program
        stages = program.problem.stages
        required = np.isfinite(stages)
        excess = np.minimum(np.abs(law.durations / stages - 1.0), 1.0)  # (m,) 1 where open
        slack = FIRST_SLACK
        bounded = False  # whether programs bound the durations
        overshoot = None  # the last step of too much excess
        for _ in range(MAX_SETTLING_STEPS):
            targets = np.where(required, np.minimum(stages, LONGER_STEP * law.durations), np.inf)
            allowed = np.maximum(EXCESS_LEFT * excess, max(slack, BLENDED_DURATION))
            step = program.minimise(
                goal,
                self._bound_required(bounds, (1.0 + allowed) * targets if bounded else np.inf),
                self.units,
                floor=law.floor,
                about=(law.y, targets, not bounded),
            )
            if isinstance(step, Speed):
                step = self._blend(quick, step)
                over, under = step.durations / stages - 1.0, 1.0 - step.durations / targets
                excess_left = np.maximum(over, under)
                if np.isfinite(step.duration) and (bounded or np.all((excess_left <= allowed)[required])):
                    is_gain = self._is_gain(goal, step, law)
                    law = step
                    excess = excess_left
                    slack *= SLACK_LEFT if np.all(targets[required] == stages[required]) else 1.0
                    is_near = self._mismatch(law) <= (2.0 * BLENDED_DURATION if bounded else SAME_DURATION)
                    if is_near and not is_gain:
                        break
                    continue
                overshoot = step if np.isfinite(step.duration) else None
            if bounded and overshoot is None:
                break
            if bounded and overshoot is not None:  # no law is between
                law, overshoot = overshoot, None
                excess = np.minimum(np.abs(law.durations / stages - 1.0), 1.0)
            bounded = not bounded
        return law

    def _blend(self, quick: Speed, slow: Speed) -> Speed:
        """Blend a slow law with a quick one, to the quickest without a stage quicker than required.

        The law is y = slow + share (quick - slow). Its durations are convex functions of the share, so that
        Newton's method from a small share approaches the first of them that is met from the slow side. A law
        that stands still is first blended so that its z is at least LIFTED_SHARE of the quick law's.

        Args:
            quick: a law of which no stage takes longer than required, with a positive z.
            slow: a law of which no stage takes less; any other law is returned.
        """
        stages = self.program.problem.stages
        required = np.isfinite(stages)
        if np.any(slow.durations[required] < stages[required]):
            return slow
        fine_z, weights = self.program.fine_quadrature
        z_slow, z_quick = fine_z @ slow.y, fine_z @ quick.y  # (F,)
        direction = z_quick - z_slow
        lowest = LIFTED_SHARE * z_quick
        is_low = z_slow < lowest if not np.isfinite(slow.duration) else z_slow <= 0.0
        share = float(((lowest - z_slow)[is_low] / direction[is_low]).max(initial=0.0))
        for _ in range(MAX_BLEND_STEPS):
            z = z_slow + share * direction
            durations = weights[required] @ z**-0.5
            falls = 0.5 * weights[required] @ (z**-1.5 * direction)  # by the share
            with np.errstate(divide="ignore", invalid="ignore"):
                step = np.where(falls > 0.0, (durations - stages[required]) / falls, np.inf).min()
            if not 0.0 < step < np.inf:
                break
            share = min(share + step, 1.0)
            if step <= np.finfo(float).eps:
                break
        y, x = (a + share * (b - a) for a, b in ((slow.y, quick.y), (slow.x, quick.x)))
        return self.program.evaluate_speed(y, x)._replace(floor=min(quick.floor, slow.floor))

    def _solve_above_floor(
        self, bounds: Bounds, goal: str = "curvature", similar: Speed | None = None
    ) -> Speed | NoneFound:
        """Solve with a lower bound of z, the floor of the law [1/s^2].

        The floors SQUARED_SPEED_FLOORS are tried in turn, the highest first, in units of
        1 / longest duration^2. With a similar law that has a floor, only the one nearest to its own is tried;
        if it has no solution, callers search again without the similar law. A series whose z dips below zero
        between the points ends the search: above a lower floor it would dip deeper.
        """
        if bounds.longest is None:
            return NoneFound(self.program, "no duration was found")
        status = ""
        floors = np.array(SQUARED_SPEED_FLOORS) / bounds.longest.sum() ** 2  # the highest first
        if similar is not None and similar.floor > 0.0:
            floors = floors[np.argmin(np.abs(np.log(floors / similar.floor)), keepdims=True)]
        for floor in floors:
            law = self.program.minimise(goal, bounds, self.units, floor=floor)
            if isinstance(law, Unsolved):
                status = law.status
            elif np.isfinite(law.duration):
                return law
            else:
                return NoneFound(self.program, "z is not positive")
        return NoneFound(self.program, status)

    def _choose_waits(self, width: float, goal: str) -> Iterator[BoolArray]:
        """Yield masks (m, points) of intervals, `width` of each required stage, in which a law may wait.

        For a smooth law a stage waits at its ends at rest, if it has any; else in the middle of its longest
        gap between crossings. For another goal it waits at the end at which holding is cheaper, and then
        where it is even cheaper inside: at local minima of the sum of (torque at rest over the reference)^2.
        """
        problem = self.program.problem
        positive_xi = np.clip(self.program.positive_xi, -1.0, 1.0)
        sigma = problem.task.stretch.inverse(positive_xi)  # (points,)
        # the sum of (torque at rest over the reference)^2; torques at rest are offsets, as z = u = 0, and the
        # first M rows of the program are at its points
        points = problem.task.stretch.inverse(self.program.xi)  # sigma (M,)
        at_rest = [torque.offset[: len(points)] for torque in self.program.rows.torque]  # (M,) of each motor
        ratio = np.stack(at_rest, axis=1) / problem.reference  # (M, n_a)
        cost = np.interp(sigma, points, (ratio**2).sum(axis=1))  # (points,)
        is_minimum = np.pad((cost[1:-1] <= cost[:-2]) & (cost[1:-1] <= cost[2:]), 1)
        edges = np.array([0.0, *problem.stops, 1.0])
        resting_ends = np.array([0.0, 1.0])[~np.array(problem.specification.ends.moving)]
        masks = list[list[BoolArray]]()  # of each stage, one after the other
        for start, end in pairwise(edges[: 1 + np.isfinite(problem.stages).sum()]):
            reach = width * (end - start)
            resting = resting_ends[(resting_ends == start) | (resting_ends == end)]
            if goal != "curvature" and len(resting) > 1:
                resting = resting[[np.argmin(cost[[0, -1]])]]
            if not len(resting):
                between = problem.crossings[(start < problem.crossings) & (problem.crossings < end)]
                gaps = np.unique([start, *between, end])
                longest = np.diff(gaps).argmax()
                middle = 0.5 * (gaps[longest] + gaps[longest + 1])
                masks.append([np.abs(sigma - middle) < 0.5 * reach])
                continue
            stage_masks = [np.abs(sigma[:, None] - resting).min(axis=1) < reach]
            if goal != "curvature":
                is_cheap = is_minimum & (cost < MAX_INNER_COST * cost[stage_masks[0]].min())
                is_cheap &= (start < sigma) & (sigma < end)
                stage_masks += [np.abs(sigma - place) < 0.5 * reach for place in sigma[is_cheap]]
            masks.append(stage_masks)
        for k in range(max(map(len, masks))):
            yield np.array([each[min(k, len(each) - 1)] for each in masks])


def find_exceeded_places(program: SpeedProgram, speed: Speed, bounds: Bounds) -> Array:
    """Find xi (R,) between the points at which a limit or the peak bound is exceeded.

    Only intervals beside a point that nearly reaches a limit are searched. If a limit is exceeded anywhere,
    local maxima that nearly reach one are added, since the next law would exceed the limit there.
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

    # internal torques give way at other places, and their rows are many
    nearly_reached = NEARLY_REACHED if program.frames is None else 1.0
    if not problem.task.robot.n_e:
        padded = np.pad(ratio, 1, constant_values=-np.inf)
        is_maximum = (ratio >= padded[:-2]) & (ratio >= padded[2:])
        return xi[is_maximum & (ratio > nearly_reached)]
    # torques of elastic robots peak more sharply, 1e-3 above all places: rows at the vertices of parabolas
    # through three places or points
    worst_place = xi[[ratio.argmax()]]
    ends = np.unique([intervals, intervals + 1])
    xi, ratio = np.append(xi, program.xi[ends]), np.append(ratio, ratio_at_points[ends])
    order = xi.argsort()
    xi, ratio = xi[order], ratio[order]  # (R,)
    step, change = np.diff(xi), np.diff(ratio)  # (R - 1,)
    rise, fall = change[:-1], -change[1:]  # to each place and from it, (R - 2,)
    is_maximum = (rise >= 0.0) & (fall >= 0.0) & (rise + fall > 0.0)
    chosen = np.flatnonzero(is_maximum & (ratio[1:-1] > nearly_reached))
    step_to, step_from, rise, fall = step[chosen], step[chosen + 1], rise[chosen], fall[chosen]
    curvature = step_from * rise + step_to * fall
    vertices = xi[chosen + 1] + 0.5 * (step_from**2 * rise - step_to**2 * fall) / curvature
    taken = np.concatenate([program.xi, problem.crossing_xi, program.further_xi])
    distance = np.abs(vertices[:, None] - taken).min(axis=1)
    vertices = vertices[distance > LEAST_DISTANCE * np.minimum(step_to, step_from)]
    return vertices if len(vertices) else worst_place
