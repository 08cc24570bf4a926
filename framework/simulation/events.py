"""Instants at which a function of the state passes through zero."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from framework.errors import InvalidInput
from framework.numerics.arrays import Array
from framework.simulation.trajectory import Trajectory

EVENT_TIME_ROUNDING = 1e-15  # [s]


@dataclass(frozen=True, eq=False)
class Event:
    """A function of (t, q, v) to watch: its zeros are reported, and end the simulation if `terminal`.

    `direction` +1 counts only zeros at which the function grows, -1 those at which it falls, 0 both.
    """

    function: Callable[[float, Array, Array], float]
    name: str = "event"
    terminal: bool = False
    direction: int = 0


@dataclass(frozen=True, eq=False)
class Occurrence:
    """An event that happened: when, and the state q (nq,), v (nv,)."""

    name: str
    time: float
    q: Array
    v: Array
    terminal: bool


def occurrences(
    events: Sequence[Event],
    trajectory: Trajectory,
    edges: tuple[float, float],
    samples: int,
    last_values: dict[Event, float],
) -> list[Occurrence]:
    """Find the events of a step in order of time.

    The first terminal event is the last one. Each function is evaluated at `samples` instants after the first
    of the `edges` [s]; two zeros between neighbouring instants go unseen. `last_values` are the values at the
    end of the last step, stored for the next call: rounding must not lose a zero between two steps.
    """
    occurred: list[Occurrence] = []
    times = np.linspace(*edges, samples + 1)
    states = trajectory(times)
    for event in events:
        values = [_event_value(event, float(t), q, v) for t, q, v in zip(times, *states, strict=True)]
        # at the beginnings of intervals, of which the first is empty: from the end of the last step
        first_values = [last_values.get(event, values[0]), *values[:-1]]
        last_values[event] = values[-1]
        for first, second, begin, end in zip(first_values, values, [times[0], *times], times, strict=False):
            # a zero on an instant belongs to the interval that ends there
            if first == 0.0 or first * second > 0 or event.direction * (second - first) < 0:
                continue
            t = float(end)
            if second != 0.0 and begin != end:
                t = _find_zero(event, trajectory, begin, t)
            q, v = trajectory(np.array([t]))
            occurred.append(Occurrence(event.name, t, q[0], v[0], event.terminal))
    occurred.sort(key=lambda occurrence: occurrence.time)
    terminal = [occurrence.terminal for occurrence in occurred]
    return occurred[: terminal.index(True) + 1] if any(terminal) else occurred


def _find_zero(event: Event, trajectory: Trajectory, begin: float, end: float) -> float:
    """Find the instant [s] at which an event's function is zero.

    It lies between two others of different sign.
    """
    from scipy.optimize import brentq

    def value(t: float) -> float:
        q, v = trajectory(np.array([t]))
        return _event_value(event, t, q[0], v[0])

    return float(brentq(value, begin, end, xtol=EVENT_TIME_ROUNDING))


def _event_value(event: Event, t: float, q: Array, v: Array) -> float:
    """Return the value of an event's function; refuse one that is no number."""
    value = event.function(t, q, v)
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = float("nan")
    if np.isnan(number):
        raise InvalidInput(f"event {event.name}: needs one number, got {value!r} at t = {t:.9g} s")
    return number
