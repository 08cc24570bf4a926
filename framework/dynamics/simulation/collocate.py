"""Collocation steps of variable length from one end of a simulation to the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np

from framework.arrays import Array
from framework.dynamics.simulation.collocation import Collocation, radau
from framework.dynamics.simulation.collocation_step import Failure, Step, solve_step
from framework.dynamics.simulation.consistent import allowed_velocity
from framework.dynamics.simulation.drive import Drive
from framework.dynamics.simulation.equations import Equations
from framework.errors import NotConverged
from framework.kinematics.closures import column_scale

ROUNDING = 1e-15  # of a joint's move in a step: less cannot be resolved
SHORTEST = 1e-9  # of the duration: steps below it are given up
FIRST = 1 / 8  # of the duration
# where steps get shorter than the usual one by FEW, try to step over what is there, with these shares of it
FEW, HOPS = 8.0, (2.0, 1.4, 0.9)
LENIENT = 1e3  # times the tolerance that such a step may leave unresolved, since no shorter one does better
MOST_STEPS, LOOKED_AT = 20_000, 100  # at the pace of so many steps, no more than so many may be needed
GUESSED = 4  # Legendre coefficients of a step that guess the next one


def collocate(
    equations: Equations,
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

    Where the loops lose rank in passing (a singularity of the closures) no short step can be solved, but a
    long one may, with its nodes on both sides. Rounding near the singularity may then leave more unresolved
    than the tolerance; `Step.unresolved` tells.

    Raises:
        NotConverged: no step, however short, can be solved or resolved.
    """
    table = radau(stages)
    h, taken = min(longest, duration * FIRST), 0
    edges = [0.0, *(t for t in drive.breaks if 0 < t < duration), duration]
    for start, end in pairwise(edges):
        time, before, usual, back, hops = start, None, 0.0, 0.0, 0
        h = min(h, end - start)
        while time < end:
            left, hopping = end - time, back > 0
            count = max(1, int(np.ceil(left / h - 1e-9)))
            length = left if count == 1 else (left / 2 if count == 2 else h)
            guess = _guess(equations, table, before, length)
            step = solve_step(equations, drive, table, time, length, q, v, guess, 0.01 * tolerance)
            reason = step.reason if isinstance(step, Failure) else "the motion is not resolved"
            factor = 0.25
            if isinstance(step, Step):
                wanted = tolerance + ROUNDING * _largest_move(equations, step)
                fit = (wanted / max(step.unresolved, 1e-300)) ** (1 / (stages + 1))
                factor = float(np.clip(0.9 * fit, 0.2, 3.0))
                if step.unresolved <= (LENIENT * wanted if hopping else wanted):
                    yield step
                    q, v = end_state(equations, step)
                    time, before = (end if count == 1 else time + length), step
                    h, taken = min(longest, length * factor), taken + 1
                    usual, back, hops = max(length, 0.5 * usual), 0.0, 0
                    if advanced is not None:
                        advanced(time / duration)
                    if taken >= LOOKED_AT and taken * duration > MOST_STEPS * time:
                        raise _given_up(equations, time, length, "they are too many")
                    continue
            before = None if isinstance(step, Failure) else before
            shorter = length * min(factor, 0.7)
            if hops < len(HOPS) and (hopping or shorter < usual / FEW):
                h, back, hops = min(HOPS[hops] * usual, left), back or shorter, hops + 1
            else:
                h, back = back or shorter, 0.0  # no hop was any good
            if h < SHORTEST * duration:
                raise _given_up(equations, time, h, f"and even they fail: {reason}")


def _largest_move(equations: Equations, step: Step) -> float:
    """Of a joint during a step [rad, robot lengths]."""
    return step.length * float(np.abs(step.slope / column_scale(equations.robot)).max(initial=0.0))


def _given_up(equations: Equations, time: float, length: float, why: str) -> NotConverged:
    return NotConverged(
        f"{equations.robot.name}: the simulation stops at t = {time:.9g} s, where it needs steps of "
        f"{length:.1e} s {why}. Either the loops lock or branch there, or the torque jumps: instants "
        f"known beforehand go into breaks, a controller that switches needs method fast",
        residual=time,
    )


def end_state(equations: Equations, step: Step) -> tuple[Array, Array]:
    """Where a step ends, its velocity as the loops allow it."""
    rest = np.zeros((1, equations.robot.model.nv))
    at = equations.tangent(step.q[-1:], rest, rest)
    return step.q[-1], allowed_velocity(equations, at, step.v[-1])


def _guess(
    equations: Equations, table: Collocation, before: Step | None, length: float
) -> tuple[Array, Array]:
    """Accelerations and multipliers at the nodes: nothing, or what the step before lets expect."""
    if before is None:
        return np.zeros((table.stages, equations.robot.model.nv)), np.zeros(
            (table.stages, len(equations.rows.names))
        )
    at = 1.0 + table.nodes * (length / before.length)
    few = min(GUESSED, table.stages)
    return (
        table.values((table.series @ before.a)[:few], at),
        table.values((table.series @ before.multipliers)[:few], at),
    )
