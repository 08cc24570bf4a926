"""When and how fast to cross, when the user leaves it open: a law that always advances."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.crossing.request import Request
from framework.dynamics.crossings import instants
from framework.errors import InvalidInput, NoLaw
from framework.motion.law import OVERSHOOT, Law

# Least slope of s (the ends' zeros divided out) over its mean that a law of our own choice should keep.
COMFORTABLE = 0.2
MOST_CROSSINGS = 8  # through more, one polynomial has so many turns that none that advances is found
TRIALS = 1600  # laws that are tried at most while times or speeds are moved


OTHERWISE = "choose other times or speeds, or law optimal"


class CrossingTime(NamedTuple):
    """The law is to cross a singular point at `time` [s] with s' = `speed` [1/s]."""

    time: float
    speed: float


def choose_timing(
    s: Sequence[float],
    request: Request,
    advance: Callable[[Sequence[CrossingTime]], float],
    name: str,
) -> tuple[CrossingTime, ...]:
    """Timing of the crossings at path coordinates s (k,), ascending.

    What the request gives is kept. What is open starts from the law that would ignore the crossings, and
    is then moved, if need be, until the law through it advances comfortably, as told by `advance`.

    Raises:
        NoLaw: no law that always advances was found.
    """
    if request.times is not None and request.speeds is not None:
        # what such a law does is for `check_advance` to judge
        return _timings(np.array(request.times), np.array(request.speeds))
    if len(s) > MOST_CROSSINGS:
        raise NoLaw(
            f"{name}: the path meets {len(s)} singular points, the first at s = {s[0]:.6g}; a law through "
            f"more than {MOST_CROSSINGS} is not searched for: cut the path, or give all times and speeds"
        )
    best: tuple[CrossingTime, ...] = ()
    score = -np.inf
    for start in _starts(s, request):
        found = _advance(advance, start, request)
        if found > score or not best:
            best, score = start, found
        if score >= COMFORTABLE:
            return best
    best, score = _improve(best, request, advance)
    if score <= 0:
        raise NoLaw(
            f"{name}: no law that always advances found through s = "
            f"{', '.join(f'{value:.6g}' for value in s)}, tried t = "
            f"{', '.join(f'{m.time:.6g}' for m in best)} s, s' = "
            f"{', '.join(f'{m.speed:.6g}' for m in best)} 1/s; give other times, speeds or another duration"
        )
    return best


def check_advance(law: Law, s: Sequence[float], name: str) -> None:
    """Refuse a law that runs backwards, leaves the path, or meets a singular point s (k,) twice.

    A law that always advances passes; so does one that overshoots an end by less than OVERSHOOT and
    comes back to it, as the paper's case C does with degree 8.

    Raises:
        NoLaw: says where and when.
    """
    times = np.linspace(0.0, law.duration, 2001)
    values = law(times)
    for end, beyond in ((0.0, -values), (1.0, values - 1.0)):
        worst = int(np.argmax(beyond))
        if beyond[worst] > OVERSHOOT:
            raise NoLaw(
                f"{name}: the law does not always advance: it leaves the path at s = {end:g}, up to "
                f"s = {values[worst]:.4g} at t = {times[worst]:.4g} s; {OTHERWISE}"
            )
    inside = (values > 0) & (values < 1)
    rates = law(times, 1)
    backwards = rates < -1e-9 * np.abs(rates).max()
    if np.any(inside & backwards):
        k = int(np.argmax(inside & backwards))
        raise NoLaw(
            f"{name}: the law does not always advance: it runs backwards at t = {times[k]:.4g} s, s = "
            f"{values[k]:.4g}; {OTHERWISE}"
        )
    for singular in s:
        crossed = np.flatnonzero(np.diff(values > singular))
        if len(crossed) > 1:
            raise NoLaw(
                f"{name}: the law does not always advance: it meets the singular point s = "
                f"{singular:.6g} {len(crossed)} times (about t = "
                f"{', '.join(f'{times[k]:.4g}' for k in crossed)} s); {OTHERWISE}"
            )


def _starts(s: Sequence[float], request: Request) -> Iterator[tuple[CrossingTime, ...]]:
    """First the law that ignores the crossings, then laws of one cruising speed, ever faster."""
    duration, times, speeds = request.fixed_duration, request.times, request.speeds
    plain = Law.rest_to_rest(duration, request.smoothness)
    ends = np.array([0.0, duration])
    when = np.array([instants(plain, ends, value)[0] for value in s]) if times is None else np.array(times)
    how_fast = plain(when, 1) if speeds is None else np.array(speeds)
    yield _timings(when, how_fast)
    for cruising in np.linspace(1.2, 2.4, 7) / duration:
        middle = 0.5 * duration + (np.array(s) - 0.5) / cruising
        when = middle if times is None else np.array(times)
        yield _timings(when, np.full(len(s), cruising) if speeds is None else np.array(speeds))


def _timings(times: Array, speeds: Array) -> tuple[CrossingTime, ...]:
    return tuple(CrossingTime(float(t), float(v)) for t, v in zip(times, speeds, strict=True))


def _advance(
    advance: Callable[[Sequence[CrossingTime]], float],
    crossing_times: Sequence[CrossingTime],
    request: Request,
) -> float:
    """How well the law advances; negative infinity where there is none."""
    duration = request.fixed_duration
    t = np.array([0.0, *(m.time for m in crossing_times), duration])
    if np.any(np.diff(t) < 1e-3 * duration) or any(m.speed <= 0 for m in crossing_times):
        return -np.inf
    try:
        return advance(crossing_times)
    except InvalidInput:
        return -np.inf


def _improve(
    first: tuple[CrossingTime, ...],
    request: Request,
    advance: Callable[[Sequence[CrossingTime]], float],
) -> tuple[tuple[CrossingTime, ...], float]:
    """Nelder-Mead on what is open, until the law advances comfortably."""
    from scipy.optimize import OptimizeResult, minimize

    count, duration = len(first), request.fixed_duration
    open_times, open_speeds = request.times is None, request.speeds is None

    def crossing_times(free: Array) -> tuple[CrossingTime, ...]:
        shift = free[:count] if open_times else np.zeros(count)
        faster = np.exp(free[-count:]) if open_speeds else np.ones(count)
        return tuple(
            CrossingTime(m.time + duration * float(d), m.speed * float(f))
            for m, d, f in zip(first, shift, faster, strict=True)
        )

    def cost(free: Array) -> float:
        score = _advance(advance, crossing_times(free), request)
        return 1e6 if np.isneginf(score) else -min(score, COMFORTABLE)

    def stop_when_comfortable(intermediate_result: OptimizeResult) -> None:
        if intermediate_result.fun <= -COMFORTABLE:
            raise StopIteration

    unknowns = count * (open_times + open_speeds)
    simplex = np.vstack([np.zeros(unknowns), 0.1 * np.eye(unknowns)])
    found = minimize(
        cost,
        np.zeros(unknowns),
        method="Nelder-Mead",
        callback=stop_when_comfortable,
        options={
            "initial_simplex": simplex,
            "maxfev": min(400 * unknowns, TRIALS),
            "xatol": 1e-4,
            "fatol": 1e-6,
        },
    )
    best = crossing_times(found.x)
    return best, _advance(advance, best, request)
