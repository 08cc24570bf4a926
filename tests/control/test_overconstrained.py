"""Control of robots of which no fixed loop equations suffice in all poses: the Diamond, wherever it is."""

from functools import cache

import numpy as np
import pytest

import robots
from framework import assemble, plan_scene
from framework.control import CONTROLLERS, ControlLoop, Spread, reference_of, tuned_controller
from framework.control.control_cycle import ControlCycle
from framework.control.study import run_study

SCENES = ("pick", pytest.param("pick-mirrored", marks=pytest.mark.slow))
plan = cache(lambda scene: plan_scene(robots.load("diamond"), scene))


@pytest.mark.parametrize("scene", SCENES)
def test_the_cycle_follows_the_motors_with_the_torques_of_the_plan(scene):
    planned = plan(scene)
    robot = planned.robot
    cycle = ControlCycle(robot, near=assemble(robot, planned.platform(0.0)))
    for t in np.linspace(0.0, planned.duration, 201):
        angle, speed, acceleration = (planned.motor_angle(t, order) / robot.gear_ratio for order in range(3))
        cycle.update(angle, speed)
        np.testing.assert_allclose(cycle.x, planned.platform(t), rtol=0, atol=1e-9)
        np.testing.assert_allclose(cycle.torque(acceleration), planned.torque(t), rtol=0, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("name", CONTROLLERS)
def test_every_controller_keeps_the_robot_on_the_path(name, scene):
    reference = reference_of(plan(scene), period=1e-3)
    loop = ControlLoop(sensors="joints")
    done = run_study(tuned_controller(name, reference), loop, Spread(payload=0.05), runs=2)
    assert done.passed.all()
