"""SDF: one mechanism in two formats has one plan; poses, axes and nested names mean what SDFormat says."""

import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from framework import Line, Mechanism, ParallelRobot, RobotFileError, locate_singularities, plan_crossing
from framework.kinematics.diagnostics.proposal import propose
from framework.model.description import JointDynamics, locked_axes
from framework.model.readers import parse_any, read_any
from framework.model.readers.sdf_scope import Scope
from framework.proofs.assembly_modes import assembly_modes
from tests.model.readers.foreign_files import short_move
from tests.oracles.placements import placements
from tests.robots.every_robot import assert_same_torques

INERTIAL = (
    "<inertial><pose>{x} 0 0 0 0 0</pose><mass>{m}</mass><inertia><ixx>0.001</ixx><iyy>0.01</iyy>"
    "<izz>0.01</izz></inertia></inertial>"
)
POSE = {"left_motor": 1.271863, "left_elbow": -0.83362, "right_motor": 1.083625, "right_elbow": 1.538591}
PLACES = {"left_crank": "-0.2 0 0", "left_rod": "0.05 0 0", "right_crank": "0.2 0 0", "right_rod": "0.45 0 0"}
JOINTS = (
    ("left_motor", "world", "left_crank"),
    ("left_elbow", "left_crank", "left_rod"),
    ("right_motor", "world", "right_crank"),
    ("right_elbow", "right_crank", "right_rod"),
)


def axis(more: str = "") -> str:
    return f"<axis><xyz>0 0 1</xyz>{more}</axis>"


def five_bar(more: str = "", tip_axis: str = axis()) -> str:
    """A five-bar whose links lie along x: its tip is open there, and closes by its frames."""
    links = "".join(
        f'<link name="{name}"><pose>{place} 0 0 0</pose>{INERTIAL.format(x=0.125, m=0.5)}</link>'
        for name, place in PLACES.items()
    )
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent>{parent}</parent><child>{child}</child>'
        f"{axis()}</joint>"
        for name, parent, child in JOINTS
    )
    tips = "".join(
        f'<frame name="{side}_tip" attached_to="{side}_rod"><pose>0.25 0 0 0 0 0</pose></frame>'
        for side in ("left", "right")
    )
    tip = f"<parent>left_tip</parent><child>right_tip</child>{tip_axis}"
    return (
        f'<sdf version="1.9"><model name="five_bar">{links}{joints}{tips}'
        f'<joint name="tip" type="revolute">{tip}</joint>{more}</model></sdf>'
    )


