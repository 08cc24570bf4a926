"""What comes of files with the quirks of published ones: as EXPECTED.md beside them says beforehand."""

from dataclasses import replace

import numpy as np
import pytest

from framework import LoadedJoint, Mechanism, ParallelRobot, RobotFileError, check_robot, simulate
from framework.kinematics.diagnostics.proposal import propose
from framework.model.description import Closure
from framework.model.readers import parse_any
from tests.model.readers.foreign_files import DATA, PLANNED, short_move, without_dry_friction
from tests.oracles.placements import placements

PLATFORM = {"platform": "head", "axes": ["x", "y", "z", "rx", "ry", "rz"]}
FILES = pytest.mark.parametrize("file", PLANNED, ids=lambda file: file.name.removesuffix(".xml"))


@FILES
def test_freedoms_and_idle_turns_are_those_that_an_expert_counts(file):
    found = check_robot(ParallelRobot.from_description(file.description()))
    assert found.mobility == file.freedoms + file.idle_turns
    assert len(found.idle_joints) == file.idle_turns


@FILES
def test_a_short_move_is_planned_and_what_is_held_is_worth_little(file):
    plan = short_move(ParallelRobot.from_description(file.description()))
    largest = np.abs(plan.robot.gear_ratio * plan.torque(np.linspace(0.0, plan.duration, 101))).max()
    assert plan.certificate.max_residual_torque < 1e-9 * largest
    assert plan.certificate.max_held_torque < 1e-4 * largest


@FILES
def test_planned_torques_bring_the_robot_along(file):
    """Forward dynamics of all coordinates, idle turns free: what holding them costs leads off the path."""
    plan = short_move(ParallelRobot.from_description(without_dry_friction(file.description())))
    back = simulate(plan)
    largest = np.abs(plan.robot.gear_ratio * plan.torque(np.linspace(0.0, plan.duration, 101))).max()
    share = plan.certificate.max_held_torque / largest
    error = max((back.tracking_error or 0.0) / plan.robot.length, back.turning_error or 0.0)
    assert error < 1e-9 + 10 * share


def test_rounded_and_overconstrained_rings_say_by_how_much_they_are_open():
    plan = short_move(ParallelRobot.from_description(PLANNED[1].description()))
    of_ten_numbers = 10 * 0.5e-6  # [m, rad], that a loop is made of, each rounded to six digits
    assert 1e-9 < plan.certificate.rounded_gap < of_ten_numbers


@pytest.mark.parametrize(
    ("name", "springs"),
    [("sprung_leg.xml", "shin, heel"), ("gripper_on_a_tendon.xml", "right_spring_link, left_spring_link")],
)
def test_springs_that_no_motor_drives_are_held_as_the_options_would_hold_them(name, springs):
    """An expert locks them by name; proposed alone, and said, the same joints are left to move."""
    (file,) = (file for file in PLANNED if file.name == name)
    parsed, locked = parse_any(DATA / name, propose=propose), file.description()
    assert any(remark.startswith(f"held: {springs} (springs") for remark in parsed.remarks)
    assert parsed.description.motor_joints == locked.motor_joints
    assert parsed.description.reference.keys() == locked.reference.keys()


def unlike_about_one_axis(description):
    """The same robot, the damping of one ball of the last rod unlike about its axes."""
    turn = description.joints["passive_7_ry"]
    joints = {**description.joints, "passive_7_ry": replace(turn, damping=2.0 * turn.damping)}
    return replace(description, joints=joints)


def test_a_rod_that_a_ball_loads_by_its_angle_is_not_held_in_silence_and_the_remedies_work():
    """What acts on the ball then depends on how far the rod has turned: the plan holds it, or is refused."""
    description = unlike_about_one_axis(parse_any(DATA / "head_on_six_rods.xml", propose=propose).description)
    robot = ParallelRobot.from_description(description)
    assert (robot.n, len(robot.structure.idle)) == (6, 6)
    with pytest.raises(
        LoadedJoint, match=r"lock passive_6_ry .* closure \{frames: \[horn_6, rod_6\], axes: \[ry\]"
    ):
        short_move(robot)
    lock = Closure("turn", ("horn_6", "rod_6"), ("ry",))
    locked = replace(description, closures=(*description.closures, lock))
    acting = {name: joint for name, joint in description.joints.items() if not name.startswith("passive_7")}
    for remedied in (locked, replace(description, joints=acting)):
        plan = short_move(ParallelRobot.from_description(remedied))
        assert plan.certificate.max_held_torque < 1e-4 * max(plan.peak_torque.values())


@pytest.mark.parametrize("turn", [None, 0.0])
def test_one_turn_of_a_ball_is_held_by_the_name_that_check_prints(turn):
    """A rod on a ball and a cross: no idle turn is left there, and the head moves the rod as before."""
    file = DATA / "head_on_six_rods.xml"
    free = ParallelRobot.from_description(parse_any(file, propose=propose).description)
    names = [name for name in check_robot(free).idle_joints if name.startswith("passive_6")]
    held = parse_any(file, propose=propose, locked=dict.fromkeys(names, turn)).description
    robot = ParallelRobot.from_description(held)
    assert len(names) == 1
    assert names[0] not in robot.coordinates.names
    assert (robot.n, len(robot.structure.idle)) == (6, 5)
    assert short_move(robot).certificate.max_residual_torque < 1e-9


def test_a_ball_with_a_turn_held_stands_as_the_reference_had_it():
    file, turned = (
        DATA / "head_on_six_rods.xml",
        {"passive_1_rx": 0.2, "passive_1_ry": -0.3, "passive_1_rz": 0.5},
    )
    robots = [
        Mechanism.from_description(
            parse_any(file, propose=None, **PLATFORM, reference=turned, **more).description
        )
        for more in ({}, {"locked": {"passive_1_ry": None}})
    ]
    (one,), (other,) = (placements(robot.model, ("rod_1",), robot.q_near) for robot in robots)
    np.testing.assert_allclose(other.homogeneous, one.homogeneous, atol=1e-12)


def test_motions_that_nothing_drives_are_refused_with_joints_to_hold(tmp_path):
    """One motor in the middle of a 5R: all bodies move with it, and with what is loose."""
    text = (DATA / "five_bar_sites.xml").read_text()
    motors = text[text.index("<actuator>") : text.index("</actuator>")]
    file = tmp_path / "loose.xml"
    file.write_text(text.replace(motors, '<actuator><motor joint="left_elbow"/>'))
    with pytest.raises(
        RobotFileError, match=r"2 freedoms and 1 motor \(left_elbow\): no motor drives .* --lock"
    ):
        parse_any(file, propose=propose)
