"""URDFs as they are found: mimics, joints of Gazebo, macros, other programs' elements, impossible bodies."""

import re
from itertools import combinations
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from framework import Mechanism, ParallelRobot, RobotFileError, assemble, dynamics_at
from framework.kinematics.assembly import loops_at
from framework.kinematics.diagnostics.proposal import propose
from framework.model.description import locked_axes
from framework.model.readers import parse_any, read_any
from framework.model.robot_file_writer import write_robot_file
from tests.model.readers.foreign_files import short_move
from tests.model.readers.test_sdf import five_bar_urdf
from tests.oracles.placements import placements

DATA = Path(__file__).parents[2] / "data" / "dialects"
TIP = ("left_rod", "right_rod")
POSE = {"left_motor": 1.271863, "left_elbow": -0.83362, "right_motor": 1.083625, "right_elbow": 1.538591}


def link(name: str, more: str = "") -> str:
    return (
        f'<link name="{name}"><inertial><origin xyz="0.1 0 0"/><mass value="1"/><inertia ixx="0.01" '
        f'iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>{more}</link>'
    )


def joint(name: str, parent: str, child: str, more: str = "") -> str:
    return (
        f'<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.2 0 0"/><axis xyz="0 0 1"/>{more}</joint>'
    )


def fingers(more: str = "", head: str = "") -> str:
    """Three fingers, each of which follows the one before."""
    return (
        f'<robot name="fingers"{head}><link name="palm"/>{link("a")}{link("b")}{link("c")}'
        + joint("ja", "palm", "a")
        + joint("jb", "palm", "b", '<mimic joint="ja" multiplier="-2" offset="0.1"/>')
        + joint("jc", "palm", "c", '<mimic joint="jb" multiplier="0.5"/>')
        + f"{more}</robot>"
    )


def read(folder: Path, text: str, name: str = "robot.urdf", **said):
    (folder / name).write_text(text)
    return parse_any(folder / name, propose=propose, **said)


def test_chains_of_mimics_are_couplings_that_plan(tmp_path):
    parsed = read(tmp_path, fingers(), motors=["ja"])
    found = {c.joint: (c.of, c.ratio, c.offset) for c in parsed.description.couplings}
    assert found == {"jb": ("ja", -2, 0.1), "jc": ("jb", 0.5, 0)}
    plan = short_move(ParallelRobot.from_description(parsed.description))
    assert plan.certificate.max_residual_torque < 1e-9 * max(plan.peak_torque.values())


def test_a_held_joint_holds_what_mimics_it(tmp_path):
    more = link("d") + joint("jd", "palm", "d", '<mimic joint="ja"/>')
    with pytest.raises(RobotFileError, match="--lock: no loop moves any more"):
        read(tmp_path, fingers(more), locked={"jc": 0.0})


BALL = (
    '<drake:ball_constraint xmlns:drake="d"><drake:ball_constraint_body_A name="left_rod"/>'
    '<drake:ball_constraint_p_AP value="0.25 0 0"/><drake:ball_constraint_body_B name="right_rod"/>'
    '<drake:ball_constraint_p_BQ value="0.25 0 0"/></drake:ball_constraint>'
)


def without_loop() -> str:
    text = five_bar_urdf()
    return text[: text.index("<constraint")] + "</robot>"


def test_ball_constraints_of_drake_are_balls(tmp_path):
    for text in (BALL, BALL.replace(' xmlns:drake="d"', "")):
        (closure,) = read(
            tmp_path, without_loop().replace("</robot>", f"{text}</robot>")
        ).description.closures
        assert closure.axes == locked_axes("spherical")


@pytest.mark.parametrize("part", ["body_A", "p_AP", "body_B", "p_BQ"])
def test_a_ball_constraint_without_a_body_or_a_point_is_refused_by_its_name(part, tmp_path):
    text = re.sub(rf"<drake:ball_constraint_{part}[^>]*/>", "", BALL)
    with pytest.raises(RobotFileError, match=f"<ball_constraint>: {part} is missing"):
        read(tmp_path, without_loop().replace("</robot>", f"{text}</robot>"))


@pytest.mark.parametrize("scope", ["loop", "whole element"])
def test_loops_in_a_namespace_are_read_as_those_without(scope, tmp_path):
    text = five_bar_urdf()
    start, end = text.index("<constraint"), text.index("</robot>")
    prefixed = re.sub(
        r"<(/?)(?=\w)" if scope == "whole element" else r"<(/?)(?=constraint)", r"<\1s:", text[start:end]
    )
    plain = read(tmp_path, text).description
    spaced = read(
        tmp_path, text[:start] + prefixed.replace("<s:constraint", '<s:constraint xmlns:s="s"') + text[end:]
    )
    assert (spaced.dialect, spaced.description.closures) == ("ros", plain.closures)


