"""What convert proposes of a file that is silent, what it holds, and what it leaves out."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from framework import Line, Mechanism, ParallelRobot, RobotFileError, check_robot, plan_crossing
from framework.kinematics import loop_structure, parallel_robot
from framework.kinematics.assembly_search import find_closed_pose
from framework.kinematics.diagnostics import mobility
from framework.kinematics.diagnostics.proposal import propose
from framework.model.readers import parse_any
from tests.model.readers.foreign_files import short_move

DATA = Path(__file__).parents[2] / "data" / "dialects"
GRIPPER = DATA / "mirrored_gripper.xml"


def test_a_tendon_over_coupled_joints_is_a_transmission_to_one():
    robot = parse_any(GRIPPER, base="palm", propose=propose)
    (actuator,) = robot.description.actuators
    assert (actuator.joint, actuator.gear_ratio, actuator.torque_limit) == ("right_driver_joint", 1.0, 5.0)
    assert robot.description.couplings[0].name == "left_driver_joint_of_right_driver_joint"
    assert ParallelRobot.from_description(robot.description).n == 1


def test_what_acts_beside_the_base_stops_nothing_and_is_not_named():
    assert parse_any(GRIPPER, base="palm", propose=propose).description.left_out == ()
    left_out = " ".join(parse_any(GRIPPER, propose=propose, locked={}).description.left_out)
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


FIVE_BAR = (DATA / "five_bar_sites.xml").read_text()


def proposed(folder: Path, text: str, **options):
    """What `convert` proposes of a text."""
    file = folder / "file.xml"
    file.write_text(text)
    return parse_any(file, propose=propose, **options)


def test_a_site_between_two_ends_stands_half_way(tmp_path):
    text = FIVE_BAR.replace(
        'name="left_tip" pos="0.25 0 0"',
        'name="left_tip" type="capsule" size="0.01" fromto="0.25 0 -0.1 0.25 0 0.1"',
    )
    ends = proposed(tmp_path, text).description
    assert ends.reference == pytest.approx(proposed(tmp_path, FIVE_BAR).description.reference, abs=1e-12)


def test_a_fluid_is_left_out_by_name(tmp_path):
    text = FIVE_BAR.replace("<option ", '<option density="1.2" viscosity="1.8e-5" ')
    assert proposed(tmp_path, text).description.left_out == (
        "<option> density 1.2, viscosity 1.8e-05: the drag of the fluid",
    )


def test_global_coordinates_are_refused_by_a_way_out(tmp_path):
    with pytest.raises(RobotFileError, match="load and save them in MuJoCo 2"):
        proposed(tmp_path, FIVE_BAR.replace("<compiler ", '<compiler coordinate="global" '))


FLAT_FOUR_BAR = """<mujoco><compiler angle="degree"/><worldbody>
  <body name="crank"><joint name="crank" range="30 140"/><geom size="0.01" mass="0.1"/>
    <body name="rod" pos="0.055 0 0"><joint name="rod"/><geom size="0.01" pos="0.1 0 0" mass="0.2"/></body>
  </body>
  <body name="foot" pos="0.35 -0.006 0"><joint name="foot" range="30 140"/>
    <geom size="0.01" pos="0.03 0 0" mass="0.3"/></body>
</worldbody><equality><connect body1="rod" body2="foot" anchor="0.35 0 0"/></equality>
<actuator><motor joint="foot"/></actuator></mujoco>"""


def test_where_motors_do_not_drive_the_pose_of_the_file_one_within_the_limits_is_taken(tmp_path):
    """Crank and rod are one line: the foot's motor holds its end, and the two are free to bulge."""
    parsed = proposed(tmp_path, FLAT_FOUR_BAR)
    (remark,) = (remark for remark in parsed.remarks if remark.startswith("reference"))
    assert "within the joints' limits" in remark
    robot = ParallelRobot.from_description(parsed.description)
    assert not any("limits" in note for note in check_robot(robot).advice)
    assert all(abs(robot.description.reference[name]) > 0.5 for name in ("crank", "foot"))


