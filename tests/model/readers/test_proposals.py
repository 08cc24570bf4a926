"""What convert proposes of a file that is silent, what it holds, and what it leaves out."""

from __future__ import annotations

from pathlib import Path

import pytest

from framework import ParallelRobot
from framework.errors import RobotFileError
from framework.kinematics.diagnostics.proposal import propose
from framework.model.readers.recognise import parse_any

DATA = Path(__file__).parents[2] / "data" / "dialects"
GRIPPER = DATA / "mirrored_gripper.xml"


def test_a_tendon_over_coupled_joints_is_a_transmission_to_one():
    robot = parse_any(GRIPPER, base="palm", propose=propose)
    (actuator,) = robot.description.actuators
    assert (actuator.joint, actuator.gear_ratio, actuator.torque_limit) == ("right_driver_joint", 1.0, 5.0)
    assert robot.description.couplings[0].name == "left_driver_joint_of_right_driver_joint"
    assert ParallelRobot.from_description(robot.description).n == 1


def test_what_acts_beside_the_base_stops_nothing_and_is_not_named():
    assert parse_any(GRIPPER, base="palm", propose=propose).left_out == ()
    left_out = " ".join(parse_any(GRIPPER, propose=propose, locked={}).left_out)
    assert left_out == ""  # the arm carries the loops and has no motor: it is held


def test_joints_that_are_locked_take_their_followers_with_them():
    with pytest.raises(RobotFileError, match="the loops leave no freedom"):
        parse_any(GRIPPER, base="palm", locked={"left_driver_joint": 0.0}, propose=propose)


def test_classes_say_what_acts_on_a_passive_joint():
    joint = parse_any(GRIPPER, base="palm", propose=propose).description.joints["left_follower_joint"]
    assert (joint.stiffness, joint.rest, joint.damping, joint.friction) == (0.05, 0.3, 0.002, 0.01)


@pytest.mark.parametrize("name", ["five_bar_anchor.xml", "five_bar_sites.xml", "five_bar_ros.urdf"])
def test_a_five_bar_is_proposed_whole(name):
    parsed = parse_any(DATA / name, propose=propose)
    robot = ParallelRobot.from_description(parsed.description)
    assert set(robot.actuator_names) == {"left_motor", "right_motor"}
    assert robot.axis_names == ("x", "y")