def five_bar_urdf() -> str:
    text = '<link name="world"/>'
    inertial = (
        '<inertial><origin xyz="0.125 0 0"/><mass value="0.5"/>'
        '<inertia ixx="0.001" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    for name, parent, child in JOINTS:
        xyz = PLACES[child] if parent == "world" else "0.25 0 0"
        text += (
            f'<link name="{child}">{inertial}</link><joint name="{name}" type="continuous">'
            f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/>'
            '<axis xyz="0 0 1"/></joint>'
        )
    tip = (
        '<constraint name="tip" type="revolute_joint"><parent link="left_rod"/>'
        '<parent_origin xyz="0.25 0 0"/><parent_axis xyz="0 0 1"/><child link="right_rod"/>'
        '<child_origin xyz="0.25 0 0"/></constraint>'
    )
    return f'<robot name="five_bar">{text}{tip}</robot>'


def fingers_urdf() -> str:
    """Two fingers that turn about y, the second by -2 times the first and 0.1 rad."""
    text = '<link name="world"/>'
    for name, x, mimic in (("a", 0.2, ""), ("b", -0.2, '<mimic joint="ja" multiplier="-2" offset="0.1"/>')):
        text += (
            f'<link name="{name}"><inertial><origin xyz="0.1 0 0"/><mass value="1"/><inertia ixx="0.01" '
            f'iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="j{name}" type="continuous"><parent link="world"/><child link="{name}"/>'
            f'<origin xyz="{x} 0 0"/><axis xyz="0 1 0"/>{mimic}</joint>'
        )
    return f'<robot name="fingers">{text}</robot>'


def fingers_sdf() -> str:
    text = ""
    mimic = '<mimic joint="ja"><multiplier>-2</multiplier><offset>0.1</offset></mimic>'
    for name, x, more in (("a", 0.2, ""), ("b", -0.2, mimic)):
        text += (
            f'<link name="{name}"><pose>{x} 0 0 0 0 0</pose>'
            f"<inertial><pose>0.1 0 0 0 0 0</pose><mass>1</mass>"
            f"<inertia><ixx>0.01</ixx><iyy>0.02</iyy><izz>0.02</izz></inertia></inertial></link>"
            f'<joint name="j{name}" type="revolute"><parent>world</parent><child>{name}</child>'
            f"<axis><xyz>0 1 0</xyz>{more}</axis></joint>"
        )
    return f'<sdf version="1.11"><model name="fingers">{text}</model></sdf>'


def test_each_axis_of_a_universal_joint_may_mimic_another(tmp_path):
    mimic = '<mimic joint="ja" axis="axis"><multiplier>0.5</multiplier><reference>0.2</reference></mimic>'
    text = (
        f'<sdf version="1.11"><model name="wrist"><link name="a"/><joint name="ja" type="universal">'
        f"<parent>world</parent><child>a</child><axis><xyz>1 0 0</xyz></axis>"
        f"<axis2><xyz>0 1 0</xyz>{mimic}</axis2></joint></model></sdf>"
    )
    (tmp_path / "wrist.sdf").write_text(text)
    robot = read_any(tmp_path / "wrist.sdf", platform_joints=["ja_2"], motors=["ja"])
    (coupling,) = robot.couplings
    assert (coupling.joint, coupling.of, coupling.ratio, coupling.offset) == ("ja_2", "ja", 0.5, -0.1)
    (tmp_path / "wrist.sdf").write_text(text.replace('joint="ja" axis="axis"', 'joint="jb" axis="axis2"'))
    with pytest.raises(RobotFileError, match=r"joint 'ja': <mimic>: unknown joint 'jb_2'"):
        read_any(tmp_path / "wrist.sdf", platform_joints=["ja_2"], motors=["ja"])


def test_a_world_finds_the_models_beside_its_folder(tmp_path):
    for folder in ("worlds", "models/fingers"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "models/fingers/model.sdf").write_text(fingers_sdf())
    world = '<world name="w"><include><uri>model://fingers</uri></include></world>'
    (tmp_path / "worlds/w.sdf").write_text(f'<sdf version="1.11">{world}</sdf>')
    robot = read_any(tmp_path / "worlds/w.sdf", platform_joints=["jb"], motors=["ja"])
    assert [coupling.name for coupling in robot.couplings] == ["jb_of_ja"]


def test_fingers_that_mimic_have_one_plan_in_two_formats(tmp_path):
    """That of the law of motion: what each finger needs, as the first finger feels it."""
    plans = []
    for name, text in (("a.urdf", fingers_urdf()), ("a.sdf", fingers_sdf())):
        (tmp_path / name).write_text(text)
        description = read_any(tmp_path / name, platform_joints=["jb"], motors=["ja"])
        plans.append(short_move(ParallelRobot.from_description(description)))
    t = np.linspace(0.0, 1.0, 41)
    turn, acceleration = (plans[0].motor_angle(t, order)[:, 0] for order in (0, 2))
    second = 0.1 - 2.0 * turn
    weights = (
        9.81 * 0.1 * (2.0 * np.cos(second) - np.cos(turn))
    )  # about y, the first finger's and -2 x the second's
    expected = (0.02 + 0.1**2) * 5.0 * acceleration + weights
    for plan in plans:
        np.testing.assert_allclose(
            plan.torque(t)[:, 0], expected, rtol=0, atol=1e-10 * np.abs(expected).max()
        )


def test_a_negative_damping_is_refused_by_the_name_of_its_joint(tmp_path):
    damped = "<axis><dynamics><damping>-1</damping></dynamics>"
    (tmp_path / "a.sdf").write_text(fingers_sdf().replace("<axis>", damped, 1))
    with pytest.raises(
        RobotFileError, match="joint 'ja': armature, damping, friction and stiffness must not"
    ):
        read_any(tmp_path / "a.sdf", platform_joints=["jb"], motors=["ja"])


def test_one_mechanism_in_two_formats_has_one_plan(tmp_path):
    said = {"axes": ["x", "y"], "motors": ["left_motor", "right_motor"], "reference": POSE}
    plans = []
    for name, text, platform in (("a.sdf", five_bar(), "tip_1"), ("a.urdf", five_bar_urdf(), "tip_parent")):
        (tmp_path / name).write_text(text)
        robot = ParallelRobot.from_description(read_any(tmp_path / name, platform=platform, **said))
        path = Line([0.1, 0.345], [-0.05, 0.195])
        assert len(locate_singularities(robot, path)) == 1
        plans.append(plan_crossing(robot, path, duration=1.5, times=[1.0], speeds=[1.5]))
    assert_same_torques(*plans, within=1e-10)


def read(folder: Path, text: str, **said):
    file = folder / "model.sdf"
    file.write_text(text)
    return parse_any(file, propose=propose, **said)


def test_what_joins_the_loops_need_not_be_assembled(tmp_path):
    parsed = read(tmp_path, five_bar())
    assert parsed.dialect == "sdf"
    assert any(remark.startswith("reference: the nearest closed pose") for remark in parsed.remarks)
    assert [closure.name for closure in parsed.description.closures] == ["tip"]
    assert parsed.description.platform.frame == "left_tip"  # the file's own frame at the loop
    assert ParallelRobot.from_description(parsed.description).n == 2


def test_a_joint_with_something_of_its_own_is_not_where_a_loop_is_cut(tmp_path):
    own = axis("<dynamics><damping>0.3</damping></dynamics>")
    description = read(tmp_path, five_bar(tip_axis=own)).description
    assert description.joints == {"tip": JointDynamics(damping=0.3)}
    assert [closure.name for closure in description.closures] == ["right_elbow"]


def test_mimics_limits_and_springs_are_those_of_the_joints(tmp_path):
    more = (
        "<dynamics><spring_stiffness>2</spring_stiffness><spring_reference>0.1</spring_reference>"
        "<friction>0.4</friction></dynamics><limit><lower>-3</lower><upper>2</upper></limit>"
    )
    mimic = (
        '<mimic joint="left_motor"><multiplier>-2</multiplier><offset>0.5</offset>'
        "<reference>0.1</reference></mimic>"
    )
    text = five_bar().replace(f"<child>left_crank</child>{axis()}", f"<child>left_crank</child>{axis(more)}")
    text = text.replace(f"<child>right_crank</child>{axis()}", f"<child>right_crank</child>{axis(mimic)}")
    file = tmp_path / "model.sdf"
    file.write_text(text)
    description = read_any(file, platform="tip_1", axes=["x"], motors=["left_motor"], reference=POSE)
    (coupling,) = description.couplings
    assert (coupling.joint, coupling.of, coupling.ratio) == ("right_motor", "left_motor", -2)
    assert coupling.offset == pytest.approx(0.7)
    assert description.joints["left_motor"] == JointDynamics(friction=0.4, stiffness=2.0, rest=0.1)
    limits = {
        limit.joint: (limit.lower, limit.upper) for limit in Mechanism.from_description(description).limits
    }
    assert limits == {"left_motor": (-3, 2)}


POSES = """<sdf version="{version}"><model name="m"><pose>9 9 9 0 0 0</pose>
<link name="a"><pose>1 2 3 0.1 0.2 0.3</pose></link>
<link name="b"><pose relative_to="f">0 1 0 0.5 0 0</pose></link>
<frame name="f" attached_to="a"><pose>0 0 1 0 0 0.4</pose></frame>
<joint name="j" type="revolute"><pose>0.1 0 0 0 0.7 0</pose><parent>a</parent><child>b</child>
<axis><xyz{within}>1 2 3</xyz></axis></joint>
<joint name="k" type="revolute"><parent>a</parent><child>b</child><axis><xyz>0 0 1</xyz></axis></joint>
</model></sdf>"""


@pytest.mark.parametrize(
    ("version", "within", "frames"),
    [
        ("1.9", "", ()),
        ("1.9", ' expressed_in="__model__"', "model"),
        ("1.9", ' expressed_in="a"', "a"),
        ("1.4", "", "model"),
    ],
)
def test_poses_and_axes_are_relative_to_what_sdformat_says(tmp_path, version, within, frames):
    def at(x, y, z, *rpy):
        return pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array([x, y, z], float))

    (tmp_path / "m.sdf").write_text(POSES.format(version=version, within=within))
    description = read_any(tmp_path / "m.sdf", platform="b", axes=["rx"], motors=["j"])
    robot = Mechanism.from_description(description)
    a = at(1, 2, 3, 0.1, 0.2, 0.3)
    b = a * at(0, 0, 1, 0, 0, 0.4) * at(0, 1, 0, 0.5, 0, 0)
    joint = b * at(0.1, 0, 0, 0, 0.7, 0)
    turned = {"": joint, "a": a, "model": pin.SE3.Identity()}[frames or ""]
    direction = turned.rotation @ np.array([1.0, 2.0, 3.0]) / np.sqrt(14)
    in_a, in_b = placements(robot.model, ("a", "b"))
    np.testing.assert_allclose(in_a.actInv(in_b).homogeneous, a.actInv(b).homogeneous, atol=1e-15)
    data = robot.model.createData()
    pin.computeJointJacobians(robot.model, data, pin.neutral(robot.model))
    twist = pin.getFrameJacobian(
        robot.model, data, robot.model.getFrameId("b"), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    ).reshape(6)
    expected = a.rotation.T @ direction
    np.testing.assert_allclose(twist[3:], expected, atol=1e-15)
    arm = a.rotation.T @ (b.translation - joint.translation)
    np.testing.assert_allclose(twist[:3], np.cross(expected, arm), atol=1e-15)


