"""Pinocchio parses what moves and nothing else: the same model, and no line of its parser's own."""

import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import ParallelRobot, RobotFileError
from framework.model.urdf_edits import copy_without_shapes, make_continuous_joints_revolute
from tests.urdf_edits import edited

VISUALS = [
    '<box size="a b c"/>',
    '<box size="1 2"/>',
    '<box size="nan 1 1"/>',
    '<cylinder radius="x" length="1"/>',
    '<sphere radius=""/>',
    "<sphere/>",
    '<mesh filename=""/>',
    "<mesh/>",
    "<cone/>",
    "",
]
ODDITIES = [  # beside the shapes of a link, beside the axis of a joint
    ("</link>", '<visual><material><color rgba="red"/></material></visual></link>'),
    ("</link>", "<visual/></link>"),
    ("</joint>", '<safety_controller k_velocity="x"/></joint>'),
    ("</joint>", '<calibration rising="x"/></joint>'),
    ("</robot>", '<material name="red"/></robot>'),
    ("</robot>", '<material name="red"><color rgba="1 0"/></material></robot>'),
    ("</robot>", "<gazebo><a/></gazebo></robot>"),
]


@pytest.mark.parametrize("name", robots.CATALOGUE)
def test_the_model_is_the_one_of_the_whole_urdf(name):
    text = re.sub("<dynamics[^>]*>", "", robots.load(name).description.urdf_text)  # is read by us
    stripped = ElementTree.tostring(copy_without_shapes(ElementTree.fromstring(text)), encoding="unicode")
    whole, bare = (
        pin.buildModelFromXML(edited(urdf, (make_continuous_joints_revolute,))) for urdf in (text, stripped)
    )
    assert whole == bare  # joints, placements, inertias, limits, to the last bit


@pytest.mark.parametrize("part", ["visual", "collision"])
@pytest.mark.parametrize("shape", VISUALS)
def test_a_malformed_shape_prints_nothing_and_changes_nothing(write_robot, capfd, part, shape):
    many = f"<{part}><geometry>{shape}</geometry></{part}>" * 40
    robot = ParallelRobot.from_file(write_robot(urdf=(("</link>", f"{many}</link>"),)))
    assert robot.model == robots.load("five_bar").model
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(("old", "new"), ODDITIES)
def test_what_does_not_move_is_not_judged(write_robot, capfd, old, new):
    robot = ParallelRobot.from_file(write_robot(urdf=((old, new),)))
    assert robot.model == robots.load("five_bar").model
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("numbers", ["1 2", "nan 0 0", "a b c", "1e40 0 0"])
@pytest.mark.parametrize("key", ["xyz", "rpy"])
def test_a_shape_that_is_nowhere_is_refused_by_the_name_of_its_link(write_robot, key, numbers):
    shape = f'<visual><origin {key}="{numbers}"/><geometry><sphere radius="1"/></geometry></visual>'
    file = write_robot(urdf=(("</link>", f"{shape}</link>"),))
    with pytest.raises(RobotFileError, match=f"link '.*': <visual>: <origin> {key}: .*{numbers}"):
        ParallelRobot.from_file(file)


@pytest.mark.parametrize("number", ["1_0e-1", " 1. ", "+1", "1E0", "0.1e1", "\u0661"])  # one, as Python reads
def test_numbers_are_those_that_python_reads(write_robot, number):
    mass = '<mass value="10"/>'
    file = write_robot(urdf=((mass, f'<mass value="{number}"/>'),))
    inertias = ParallelRobot.from_file(file).model.inertias
    np.testing.assert_array_equal(sum(float(inertia.mass) for inertia in inertias), 1.0)
