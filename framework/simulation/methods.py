"""The integrators of `simulate`, listed in `METHODS`: each computes a trajectory and its energy balance.

Methods reference and stiff are collocation (`collocate`), method fast takes the fixed steps of `Stepper`.

Method explicit takes fixed steps of an explicit Runge-Kutta method of order 8 on pinocchio's constrained
dynamics. It solves no equations and stacks no states: a step is twelve calls of pinocchio. It suits robots in
which every joint moves some mass and every loop is a point or a weld. For these it reaches any error well
above rounding in less time than the other methods. Its steps must resolve the fastest vibration: the step
times the frequency must be below 5.

Pinocchio factorises the mass matrix of the tree, which must be definite, hence the masses. Its proximal
iterations handle redundant rows. The loops are pinocchio's own constraints at the frames of the robot file.
Only rotors, springs and damping come from `equations`, so this method also checks the loop equations
independently. Source: Carpentier, Budhiraja and Mansard 2021, "Proximal and sparse resolution of constrained
dynamic equations", Robotics: Science and Systems. The coefficients and the error estimate of the Runge-Kutta
method are those of scipy's DOP853. Source: Hairer, Norsett and Wanner, Solving Ordinary Differential
Equations I, Springer 1993, section II.5.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from framework.errors import InvalidInput, NotConverged
from framework.kinematics.frames import integrate
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.simulation.collocation import CollocationStep
from framework.simulation.drive import Drive
from framework.simulation.equations import EquationsOfMotion, State, stack_states
from framework.simulation.step_size_control import collocate
from framework.simulation.stepper import Stepper
from framework.simulation.trajectory import Cubics, Event, Occurrence, Polynomials, Trajectory, occurrences
from framework.tolerances import FIXED_STEP_ERROR, RANK_ROUNDING, SAME_PLACE

MAX_STEPS = 1_000_000  # of methods with steps of one length


class MethodSettings(NamedTuple):
    """The settings of a method; each method ignores some."""

    stages: int = 0  # number of nodes of a collocation step; 0 for methods without collocation
    tolerance: float = 0.0  # largest part of a collocation step left unresolved [rad, robot lengths]
    step: float = 0.0  # length of fixed steps, or of the longest step [s]; 0 for the default of the method


class IntegrationTask(NamedTuple):
    """The input of a simulation, checked and completed."""

    equations: EquationsOfMotion
    drive: Drive
    start: State
    duration: float  # [s]
    events: Sequence[Event]
    report_progress: Callable[[float], None] | None  # called with the finished share of the motion, 0 to 1


@dataclass
class RunRecord:
    """The energy balance and the events of a run, over the K steps so far."""

    task: IntegrationTask
    event_samples: int  # number of instants of a step at which events are evaluated
    # energy supplied until each end of a step [J], K + 1 values: the sum of the `work` of `add_step`
    supplied: list[float] = field(default_factory=lambda: [0.0])
    exchanged: float = 0.0  # sum of the exchanged energy of all steps [J]
    occurred: list[Occurrence] = field(default_factory=list)
    last_values: dict[Event, float] = field(default_factory=dict)  # of events at the end of the last step

    def add_step(self, step: Trajectory, work: float, exchange: float) -> bool:
        """Add a step; return whether an event ends the run.

        Args:
            step: the motion of this step.
            work: work of motors and external wrenches minus the energy that damping dissipates [J].
            exchange: integral of the absolute power of this work over the step [J].
        """
        task = self.task
        self.supplied.append(self.supplied[-1] + work)
        self.exchanged += exchange
        if task.events:
            self.occurred += occurrences(task.events, step, self.event_samples, self.last_values)
            if self.occurred and self.occurred[-1].terminal:
                return True
        if task.report_progress is not None:
            task.report_progress(min(float(step.edges[-1]) / task.duration, 1.0))
        return False


class Integration(NamedTuple):
    """The result of a method."""

    record: RunRecord
    trajectory: Trajectory
    unresolved: float  # see `Simulation`
    iterations: int  # of Newton's method; of fixed steps, their number


def integrate_by_collocation(task: IntegrationTask, settings: MethodSettings) -> Integration:
    """Integrate a task by Radau IIA steps of variable length; see `collocate`."""
    robot = task.equations.robot
    # events are evaluated at twice as many instants as a step has nodes
    record = RunRecord(task, event_samples=2 * settings.stages)
    steps = list[CollocationStep]()
    for step in collocate(
        task.equations,
        task.drive,
        task.start,
        task.duration,
        stages=settings.stages,
        tolerance=settings.tolerance,
        longest=settings.step or task.duration,
    ):
        steps.append(step)
        power = step.power - step.v**2 @ task.equations.damping  # [W] at the s nodes
        weights = step.length * step.table.integration[-1]  # (s,) of the integral to the last node, the end
        work = float(weights @ power)
        exchange = float(weights @ np.abs(power))
        if record.add_step(Polynomials(robot, (step,)), work, exchange):
            break
    unresolved = max(step.unresolved for step in steps)
    iterations = sum(step.iterations for step in steps)
    return Integration(record, Polynomials(robot, tuple(steps)), unresolved, iterations)


def integrate_by_fixed_steps(task: IntegrationTask, settings: MethodSettings) -> Integration:
    """Integrate a task by steps of one length under the torque in their middle; see `Stepper`."""
    robot = task.equations.robot
    count = _count_steps(task.duration, settings.step)
    if count < 2:  # the error is estimated from second differences
        raise InvalidInput(
            f"step: {settings.step:g} s is too long for {task.duration:g} s; take at least 2 steps"
        )
    edges = np.linspace(0.0, task.duration, count + 1)
    record = RunRecord(task, event_samples=1)
    trajectory, _ = _collect_steps(record, _fixed_steps(task, edges), edges)
    h = task.duration / count
    error = _fixed_step_error(robot, trajectory.v, h)
    if error > FIXED_STEP_ERROR:
        # the error grows with the square of h: advise a step with a tenth of the error allowed
        advised = h * (0.1 * FIXED_STEP_ERROR / error) ** 0.5
        raise NotConverged(
            f"{robot.name}: steps of {h:.3g} s leave about {error:.2g} rad or robot lengths of this motion "
            f"unresolved; as the error falls with the square of the step, about {advised:.1g} s leave a "
            f"tenth of what is allowed (method stiff chooses its steps)",
            residual=error,
        )
    return Integration(record, trajectory, error, len(trajectory.q) - 1)


class FixedStep(NamedTuple):
    """A step of fixed length."""

    end: State
    power: float  # mean power of motors and external wrenches minus that of damping [W]
    error: float = 0.0  # estimated error of q in this step [rad, m]; 0 without an estimate


def _fixed_steps(task: IntegrationTask, edges: Array) -> Iterator[FixedStep]:
    """Yield steps of `Stepper` between the instants `edges` (K + 1,) under the torque in their middle.

    A feedback torque responds to the state at the beginning of a step, as a digital controller does. External
    wrenches are those at the predicted middle of a step. The power is that at the mean velocity, which gives
    the work of constant forces along the step.
    """
    drive = task.drive
    robot = task.equations.robot
    stepper = Stepper.from_equations(task.equations)
    h = task.duration / (len(edges) - 1)
    middles = edges[:-1] + 0.5 * h
    torques = drive.torques_without_feedback(middles)  # (K, n_a); None with feedback
    q, v = task.start
    for k in range(len(middles)):
        if torques is not None:
            torque = torques[k]
        else:
            torque = drive(edges[k : k + 1], q[None], v[None])[0]
        world = np.zeros_like(v)  # generalised forces of the external wrenches
        if drive.world.acts:
            middle = integrate(robot, q, 0.5 * h * v)[None]
            world = drive.world(robot, middles[k : k + 1], middle, v[None])[0]
        end = stepper.step(q, v, torque, h, world=world)
        mean = 0.5 * (v + end.v)  # (nv,)
        supplied = (robot.gear_ratio * torque) @ mean[robot.actuated] + world @ mean
        dissipated = mean**2 @ task.equations.damping
        yield FixedStep(end, float(supplied - dissipated))
        q, v = end


def integrate_by_explicit_steps(
    task: IntegrationTask,
    settings: MethodSettings,
    *,
    # steps in which open loops close; faster closing dominates the error estimate
    closing_steps: float = 50.0,
    default_steps: int = 256,  # of method explicit
) -> Integration:
    """Integrate a task by explicit steps of order 8, of about one length; see `explicit_steps`."""
    edges = _step_edges(task, settings.step or task.duration / default_steps)
    dynamics = ContactDynamics.of(task.equations, closing_steps * float(np.diff(edges).max()))
    steps = explicit_steps(dynamics, task.drive, task.start, edges)
    record = RunRecord(task, event_samples=4)
    trajectory, largest_error = _collect_steps(record, steps, edges)
    return Integration(record, trajectory, largest_error, len(trajectory.q) - 1)


def _collect_steps(record: RunRecord, steps: Iterator[FixedStep], edges: Array) -> tuple[Cubics, float]:
    """Collect steps between the instants `edges` until the end or a terminal event.

    Returns:
        The motion; the largest estimated error of a step [rad, m].

    Raises:
        NotConverged: the motion diverges.
    """
    robot = record.task.equations.robot
    states = [record.task.start]
    largest_error = 0.0
    with np.errstate(over="ignore", invalid="ignore"):  # divergence is reported below
        for k, step in enumerate(steps):
            start = float(edges[k])
            length = float(edges[k + 1] - edges[k])
            if not all(np.all(np.isfinite(part)) for part in step.end):
                raise NotConverged(
                    f"{robot.name}: the simulation runs away at t = {start:.9g} s, or its equations are "
                    f"singular there; the steps are of {length:.3g} s (method stiff chooses its own)",
                    residual=start,
                )
            states.append(step.end)
            largest_error = max(largest_error, step.error)
            piece = Cubics(robot, edges[k : k + 2], *stack_states(states[-2:]))
            if record.add_step(piece, length * step.power, length * abs(step.power)):
                break
    return Cubics(robot, edges[: len(states)], *stack_states(states)), largest_error


def _fixed_step_error(robot: ParallelRobot, v: Array, h: float) -> float:
    """Estimate the error [rad, robot lengths] that fixed steps of order 2 accumulate.

    It is the sum of the truncation errors of all steps, for the coordinate of the largest sum. The truncation
    error of a step of length h is h^3 / 12 times the third derivative of q. The third
    derivative is the second difference of the velocities v (K + 1, nv), divided by h^2. The estimate does not
    include the growth of errors along an unstable motion.
    """
    second_differences = np.abs(np.diff(v / robot.column_scale, 2, axis=0))
    return float(h / 12 * second_differences.sum(axis=0).max(initial=0.0))


def _step_edges(task: IntegrationTask, step: float) -> Array:
    """Compute the instants (K + 1,) [s] between which steps are no longer than `step` [s].

    Every break of the drive is the end of a step.
    """
    edges = [
        np.linspace(start, end, _count_steps(end - start, step) + 1)
        for start, end in pairwise(task.drive.edges(task.duration))
    ]
    return np.unique(np.concatenate(edges))


def _count_steps(length: float, step: float) -> int:
    """Count the steps no longer than `step` [s] that cover `length` [s].

    Raises:
        InvalidInput: there are more than MAX_STEPS.
    """
    count = length / step
    if not count <= MAX_STEPS:
        raise InvalidInput(f"step: {step!r} s makes more than {MAX_STEPS} steps of {length:g} s")
    return max(1, int(np.ceil(count - SAME_PLACE)))


# ------------------------------------------------------------------ explicit steps


@dataclass(frozen=True, eq=False)
class ContactDynamics:
    """A robot prepared for pinocchio's contact solver; one object serves one thread at a time."""

    model: pin.Model  # with rotors as armature
    data: pin.Data
    contacts: Any  # pin.StdVec_RigidConstraintModel
    contact_data: Any  # pin.StdVec_RigidConstraintData
    settings: pin.ProximalSettings
    equations: EquationsOfMotion  # whose springs and dampers act

    def acceleration(self, q: Array, v: Array, force: Array) -> Array:
        """Compute joint accelerations (nv,) at q (nq,), v (nv,) under applied generalised forces (nv,)."""
        springs = self.equations.stiffness * (q - self.equations.robot.joint_rest)
        total = force - springs - self.equations.damping * v
        return pin.constraintDynamics(
            self.model, self.data, q, v, total, self.contacts, self.contact_data, self.settings
        )

    @staticmethod
    def of(equations: EquationsOfMotion, closing: float) -> ContactDynamics:
        """Prepare a robot for pinocchio's contact solver.

        Args:
            closing: time constant [s] with which open loops close, critically damped.

        Raises:
            InvalidInput: a loop that is neither spherical nor fixed, a joint that moves no mass, or a joint
                with several degrees of freedom.
        """
        _check_contact_robot(equations)
        robot = equations.robot
        model = robot.model.copy()
        model.armature[:] += equations.rotors

        contacts, contact_data = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for contact in robot.constraint_models():
            # Baumgarte stabilisation of the gap e: e" + Kd e' + Kp e = 0 is critically damped
            gains = contact.m_baumgarte_parameters
            gains.Kp = 1 / closing**2
            gains.Kd = 2 / closing
            contacts.append(contact)
            contact_data.append(contact.createData())

        data = model.createData()
        pin.initConstraintDynamics(model, data, contacts, contact_data)
        return ContactDynamics(
            model=model,
            data=data,
            contacts=contacts,
            contact_data=contact_data,
            # with the default settings redundant rows, as of a planar loop described in space, give NaN
            settings=pin.ProximalSettings(accuracy=1e-12, mu=1e-8, max_iter=20),
            equations=equations,
        )