@pytest.mark.parametrize(
    ("file", "config"),
    [
        ("model.sdf", ""),
        ("new.sdf", "<model><sdf version='1.4'>old.sdf</sdf><sdf version='1.9'> new.sdf </sdf></model>"),
        ("arm.sdf", '<!-- a licence first --><?xml version="1.0"?><model><sdf>arm.sdf</sdf></model>'),
    ],
)
def test_nested_models_are_included_from_beside_the_file(tmp_path, file, config):
    (tmp_path / "arm").mkdir()
    (tmp_path / "arm" / file).write_text(
        '<sdf version="1.9"><model name="arm"><link name="1"/></model></sdf>'
    )
    if config:
        (tmp_path / "arm" / "model.config").write_text(config)
    joint = '<joint name="{}" type="{}"><parent>base</parent><child>{}</child></joint>'
    text = (
        '<sdf version="1.9"><world name="w"><model name="m"><link name="base"/>'
        "<include><uri>model://arm</uri><name>left</name><pose>0 0 2 0 0 0</pose></include>"
        "<include><uri>arm</uri><name>right</name></include>"
        + joint.format("j", "revolute", "left::1")
        + joint.format("k", "revolute", "right::1")
        + '<joint name="l" type="ball"><parent>left::1</parent><child>right::1</child></joint>'
        + "</model></world></sdf>"
    )
    (tmp_path / "w.sdf").write_text(text)
    description = read_any(tmp_path / "w.sdf", platform="left::1", axes=["rz"], motors=["j"])
    robot = Mechanism.from_description(description)
    (left,) = placements(robot.model, ("left::1",))
    np.testing.assert_allclose(left.translation, [0, 0, 2])
    assert description.closures[0].axes == ("x", "y", "z")


