"""A robot moved by hand keeps its loops closed, and stops where its geometry ends."""

import numpy as np
import pytest

import robots
from framework import InvalidInput, ParallelRobot, assemble
from framework.kinematics.closures import loop_equations
from framework.kinematics.continuation.forward_kinematics import motors_are_free
from framework.kinematics.frames import frames_at
from framework.singularity.jogging import (
    describe_jogged_pose,
    drag_platform,
    loose_motion,
    move_motor,
    move_platform,
)
from tests.singularity.test_drawn_locus import LINK, MOTORS, elbows

ROBOT = "five_bar"


def gap(robot, q) -> float:
    return float(np.abs(loop_equations(robot.rows, frames_at(robot, q[None])).residual).max())


def test_the_platform_goes_where_it_is_led_and_back(robot):
    start = assemble(robot)
    there = move_platform(robot, start.q, 0, -0.05)
    assert there.stopped == ""
    np.testing.assert_allclose(there.x, [-0.05, start.x[1]], atol=1e-12)
    back = move_platform(robot, there.q, 0, float(start.x[0]))
    np.testing.assert_allclose(back.q, start.q, atol=1e-9)
    assert max(gap(robot, there.q), gap(robot, back.q)) < 1e-12


def test_the_platform_is_led_across_a_singularity_and_g_changes_sign(robot):
    above = move_platform(robot, assemble(robot).q, 0, 0.0)
    on = move_platform(robot, above.q, 1, float(np.sqrt(0.06)))  # where the rods lie in line
    below = move_platform(robot, on.q, 1, 0.22)
    assert (above.level, on.level) == ("regular", "singular")
    assert "Type 2" in on.verdict
    assert not on.verdict.startswith("near ")
    beside = move_platform(robot, above.q, 1, float(np.sqrt(0.06)) + 3e-3)
    assert beside.level == "near"
    assert beside.verdict == f"near a {on.verdict.split(':')[0]}"
    assert abs(on.g) == pytest.approx(on.smallest, abs=1e-12)
    assert abs(on.g) < 1e-9
    assert above.g * below.g < 0
    assert abs(on.twist[1]) == pytest.approx(1.0)  # t_s = (0, 1), the paper's case C
    assert below.stopped == ""


def test_the_platform_stops_where_a_leg_is_stretched(robot):
    start = move_platform(robot, assemble(robot).q, 0, 0.0)
    edge = move_platform(robot, start.q, 1, 2.0)
    reach = np.linalg.norm(edge.x - MOTORS, axis=1).max()
    assert reach == pytest.approx(2 * LINK, abs=1e-5)
    assert "Type 1" in edge.stopped
    assert "motor" in edge.stopped
    assert edge.level != "regular"
    assert edge.kind == "type_1"
    assert gap(robot, edge.q) < 1e-9


def test_a_motor_moves_alone(robot):
    start = describe_jogged_pose(robot, assemble(robot).q)
    there = move_motor(robot, start.q, 0, float(start.motors[0]) + 0.1)
    np.testing.assert_allclose(there.motors, start.motors + np.array([0.1, 0.0]), atol=1e-12)
    assert gap(robot, there.q) < 1e-12


def test_a_motor_stops_where_the_rods_lie_in_line(robot):
    # outward, the elbows part until they are two rods apart: a Type 2 singularity, and no way on
    start = describe_jogged_pose(robot, assemble(robot).q)
    apart = move_motor(robot, start.q, 0, float(start.motors[0]) + 3.0)
    assert "Type 2" in apart.stopped
    assert apart.level != "regular"
    left, right = elbows(apart.x)
    assert np.linalg.norm(left - right) == pytest.approx(2 * LINK, abs=1e-7)
    assert gap(robot, apart.q) < 1e-9
    again = move_motor(robot, apart.q, 0, float(start.motors[0]) + 3.0)
    np.testing.assert_array_equal(again.q, apart.q)
    back = move_motor(robot, again.q, 0, float(start.motors[0]))
    np.testing.assert_allclose(back.q, start.q, rtol=0, atol=1e-9)


