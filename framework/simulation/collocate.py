"""Collocation steps of variable length from one end of a simulation to the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np

from framework.arrays import Array
from framework.errors import NotConverged
from framework.simulation.collocation import Collocation, radau
from framework.simulation.collocation_step import Failure, Step, solve_step
from framework.simulation.consistent import allowed_velocity
from framework.simulation.drive import Drive
from framework.simulation.equations import EquationsOfMotion
from framework.simulation.pace import FAILED, Pace

ROUNDING = 1e-15  # of a joint's move in a step: less cannot be resolved
SHORTEST = 1e-9  # of the duration: steps below it are given up
FIRST = 1 / 8  # of the duration
MOST_STEPS, LOOKED_AT = 20_000, 100  # at the pace of so many steps, no more than so many may be needed
GUESSED = 4  # Legendre coefficients of a step that guess the next one


def collocate(
    equations: EquationsOfMotion,
    drive: Drive,
    q: Array,
    v: Array,
    duration: float,
    *,
    stages: int,
    tolerance: float,
    longest: float,
    advanced: Callable[[float], None] | None = None,
) -> Iterator[Step]:
    """Steps from 0 to `duration`; each keeps what it leaves unresolved below `tolerance`.

    Over a singularity of the closures rounding may leave more unresolved; `Step.unresolved` tells.

    Raises:
        NotConverged: no step, however short, can be solved or resolved.
    """
    table, taken = radau(stages), 0
    pace = Pace(min(longest, duration * FIRST), longest)
    edges = [0.0, *(t for t in drive.breaks if 0 < t < duration), duration]
    for start, end in pairwise(edges):
        time, before = start, None
        while time < end:
            length = pace.fitted(end - time)
            guess = _guess(equations, table, before, length)
            step = solve_step(
                equations,
                drive,
                table,
                time=time,
                length=length,
                q0=q,
                v0=v,
                guess=guess,
                accuracy=0.01 * tolerance,
            )
            if isinstance(step, Failure):
                before, reason = None, step.reason
                pace.refused(length, FAILED, end - time)
            else:
                wanted = tolerance + ROUNDING * _largest_move(equations, step)
                fit = (wanted / max(step.unresolved, 1e-300)) ** (1 / (stages + 1))
                factor = float(np.clip(0.9 * fit, 0.2, 3.0))
                if step.unresolved <= pace.leniency * wanted:
                    yield step
                    q, v = end_state(equations, step)
                    time, before, taken = (end if length == end - time else time + length), step, taken + 1
                    pace.taken(length, factor)
                    if advanced is not None:
                        advanced(time / duration)
                    if taken >= LOOKED_AT and taken * duration > MOST_STEPS * time:
                        raise _given_up(equations, time, length, "they are too many")
                    continue
                reason = "the motion is not resolved"
                pace.refused(length, factor, end - time)
            if pace.length < SHORTEST * duration:
                raise _given_up(equations, time, pace.length, f"and even they fail: {reason}")


def _largest_move(equations: EquationsOfMotion, step: Step) -> float:
    """Of a joint during a step [rad, robot lengths]."""
    return step.length * float(np.abs(step.slope / equations.robot.column_scale).max(initial=0.0))


def _given_up(equations: EquationsOfMotion, time: float, length: float, why: str) -> NotConverged:
    return NotConverged(
        f"{equations.robot.name}: the simulation stops at t = {time:.9g} s, where it needs steps of "
        f"{length:.1e} s {why}. Either the loops lock or branch there, or the torque jumps: instants "
        f"known beforehand go into breaks, a controller that switches needs method fast",
        residual=time,
    )


def end_state(equations: EquationsOfMotion, step: Step) -> tuple[Array, Array]:
    """Where a step ends, its velocity as the loops allow it."""
    rest = np.zeros((1, equations.robot.model.nv))
    at = equations.tangent(step.q[-1:], rest, rest)
    return step.q[-1], allowed_velocity(equations, at, step.v[-1])


def _guess(
    equations: EquationsOfMotion, table: Collocation, before: Step | None, length: float
) -> tuple[Array, Array]:
    """Accelerations and multipliers at the nodes: nothing, or what the step before lets expect."""
    if before is None:
        return np.zeros((table.stages, equations.robot.model.nv)), np.zeros(
            (table.stages, len(equations.rows.names))
        )
    at = 1.0 + table.nodes * (length / before.length)
    few = min(GUESSED, table.stages)
    ahead = table.basis(at, few - 1) @ table.series[:few]
    return ahead @ before.a, ahead @ before.multipliers