@pytest.mark.parametrize(
    ("thread", "lead"),
    [
        ("<screw_thread_pitch>0.01</screw_thread_pitch>", 0.01),
        ("<thread_pitch>-400</thread_pitch>", np.pi / 200),
    ],
)
def test_a_jack_lifts_its_nut_by_the_lead_of_its_screw(tmp_path, thread, lead):
    """The nut of a right-handed screw sinks when it turns about z; its weight gives the torque."""
    mass, links = 2.0, ("base", "shaft", "nut")
    text = (
        '<sdf version="1.10"><model name="jack"><static>false</static>'
        + "".join(f'<link name="{n}">{INERTIAL.format(x=0, m=mass)}</link>' for n in links)
        + "".join(
            f'<joint name="{name}" type="{kind}"><parent>{parent}</parent><child>{child}</child>{axis()}'
            f"{more}</joint>"
            for name, kind, parent, child, more in (
                ("motor", "revolute", "base", "shaft", ""),
                ("guide", "prismatic", "base", "nut", ""),
                ("thread", "screw", "shaft", "nut", thread),
            )
        )
        + "</model></sdf>"
    )
    description = read(tmp_path, text, motors=["motor"], platform="nut", axes=["z"]).description
    robot = ParallelRobot.from_description(description)
    plan = plan_crossing(robot, Line([0.0], [0.01]), duration=1.0)
    turned = plan.motor_angle(np.array([0.0, 1.0]))[:, 0]
    np.testing.assert_allclose(np.diff(turned), -0.01 / lead * 2 * np.pi, rtol=1e-9)
    np.testing.assert_allclose(plan.torque(np.zeros(1)), -mass * 9.81 * lead / (2 * np.pi), rtol=1e-9)