def test_a_coupling_in_a_namespace_is_read(tmp_path):
    couplings = []
    for tag in ("coupling", "s:coupling"):
        ends = '<predecessor link="a"/><successor link="d"/><ratio value="3"/>'
        more = link("d") + joint("jd", "palm", "d") + f'<{tag} xmlns:s="s" name="g">{ends}</{tag}>'
        couplings.append(read(tmp_path, fingers(more), motors=["ja"]).description.couplings)
    assert couplings[0] == couplings[1]
    assert ("jd", "ja", 3) in [(one.joint, one.of, one.ratio) for one in couplings[1]]


def test_joints_of_gazebo_close_loops_where_the_links_are_at_zero(tmp_path):
    text = (
        fingers()
        .replace('<mimic joint="jb" multiplier="0.5"/>', "")
        .replace("-2", "1")
        .replace('0.1"/>', '0"/>')
    )
    gazebo = (
        '<gazebo><joint name="pin" type="revolute"><parent>a</parent><child>c</child>'
        "<pose>0.3 0 0 0 0 0</pose>"
        "<axis><xyz>0 0 1</xyz></axis></joint></gazebo>"
    )
    description = read(tmp_path, text.replace("</robot>", f"{gazebo}</robot>")).description
    (closure,) = description.closures
    assert (closure.name, closure.axes) == ("pin", locked_axes("revolute"))


def test_loop_closures_beside_a_urdf_are_hinges(tmp_path):
    text = without_loop().replace('name="world"', 'name="base_link"').replace('"world"', '"base_link"')
    listed = (
        "closures:\n- {link_a: left_rod, link_b: right_rod, point: [0.3, 0, 0], axis: [0, 0, 2]}\n"
        "dependent: [left_elbow, right_elbow]\nindependent: [left_motor, right_motor]\n"
    )
    (tmp_path / "loop_closures.yaml").write_text(listed)
    one = read(tmp_path, text).description
    two = parse_any(tmp_path / "loop_closures.yaml", propose=propose).description
    for description in (one, two):
        (closure,) = description.closures
        assert closure.axes == locked_axes("revolute")
        assert [actuator.joint for actuator in description.actuators] == ["left_motor", "right_motor"]


def test_motors_in_a_list_of_closures_are_a_list(tmp_path):
    (tmp_path / "loop_closures.yaml").write_text("independent: 3\n")
    with pytest.raises(RobotFileError, match=r"loop_closures\.yaml: independent: needs a list, got 3"):
        read(tmp_path, without_loop())


XACRO = ' xmlns:xacro="http://www.ros.org/wiki/xacro"'


def test_ends_of_a_loop_joint_are_in_the_order_of_the_document(tmp_path):
    """And attributes of other programs are no matter, but mistyped ones are."""
    text = (DATA / "five_bar_loop_joint.urdf").read_text()
    said = {"platform": "tip", "axes": ["x", "y"], "reference": POSE}
    first, second = (f'<link1 link="{name}" xyz="0.25 0 0" rpy="0 0 0"/>' for name in TIP)
    turned = text.replace(first, first.replace("link1", "link2")).replace(second, f"{second} ")
    assert (
        read(tmp_path, turned, **said).description.closures
        == read(tmp_path, text, **said).description.closures
    )
    foreign = text.replace('name="loop"', 'name="loop" stiffness="1e5"').replace(
        first, f'{first[:-2]} id="3"/>'
    )
    assert (
        read(tmp_path, foreign, **said).description.closures
        == read(tmp_path, text, **said).description.closures
    )
    with pytest.raises(RobotFileError, match="unknown attribute 'xyx'; did you mean 'xyz'"):
        read(tmp_path, text.replace(first, first.replace("xyz", "xyx")), **said)


