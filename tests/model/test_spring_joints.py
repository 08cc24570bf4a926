"""Springs as virtual joints: at rest nothing has changed, and each gives way where its file says."""

from collections.abc import Sequence
from xml.etree.ElementTree import fromstring

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework.kinematics.tree_model import tree_model
from framework.model.description import Spring
from framework.model.urdf_edits import insert_springs
from framework.model.urdf_elements import read_tree
from tests.robots.every_robot import KINDS

# A motor, an elbow turned about x and a tip turned about z, so that frames and base differ.
ARM = """
<robot name="arm">
  <link name="base"/> <link name="crank"/> <link name="slider"/> <link name="tip"/>
  <joint name="motor" type="{motor}">
    <parent link="base"/> <child link="crank"/> <origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/>
    <axis xyz="0 0.6 0.8"/> {limit}
  </joint>
  <joint name="rail" type="prismatic">
    <parent link="crank"/> <child link="slider"/> <origin xyz="0.5 0 0" rpy="0.7 0 0"/>
    <axis xyz="0.6 0 -0.8"/> <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="weld" type="fixed">
    <parent link="slider"/> <child link="tip"/> <origin xyz="0 0.25 0" rpy="0 0 0.9"/>
  </joint>
</robot>
"""
LIMIT = '<limit lower="-3" upper="3" effort="1" velocity="1"/>'
REVOLUTE = ARM.format(motor="revolute", limit=LIMIT)
RNG = np.random.default_rng(0)
MOTOR, RAIL = 0.8, -0.3  # joint coordinates [rad], [m]


def spring(after: str, *motion: str, name: str = "soft") -> Spring:
    return Spring(name, "link", after, motion, (1.0,) * max(len(motion), 1))


def model_of(urdf: str, springs: Sequence[Spring] = ()) -> pin.Model:
    tree = read_tree(fromstring(urdf))
    insert_springs(tree, springs)
    return tree_model(tree)


def placements(model: pin.Model, **coordinates: float) -> dict[str, pin.SE3]:
    """Pose of each link in the base, joints not named at zero."""
    data = model.createData()
    q = np.zeros(model.nq)
    for name, value in coordinates.items():
        q[model.joints[model.getJointId(name)].idx_q] = value
    pin.framesForwardKinematics(model, data, q)
    return {
        frame.name: data.oMf[k].copy()
        for k, frame in enumerate(model.frames)
        if frame.type == pin.FrameType.BODY
    }


def twisted(axis: str, amount: float) -> pin.SE3:
    """A slide along, or a turn about, one axis of a frame, in closed form."""
    k = "xyz".index(axis[-1])
    if not axis.startswith("r"):
        return pin.SE3(np.eye(3), amount * np.eye(3)[k])
    turn = np.eye(3)
    i, j = (k + 1) % 3, (k + 2) % 3
    turn[[i, i, j, j], [i, j, i, j]] = np.cos(amount), -np.sin(amount), np.sin(amount), np.cos(amount)
    return pin.SE3(turn, np.zeros(3))


def assert_same_pose(one: pin.SE3, other: pin.SE3) -> None:
    np.testing.assert_allclose(one.homogeneous, other.homogeneous, atol=1e-15)  # rounding


def test_the_rigid_robot_is_the_untouched_urdf():
    assert model_of(REVOLUTE, []) == model_of(REVOLUTE)


@pytest.mark.parametrize("name", KINDS)
def test_with_springs_at_rest_all_links_are_where_the_rigid_robot_has_them(name):
    rigid, elastic = robots.load(name), robots.load(name, flexibility="flexible_links")
    for _ in range(2):
        joints = dict(zip(rigid.model.names[1:], RNG.uniform(-3, 3, rigid.model.nq), strict=True))
        urdf = rigid.description.urdf_text
        springs = elastic.description.active_springs(elastic.flexibility)
        at_rest = placements(model_of(urdf, springs), **joints)
        for link, pose in placements(model_of(urdf), **joints).items():
            assert_same_pose(at_rest[link], pose)


