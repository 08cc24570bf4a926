"""The equalities of an export to MuJoCo lock what the closures lock, and no motion of the robot."""

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import pytest

import robots
from framework import InvalidInput, ParallelRobot
from framework.files.mjcf import OFF_ORIGIN, ROD, equality_axes, mjcf_text
from framework.model.description import Spring


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


def test_axes_that_springs_leave_free_are_not_locked():
    """In the plane the pin of the 5R may be a point; not with a spring across the plane."""
    original = robots.load("five_bar").description
    pin = replace(original.closures[0], axes=("x", "y"))
    across = Spring("lift", "link", "left_rod_tip", ("z",), (1e4,))
    description = replace(original, closures=(pin,), springs=(across,))
    assert equality_axes(ParallelRobot.from_description(description)) == {pin.name: ("x", "y", "z")}
    with pytest.raises(InvalidInput, match="would lock z, along which the robot moves"):
        equality_axes(ParallelRobot.from_description(description, flexibility="flexible_links"))