def test_the_axis_of_a_loop_joint_may_be_that_of_the_parent(tmp_path):
    """Two hinges about z of the base, with the second link turned by a right angle about x."""
    text = """<robot name="pair"><link name="base"/><link name="a"/><link name="b"/>
      <joint name="ja" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/></joint>
      <joint name="jb" type="continuous"><parent link="base"/><child link="b"/>
        <origin xyz="0.3 0 0" rpy="1.5707963267948966 0 0"/><axis xyz="0 1 0"/></joint>
      <loop_joint name="loop" type="revolute"><parent link="a"/><child link="b"/>
        <parent_origin xyz="0.2 0.1 0"/><child_origin xyz="-0.1 0 -0.1"/><axis xyz="0 0 1" frame="parent"/>
      </loop_joint></robot>"""
    (tmp_path / "pair.urdf").write_text(text)
    said = {"platform_joints": ["jb"], "motors": ["ja"]}
    mechanism = Mechanism.from_description(read_any(tmp_path / "pair.urdf", **said))
    (closure,) = mechanism.description.closures
    first, second = placements(mechanism.model, closure.frames, np.zeros(2))
    for end in (first, second):
        np.testing.assert_allclose(end.translation, [0.2, 0.1, 0.0], atol=1e-15)
        np.testing.assert_allclose(end.rotation[:, 2], [0.0, 0.0, 1.0], atol=1e-15)


def test_leftovers_of_xacro_are_no_matter(tmp_path):
    more = '<xacro:property name="a" value="1"/><xacro:arg name="b" default="2"/><xacro:macro name="m"/>'
    text = fingers(more, XACRO).replace('name="ja" type', 'xacro:note="x" name="ja" type')
    assert len(read(tmp_path, text).description.couplings) == 2
    assert len(read(tmp_path, text.replace(XACRO, "")).description.couplings) == 2


@pytest.mark.parametrize("more", ['<xacro:finger side="left"/>', '<link name="${side}_finger"/>'])
def test_macros_are_named_with_the_command_that_expands_them(tmp_path, more):
    text = fingers(f'<xacro:arg name="constraints" default="false"/>{more}', XACRO)
    with pytest.raises(RobotFileError, match=r"xacro FILE constraints:=false > OUT"):
        read(tmp_path, text)


def test_elements_of_other_programs_are_named_and_no_matter(tmp_path):
    parsed = read(tmp_path, fingers("<mujoco><compiler/></mujoco><drake:proximity/>"))
    assert "not used: 1 <mujoco>, 1 <proximity>" in parsed.remarks
    unused = '<sensor name="s"/><gazebo><plugin/></gazebo>'
    text = fingers(unused).replace("</joint>", "<calibration/></joint>")
    assert "not used: 3 <calibration>, 1 <sensor>, 1 <gazebo>" in read(tmp_path, text).remarks
    with pytest.raises(RobotFileError, match="unknown element 'lnik'; did you mean 'link'"):
        read(tmp_path, fingers('<lnik name="a"/>'))


@pytest.mark.parametrize("broken", ['ixx="-1"', 'ixx=""'])
def test_an_impossible_body_stops_what_moves_and_is_a_remark_where_it_does_not(tmp_path, broken):
    bad = link("tool").replace('ixx="0.01"', broken)
    fixed = '<joint name="m" type="fixed"><parent link="palm"/><child link="tool"/></joint>'
    parsed = read(tmp_path, fingers(bad + fixed))
    assert any("does not move: link 'tool': " in remark for remark in parsed.remarks)
    with pytest.raises(RobotFileError, match="link 'tool': "):
        read(tmp_path, fingers(bad + fixed.replace('"palm"', '"a"')))


def test_an_impossible_limit_stops_what_moves(tmp_path):
    limit = '<limit lower="1" upper="0" effort="1" velocity="1"/>'
    more = link("d") + joint("jd", "a", "d", limit).replace("continuous", "revolute")
    assert any(
        "joint 'jd'" in remark for remark in read(tmp_path, fingers(more)).remarks
    )  # in no loop, so held
    with pytest.raises(RobotFileError, match="joint 'jd': <limit>"):
        read(tmp_path, fingers(more), motors=["ja", "jd"])


@pytest.mark.parametrize("size", ["inf", "Infinity", "1.79769e+308", "1e9"])
def test_limits_that_no_motion_reaches_are_none(tmp_path, size):
    def read_ranges(lower: str, upper: str):
        limit = f'<limit lower="{lower}" upper="{upper}" effort="{size}" velocity="{size}"/>'
        text = fingers().replace(joint("ja", "palm", "a"), joint("ja", "palm", "a", limit))
        parsed = read(tmp_path, text.replace('"continuous"', '"revolute"', 1), motors=["ja"])
        return ParallelRobot.from_description(parsed.description).joint_ranges[:, 0].tolist()

    assert read_ranges(f"-{size}", size) == [-np.inf, np.inf]
    assert read_ranges("-0.5", size) == [-0.5, 1e9]


