"""Integrators of forward dynamics under one face: given a case and a setting, where the joints go.

Those of the framework, and what one writes with pinocchio and scipy. Models and starts are made ready
beforehand; asking for the torque of a step or stage counts.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

from framework import ParallelRobot
from framework.numerics.arrays import Array
from framework.simulation import State, Stepper
from framework.simulation.consistent_states import consistent_state
from framework.simulation.drive import Drive
from framework.simulation.equations import EquationsOfMotion
from framework.simulation.methods import (
    ContactDynamics,
    IntegrationTask,
    MethodSettings,
    explicit_steps,
    integrate_by_collocation,
)

LOOKS = 151  # equidistant instants at which a continuous solution is read
MOST_CALLS = 20_000  # of the right-hand side
PROXIMAL = (1e-12, 1e-12, 1e-8, 20)  # settings with which planar loops are sound in 3D
Prepared = Callable[[float], Callable[[], "Course"]]


class Course(NamedTuple):
    """Joints q (T, nq) at times (T,) [s]."""

    times: Array
    q: Array


@dataclass(frozen=True, eq=False)
class Case:
    """A robot, the motor torques (T, n_a) [N m] at times (T,) that drive it from rest, and how long [s].

    `near` is a configuration (nq,) next to the start.
    """

    robot: ParallelRobot
    torque: Callable[[Array], Array]
    duration: float
    near: Array

    @cached_property
    def equations(self) -> EquationsOfMotion:
        return EquationsOfMotion.of(self.robot)

    @cached_property
    def start(self) -> State:
        """At rest, loops closed."""
        rest = np.zeros(self.robot.model.nv)
        return consistent_state(self.equations, self.near, rest, self.torque(np.zeros(1))[0])

    @cached_property
    def drive(self) -> Drive:
        return Drive(self.robot, lambda t, q, v: self.torque(t), False, ())

    @property
    def looks(self) -> Array:
        return np.linspace(0.0, self.duration, LOOKS)

    def edges(self, step: float) -> Array:
        """The ends of steps of about this length [s] that divide the duration."""
        return np.linspace(0.0, self.duration, round(self.duration / step) + 1)

    def joint_forces(self, times: Array) -> Array:
        """Generalised forces of the motors (T, nv) [N m], joint side."""
        forces = np.zeros((len(times), self.robot.model.nv))
        forces[:, self.robot.actuated] = self.robot.gear_ratio * self.torque(times)
        return forces


def collocation(case: Case, stages: int) -> Prepared:
    """Ours: Radau IIA; the setting is the tolerance."""
    task = IntegrationTask(case.equations, case.drive, case.start, case.duration, (), None)

    def prepare(tolerance: float) -> Callable[[], Course]:
        def run() -> Course:
            found = integrate_by_collocation(task, MethodSettings(stages=stages, tolerance=tolerance))
            return Course(case.looks, found.trajectory(case.looks)[0])

        return run

    return prepare


def fixed_steps(case: Case) -> Prepared:
    """Ours: fixed steps [s] of order 2, the torque held in each."""
    stepper = Stepper.of(case.robot)

    def prepare(step: float) -> Callable[[], Course]:
        edges = case.edges(step)

        def run() -> Course:
            state, states = case.start, [case.start.q]
            for torque in case.torque(0.5 * (edges[:-1] + edges[1:])):
                state = stepper.step(state.q, state.v, torque, edges[1])
                states.append(state.q)
            return Course(edges, np.array(states))

        return run

    return prepare


def explicit(case: Case) -> Prepared:
    """Ours: fixed steps [s] of order 8 on pinocchio's contact dynamics."""
    dynamics = ContactDynamics.of(case.equations, 1.0)

    def prepare(step: float) -> Callable[[], Course]:
        edges = case.edges(step)

        def run() -> Course:
            steps = explicit_steps(dynamics, case.drive, case.start, edges)
            return Course(edges[1:], np.array([one.end.q for one in steps]))

        return run

    return prepare


@dataclass(frozen=True, eq=False)
class BareContacts:
    """Pinocchio's constraintDynamics of a case, with a 3D contact for each loop; nothing of the framework.

    For robots without springs at their joints."""

    case: Case

    @cached_property
    def slope(self) -> Callable[[Array, Array], Array]:
        """d(q, v)/dt (2 nv,) at (q, v) under the motors' generalised forces (nv,)."""
        robot = self.case.robot
        model = robot.model.copy()
        model.armature[robot.actuated] = robot.gear_ratio**2 * robot.rotor_inertia
        contacts, contact_data = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for closure in robot.description.closures:
            one, other = (model.frames[model.getFrameId(name)] for name in closure.frames)
            contact = pin.RigidConstraintModel(
                pin.ContactType.CONTACT_3D,
                model,
                one.parentJoint,
                one.placement,
                other.parentJoint,
                other.placement,
                pin.ReferenceFrame.LOCAL,
            )
            contacts.append(contact)
            contact_data.append(contact.createData())
        data, settings = model.createData(), pin.ProximalSettings(*PROXIMAL)
        pin.initConstraintDynamics(model, data, contacts, contact_data)
        nv = model.nv

        def slope(y: Array, force: Array) -> Array:
            a = pin.constraintDynamics(model, data, y[:nv], y[nv:], force, contacts, contact_data, settings)
            return np.concatenate([y[nv:], a])

        return slope


