"""Collocation steps of variable length over a whole simulation.

The length of a step follows from the part of the motion that the step before left unresolved. At a
singularity of the closures the loops lose rank for an instant. Short steps cannot be solved there, but a long
step may be, with its nodes on both sides. Therefore, where steps become much shorter than usual, a few longer
ones are tried before the simulation goes on with short ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from framework.errors import NotConverged
from framework.numerics.arrays import LEAST_DIVISOR, Array
from framework.simulation.collocation import (
    Collocation,
    CollocationStep,
    StepEquations,
    StepFailed,
    radau_table,
)
from framework.simulation.consistent import allowed_velocity
from framework.simulation.drive import Drive
from framework.simulation.equations import EquationsOfMotion
from framework.simulation.schemes import State

BRIDGING_LENIENCY = 1e3  # factor on the tolerance of a step over a singularity; `unresolved` reports it
MIN_STEP_RATIO = 1e-9  # of the duration: the simulation is given up where shorter steps are needed
BRIDGED_SHORTENING = 8.0  # a step shorter than the usual one by this factor meets a singularity
BRIDGING_RATIOS = (2.0, 1.4, 0.9, 2.8, 1.7, 1.15, 0.65)  # of the usual step, tried over a singularity
FAILED_STEP_RATIO = 0.25  # after a step without solution, the next is shorter by this factor
MOVE_ROUNDING = 1e-15  # share of a joint's motion in a step that rounding leaves unresolved
FIRST_STEP_RATIO = 1 / 8  # of the duration
COUNT_ROUNDING = 1e-9  # of a step: a shorter remainder is no step of its own
# bounds on the growth from step to step, and a safety factor
MAX_STEP_GROWTH, MIN_STEP_GROWTH, STEP_SAFETY = 3.0, 0.2, 0.9
NEWTON_SHARE = 0.01  # share of the tolerance to which a step is solved
REFUSED_STEP_RATIO = 0.7  # after an unresolved step, the next is shorter at least by this factor
# steps that a simulation may need, extrapolated from the pace once so many were accepted
MAX_STEPS, PROJECTED_AFTER = 20_000, 100
GUESS_COEFFICIENTS = 4  # number of Legendre coefficients that are extrapolated to the next step


@dataclass
class StepSizeControl:
    """The length of the next step and the quantities that determine its choice; lengths in seconds."""

    length: float  # of the next step
    longest: float
    usual: float = 0.0  # length of the last accepted steps
    short: float = 0.0  # length to go on with if no bridging step succeeds; 0 while none is being tried
    tried: int = 0  # number of `BRIDGING_RATIOS` tried over the present singularity
    accepted: int = 0  # number of steps

    def next_length(self, remaining: float) -> float:
        """Return the length [s] of the next step; the last two of a stretch are equal."""
        count = max(1, int(np.ceil(remaining / self.length - COUNT_ROUNDING)))
        return remaining / count if count <= 2 else self.length

    def accept(self, length: float, factor: float) -> None:
        """Accept a step of this length [s]; set the next by the growth `factor`."""
        self.length = min(self.longest, length * factor)
        self.usual = max(length, 0.5 * self.usual)
        self.short, self.tried = 0.0, 0
        self.accepted += 1

    def reject(self, length: float, factor: float, remaining: float) -> None:
        """Reject a step of this length [s] and choose the next.

        The next step is shorter by `factor`. Where steps become far shorter than usual, long steps over the
        singularity are tried first, one of `BRIDGING_RATIOS` after the other. If none succeeds, the
        simulation goes on with the length `short`.
        """
        shorter = self.short or length * min(factor, REFUSED_STEP_RATIO)
        meets_singularity = bool(self.short) or shorter < self.usual / BRIDGED_SHORTENING
        if meets_singularity and self.tried < len(BRIDGING_RATIOS):
            self.length, self.short = min(BRIDGING_RATIOS[self.tried] * self.usual, remaining), shorter
            self.tried += 1
        else:
            self.length, self.short = shorter, 0.0


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

    A step has `stages` nodes and at most the length `longest` [s]. The tolerance is in rad or robot lengths.
    A step over a singularity of the closures may leave more unresolved; see `CollocationStep.unresolved`.

    Raises:
        NotConverged: no step, however short, can be solved or resolved; or too many steps are needed.
    """
    table = radau_table(stages)
    control = StepSizeControl(min(longest, duration * FIRST_STEP_RATIO), longest)
    for time, end in pairwise(drive.edges(duration)):
        previous = None
        while time < end:
            remaining = end - time
            length = control.next_length(remaining)
            guess = _extrapolate_guess(equations, table, previous, length)
            try:
                step = StepEquations(equations, drive, table, time, length, start).solve(
                    *guess, NEWTON_SHARE * tolerance
                )
            except StepFailed as failure:
                previous, reason = None, str(failure)
                control.reject(length, FAILED_STEP_RATIO, remaining)
            else:
                admissible = tolerance + MOVE_ROUNDING * _largest_motion(equations, step)
                leniency = BRIDGING_LENIENCY if control.short else 1.0  # over a singularity
                growth = _step_growth(admissible / max(step.unresolved, LEAST_DIVISOR), stages)
                if step.unresolved <= leniency * admissible:
                    yield step
                    start, previous = end_state(equations, step), step
                    time = end if length == remaining else time + length
                    control.accept(length, growth)
                    is_slow_pace = control.accepted * duration > MAX_STEPS * time
                    if control.accepted >= PROJECTED_AFTER and is_slow_pace:
                        raise _stalled_error(equations, time, length, "they are too many")
                    continue
                reason = "the motion is not resolved"
                control.reject(length, growth, remaining)
            if control.length < MIN_STEP_RATIO * duration:
                raise _stalled_error(equations, time, control.length, f"and even they fail: {reason}")


def _largest_motion(equations: EquationsOfMotion, step: CollocationStep) -> float:
    """Return the largest joint motion of a step [rad, robot lengths], estimated from its slopes."""
    joint_motions = step.length * np.abs(step.slope / equations.robot.column_scale)
    return float(joint_motions.max(initial=0.0))


def _step_growth(ratio: float, stages: int) -> float:
    """Return the factor on the length of the next step for the ratio of admissible to unresolved part."""
    # the unresolved part grows with the length of a step to the power stages + 1
    return float(np.clip(STEP_SAFETY * ratio ** (1 / (stages + 1)), MIN_STEP_GROWTH, MAX_STEP_GROWTH))


def _stalled_error(equations: EquationsOfMotion, time: float, length: float, why: str) -> NotConverged:
    """Return the error of a simulation that needs steps as short as `length` [s] at `time` [s]."""
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
    """Extrapolate accelerations (s, nv) and multipliers (s, m) from the previous step; zero without one."""
    if previous is None:
        a = np.zeros((table.stages, equations.robot.nv))
        return a, np.zeros((table.stages, len(equations.rows.names)))
    c = 1.0 + table.nodes * (length / previous.length)  # the new nodes on the scale of the previous step
    count = min(GUESS_COEFFICIENTS, table.stages)
    extrapolation = table.basis(c, count - 1) @ table.series[:count]  # (s, s)
    return extrapolation @ previous.a, extrapolation @ previous.multipliers