def test_a_hinge_with_limits_of_many_turns_is_closed_within_half_a_turn(tmp_path):
    wide = '<limit lower="-180" upper="180" effort="1" velocity="1"/></joint>'
    text = five_bar_urdf().replace("</joint>", wide).replace("continuous", "revolute")
    robot = ParallelRobot.from_description(read(tmp_path, text).description)
    assert len(robot.limits) == 4
    assert 1.0 < np.abs(robot.reference.q).max() < np.pi


def test_a_joint_named_as_pinocchio_names_the_world_is_refused(tmp_path):
    with pytest.raises(RobotFileError, match=r"joint 'universe': .*rename the joint"):
        read(tmp_path, fingers().replace('"jb"', '"universe"'))
    fixed = '<link name="universe"/><joint name="universe" type="fixed"><parent link="a"/>'
    parsed = read(tmp_path, fingers(fixed + '<child link="universe"/></joint>'), motors=["ja"])
    assert ParallelRobot.from_description(parsed.description).n == 1


def with_motors(text: str, *names: str) -> str:
    motors = "".join(f'<joint name="{name}"/>' for name in names)
    return text.replace("</robot>", f"<transmission>{motors}</transmission></robot>")


def test_of_motors_on_all_joints_those_are_taken_that_tell_the_freedoms_apart_best(tmp_path):
    parsed = read(tmp_path, with_motors(five_bar_urdf(), *POSE), reference=POSE)
    (remark,) = (remark for remark in parsed.remarks if remark.startswith("motors"))
    assert "of 4 in the file, for 2 freedoms" in remark
    chosen = tuple(actuator.joint for actuator in parsed.description.actuators)
    said = {"platform": "tip_parent", "axes": ["x", "y"], "reference": POSE}
    gains = {}  # of the motors' rates at the fastest motion of all joints of length 1
    for pair in combinations(POSE, 2):
        robot = ParallelRobot.from_description(read_any(tmp_path / "robot.urdf", motors=pair, **said))
        loops = loops_at(robot, robot.reference.q).jacobian
        motions = np.linalg.svd(loops)[2][np.linalg.matrix_rank(loops, tol=1e-9) :].T
        gains[pair] = np.linalg.svd(motions[robot.actuated], compute_uv=False)[-1]
    assert max(gains, key=gains.get) == chosen


def test_motors_that_are_alike_are_left_to_a_person():
    with pytest.raises(RobotFileError, match="none are better than others: give --motors j"):
        parse_any(DATA / "two_cranks.xml", propose=propose)


def test_a_free_base_is_held_with_one_line(tmp_path):
    root = '<joint name="root" type="floating"><parent link="ground"/><child link="palm"/></joint>'
    text = fingers('<link name="ground"/>' + root)
    parsed = read(tmp_path, text)
    assert "held: root (a free base, which no motor drives)" in parsed.remarks


def test_serial_joints_beside_the_mechanism_are_held_with_a_platform_too(tmp_path):
    more = link("d") + joint("jd", "palm", "d")
    for said in ({}, {"motors": ["ja"]}):
        parsed = read(tmp_path, fingers(more), platform_joints=["jb"], **said)
        assert any(remark.startswith("held: jd") for remark in parsed.remarks)
        assert ParallelRobot.from_description(parsed.description).n == 1


def test_usd_is_named_with_a_way_out(tmp_path):
    (tmp_path / "a.usda").write_text("#usda 1.0\n")
    with pytest.raises(RobotFileError, match="USD is not read; write it as URDF or MJCF"):
        read_any(tmp_path / "a.usda")


def transmission(kind: str, *parts: str) -> str:
    return f'<transmission name="t">{kind}{"".join(parts)}</transmission>'


def part(tag: str, name: str, reduction: str = "") -> str:
    return f'<{tag} name="{name}">{reduction}</{tag}>'


SIMPLE = "<type>transmission_interface/SimpleTransmission</type>"


@pytest.mark.parametrize(
    ("more", "gear"),
    [
        (
            transmission(
                SIMPLE,
                part("joint", "ja"),
                part("actuator", "m", "<mechanicalReduction>7.5</mechanicalReduction>"),
            ),
            7.5,
        ),
        (
            '<ros2_control name="h" type="system"><joint name="ja"><command_interface name="effort"/></joint>'
            + transmission(
                "<plugin>transmission_interface/SimpleTransmission</plugin>",
                part("joint", "ja", "<mechanical_reduction>4</mechanical_reduction>"),
                part("actuator", "m", "<mechanical_reduction>-2.5</mechanical_reduction>"),
            )
            + "</ros2_control>",
            10.0,
        ),
        (transmission(SIMPLE, part("joint", "ja"), "<mechanicalReduction>3</mechanicalReduction>"), 3.0),
    ],
    ids=["ros", "ros2_control", "older"],
)
def test_the_reduction_of_a_transmission_is_the_gear_ratio(tmp_path, more, gear):
    (motor,) = read(tmp_path, fingers(more)).description.actuators
    assert (motor.joint, motor.gear_ratio) == ("ja", gear)