def contact_runge_kutta(case: Case) -> Prepared:
    """RK4 on pinocchio's constraintDynamics, forces precomputed; the setting is the step [s]."""
    slope, nv = BareContacts(case).slope, case.robot.model.nv

    def prepare(step: float) -> Callable[[], Course]:
        edges = case.edges(step)
        h, start = float(edges[1]), np.concatenate(case.start)
        forces = case.joint_forces(np.linspace(0.0, case.duration, 2 * len(edges) - 1))

        def run() -> Course:
            y, states = start, [case.start.q]
            for k in range(len(edges) - 1):
                early, middle, late = forces[2 * k : 2 * k + 3]
                k1 = slope(y, early)
                k2 = slope(y + 0.5 * h * k1, middle)
                k3 = slope(y + 0.5 * h * k2, middle)
                k4 = slope(y + h * k3, late)
                y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
                states.append(y[:nv])
            return Course(edges, np.array(states))

        return run

    return prepare


def _solved_by_scipy(
    case: Case, method: str, new_rate: Callable[[], Callable[[float, Array], Array]]
) -> Prepared:
    """solve_ivp of a rate that is made for each run; the setting is the relative tolerance."""

    def prepare(tolerance: float) -> Callable[[], Course]:
        start = np.concatenate(case.start)

        def run() -> Course:
            solved = solve_ivp(
                new_rate(),
                (0.0, case.duration),
                start,
                method,
                rtol=tolerance,
                atol=1e-2 * tolerance,
                t_eval=case.looks,
            )
            if not solved.success:
                raise ArithmeticError(solved.message)
            return Course(case.looks, solved.y[: case.robot.model.nv].T)

        return run

    return prepare


def scipy_contacts(case: Case, method: str) -> Prepared:
    """solve_ivp on pinocchio's constraintDynamics; the setting is the relative tolerance."""
    slope = BareContacts(case).slope

    def new_rate() -> Callable[[float, Array], Array]:
        calls = count()

        def rate(t: float, y: Array) -> Array:
            if next(calls) > MOST_CALLS:
                raise ArithmeticError(f"{method}: no end after {MOST_CALLS} calls, at t = {t:.6g} s")
            return slope(y, case.joint_forces(np.array([t]))[0])

        return rate

    return _solved_by_scipy(case, method, new_rate)


def scipy_planar(case: Case, method: str) -> Prepared:
    """solve_ivp on [M J'; J 0], mass matrix and forces from pinocchio; the setting is the relative tolerance.

    For robots that move in one plane and whose loops are points.
    """
    robot, model = case.robot, case.robot.model
    data, nv = model.createData(), model.nv
    rotors = np.zeros(nv)
    rotors[robot.actuated] = robot.gear_ratio**2 * robot.rotor_inertia
    pairs = [tuple(model.getFrameId(name) for name in one.frames) for one in robot.description.closures]
    axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    neutral = pin.neutral(model)

    def loops(q: Array, v: Array) -> tuple[Array, Array]:
        """J (2 k, nv) and J' v (2 k,) in the plane of x and y."""
        pin.forwardKinematics(model, data, q, v, np.zeros(nv))
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        rows, drift = [], []
        for one, other in pairs:
            difference = pin.getFrameJacobian(model, data, one, axes) - pin.getFrameJacobian(
                model, data, other, axes
            )
            rows.append(difference[:2])
            accelerations: list[Any] = [
                pin.getFrameClassicalAcceleration(model, data, frame, axes).linear[:2]
                for frame in (one, other)
            ]
            drift.append(accelerations[0] - accelerations[1])
        return np.concatenate(rows), np.concatenate(drift)

    def slope(t: float, y: Array) -> Array:
        q, v = y[:nv], y[nv:]
        force = case.joint_forces(np.array([t]))[0] - pin.nonLinearEffects(model, data, q, v)
        force = force - robot.joint_stiffness * (pin.difference(model, neutral, q) - robot.joint_rest)
        mass = np.triu(pin.crba(model, data, q))
        mass = mass + np.triu(mass, 1).T + np.diag(rotors)
        rows, drift = loops(q, v)
        whole = np.block([[mass, rows.T], [rows, np.zeros((len(rows), len(rows)))]])
        return np.concatenate([v, np.linalg.solve(whole, np.concatenate([force, -drift]))[:nv]])

    return _solved_by_scipy(case, method, lambda: slope)
