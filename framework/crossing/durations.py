"""The longest and the shortest motion along a path for each kind of law, told before one is sought.

The polynomial of least degree through its crossings is affine in what it goes through. Over t/T the s" that
condition (8) asks for is -(beta v^2 + gamma T^2)/alpha, v = s' T: affine in T^2. So with t_k/T and v_k
chosen, the T at which it always advances are an interval in closed form, and only t_k/T and v_k have to be
searched for.

A law of free shape may be as slow as one likes if there is any: condition (8) and the limits are met by a
convex set of squared speeds z, and near an end of the path, where a smooth law asks for little more than the
weight, z may be multiplied with a factor that is near to zero there. Without limits it may be as quick as one
likes too, since condition (8) asks something of z and z' at the crossing alone. That such a law
exists does not say that the degrees tried resolve it: far beyond the pace it is a sharp sprint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.crossing.feasibility import Feasibility, feasibility_on_path
from framework.crossing.optimal_motion import best_undeformed
from framework.crossing.optimal_task import Task
from framework.crossing.request import Request
from framework.crossing.specification import specification_of
from framework.crossing.targets import END, TargetedPath
from framework.errors import NoLaw, NotConverged
from framework.motion.law import Condition, Law
from framework.motion.optimal_law import HIGHEST_SMOOTHNESS
from framework.singularity.points_on_path import SearchedPath

CRUISING = (1.0, 1.3, 1.6, 2.0)  # s' T from which the search starts
TRIALS = 80  # laws for each crossing and start: the longest is found to about a hundredth
GAIN = 1e-2  # share by which a further start must lengthen the longest, for another one to be tried
MOST = 3  # crossings
CLOSEST = 1e-3  # of the duration between two crossings, and between the ends and one
INSTANTS = 0.5 - 0.5 * np.cos(np.pi * (np.arange(120) + 0.5) / 120)  # of t/T, where a law is looked at


class PolynomialDurations(NamedTuple):
    """The shortest and the longest duration [s] found at which one polynomial always advances.

    0 and infinity where nothing bounds them, and the other way round where none was found.
    """

    shortest: float
    longest: float

    def to_list(self) -> list[float | None] | None:
        """As `locate --json` has it; null where none was found, and where nothing bounds the longest."""
        if not self.longest:
            return None
        return [self.shortest, self.longest if np.isfinite(self.longest) else None]

    @property
    def sentence(self) -> str:
        """In one line."""
        if not self.longest:
            return "no duration was found at which one polynomial advances"
        if np.isinf(self.longest) and not self.shortest:
            return "one polynomial advances at any duration"
        bounds = [f"from {self.shortest:.3g} s on"] if self.shortest else []
        bounds += [f"up to {self.longest:.3g} s"] if np.isfinite(self.longest) else []
        return (
            f"one polynomial advances {' and '.join(bounds)}; else use the optimal law, or take a path with "
            f"less weight or more of its tangent along t_s"
        )


class OptimalDurations(NamedTuple):
    """The least duration [s] of a law of free shape within the limits of the motors, 0 without limits.

    None where none was found, with the reason. There is never a longest.
    """

    shortest: float | None
    refusal: str = ""

    def to_list(self) -> list[float | None] | None:
        """As `locate --json` has it; null where there is no law, and in place of the longest."""
        return None if self.shortest is None else [self.shortest, None]

    @property
    def sentence(self) -> str:
        """In one line."""
        if self.shortest is None:
            return f"within the limits no law of free shape was found ({self.refusal})"
        if not self.shortest:
            return "without limits laws of free shape have no shortest duration and no longest"
        return (
            f"within the limits laws of free shape last at least {self.shortest:.4g} s, and have no longest"
        )


def polynomial_durations(searched: SearchedPath, smoothness: int) -> PolynomialDurations | None:
    """The durations of polynomials of least degree through all singular points of a path, springs at rest.

    Times and speeds of the crossings are searched for. None where no polynomial can cross, and through more
    than MOST singular points, where it would take too long.
    """
    asked = _crossable(searched)
    if asked is None or len(asked) > MOST:
        return None
    if any(found.orthogonal and not found.condition.holds_anyway for found in asked):
        return None
    return _searched_durations(asked, smoothness)


def optimal_durations(searched: SearchedPath, request: Request) -> OptimalDurations | None:
    """The durations of laws of free shape through all singular points of a path, springs at rest.

    The limits and the smoothness are those of the request. None where no law can cross, and beyond the
    smoothness that such a law can have.
    """
    if request.smoothness > HIGHEST_SMOOTHNESS or _crossable(searched) is None:
        return None
    robot = searched.branch.robot
    specification = replace(specification_of(robot, request), goal="time", duration=None, longest=None)
    if not (specification.limited or np.isfinite(specification.speed_limit).any()):
        return OptimalDurations(0.0)
    try:
        targeted = TargetedPath(searched, searched.points)
        best = best_undeformed(
            Task(targeted, replace(request, times=None, speeds=None, at=None), specification)
        )
    except (NoLaw, NotConverged) as refusal:
        return OptimalDurations(None, str(refusal))
    return OptimalDurations(best.law.duration)


def _crossable(searched: SearchedPath) -> list[Feasibility] | None:
    """What condition (8) asks at each singular point; None if one of them cannot be crossed by any law."""
    asked = [found for found in feasibility_on_path(searched) if found is not None]
    touched = any(at.contact == "tangential" for at in searched.points)
    ends = any(not END < at.s < 1.0 - END for at in searched.points)
    hopeless = any(
        found.orthogonal and not found.condition.holds_anyway and found.steady_speed is None
        for found in asked
    )
    return None if len(asked) < len(searched.points) or touched or ends or hopeless else asked


def _searched_durations(asked: Sequence[Feasibility], smoothness: int) -> PolynomialDurations:
    """The shortest and the longest duration [s] found, over times and speeds of the crossings."""
    from scipy.optimize import minimize

    paces = [found.pace for found in asked if found.pace is not None]
    unit = min(paces, default=1.0)
    places = np.array([found.s for found in asked])
    shortest, longest = np.inf, 0.0

    def longer(free: Array) -> float:
        """What is minimised: the longest duration with its sign changed."""
        nonlocal shortest, longest
        low, high = _advancing(asked, free[: len(asked)], np.exp(free[len(asked) :]), unit, smoothness)
        if not low < high:
            return 1e6
        shortest, longest = min(shortest, low), max(longest, high)
        return -high

    for cruising in CRUISING:
        start = np.concatenate([0.5 + (places - 0.5) / cruising, np.full(len(asked), np.log(cruising))])
        simplex = np.vstack([start, start + 0.1 * np.eye(len(start))])
        options = {"initial_simplex": simplex, "maxfev": TRIALS * len(asked), "xatol": 1e-3, "fatol": 1e-3}
        before = longest
        longer(start)
        if np.isinf(longest) and shortest == 0.0:
            break
        minimize(longer, start, method="Nelder-Mead", options=options)
        if before and longest < (1.0 + GAIN) * before:
            break
    return PolynomialDurations(unit * shortest, unit * longest)


def _advancing(
    asked: Sequence[Feasibility], times: Array, speeds: Array, unit: float, smoothness: int
) -> tuple[float, float]:
    """The durations over `unit` between which the polynomial through these t_k/T and s'_k T advances.

    The first is not below the second where there are none.
    """
    if np.any(np.diff([0.0, *times, 1.0]) < CLOSEST):
        return np.inf, 0.0
    laws = []
    for weight in (0.0, unit**2):
        inner = [
            Condition(float(t), order, value)
            for found, t, v in zip(asked, times, speeds, strict=True)
            for order, value in enumerate((found.s, float(v), _asked(found, float(v), weight)))
        ]
        laws.append(Law.rest_to_rest(1.0, smoothness, inner)(INSTANTS, 1))
    plain, more = laws[0], laws[1] - laws[0]  # s' T without weight, and what the weight adds at T = unit
    up, down = more > 0, more < 0
    if np.any(plain[~up & ~down] <= 0):
        return np.inf, 0.0
    low = np.max(-plain[up] / more[up], initial=0.0)
    high = np.min(plain[down] / -more[down], initial=np.inf)
    return float(np.sqrt(low)), float(np.sqrt(max(high, 0.0)))


def _asked(found: Feasibility, speed: float, squared_duration: float) -> float:
    """s" T^2 that condition (8) asks for at s' T, where it asks for any."""
    if found.condition.holds_anyway:
        return 0.0
    weight = 0.0 if found.weightless else found.constant
    return found.per_squared_speed * speed**2 + weight * squared_duration
