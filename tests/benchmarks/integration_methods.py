"""Our integrators, and pinocchio's constrained dynamics with RK4, as methods of the work-precision chart.

`methods(name, flexibility)` maps names to methods on scene C of the 5R; `Method.run(setting)` with a
tolerance or a step [s] gives the wall time of the integration [s] and the largest distance of the payload
from the planned path over the run [m]. Models, start and tables of torques are made beforehand; calling
back for the torque of a step counts. tests/benchmarks/witness_methods.py has the same for other simulators.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pinocchio as pin

import robots
from framework import CrossingPlan, plan_scene
from framework.errors import NotConverged
from framework.kinematics.frames import frames_at
from framework.simulation.consistent import consistent_state
from framework.simulation.contacts import ContactDynamics
from framework.simulation.drive import Drive
from framework.simulation.equations import EquationsOfMotion
from framework.simulation.explicit import explicit_steps
from framework.simulation.methods import IntegrationTask, MethodSettings, by_collocation
from framework.simulation.schemes import State
from framework.simulation.stepper import Stepper

LOOKS = 151  # equidistant instants at which the payload is compared with its path


class Method(NamedTuple):
    """`run(setting)` gives (seconds, error); `settings` are tolerances or steps, coarse to fine."""

    run: Callable[[float], tuple[float, float]]
    settings: tuple[float, ...]


def methods(name: str, flexibility: str) -> dict[str, Method]:
    """For a robot of the catalogue with the scene C: five_bar or five_bar_heavy."""
    robot = robots.load(name, flexibility=flexibility)
    plan = plan_scene(robot, "C")
    steps = tuple(1.5 / count for count in (75, 150, 300, 600, 1500, 3000))
    found = {
        f"ours, Radau IIA of {stages} stages": Method(
            _collocation(plan, stages), tuple(10.0**power for power in powers)
        )
        for stages, powers in ((5, (-2, -4, -6)), (10, (-2, -4, -6, -8, -10)), (16, (-4, -6, -8, -10, -12)))
    }
    found["ours, fixed steps"] = Method(_fixed_steps(plan), steps)
    if flexibility == "rigid" and name != "five_bar":  # both divide by the mass matrix of the tree
        found["ours, explicit of order 8"] = Method(
            _explicit(plan), tuple(1.5 / count for count in (6, 8, 12, 16, 24, 32, 48, 64))
        )
        found["pin.constraintDynamics, RK4"] = Method(_runge_kutta(plan), steps)
    return found


def _off(plan: CrossingPlan, times: np.ndarray, q: np.ndarray) -> float:
    if not np.all(np.isfinite(q)):
        return np.inf
    place = plan.robot.platform.coordinates(frames_at(plan.robot, q))
    return float(np.linalg.norm(place - plan.platform(times), axis=1).max())


def _start(plan: CrossingPlan) -> tuple[EquationsOfMotion, State]:
    equations = EquationsOfMotion.of(plan.robot)
    q, v = plan.dynamics.configuration(0.0)[0], plan.dynamics.velocity(0.0)[0]
    return equations, State(*consistent_state(equations, q, v, plan.torque(0.0)))


def _collocation(plan: CrossingPlan, stages: int) -> Callable[[float], tuple[float, float]]:
    equations, start = _start(plan)
    task = IntegrationTask(equations, Drive.of(plan.robot, plan), start, plan.duration, (), None)
    times = np.linspace(0.0, plan.duration, LOOKS)

    def run(tolerance: float) -> tuple[float, float]:
        began = time.perf_counter()
        try:
            found = by_collocation(task, MethodSettings(stages=stages, tolerance=tolerance))
        except NotConverged:
            return np.nan, np.inf
        return time.perf_counter() - began, _off(plan, times, found.trajectory(times)[0])

    return run


def _fixed_steps(plan: CrossingPlan) -> Callable[[float], tuple[float, float]]:
    stepper, (_, start) = Stepper.of(plan.robot), _start(plan)

    def run(step: float) -> tuple[float, float]:
        count = round(plan.duration / step)
        torques = plan.torque((np.arange(count) + 0.5) * step)
        state, states = start, [start.q]
        began = time.perf_counter()
        for torque in torques:
            state = stepper.step(*state, torque, step)
            states.append(state.q)
        seconds = time.perf_counter() - began
        return seconds, _off(plan, np.minimum(np.arange(count + 1) * step, plan.duration), np.array(states))

    return run


def _explicit(plan: CrossingPlan) -> Callable[[float], tuple[float, float]]:
    equations, start = _start(plan)
    drive, state = Drive.of(plan.robot, plan), np.concatenate(start)
    dynamics, nv = ContactDynamics.of(equations, 1.0), plan.robot.model.nv

    def run(step: float) -> tuple[float, float]:
        edges = np.linspace(0.0, plan.duration, round(plan.duration / step) + 1)
        began = time.perf_counter()
        ends = [one.end[:nv] for one in explicit_steps(equations, dynamics, drive, state, edges)]
        seconds = time.perf_counter() - began
        return seconds, _off(plan, edges[1:], np.array(ends))

    return run


def _runge_kutta(plan: CrossingPlan) -> Callable[[float], tuple[float, float]]:
    """constraintDynamics with a 3D contact between the tips, four times a step."""
    robot, (_, start) = plan.robot, _start(plan)
    model = robot.model.copy()
    model.armature[robot.actuated] = robot.gear_ratio**2 * robot.rotor_inertia
    first, second = (model.frames[model.getFrameId(name)] for name in ("left_tip", "right_tip"))
    contact = pin.RigidConstraintModel(
        pin.ContactType.CONTACT_3D,
        model,
        first.parentJoint,
        first.placement,
        second.parentJoint,
        second.placement,
        pin.ReferenceFrame.LOCAL,
    )
    contacts, contact_data = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    contacts.append(contact)
    contact_data.append(contact.createData())
    data, settings = model.createData(), pin.ProximalSettings(1e-12, 1e-12, 1e-8, 20)
    pin.initConstraintDynamics(model, data, contacts, contact_data)

    def slope(y: np.ndarray, force: np.ndarray) -> np.ndarray:
        q, v = y[: model.nv], y[model.nv :]
        a = pin.constraintDynamics(model, data, q, v, force, contacts, contact_data, settings)
        return np.concatenate([v, a])

    def run(step: float) -> tuple[float, float]:
        count = round(plan.duration / step)
        forces = np.zeros((2 * count + 1, model.nv))
        instants = np.minimum(np.arange(2 * count + 1) * 0.5 * step, plan.duration)
        forces[:, robot.actuated] = robot.gear_ratio * plan.torque(instants)
        y = np.concatenate(start)
        states = [start.q]
        began = time.perf_counter()
        for k in range(count):
            early, middle, late = forces[2 * k : 2 * k + 3]
            k1 = slope(y, early)
            k2 = slope(y + 0.5 * step * k1, middle)
            k3 = slope(y + 0.5 * step * k2, middle)
            k4 = slope(y + step * k3, late)
            y = y + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            states.append(y[: model.nv])
        seconds = time.perf_counter() - began
        return seconds, _off(plan, instants[::2], np.array(states))

    return run
