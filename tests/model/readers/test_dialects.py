"""One robot in every dialect is one robot; what a dialect leaves unsaid is asked for by name."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import (
    Line,
    Mechanism,
    OutputError,
    ParallelRobot,
    RobotFileError,
    assemble,
    check_robot,
    dynamics_at,
    locate_singularities,
)
from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import frames_at
from framework.model import read_robot_file
from framework.model.description import CLOSURE_KINDS, Coupling, locked_axes
from framework.model.readers import DIALECTS, parse_any, read_any
from framework.model.robot_file_writer import write_robot_file
from tests.model.readers.leg import ankle
from tests.oracles.placements import placements

DATA = Path(__file__).parents[2] / "data" / "dialects"
POSE = {"left_motor": 1.271863, "left_elbow": -0.83362, "right_motor": 1.083625, "right_elbow": 1.538591}
AXES = {"axes": ["x", "y"]}
FIVE_BARS = {
    "own": (robots.CATALOGUE["five_bar"].file, {}),
    "gepetto": (DATA / "gepetto" / "robot.yaml", {"platform": "tip_A", **AXES}),
    "gepetto folder": (DATA / "gepetto", {"platform": "tip_A", **AXES}),
    "urdf+": (
        DATA / "five_bar_plus.urdf",
        {"platform": "tip_predecessor", "motors": ["left_motor", "right_motor"], **AXES},
    ),
    "ros": (DATA / "five_bar_ros.urdf", {"platform": "tip_parent", "reference": POSE, **AXES}),
    "loop_joint": (DATA / "five_bar_loop_joint.urdf", {"platform": "tip", "reference": POSE, **AXES}),
    "onshape": (
        DATA / "five_bar_onshape.urdf",
        {"platform": "closing_tip_1", "reference": POSE, "motors": ["left_motor", "right_motor"], **AXES},
    ),
    "mjcf, sites": (DATA / "five_bar_sites.xml", {"platform": "left_tip", **AXES}),
    "mjcf, anchor": (DATA / "five_bar_anchor.xml", {"platform": "tip", **AXES}),
}
LINE = Line([0.1, 0.345], [-0.05, 0.195])


@pytest.mark.parametrize("name", FIVE_BARS)
def test_the_five_bar_is_the_same_in_every_dialect(name, tmp_path):
    """Read, written as a robot file, and read again."""
    file, options = FIVE_BARS[name]
    written = write_robot_file(read_any(file, **options), tmp_path / "out")
    robot = ParallelRobot.from_description(read_robot_file(written))
    own = check_robot(robots.load("five_bar"))
    found = check_robot(robot)
    assert (found.mobility, found.rank, found.mass) == (own.mobility, own.rank, own.mass)
    assert (found.working_mode, found.assembly_mode) == (own.working_mode, own.assembly_mode)
    (singular,) = locate_singularities(robot, LINE)
    assert singular.s == pytest.approx(0.667006874764298, abs=1e-12)
    assert singular.kind == "type_2"


@pytest.mark.parametrize("name", FIVE_BARS)
def test_the_dialect_is_recognised(name):
    expected = {"own": "robot file", "gepetto folder": "gepetto"}.get(name, name.split(",")[0])
    file, options = FIVE_BARS[name]
    assert parse_any(file, **options).dialect == expected
    assert expected in DIALECTS


def test_a_hinge_of_onshape_has_a_second_pair_of_frames_on_its_axis(tmp_path):
    text = (DATA / "five_bar_onshape.urdf").read_text()
    for k in (1, 2):
        lines = re.search(rf'  <link name="closing_tip_{k}"/>.*?</joint>\n', text, flags=re.DOTALL)[0]
        second = lines.replace(f"closing_tip_{k}", f"closing_tip_{k}_z").replace("0.25 0 0", "0.25 0 0.1")
        text = text.replace(lines, lines + second)
    (tmp_path / "robot.urdf").write_text(text)
    description = read_any(tmp_path / "robot.urdf", **FIVE_BARS["onshape"][1])
    assert [closure.name for closure in description.closures] == ["tip", "tip_z"]
    found = check_robot(ParallelRobot.from_description(description))
    assert (found.mobility, found.rank, found.loop_equations) == (2, 2, 6)


def test_mjcf_motors_carry_their_gear_rotor_and_limit():
    description = read_any(DATA / "five_bar_sites.xml", platform="left_tip", axes=["x", "y"])
    for actuator in description.actuators:
        assert actuator.gear_ratio == 50
        assert actuator.rotor_inertia == 0.0  # it is the joint's, whichever motors are chosen
        assert description.joints[actuator.joint].armature == pytest.approx(6.4e-6 * 50**2)
        assert actuator.torque_limit == 4


@pytest.mark.parametrize("name", FIVE_BARS)
def test_what_is_written_says_the_same_as_what_was_read(name, tmp_path):
    file, options = FIVE_BARS[name]
    description = read_any(file, **options)
    written = write_robot_file(description, tmp_path)
    again = read_robot_file(written)
    same = {"file": description.file, "urdf_text": description.urdf_text}
    assert replace(again, **same) == description
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        f"{written.stem}.urdf",
        f"{written.stem}.yaml",
    ]


@pytest.mark.parametrize("name", sorted(robots.CATALOGUE))
def test_every_robot_of_the_catalogue_can_be_written(name, tmp_path):
    description = read_any(robots.CATALOGUE[name].file)
    again = read_robot_file(write_robot_file(description, tmp_path))
    assert replace(again, file=description.file, urdf_text=description.urdf_text) == description


@pytest.mark.parametrize("kind", CLOSURE_KINDS)
def test_every_closure_kind_can_be_written(kind, tmp_path):
    description = read_any(*FIVE_BARS["own"][:1])
    length = 0.25 if kind == "distance" else None
    (tip,) = description.closures
    described = replace(description, closures=(replace(tip, axes=locked_axes(kind), length=length),))
    assert read_robot_file(write_robot_file(described, tmp_path)).closures == described.closures


def test_writing_over_the_file_that_is_read_is_refused(tmp_path):
    for suffix in ("yaml", "urdf"):
        text = (DATA / "gepetto" / f"robot.{suffix}").read_text()
        (tmp_path / f"five_bar.{suffix}").write_text(text)
    file = tmp_path / "five_bar.yaml"
    before = file.read_text()
    with pytest.raises(OutputError, match="overwrite"):
        write_robot_file(read_any(file, platform="tip_A", axes=["x"]), tmp_path)
    assert file.read_text() == before


def test_nothing_is_left_behind_where_writing_fails(tmp_path):
    description = read_any(*FIVE_BARS["own"][:1])
    broken = replace(description, platform=replace(description.platform, frame="nowhere"))
    with pytest.raises(RobotFileError, match=r"cannot become a robot file: platform\.frame"):
        write_robot_file(broken, tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_meshes_are_still_found_from_the_new_folder(tmp_path):
    text = (DATA / "five_bar_plus.urdf").read_text()
    mesh = '<link name="base"><visual><geometry><mesh filename="meshes/a.stl"/></geometry></visual></link>'
    (tmp_path / "a.urdf").write_text(text.replace('<link name="base"/>', mesh))
    written = write_robot_file(
        read_any(tmp_path / "a.urdf", **FIVE_BARS["urdf+"][1]), tmp_path / "deep" / "out"
    )
    assert 'filename="../../meshes/a.stl"' in written.with_suffix(".urdf").read_text()


# ------------------------------------------------------------------ what is unsaid


def test_all_that_is_missing_is_asked_for_at_once_with_candidates():
    with pytest.raises(RobotFileError) as caught:
        read_any(DATA / "five_bar_plus.urdf")
    message = str(caught.value)
    assert "--platform FRAME (of: base, left_crank" in message
    assert "--axes (of: x, y, z, rx, ry, rz)" in message
    assert "--motors (of: left_motor, right_motor)" in message  # those marked independent


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"platform": "tip_C"}, "--platform: unknown frame 'tip_C'; did you mean"),
        ({"axes": ["x", "w"]}, "--axes: unknown axis 'w'"),
        ({"axes": ["x", "x"]}, "--axes: needs at least one axis, and each once"),
        (
            {"motors": ["left_moter"]},
            "--motors: unknown movable joint 'left_moter'; did you mean 'left_motor'",
        ),
        ({"motors": ["tip_A_frame"]}, "--motors: unknown movable joint"),
        (
            {"motors": ["left_motor", "left_motor"]},
            "--motors: needs at least one movable joint, and each once",
        ),
        ({"motors": []}, "--motors: needs at least one"),
        ({"reference": {"elbow": 1.0}}, "--reference: unknown movable joint 'elbow'"),
    ],
)
@pytest.mark.parametrize("name", ["gepetto", "own"])
def test_options_are_checked(name, options, message):
    file, given = FIVE_BARS[name]
    if name == "own":
        message = message.split("; did you mean")[0]
    with pytest.raises(RobotFileError, match=message):
        read_any(file, **{**given, **options})


def test_options_overrule_the_file():
    description = read_any(FIVE_BARS["own"][0], platform="right_tip", motors=["right_motor"], axes=["y"])
    assert description.platform.frame == "right_tip"
    assert [actuator.gear_ratio for actuator in description.actuators] == [50]
    assert description.platform.axes == ("y",)


# ------------------------------------------------------------------ closures in space


def two_links(*closures: str, joint: str = "revolute", axis: str = "0 0 1") -> str:
    """Two links on one base, joined by what is given."""
    joints = "".join(
        f'<link name="{link}"/><joint name="{link}_joint" type="{joint}"><parent link="base"/>'
        f'<child link="{link}"/><origin xyz="{x} 0 0" rpy="0.1 0.2 {x}"/><axis xyz="{axis}"/>'
        f'<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        for link, x in (("one", 0.0), ("two", 0.5))
    )
    return f'<robot name="r"><link name="base"/>{joints}{"".join(closures)}</robot>'


SAID = {"platform": "one", "axes": ["x"], "motors": ["one_joint"]}


def closure_axes_in_base(robot: Mechanism) -> tuple[np.ndarray, np.ndarray]:
    """Rotations of the two frames of the first closure at zero."""
    one, two = placements(robot.model, robot.description.closures[0].frames)
    return one.rotation, two.rotation


@pytest.mark.parametrize(
    ("kind", "axes"),
    [
        ("revolute", ("x", "y", "z", "rx", "ry")),
        ("continuous", ("x", "y", "z", "rx", "ry")),
        ("prismatic", ("x", "y", "rx", "ry", "rz")),
        ("cylindrical", ("x", "y", "rx", "ry")),
        ("planar", ("z", "rx", "ry")),
    ],
)
@pytest.mark.parametrize("dialect", ["urdf+", "ros"])
def test_the_axis_of_a_loop_is_z_of_both_its_frames(dialect, kind, axes, tmp_path):
    axis = np.array([0.3, -0.4, 1.2])
    text = " ".join(map(str, axis))
    if dialect == "urdf+":
        loop = (
            f'<loop name="l" type="{kind}"><predecessor link="one"><origin xyz="1 2 3" rpy="1 0.5 0.2"/>'
            f'</predecessor><successor link="two"/><axis xyz="{text}"/></loop>'
        )
    else:
        loop = (
            f'<constraint name="l" type="{kind}"><parent link="one"/><parent_origin xyz="1 2 3" '
            f'rpy="1 0.5 0.2"/><parent_axis xyz="{text}"/><child link="two"/></constraint>'
        )
    file = tmp_path / "r.urdf"
    file.write_text(two_links(loop))
    description = read_any(file, **SAID)
    assert description.closures[0].axes == axes
    robot = Mechanism.from_description(description)
    first, second = closure_axes_in_base(robot)
    one = pin.rpy.rpyToMatrix(0.1, 0.2, 0.0) @ pin.rpy.rpyToMatrix(1.0, 0.5, 0.2)
    two = pin.rpy.rpyToMatrix(0.1, 0.2, 0.5)
    unit = axis / np.linalg.norm(axis)
    np.testing.assert_allclose(first[:, 2], one @ unit, atol=1e-14)
    np.testing.assert_allclose(second[:, 2], two @ unit, atol=1e-14)


def test_a_universal_constraint_keeps_its_two_axes_at_right_angles(tmp_path):
    file = tmp_path / "r.urdf"
    file.write_text(
        two_links(
            '<constraint name="u" type="universal"><parent link="one"/><parent_axis xyz="1 1 0"/>'
            '<child link="two"/><child_axis xyz="0 1 3"/></constraint>'
        )
    )
    robot = Mechanism.from_description(read_any(file, **SAID))
    assert robot.rows.names == ("u.x", "u.y", "u.z", "u.rz")
    first, second = closure_axes_in_base(robot)
    row = list(robot.rows.rotation).index(True)
    one = pin.rpy.rpyToMatrix(0.1, 0.2, 0.0) @ np.array([1, 1, 0]) / np.sqrt(2)
    two = pin.rpy.rpyToMatrix(0.1, 0.2, 0.5) @ np.array([0, 1, 3]) / np.sqrt(10)
    np.testing.assert_allclose(first[:, robot.rows.first_axis[row]], one, atol=1e-14)
    np.testing.assert_allclose(second[:, robot.rows.second_axis[row]], two, atol=1e-14)


# ------------------------------------------------------------------ joints that stand for others


def test_gepetto_joint_types_become_joints_of_one_degree(tmp_path):
    (tmp_path / "robot.urdf").write_text(two_links())
    (tmp_path / "robot.yaml").write_text(
        "closed_loop: [[one, two]]\ntype: [6D]\nname_mot: [two_joint_Z]\n"
        "joint_name: [one_joint, two_joint]\njoint_type: [SPHERICAL, UJOINT_ZY]\n"
    )
    description = read_any(tmp_path, platform="one", axes=["x"])
    robot = Mechanism.from_description(description)
    assert list(robot.model.names)[1:] == ["one_joint", "two_joint_Z", "two_joint_Y"]
    assert robot.coordinates.names == (
        "one_joint_rx", "one_joint_ry", "one_joint_rz", "two_joint_Z", "two_joint_Y",
    )  # fmt: skip
    assert description.closures[0].axes == ("x", "y", "z", "rx", "ry", "rz")
    (tmp_path / "robot.yaml").write_text(
        "closed_loop: [[one, two]]\ntype: [3D]\nname_mot: [one_joint]\n"
        "joint_name: [two_joint]\njoint_type: [FIXED]\n"
    )
    robot = Mechanism.from_description(read_any(tmp_path, platform="one", axes=["x"]))
    assert list(robot.model.names)[1:] == ["one_joint"]


def test_a_fixed_joint_that_gepetto_fixes_stays_where_it_is(tmp_path):
    """Its child stands at 0.1 m, whatever the pair says of the joint."""
    tip = (
        '<link name="tip"/><joint name="tip_joint" type="fixed"><parent link="two"/><child link="tip"/>'
        '<origin xyz="0.1 0 0" rpy="0 0 0.3"/></joint>'
    )
    (tmp_path / "robot.urdf").write_text(two_links(tip))
    loop = "closed_loop: [[one, tip]]\ntype: [3D]\nname_mot: [one_joint]\n"
    (tmp_path / "robot.yaml").write_text(f"{loop}joint_name: [tip_joint]\njoint_type: [FIXED]\n")
    robot = Mechanism.from_description(read_any(tmp_path, platform="one", axes=["x"]))
    assert list(robot.model.names)[1:] == ["one_joint", "two_joint"]
    in_two = robot.model.frames[robot.model.getFrameId("tip")].placement
    np.testing.assert_allclose(in_two.translation, [0.1, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(in_two.rotation[:2, 0], [np.cos(0.3), np.sin(0.3)], atol=1e-15)


LOOP = '<loop name="l" type="spherical"><predecessor link="one"/><successor link="two"/></loop>'


def coupling(first: str, second: str, ratio: str) -> str:
    return (
        f'<coupling name="c"><predecessor link="{first}"/><successor link="{second}"/>'
        f'<ratio value="{ratio}"/></coupling>'
    )


def test_a_coupling_of_equal_turns_becomes_a_loop_equation(tmp_path):
    file = tmp_path / "r.urdf"
    parallel = two_links(LOOP, coupling("one", "two", "1")).replace('rpy="0.1 0.2 0.5"', 'rpy="0.1 0.2 0.9"')
    # turning the second about its own z keeps the axes parallel only without roll and pitch
    file.write_text(parallel.replace("0.1 0.2 0.9", "0 0 0.9").replace("0.1 0.2 0.0", "0 0 0.3"))
    description = read_any(file, **SAID)
    assert description.closures[1].axes == ("rz",)
    robot = Mechanism.from_description(description)
    row = robot.rows.names.index("c.rz")
    for q, error in (([0.4, 0.4], 0.0), ([0.4, 0.3], np.sin(0.1))):
        residual = loop_equations(robot.rows, frames_at(robot, np.array([q]))).residual[0, row]
        assert abs(residual) == pytest.approx(error, abs=1e-15)


def test_a_coupling_of_two_joints_is_a_gear(tmp_path):
    file = tmp_path / "r.urdf"
    file.write_text(two_links(LOOP, coupling("one", "two", "-2")))
    assert read_any(file, **SAID).couplings == (Coupling("two_joint", "one_joint", -2.0),)


def test_a_coupling_of_a_chain_turns_by_the_sum_of_its_joints(tmp_path):
    """The format's own library sums coordinates: ratio times those before, minus those behind."""
    chain = coupling("one", "three", "4")
    third = (
        '<link name="three"/><joint name="three_joint" type="revolute"><parent link="two"/>'
        '<child link="three"/><axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/>'
        "</joint>"
    )
    file = tmp_path / "r.urdf"
    file.write_text(two_links(LOOP, chain + third))
    (found,) = read_any(file, **SAID).couplings
    signs = {product: value / found.equation["one_joint",] for product, value in found.equation.items()}
    assert signs == {("one_joint",): 1.0, ("two_joint",): -0.25, ("three_joint",): -0.25, (): 0.0}


