"""Paths in joints without motors: through stretched legs, into other working modes."""

import json

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import InvalidInput, JointPath, Line, NoAnswer, assemble, load_plan, plan_crossing, simulate
from framework.cli import main
from framework.kinematics.tree_model import shares_beyond_limits
from framework.planning import choose_joint_path, flip_legs, save_plan, with_platform_joints
from framework.proofs.working_modes import working_modes
from tests.oracles.equations_of_motion import defects_of

START, GOAL = [0.1, 0.345], [-0.05, 0.195]
ELBOWS = ("left_elbow", "right_elbow")


def five_bar():
    return robots.load("five_bar", flexibility="rigid")


def positions(robot, q: np.ndarray, joints) -> np.ndarray:
    """The positions of joints at q (nq,)."""
    return np.array([q[robot.model.joints[robot.model.getJointId(name)].idx_q] for name in joints])


def elbows_flipped() -> JointPath:
    """From the start of scene C to its goal with both elbows mirrored."""
    robot = five_bar()
    start, goal = (positions(robot, assemble(robot, x).q, ELBOWS) for x in (START, GOAL))
    return JointPath(ELBOWS, Line(start, -goal))


def test_both_elbows_flip_through_one_singular_point():
    """Where the forearms lie in one line, by pinocchio alone."""
    robot = five_bar()
    plan = plan_crossing(robot, elbows_flipped(), duration=1.5)

    def sine(t: float) -> float:
        """Of the angle between the forearms."""
        q = plan.configuration(t)
        tip, data = tip_of(robot, q), robot.model.createData()
        pin.forwardKinematics(robot.model, data, q)
        elbows = [data.oMi[robot.model.getJointId(name)].translation[:2] for name in ELBOWS]
        (x, y), (u, v) = ((tip - elbow) / np.linalg.norm(tip - elbow) for elbow in elbows)
        return x * v - y * u

    (crossing,) = plan.crossings
    assert abs(sine(crossing.time)) < 1e-12
    turns_over = np.diff(np.sign([sine(t) for t in np.linspace(0.0, plan.duration, 301)])) != 0
    assert np.count_nonzero(turns_over) == 1
    peaks = np.abs(plan.torque(np.linspace(0.0, plan.duration, 5001))).max(axis=0)
    np.testing.assert_allclose(list(plan.peak_torque.values()), peaks, rtol=1e-5)
    # of a robot file that declares the elbows as platform, by another version of the program
    assert crossing.s == pytest.approx(0.675983, abs=1e-6)
    assert peaks.max() == pytest.approx(0.127, abs=1e-3)
    assert plan.certificate.tail < 1e-10
    assert simulate(plan).tracking_error < 1e-10
    defect = defects_of(plan)
    assert max(defect.open, defect.acceleration, defect.force) < 1e-8


def test_the_tip_is_at_both_ends_where_the_platform_would_be():
    """By pinocchio alone, without the loops."""
    robot = five_bar()
    plan = plan_crossing(robot, elbows_flipped(), duration=1.5)
    for t, x in ((0.0, START), (plan.duration, GOAL)):
        np.testing.assert_allclose(tip_of(robot, plan.configuration(t)), x, atol=1e-9)
    assert positions(robot, plan.configuration(plan.duration), ELBOWS)[0] > 0.0  # it was negative


