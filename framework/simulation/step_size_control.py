"""Collocation steps of variable length over a whole simulation.

The length of a step follows from the part of the motion that the previous step left unresolved. At a
singularity of the closures the loops lose rank for an instant. Short steps cannot be solved there, but a long
step may be, with nodes on both sides of the singularity: it bridges the singularity. Therefore, where steps
become much shorter than usual, a few longer steps are tried before the simulation continues with short ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from framework.errors import NotConverged
from framework.numerics.arrays import LEAST_DIVISOR, Array
from framework.simulation.collocation import (
    COORDINATE_ROUNDING,
    CollocationStep,
    StepEquations,
    StepFailed,
    radau_table,
)
from framework.simulation.consistent_states import allowed_velocity
from framework.simulation.drive import Drive
from framework.simulation.equations import EquationsOfMotion, State
from framework.tolerances import SAME_PLACE


def collocate(
    equations: EquationsOfMotion,
    drive: Drive,
    start: State,
    duration: float,
    *,
    stages: int,
    tolerance: float,
    longest: float,
) -> Iterator[CollocationStep]:
    """Yield the steps from `start` at 0 to `duration` [s], each resolved to `tolerance`.

    A step over a singularity of the closures may leave a larger part unresolved, which
    `CollocationStep.unresolved` reports.

    Args:
        drive: motor torques, whose breaks are ends of steps, and external wrenches.
        stages: number of nodes of a step.
        tolerance: what a step may leave unresolved [rad, robot lengths].
        longest: largest length of a step [s], except to bridge a singularity.

    Raises:
        NotConverged: no step, however short, can be solved or resolved; or too many steps are needed.
    """
    max_steps = 20_000  # of a simulation
    projected_after = 100  # accepted steps after which the whole number is extrapolated
    table = radau_table(stages)
    # of the next step; the first is short, because nothing is known of the motion yet
    length = min(longest, duration / stages)
    usual = 0.0  # length of accepted steps; falls at most by half from step to step
    accepted = 0
    for time, end in pairwise(drive.edges(duration)):
        previous = None  # the last step, from which the next one is guessed
        while time < end:
            # take the first length with which the step is solved; if none is left, the `else` raises
            for candidate, leniency in _step_lengths(length, usual, end - time, SAME_PLACE * duration):
                step_equations = StepEquations(equations, drive, table, time, candidate, start)
                try:
                    step, growth = _try_step(step_equations, previous, tolerance, leniency)
                    break
                except StepFailed as error:
                    failure = error
            else:
                raise _stalled_error(equations, time, candidate, f"and even they fail: {failure}")

            yield step
            previous = step
            # the next step begins with a velocity that the loops allow
            q = step.q[-1]
            start = State(q, allowed_velocity(equations, equations.tangent_at_rest(q), step.v[-1]))
            time = end if candidate == end - time else step.end
            length = min(longest, candidate * growth)
            usual = max(candidate, 0.5 * usual)
            accepted += 1
            # at this rate the whole simulation needs accepted * duration / time steps
            if accepted >= projected_after and accepted * duration / time > max_steps:
                raise _stalled_error(equations, time, candidate, "they are too many")


def _step_lengths(
    length: float, usual: float, remaining: float, shortest: float
) -> Iterator[tuple[float, float]]:
    """Yield the lengths [s] to try in turn for a step, each with its factor on the tolerance.

    The length is halved from try to try. Where steps become shorter than usual by the factor
    `bridged_shortening`, longer ones that may bridge a singularity are tried once. Each length is adapted by
    `_divide_evenly`, so that no tiny step is left over at the end.

    Args:
        length: the first length [s].
        usual: usual length of accepted steps [s].
        remaining: time to go until the torque may jump [s].
        shortest: length below which no step is tried [s].
    """
    # factor on the tolerance of a bridging step, whose `unresolved` part is reported
    bridging_leniency = 1e3
    bridged_shortening = 8.0  # steps shorter than the usual one by this factor indicate a singularity
    # bridging steps over the usual step, tried in turn
    bridging_ratios = (2.0, 1.4, 0.9, 2.8, 1.7, 1.15, 0.65)
    bridging = [min(ratio * usual, remaining) for ratio in bridging_ratios]  # [s]; emptied once tried
    yield _divide_evenly(length, remaining), 1.0
    while (length := length / 2) >= shortest:
        if length < usual / bridged_shortening:
            for bridge in bridging:
                yield _divide_evenly(bridge, remaining), bridging_leniency
            bridging = []
        yield _divide_evenly(length, remaining), 1.0


def _divide_evenly(length: float, remaining: float) -> float:
    """Return the length [s] of a step of about `length`, with `remaining` [s] until the torque may jump.

    The last two steps before that instant are equally long, so that no tiny step is left over.
    """
    count = max(1, int(np.ceil(remaining / length - SAME_PLACE)))
    return remaining / count if count <= 2 else length


def _try_step(
    equations: StepEquations, previous: CollocationStep | None, tolerance: float, leniency: float
) -> tuple[CollocationStep, float]:
    """Solve a step from a guess that is extrapolated from the previous one.

    Args:
        previous: the previous step; None after a break of the torque.
        tolerance: what a step may leave unresolved [rad, robot lengths].
        leniency: factor on this part for a bridging step.

    Returns:
        The step, and the factor on the length of the next one that keeps its unresolved part admissible.

    Raises:
        StepFailed: the step cannot be solved, or leaves more unresolved.
    """
    newton_share = 0.01  # share of the tolerance to which a step is solved
    step_safety = 0.8  # factor on the length that the estimate of the unresolved part allows
    step = equations.solve(*_extrapolate_guess(equations, previous), newton_share * tolerance)
    # admissible are the tolerance and the rounding of the step's motion, [rad, robot lengths]
    motions = step.length * np.abs(step.offset_rate / equations.equations.robot.column_scale)
    admissible = tolerance + COORDINATE_ROUNDING * float(motions.max(initial=0.0))
    if step.unresolved > leniency * admissible:
        raise StepFailed("the motion is not resolved")
    # the unresolved part is proportional to the length of a step to the power stages + 1
    ratio = admissible / max(step.unresolved, LEAST_DIVISOR)
    return step, step_safety * float(ratio ** (1 / (step.table.stages + 1)))


def _stalled_error(equations: EquationsOfMotion, time: float, length: float, why: str) -> NotConverged:
    """Return the error of a simulation that needs steps as short as `length` [s] at `time` [s].

    `why` ends the first sentence of the message.
    """
    return NotConverged(
        f"the simulation stops at t = {time:.9g} s, where it needs steps of "
        f"{length:.1e} s {why}. Either the loops lock or branch there, or the torque jumps: instants "
        f"known beforehand go into breaks, a controller that switches needs method fast",
        name=equations.robot.name,
        residual=time,
    )


def _extrapolate_guess(step: StepEquations, previous: CollocationStep | None) -> tuple[Array, Array]:
    """Guess accelerations (s, nv) and multipliers (s, m) at the nodes of a step.

    The first Legendre coefficients of the previous step are extrapolated. The last ones are left out, because
    their polynomials grow too fast outside of the step. Without a previous step the guess is zero.
    """
    guess_coefficients = 4  # number of Legendre coefficients that are extrapolated to the next step
    table = step.table
    if previous is None:
        a = np.zeros((table.stages, step.equations.robot.nv))
        return a, np.zeros((table.stages, len(step.equations.rows.names)))
    c = 1.0 + table.nodes * (step.length / previous.length)  # new nodes; the previous step is [0, 1]
    count = min(guess_coefficients, table.stages)
    extrapolation = table.basis(c, count - 1) @ table.to_series[:count]  # (s, s) from old to new node values
    return extrapolation @ previous.a, extrapolation @ previous.multipliers