def test_a_coupling_that_holds_a_joint_fixes_it(tmp_path):
    file = tmp_path / "r.urdf"
    for text in (coupling("one", "two", "0"), coupling("base", "two", "3")):
        file.write_text(two_links(LOOP, text))
        robot = Mechanism.from_description(read_any(file, **SAID))
        assert list(robot.model.names)[1:] == ["one_joint"]


# ------------------------------------------------------------------ MJCF


def mjcf(bodies: str, equality: str = "", *, compiler: str = 'angle="radian"', more: str = "") -> str:
    loop = equality or '<connect body1="one" anchor="0 0 0"/>'
    return (
        f"<mujoco><compiler {compiler}/>{more}<worldbody>{bodies}</worldbody>"
        f"<equality>{loop}</equality></mujoco>"
    )


def read_mjcf_text(text: str, tmp_path: Path, **said: object) -> Mechanism:
    file = tmp_path / "m.xml"
    file.write_text(text)
    options = {"platform": "one", "axes": ["x"], "motors": ["j"]}
    return Mechanism.from_description(read_any(file, **{**options, **said}))


DRIVEN = '<body name="other"><joint name="j"/></body>'


def test_mjcf_joints_of_one_body_follow_each_other_about_their_points(tmp_path):
    bodies = (
        '<body name="one" pos="0 0 1"><joint name="j" pos="0.1 0 0" axis="0 0 2"/>'
        '<joint name="slide" type="slide" axis="0 1 0" pos="5 5 5"/>'
        '<joint name="k" pos="0 0.2 0" axis="1 0 0"/></body>'
    )
    robot = read_mjcf_text(mjcf(bodies), tmp_path)
    assert list(robot.model.names)[1:] == ["j", "slide", "k"]
    a, d, b = 0.7, 0.3, -0.5

    def about(point, turn):
        at = np.eye(4)
        at[:3, 3], at[:3, :3] = point - turn @ point, turn
        return at

    def shift(v):
        at = np.eye(4)
        at[:3, 3] = v
        return at

    z = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    x = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    expected = (
        shift([0, 0, 1])
        @ about(np.array([0.1, 0, 0]), z)
        @ shift([0, d, 0])
        @ about(np.array([0, 0.2, 0]), x)
    )
    (at,) = placements(robot.model, ("one",), np.array([a, d, b]))
    np.testing.assert_allclose(at.homogeneous, expected, atol=1e-15)