def test_a_pose_within_limits_that_contradict_the_loops_is_sought_once(tmp_path, monkeypatch):
    """Every search asks another question: of a walking robot 18 searches took 34 s."""
    questions = []

    def find(mechanism):
        questions.append((mechanism.description.urdf_text, mechanism.q_near.tobytes()))
        return find_closed_pose(mechanism)

    for module in (mobility, loop_structure, parallel_robot):
        monkeypatch.setattr(module, "find_closed_pose", find)
    far = FLAT_FOUR_BAR.replace('name="crank" range="30 140"', 'name="crank" range="170 175"')
    with pytest.raises(RobotFileError, match="leave no freedom"):
        proposed(tmp_path, far.replace('name="foot" range="30 140"', 'name="foot" range="10 12"'))
    assert questions
    assert len(set(questions)) == len(questions)


def two_five_bars(stand: Callable[[ElementTree.Element, str], ElementTree.Element]) -> str:
    """The five-bar twice, side a and side b, each on the element that `stand` makes in the world for it."""
    root = ElementTree.fromstring(FIVE_BAR)
    root.remove(root.find("keyframe"))
    world = root.find("worldbody")
    bodies = world.findall("body")
    for body in bodies:
        world.remove(body)
    for side in ("a", "b"):
        stand(world, side).extend(_named(body, side) for body in bodies)
    for section in ("equality", "actuator"):
        elements = root.find(section)
        for element in list(elements):
            elements.remove(element)
            elements.extend(_named(element, side) for side in ("a", "b"))
    return ElementTree.tostring(root, encoding="unicode")


@pytest.mark.slow
def test_of_two_five_bars_that_move_no_body_together_one_is_taken_as_the_remark_says(tmp_path):
    """The left and the right one stand on carriages of one table."""

    def carriage(world: ElementTree.Element, side: str) -> ElementTree.Element:
        table = ElementTree.SubElement(world, "body", name=f"table_{side}")
        ElementTree.SubElement(table, "joint", name=f"table_{side}", type="slide")
        return table

    text = two_five_bars(carriage)
    (remark,) = (remark for remark in proposed(tmp_path, text).remarks if remark.startswith("platform"))
    assert "no body is moved by all of the motors" in remark
    assert "such as --base table_a" in remark
    taken = proposed(tmp_path, text, base="table_a").description
    assert [actuator.joint for actuator in taken.actuators] == ["left_motor_a", "right_motor_a"]


def _named(element: ElementTree.Element, side: str) -> ElementTree.Element:
    """A copy whose names end in a side."""
    copied = ElementTree.fromstring(ElementTree.tostring(element))
    for part in copied.iter():
        for key in ("name", "joint", "site1", "site2"):
            if key in part.attrib:
                part.set(key, f"{part.get(key)}_{side}")
    return copied


def test_the_only_urdf_beside_a_yaml_is_its_own(tmp_path):
    for name, renamed in (("robot.yaml", "robot.yaml"), ("robot.urdf", "model_full_v2.urdf")):
        (tmp_path / renamed).write_text((DATA / "gepetto" / name).read_text())
    assert parse_any(tmp_path / "robot.yaml", propose=propose).dialect == "gepetto"


