"""What a plan leaves out is worth what the fuller model's torques differ by."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import robots
from framework import NotConverged, ParallelRobot, plan_scene
from framework.fidelity.predicted_level import robot_at_level
from framework.model.description import LEVELS_BY_NAME, JointDynamics
from framework.planning import neglected_effects
from framework.planning.neglected_effects import ModelOnMotion
from tests.oracles import five_bar as oracle
from tests.robots.every_robot import RIGID, SCENES, asks_nothing, in_stages

TIMES = np.linspace(0.0, 1.5, 61)


def with_joints(name: str, **joints: JointDynamics) -> ParallelRobot:
    return ParallelRobot.from_description(replace(robots.load(name).description, joints=joints))


def test_springs_of_the_paper_s_robot_are_worth_what_the_closed_forms_say():
    plan = plan_scene(robots.load("five_bar"), "C", smoothness=4)
    rigid, drives, links = (
        oracle.torques(oracle.solve("C", flexibility, "deformed", 4), TIMES)
        for flexibility in ("rigid", "flexible_joints", "flexible_links")
    )
    of_links, of_joints = plan.neglected
    assert "left_rod, right_rod" in of_links.effect
    assert "left_drive, right_drive" in of_joints.effect
    # second order: the squares of shares near 1e-3
    assert of_links.torque == pytest.approx(np.abs(links - drives).max(), rel=0.02)
    assert of_joints.torque == pytest.approx(np.abs(drives - rigid).max(), rel=0.02)
    for effect in plan.neglected:
        assert effect.share == pytest.approx(effect.torque / max(plan.peak_torque.values()), rel=1e-3)


def test_the_fullest_plan_leaves_out_nothing():
    plan = plan_scene(robots.load("five_bar_heavy", flexibility="flexible_links"), "C")
    assert plan.neglected == ()


def test_nothing_is_computed_before_it_is_asked_for():
    plan = plan_scene(robots.load("five_bar"), "A")
    assert "neglected" not in vars(plan)
    assert plan.neglected is plan.neglected


def test_dry_friction_of_a_robot_with_one_motor_is_worth_its_power():
    """tau dtheta/dt = sum of f |dq/dt| over the joints without a motor: virtual work."""
    robot = with_joints(
        "slider_crank", **{name: JointDynamics(friction=0.3) for name in passive("slider_crank")}
    )
    plan = plan_scene(robot, "clear")
    (friction,) = (effect for effect in plan.neglected if "friction" in effect.effect)
    t = np.linspace(0.0, plan.duration, 20001)[1:-1]
    power = np.abs(plan.velocity(t)) @ np.where(robot.joint_friction > 0, robot.joint_friction, 0.0)
    speed = np.abs(plan.motor_angle(t, 1)[:, 0])
    moving = speed > 1e-3 * speed.max()
    assert friction.torque == pytest.approx(float((power / speed)[moving].max()), rel=1e-3)
    assert friction.motor == robot.actuator_names[0]


def passive(name: str) -> list[str]:
    robot = robots.load(name)
    return [robot.coordinates.name_of(int(column)) for column in robot.passive]


def test_dry_friction_through_a_crossing_is_worth_what_a_constant_torque_is():
    """A soft spring far from rest gives the elbow, which turns one way, the torque that friction would."""
    size, soft = 0.01, 1e-9
    once = {"times": [0.95], "speeds": [1.1]}
    rubbing = plan_scene(with_joints("five_bar", left_elbow=JointDynamics(friction=size)), "C", **once)
    k = rubbing.robot.coordinates.names.index("left_elbow")
    turned = rubbing.robot.coordinates.positions(rubbing.dynamics.configuration(TIMES))[:, k]
    way = np.sign(turned[-1] - turned[0])
    assert np.all(way * np.diff(turned)[1:-1] > 0.0)
    spring = JointDynamics(stiffness=soft, rest=-way * size / soft)
    pulled = plan_scene(with_joints("five_bar", left_elbow=spring), "C", **once)
    (friction,) = (effect for effect in rubbing.neglected if "friction" in effect.effect)
    inside = TIMES[1:-1]
    expected = np.abs(pulled.torque(inside) - rubbing.torque(inside)).max()
    assert friction.torque == pytest.approx(expected, rel=0.01)


def rubbing_elbow():
    robot = with_joints("five_bar", left_elbow=JointDynamics(friction=0.01))
    return plan_scene(robot, "C", times=[0.95], speeds=[1.1]).dynamics


def test_a_pole_is_no_torque_with_friction_either():
    """Of the law through the condition without friction, and of that through the one with it."""
    dynamics = rubbing_elbow()
    smooth = ModelOnMotion.of(dynamics, dynamics.robot)
    rough = replace(smooth, friction=dynamics.robot.joint_friction)
    known = smooth.known_deflections()
    assert np.isfinite(rough.torque(rough.compute_pass(known))).all()
    with pytest.raises(NotConverged, match="pole"):
        rough.torque(smooth.compute_pass(known))
    with pytest.raises(NotConverged, match="pole"):
        smooth.torque(rough.compute_pass(known))


def test_a_corrected_law_that_turns_back_is_none():
    dynamics = rubbing_elbow()
    much = ModelOnMotion.of(dynamics, dynamics.robot, friction=100.0 * dynamics.robot.joint_friction)
    with pytest.raises(NotConverged, match="the corrected law turns back"):
        much.compute_pass(much.known_deflections())


def test_two_crossings_do_not_meet_one_singular_point():
    dynamics = plan_scene(robots.load("slider_crank"), "full_turn").dynamics
    fuller = ModelOnMotion.of(dynamics, dynamics.robot)
    assert len(fuller.searched.points) > 1
    fewer = replace(fuller, searched=fuller.searched._replace(points=fuller.searched.points[:1]))
    fuller.compute_pass(fuller.known_deflections())
    with pytest.raises(NotConverged, match="same singular point"):
        fewer.compute_pass(fuller.known_deflections())


def test_another_model_on_the_motion_needs_what_its_own_plan_does():
    """Masses, and springs of the deformed robot, on the motion of the payload alone."""
    whole = robots.load("five_bar_heavy").description
    for name, geometry, smoothness in (("rigid", "rigid", 2), ("elastic_inertia", "deformed", 4)):
        model = robot_at_level(whole, LEVELS_BY_NAME[name])
        payload, own = (
            plan_scene(robot, "C", smoothness=smoothness)
            for robot in (robot_at_level(whole, LEVELS_BY_NAME["payload"]), model)
        )
        needed = ModelOnMotion.of(payload.dynamics, model).resolve(geometry)
        np.testing.assert_allclose(needed.torque(TIMES), own.torque(TIMES), rtol=0, atol=1e-8)


def test_inertia_of_the_elastic_motion_is_worth_what_the_plan_with_it_needs_more():
    whole = robots.load("five_bar_heavy", flexibility="flexible_links")
    still, full = (plan_scene(replace(whole, elastic_inertia=felt), "C") for felt in (False, True))
    (inertia,) = still.neglected
    assert inertia.effect == "inertia of the elastic motion"
    needed = np.abs(full.torque(TIMES) - still.torque(TIMES)).max()
    assert inertia.torque == pytest.approx(needed, rel=0.05)


def test_what_a_reader_left_out_comes_last_and_has_no_number():
    description = replace(robots.load("five_bar").description, left_out=("a tendon: 3 N",))
    plan = plan_scene(ParallelRobot.from_description(description), "A")
    assert plan.neglected[-1] == ("a tendon: 3 N", None, "", None)
    shares = [effect.share for effect in plan.neglected[:-1]]
    assert shares == sorted(shares, reverse=True)


CROSSED = [(name, scene) for name, scene in SCENES if not asks_nothing(RIGID[name].description.scenes[scene])]


@pytest.mark.parametrize("case", in_stages(CROSSED, at_once=lambda case: case == ("five_bar_heavy", "C")))
def test_deformed_geometry_is_worth_what_the_deformed_plan_needs_more(case):
    name, scene = case
    robot = robots.load(name, flexibility="flexible_links")
    deformed = plan_scene(robot, scene)
    assert robot.n_e
    timing = {
        "times": [crossing.time for crossing in deformed.crossings] or None,
        "speeds": [crossing.speed for crossing in deformed.crossings] or None,
        "geometry": "rigid",
    }
    undeformed = plan_scene(robot, scene, **timing)
    t = np.linspace(0.0, deformed.duration, 501)
    needed = np.abs(deformed.torque(t) - undeformed.torque(t)).max() / max(undeformed.peak_torque.values())
    found = max((effect.share for effect in undeformed.neglected if "geometry" in effect.effect), default=0.0)
    assert found == pytest.approx(needed, rel=0.05, abs=1e-9)


def test_what_nothing_holds_is_over_the_smallest_gear(monkeypatch):
    """A moment on an idle ball that some motor must bear: at most the moment over the least gear ratio."""
    monkeypatch.setattr(neglected_effects, "driven_turns", lambda robot: [])
    robot = SimpleNamespace(
        gear_ratio=np.array([50.0, -2.0, 10.0]),
        structure=SimpleNamespace(idle=np.array([4])),
        coordinates=SimpleNamespace(turn_name=lambda column: f"joint {column}"),
    )
    dynamics = SimpleNamespace(robot=robot, certificate=SimpleNamespace(max_held_torque=6.0))
    (effect,) = neglected_effects._idle_turn_effects(dynamics, np.full(3, 30.0))
    assert (effect.torque, effect.share) == (3.0, pytest.approx(0.1))
    assert "joint 4" in effect.effect