def test_a_screw_that_has_to_close_a_loop_is_refused_by_its_name(tmp_path):
    ends = {"a": ("base", "shaft"), "b": ("base", "nut"), "c": ("shaft", "nut")}
    links = "".join(
        f'<link name="{n}">{INERTIAL.format(x=0, m=1.0)}</link>' for n in ("base", "shaft", "nut")
    )
    joints = "".join(
        f'<joint name="{name}" type="screw"><parent>{parent}</parent><child>{child}</child>{axis()}</joint>'
        for name, (parent, child) in ends.items()
    )
    text = f'<sdf version="1.10"><model name="m">{links}{joints}</model></sdf>'
    with pytest.raises(RobotFileError, match="joint 'c': screw: not read where it closes a loop"):
        read(tmp_path, text, motors=["a"], platform="nut", axes=["z"])


def test_links_without_gravity_beside_the_mechanism_and_what_no_motion_needs_are_named(tmp_path):
    text = five_bar('<link name="hook"/><plugin name="p" filename="f"/><light name="l"/>')
    parsed = read(
        tmp_path, text.replace('<link name="left_rod">', '<link name="left_rod"><gravity>0</gravity>')
    )
    assert parsed.description.left_out == ("link 'left_rod': <gravity> off, 0.5 kg",)
    assert parsed.remarks[:2] == (
        "not used: 1 <plugin>, 1 <light>",
        "not read: hook of 1 kg, which no joint joins with the mechanism",
    )


def test_damping_is_that_of_each_axis_of_a_universal_joint(tmp_path):
    damped = "<dynamics><damping>{}</damping></dynamics>"
    second = f"<axis2><xyz>0 1 0</xyz>{damped.format(0.2)}</axis2>"
    joint = f"<parent>left_crank</parent><child>left_rod</child>{axis()}</joint>"
    text = five_bar().replace('name="left_elbow" type="revolute"', 'name="left_elbow" type="universal"')
    text = text.replace(joint, joint.replace(axis(), axis(damped.format(0.1)) + second))
    joints = read(tmp_path, text, motors=["left_motor", "right_motor"]).description.joints
    assert joints == {"left_elbow": JointDynamics(damping=0.1), "left_elbow_2": JointDynamics(damping=0.2)}


def test_comments_and_prefixes_that_xml_forbids_are_mended(tmp_path):
    text = five_bar("<!-- a -- b --><gz:thing gz:of='1'/>")
    assert read(tmp_path, text).description.closures[0].name == "tip"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name="tip" type="revolute"', 'name="tip" type="gearbox"', "joint 'tip': gearbox: not read"),
        ('name="tip" type="revolute"', 'name="tip" type="hinge"', "joint 'tip': unknown type 'hinge'"),
        ("<child>right_tip</child>", "<child>tip_2</child>", "joint 'tip': unknown link or frame 'tip_2'"),
        ("<child>right_tip</child>", "", "joint 'tip': <child> is missing"),
        ('attached_to="left_rod"', 'attached_to="left_tip"', "left_tip"),
        ("<xyz>0 0 1</xyz>", "<xyz>0 0 0</xyz>", "the axis is zero"),
        ("<mass>0.5</mass>", "<mass>heavy</mass>", "link 'left_crank': <mass>: needs finite numbers"),
        ("<ixx>0.001</ixx>", "<ixx>-1</ixx>", "link 'left_crank': <inertia>: has the principal moments"),
        ('<link name="left_rod">', '<link name="left_crank">', "duplicate link 'left_crank'"),
    ],
)
def test_a_malformed_model_gives_one_line(tmp_path, old, new, message):
    text = five_bar()
    assert old in text
    with pytest.raises(RobotFileError, match=message) as caught:
        read(tmp_path, text.replace(old, new, 1))
    assert "\n" not in str(caught.value)