def test_a_motor_on_a_joint_that_follows_another_stays_there(tmp_path):
    """Joint jb turns by -2 ja, so that half the torque at jb does the same work."""
    more = transmission(
        SIMPLE, part("joint", "jb"), part("actuator", "m", "<mechanicalReduction>3</mechanicalReduction>")
    )
    description = read(tmp_path, fingers(more)).description
    assert [(motor.joint, motor.gear_ratio) for motor in description.actuators] == [("jb", 3.0)]
    follower = ParallelRobot.from_description(description)
    leader = ParallelRobot.from_description(read(tmp_path, fingers(), motors=["ja"]).description)
    plans = short_move(follower), short_move(leader)
    assert [robot.actuator_names for robot in (follower, leader)] == [("jb",), ("ja",)]
    assert all(plan.certificate.max_residual_torque < 1e-9 for plan in plans)


@pytest.mark.parametrize("actuators", [("m1", "m2"), ("pitch", "roll")], ids=["own", "of joints"])
@pytest.mark.parametrize(
    ("kind", "turns"),
    [
        ("DifferentialTransmission", [[40 * 2, 40 * 3], [-50 * 2, 50 * 3]]),
        ("FourBarLinkageTransmission", [[40 * 2, 0], [-50, -50 * 3]]),
    ],
)
def test_the_motors_of_two_joints_do_the_work_of_the_joints(tmp_path, kind, turns, actuators):
    """Motors turn by 40 (2 p + 3 r), -50 (2 p - 3 r), or 40 * 2 p, -50 (p + 3 r); RNEA of the tree alone."""
    more = transmission(
        f"<plugin>transmission_interface/{kind}</plugin>",
        part("joint", "roll", "<mechanical_reduction>3</mechanical_reduction>").replace(
            ">", ' role="joint2">', 1
        ),
        part("joint", "pitch", "<mechanical_reduction>2</mechanical_reduction>").replace(
            ">", ' role="joint1">', 1
        ),
        part("actuator", actuators[0], "<mechanical_reduction>40</mechanical_reduction>"),
        part("actuator", actuators[1], "<mechanical_reduction>-50</mechanical_reduction>"),
    )
    tree = (
        f'<robot name="wrist"><link name="base"/>{link("a")}{link("b")}'
        + joint("pitch", "base", "a").replace("0 0 1", "0 1 0")
        + joint("roll", "a", "b").replace("0 0 1", "1 0 0")
    )
    motors = [name if name.startswith("m") else f"{name}_" for name in actuators]
    said = {"platform": "b", "platform_joints": ["pitch", "roll"], "motors": motors}
    description = read(tmp_path, f"{tree}{more}</robot>", **said).description
    robot = ParallelRobot.from_file(write_robot_file(description, tmp_path / "out"))
    proposed = read(tmp_path, f"{tree}{more}</robot>").description
    assert (set(proposed.motor_joints), proposed.platform.joints) == (set(motors), ("pitch", "roll"))
    y, dy, ddy = np.array([0.3, -0.5]), np.array([0.7, 1.1]), np.array([-1.0, 2.0])
    pose = assemble(robot, y)
    np.testing.assert_allclose(robot.gear_ratio * pose.q[robot.actuated], np.array(turns) @ y, atol=1e-12)
    bare = pin.buildModelFromXML(f"{tree.replace('continuous', 'revolute').replace('<axis', FREE)}</robot>")
    torques = pin.rnea(bare, bare.createData(), y, dy, ddy)
    expected = np.linalg.solve(np.array(turns, dtype=float).T, torques)
    np.testing.assert_allclose(dynamics_at(robot, pose.q, dx=dy, ddx=ddy).torque.ravel(), expected, rtol=1e-9)


FREE = '<limit lower="-9" upper="9" effort="9" velocity="9"/><axis'


def test_other_transmissions_of_several_joints_are_named(tmp_path):
    kind = "<type>own/CableTransmission</type>"
    parsed = read(tmp_path, fingers(transmission(kind, part("joint", "ja"), part("joint", "jc"))))
    assert any(
        "not read: transmission 't', CableTransmission of ja, jc" in remark for remark in parsed.remarks
    )


