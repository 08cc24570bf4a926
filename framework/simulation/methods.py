"""The integrators of `simulate`, as data: each turns a start into a trajectory and the energy spent."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.errors import InvalidInput, NotConverged
from framework.kinematics.frames import integrate
from framework.kinematics.parallel_robot import ParallelRobot
from framework.simulation.contacts import ContactDynamics
from framework.simulation.drive import Drive
from framework.simulation.equations import EquationsOfMotion
from framework.simulation.events import Event, Occurrence, occurrences
from framework.simulation.explicit import CLOSING_STEPS, explicit_steps
from framework.simulation.schemes import State
from framework.simulation.step_size_control import COUNT_ROUNDING, collocate
from framework.simulation.stepper import Stepper
from framework.simulation.trajectory import Cubics, Polynomials, Trajectory
from framework.tolerances import FIXED_STEP_ERROR

DEFAULT_EXPLICIT_STEPS = 256  # by default
MAX_STEPS = 1_000_000  # of one length
MIN_FIXED_STEPS = 4  # of method fast: fewer show nothing of what they leave out


class MethodSettings(NamedTuple):
    """Numbers of a method; those that do not concern it are ignored."""

    stages: int = 0  # of collocation
    tolerance: float = 0.0  # what a step may leave unresolved [rad, robot lengths]
    step: float = 0.0  # fixed step, or the longest one [s]
    looks: int = 1  # how often a step is looked at for events


class IntegrationTask(NamedTuple):
    """The input of a simulation, checked and completed."""

    equations: EquationsOfMotion
    drive: Drive
    start: State
    duration: float
    events: Sequence[Event]
    advanced: Callable[[float], None] | None


@dataclass(frozen=True, eq=False)
class Integration:
    """The result of a method: the motion, and the energy balance at the ends of its steps."""

    trajectory: Trajectory
    supplied: Array  # (K + 1,) work of motors and world less that of damping, from the start [J]
    exchanged: float  # all of it counted positive [J]
    occurrences: tuple[Occurrence, ...]
    unresolved: float
    iterations: int


def by_collocation(task: IntegrationTask, settings: MethodSettings) -> Integration:
    """Integrate by Radau IIA steps of variable length; see `collocate`."""
    equations, steps, occurred, supplied, exchanged = task.equations, [], [], [0.0], 0.0
    weights, last_values = equations.damping, dict[Event, float]()
    for step in collocate(
        equations,
        task.drive,
        *task.start,
        task.duration,
        stages=settings.stages,
        tolerance=settings.tolerance,
        longest=settings.step or task.duration,
        advanced=task.advanced,
    ):
        steps.append(step)
        power = step.power - step.v**2 @ weights
        share = step.length * step.table.once[-1]
        supplied.append(supplied[-1] + float(share @ power))
        exchanged += float(share @ np.abs(power))
        if task.events:
            piece = Polynomials(equations.robot, (step,))
            occurred += occurrences(
                task.events, piece, (step.time, float(step.times[-1])), settings.looks, last_values
            )
            if occurred and occurred[-1].terminal:
                break
    return Integration(
        Polynomials(equations.robot, tuple(steps)),
        np.array(supplied),
        exchanged,
        tuple(occurred),
        max(step.unresolved for step in steps),
        sum(step.iterations for step in steps),
    )


def by_fixed_steps(task: IntegrationTask, settings: MethodSettings) -> Integration:
    """Integrate by steps of one length with the torque of their middle; see `Stepper`."""
    equations, drive = task.equations, task.drive
    robot = equations.robot
    stepper = Stepper.of(robot, damping=equations.damping)
    count = _count(task.duration, settings.step)
    if count < MIN_FIXED_STEPS:
        raise InvalidInput(
            f"step: {settings.step:g} s is too long for {task.duration:g} s, which "
            f"needs {MIN_FIXED_STEPS} steps"
        )
    h = task.duration / count
    edges = np.linspace(0.0, task.duration, count + 1)
    states, work, exchanged, occurred = [task.start], [0.0], 0.0, []
    last_values: dict[Event, float] = {}
    torques = None if drive.feedback else drive(edges[:-1] + 0.5 * h, *(np.empty((count, 0)),) * 2)
    for k in range(count):
        q, v = states[-1]
        torque = drive(edges[k : k + 1], q[None], v[None])[0] if torques is None else torques[k]
        pushed = _pushed(drive, edges[k] + 0.5 * h, q, 0.5 * h * v)
        state = stepper.step(q, v, torque, h, pushed=pushed)
        if not (np.all(np.isfinite(state.q)) and np.all(np.isfinite(state.v))):
            raise _runaway(robot, float(edges[k]), h)
        states.append(state)
        mean = 0.5 * (v + state.v)
        power = float((robot.gear_ratio * torque) @ mean[robot.actuated] - mean**2 @ equations.damping)
        power += 0.0 if pushed is None else float(pushed @ mean)
        work.append(work[-1] + h * power)
        exchanged += h * abs(power)
        if task.events:
            piece = Cubics(
                robot, edges[k : k + 2], *(np.array(part) for part in zip(*states[-2:], strict=True))
            )
            occurred += occurrences(
                task.events, piece, (float(edges[k]), float(edges[k + 1])), 1, last_values
            )
            if occurred and occurred[-1].terminal:
                break
        if task.advanced is not None:
            task.advanced(float(edges[k + 1] / task.duration))
    q, v = (np.array(part) for part in zip(*states, strict=True))
    missed = _left_out(robot, v, h)
    _check_resolved(robot, missed, h)
    trajectory = Cubics(robot, edges[: len(q)], q, v)
    return Integration(trajectory, np.array(work), exchanged, tuple(occurred), missed, len(q) - 1)


def _pushed(drive: Drive, t: float, q: Array, step: Array) -> Array | None:
    """Compute the world's forces (nv,) at t [s], q (nq,) moved by a step (nv,); None without any."""
    if not drive.world.acts:
        return None
    robot = drive.robot
    return drive.world(robot, np.array([t]), integrate(robot, q[None], step[None]))[0]


