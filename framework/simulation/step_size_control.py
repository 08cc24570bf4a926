"""Collocation steps of variable length from one end of a simulation to the other.

Steps grow and shrink with what they leave unresolved. Where the loops lose rank in passing (a singularity of
the closures) short steps cannot be solved at all, but a long one may, with its nodes on both sides: where
steps get much shorter than they usually are, a few longer ones are tried before going on with short ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from framework.errors import NotConverged
from framework.numerics.arrays import LEAST_DIVISOR, Array
from framework.simulation.collocation import Collocation, CollocationStep, radau_table, solve_step
from framework.simulation.consistent import allowed_velocity
from framework.simulation.drive import Drive
from framework.simulation.equations import EquationsOfMotion

BRIDGING_LENIENCY = 1e3  # times the tolerance, left by a step over a singularity; `unresolved` says it
MIN_STEP_RATIO = 1e-9  # of the duration: where shorter ones are taken, the simulation is given up
BRIDGED_SHORTENING = 8.0  # times shorter than the usual step
BRIDGING_RATIOS = (2.0, 1.4, 0.9, 2.8, 1.7, 1.15, 0.65)  # of the usual step, tried over a singularity
FAILED_STEP_RATIO = 0.25  # of its length is tried next when a step was not solved
MOVE_ROUNDING = 1e-15  # of a joint's move in a step: less cannot be resolved
FIRST_STEP_RATIO = 1 / 8  # of the duration
COUNT_ROUNDING = 1e-9  # of a step: a rest that is smaller makes no step of its own
# bounds on the change of length from step to step, and its caution
MAX_STEP_GROWTH, MIN_STEP_GROWTH, STEP_SAFETY = 3.0, 0.2, 0.9
NEWTON_SHARE = 0.01  # of the tolerance, to which a step is solved
REFUSED_STEP_RATIO = 0.7  # of its length, at most, for what is tried next
MAX_STEPS, PROJECTED_AFTER = 20_000, 100  # at the pace of so many steps, no more than so many may be needed
GUESS_COEFFICIENTS = 4  # Legendre coefficients of a step that guess the next one


@dataclass
class StepSizeControl:
    """The length [s] of the next step, with the lengths behind the choice."""

    length: float
    longest: float
    usual: float = 0.0  # length of the last accepted steps
    short: float = 0.0  # to go on with when stepping over does not help; 0: nothing is being stepped over
    tried: int = 0  # number of `BRIDGING_RATIOS` tried over the present singularity
    accepted: int = 0  # number of steps

    def next_length(self, remaining: float) -> float:
        """Return the length [s] of the next step.

        Two equal steps end a stretch, instead of a long one and a tiny one.
        """
        count = max(1, int(np.ceil(remaining / self.length - COUNT_ROUNDING)))
        return remaining / count if count <= 2 else self.length

    def accept(self, length: float, factor: float) -> None:
        """Accept a step; the next may be longer by this factor."""
        self.length = min(self.longest, length * factor)
        self.usual = max(length, 0.5 * self.usual)
        self.short, self.tried = 0.0, 0
        self.accepted += 1

    def reject(self, length: float, factor: float, remaining: float) -> None:
        """Reject a step of this length and choose the next.

        It is shorter by this factor, or steps over a singularity. Where steps become far shorter than usual,
        long ones are tried first, one of `BRIDGING_RATIOS` after the other. If none succeeds, `short` is the
        length to go on with.
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
    q: Array,
    v: Array,
    duration: float,
    *,
    stages: int,
    tolerance: float,
    longest: float,
) -> Iterator[CollocationStep]:
    """Yield steps from 0 to `duration`, each resolved to `tolerance`.

    Over a singularity of the closures rounding may leave more unresolved; `CollocationStep.unresolved` tells.

    Raises:
        NotConverged: no step, however short, can be solved or resolved.
    """
    table = radau_table(stages)
    control = StepSizeControl(min(longest, duration * FIRST_STEP_RATIO), longest)
    for time, end in pairwise(drive.edges(duration)):
        previous = None
        while time < end:
            length = control.next_length(end - time)
            step = solve_step(
                equations,
                drive,
                table,
                time=time,
                length=length,
                q0=q,
                v0=v,
                guess=_extrapolate_guess(equations, table, previous, length),
                accuracy=NEWTON_SHARE * tolerance,
            )
            if isinstance(step, str):
                previous, reason = None, step
                control.reject(length, FAILED_STEP_RATIO, end - time)
            else:
                joint_motions = length * np.abs(step.slope / equations.robot.column_scale)
                admissible = tolerance + MOVE_ROUNDING * float(joint_motions.max(initial=0.0))
                # what a step leaves unresolved grows with its length to the power stages + 1
                factor = (admissible / max(step.unresolved, LEAST_DIVISOR)) ** (1 / (stages + 1))
                factor = float(np.clip(STEP_SAFETY * factor, MIN_STEP_GROWTH, MAX_STEP_GROWTH))
                leniency = BRIDGING_LENIENCY if control.short else 1.0  # over a singularity
                if step.unresolved <= leniency * admissible:
                    yield step
                    q, v = end_state(equations, step)
                    time = end if length == end - time else time + length
                    previous = step
                    control.accept(length, factor)
                    many = control.accepted >= PROJECTED_AFTER
                    if many and control.accepted * duration > MAX_STEPS * time:
                        raise _stalled_error(equations, time, length, "they are too many")
                    continue
                reason = "the motion is not resolved"
                control.reject(length, factor, end - time)
            if control.length < MIN_STEP_RATIO * duration:
                raise _stalled_error(equations, time, control.length, f"and even they fail: {reason}")


def _stalled_error(equations: EquationsOfMotion, time: float, length: float, why: str) -> NotConverged:
    """Return the error of a simulation that needs too short steps.

    At this time [s] it needs steps of this length [s].
    """
    return NotConverged(
        f"{equations.robot.name}: the simulation stops at t = {time:.9g} s, where it needs steps of "
        f"{length:.1e} s {why}. Either the loops lock or branch there, or the torque jumps: instants "
        f"known beforehand go into breaks, a controller that switches needs method fast",
        residual=time,
    )


def end_state(equations: EquationsOfMotion, step: CollocationStep) -> tuple[Array, Array]:
    """Return the state at the end of a step.

    Its velocity is one that the loops allow.
    """
    tangent = equations.tangent_at_rest(step.q[-1])
    return step.q[-1], allowed_velocity(equations, tangent, step.v[-1])


def _extrapolate_guess(
    equations: EquationsOfMotion, table: Collocation, previous: CollocationStep | None, length: float
) -> tuple[Array, Array]:
    """Extrapolate accelerations and multipliers at the nodes from the previous step; zero without one."""
    if previous is None:
        a = np.zeros((table.stages, equations.robot.nv))
        return a, np.zeros((table.stages, len(equations.rows.names)))
    shares = 1.0 + table.nodes * (length / previous.length)
    count = min(GUESS_COEFFICIENTS, table.stages)
    ahead = table.basis(shares, count - 1) @ table.series[:count]
    return ahead @ previous.a, ahead @ previous.multipliers