def test_frames_place_and_class_what_they_hold(tmp_path):
    """The right leg of the five-bar in two frames, one of which turns it and one of which is a class."""
    start, end = FIVE_BAR.index('<body name="right_crank"'), FIVE_BAR.index("  </worldbody>")
    leg = FIVE_BAR[start:end]
    for old, new in (
        ('pos="0.2 0 0"', 'pos="0.1 0.05 0" axisangle="0 0 1 -0.7"'),
        ('childclass="passive"', ""),
        ('<joint name="right_elbow"/>', '<frame childclass="passive"><joint name="right_elbow"/></frame>'),
        (
            '<site name="right_tip" pos="0.25 0 0"/>',
            '<frame pos="0.2 0 0"><site name="right_tip" pos="0.05 0 0"/></frame>',
        ),
    ):
        assert old in leg
        leg = leg.replace(old, new)
    cosine, sine = np.cos(0.7), np.sin(0.7)
    x, y = 0.2 - (0.1 * cosine - 0.05 * sine), -(0.1 * sine + 0.05 * cosine)
    frame = f'<frame pos="{x} {y} 0" euler="0 0 0.7">{leg}</frame>'
    framed = proposed(tmp_path, FIVE_BAR[:start] + frame + FIVE_BAR[end:]).description
    plain = proposed(tmp_path, FIVE_BAR).description
    robots = [ParallelRobot.from_description(each) for each in (framed, plain)]
    assert robots[0].reference.x == pytest.approx(robots[1].reference.x, abs=1e-9)
    line = Line([0.1, 0.345], [0.05, 0.3])
    torques = [plan_crossing(robot, line, duration=1.0).torque(0.4) for robot in robots]
    assert torques[0] == pytest.approx(torques[1], rel=1e-9)


def test_copies_of_bodies_are_read_as_mujoco_makes_them(tmp_path):
    copy = '<body name="c"><geom type="sphere" size="0.01" mass="1"/></body>'
    copies = f'<replicate count="5" offset="0.1 0 0">{copy}</replicate>'
    whole, at_rest, carried = (
        Mechanism.from_description(proposed(tmp_path, text).description)
        for text in (
            FIVE_BAR,
            FIVE_BAR.replace("<worldbody>", f"<worldbody>{copies}"),
            FIVE_BAR.replace('<joint name="left_elbow"/>', f'<joint name="left_elbow"/>{copies}'),
        )
    )
    moving = [
        sum(inertia.mass for inertia in list(robot.model.inertias)[1:]) for robot in (whole, at_rest, carried)
    ]
    assert moving[1] - moving[0] == 0
    assert moving[2] - moving[0] == pytest.approx(5)


def test_two_legs_that_no_body_joins_move_by_their_joints_or_one_is_held(tmp_path):
    text = two_five_bars(lambda world, side: world)
    whole = proposed(tmp_path, text)
    assert len(whole.description.platform.joints) == ParallelRobot.from_description(whole.description).n == 4
    names = whole.remarks[-1].partition("--lock ")[2].partition(")")[0].split()
    taken = proposed(tmp_path, text, locked=dict.fromkeys(names)).description
    assert ParallelRobot.from_description(taken).n == 2


def test_a_follower_that_is_held_by_its_spring_holds_its_leader(tmp_path):
    """A four-bar whose first bar carries two coupled flaps; one has a spring, and no motor moves them."""
    flaps = "".join(
        f'<body name="{name}" pos="{x} 0 0"><joint name="{name}_j" axis="0 1 0" {spring}/>'
        f'<geom pos="0.1 0 0" size="0.05" mass="0.1"/></body>'
        for name, x, spring in (("s", 0.2, 'stiffness="3"'), ("t", -0.2, ""))
    )
    bars = (
        '<body name="u" pos="0.3 0 0.2"><joint axis="0 1 0"/><geom pos="0.1 0 0" size="0.05" mass="0.1"/>'
        '<body name="v" pos="0.1 0 0"><joint axis="0 1 0"/><geom pos="0.1 0 0" size="0.05" mass="0.1"/>'
        "</body></body>"
    )
    model = (
        '<mujoco><worldbody><body name="one"><joint name="j" axis="0 1 0"/><geom size="0.1" mass="1"/>'
        f'{flaps}</body>{bars}</worldbody><equality><joint joint1="s_j" joint2="t_j" polycoef="0 -2 0 0 0"/>'
        '<connect body1="one" body2="v" anchor="0.1 0 0"/></equality>'
        '<actuator><motor joint="j"/></actuator></mujoco>'
    )
    description = proposed(tmp_path, model).description
    assert description.couplings == ()
    assert description.motor_joints == ("j",)
    assert {"s_j", "t_j"}.isdisjoint(description.reference)