def _check_contact_robot(equations: EquationsOfMotion) -> None:
    """Raise InvalidInput for a robot that pinocchio's contact solver cannot treat."""
    robot = equations.robot
    if robot.has_balls:
        raise InvalidInput(
            f"{robot.name}: pinocchio's contact dynamics is for joints of one degree of freedom"
        )
    mass = equations.tangent_at_rest(robot.reference.q).mass[0]
    inertias, motions = np.linalg.eigh(mass)  # ascending
    if inertias[0] <= RANK_ROUNDING * inertias[-1]:
        joint = robot.coordinates.name_of(int(np.argmax(np.abs(motions[:, 0]))))
        raise InvalidInput(
            f"{robot.name}, {robot.flexibility}: {joint} moves no mass, and pinocchio's contact dynamics "
            f"divides by the mass matrix of the tree; use another method"
        )


def explicit_steps(
    dynamics: ContactDynamics, drive: Drive, start: State, edges: Array
) -> Iterator[FixedStep]:
    """Yield explicit Runge-Kutta steps between the instants `edges` (K + 1,), also non-finite ones.

    With y = (q, v) and the coefficients A, B, C of the method, stage i of a step of length h evaluates the
    slope K_i = dy/dt at the state y + h sum_j A_ij K_j and the time t + C_i h. The step ends at
    y + h sum_i B_i K_i. The weights B also integrate the power over the step.

    Args:
        dynamics: the robot, which computes accelerations.
        drive: motor torques and external wrenches.
        start: the state at the first of the instants.
    """
    from scipy.integrate import DOP853  # importing it takes 0.2 s, which planning does not need

    equations = dynamics.equations
    times = edges[:-1, None] + np.diff(edges)[:, None] * DOP853.C  # (K, stages)
    # torques that depend on time alone are computed for all stages at once, `motors` (K, stages, nv);
    # by rounding the last stage may lie beyond the end
    torques = drive.torques_without_feedback(np.minimum(drive.shift_breaks(times).ravel(), edges[-1]))
    motors = None if torques is None else equations.motor_forces(torques).reshape(*times.shape, -1)

    def force_at(k: int, i: int, q: Array, v: Array) -> Array:
        """Compute generalised forces (nv,) of motors and external wrenches at stage i of step k."""
        t = times[k, i : i + 1]
        if motors is None:
            force = equations.motor_forces(drive(t, q[None], v[None]))[0]
        else:
            force = motors[k, i].copy()
        if drive.world.acts:
            force += drive.world(equations.robot, t, q[None], v[None])[0]
        return force

    y = np.concatenate(start)  # (2 nv,) q, then v
    slopes = np.empty((DOP853.n_stages, len(y)))
    for k, h in enumerate(np.diff(edges)):
        power = 0.0
        for i in range(len(slopes)):
            q, v = np.split(y + h * (DOP853.A[i, :i] @ slopes[:i]), 2)
            force = force_at(k, i, q, v)
            slopes[i] = np.concatenate([v, dynamics.acceleration(q, v, force)])
            # the weights B have the sum 1, so this is the mean power over the step
            power += DOP853.B[i] * float(force @ v - equations.damping @ v**2)
        y = y + h * (DOP853.B @ slopes)
        # of q, by the embedded method of order 5, which gives the slope at the end of the step no weight
        error = h * (DOP853.E5[:-1] @ slopes)[: len(start.q)]
        yield FixedStep(State(*np.split(y, 2)), power, float(np.abs(error).max()))


class Method(NamedTuple):
    """An integrator with its default settings."""

    run: Callable[[IntegrationTask, MethodSettings], Integration]
    settings: MethodSettings


METHODS: dict[str, Method] = {
    "reference": Method(integrate_by_collocation, MethodSettings(stages=16, tolerance=1e-12)),
    "fast": Method(integrate_by_fixed_steps, MethodSettings(step=1e-3)),
    "explicit": Method(integrate_by_explicit_steps, MethodSettings()),
    "stiff": Method(integrate_by_collocation, MethodSettings(stages=5, tolerance=1e-7)),
}
