"""Plans that begin on the way of others, and chains of plans as one motion."""

import numpy as np
import pytest

import robots
from framework import (
    Arc,
    InvalidInput,
    Line,
    chain_plans,
    inverse_dynamics,
    load_plan,
    plan_crossing,
    simulate,
)
from framework.cli.plan import plan_lines
from framework.control import reference_of
from framework.dynamics.drive_limits import DriveLimits
from framework.files.trajectory_file import joint_trajectory
from framework.planning.chain import DepartingCurve, envelop_drives
from framework.planning.scenes import scene_path
from framework.show.report import _law_html
from tests.oracles.equations_of_motion import defects_of

PATH = Line([0.1, 0.345], [-0.05, 0.195])
PUSH = [[s, 0.0, -1.0 - s, 0.0, 0.0, 0.0, 0.0] for s in (0.0, 0.5, 1.0)]  # rows of s, force and moment
SEAM = 1e-9  # [N m] that a torque may jump


def five_bar(flexibility: str = "rigid"):
    return robots.load("five_bar", flexibility=flexibility)


@pytest.mark.parametrize("flexibility", ["rigid", pytest.param("flexible_joints", marks=pytest.mark.slow)])
def test_two_crossings_are_one_motion(flexibility):
    """Through the locus, on a curve back to the other side and through it again."""
    robot = five_bar(flexibility)
    first = plan_crossing(robot, PATH, duration=1.5, end_speed=0.4, law="polynomial")
    second = first.restart(1.3, [0.03, 0.32], duration=2.0)
    chain = chain_plans([first, second], [1.3])
    assert len(chain.crossings) == 2
    assert np.abs(second.torque(0.0) - first.torque(1.3)).max() < SEAM
    assert simulate(chain).tracking_error < 1e-9
    defect = defects_of(chain)
    assert max(defect.open, defect.acceleration, defect.force) < 1e-7


@pytest.mark.parametrize(
    "t", [pytest.param(0.1, marks=pytest.mark.slow), 0.5, pytest.param(1.0, marks=pytest.mark.slow)]
)
def test_the_rest_of_a_path_is_planned_anew_with_the_same_torques(t):
    plan = plan_crossing(five_bar(), PATH, duration=1.5, law="optimal")
    slower = plan.restart(t, duration=2.0 - t)
    for order in range(3):
        np.testing.assert_allclose(slower.platform(0.0, order), plan.platform(t, order), atol=1e-11)
    assert np.abs(slower.torque(0.0) - plan.torque(t)).max() < SEAM
    np.testing.assert_allclose(slower.platform(slower.duration), PATH(1.0), atol=1e-12)


def test_a_chain_answers_as_its_plans_do():
    plan = plan_crossing(five_bar(), PATH, duration=1.5)
    rest = plan.restart(0.5, duration=1.6)
    chain = chain_plans([plan, rest], [0.5])
    before, after = np.linspace(0.0, 0.499, 40), np.linspace(0.001, 1.6, 40)
    for quantity in ("torque", "motor_angle", "platform", "configuration"):
        of_chain, of_plan, of_rest = (getattr(each, quantity) for each in (chain, plan, rest))
        np.testing.assert_allclose(of_chain(before), of_plan(before), atol=1e-9)
        np.testing.assert_allclose(of_chain(0.5 + after), of_rest(after), atol=1e-9)
    assert chain.duration == pytest.approx(2.1)
    assert "a chain of 2 plans over 2.1 s" in repr(chain)
    assert "geometry: a chain of 2 plans over 2.1 s" in plan_lines(chain)[0]
    assert "It is a chain of 2 plans" in _law_html(chain)
    assert all("degree" in text for text in (repr(plan), plan_lines(plan)[0], _law_html(plan)))
    assert chain.crossings[0].time == pytest.approx(0.5 + rest.crossings[0].time)
    assert len(joint_trajectory(chain)["points"]) == 501
    reference = reference_of(chain, period=1e-2)
    np.testing.assert_allclose(reference.motion.v[50], plan.velocity(0.5), atol=1e-8)


