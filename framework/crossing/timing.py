"""Times and speeds of the crossings where the user leaves them open: those of a law that always advances."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.crossing.request import Request
from framework.dynamics.singularity_crossings import instants
from framework.errors import InvalidInput, NoLaw
from framework.motion.law import Law

# Least slope of s (the ends' zeros divided out) over its mean that a law of our own choice should keep.
COMFORTABLE_ADVANCE = 0.2
MAX_CROSSINGS = 8  # through more, one polynomial has so many turns that none that advances is found
MAX_TRIALS = 1600  # laws that are tried while times or speeds are moved
MIN_SEPARATION = 1e-3  # of the duration, between crossings and from them to the ends, in a search


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
    """Choose the timing of the crossings at path coordinates s (k,), ascending.

    What the request gives is kept. What is open starts from the law that would ignore the crossings, and
    is then moved, if need be, until the law through it advances comfortably, as `advance` measures it.

    Raises:
        NoLaw: no law that always advances was found.
    """
    if request.times is not None and request.speeds is not None:
        # what such a law does is for `check_advance` to judge
        return _timings(np.array(request.times), np.array(request.speeds))
    if len(s) > MAX_CROSSINGS:
        raise NoLaw(
            f"{name}: the path meets {len(s)} singular points, the first at s = {s[0]:.6g}; a law through "
            f"more than {MAX_CROSSINGS} is not searched for: cut the path, or give all times and speeds"
        )
    best: tuple[CrossingTime, ...] = ()
    score = -np.inf
    for start in _starts(s, request):
        advanced = _advance(advance, start, request)
        if advanced > score or not best:
            best, score = start, advanced
        if score >= COMFORTABLE_ADVANCE:
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


def _starts(s: Sequence[float], request: Request) -> Iterator[tuple[CrossingTime, ...]]:
    """Yield first the law that ignores the crossings, then laws of one cruising speed, ever faster."""
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
    """Return how well the law advances; negative infinity where there is none."""
    duration = request.fixed_duration
    t = np.array([0.0, *(m.time for m in crossing_times), duration])
    if np.any(np.diff(t) < MIN_SEPARATION * duration) or any(m.speed <= 0 for m in crossing_times):
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
    """Search by Nelder and Mead's method what is open, until the law advances comfortably."""
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
        return 1e6 if np.isneginf(score) else -min(score, COMFORTABLE_ADVANCE)

    def stop_when_comfortable(intermediate_result: OptimizeResult) -> None:
        if intermediate_result.fun <= -COMFORTABLE_ADVANCE:
            raise StopIteration

    unknowns = count * (open_times + open_speeds)
    simplex = np.vstack([np.zeros(unknowns), 0.1 * np.eye(unknowns)])
    optimum = minimize(
        cost,
        np.zeros(unknowns),
        method="Nelder-Mead",
        callback=stop_when_comfortable,
        options={
            "initial_simplex": simplex,
            "maxfev": min(400 * unknowns, MAX_TRIALS),
            "xatol": 1e-4,
            "fatol": 1e-6,
        },
    )
    best = crossing_times(optimum.x)
    return best, _advance(advance, best, request)
