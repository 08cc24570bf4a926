"""Dry friction of the motors: against the power balance, and in the limits of optimal laws."""

import json
from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import Line, NoLaw, ParallelRobot, load_plan, plan_crossing, simulate
from framework.cli import main
from framework.dynamics.motor_friction import PlannedFriction
from framework.model.description import JointDynamics
from framework.model.robot_file_writer import write_robot_file
from framework.planning.optimal.limit_curves import limit_curves
from framework.planning.optimal.peak_bound import bound_plan
from framework.planning.request import motor_peaks

LINE = Line([0.1, 0.345], [-0.05, 0.195])
BACK_AND_FORTH = {"duration": 1.5, "times": [1.0], "speeds": [1.5]}
FRICTION = {"left_motor": 1.5, "right_motor": 0.8}  # [N m], joint side
DAMPING = {"left_motor": 0.4, "right_motor": 0.3}  # [N m s/rad]


def rubbing(*, passive: float = 0.0, damped: bool = True) -> ParallelRobot:
    """The paper's five-bar, a payload on massless links, with friction and damping on its motors."""
    joints = {
        name: JointDynamics(friction=FRICTION[name], damping=DAMPING[name] * damped) for name in FRICTION
    }
    if passive:
        joints["left_elbow"] = JointDynamics(friction=passive)
    return ParallelRobot.from_description(replace(robots.load("five_bar").description, joints=joints))


@pytest.fixture(scope="module")
def polynomial():
    return plan_crossing(rubbing(), LINE, **BACK_AND_FORTH)


def test_the_motors_give_the_energy_and_what_friction_and_damping_take(polynomial):
    """torque . motor speed = d(energy)/dt + f |v| + D v^2, energy of 10 kg and the rotors, no gravity."""
    robot, t = polynomial.robot, np.linspace(0.01, 1.49, 301)
    dx, ddx = (polynomial.platform(t, order) for order in (1, 2))
    speed, acceleration = (polynomial.motor_angle(t, order) for order in (1, 2))
    v = speed / robot.gear_ratio
    power = (10.0 * dx * ddx).sum(axis=1) + (robot.rotor_inertia * speed * acceleration).sum(axis=1)
    power += np.abs(v) @ list(FRICTION.values()) + v**2 @ list(DAMPING.values())
    given = (polynomial.torque(t) * speed).sum(axis=1)
    np.testing.assert_allclose(given, power, atol=1e-9 * np.abs(power).max())


def test_friction_jumps_where_a_motor_reverses_and_is_nothing_at_a_standstill(polynomial):
    size = np.array(list(FRICTION.values())) / polynomial.robot.gear_ratio
    smooth, whole = polynomial.dynamics.torques, polynomial.torque
    np.testing.assert_array_equal(whole([0.0, 1.5]), smooth([0.0, 1.5]))
    t = np.linspace(0.0, 1.5, 20001)[1:-1]
    share, speed = whole(t) - smooth(t), polynomial.motor_angle(t, 1)
    surely = np.abs(speed) > 1e-6 * np.abs(speed).max()
    np.testing.assert_allclose(share[surely], (size * np.sign(speed))[surely], atol=1e-15)
    np.testing.assert_allclose(np.abs(share), np.broadcast_to(size, share.shape), rtol=1e-9)
    assert np.any(np.diff(np.sign(share), axis=0) != 0.0)  # one motor does reverse on this line


def test_peaks_with_friction_are_those_of_a_dense_sampling(polynomial):
    torque, _speed = motor_peaks(polynomial.dynamics)
    dense = np.abs(polynomial.torque(np.linspace(0.0, 1.5, 200001))).max(axis=0)
    np.testing.assert_allclose(torque, dense, rtol=1e-5)


def test_a_motor_that_reverses_rests_and_starts():
    """Ends in motion; speeds cos(t) (reverses twice) and max(0, t - 2) - max(0, 1 - t) (rests in [1, 2])."""

    def speed(t):
        return np.stack([np.cos(t), np.maximum(0, t - 2) - np.maximum(0, 1 - t)], axis=1)

    friction = PlannedFriction.from_speed(np.array([2.0, 3.0]), speed, 5.0)
    np.testing.assert_allclose(friction.instants[0], [-np.inf, np.pi / 2, 3 * np.pi / 2, np.inf], rtol=1e-14)
    np.testing.assert_array_equal(
        friction([0.0, 0.5, 1.5, 2.5, 4.8, 5.0]), [[2, -3], [2, -3], [2, 0], [-2, 3], [2, 3], [2, 3]]
    )
    np.testing.assert_array_equal(friction(0.5), [2, -3])
    assert PlannedFriction.from_speed(np.zeros(2), speed, 5.0) is None


def test_friction_of_other_joints_changes_nothing_but_is_named():
    plan = plan_crossing(rubbing(passive=0.2, damped=False), LINE, **BACK_AND_FORTH)
    plain = plan_crossing(rubbing(damped=False), LINE, **BACK_AND_FORTH)
    np.testing.assert_array_equal(plan.torque([0.3, 1.2]), plain.torque([0.3, 1.2]))
    assert plan.neglected_friction == "left_elbow 0.2 N m"