def tip_of(robot, q: np.ndarray) -> np.ndarray:
    """The place (2,) of the tip at q, by pinocchio alone."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    return data.oMf[robot.model.getFrameId("left_tip")].translation[:2]


def test_the_tip_is_compared_in_metres():
    """By pinocchio alone; in joints the errors are angles."""
    robot = five_bar()
    plan = plan_crossing(robot, elbows_flipped(), duration=1.5)
    result = simulate(plan, method="fast", step=1e-2)
    planned = plan.configuration(np.minimum(result.times, plan.duration))
    tips = np.array([tip_of(robot, q) for q in result.q]) - [tip_of(robot, q) for q in planned]
    assert result.frame_error == pytest.approx(np.linalg.norm(tips, axis=1).max(), rel=1e-9)
    assert result.tracking_error != pytest.approx(result.frame_error, rel=0.1)


@pytest.mark.slow
def test_the_quickest_flip_within_limits():
    """A motor is at its limit nearly all the time, or the law would not be the quickest."""
    limit = 0.165
    plan = plan_crossing(five_bar(), elbows_flipped(), optimize="time", torque_limit=limit)
    largest = np.abs(plan.torque(np.linspace(0.0, plan.duration, 5001))).max(axis=1)
    assert largest.max() <= limit
    assert np.mean(largest > 0.98 * limit) > 0.9
    assert plan.duration == pytest.approx(0.936, abs=2e-3)  # as the other version
    # at the default tolerance the integration's own error is 1e-10, through the singular point
    assert simulate(plan, tolerance=1e-13).tracking_error < 1e-10


def test_the_joints_are_chosen_that_make_the_line_regular():
    robot = five_bar()
    start = assemble(robot, START).q
    for mode in working_modes(robot, GOAL).modes:
        chosen = choose_joint_path(robot, start, mode.q)
        assert chosen.joints == ELBOWS
        plan = plan_crossing(robot, chosen, duration=1.5)
        end = plan.configuration(plan.duration)
        np.testing.assert_allclose(np.exp(1j * end), np.exp(1j * mode.q), atol=1e-8)  # but for whole turns


@pytest.mark.slow
@pytest.mark.parametrize(("name", "modes"), [("spherical_rrr", 2), ("humanoid_ankle", 2), ("agile_eye", 1)])
def test_legs_of_spatial_robots_flip(name, modes):
    robot = robots.load(name, flexibility="rigid")
    found = 0
    for mode in working_modes(robot, robot.reference.x).modes:
        if np.abs(np.exp(1j * mode.q) - np.exp(1j * robot.reference.q)).max() < 1e-6:
            continue
        try:
            chosen = choose_joint_path(robot, robot.reference.q, mode.q)
        except NoAnswer:
            continue
        plan = plan_crossing(robot, chosen, duration=2.0)
        end = plan.configuration(plan.duration)
        np.testing.assert_allclose(np.exp(1j * end), np.exp(1j * mode.q), atol=1e-7)
        defect = defects_of(plan)
        assert max(defect.open, defect.acceleration, defect.force) < 1e-7
        found += 1
        if found == modes:
            return
    pytest.fail(f"{found} modes reached")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "motors", "goal"),
    [
        ("delta", ["motor_1", "motor_2"], [0.1, 0.05, -1.2]),
        ("orthoglide", ["slide_2"], [0.05, 0.0, 0.02]),
        ("par4", ["motor_1"], [0.05, 0.05, -0.85, 1.0]),
    ],
)
def test_legs_flip_where_they_are_stretched(name, motors, goal):
    """No line in joints leads there; the platform goes out to a fold of each leg and back."""
    robot = robots.load(name, flexibility="rigid")
    unflipped = assemble(robot, goal).q
    chosen = flip_legs(robot, robot.reference.q, unflipped, motors)
    plan = plan_crossing(robot, chosen, duration=3.0)
    end = plan.configuration(plan.duration)
    turned = np.exp(1j * (end - unflipped))[robot.actuated]
    moved = [other for other, turn in zip(robot.actuator_names, turned, strict=True) if abs(turn - 1) > 1e-6]
    assert moved == motors
    placements = [frame_of(robot, q) for q in (end, unflipped)]
    np.testing.assert_allclose(*placements, atol=1e-8)
    defect = defects_of(plan)
    assert max(defect.open, defect.acceleration, defect.force) < 1e-7


@pytest.mark.slow
def test_a_leg_flips_on_the_side_where_its_motor_keeps_its_limits():
    robot = robots.load("delta", flexibility="rigid")  # over the nearest fold arm 1 would turn to 6.5 rad
    start = robot.reference.q
    plan = plan_crossing(robot, flip_legs(robot, start, start, ["motor_1"]), duration=2.0)
    poses = plan.configuration(np.linspace(0.0, plan.duration, 101))
    assert not shares_beyond_limits(robot.limits, poses).any()


def frame_of(robot, q):
    """The platform's frame, by pinocchio alone."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    return data.oMf[robot.model.getFrameId(robot.description.platform.frame)].homogeneous


def test_motors_are_no_joints_of_a_path():
    with pytest.raises(InvalidInput, match=r"left_motor has a motor.*left_elbow, right_elbow"):
        with_platform_joints(five_bar(), ["left_motor", "right_elbow"])
    with pytest.raises(InvalidInput, match="needs 2 different ones"):
        with_platform_joints(five_bar(), ["left_elbow", "left_elbow"])
    with pytest.raises(InvalidInput, match="elbow"):
        with_platform_joints(five_bar(), ["left_elbow", "elbow"])


def test_a_saved_plan_keeps_its_joints(tmp_path):
    plan = plan_crossing(five_bar(), elbows_flipped(), duration=1.5)
    save_plan(plan, tmp_path)
    again = load_plan(tmp_path)
    assert again.robot.axis_names == ELBOWS
    np.testing.assert_array_equal(again.torque(0.7), plan.torque(0.7))


def test_the_command_flips_the_legs_of_motors(capsys):
    line = ["--from", *map(str, START), "--to", *map(str, GOAL), "--duration", "1.5"]
    assert main(["plan", "five_bar", *line, "--to-mode", "left_motor", "right_motor", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["platform_joints"] == list(ELBOWS)
    assert [round(crossing["s"], 6) for crossing in document["crossings"]] == [0.675983]
    line[4:6] = line[1:3]
    assert main(["plan", "five_bar", *line, "--to-mode", "left_motor", "--json"]) == 0  # flips, and is back
    capsys.readouterr()
    assert main(["plan", "five_bar", *line, "--to-mode", "elbow"]) == 2
    assert "valid: left_motor, right_motor" in capsys.readouterr().err
