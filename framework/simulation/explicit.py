"""Fixed steps of an explicit Runge-Kutta method of order 8 on pinocchio's constrained dynamics.

Nothing is solved for and nothing stacked: a step is twelve calls of pinocchio. For robots whose every joint
moves some mass, and whose loops are points or welds, it takes the least time of all methods to any error
that is not near rounding. Its steps must resolve the quickest vibration (step times frequency below 5).
The table is that of scipy's DOP853, and so is the estimate of the error.
Source: Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, Springer 1993, section II.5.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.simulation.contacts import ContactDynamics
from framework.simulation.drive import Drive
from framework.simulation.equations import EquationsOfMotion

STAGES = 12
CLOSING_STEPS = 50.0  # steps in which open loops close: quicker, and it shows in the error estimate


class Table(NamedTuple):
    """A Runge-Kutta method."""

    nodes: Array  # (STAGES,)
    weights: Array  # (STAGES,)
    rows: tuple[Array, ...]  # row k (k,)
    error: Array  # (STAGES,) weights of the estimate


@cache
def _table() -> Table:
    from scipy.integrate import DOP853  # 0.2 s, not for those who only plan

    rows = tuple(DOP853.A[k, :k] for k in range(STAGES))
    return Table(DOP853.C[:STAGES], DOP853.B, rows, DOP853.E5[:STAGES])


@dataclass(frozen=True, eq=False)
class ExplicitStep:
    """A step: its ends, its mean power and its error."""

    time: float
    length: float
    start: Array  # (2 nv,) q and v
    end: Array
    power: float  # mean power of motors and world less that of damping [W]
    error: float  # estimate of the part of q that the step misses [rad, m]


def explicit_steps(
    equations: EquationsOfMotion, dynamics: ContactDynamics, drive: Drive, start: Array, edges: Array
) -> Iterator[ExplicitStep]:
    """Yield steps between the instants `edges` (K + 1,) from the state (2 nv,); infinite once it diverges."""
    robot, nv = equations.robot, equations.robot.model.nv
    table, force = _table(), _forces(equations, drive, edges)
    instants = edges[:-1, None] + np.diff(edges)[:, None] * table.nodes
    state, K = start, np.empty((STAGES, 2 * nv))
    before = tuple(K[:k] for k in range(STAGES))
    gear, actuated, damping = robot.gear_ratio, robot.actuated, equations.damping
    for k, h in enumerate(np.diff(edges)):
        power = 0.0
        for i in range(STAGES):
            stage = state + h * (table.rows[i] @ before[i]) if i else state
            q, v = stage[:nv], stage[nv:]
            applied, torque = force(k, i, q, v)
            power_of_world = 0.0
            if drive.world.acts:
                pushed = drive.world(robot, instants[k, i : i + 1], q[None])[0]
                applied, power_of_world = applied + pushed, float(pushed @ v)
            K[i, :nv] = v
            K[i, nv:] = dynamics.acceleration(q, v, applied)
            if table.weights[i]:
                of_motors = float((gear * torque) @ v[actuated] - damping @ v**2)
                power += table.weights[i] * (of_motors + power_of_world)
        end = state + h * (table.weights @ K)
        missed = float(np.abs(h * (table.error @ K[:, :nv])).max())
        yield ExplicitStep(float(edges[k]), float(h), state, end, power, missed)
        state = end


Forces = Callable[[int, int, Array, Array], tuple[Array, Array]]


def _forces(equations: EquationsOfMotion, drive: Drive, edges: Array) -> Forces:
    """Return a function (step, stage, q, v) of the motors' generalised forces (nv,) and torques (n_a,)."""
    robot, count = equations.robot, len(edges) - 1
    times = edges[:-1, None] + np.diff(edges)[:, None] * _table().nodes
    if drive.feedback:

        def answer(k: int, i: int, q: Array, v: Array) -> tuple[Array, Array]:
            torque = drive(times[k, i : i + 1], q[None], v[None])
            return equations.applied(torque)[0], torque[0]

        return answer
    instants = np.minimum(drive.before_breaks(times).ravel(), edges[-1])
    torques = drive(instants, *(np.empty((len(instants), 0)),) * 2)
    table = equations.applied(torques).reshape(count, STAGES, -1)
    torques = torques.reshape(count, STAGES, robot.n_a)

    def tabulated(k: int, i: int, q: Array, v: Array) -> tuple[Array, Array]:
        return table[k, i], torques[k, i]

    return tabulated