def _check_resolved(robot: ParallelRobot, missed: float, h: float) -> None:
    if missed > FIXED_STEP_ERROR:
        enough = h * (0.1 * FIXED_STEP_ERROR / missed) ** 0.5
        raise NotConverged(
            f"{robot.name}: steps of {h:.3g} s leave about {missed:.2g} rad or robot lengths of this motion "
            f"out; take steps of {enough:.1g} s, or method stiff",
            residual=missed,
        )


def _left_out(robot: ParallelRobot, v: Array, h: float) -> float:
    """Compute the error of fixed steps of order 2, all steps together [rad, robot lengths].

    A step misses h^3 / 12 of the third derivative of q, which is the second difference of v over h^2. How far
    the motion itself pulls neighbouring motions apart is not in it.
    """
    bends = np.abs(np.diff(v / robot.column_scale, 2, axis=0))
    return float(h / 12 * bends.sum(axis=0).max(initial=0.0))


def by_explicit_steps(task: IntegrationTask, settings: MethodSettings) -> Integration:
    """Integrate by steps of one length, of order 8; see `explicit`. Breaks of the torque end a step."""
    robot = task.equations.robot
    edges = _edges(task, settings.step or task.duration / DEFAULT_EXPLICIT_STEPS)
    dynamics = ContactDynamics.of(task.equations, CLOSING_STEPS * float(np.diff(edges).max()))
    state = np.concatenate(task.start)
    states, work, exchanged, occurred, missed = [state], [0.0], 0.0, [], 0.0
    last_values: dict[Event, float] = {}
    with np.errstate(over="ignore", invalid="ignore"):  # a runaway is told below
        for step in explicit_steps(task.equations, dynamics, task.drive, state, edges):
            if not np.all(np.isfinite(step.end)):
                raise _runaway(robot, step.time, step.length)
            states.append(step.end)
            work.append(work[-1] + step.length * step.power)
            exchanged += step.length * abs(step.power)
            missed = max(missed, step.error)
            if task.events:
                ends = np.array([step.time, step.time + step.length])
                piece = Cubics(robot, ends, *np.split(np.array(states[-2:]), 2, axis=1))
                occurred += occurrences(
                    task.events, piece, (float(ends[0]), float(ends[1])), settings.looks, last_values
                )
                if occurred and occurred[-1].terminal:
                    break
            if task.advanced is not None:
                task.advanced((step.time + step.length) / task.duration)
    q, v = np.split(np.array(states), 2, axis=1)
    return Integration(
        Cubics(robot, edges[: len(q)], q, v), np.array(work), exchanged, tuple(occurred), missed, len(q) - 1
    )


def _edges(task: IntegrationTask, step: float) -> Array:
    """Compute the ends of steps no longer than `step`, with one on every break."""
    marks = [0.0, *(t for t in task.drive.breaks if 0 < t < task.duration), task.duration]
    pieces = [np.linspace(a, b, _count(b - a, step) + 1) for a, b in pairwise(marks)]
    return np.unique(np.concatenate(pieces))


def _count(length: float, step: float) -> int:
    """Count the steps no longer than `step` [s] that make `length` [s].

    Raises:
        InvalidInput: more than can be kept.
    """
    count = length / step
    if not count <= MAX_STEPS:
        raise InvalidInput(f"step: {step!r} s makes more than {MAX_STEPS} steps of {length:g} s")
    return max(1, int(np.ceil(count - COUNT_ROUNDING)))


def _runaway(robot: ParallelRobot, time: float, step: float) -> NotConverged:
    return NotConverged(
        f"{robot.name}: the simulation runs away at t = {time:.9g} s, or its equations are singular there; "
        f"take a shorter step than {step:.3g} s, or method stiff",
        residual=time,
    )


class Method(NamedTuple):
    """An integrator with the settings that it has by default."""

    run: Callable[[IntegrationTask, MethodSettings], Integration]
    settings: MethodSettings


METHODS: dict[str, Method] = {
    "reference": Method(by_collocation, MethodSettings(stages=16, tolerance=1e-12, looks=32)),
    "fast": Method(by_fixed_steps, MethodSettings(step=1e-3)),
    "explicit": Method(by_explicit_steps, MethodSettings(looks=4)),
    "stiff": Method(by_collocation, MethodSettings(stages=5, tolerance=1e-7, looks=10)),
}
