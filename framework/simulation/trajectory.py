"""A simulated motion between its steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from framework.arrays import Array, ReadOnlyArrays
from framework.errors import InvalidInput
from framework.kinematics.frames import difference, integrate
from framework.kinematics.parallel_robot import ParallelRobot
from framework.simulation.collocation import CollocationStep
from framework.tolerances import SAME_PLACE


class Trajectory(Protocol):
    """Configurations (T, nq) and velocities (T, nv) at any times (T,) [s]."""

    @property
    def edges(self) -> Array:
        """Ends of the steps, (steps + 1,) [s]."""

    def __call__(self, t: Array) -> tuple[Array, Array]:
        """Return q and v."""


@dataclass(frozen=True, eq=False)
class Polynomials:
    """Collocation steps: their own polynomials, of the degree of their stages; velocities are continuous."""

    robot: ParallelRobot
    steps: tuple[CollocationStep, ...]

    @property
    def edges(self) -> Array:
        return np.array([self.steps[0].time, *(step.times[-1] for step in self.steps)])

    def __call__(self, t: Array) -> tuple[Array, Array]:
        """Evaluate positions (T, nq) and velocities (T, nv) at times (T,) [s].

        q is the integral of its stages' slopes from the start of the step; v interpolates stages and start.
        """
        which, table = _step_index(self.edges, t), self.steps[0].table
        times, lengths = np.array([(step.time, step.length) for step in self.steps]).T
        basis = table.basis((t - times[which]) / lengths[which])
        starts = np.array([step.start for step in self.steps])[which]
        offset, v = np.empty((2, len(t), self.robot.model.nv))
        for k in np.unique(which):
            step, inside = self.steps[k], which == k
            offset[inside] = basis[inside] @ (step.length * table.series_of_integral @ step.slope)
            rates = np.vstack([step.start_velocity, step.v])
            v[inside] = basis[inside] @ (table.series_with_start @ rates)
        return integrate(self.robot, starts, offset), v


@dataclass(frozen=True, eq=False)
class Cubics(ReadOnlyArrays):
    """Fixed steps: cubic polynomials through the states at their ends."""

    robot: ParallelRobot
    edges: Array  # (K + 1,) [s]
    q: Array  # (K + 1, nq)
    v: Array  # (K + 1, nv)

    def __call__(self, t: Array) -> tuple[Array, Array]:
        """Evaluate cubic Hermite interpolants q (T, nq) and their rates v (T, nv) at times (T,) [s]."""
        which = _step_index(self.edges, t)
        h = np.diff(self.edges)[which][:, None]
        share = (t - self.edges[which])[:, None] / h
        start, end = self.q[which], self.q[which + 1]
        offset = difference(self.robot, start, end)
        v0, v1 = h * self.v[which], h * self.v[which + 1]
        # d(0) = 0, d(1) = offset, d'(0) = v0, d'(1) = v1
        c2, c3 = 3 * offset - 2 * v0 - v1, v0 + v1 - 2 * offset
        step = share * (v0 + share * (c2 + share * c3))
        return integrate(self.robot, start, step), (v0 + share * (2 * c2 + 3 * share * c3)) / h


def _step_index(edges: Array, t: Array) -> Array:
    """Compute the index of the step of each time.

    Raises:
        InvalidInput: a time lies outside.
    """
    slack = SAME_PLACE * (edges[-1] - edges[0])
    if not np.all((t >= edges[0] - slack) & (t <= edges[-1] + slack)):
        raise InvalidInput(f"time {t!r} is outside the simulation, [{edges[0]:g}, {edges[-1]:g}] s")
    return np.clip(np.searchsorted(edges, t, side="right") - 1, 0, len(edges) - 2)