def test_the_default_namespace_of_a_file_is_none(tmp_path):
    plain = read(tmp_path, fingers(), motors=["ja"]).description
    named = read(tmp_path, fingers(head=' xmlns="http://www.ros.org"'), motors=["ja"]).description
    assert (named.couplings, named.actuators, named.reference) == (
        plain.couplings,
        plain.actuators,
        plain.reference,
    )


def test_one_of_several_trees_is_read(tmp_path):
    shelf = link("shelf") + joint("slot", "shelf", "book") + link("book")
    text = fingers(shelf)
    with pytest.raises(RobotFileError, match="one root link, got palm, shelf; --base palm reads"):
        read(tmp_path, text, motors=["ja"])
    assert read(tmp_path, text, motors=["ja"], base="palm").description.couplings
    with pytest.raises(RobotFileError, match=r"no joint moves|without loops|no loop"):
        read(tmp_path, text, base="shelf")


def test_a_planar_joint_is_read_where_it_is_held(tmp_path):
    text = fingers().replace('<link name="palm"/>', '<link name="floor"/>' + link("palm"))
    planar = joint("roll", "floor", "palm").replace("continuous", "planar")
    text = text.replace("</robot>", f"{planar}</robot>")
    held = read(tmp_path, text, motors=["ja"])
    assert "held: roll (a free base, which no motor drives)" in held.remarks
    said = {"motors": ["ja"], "axes": ["y"], "platform": "b"}
    with pytest.raises(RobotFileError, match="joint 'roll': planar joints are only read where they are held"):
        read_any(tmp_path / "robot.urdf", **said)
    assert read_any(tmp_path / "robot.urdf", **said, locked={"roll": None}).couplings


@pytest.mark.parametrize(
    ("moments", "is_repaired"),
    [
        (("2e-07", "5e-07", "8e-07"), True),  # such as 2.4, 5.4 and 7.6
        (("0.020", "0.051", "0.072"), True),  # 1 in the last digit, of 1.5 that rounding explains
        (("0.020", "0.050", "0.072"), False),  # 2
        (("2e-07", "5e-07", "7e-07"), None),  # possible as it is
        (("1", "2", "4"), False),
    ],
)
def test_moments_that_rounding_made_impossible_are_repaired(tmp_path, moments, is_repaired):
    text = fingers()
    for key, moment in zip(("ixx", "iyy", "izz"), moments, strict=True):
        text = re.sub(rf'{key}="[^"]*"', f'{key}="{moment}"', text)
    if is_repaired is False:
        with pytest.raises(RobotFileError, match="has the principal moments"):
            read(tmp_path, text, motors=["ja"])
        return
    parsed = read(tmp_path, text, motors=["ja"])
    assert any("repaired in their last digit" in remark for remark in parsed.remarks) == bool(is_repaired)
    inertia = parsed.tree.links["a"].find("inertial/inertia")
    found = [float(inertia.get(key)) for key in ("ixx", "iyy", "izz")]
    assert found[2] <= (found[0] + found[1]) * (1 + 1e-12)
    for value, moment in zip(found, moments, strict=True):
        assert abs(value - float(moment)) <= 0.5 * 10 ** -(7 if "e" in moment else 3)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            '<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:macro name="a"/></robot>',
            "xacro FILE",
        ),
        (
            '<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:include filename="a"/></robot>',
            "expand the file that includes it",
        ),
        (
            '<robot name="r" xmlns:xacro="http://ros.org/wiki/xacro"><xacro:include filename="a"/></robot>',
            "<include>: expand the xacro macros first: xacro FILE",
        ),
        ("<robot name='r'>\n<% n = 3 %>\n</robot>", "a template of ERB: fill it in first: erb FILE"),
        (
            "<robot name='r'>{% for a in b %}<link name='{{ a }}'/>{% endfor %}<</robot>",
            "a template of Jinja",
        ),
    ],
)
def test_what_must_be_filled_in_first_is_told_so(tmp_path, text, words):
    with pytest.raises(RobotFileError, match=re.escape(words)):
        read(tmp_path, text)


def slide(offset: float) -> str:
    """A finger that follows another, ahead by `offset` [rad]; both range from 0 to 0.8 rad."""
    limit = '<limit lower="0" upper="0.8" effort="1" velocity="1"/>'
    return (
        f'<robot name="pair"><link name="palm"/>{link("a")}{link("b")}'
        + joint("ja", "palm", "a", limit)
        + joint("jb", "palm", "b", f'<mimic joint="ja" offset="{offset}"/>{limit}')
        + "</robot>"
    ).replace("continuous", "revolute")