def test_mjcf_ball_joint_and_keyframe_pose(tmp_path):
    quaternion = pin.Quaternion(0.7, 0.1, -0.5, 0.4).normalized()
    text = mjcf(f'<body name="one"><joint name="b" type="ball"/></body>{DRIVEN}').replace(
        "</mujoco>",
        f'<keyframe><key qpos="{quaternion.w!r} {quaternion.x!r} {quaternion.y!r} {quaternion.z!r} 0"/>'
        "</keyframe></mujoco>",
    )
    robot = read_mjcf_text(text, tmp_path)
    (at,) = placements(robot.model, ("one",), robot.q_near)
    np.testing.assert_allclose(at.rotation, quaternion.toRotationMatrix(), atol=1e-15)


@pytest.mark.parametrize("joint", ['<freejoint name="f"/>', '<joint name="f" type="free"/>'])
def test_mjcf_free_bodies_are_where_the_keyframe_has_them(tmp_path, joint):
    """qpos of a free body is its pose in the world, whatever its own pos and quat are."""
    start, there = (pin.Quaternion(*q).normalized() for q in ((0.9, 0.2, 0.1, -0.3), (0.7, 0.1, -0.5, 0.4)))
    at, quat = (0.3, -0.2, 0.5), " ".join(map(repr, (start.w, *start.coeffs()[:3].tolist())))
    body = f'<body name="one" pos="1 2 3" quat="{quat}">{joint}<geom size="0.1"/></body>'
    qpos = " ".join(map(repr, (*at, there.w, *there.coeffs()[:3].tolist())))
    key = f'<keyframe><key qpos="{qpos} 0"/></keyframe></mujoco>'
    robot = read_mjcf_text(mjcf(body + DRIVEN).replace("</mujoco>", key), tmp_path)
    assert robot.coordinates.names == ("f_x", "f_y", "f_z", "f_rx", "f_ry", "f_rz", "j")
    for q, place, turn in ((robot.q_near, at, there), (robot.neutral, (1, 2, 3), start)):
        (found,) = placements(robot.model, ("one",), q)
        np.testing.assert_allclose(found.translation, place, atol=1e-15)
        np.testing.assert_allclose(found.rotation, turn.toRotationMatrix(), atol=1e-15)


