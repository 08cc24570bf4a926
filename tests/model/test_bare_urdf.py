"""The model of what moves and nothing else: that of pinocchio's own parser, without a line of its own."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import ParallelRobot, RobotFileError
from framework.kinematics.tree_model import tree_model
from framework.model.urdf_elements import read_tree

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
def test_the_model_is_the_one_of_pinocchios_parser(name):
    urdf = ElementTree.fromstring(robots.load(name).description.urdf_text)
    tree = read_tree(urdf)
    for joint in urdf.findall("joint"):
        if joint.get("type") == "continuous":  # a point on a circle
            joint.set("type", "revolute")
            ElementTree.SubElement(joint, "limit", lower="-1e9", upper="1e9", effort="1e9", velocity="1e9")
        for dynamics in joint.findall("dynamics"):  # we keep them elsewhere
            joint.remove(dynamics)
    theirs = pin.buildModelFromXML(ElementTree.tostring(urdf, encoding="unicode"))
    ours = tree_model(tree)
    assert list(ours.names) == list(theirs.names)
    assert list(ours.parents) == list(theirs.parents)
    assert [(f.name, f.type, f.parentJoint) for f in ours.frames] == [
        (f.name, f.type, f.parentJoint) for f in theirs.frames
    ]
    for one, other in zip([*ours.frames], [*theirs.frames], strict=True):
        np.testing.assert_allclose(one.placement.homogeneous, other.placement.homogeneous, atol=1e-15)
    for key in ("lowerPositionLimit", "upperPositionLimit", "effortLimit", "velocityLimit"):
        np.testing.assert_array_equal(getattr(ours, key), getattr(theirs, key))
    for j in range(ours.njoints):
        assert ours.joints[j].shortname() == theirs.joints[j].shortname()
        place, their_place = ours.jointPlacements[j], theirs.jointPlacements[j]
        np.testing.assert_allclose(place.homogeneous, their_place.homogeneous, atol=1e-15)
        body, their_body = (model.inertias[j].toDynamicParameters() for model in (ours, theirs))
        np.testing.assert_allclose(body, their_body, rtol=1e-13, atol=1e-15)


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


@pytest.mark.parametrize("lower", ["-inf", "-1.79769e+308", "-Infinity"])
def test_limits_without_end_are_none(write_robot, capfd, lower):
    limit = '<limit lower="-6.28" upper="6.28" effort="0" velocity="20"/>'
    endless = limit.replace("-6.28", lower)
    mechanism = ParallelRobot.from_file(write_robot(urdf=((limit, endless),)))
    assert {one.joint: (one.lower, one.upper) for one in mechanism.limits}["left_elbow"] == (-1e9, 6.28)
    assert capfd.readouterr() == ("", "")


def test_a_robot_with_a_ball_keeps_the_limits_of_its_hinges():
    text = """<robot name="r"><link name="base"/><link name="crank"/><link name="rod"/>
      <joint name="hinge" type="revolute"><parent link="base"/><child link="crank"/>
        <limit lower="-1" upper="2" effort="3" velocity="4"/></joint>
      <joint name="ball" type="spherical"><parent link="crank"/><child link="rod"/></joint></robot>"""
    model = tree_model(read_tree(ElementTree.fromstring(text)))
    limits = model.lowerPositionLimit, model.upperPositionLimit, model.effortLimit, model.velocityLimit
    assert [values[0] for values in limits] == [-1.0, 2.0, 3.0, 4.0]