def test_a_lock_of_a_joint_that_leads_a_fixed_one_is_read(tmp_path):
    follower = '<mimic joint="left_elbow"><multiplier>1</multiplier></mimic>'
    joints = (
        '<joint name="left_motor" type="revolute"><parent>world</parent><child>crank</child><axis/></joint>'
        '<joint name="left_elbow" type="revolute"><parent>crank</parent><child>rod</child><axis/></joint>'
        '<joint name="mark" type="fixed"><parent>rod</parent><child>dot</child>'
        f"<axis>{follower}</axis></joint>"
    )
    links = "".join(f'<link name="{name}"/>' for name in ("crank", "rod", "dot"))
    file = tmp_path / "led.sdf"
    file.write_text(f'<sdf version="1.7"><model name="led">{links}{joints}</model></sdf>')
    with pytest.raises(RobotFileError, match="no loop moves"):
        parse_any(file, locked={"left_elbow": 0.0})


def test_gazebo_s_detachable_joint_closes_the_loop_of_two_links(tmp_path):
    """The plugin welds a stub, which turns on the left rod, to the right rod: a hinge at the tip."""
    plugin = 'filename="detach" name="gz::sim::systems::DetachableJoint"'
    stub = (
        '<link name="stub"><pose>0.3 0 0 0 0 0</pose></link>'
        f'<joint name="tip" type="revolute"><parent>left_rod</parent><child>stub</child>'
        f"{axis()}</joint>"
        f"<plugin {plugin}><parent_link>right_rod</parent_link>"
        "<child_model>m</child_model><child_link>stub</child_link></plugin>"
    )
    model = re.sub(r"<joint name=.tip.*?</joint>", "", five_bar())
    name = re.search(r"<model name=.([^'\"]*)", model)[1]
    text = model.replace("</model>", stub.replace(">m<", f">{name}<") + "</model>")
    (tmp_path / "robot.sdf").write_text(text)
    parsed = parse_any(tmp_path / "robot.sdf", propose=propose)
    (closure,) = parsed.description.closures
    assert closure.axes == locked_axes("fixed")
    assert "detachable" in closure.name
    absent = stub.replace("<child_model>m<", "<child_model>box<")
    (tmp_path / "grasp.sdf").write_text(
        five_bar().replace("</model>", absent[absent.index("<plugin") :] + "</model>")
    )
    grasp = parse_any(tmp_path / "grasp.sdf", propose=propose).description
    assert not [closure for closure in grasp.closures if "detachable" in closure.name]
    (tmp_path / "torn.sdf").write_text(text.replace("child_link>", "child_body>"))
    assert any("DetachableJoint of" in text for text in grasp.left_out)
    with pytest.raises(RobotFileError, match="DetachableJoint: <child_link> is missing"):
        read_any(tmp_path / "torn.sdf")


def test_a_model_that_is_not_found_is_named_where_its_joint_is_missing(tmp_path):
    scene = "<sdf version='1.9'><world name='w'><include><uri>model://lost_arm</uri></include></world></sdf>"
    (tmp_path / "scene.sdf").write_text(scene)
    with pytest.raises(
        RobotFileError, match="no joint in it; <include> lost_arm: not read, as there is no such"
    ):
        read_any(tmp_path / "scene.sdf")


@pytest.mark.parametrize("size", ["1.79769e+308", "inf", "1e16"])
def test_limits_without_a_size_are_none(tmp_path, size):
    limit = f"<limit><lower>-{size}</lower><upper>{size}</upper></limit>"
    text = five_bar().replace(axis(), axis(limit), 1)
    said = {"platform": "tip_1", "axes": ["x", "y"], "motors": ["left_motor", "right_motor"]}
    (tmp_path / "robot.sdf").write_text(text)
    described = parse_any(tmp_path / "robot.sdf", **said)
    assert described.tree.joints["left_motor"].kind == "continuous"
    (tmp_path / "robot.sdf").write_text(text.replace(f"-{size}", "-0.5"))
    described = parse_any(tmp_path / "robot.sdf", **said)
    assert described.tree.joints["left_motor"].limits == (-0.5, 1e9)


def test_empty_elements_mean_their_defaults(tmp_path):
    empty = "<limit><lower/><upper> </upper></limit><dynamics><damping/></dynamics></axis>"
    texts = []
    for text in (fingers_sdf(), fingers_sdf().replace("</axis>", empty)):
        description = read(tmp_path, text, platform_joints=["jb"], motors=["ja"]).description
        texts.append(description.urdf_text)
    assert texts[0] == texts[1]


