"""Collocation steps of variable length over a whole simulation.

The length of a step follows from the part of the motion that the previous step left unresolved. At a
singularity of the closures the loops lose rank for an instant. Short steps cannot be solved there, but a long
step may be, with nodes on both sides of the singularity: it bridges the singularity. Therefore, where steps
become much shorter than usual, a few longer steps are tried before the simulation continues with short ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from framework.errors import NotConverged
from framework.numerics.arrays import LEAST_DIVISOR, Array
from framework.simulation.collocation import (
    COORDINATE_ROUNDING,
    Collocation,
    CollocationStep,
    StepEquations,
    StepFailed,
    radau_table,
)
from framework.simulation.consistent_states import allowed_velocity
from framework.simulation.drive import Drive
from framework.simulation.equations import EquationsOfMotion, State
from framework.tolerances import SAME_PLACE

BRIDGING_LENIENCY = 1e3  # factor on the tolerance of a bridging step, whose `unresolved` part is reported
BRIDGED_SHORTENING = 8.0  # steps shorter than the usual one by this factor indicate a singularity
BRIDGING_RATIOS = (2.0, 1.4, 0.9, 2.8, 1.7, 1.15, 0.65)  # bridging steps over the usual step, tried in turn
FIRST_STEP_RATIO = 1 / 8  # of the duration
# bounds on the growth from step to step, and a safety factor
MAX_STEP_GROWTH, MIN_STEP_GROWTH, STEP_SAFETY = 3.0, 0.2, 0.9
NEWTON_SHARE = 0.01  # share of the tolerance to which a step is solved
REFUSED_STEP_RATIO = 0.7  # after an unresolved step, the next is shorter at least by this factor
# largest number of steps of a simulation; their number is extrapolated once so many steps are accepted
MAX_STEPS, PROJECTED_AFTER = 20_000, 100
GUESS_COEFFICIENTS = 4  # number of Legendre coefficients that are extrapolated to the next step


@dataclass
class StepSizeControl:
    """The length of the next step and the quantities that determine its choice; lengths in seconds.

    There are two states. While `short` is 0, the next step is an ordinary one. Otherwise it is a bridging
    step, of a length in `BRIDGING_RATIOS`. If all bridging steps are rejected, ordinary steps continue with
    the length `short`.
    """

    length: float  # of the next step
    longest: float  # length that no ordinary step exceeds
    usual: float = 0.0  # length of accepted steps; falls at most by half from step to step
    short: float = 0.0
    tried: int = 0  # number of bridging steps tried at the present singularity
    accepted: int = 0  # number of accepted steps

    def next_length(self, remaining: float) -> float:
        """Return the length [s] of the next step, with `remaining` [s] to go until the torque may jump.

        The last two steps before that instant are equally long, so that no tiny step is left over.
        """
        count = max(1, int(np.ceil(remaining / self.length - SAME_PLACE)))
        return remaining / count if count <= 2 else self.length

    def accept(self, length: float, factor: float) -> None:
        """Accept a step of this length [s]; multiply the length of the next one by `factor`."""
        self.length = min(self.longest, length * factor)
        self.usual = max(length, 0.5 * self.usual)
        self.short, self.tried = 0.0, 0
        self.accepted += 1

    def reject(self, length: float, factor: float, remaining: float) -> None:
        """Reject a step of this length [s] and choose the next, with `remaining` [s] to go.

        The length is multiplied by `factor`. Where steps become far shorter than usual, bridging steps of
        different lengths are tried first.
        """
        shorter = self.short or length * min(factor, REFUSED_STEP_RATIO)
        is_bridging = self.short > 0.0 or shorter < self.usual / BRIDGED_SHORTENING
        if is_bridging and self.tried < len(BRIDGING_RATIOS):
            self.length = min(BRIDGING_RATIOS[self.tried] * self.usual, remaining)
            self.short = shorter
            self.tried += 1
        else:
            self.length = shorter
            self.short = 0.0


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
        stages: number of nodes of a step.
        tolerance: what a step may leave unresolved [rad, robot lengths].
        longest: largest length of a step [s].

    Raises:
        NotConverged: no step, however short, can be solved or resolved; or too many steps are needed.
    """
    table = radau_table(stages)
    control = StepSizeControl(min(longest, duration * FIRST_STEP_RATIO), longest)
    for time, end in pairwise(drive.edges(duration)):
        previous = None  # the last step, from which the next one is guessed
        failure = ""  # why the last attempt was rejected, if it was
        while time < end:
            if failure and control.length < SAME_PLACE * duration:
                raise _stalled_error(equations, time, control.length, f"and even they fail: {failure}")
            remaining = end - time
            length = control.next_length(remaining)
            step_equations = StepEquations(equations, drive, table, time, length, start)
            guess = _extrapolate_guess(equations, table, previous, length)
            try:
                step = step_equations.solve(*guess, NEWTON_SHARE * tolerance)
            except StepFailed as error:
                failure = str(error)
                previous = None
                control.reject(length, MIN_STEP_GROWTH, remaining)
                continue

            admissible = tolerance + COORDINATE_ROUNDING * _largest_motion(equations, step)
            growth = _step_growth(admissible / max(step.unresolved, LEAST_DIVISOR), stages)
            leniency = BRIDGING_LENIENCY if control.short else 1.0  # for a bridging step
            if step.unresolved > leniency * admissible:
                failure = "the motion is not resolved"
                control.reject(length, growth, remaining)
                continue

            yield step
            failure = ""
            previous = step
            start = end_state(equations, step)
            time = end if length == remaining else time + length
            control.accept(length, growth)
            # at this rate the whole simulation needs accepted * duration / time steps
            if control.accepted >= PROJECTED_AFTER and control.accepted * duration / time > MAX_STEPS:
                raise _stalled_error(equations, time, length, "they are too many")


