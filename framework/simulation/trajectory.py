"""A simulated motion as a function of time, also between the ends of its steps, and the events on it.

An event is an instant at which a function of the state passes through zero.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from framework.errors import InvalidInput
from framework.kinematics.frames import difference, integrate
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, IntArray, ReadOnlyArrays
from framework.simulation.collocation import CollocationStep
from framework.tolerances import SAME_PLACE


@dataclass(frozen=True, eq=False)
class Polynomials:
    """The motion over collocation steps of s stages: polynomials of degree s with continuous velocities."""

    robot: ParallelRobot
    steps: tuple[CollocationStep, ...]  # successive ones, all with the same table

    @property
    def edges(self) -> Array:
        """The instants (K + 1,) at which the K steps begin and end [s]."""
        return np.array([self.steps[0].time, *(step.end for step in self.steps)])

    def __call__(self, t: Array) -> tuple[Array, Array]:
        """Evaluate q (T, nq) and v (T, nv) at times t (T,) [s].

        The tangent offset from the start of a step is the integral of the polynomial through its rates at the
        nodes. The velocity interpolates the start and the nodes.
        """
        index = _step_index(self.edges, t)  # (T,) of the step that contains each time
        table = self.steps[0].table
        begins, lengths = np.array([(step.time, step.length) for step in self.steps]).T  # (K,) each
        basis = table.basis((t - begins[index]) / lengths[index])  # (T, s + 1)
        starts = np.array([step.start for step in self.steps])[index]  # (T, nq)
        offset, v = np.empty((2, len(t), self.robot.nv))
        for k in np.unique(index):
            step = self.steps[k]
            is_inside = index == k
            offset_series = step.length * table.to_integral_series @ step.offset_rate
            velocity_series = table.to_series_with_start @ np.vstack([step.start_velocity, step.v])
            offset[is_inside] = basis[is_inside] @ offset_series
            v[is_inside] = basis[is_inside] @ velocity_series
        return integrate(self.robot, starts, offset), v


@dataclass(frozen=True, eq=False)
class Cubics(ReadOnlyArrays):
    """The motion over K fixed steps: cubic polynomials through the states at their ends."""

    robot: ParallelRobot
    edges: Array  # (K + 1,) instants at which the steps begin and end [s]
    q: Array  # (K + 1, nq)
    v: Array  # (K + 1, nv)

    def __call__(self, t: Array) -> tuple[Array, Array]:
        """Evaluate cubic Hermite interpolants q (T, nq) and their rates v (T, nv) at times t (T,) [s].

        On a step of length h from velocity v_0 to v_1, with u in [0, 1], the tangent offset from the start of
        the step is h v_0 u + c_2 u^2 + c_3 u^3. At u = 1, the end of the step, the offset is d and its
        derivative with respect to u is h v_1. Hence c_2 = 3 d - 2 h v_0 - h v_1 and
        c_3 = h v_0 + h v_1 - 2 d.
        """
        k = _step_index(self.edges, t)  # (T,) step that contains each time
        h = np.diff(self.edges)[k][:, None]
        u = (t - self.edges[k])[:, None] / h
        d = difference(self.robot, self.q[k], self.q[k + 1])  # (T, nv)
        hv_0, hv_1 = h * self.v[k], h * self.v[k + 1]
        c_2 = 3 * d - 2 * hv_0 - hv_1
        c_3 = hv_0 + hv_1 - 2 * d
        offset = u * (hv_0 + u * (c_2 + u * c_3))
        rate = (hv_0 + u * (2 * c_2 + 3 * u * c_3)) / h
        return integrate(self.robot, self.q[k], offset), rate


Trajectory = Polynomials | Cubics  # gives q (T, nq) and v (T, nv) at any times (T,) [s] between its `edges`


def _step_index(edges: Array, t: Array) -> IntArray:
    """Find the index (T,) of the step that contains each of the times t (T,).

    The K steps lie between the instants `edges` (K + 1,).
    """
    slack = SAME_PLACE * (edges[-1] - edges[0])
    if not np.all((t >= edges[0] - slack) & (t <= edges[-1] + slack)):
        raise InvalidInput(f"time {t!r} is outside the simulation, [{edges[0]:g}, {edges[-1]:g}] s")
    return np.searchsorted(edges[1:-1], t, side="right")


# ------------------------------------------------------------------ events


@dataclass(frozen=True, eq=False)
class Event:
    """A function of t [s], q (nq,), v (nv,) whose zeros are reported; `terminal` ones end the simulation.

    `direction` selects the zeros that count: +1 those at which the function grows, -1 those at which it
    falls, 0 all.
    """

    function: Callable[[float, Array, Array], float]
    name: str = "event"
    terminal: bool = False  # whether a zero ends the simulation
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
    events: Sequence[Event], step: Trajectory, samples: int, last_values: dict[Event, float]
) -> list[Occurrence]:
    """Find the events of one step in order of time, the first terminal event last.

    Each function is evaluated at `samples` equidistant instants after the start of the step. A change of its
    sign brackets a zero. If a function has two zeros between neighbouring instants, both are missed.

    Args:
        last_values: value of each function at the end of the previous step, which is the start of this one;
            updated here.
    """
    occurred: list[Occurrence] = []
    times = np.linspace(step.edges[0], step.edges[-1], samples + 1)
    states = list(zip(times.tolist(), *step(times), strict=True))  # (t, q, v) each
    for event in events:
        # no second value at the start: rounding may give it the other sign, and a zero would count twice
        if event not in last_values:
            last_values[event] = _event_value(event, *states[0])
        values = [last_values[event], *(_event_value(event, *state) for state in states[1:])]
        last_values[event] = values[-1]
        for k, (begin_value, end_value) in enumerate(pairwise(values)):
            # a zero at the beginning belongs to the interval that ends there
            changes_sign = begin_value != 0.0 and begin_value * end_value <= 0.0
            if changes_sign and event.direction * (end_value - begin_value) >= 0.0:
                zero = _find_zero(event, step, times[k], times[k + 1])
                q, v = step(np.array([zero]))
                occurred.append(Occurrence(event.name, zero, q[0], v[0], event.terminal))
    occurred.sort(key=lambda occurrence: occurrence.time)
    terminal = [k for k, occurrence in enumerate(occurred) if occurrence.terminal]
    return occurred[: terminal[0] + 1] if terminal else occurred


def _find_zero(event: Event, trajectory: Trajectory, begin: float, end: float) -> float:
    """Find the zero [s] of an event's function between `begin` and `end` [s]."""
    from scipy.optimize import brentq

    def value(t: float) -> float:
        """Evaluate the event's function at t [s]."""
        q, v = trajectory(np.array([t]))
        return _event_value(event, t, q[0], v[0])

    # the value at `begin` was computed from the end of the previous step; rounding gave it the other sign
    if value(begin) * value(end) > 0.0:
        return float(begin)
    return float(brentq(value, begin, end, xtol=np.spacing(end)))


def _event_value(event: Event, t: float, q: Array, v: Array) -> float:
    """Return the value of an event's function at t [s], q (nq,) and v (nv,)."""
    value = event.function(t, q, v)
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = np.nan
    if np.isnan(number):
        raise InvalidInput(f"event {event.name}: needs one number, got {value!r} at t = {t:.9g} s")
    return number