def test_a_loop_in_words_between_frames_of_the_file_is_that_of_a_joint(tmp_path):
    """As for a file of Drake, whose code closes the loop, and whose joints start at initial positions."""
    text = five_bar()
    start, _, end = text.partition('<joint name="tip"')
    text = start + end.partition("</joint>")[2]
    for name, angle in POSE.items():
        begin, joint, rest = text.partition(f'<joint name="{name}"')
        initial = f"<axis><initial_position>{angle}</initial_position>"
        text = begin + joint + rest.replace("<axis>", initial, 1)
    closure = ("left_tip", "right_tip", "revolute", "z")
    parsed = read(tmp_path, text, closures=[closure])
    robot = ParallelRobot.from_description(parsed.description)
    assert robot.reference_values(robot.reference.q) == pytest.approx(POSE, abs=1e-6)
    stated = read(tmp_path, five_bar(), reference=POSE)
    plans = [short_move(ParallelRobot.from_description(each.description)) for each in (parsed, stated)]
    assert_same_torques(*plans, within=1e-10)
    with pytest.raises(RobotFileError, match="no loop in it: --close FRAME FRAME KIND closes one"):
        read(tmp_path, text)


def framed(name: str, parent: str, child: str, frames: tuple[str, str], effort: str = "0.00") -> str:
    """A hinge about y that stands in a frame of each link, as Drake writes it."""
    ends = f"<parent>{parent}</parent><child>{child}</child>"
    places = "".join(
        f"<drake:{end}_frame>{frame}</drake:{end}_frame>"
        for end, frame in zip(("parent", "child"), frames, strict=True)
    )
    limit = f"<limit>{effort and f'<effort>{effort}</effort>'}</limit>"
    axis = f'<axis><xyz expressed_in="{frames[1]}">0 1 0</xyz>{limit}</axis>'
    return f'<joint name="{name}" type="revolute">{ends}{places}<pose>9 9 9 0 0 0</pose>{axis}</joint>'


@pytest.mark.parametrize(("crank", "effort"), [(0.0, ""), (0.7, "inf"), (0.7, "1.79769e+308")])
def test_a_joint_of_drake_stands_in_a_frame_of_each_link(tmp_path, crank, effort):
    """A four-bar that is drawn apart: the rocker's angle by the law of cosines. The motor is not limited."""
    a, b, c, d = 0.1, 0.35, 0.2, 0.3  # [m] crank along x at zero, coupler along x, rocker along x, ground
    links = "".join(
        f'<link name="{name}"><pose>{k} {k} {k} 0 0 {k}</pose>{INERTIAL.format(x=0.05, m=1)}</link>'
        for k, name in enumerate(("ground", "crank", "coupler", "rocker"))
    )
    places = {
        "Gr": ("ground", d),
        "Cc": ("crank", a),
        "Bc": ("coupler", -0.5 * b),
        "Br": ("coupler", 0.5 * b),
    }
    places["Rb"] = "rocker", c
    frames = "".join(
        f'<frame name="{name}" attached_to="{link}"><pose relative_to="{link}">{x} 0 0 0 0 0</pose></frame>'
        for name, (link, x) in places.items()
    )
    joints = framed("left", "ground", "rocker", ("Gr", "rocker"))
    joints += framed("motor", "ground", "crank", ("ground", "crank"), effort)
    joints += framed("pin", "crank", "coupler", ("Cc", "Bc"))
    joints += framed("tip", "coupler", "rocker", ("Br", "Rb"))
    weld = '<joint name="weld" type="fixed"><parent>world</parent><child>ground</child></joint>'
    text = f'<sdf version="1.7"><model name="m">{links}{frames}{weld}{joints}</model></sdf>'
    parsed = read(tmp_path, text, platform_joints=["left"])
    assert parsed.description.motor_joints == ("motor",)
    robot = ParallelRobot.from_description(parsed.description)
    tip = np.array([a * np.cos(crank), -a * np.sin(crank)])  # about y: z falls
    to_tip = tip - [d, 0.0]
    cosine = (to_tip @ to_tip + c**2 - b**2) / (2.0 * c * np.linalg.norm(to_tip))
    angles = {mode.x[0] for mode in assembly_modes(robot, [crank]).modes}
    towards = np.arctan2(-to_tip[1], to_tip[0])
    expected = [towards + np.arccos(cosine), towards - np.arccos(cosine)]
    assert np.sort(np.cos([*angles])) == pytest.approx(np.sort(np.cos(expected)), abs=1e-9)
    with pytest.raises(RobotFileError, match="joint 'tip': needs both drake:parent_frame"):
        read(tmp_path, text.replace("<drake:child_frame>Rb</drake:child_frame>", ""))