def test_a_chain_is_saved_with_its_plans(tmp_path):
    """Its plans are a line, a curve to a goal and the rest of an arc; it is itself the path of a restart."""
    robot = five_bar()
    arc = plan_crossing(robot, Arc([0.1, 0.345], [0.05, 0.33], [0.0, 0.3]), duration=1.0)
    rest = arc.restart(0.4, duration=1.0, end_speed=0.3)
    onward = rest.restart(1.0, [-0.02, 0.25], duration=1.2, law="polynomial")
    chain = chain_plans([arc, rest, onward], [0.4, 1.0])
    slower = chain.restart(0.6, duration=3.0)
    for plan in (rest, onward, chain, slower):
        plan.save(tmp_path)
        loaded = load_plan(tmp_path)
        t = np.linspace(0.0, plan.duration, 31)
        np.testing.assert_allclose(loaded.torque(t), plan.torque(t), atol=1e-12)
        np.testing.assert_allclose(loaded.platform(t), plan.platform(t), atol=1e-14)
        assert loaded.request.torque_limit == plan.request.torque_limit


def test_a_chain_has_limits_that_each_of_its_plans_keeps():
    """Every plan keeps its own; the motion of both keeps the larger one of each motor."""
    plan = plan_crossing(five_bar(), PATH, duration=1.5, torque_limit=[0.5, 0.3], margin=0.1)
    rest = plan.restart(0.5, duration=1.6, torque_limit=[0.2, 0.4])
    chain = chain_plans([plan, rest], [0.5])
    np.testing.assert_allclose(chain.request.torque_limit, [0.45, 0.4])
    assert chain_plans([plan, plan.restart(0.5, duration=1.6)], [0.5]).request.torque_limit[0] is None


def test_what_a_drive_of_a_plan_admits_that_of_the_chain_admits_too():
    """Also torques that brake at speeds beyond the no-load speed of some plan."""
    random = np.random.default_rng(20261129)
    for _ in range(20):
        torque, corner = random.uniform(0.1, 3.0, (2, 3, 2))  # of three plans and two motors
        no_load = corner * random.uniform(1.01, 3.0, (3, 2))
        drives = [
            DriveLimits(*limits, torque[0], None) for limits in zip(torque, corner, no_load, strict=True)
        ]
        corner_speed, no_load_speed, _rms = envelop_drives(drives)
        assert np.all((corner_speed > 0.0) & (corner_speed < no_load_speed))
        chain = DriveLimits(torque.max(axis=0), corner_speed, no_load_speed, torque[0], None)
        T, w = random.uniform(-1.0, 1.0, (2, 4000, 2)) * np.array([3.0, 20.0])[:, None, None]
        admitted = [
            (np.abs(T) <= each.torque_limit) & (np.abs(each.curve_ratio(T, w)) <= 1.0)
            for each in (*drives, chain)
        ]
        assert np.any(admitted[:3], axis=0)[~admitted[3]].sum() == 0
    same = envelop_drives([drives[0], drives[0]])
    np.testing.assert_allclose(same[:2], [drives[0].corner_speed, drives[0].no_load_speed], rtol=1e-14)


def test_the_path_of_a_chain_is_one_motion_to_inverse_dynamics():
    """Computed anew along the chain's path, without the plans: other nodes, and no seam."""
    plan = plan_crossing(five_bar(), PATH, duration=1.5, end_speed=0.4)
    chain = chain_plans([plan, plan.restart(1.3, [0.05, 0.35], duration=2.0)], [1.3])
    anew = inverse_dynamics(chain.robot, chain.path, chain.law)
    t = np.linspace(0.0, chain.duration, 101)
    np.testing.assert_allclose(chain.torque(t), anew.torque(t), atol=1e-11)
    assert len(anew.crossings) == 2


def test_a_chain_of_balls_keeps_its_angles():
    robot = robots.load("gough_stewart", flexibility="rigid")
    x = robot.reference.x
    plan = plan_crossing(robot, Line(x, x + 0.02), duration=1.0, end_speed=0.5)
    chain = chain_plans([plan, plan.restart(1.0, x + 0.03, duration=1.0)])
    for t in (0.3, 0.999, 1.2, 1.9):
        step = 1e-6
        rate = (chain.motor_angle(t + step) - chain.motor_angle(t - step)) / (2.0 * step)
        np.testing.assert_allclose(rate, chain.motor_angle(t, 1), rtol=1e-5, atol=1e-5)
    assert simulate(chain).tracking_error < 1e-9