def test_mjcf_ankle_with_rods_on_balls_is_that_of_the_catalogue(tmp_path):
    """The ankle of the Booster T1 as its users' MJCF has it: rods drawn from end to end, balls, sites.

    Its cranks are at their own zeros: there the rods go from tip to ball of the level foot.
    """
    robot, ours = ankle(tmp_path), robots.load("humanoid_ankle")
    assert {*check_robot(robot).idle_joints} == {"left_ankle_rod_a_ball_rz", "left_ankle_rod_b_ball_rz"}
    assert {limit.joint: (limit.lower, limit.upper) for limit in robot.limits} == {
        "left_ankle_pitch_joint": (-0.87, 0.35),
        "left_ankle_roll_joint": (-0.44, 0.44),
        "left_ankle_drive_a_joint": (-0.8187464729740654, 1.0227913151109491),
        "left_ankle_drive_b_joint": (-0.6454320082084025, 1.097331001571644),
    }
    zeros = np.arctan2(
        [-0.002346359528693609, 0.0058995075739472075], [0.04293593596233938, 0.04259337754140823]
    )
    for x in ([0.0, 0.0], [-0.6, 0.3], [0.3, -0.2]):
        one, two = assemble(robot, x).q, assemble(ours, x).q
        motors = (which.actuated_coordinates(q[None])[0] for which, q in ((robot, one), (ours, two)))
        np.testing.assert_allclose(np.subtract(*motors), -zeros, atol=1e-12)
        one, two = dynamics_at(robot, one), dynamics_at(ours, two)
        np.testing.assert_allclose(one.joint_torque, two.joint_torque, rtol=0.02)  # their rods' ends differ


