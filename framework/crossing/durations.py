"""The longest and the shortest duration along a path for each kind of law, before a law is sought.

The polynomial of least degree is affine in the values that it passes through. Over t/T condition (8) asks for
s" = -(beta v^2 + gamma T^2)/alpha, v = s' T, which is affine in T^2. So for given t_k/T and v_k the durations
T at which the polynomial always advances are an interval in closed form, and only t_k/T and v_k are searched
for.

If a law of free shape exists, slower ones exist without bound: the squared speeds z that meet condition (8)
and the limits are a convex set, and near an end of the path, where a smooth law needs little more than the
weight, z may be scaled by a factor close to zero. Without limits quicker ones exist, too, since condition (8)
concerns z and z' at the crossing alone. The degrees tried may not resolve such a law: far beyond the pace it
is a sharp sprint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.crossing.crossing_points import PathToCross
from framework.crossing.feasibility import Feasibility, feasibility_on_path
from framework.crossing.optimal.optimal_task import Task
from framework.crossing.optimal.undeformed_law import find_undeformed_law
from framework.crossing.refusals.uncrossable_points import stops_at
from framework.crossing.request import Request
from framework.crossing.specification import specification_of
from framework.crossing.timing import MIN_SEPARATION
from framework.errors import InvalidInput, NoLaw, NotConverged
from framework.motion.law import Law, conditions_at_instants
from framework.motion.optimal_law import HIGHEST_SMOOTHNESS
from framework.singularity.points_on_path import SearchedPath

CRUISING_SPEEDS = (1.0, 1.3, 1.6, 2.0)  # s' T from which the search starts
MAX_TRIALS = 80  # laws for each crossing and start: the longest is found to about a hundredth
NEARNESS = {"xatol": 1e-3, "fatol": 1e-3}  # of the simplex: [s, s' T] and the longest, where it ends
MIN_GAIN = 1e-2  # share by which a start must lengthen the longest duration, for another start to be tried
MAX_CROSSINGS = 3  # through more, the search takes too long
LAW_CHECK_TIMES = 0.5 - 0.5 * np.cos(np.pi * (np.arange(120) + 0.5) / 120)  # of t/T, where a law is looked at


class PolynomialDurations(NamedTuple):
    """The shortest and the longest duration [s] found at which one polynomial always advances.

    0 and infinity where nothing bounds them; infinity and 0 where no duration was found.
    """

    shortest: float
    longest: float

    def to_list(self) -> list[float | None] | None:
        """Return the entry of `locate --json`; null where none was found, and for no bound."""
        if not self.longest:
            return None
        return [self.shortest, self.longest if np.isfinite(self.longest) else None]

    @property
    def bounded(self) -> bool:
        """Whether anything bounds the duration."""
        return self.shortest > 0.0 or bool(np.isfinite(self.longest))

    @property
    def advice(self) -> str:
        """Advice for a duration beyond the bounds."""
        if not (self.longest and self.bounded):
            return ""
        return "; else use the optimal law, or take a path with less weight or more of its tangent along t_s"

    @property
    def sentence(self) -> str:
        """The durations, in one line."""
        if not self.longest:
            return "no duration was found at which one polynomial advances"
        if not self.bounded:
            return "one polynomial advances at any duration"
        bounds = [f"from {self.shortest:.3g} s on"] if self.shortest else []
        bounds += [f"up to {self.longest:.3g} s"] if np.isfinite(self.longest) else []
        return f"one polynomial advances {' and '.join(bounds)}"


class OptimalDurations(NamedTuple):
    """The least duration [s] found of a law of free shape within the limits of the motors, 0 without limits.

    None where none was found, with the reason. There is never a longest.
    """

    shortest: float | None
    refusal: str = ""

    def to_list(self) -> list[float | None] | None:
        """Return the entry of `locate --json`; null without a law, and in place of the longest."""
        return None if self.shortest is None else [self.shortest, None]

    @property
    def sentence(self) -> str:
        """The durations, in one line."""
        if self.shortest is None:
            return f"within the limits no law of free shape was found ({self.refusal})"
        if not self.shortest:
            return "without limits laws of free shape have no shortest duration and no longest"
        return (
            f"within the limits the quickest law of free shape found takes {self.shortest:.4g} s; none is "
            f"the slowest"
        )


def polynomial_durations(searched: SearchedPath, smoothness: int) -> PolynomialDurations | None:
    """Return the durations of polynomials of least degree through all singular points, springs at rest.

    Times and speeds of the crossings are searched for. None where no polynomial can cross; with damping,
    which is not affine in T^2; and through more than MAX_CROSSINGS singular points, where it would take
    too long.
    """
    conditions = _conditions_to_cross(searched)
    if conditions is None or len(conditions) > MAX_CROSSINGS:
        return None
    if any(feasibility.damped or feasibility.unmet_by_acceleration for feasibility in conditions):
        return None
    return _search_durations(conditions, smoothness)


def optimal_durations(searched: SearchedPath, request: Request) -> OptimalDurations | None:
    """Return the durations of laws of free shape through all singular points of a path, springs at rest.

    The limits and the smoothness are those of the request. None where no law can cross, and beyond the
    smoothness that such a law can have.
    """
    if request.smoothness > HIGHEST_SMOOTHNESS or _conditions_to_cross(searched) is None:
        return None
    robot = searched.branch.robot
    specification = replace(specification_of(robot, request), goal="time", duration=None, longest=None)
    if not (specification.limited or specification.limited_speeds):
        return OptimalDurations(0.0)
    try:
        to_cross = PathToCross(searched, searched.points)
        best = find_undeformed_law(
            Task(to_cross, replace(request, times=None, speeds=None, at=None), specification)
        )
    except (NoLaw, NotConverged) as refusal:
        return OptimalDurations(None, str(refusal))
    return OptimalDurations(best.law.duration)


def _conditions_to_cross(searched: SearchedPath) -> list[Feasibility] | None:
    """Return condition (8) at each singular point; None where one point cannot be crossed by any law."""
    conditions = [feasibility for feasibility in feasibility_on_path(searched) if feasibility is not None]
    blocked = len(conditions) < len(searched.points)
    blocked |= any(singular.contact == "tangential" or stops_at(singular) for singular in searched.points)
    blocked |= any(one.unmet_by_acceleration and one.steady_speed is None for one in conditions)
    return None if blocked else conditions


def _search_durations(conditions: Sequence[Feasibility], smoothness: int) -> PolynomialDurations:
    """Search the shortest and the longest duration [s], over times and speeds of the crossings.

    The unknowns are t_k/T and log(s'_k T). The simplex method makes the longest duration longer; the shortest
    is the least that its trials meet.
    """
    from scipy.optimize import minimize

    count = len(conditions)
    unit = min((one.pace for one in conditions if one.pace is not None), default=1.0)
    places = np.array([one.s for one in conditions])
    shortest, longest = np.inf, 0.0

    def negative_longest(unknowns: Array) -> float:
        """Return minus the longest duration over `unit`, to be minimised; record both extremes."""
        nonlocal shortest, longest
        times, speeds = unknowns[:count], np.exp(unknowns[count:])
        low, high = _advancing_interval(conditions, times, speeds, unit, smoothness)
        if not low < high:
            return 1e6  # worse than any duration
        shortest, longest = min(shortest, low), max(longest, high)
        return -high

    for cruising in CRUISING_SPEEDS:
        start = np.concatenate([0.5 + (places - 0.5) / cruising, np.full(count, np.log(cruising))])
        simplex = np.vstack([start, start + 0.1 * np.eye(len(start))])
        options = {"initial_simplex": simplex, "maxfev": MAX_TRIALS * count, **NEARNESS}
        previous = longest
        negative_longest(start)
        if np.isinf(longest) and shortest == 0.0:
            break
        minimize(negative_longest, start, method="Nelder-Mead", options=options)
        if previous and longest < (1.0 + MIN_GAIN) * previous:
            break
    return PolynomialDurations(unit * shortest, unit * longest)


def _advancing_interval(
    conditions: Sequence[Feasibility], times: Array, speeds: Array, unit: float, smoothness: int
) -> tuple[float, float]:
    """Compute the interval of durations over `unit` in which the polynomial through t_k/T, s'_k T advances.

    s' T is affine in (T/unit)^2: the law without weight, plus (T/unit)^2 times the change by the weight at
    T = unit. Each sample t/T bounds T from below or from above. The first number returned is not below the
    second where the interval is empty.
    """
    empty = np.inf, 0.0
    if np.any(np.diff([0.0, *times, 1.0]) < MIN_SEPARATION):
        return empty
    slopes = []  # s' T without weight, and with the weight at T = unit
    for squared_duration in (0.0, unit**2):
        values = [
            (feasibility.s, v, _scaled_acceleration(feasibility, v, squared_duration))
            for feasibility, v in zip(conditions, speeds, strict=True)
        ]
        inner = conditions_at_instants(times, values)
        try:
            slopes.append(Law.rest_to_rest(1.0, smoothness, inner)(LAW_CHECK_TIMES, 1))
        except InvalidInput:  # crossings too near to each other or to an end
            return empty
    weightless, by_weight = slopes[0], slopes[1] - slopes[0]
    up, down = by_weight > 0, by_weight < 0
    if np.any(weightless[~up & ~down] <= 0):
        return empty
    low = np.max(-weightless[up] / by_weight[up], initial=0.0)
    high = np.min(weightless[down] / -by_weight[down], initial=np.inf)
    return float(np.sqrt(low)), float(np.sqrt(max(high, 0.0)))


def _scaled_acceleration(feasibility: Feasibility, speed: float, squared_duration: float) -> float:
    """Return s" T^2 by condition (8) at v = s' T; 0 where the condition holds anyway.

    s" = per_squared_speed s'^2 + constant, multiplied by T^2.
    """
    if feasibility.condition.holds_anyway:
        return 0.0
    return feasibility.per_squared_speed * speed**2 + feasibility.constant * squared_duration
