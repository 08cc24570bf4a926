"""The integrators of `simulate`, listed in `METHODS`: each computes a trajectory and its energy balance.

Methods reference and stiff are collocation (`collocate`), method fast takes the fixed steps of `Stepper`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput, NotConverged
from framework.kinematics.frames import integrate
from framework.numerics.arrays import Array
from framework.simulation.collocation import CollocationStep
from framework.simulation.drive import Drive
from framework.simulation.equations import EquationsOfMotion, State, stack_states
from framework.simulation.step_size_control import collocate
from framework.simulation.stepper import Stepper, choose_scheme
from framework.simulation.trajectory import Cubics, Event, Occurrence, Polynomials, Trajectory, occurrences
from framework.tolerances import FIXED_STEP_ERROR, SAME_PLACE

MAX_STEPS = 1_000_000  # of methods with steps of one length


class MethodSettings(NamedTuple):
    """The settings of a method; each method ignores some."""

    stages: int = 0  # number of nodes of a collocation step; 0 for methods without collocation
    tolerance: float = 0.0  # largest part of a collocation step left unresolved [rad, robot lengths]
    step: float = 0.0  # length of fixed steps, or of the longest step [s]; 0 for the default of the method


@dataclass
class RunRecord:
    """The energy balance and the events of a run, over the K steps so far."""

    duration: float  # [s]
    events: Sequence[Event]
    event_samples: int  # number of instants of a step at which events are evaluated
    report_progress: Callable[[float], None] | None  # called with the finished share of the motion, 0 to 1
    # energy supplied until each end of a step [J], K + 1 values: the sum of the `work` of `add_step`
    supplied: list[float] = field(default_factory=lambda: [0.0])
    exchanged: float = 0.0  # sum of the exchanged energy of all steps [J]
    occurred: list[Occurrence] = field(default_factory=list)
    last_values: dict[Event, float] = field(default_factory=dict)  # of events at the end of the last step

    def add_step(self, step: Trajectory, work: float, exchange: float) -> bool:
        """Add a step; return whether an event ends the run.

        Args:
            work: work of motors and external wrenches minus the energy that damping dissipates [J].
            exchange: integral of the absolute power of this work over the step [J].
        """
        self.supplied.append(self.supplied[-1] + work)
        self.exchanged += exchange
        if self.events:
            self.occurred += occurrences(self.events, step, self.event_samples, self.last_values)
            if self.occurred and self.occurred[-1].terminal:
                return True
        if self.report_progress is not None:
            self.report_progress(min(float(step.edges[-1]) / self.duration, 1.0))
        return False


class Integration(NamedTuple):
    """The motion that a method computes."""

    trajectory: Trajectory
    unresolved: float  # see `Simulation`
    iterations: int  # of Newton's method; of fixed steps, their number


def integrate_by_collocation(
    equations: EquationsOfMotion, drive: Drive, start: State, record: RunRecord, settings: MethodSettings
) -> Integration:
    """Integrate by Radau IIA steps of variable length; see `collocate`."""
    robot = equations.robot
    steps = list[CollocationStep]()
    for step in collocate(
        equations,
        drive,
        start,
        record.duration,
        stages=settings.stages,
        tolerance=settings.tolerance,
        longest=settings.step or record.duration,
    ):
        steps.append(step)
        power = step.power - equations.dissipated_power(step.q, step.v)  # [W] at the s nodes
        weights = step.length * step.table.integration[-1]  # (s,) of the integral to the last node, the end
        work = float(weights @ power)
        exchange = float(weights @ np.abs(power))
        if record.add_step(Polynomials(robot, (step,)), work, exchange):
            break
    unresolved = max(step.unresolved for step in steps)
    iterations = sum(step.iterations for step in steps)
    return Integration(Polynomials(robot, tuple(steps)), unresolved, iterations)


def integrate_by_fixed_steps(
    equations: EquationsOfMotion, drive: Drive, start: State, record: RunRecord, settings: MethodSettings
) -> Integration:
    """Integrate by steps of one length under the torque in their middle; see `Stepper`."""
    robot, duration = equations.robot, record.duration
    steps = duration / settings.step
    if not steps <= MAX_STEPS:
        raise InvalidInput(f"step: {settings.step!r} s makes more than {MAX_STEPS} steps of {duration:g} s")
    count = max(1, int(np.ceil(steps - SAME_PLACE)))
    if count < 2:  # the error is estimated from second differences
        raise InvalidInput(f"step: {settings.step:g} s is too long for {duration:g} s; take at least 2 steps")
    trajectory = _take_fixed_steps(equations, drive, start, record, np.linspace(0.0, duration, count + 1))
    h = duration / count
    # The error [rad, robot lengths] that steps of order 2 accumulate, without its growth along an unstable
    # motion, is the sum of the truncation errors, for the coordinate of the largest sum. That of a step is
    # h^3 / 12 times the third derivative of q: the second difference of velocities (K + 1, nv) over h^2.
    second_differences = np.abs(np.diff(trajectory.v / robot.column_scale, 2, axis=0))
    error = float(h / 12 * second_differences.sum(axis=0).max(initial=0.0))
    if error > FIXED_STEP_ERROR:
        # the error grows with the square of h: advise a step with a tenth of the error allowed
        advised = h * (0.1 * FIXED_STEP_ERROR / error) ** 0.5
        raise NotConverged(
            f"steps of {h:.3g} s leave about {error:.2g} rad or robot lengths of this motion "
            f"unresolved; as the error falls with the square of the step, about {advised:.1g} s leave a "
            f"tenth of what is allowed (method stiff chooses its steps)",
            name=robot.name,
            residual=error,
        )
    return Integration(trajectory, error, len(trajectory.q) - 1)


def _take_fixed_steps(
    equations: EquationsOfMotion, drive: Drive, start: State, record: RunRecord, edges: Array
) -> Cubics:
    """Take steps of `Stepper` between the instants `edges` (K + 1,), until the end or a terminal event.

    The torque of a step is that in its middle. A feedback torque responds to the state at the beginning of a
    step, as a digital controller does. External wrenches are those at the predicted middle of a step. The
    power is that at the mean velocity, which gives the work of constant forces along the step.

    Raises:
        NotConverged: the motion diverges.
    """
    robot = equations.robot
    stepper = Stepper((equations,), choose_scheme(equations))
    h = record.duration / (len(edges) - 1)
    middles = edges[:-1] + 0.5 * h
    torques = drive.torques_without_feedback(middles)  # (K, n_a); None with feedback
    states = [start]
    with np.errstate(over="ignore", invalid="ignore"):  # divergence is reported below
        for k in range(len(middles)):
            q, v = states[-1]
            if torques is not None:
                torque = torques[k]
            else:
                torque = drive(edges[k : k + 1], q[None], v[None])[0]
            world = np.zeros_like(v)  # generalised forces of the external wrenches
            if drive.world.acts:
                middle = integrate(robot, q, 0.5 * h * v)[None]
                world = drive.world(robot, middles[k : k + 1], middle, v[None])[0]
            end = stepper.step(q, v, torque, h, world=world)
            if not all(np.all(np.isfinite(part)) for part in end):
                raise NotConverged(
                    f"the simulation runs away at t = {edges[k]:.9g} s, or its equations are "
                    f"singular there; the steps are of {h:.3g} s (method stiff chooses its own)",
                    name=robot.name,
                    residual=float(edges[k]),
                )
            states.append(end)

            mean = 0.5 * (v + end.v)  # (nv,)
            supplied = (robot.gear_ratio * torque) @ mean[robot.actuated] + world @ mean  # [W]
            middle = integrate(robot, q, 0.5 * h * mean)[None]
            work = h * float(supplied - equations.dissipated_power(middle, mean[None])[0])
            piece = Cubics(robot, edges[k : k + 2], *stack_states(states[-2:]))
            if record.add_step(piece, work, abs(work)):
                break
    return Cubics(robot, edges[: len(states)], *stack_states(states))


_REFERENCE = MethodSettings(stages=16, tolerance=1e-12)
METHODS = {
    "reference": _REFERENCE,
    "explicit": _REFERENCE,  # deprecated, see `simulate`
    "fast": MethodSettings(step=1e-3),
    "stiff": MethodSettings(stages=5, tolerance=1e-7),
}