def three_bars(difference: float, tilt: float) -> str:
    """A parallelogram with a third bar, drawn at zero; rods differ by a length [m], axes are tilted [rad]."""
    ball = '<geom size="0.005" mass="0.1" pos="0.003 0 0.02"/>'
    rods, ends, loops = "", "", ""
    for name, side in (("left", -0.5), ("right", 0.5)):
        x, z, length = side * 0.0145, side * 0.0039, 0.0423 + side * difference
        rods += (
            f'<body name="{name}" pos="{x} 0 {z}"><joint name="{name}" axis="{tilt * side} 1 0"/>{ball}'
            f'<site name="{name}" pos="0 0 {length}"/></body>'
        )
        ends += (
            f'<body name="{name}_end" pos="{x} 0 {z + side * difference}"><joint axis="0 1 0"/>'
            f'<geom size="0.005" mass="0.01"/><site name="{name}_end"/></body>'
        )
        loops += f'<weld site1="{name}" site2="{name}_end"/>'
    return (
        f'<mujoco><worldbody><body name="bar"><joint name="bar" axis="0 1 0"/>{ball}<body name="plate" '
        f'pos="0 0 0.0423"><joint name="plate" axis="0 1 0"/>{ball}{ends}</body></body>{rods}</worldbody>'
        f'<equality>{loops}</equality><actuator><motor joint="bar"/></actuator></mujoco>'
    )


@pytest.mark.parametrize("tilt", [1e-8, 1e-7, 1e-6])
def test_bars_that_are_drawn_closed_are_not_locked_by_the_rounding_of_their_axes(tmp_path, tilt):
    robot = ParallelRobot.from_description(proposed(tmp_path, three_bars(5e-5, tilt)).description)
    assert check_robot(robot).mobility == 1
    assert short_move(robot).certificate.rounded_gap < 1e-6


def test_bars_whose_axes_are_not_parallel_are_locked(tmp_path):
    with pytest.raises(RobotFileError, match="the loops leave no freedom"):
        proposed(tmp_path, three_bars(0.0, 0.1))


DRAWN_OPEN = """<mujoco><worldbody>
  <body name="A"><joint name="a"/><geom size="0.01" mass="0.1"/>
    <body name="B" pos="0.4 0 0"><joint name="b"/><geom size="0.01" pos="0.1 0 0" mass="0.2"/>
      <site name="tip" pos="1 0 0"/></body></body>
  <body name="C" pos="1 0 0"><joint name="c"/><geom size="0.01" pos="0.03 0 0" mass="0.3"/>
    <site name="eye" pos="0.7 0 0"/></body>
</worldbody><equality><connect site1="tip" site2="eye"/></equality></mujoco>"""


def test_loops_that_the_file_leaves_open_are_closed_where_motors_and_platform_are_stated(tmp_path):
    """Links of 1 (ground), 0.4, 1 and 0.7 m, all drawn along x."""
    parsed = proposed(tmp_path, DRAWN_OPEN, platform_joints=["c"], motors=["a"])
    assert any("loops are 0.3 m" in remark for remark in parsed.remarks)
    a, b, c = (parsed.description.reference[name] for name in "abc")
    assert abs(0.4 * np.exp(1j * a) + np.exp(1j * (a + b)) - 1.0 - 0.7 * np.exp(1j * c)) < 1e-8


def lift(legs: int) -> str:
    """A plate that slides on stretched legs of crank and rod in vertical planes through its axis."""
    bodies = "".join(
        f'<body euler="0 0 {120 * k}"><body name="crank{k}" pos="1 0 5"><joint name="hip{k}" axis="0 1 0"/>'
        f'<geom size=".05" fromto="0 0 0 0 0 -2" type="capsule"/><body name="rod{k}" pos="0 0 -2">'
        f'<joint name="knee{k}" axis="0 1 0"/><geom size=".05" fromto="0 0 0 0 0 -3" type="capsule"/>'
        "</body></body></body>"
        for k in range(legs)
    )
    connects = "".join(f'<connect body1="rod{k}" body2="plate" anchor="0 0 -3"/>' for k in range(legs))
    plate = '<body name="plate"><joint name="lift" type="slide" axis="0 0 1"/><geom size="1"/></body>'
    return (
        f"<mujoco><worldbody>{bodies}{plate}</worldbody><equality>{connects}</equality>"
        '<actuator><motor joint="hip0"/></actuator></mujoco>'
    )


