"""Instants at which a function of the state passes through zero."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from framework.arrays import Array
from framework.dynamics.simulation.trajectory import Trajectory


@dataclass(frozen=True)
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
    events: Sequence[Event], trajectory: Trajectory, start: float, end: float, looks: int
) -> list[Occurrence]:
    """Events between two instants in order of time, up to the first terminal one.

    The function is looked at `looks` times on the way: two zeros between neighbouring looks go unseen.
    """
    from scipy.optimize import brentq

    found: list[Occurrence] = []
    times = np.linspace(start, end, looks + 1)
    states = trajectory(times)
    for event in events:

        def value(t: float, event: Event = event) -> float:
            q, v = trajectory(np.array([t]))
            return float(event.function(t, q[0], v[0]))

        values = [float(event.function(float(t), q, v)) for t, q, v in zip(times, *states, strict=True)]
        for k in range(looks):
            before, after = values[k], values[k + 1]
            # a zero on a look belongs to the interval that it ends
            if before == 0.0 or before * after > 0 or event.direction * (after - before) < 0:
                continue
            t = (
                float(times[k + 1])
                if after == 0.0
                else float(brentq(value, times[k], times[k + 1], xtol=1e-15))
            )
            q, v = trajectory(np.array([t]))
            found.append(Occurrence(event.name, t, q[0], v[0], event.terminal))
    found.sort(key=lambda one: one.time)
    ends = [k for k, one in enumerate(found) if one.terminal]
    return found[: ends[0] + 1] if ends else found