def test_mjcf_ranges_are_limits_from_the_zero_of_ref(tmp_path):
    joints = (
        '<joint name="j" range="-10 90" ref="30"/><joint name="s" type="slide" range="-2 1"/>'
        '<joint name="off" range="-1 1" limited="false"/>'
    )
    robot = read_mjcf_text(mjcf(f'<body name="one">{joints}</body>', compiler='angle="degree"'), tmp_path)
    found = {limit.joint: (limit.lower, limit.upper, limit.unit) for limit in robot.limits}
    assert found.keys() == {"j", "s"}
    assert found["j"] == (pytest.approx(np.radians(-40)), pytest.approx(np.radians(60)), "rad")
    assert found["s"] == (-2, 1, "m")


def test_mjcf_ref_moves_the_zero_and_springs_rest_from_it(tmp_path):
    text = mjcf(
        '<body name="one"><joint name="j" ref="30" stiffness="7" springref="40"/></body>',
        compiler='angle="degree"',
    ).replace("</mujoco>", '<keyframe><key qpos="1"/></keyframe></mujoco>')
    robot = read_mjcf_text(text, tmp_path)
    assert robot.joint_stiffness == 7
    assert robot.joint_rest[0] == pytest.approx(np.radians(10))
    assert robot.q_near[0] == pytest.approx(1 - np.radians(30))


