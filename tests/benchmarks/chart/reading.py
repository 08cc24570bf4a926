"""What the rows of a stage say: the best of a method, and factors between two methods."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from tests.benchmarks.chart.measure import Row

LEAST = 1e-17  # stands for an error of zero
RESOLVED = 10.0  # times the least error of a method: what it has when more work hardly helps


class Gain(NamedTuple):
    """What one method gains over another, in time at equal error and in error at equal time."""

    time: float  # at the other's least error `error`, which takes it `seconds` [s]
    error: float
    seconds: float
    accuracy: float  # within the time `within` [s] in which this one has all but its least error
    within: float


def finite(rows: Sequence[Row], method: str) -> list[Row]:
    """The rows of a method that have a result."""
    return [row for row in rows if row.method == method and np.isfinite(row.error)]


def best_within(rows: Sequence[Row], method: str, seconds: float = np.inf) -> Row | None:
    """The row with the least error that takes no longer."""
    return min(
        (row for row in finite(rows, method) if row.seconds <= seconds), key=lambda r: r.error, default=None
    )


def quickest_to(rows: Sequence[Row], method: str, error: float) -> Row | None:
    """The row with the least time whose error is no larger."""
    return min(
        (row for row in finite(rows, method) if row.error <= error), key=lambda r: r.seconds, default=None
    )


def gain(rows: Sequence[Row], one: str, other: str) -> Gain | None:
    """What `one` gains over `other`, read off their curves; None if it never comes to its least error."""
    here, there = best_within(rows, one), best_within(rows, other)
    if here is None or there is None:
        return None
    resolved = quickest_to(rows, one, RESOLVED * here.error)
    time, error = _curve(rows, one), _curve(rows, other)
    if resolved is None or here.error > there.error:
        return None
    quick = np.exp(np.interp(-np.log(there.error), -time[1], time[0]))
    slower = np.exp(np.interp(np.log(resolved.seconds), error[0], error[1]))
    return Gain(
        time=float(there.seconds / quick),
        error=there.error,
        seconds=there.seconds,
        accuracy=float(slower / resolved.error),
        within=resolved.seconds,
    )


def _curve(rows: Sequence[Row], method: str) -> Array:
    """Logarithms of seconds and of the least error in them (2, k)."""
    ordered = sorted(finite(rows, method), key=lambda row: row.seconds)
    best, points = np.inf, []
    for row in ordered:
        if row.error < best:
            best = row.error
            points.append((np.log(row.seconds), np.log(max(best, LEAST))))
    return np.array(points).T


def error_at_best(rows: Sequence[Row], method: str, profile: int) -> float | None:
    """The error in one class of the profile, of the row of a method that has the least error."""
    best = best_within(rows, method)
    return None if best is None or not best.profile else best.profile[profile]


def short(value: float | None) -> str:
    """A number of one digit."""
    return "-" if value is None else f"{value:.0e}"
