"""Times and speeds of the crossings where the user leaves them open: those of a law that always advances."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.crossing.request import Request
from framework.dynamics.singularity_crossings import find_instants
from framework.errors import NoLaw
from framework.motion.law import Law

# Least slope of s (the ends' zeros divided out) over its mean that a law of our own choice should keep.
COMFORTABLE_ADVANCE = 0.2
MAX_CROSSINGS = 8  # through more, one polynomial has so many turns that none that advances is found
LAWS_PER_UNKNOWN, MAX_ROUNDS = 64, 25  # tried together, and how often, while times or speeds are moved
BEST_SHARE = 8  # one in so many laws of a round is kept, and the next ones are drawn around those
FIRST_SPREAD = 0.1  # of the duration for times, of themselves for speeds, around what the search starts from
NO_GAIN = 1e-4  # of `Law.advance`, between the laws that are kept: the search has arrived
MIN_SEPARATION = 1e-3  # of the duration, between crossings and from them to the ends, in a search

Measure = Callable[[Array, Array], tuple[Array, Array]]


class CrossingTime(NamedTuple):
    """The law is to cross a singular point at `time` [s] with s' = `speed` [1/s]."""

    time: float
    speed: float


def choose_timing(
    s: Sequence[float], request: Request, measure: Measure, name: str
) -> tuple[CrossingTime, ...]:
    """Choose the timing of the crossings at path coordinates s (k,), ascending.

    Times or speeds of the request are kept. Open ones start from the law that would ignore the crossings. If
    the law through them does not advance comfortably, laws are searched for one that does, with a low peak
    of s".

    Args:
        measure: computes `Law.advance` (m,) of laws that cross at times (m, k) with speeds (m, k), and the
            peaks of their s" [1/s^2] (m,), as `advances_and_peaks` does.

    Raises:
        NoLaw: no law that always advances was found.
    """
    if request.times is not None and request.speeds is not None:
        # `check_advance` judges such a law
        return _timing(np.array([request.times, request.speeds]))
    if len(s) > MAX_CROSSINGS:
        raise NoLaw(
            f"{name}: the path meets {len(s)} singular points, the first at s = {s[0]:.6g}; a law through "
            f"more than {MAX_CROSSINGS} is not searched for: cut the path, or give all times and speeds"
        )
    starts = _starts(s, request)
    scores = _scores(starts, request, measure)
    if (scores >= COMFORTABLE_ADVANCE).any():
        return _timing(starts[np.argmax(scores >= COMFORTABLE_ADVANCE)])
    best, score = _search(starts[np.argsort(-scores, kind="stable")], request, measure)
    timing = _timing(best)
    if score <= 0:
        raise NoLaw(
            f"{name}: no law that always advances found through s = "
            f"{', '.join(f'{value:.6g}' for value in s)}, tried t = "
            f"{', '.join(f'{m.time:.6g}' for m in timing)} s, s' = "
            f"{', '.join(f'{m.speed:.6g}' for m in timing)} 1/s; give other times, speeds or another duration"
        )
    return timing


def _starts(s: Sequence[float], request: Request) -> Array:
    """Return times and speeds (m, 2, k), first of the law that ignores the crossings, then of faster ones."""
    duration = request.fixed_duration
    plain = Law.rest_to_rest(duration, request.smoothness)
    ends = np.array([0.0, duration])
    when = np.array([find_instants(plain, ends, value)[0] for value in s])
    cruising = np.linspace(1.2, 2.4, 7)[:, None] / duration
    times = np.vstack([when, 0.5 * duration + (np.array(s) - 0.5) / cruising])
    if request.times is not None:
        times[:] = when = np.array(request.times)
    speeds = np.vstack([plain(when, 1), np.repeat(cruising, len(s), axis=1)])
    if request.speeds is not None:
        speeds[:] = request.speeds
    return np.stack([times, speeds], axis=1)


def _timing(timing: Array) -> tuple[CrossingTime, ...]:
    """Return times and speeds (2, k) as crossing times."""
    return tuple(CrossingTime(float(t), float(v)) for t, v in timing.T)


def _scores(timings: Array, request: Request, measure: Measure) -> Array:
    """Score laws (m,) through times and speeds (m, 2, k) by their advance; negative infinity without a law.

    Of laws that advance comfortably, the one with the lowest peak of s" is best.
    """
    duration, (times, speeds) = request.fixed_duration, timings.swapaxes(0, 1)
    apart = np.diff(times, axis=1, prepend=0.0, append=duration).min(axis=1) >= MIN_SEPARATION * duration
    possible = apart & (speeds > 0).all(axis=1)
    scores = np.full(len(timings), -np.inf)
    advances, peaks = measure(times[possible], speeds[possible])
    quiet = COMFORTABLE_ADVANCE + 1.0 / (peaks * duration**2)
    scores[possible] = np.where(advances < COMFORTABLE_ADVANCE, advances, quiet)
    return scores


def _search(starts: Array, request: Request, measure: Measure) -> tuple[Array, float]:
    """Search open times and speeds (m, 2, k), starts best first, until laws advance comfortably.

    Laws are drawn around all starts, and then, round by round, around the mean of the best ones with the
    covariance of these about the last mean: it stretches along a descent and shrinks at its end.
    """
    duration = request.fixed_duration
    is_open = np.array([[request.times is None], [request.speeds is None]])

    def timings(laws: Array) -> Array:
        """Return times and speeds (m, 2, k) of times over the duration and logarithms of speeds."""
        physical = np.stack([duration * laws[:, 0], np.exp(laws[:, 1])], axis=1)
        return np.where(is_open, physical, starts[0])

    random = np.random.default_rng(0)
    scaled = np.stack([starts[:, 0] / duration, np.log(starts[:, 1])], axis=1)
    middle = scaled[0]
    size = LAWS_PER_UNKNOWN * int(is_open.sum()) * len(middle.T)
    around = scaled[random.integers(len(starts), size=size)]
    drawn = around + is_open * FIRST_SPREAD * random.standard_normal(around.shape)
    laws, scores = scaled[:1], _scores(starts[:1], request, measure)
    for _ in range(MAX_ROUNDS):
        laws = np.concatenate([laws, drawn])
        scores = np.concatenate([scores, _scores(timings(drawn), request, measure)])
        best = np.argsort(-scores, kind="stable")[: size // BEST_SHARE]
        laws, scores = laws[best], scores[best]
        if scores[-1] >= COMFORTABLE_ADVANCE or scores[-1] > scores[0] - NO_GAIN:
            break
        weights = random.standard_normal((size, len(laws))) / np.sqrt(len(laws))
        drawn = np.tensordot(weights, laws - middle, axes=1)
        middle = laws.mean(axis=0)
        drawn += middle
    return timings(laws[:1])[0], float(scores[0])