def test_mjcf_weld_holds_the_zero_pose_or_the_given_one(tmp_path):
    bodies = (
        '<body name="one" pos="1 0 0" euler="0 0 0.4"><joint name="j"/></body>'
        '<body name="two" pos="0 1 0" euler="0.3 0 0"><joint name="k"/></body>'
    )
    robot = read_mjcf_text(mjcf(bodies, '<weld name="w" body1="one" body2="two" anchor="0 0 1"/>'), tmp_path)
    residual = loop_equations(robot.rows, frames_at(robot, np.zeros((1, 2)))).residual
    np.testing.assert_allclose(residual, np.zeros((1, 6)), atol=1e-15)
    other = read_mjcf_text(
        mjcf(bodies, '<weld body1="one" body2="two" relpose="0.5 0 0 1 0 0 0"/>'), tmp_path
    )
    one, two = placements(other.model, ("one", "two"), np.zeros(2))
    gap = two.translation - one.act(np.array([0.5, 0, 0]))
    residual = loop_equations(other.rows, frames_at(other, np.zeros((1, 2)))).residual[0, :3]
    np.testing.assert_allclose(residual, one.rotation.T @ gap, atol=1e-15)
    glue = '<weld body1="one" body2="two" torquescale="0"/>'
    assert read_mjcf_text(mjcf(bodies, glue), tmp_path).description.closures[0].axes == ("x", "y", "z")