def test_a_pose_beside_a_singularity_of_the_loops_is_not_nearly_singular(tmp_path):
    """With stretched legs the height is of second order in their angles."""
    description = proposed(tmp_path, lift(3)).description
    assert min(abs(description.reference[f"hip{k}"]) for k in range(3)) > 0.1
    assert check_robot(ParallelRobot.from_description(description)).mobility == 1


def test_motions_that_no_joint_tells_are_not_answered_by_more_motors(tmp_path):
    """The bar between two balls is a free body, which turns about its line: no hinge tells how far."""
    arms = "".join(
        f'<body name="{side}" pos="{x} 0 0"><joint name="{side}_motor" axis="0 0 1"/>'
        f'<geom type="capsule" size=".02" fromto="0 0 0 .1 .3 0"/></body>'
        for side, x in (("left", -0.5), ("right", 0.5))
    )
    bar = '<freejoint name="free"/><geom type="box" size=".5 .02 .02" pos="0 0 .1"/>'
    ends = "".join(f'<connect body1="{side}" body2="bar" anchor=".1 .3 0"/>' for side in ("left", "right"))
    text = (
        f'<mujoco><worldbody>{arms}<body name="bar" pos="0 .3 0">{bar}</body></worldbody>'
        f'<equality>{ends}</equality><actuator><motor joint="left_motor"/></actuator></mujoco>'
    )
    with pytest.raises(RobotFileError, match=r"no hinge or slide tells 1 of these; .* in the place of free"):
        proposed(tmp_path, text)


def test_a_ball_that_carries_the_loop_is_named_to_be_held(tmp_path):
    """No hinge tells the turns of the ball: holding it is the remedy."""
    arms = "".join(
        f'<body name="{side}" pos="{-x} 0 0"><joint name="{side}_motor" axis="0 1 0"/><geom size=".1"/>'
        f'<body name="{side}_rod" pos="{-0.4 * x} 0 .5"><joint name="{side}_elbow" axis="0 1 0"/>'
        f'<geom type="capsule" size=".02" fromto="0 0 0 {1.4 * x} 0 .5"/></body></body>'
        for side, x in (("left", 0.5), ("right", -0.5))
    )
    text = (
        f'<mujoco><worldbody><body><joint name="hip" type="ball"/><geom size=".1"/>{arms}</body></worldbody>'
        '<equality><connect body1="left_rod" body2="right_rod" anchor=".7 0 .5"/></equality></mujoco>'
    )
    motors = ["left_motor", "right_motor"]
    with pytest.raises(RobotFileError, match=r"\(such as --lock hip\)"):
        proposed(tmp_path, text, motors=motors)
    assert proposed(tmp_path, text, motors=motors, locked={"hip": None}).description.platform


def test_slides_in_the_loops_are_the_motors_if_there_is_one_for_each_motion(tmp_path):
    """Two hinged slides hold a point: the legs of a plane RPRPR."""
    legs = "".join(
        f'<body name="{side}" pos="{x} 0 0"><joint name="{side}_hinge" axis="0 1 0"/><geom size=".02"/>'
        f'<body name="{side}_rod" euler="0 {turn} 0"><joint name="{side}_slide" type="slide" axis="0 0 1"/>'
        f'<geom type="capsule" size=".01" fromto="0 0 .2 0 0 {length}"/></body></body>'
        for side, x, turn, length in (("left", -0.3, 45, 0.424264), ("right", 0.3, -45, 0.424264))
    )
    end = '<equality><connect body1="left_rod" body2="right_rod" anchor="0 0 .424264"/></equality>'
    parsed = proposed(tmp_path, f"<mujoco><worldbody>{legs}</worldbody>{end}</mujoco>")
    assert parsed.description.motor_joints == ("left_slide", "right_slide")
    assert "motors: left_slide, right_slide (proposed: the slides)" in parsed.remarks
