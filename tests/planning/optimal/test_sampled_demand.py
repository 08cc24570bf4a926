"""The demand of a path by series: it gives the certified torques of plans, with damping and dry friction."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import ParallelRobot, plan_crossing, plan_scene
from framework.laws.optimal_law import Smoothstep
from framework.model.description import JointDynamics
from framework.planning.crossing_points import PathToCross
from framework.planning.optimal.optimal_task import Task
from framework.planning.optimal.path_series import sample_demand
from framework.singularity.points_on_path import search_path
from tests.oracles.planar import without_rotors
from tests.robots.every_robot import KINDS, RIGID, crossing
from tests.stability.test_touch import chord


def task_of(plan) -> Task:
    searched = search_path(plan.robot, plan.path).under(plan.dynamics.wrenches)
    return Task(PathToCross(searched, searched.points), plan.request, None)


def torque_by_series(plan, sampled, t, friction=0.0):
    """Motor torques (T, n_a) [N m] of a plan's motion, with dry friction (n_a,)."""
    asked = sampled.evaluate(Smoothstep(0), plan.law(t))
    ds, dds = (plan.law(t, order)[:, None] for order in (1, 2))
    constant, per_z, per_u = asked.torque
    return constant + per_z * ds**2 + per_u * dds + asked.damping * ds + asked.friction(friction)


def compare_torques(plan, friction=None):
    sampled = sample_demand(task_of(plan))
    assert sampled is not None
    t = plan.duration * np.linspace(0.0, 1.0, 101)[1:-1]
    away = np.abs(t[:, None] - [point.time for point in plan.crossings]).min(axis=1, initial=np.inf)
    s = plan.law(t)  # some polynomials go beyond the end of their path
    t = t[(away > 1e-3 * plan.duration) & (s >= 0.0) & (s <= 1.0)]
    torque = plan.torque(t)
    friction = np.zeros(plan.robot.n_a) if friction is None else friction
    assert np.abs(torque_by_series(plan, sampled, t, friction) - torque).max() < 1e-8 * np.abs(torque).max()


@pytest.mark.parametrize("name", KINDS)
def test_series_give_the_certified_torques_of_a_plan(name):
    compare_torques(crossing(RIGID[name], friction="none"))


def test_at_a_touch_the_pole_is_of_second_order():
    compare_torques(plan_crossing(without_rotors(), chord(0.0, 0.3), duration=3.0, optimize="energy"))


def test_damping_and_dry_friction_come_with_the_series():
    description = robots.load("five_bar").description
    joints = {
        "left_motor": JointDynamics(friction=1.5, damping=0.4),
        "right_motor": JointDynamics(friction=0.8),
    }
    robot = ParallelRobot.from_description(replace(description, joints=joints))
    compare_torques(plan_scene(robot, "C"), robot.joint_friction[robot.actuated] / robot.gear_ratio)