def test_the_simulated_robot_has_no_dry_friction_and_is_driven_without_it(polynomial):
    assert simulate(polynomial.robot, polynomial).tracking_error < 1e-9


LIMIT = 0.2  # [N m]


DRY = pytest.param(False, marks=pytest.mark.slow)


@pytest.fixture(scope="module", params=[DRY, True], ids=["dry", "dry and viscous"])
def quickest(request):
    return plan_crossing(rubbing(damped=request.param), LINE, optimize="time", torque_limit=LIMIT)


def test_an_optimal_law_keeps_and_reaches_its_limits_with_friction(quickest):
    t = np.linspace(0.0, quickest.duration, 40001)
    largest = np.abs(quickest.torque(t)).max()
    assert 0.98 * LIMIT < largest <= LIMIT
    options = {"optimize": "time", "torque_limit": LIMIT}
    other = plan_crossing(quickest.robot, LINE, friction="none", **options)
    rubbed = np.array(list(FRICTION.values())) / other.robot.gear_ratio
    t = np.linspace(0.0, other.duration, 40001)
    needed = other.torque(t) + rubbed * np.sign(other.motor_angle(t, 1))
    assert np.abs(needed).max() > 1.05 * LIMIT  # that law would need more than it may


@pytest.mark.slow
def test_the_least_peak_counts_friction():
    options = {"law": "optimal", "optimize": "peak_torque", "duration": 1.5}
    with_it, without = (plan_crossing(rubbing(), LINE, friction=one, **options) for one in ("driven", "none"))
    t = np.linspace(0.0, 1.5, 20001)
    rubbed = np.array(list(FRICTION.values())) / without.robot.gear_ratio
    of_other_law = np.abs(without.torque(t) + rubbed * np.sign(without.motor_angle(t, 1))).max()
    assert max(with_it.peak_torque.values()) < of_other_law * (1.0 + 1e-3)


def test_limit_curves_and_bound_count_friction_and_damping(quickest):
    curves = limit_curves(quickest)
    width = curves.highest_acceleration - curves.lowest_acceleration
    above = (curves.highest_acceleration - curves.acceleration) / width
    assert np.all((above > -1e-9) & (above < 1.0 + 1e-9))
    np.testing.assert_array_less(curves.speed, curves.highest_speed)
    assert np.mean(np.minimum(above, 1 - above) < 0.02) > 0.4  # along the edge but for smoothness
    bound = bound_plan(quickest).value
    assert 0.98 * quickest.duration < bound < quickest.duration


@pytest.mark.usefixtures("quick_figures")
def test_the_option_is_typed_and_saved(tmp_path, capsys):
    file = str(write_robot_file(rubbing(passive=0.2).description, tmp_path))
    for typed, named in (([], "left_elbow 0.2 N m"), (["--friction", "none"], "left_motor 1.5 N m")):
        out = tmp_path / f"plan{len(typed)}"
        assert main(["plan", file, "--scene", "A", *typed, "--out", str(out)]) == 0
        assert "left out" in capsys.readouterr().out
        saved = json.loads((out / "plan.json").read_text())
        assert saved["request"]["friction"] == (typed or ["driven"])[-1]
        assert named in saved["neglected_friction"]
        motion = np.genfromtxt(out / "motion.csv", delimiter=",", names=True)
        plan = load_plan(out)
        np.testing.assert_allclose(motion["torque_left_motor"], plan.torque(motion["time"])[:, 0], rtol=1e-9)


@pytest.mark.slow
def test_an_elastic_robot_counts_friction_too():
    description = rubbing(damped=False).description
    robot = ParallelRobot.from_description(description, flexibility="flexible_links")
    options = {"law": "optimal", "optimize": "peak_torque", "duration": 1.5}
    plan = plan_crossing(robot, LINE, **options)
    t = np.linspace(0.0, 1.5, 4001)[1:-1]
    rubbed = np.array(list(FRICTION.values())) / robot.gear_ratio
    share = plan.torque(t) - plan.dynamics.torques(t)
    speed = plan.motor_angle(t, 1)
    surely = np.abs(speed) > 1e-6 * np.abs(speed).max()
    np.testing.assert_allclose(share[surely], (rubbed * np.sign(speed))[surely], atol=1e-15)


@pytest.mark.slow
def test_a_motor_too_weak_to_hold_the_robot_is_refused_and_dry_friction_is_said_not_to_count():
    """The five-bar of the paper set upright, where its payload asks for more than the limit."""
    upright = replace(robots.load("five_bar").description, gravity=(0.0, -9.81, 0.0))
    for joints, said in (({}, False), ({"left_elbow": JointDynamics(friction=0.1)}, True)):
        robot = ParallelRobot.from_description(replace(upright, joints=joints))
        with pytest.raises(NoLaw, match="must hold") as caught:
            plan_crossing(robot, LINE, law="optimal", optimize="time", torque_limit=1e-3)
        assert ("dry friction, which may hold some of it, not counted" in str(caught.value)) is said
