"""Torques linear in the law about a motion in balance, against certified torques of laws beside it."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import ParallelRobot
from framework.dynamics.inverse_dynamics import resolve
from framework.dynamics.torque_response import foresee_deflections, respond_to_law
from framework.model.description import JointDynamics
from framework.planning import scenes
from framework.planning.optimal.elastic_balance import find_law_in_balance
from framework.planning.optimal.law_problem import LawProblem
from framework.planning.optimal.next_law import evaluate_in_balance, find_next_law
from framework.planning.optimal.optimal_task import Task
from framework.planning.optimal.undeformed_law import problem_of, solve_problem
from tests.planning.optimal.tasks import task_of

DAMPED = {"left_motor": JointDynamics(damping=0.02), "left_elbow": JointDynamics(damping=0.01)}
CASES = [
    pytest.param("five_bar", "C", "flexible_links", {}, marks=pytest.mark.slow),  # springs with inertia
    ("five_bar", "C", "flexible_joints", DAMPED),  # springs without
    pytest.param("five_bar", "C", "flexible_joints", {}, marks=pytest.mark.slow),
    pytest.param("three_rpr", "crossing", "flexible_links", {}, marks=pytest.mark.slow),
    pytest.param("delta", "pick", "flexible_links", {}, marks=pytest.mark.slow),
]
XI = np.linspace(-0.99, 0.99, 67)


def certified(task, law, deflections):
    """The certified motion of a law."""
    return resolve(
        task.to_cross.searched,
        lambda _: law,
        geometry="deformed",
        tolerance=1e-9,
        friction="none",
        known=deflections,
    )


def torques_of(task, law, deflections):
    """Certified torques (67, n_a) of a law at XI."""
    dynamics = certified(task, law, deflections)
    return dynamics.torque(law.time(law.stretch.inverse(XI)))


def at_xi(deflections):
    """Deflections (67, n_e) at XI."""
    return deflections.splines.evaluate(deflections.series, XI)


def pose_problem(name, scene, flexibility, joints) -> tuple[Task, LawProblem]:
    """Task of a scene in 1.5 s, and its problem with z as one series of degree 24."""
    description = replace(robots.load(name).description, joints=joints)
    robot = ParallelRobot.from_description(description, flexibility=flexibility)
    path = scenes.scene_path(scenes.scene(robot, scene))
    task = task_of(robot, path, duration=1.5, smoothness=6)
    problem = problem_of(task)._replace(degree=24)
    return task, problem


@pytest.mark.parametrize(("name", "scene", "flexibility", "joints"), CASES)
def test_slopes_are_those_of_certified_torques(name, scene, flexibility, joints):
    task, problem = pose_problem(name, scene, flexibility, joints)
    law, balance = find_law_in_balance(task, solve_problem(problem, share=0.3).law, None)
    response = respond_to_law(balance)
    torque, slopes, speed = response.evaluate_motors(XI)
    planned = torques_of(task, law, balance.deflections)
    assert np.abs(torque - planned).max() <= 1e-9 * np.abs(planned).max()

    change = np.zeros(len(law.coefficients))
    change[:8] = 1e-4 * np.abs(law.coefficients).max() * np.random.default_rng(1).normal(size=8)
    conditions = response.scalar_slopes[:, :8]
    change[:8] -= np.linalg.pinv(conditions) @ (conditions @ change[:8])
    beside, moved, bent = [], [], []
    for sign in (1.0, -1.0):
        shifted = replace(law, coefficients=law.coefficients + sign * change, duration=0.0)
        followed = find_law_in_balance(task, shifted, balance.deflections)
        beside.append(torques_of(task, followed[0], followed[1].deflections))
        moved.append(followed[0].coefficients)
        bent.append(at_xi(followed[1].deflections))
    foreseen = slopes @ (moved[0] - moved[1])
    assert np.abs(beside[0] - beside[1] - foreseen).max() <= 1e-4 * np.abs(foreseen).max()
    foreseen_bends = [at_xi(foresee_deflections(balance, response, y)) for y in moved]
    difference = bent[0] - bent[1]
    error = difference - (foreseen_bends[0] - foreseen_bends[1])
    assert np.abs(error).max() <= 1e-4 * np.abs(difference).max()
    sigma = law.stretch.inverse(XI)
    motor_speed = certified(task, law, balance.deflections).motor_angle(law.time(sigma), 1)
    assert (
        np.abs(np.sqrt(law.squared_speed(sigma))[:, None] * speed - motor_speed).max()
        <= 1e-7 * np.abs(motor_speed).max()
    )


@pytest.mark.slow
@pytest.mark.parametrize(("name", "scene", "flexibility", "joints"), CASES[1:4:2])
def test_loose_balances_give_certified_torques_and_steps_of_the_size_asked_for(
    name, scene, flexibility, joints
):
    task, problem = pose_problem(name, scene, flexibility, joints)
    best = solve_problem(problem, share=0.3)
    law, loose = find_law_in_balance(task, best.law, None, misfit=1e-8)
    response = respond_to_law(loose)
    same, settled = find_law_in_balance(task, law, loose.deflections)
    planned = torques_of(task, same, settled.deflections)
    torque, _slopes, _speed = response.evaluate_motors(XI)
    assert np.abs(torque - planned).max() <= 1e-4 * np.abs(planned).max()

    trust = 0.03
    step = find_next_law(evaluate_in_balance(best, law, problem._replace(response=response)), trust, 1.0)
    sigma = law.stretch.inverse(XI)
    change = step.law.squared_speed(sigma) / law.squared_speed(sigma) - 1.0
    assert np.abs(change).max() == pytest.approx(trust, rel=1e-2)
    before, after = (np.abs(response.rest(y)).max(initial=0.0) for y in (response.y, step.law.coefficients))
    assert after <= max(0.3 * before, 0.5e-3) * (1 + 1e-5)
