"""Fixed steps of an explicit Runge-Kutta method of order 8 on pinocchio's constrained dynamics.

Nothing is solved for and nothing stacked: a step is twelve calls of pinocchio. For robots whose every joint
moves some mass, and whose loops are points or welds, it takes the least time of all methods to any error
that is not near rounding. Its steps must resolve the quickest vibration (step times frequency below 5).
The table is that of scipy's DOP853, and so is the estimate of the error.
Source: Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, Springer 1993, section II.5.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.simulation.contacts import ContactDynamics
from framework.simulation.drive import Drive
from framework.simulation.equations import EquationsOfMotion
from framework.simulation.schemes import State

CLOSING_STEPS = 50.0  # steps in which open loops close: quicker, and it shows in the error estimate


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
    from scipy.integrate import DOP853  # 0.2 s, not for those who only plan

    forces = _forces(equations, drive, edges, DOP853.C)
    state, nv, stages = np.concatenate(start), len(start.v), DOP853.n_stages
    K = np.empty((stages, 2 * nv))
    for k, h in enumerate(np.diff(edges)):
        power = 0.0
        for i in range(stages):
            stage = state + h * (DOP853.A[i, :i] @ K[:i]) if i else state
            q, v = stage[:nv], stage[nv:]
            force = forces(k, i, q, v)
            K[i, :nv], K[i, nv:] = v, dynamics.acceleration(q, v, force)
            power += DOP853.B[i] * float(force @ v - equations.damping @ v**2)
        state = state + h * (DOP853.B @ K)
        yield FixedStep(
            time=float(edges[k]),
            end_time=float(edges[k]) + float(h),
            length=float(h),
            end=State(state[:nv], state[nv:]),
            power=power,
            error=float(np.abs(h * (DOP853.E5[:stages] @ K[:, :nv])).max()),
        )


def _forces(
    equations: EquationsOfMotion, drive: Drive, edges: Array, nodes: Array
) -> Callable[[int, int, Array, Array], Array]:
    """Return a function (step, stage, q, v) of the generalised forces (nv,) of motors and world.

    Stages are at `nodes` (stages,) of the steps between `edges` (K + 1,).
    """
    times = edges[:-1, None] + np.diff(edges)[:, None] * nodes
    torques = drive.of_time(np.minimum(drive.shift_breaks(times).ravel(), edges[-1]))
    motors = None if torques is None else equations.motor_forces(torques)

    def forces(k: int, i: int, q: Array, v: Array) -> Array:
        time = times[k, i : i + 1]
        if motors is None:
            force = equations.motor_forces(drive(time, q[None], v[None]))[0]
        else:
            force = motors[k * len(nodes) + i]
        return force + drive.world(equations.robot, time, q[None])[0] if drive.world.acts else force

    return forces
