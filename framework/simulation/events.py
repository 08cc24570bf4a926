"""Events of a simulation: instants at which a function of the state passes through zero."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from framework.errors import InvalidInput
from framework.numerics.arrays import Array
from framework.simulation.trajectory import Trajectory

EVENT_TIME_ROUNDING = 1e-15  # [s] to which the instant of an event is found


@dataclass(frozen=True, eq=False)
class Event:
    """A function of (t, q, v) whose zeros are reported; a zero ends the simulation if `terminal`.

    `direction` selects the zeros that count: +1 those at which the function grows, -1 those at which it
    falls, 0 all.
    """

    function: Callable[[float, Array, Array], float]
    name: str = "event"
    terminal: bool = False
    direction: int = 0


@dataclass(frozen=True, eq=False)
class Occurrence:
    """The occurrence of an event, with the state at that instant."""

    name: str
    time: float  # [s]
    q: Array  # (nq,)
    v: Array  # (nv,)
    terminal: bool


def occurrences(
    events: Sequence[Event],
    step: Trajectory,
    samples: int,
    last_values: dict[Event, float],
) -> list[Occurrence]:
    """Find the events of one step in order of time, up to the first terminal event.

    Each function is evaluated at `samples` equidistant instants after the start of the step. A change of its
    sign brackets a zero. If a function has two zeros between neighbouring instants, both are missed.

    Args:
        last_values: value of each function at the end of the previous step, updated here. This step starts
            at the same instant, but rounding may give the value the other sign. An additional interval of
            zero length, between the old and the new value, catches a zero that would be lost there.
    """
    occurred: list[Occurrence] = []
    times = np.linspace(step.edges[0], step.edges[-1], samples + 1)
    states = step(times)
    for event in events:
        values = [_event_value(event, float(t), q, v) for t, q, v in zip(times, *states, strict=True)]
        points = [(times[0], last_values.get(event, values[0])), *zip(times, values, strict=True)]
        last_values[event] = values[-1]
        for (begin, begin_value), (end, end_value) in pairwise(points):
            # a zero exactly at `begin` belongs to the interval that ends there
            has_same_sign = begin_value * end_value > 0
            if begin_value == 0.0 or has_same_sign or event.direction * (end_value - begin_value) < 0:
                continue
            t = float(end)
            if end_value != 0.0 and begin != end:
                t = _find_zero(event, step, begin, t)
            q, v = step(np.array([t]))
            occurred.append(Occurrence(event.name, t, q[0], v[0], event.terminal))
    occurred.sort(key=lambda occurrence: occurrence.time)
    for k in range(len(occurred)):
        if occurred[k].terminal:
            return occurred[: k + 1]
    return occurred


def _find_zero(event: Event, trajectory: Trajectory, begin: float, end: float) -> float:
    """Find the zero [s] of an event's function between `begin` and `end` [s], where its signs differ."""
    from scipy.optimize import brentq

    def value(t: float) -> float:
        q, v = trajectory(np.array([t]))
        return _event_value(event, t, q[0], v[0])

    return float(brentq(value, begin, end, xtol=EVENT_TIME_ROUNDING))


def _event_value(event: Event, t: float, q: Array, v: Array) -> float:
    """Return the value of an event's function; refuse values that are no numbers."""
    value = event.function(t, q, v)
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = np.nan
    if np.isnan(number):
        raise InvalidInput(f"event {event.name}: needs one number, got {value!r} at t = {t:.9g} s")
    return number