def test_a_reference_that_convert_moves_is_within_the_ranges_and_told(tmp_path):
    """The least motion of both would take ja to -0.1 rad; ja = 0 and jb = 0.2 rad close it, too."""
    parsed = read(tmp_path, slide(0.2), motors=["ja"])
    reference = parsed.description.reference
    assert reference["jb"] - reference["ja"] == pytest.approx(0.2, abs=1e-9)
    assert -1e-9 <= reference["ja"] < 1e-3
    (told,) = [remark for remark in parsed.remarks if remark.startswith("reference: ")]
    assert re.match(r"reference: jb 0\.2 rad from the file's, .*; --reference chooses others", told)
    chosen = read(tmp_path, slide(0.2), motors=["ja"], reference={"ja": 0.3, "jb": 0.5})
    assert not [remark for remark in chosen.remarks if remark.startswith("reference: ")]
    assert chosen.description.reference == pytest.approx({"ja": 0.3, "jb": 0.5})


def test_a_reference_outside_the_ranges_is_told(tmp_path):
    parsed = read(tmp_path, slide(0.2), motors=["ja"], reference={"ja": -0.3, "jb": -0.1})
    assert (
        "reference: outside the joints' ranges: ja at position -0.3 rad of 0; jb at position -0.1 rad of 0"
        in (parsed.remarks)
    )


def test_the_posture_that_base_holds_is_told(tmp_path):
    text = fingers().replace('<link name="palm"/>', '<link name="floor"/>' + link("palm"))
    text = text.replace("</robot>", joint("waist", "floor", "palm") + "</robot>")
    parsed = read(tmp_path, text, motors=["ja"], base="palm", reference={"waist": 0.4})
    assert "held by --base, in the file's posture: waist 0.4" in parsed.remarks


ARMS = f'<robot name="arms"><link name="base"/>{link("a")}{link("b")}{link("c")}' + "".join(
    [
        joint("ja", "base", "a"),
        joint("jc", "a", "c"),
        joint("jb", "base", "b"),
        '<link name="end"/><joint name="at_end" type="fixed"><parent link="c"/><child link="end"/>'
        '<origin xyz="0.2 0 0"/></joint>',
        '<link name="tip"/><joint name="at_tip" type="fixed"><parent link="b"/><child link="tip"/>'
        '<origin xyz="0.2 0.1 0"/></joint></robot>',
    ]
)


@pytest.mark.parametrize(
    ("words", "locked", "length"),
    [
        ("end tip spherical", ("x", "y", "z"), None),
        ("end tip revolute", ("x", "y", "z", "rx", "ry"), None),
        ("end tip prismatic y", ("x", "z", "rx", "ry", "rz"), None),
        ("end tip distance 0.15", ("distance",), 0.15),
    ],
)
def test_a_loop_is_closed_in_words(tmp_path, words, locked, length):
    with pytest.raises(RobotFileError, match="let `convert --close` close them in words"):
        read(tmp_path, ARMS)
    (closure,) = read(
        tmp_path, ARMS, closures=[words.split()], motors=["ja"], platform="b", axes=["rz"]
    ).description.closures
    assert (closure.frames, closure.axes, closure.length) == (("end", "tip"), locked, length)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("end tip", "needs FRAME FRAME KIND"),
        ("end top spherical", "unknown frame 'top'; did you mean 'tip'"),
        ("end tip ball", "unknown closure kind 'ball'"),
        ("end tip revolute w", "unknown closure axis 'w'"),
        ("end c spherical", "'end' and 'c' are on one rigid body"),
        ("end tip distance", "length: missing"),
        ("end tip distance -1", "length: must be greater than zero"),
    ],
)
def test_words_that_close_no_loop_are_refused(tmp_path, words, message):
    with pytest.raises(RobotFileError, match=f"--close {words}.*{message}"):
        read(tmp_path, ARMS, closures=[words.split()])