def _largest_motion(equations: EquationsOfMotion, step: CollocationStep) -> float:
    """Return the largest joint motion of a step [rad, robot lengths], estimated from its slopes."""
    joint_motions = step.length * np.abs(step.slope / equations.robot.column_scale)
    return float(joint_motions.max(initial=0.0))


def _step_growth(ratio: float, stages: int) -> float:
    """Return the factor on the length of the next step for the ratio of admissible to unresolved part.

    The unresolved part is proportional to the length of a step to the power stages + 1.
    """
    growth = STEP_SAFETY * ratio ** (1 / (stages + 1))
    return float(np.clip(growth, MIN_STEP_GROWTH, MAX_STEP_GROWTH))


def _stalled_error(equations: EquationsOfMotion, time: float, length: float, why: str) -> NotConverged:
    """Return the error of a simulation that needs steps as short as `length` [s] at `time` [s].

    `why` ends the first sentence of the message.
    """
    return NotConverged(
        f"{equations.robot.name}: the simulation stops at t = {time:.9g} s, where it needs steps of "
        f"{length:.1e} s {why}. Either the loops lock or branch there, or the torque jumps: instants "
        f"known beforehand go into breaks, a controller that switches needs method fast",
        residual=time,
    )


def end_state(equations: EquationsOfMotion, step: CollocationStep) -> State:
    """Return the state at the end of a step, with the velocity projected onto the loops."""
    tangent = equations.tangent_at_rest(step.q[-1])
    return State(step.q[-1], allowed_velocity(equations, tangent, step.v[-1]))


def _extrapolate_guess(
    equations: EquationsOfMotion, table: Collocation, previous: CollocationStep | None, length: float
) -> tuple[Array, Array]:
    """Guess accelerations (s, nv) and multipliers (s, m) at the nodes of a step of this length [s].

    They are extrapolated from the previous step by its first Legendre coefficients, because the last ones
    would grow too fast outside of it. Without a previous step they are zero.
    """
    if previous is None:
        a = np.zeros((table.stages, equations.robot.nv))
        return a, np.zeros((table.stages, len(equations.rows.names)))
    c = 1.0 + table.nodes * (length / previous.length)  # new nodes; the previous step is [0, 1]
    count = min(GUESS_COEFFICIENTS, table.stages)
    extrapolation = table.basis(c, count - 1) @ table.to_series[:count]  # (s, s) from old to new node values
    return extrapolation @ previous.a, extrapolation @ previous.multipliers
