"""Fixed steps of an explicit Runge-Kutta method of order 8 on pinocchio's constrained dynamics.

Nothing is solved for and nothing stacked: a step is twelve calls of pinocchio. For robots whose every joint
moves some mass, and whose loops are points or welds, it takes the least time of all methods to any error
that is not near rounding. Its steps must resolve the quickest vibration (step times frequency below 5).
The table is that of scipy's DOP853, and so is the estimate of the error.
Source: Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, Springer 1993, section II.5.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.simulation.contacts import ContactDynamics
from framework.simulation.drive import Drive
from framework.simulation.equations import EquationsOfMotion
from framework.simulation.schemes import State

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
    """Return the table of DOP853."""
    from scipy.integrate import DOP853  # 0.2 s, not for those who only plan

    rows = tuple(DOP853.A[k, :k] for k in range(STAGES))
    return Table(DOP853.C[:STAGES], DOP853.B, rows, DOP853.E5[:STAGES])


class FixedStep(NamedTuple):
    """A step: its ends, its mean power and its error."""

    time: float
    end_time: float
    length: float
    end: State
    power: float  # mean power of motors and world less that of damping [W]
    error: float = 0.0  # estimate of the part of q that the step misses [rad, m]


def explicit_steps(
    equations: EquationsOfMotion, dynamics: ContactDynamics, drive: Drive, start: State, edges: Array
) -> Iterator[FixedStep]:
    """Yield steps between the instants `edges` (K + 1,), also non-finite ones after divergence."""
    table, forces = _table(), _forces(equations, drive, edges)
    state, nv = np.concatenate(start), len(start.v)
    K = np.empty((STAGES, 2 * nv))
    for k, h in enumerate(np.diff(edges)):
        power = 0.0
        for i in range(STAGES):
            stage = state + h * (table.rows[i] @ K[:i]) if i else state
            q, v = stage[:nv], stage[nv:]
            force, supplied = forces(k, i, q, v)
            K[i, :nv], K[i, nv:] = v, dynamics.acceleration(q, v, force)
            power += table.weights[i] * supplied
        state = state + h * (table.weights @ K)
        yield FixedStep(
            time=float(edges[k]),
            end_time=float(edges[k]) + float(h),
            length=float(h),
            end=State(state[:nv], state[nv:]),
            power=power,
            error=float(np.abs(h * (table.error @ K[:, :nv])).max()),
        )


Forces = Callable[[int, int, Array, Array], tuple[Array, float]]


def _forces(equations: EquationsOfMotion, drive: Drive, edges: Array) -> Forces:
    """Return a function (step, stage, q, v) of the generalised forces (nv,) and their power [W].

    Forces of motors and world; the power less that of damping, and 0 at stages without weight.
    """
    robot, weights = equations.robot, _table().weights
    times = edges[:-1, None] + np.diff(edges)[:, None] * _table().nodes
    torques = drive.of_time(np.minimum(drive.shift_breaks(times).ravel(), edges[-1]))
    motors = None if torques is None else equations.motor_forces(torques)

    def forces(k: int, i: int, q: Array, v: Array) -> tuple[Array, float]:
        if torques is None or motors is None:
            torque = drive(times[k, i : i + 1], q[None], v[None])[0]
            force = equations.motor_forces(torque[None])[0]
        else:
            force, torque = motors[k * STAGES + i], torques[k * STAGES + i]
        power = 0.0
        if weights[i]:
            power = float((robot.gear_ratio * torque) @ v[robot.actuated] - equations.damping @ v**2)
        if drive.world.acts:
            world = drive.world(robot, times[k, i : i + 1], q[None])[0]
            force, power = force + world, power + (float(world @ v) if weights[i] else 0.0)
        return force, power

    return forces