def test_paths_that_do_not_continue_the_motion_are_refused():
    plan = plan_crossing(five_bar(), PATH, duration=1.5)
    x, dx = plan.platform(0.5), plan.platform(0.5, 1)
    with pytest.raises(InvalidInput, match="the platform is at"):
        plan.restart(0.5, Line(x + 0.01, x), duration=1.0)
    with pytest.raises(InvalidInput, match="derivative of order 1"):
        plan.restart(0.5, Line(x, x + np.array([0.1, 0.0])), duration=1.0)
    with pytest.raises(InvalidInput, match="derivative of order"):
        plan.restart(0.5, Arc(x, x + 0.1 * dx + [1e-3, -1e-3], x + 0.2 * dx + [4e-3, -4e-3]), duration=1.0)
    with pytest.raises(InvalidInput, match="rests"):
        plan.restart(1.5, Line(PATH(1.0), PATH(0.0)), duration=1.0)
    with pytest.raises(InvalidInput, match="nothing is left"):
        plan.restart(1.5, duration=1.0)
    with pytest.raises(InvalidInput, match="t: must lie in"):
        plan.restart(2.0, duration=1.0)
    pushed = plan_crossing(five_bar(), PATH, duration=1.5, wrenches={"left_tip": PUSH})
    with pytest.raises(InvalidInput, match="wrenches: those of the plan depend on its s"):
        pushed.restart(0.5, duration=2.0)
    with pytest.raises(InvalidInput, match="start_speed"):
        plan.restart(0.5, duration=1.0, start_speed=0.3)


def test_plans_that_do_not_meet_are_no_chain():
    robot = five_bar()
    plan = plan_crossing(robot, PATH, duration=1.5)
    with pytest.raises(InvalidInput, match="the platform jumps by"):
        chain_plans([plan, plan])
    with pytest.raises(InvalidInput, match="a restart takes a path that starts at all digits"):
        plan.restart(0.5, Line(plan.platform(0.5) + 1e-7, [0.0, 0.2]), duration=1.0)
    corner = [0.08, 0.32]
    legs = [Line([0.1, 0.345], corner), Line(corner, [0.12, 0.3])]
    moving = [
        plan_crossing(robot, legs[0], duration=1.0, end_speed=0.5),
        plan_crossing(robot, legs[1], duration=1.0, start_speed=0.5),
    ]
    with pytest.raises(InvalidInput, match=r"order 1 of the platform jumps .*a corner is passed at rest"):
        chain_plans(moving)
    assert chain_plans([plan_crossing(robot, leg, duration=1.0) for leg in legs]).duration == 2.0
    with pytest.raises(InvalidInput, match="at least two"):
        chain_plans([plan])


@pytest.mark.slow
def test_springs_that_carry_masses_take_the_next_plan_up_without_a_jump():
    """They follow derivatives beyond those that torques contain: with four the torque jumps by 4e-6 N m."""
    robot = robots.load("biglide", flexibility="flexible_links")
    path = scene_path(robot.description.scenes["across"])
    plan = plan_crossing(robot, path, duration=1.0, end_speed=0.4, law="polynomial")
    rest = plan.restart(0.8, duration=0.3, law="polynomial")
    assert np.abs(rest.torque(0.0) - plan.torque(0.8)).max() < SEAM
    assert simulate(chain_plans([plan, rest], [0.8])).tracking_error < 1e-9


@pytest.mark.slow
def test_such_springs_are_taken_up_beside_a_crossing_too():
    """Where the law bends most: with eight derivatives the torque jumps by 2e-8 N m, with ten by 3e-11."""
    robot = robots.load("three_rpr", flexibility="flexible_links")
    path = scene_path(robot.description.scenes["crossing"])
    plan = plan_crossing(robot, path, duration=1.5, law="polynomial")
    t = plan.crossings[0].time - 0.055
    onward = plan.restart(t, np.add(path(1.0), [-0.018, 0.03, -0.035]), duration=1.5 - t)
    assert np.abs(onward.torque(0.0) - plan.torque(t)).max() < SEAM


@pytest.mark.parametrize("name", ["five_bar", "three_rpr"])
def test_a_curve_to_a_goal_stays_beside_the_straight_way_of_a_straight_motion(name):
    """The law takes what the motion does along its tangent: of a line, a curve on along this line remains."""
    robot = robots.load(name)
    x = robot.reference.x
    direction = robot.platform_scale * np.eye(robot.n)[0]
    motion = [x, *(rate * direction for rate in (0.5, 3.0, -40.0, 900.0, 2e4, 1e6, -1e7, 1e9))]
    curve = DepartingCurve.to_goal(robot, motion, x + 0.3 * direction)
    s = np.linspace(0.0, 1.0, 11)
    np.testing.assert_allclose(curve(s), x + 0.3 * s[:, None] * direction, atol=1e-12)
