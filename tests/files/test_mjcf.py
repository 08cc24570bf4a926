"""The equalities of an export to MuJoCo lock what the closures lock, and no motion of the robot."""

import xml.etree.ElementTree as ElementTree

import pytest

import robots
from framework.files.mjcf import OFF_ORIGIN, ROD, equality_axes, mjcf_text


@pytest.mark.parametrize("name", ["five_bar", "orthoglide"])
def test_equalities_lock_the_axes_of_their_closures_by_kinds_that_mujoco_has(name):
    robot = robots.load(name)  # the rods of the orthoglide lock x and y, those of the 5R all positions
    axes = equality_axes(robot)
    closures = [closure for closure in robot.description.closures if closure.axes != ROD]
    assert set(axes) == {closure.name for closure in closures}
    for closure in closures:
        assert axes[closure.name] in OFF_ORIGIN
        assert set(closure.axes) <= set(axes[closure.name])


def test_motors_push_as_hard_one_way_as_the_other():
    robot = robots.load("humanoid_ankle")
    motors = ElementTree.fromstring(mjcf_text(robot)).findall("actuator/motor")
    for motor, actuator in zip(motors, robot.description.actuators, strict=True):
        ends = [-actuator.torque_limit, actuator.torque_limit]
        assert [[*map(float, motor.get(key).split())] for key in ("ctrlrange", "forcerange")] == [ends, ends]