def test_redundant_motors_cannot_move_one_by_one():
    robot = robots.load("standing_quadruped")
    assert not motors_are_free(robot)
    with pytest.raises(InvalidInput, match="12 motors drive 6 degrees of freedom"):
        move_motor(robot, assemble(robot).q, 0, 0.1)


@pytest.mark.parametrize("name", ["three_rpr", "delta", "gough_stewart", "agile_eye"])
def test_other_robots_follow_each_of_their_sliders(name):
    robot = robots.load(name)
    start = describe_jogged_pose(robot, assemble(robot).q)
    for move, values in ((move_platform, start.x), (move_motor, start.motors)):
        for index, value in enumerate(values):
            pose = move(robot, start.q, index, float(value) + 0.02 * min(robot.length, 1.0))
            assert pose.stopped == ""
            assert gap(robot, pose.q) < 1e-9 * max(robot.length, 1.0)


@pytest.mark.parametrize(
    ("index", "value", "complaint"),
    [(2, 0.1, "index"), (-1, 0.1, "index"), (0, np.nan, "value"), (0, np.inf, "value")],
)
def test_what_cannot_be_right_is_refused(robot, index, value, complaint):
    for move in (move_platform, move_motor):
        with pytest.raises(InvalidInput, match=complaint):
            move(robot, assemble(robot).q, index, value)


def test_only_closed_loops_are_moved(robot):
    open_loops = assemble(robot).q + 0.1
    for q in (open_loops, open_loops[:-1], open_loops * np.nan):
        with pytest.raises(InvalidInput, match=r"^q(: the loops|, all joints of five_bar, must be)"):
            move_platform(robot, q, 0, 0.1)


def test_what_is_moved_by_hand_stays_within_the_limits_of_the_urdf(write_robot, robot):
    column = robot.model.joints[robot.model.getJointId("left_elbow")].idx_q
    start = describe_jogged_pose(robot, assemble(robot).q)
    low, high = start.q[column] - 0.1, start.q[column] + 0.1
    any_turn = 'lower="-6.28" upper="6.28" effort="0"'  # the left elbow is the first without a motor
    limited = ParallelRobot.from_file(
        write_robot(urdf=((any_turn, f'lower="{low}" upper="{high}" effort="0"'),))
    )
    ways = [
        *(move_platform(limited, start.q, 1, float(start.x[1]) + step) for step in (0.05, -0.05)),
        drag_platform(limited, start.q, np.array([start.x[0] - 0.05, start.x[1] - 0.05, 0.0])),
        *(move_motor(limited, start.q, 0, float(start.motors[0]) + turn) for turn in (0.4, -0.4)),
    ]
    for pose in ways:
        assert low <= pose.q[column] <= high
        assert gap(robot, pose.q) < 1e-9
    stopped = [pose for pose in ways if "limit in the URDF" in pose.stopped]
    assert len(stopped) >= 3
    for pose in stopped:  # as far as it could: halving the way leaves less than a hundredth of it
        assert min(pose.q[column] - low, high - pose.q[column]) < 0.01
        assert "left_elbow" in pose.stopped


def test_on_the_locus_the_platform_moves_along_t_s_and_the_motors_by_the_square_of_it(robot):
    middle = move_platform(robot, assemble(robot).q, 0, 0.0)
    on = move_platform(robot, middle.q, 1, float(np.sqrt(0.06)))
    travel = []
    for way in (0.04, 0.02, 0.01):
        loose = loose_motion(robot, on, shift=way)
        assert loose.shift == pytest.approx(way * robot.length)
        np.testing.assert_allclose(loose.q[4], on.q, atol=1e-12)
        assert max(gap(robot, q) for q in loose.q) < 1e-9
        for share, q in zip((-1.0, 1.0), (loose.q[0], loose.q[-1]), strict=True):
            assert describe_jogged_pose(robot, q).x[1] == pytest.approx(
                np.sqrt(0.06) + share * loose.shift * on.twist[1]
            )
        travel.append(loose.motors.max())
    np.testing.assert_allclose(np.diff(np.log2(travel)), -2.0, atol=0.05)