@pytest.mark.parametrize("axis", ["x", "y", "z", "rx", "ry", "rz"])
@pytest.mark.parametrize("after", ["motor", "rail", "weld"])
def test_a_spring_moves_the_child_along_an_axis_of_its_own_frame(after, axis):
    child = {"motor": "crank", "rail": "slider", "weld": "tip"}[after]
    elastic = model_of(REVOLUTE, [spring(after, axis)])
    moved = placements(elastic, motor=MOTOR, rail=RAIL, soft=0.1)
    rigid = placements(model_of(REVOLUTE), motor=MOTOR, rail=RAIL)
    assert_same_pose(moved[child], rigid[child] * twisted(axis, 0.1))
    assert_same_pose(moved["tip"], moved[child] * (rigid[child].inverse() * rigid["tip"]))  # the rest follows


@pytest.mark.parametrize("after", ["motor", "rail"])
def test_a_spring_without_motion_gives_way_as_its_joint_moves(after):
    elastic = model_of(REVOLUTE, [spring(after)])
    joints = {"motor": MOTOR, "rail": RAIL}
    further = {**joints, after: joints[after] + 0.1}
    assert_same_pose(
        placements(elastic, **joints, soft=0.1)["tip"], placements(model_of(REVOLUTE), **further)["tip"]
    )


def test_a_joint_without_an_axis_has_the_urdf_default_x():
    urdf = REVOLUTE.replace('<axis xyz="0 0.6 0.8"/>', "")
    elastic = model_of(urdf, [spring("motor")])
    assert_same_pose(
        placements(elastic, motor=0.2, soft=0.3)["tip"], placements(model_of(urdf), motor=0.5)["tip"]
    )


def test_the_axes_of_one_spring_follow_each_other_in_the_order_given():
    several = spring("weld", "x", "rz", "y")
    elastic = model_of(REVOLUTE, [several])
    moved = placements(elastic, motor=MOTOR, soft_x=0.1, soft_rz=0.2, soft_y=0.3)["tip"]
    expected = placements(model_of(REVOLUTE), motor=MOTOR)["tip"]
    for axis, amount in (("x", 0.1), ("rz", 0.2), ("y", 0.3)):
        expected *= twisted(axis, amount)
    assert several.coordinates == ("soft_x", "soft_rz", "soft_y")
    assert_same_pose(moved, expected)


def test_several_springs_behind_one_joint_follow_it_in_the_order_given():
    springs = [spring("motor", name="drive"), spring("motor", "y", name="bend"), spring("rail", "rx")]
    elastic = model_of(REVOLUTE, springs)
    moved = placements(elastic, motor=MOTOR, drive=0.1, bend=0.2, soft=0.3)["crank"]
    assert_same_pose(moved, placements(model_of(REVOLUTE), motor=MOTOR + 0.1)["crank"] * twisted("y", 0.2))


def test_springs_bring_neither_mass_nor_limits():
    rigid, elastic = (robots.load("five_bar_heavy", flexibility=f) for f in ("rigid", "flexible_links"))
    mass = [sum(inertia.mass for inertia in robot.model.inertias) for robot in (rigid, elastic)]
    assert mass[1] == pytest.approx(mass[0], rel=1e-15)
    assert np.all(elastic.model.upperPositionLimit[elastic.elastic] > 1e6)
    assert np.all(elastic.model.lowerPositionLimit[elastic.elastic] < -1e6)


@pytest.mark.parametrize("limit", ["", LIMIT])
def test_a_continuous_joint_counts_its_turns(limit):
    counting = model_of(ARM.format(motor="continuous", limit=limit))
    assert counting.nq == counting.nv == 2  # no point on a circle
    turned = placements(counting, motor=MOTOR + 4 * np.pi)
    np.testing.assert_allclose(
        turned["tip"].homogeneous, placements(model_of(REVOLUTE), motor=MOTOR)["tip"].homogeneous, atol=1e-14
    )  # cos and sin of 13 rad


def test_a_continuous_motor_can_have_a_spring_of_its_own():
    moved = placements(
        model_of(ARM.format(motor="continuous", limit=""), [spring("motor")]), motor=MOTOR, soft=0.1
    )
    assert_same_pose(moved["tip"], placements(model_of(REVOLUTE), motor=MOTOR + 0.1)["tip"])