def test_frames_without_a_place_and_positions_of_fixed_joints_are_left_out(tmp_path):
    fixed = '<joint name="weld" type="fixed"><parent>left_rod</parent><child>tool</child>{}</joint>'
    tool = f'<link name="tool">{INERTIAL.format(x=0.1, m=0.1)}</link>'
    position = "<axis><initial_position>1</initial_position></axis>"
    lost = '<frame name="lost" attached_to="camera::lens"/>'
    plain = read(tmp_path, five_bar(tool + fixed.format(""))).description
    described = read(tmp_path, five_bar(tool + fixed.format(position) + lost)).description
    assert described.urdf_text == plain.urdf_text
    assert described.reference == plain.reference


def test_an_inertia_that_is_auto_is_that_of_solid_collisions(tmp_path):
    """A rod with a ball at its end: masses by density, moments by Steiner; a stated mass scales them."""
    r, length, ball, end = 0.01, 0.2, 0.02, 0.25
    solid = (
        '<inertial auto="true">{mass}</inertial>'
        '<collision name="rod"><pose>{x} 0 0 0 1.5707963267948966 0</pose>'
        "<density>2700</density><geometry><cylinder><radius>{r}</radius><length>{length}</length></cylinder>"
        '</geometry></collision><collision name="ball"><pose relative_to="left_tip">0 0 0 0 0 0</pose>'
        "<geometry><{shape}><radius>{ball}</radius></{shape}></geometry></collision>"
    )
    sizes = {"x": length / 2, "r": r, "length": length, "ball": ball}
    start, _, rest = five_bar().partition('<link name="left_rod">')
    pose, _, rest = rest.partition("<inertial>")
    rest = rest.partition("</inertial>")[2]

    def left_rod(mass: str = "", shape: str = "sphere") -> pin.Inertia:
        text = solid.format(mass=mass, shape=shape, **sizes)
        parsed = read(tmp_path, f'{start}<link name="left_rod">{pose}{text}{rest}', reference=POSE)
        model = pin.buildModelFromXML(parsed.description.urdf_text)
        return model.inertias[model.getJointId("left_elbow")]

    rod, sphere = 2700.0 * np.pi * r**2 * length, 1000.0 * 4.0 / 3.0 * np.pi * ball**3
    mass = rod + sphere
    centre = (rod * length / 2 + sphere * end) / mass
    across = rod * (3 * r**2 + length**2) / 12 + rod * (length / 2 - centre) ** 2
    across += 0.4 * sphere * ball**2 + sphere * (end - centre) ** 2
    body = left_rod()
    np.testing.assert_allclose(body.lever, [centre, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose([body.mass, body.inertia[1, 1], body.inertia[2, 2]], [mass, across, across])
    np.testing.assert_allclose(body.inertia[0, 0], rod * r**2 / 2 + 0.4 * sphere * ball**2)
    heavy = left_rod("<mass>3</mass>")
    np.testing.assert_allclose(
        [heavy.mass, *heavy.inertia.ravel()], [3.0, *(3.0 / mass * body.inertia).ravel()]
    )
    with pytest.raises(
        RobotFileError, match="left_rod': its <inertial auto> is that of a cone, which is not"
    ):
        left_rod(shape="cone")


def test_a_frame_is_carried_by_the_link_at_the_end_of_its_chain_however_long():
    chain = {f"frame_{k}": f"frame_{k + 1}" for k in range(9)} | {"frame_9": "link"}
    assert Scope(1.7, attached=chain, links={"link": None}).link_of("frame_0") == "link"
    with pytest.raises(RobotFileError, match="frame_0"):
        Scope(1.7, attached=chain | {"frame_9": "frame_0"}, links={"link": None}).link_of("frame_0")