def test_mjcf_joint_equalities_that_are_loops(tmp_path):
    bodies = (
        '<body name="one"><joint name="j"/></body><body name="two"><joint name="k"/></body>'
        '<body name="three"><joint name="l" type="slide"/></body>'
    )
    loop = '<connect body1="one" anchor="0 0 0"/><joint joint1="l" polycoef="0.2 0 0 0 0"/>'
    robot = read_mjcf_text(mjcf(bodies, loop + '<joint name="e" joint1="j" joint2="k"/>'), tmp_path)
    assert list(robot.model.names)[1:] == ["j", "k"]
    assert robot.rows.names[-1] == "e.rz"
    (three,) = placements(robot.model, ("three",), np.zeros(2))
    np.testing.assert_allclose(three.translation, [0, 0, 0.2])


def test_mjcf_inactive_equalities_are_left_out(tmp_path):
    loops = '<connect body1="one" anchor="0 0 0"/><connect body1="one" anchor="1 0 0" active="false"/>'
    robot = read_mjcf_text(mjcf('<body name="one"><joint name="j"/></body>', loops), tmp_path)
    assert len(robot.description.closures) == 1


def test_an_edited_robot_file_is_not_overwritten_unless_asked_for(tmp_path):
    """Neither is a file of the same name by somebody else."""
    file, options = FIVE_BARS["urdf+"]
    description = read_any(file, **options)
    written = write_robot_file(description, tmp_path / "out")
    write_robot_file(description, tmp_path / "out", comments=["Again."])  # as it was generated
    generated = {path: path.read_text() for path in (written, written.with_suffix(".urdf"))}
    for path, text in generated.items():
        path.write_text(text + "\n")
        with pytest.raises(OutputError, match=r"is edited, or not of this program; .* --overwrite"):
            write_robot_file(description, tmp_path / "out")
        assert path.read_text() == text + "\n"
        path.write_text(text)
    write_robot_file(description, tmp_path / "out")
    written.unlink()
    with pytest.raises(OutputError, match=rf"{description.name}\.urdf is edited"):
        write_robot_file(description, tmp_path / "out")
    write_robot_file(description, tmp_path / "out", overwrite=True)