def test_meshes_that_are_not_found_are_counted_in_one_line(tmp_path):
    """A folder for the package that they name finds them; the new robot file says where they are."""
    mesh = '<visual><geometry><mesh filename="package://no_such_arm/meshes/{}.stl"/></geometry></visual>'
    text = fingers(link("d", mesh.format("one") + mesh.format("two")) + joint("jd", "a", "d"))
    (told,) = [remark for remark in read(tmp_path, text).remarks if "mesh" in remark]
    first = "package://no_such_arm/meshes/one.stl"
    assert (
        told
        == f"meshes not found, and not drawn: 2, such as {first}; --package no_such_arm=FOLDER says where"
    )
    (tmp_path / "here" / "meshes").mkdir(parents=True)
    for name in ("one", "two"):
        (tmp_path / "here" / "meshes" / f"{name}.stl").write_text("solid")
    parsed = read(tmp_path, text, packages=[f"no_such_arm={tmp_path / 'here'}"])
    assert not [remark for remark in parsed.remarks if "mesh" in remark]
    assert all(
        Path(mesh.get("filename")).is_file()
        for link in parsed.tree.links.values()
        for mesh in link.iter("mesh")
    )
    with pytest.raises(RobotFileError, match="--package: needs NAME=FOLDER with a folder that exists"):
        read(tmp_path, text, packages=["no_such_arm=/no/such/folder"])


def test_gazebo_s_detachable_joint_closes_the_loop_of_a_urdf(tmp_path):
    """Both links are welded as they stand in the file."""
    plugin = (
        '<gazebo><plugin filename="detach.so" name="gz::sim::systems::DetachableJoint">'
        "<parent_link>tip</parent_link><child_model>arms</child_model><child_link>end</child_link></plugin></gazebo>"
    )
    description = read(tmp_path, ARMS.replace("</robot>", f"{plugin}</robot>"), motors=["ja"]).description
    (closure,) = description.closures
    assert (closure.frames[1], closure.axes) == ("end", locked_axes("fixed"))
    grasp = plugin.replace(">end<", ">lid<").replace(">arms<", ">box<")  # of what is spawned later
    text = ARMS.replace("</robot>", f"{plugin}{grasp}</robot>")
    left_out = read(tmp_path, text, motors=["ja"]).description.left_out
    assert any("DetachableJoint of tip and box::lid" in effect for effect in left_out)


def test_transmissions_with_other_parts_are_named_and_do_not_stop_the_file(tmp_path):
    """As older files write a differential; and an offset, which no plan needs."""
    kind = "transmission_interface/DifferentialTransmission"
    older = (
        f'<transmission name="t" type="{kind}"><leftJoint name="ja"/><rightJoint name="jb"/></transmission>'
    )
    offset = part("joint", "ja", "<mechanical_reduction>4</mechanical_reduction><offset>0.5</offset>")
    parsed = read(tmp_path, fingers(older + transmission(SIMPLE, offset)))
    assert any("not read: transmission 't', DifferentialTransmission" in remark for remark in parsed.remarks)
    assert any("its offset is not read" in remark for remark in parsed.remarks)
    assert [motor.gear_ratio for motor in parsed.description.actuators] == [4.0]


def test_joints_that_controllers_of_gazebo_name_are_likely_motors(tmp_path):
    control = "<gazebo><plugin name='control'><joint_name>jb</joint_name></plugin></gazebo>"
    text = ARMS.replace("</robot>", f"{control}</robot>")
    description = read(tmp_path, text, closures=[["end", "tip", "revolute"]]).description
    assert description.motor_joints == ("jb",)


def test_axes_that_are_rounded_take_no_freedom_beside_the_pose_of_the_file(tmp_path):
    """Both elbows of a five-bar are tilted by 1e-6 about their rods, which moves the tip only beside it."""
    tip = '<loop name="tip" type="spherical"><predecessor link="b"><origin xyz="0 0.3 0"/></predecessor>'
    tip += '<successor link="d"><origin xyz="-0.3 0.2 0"/></successor></loop>'
    left = joint("ja", "palm", "a") + joint("jb", "a", "b").replace("0 0 1", "0 1e-6 1")
    right = joint("jc", "palm", "c").replace("0.2 0 0", "0.8 0 0")
    right += joint("jd", "c", "d").replace("0.2 0 0", "-0.1 0.1 0").replace("0 0 1", "-1.2e-6 0.8e-6 1")
    links = f'<link name="palm"/>{link("a")}{link("b")}{link("c")}{link("d")}'
    text = f'<robot name="r">{links}{left}{right}{tip}</robot>'
    robot = ParallelRobot.from_description(read(tmp_path, text).description)
    exact = ParallelRobot.from_description(read(tmp_path, text.replace("e-6", "e-99")).description)
    assert robot.actuator_names == exact.actuator_names == ("ja", "jc")
    assert robot.rounded.names == ("tip.z",)
