"""Laws of geometry and of Lagrange, for the robots whose own tests have a closed form of them."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pytest

import robots
from framework import (
    Condition,
    CrossingPlan,
    Law,
    UnboundedTorque,
    assemble,
    inverse_dynamics,
    locate_singularities,
    plan_scene,
    velocity_matrices,
)
from framework.kinematics.frames import frames_at
from framework.laws.path import Path
from framework.model.description import FLEXIBILITIES
from framework.planning.scenes import scene_path
from tests.oracles.closed_form import Crossing, Kinematics
from tests.oracles.one_degree import crossing as lagrange_crossing
from tests.oracles.one_degree import instants
from tests.oracles.planar_work import assert_virtual_work
from tests.robots import (
    test_agile_eye,
    test_biglide,
    test_delta,
    test_delta_hinges,
    test_diamond,
    test_four_bar,
    test_gough_stewart,
    test_humanoid_ankle,
    test_humanoid_knee,
    test_orthoglide,
    test_par4,
    test_slider_crank,
    test_spherical_rrr,
    test_three_rpr,
    test_three_rrr,
    test_three_upu,
)

KINEMATICS: dict[str, Kinematics] = {
    "agile_eye": test_agile_eye.KINEMATICS,
    "biglide": test_biglide.KINEMATICS,
    "delta": test_delta.KINEMATICS,
    "delta_hinges": test_delta_hinges.KINEMATICS,
    "diamond": test_diamond.KINEMATICS,
    "gough_stewart": test_gough_stewart.KINEMATICS,
    "humanoid_ankle": test_humanoid_ankle.KINEMATICS,
    "humanoid_knee": test_humanoid_knee.KINEMATICS,
    "orthoglide": test_orthoglide.KINEMATICS,
    "par4": test_par4.KINEMATICS,
    "slider_crank": test_slider_crank.KINEMATICS,
    "spherical_rrr": test_spherical_rrr.KINEMATICS,
}
CROSSINGS: dict[str, Crossing] = {
    "delta": test_delta.CROSSING,
    "diamond": test_diamond.CROSSING,
    "gough_stewart": test_gough_stewart.CROSSING,
    "orthoglide": test_orthoglide.CROSSING,
    "par4": test_par4.CROSSING,
    "spherical_rrr": test_spherical_rrr.CROSSING,
}
CLEAR = {  # motor torques of Lagrange, along scenes that meet no singularity
    ("agile_eye", "orient"): test_agile_eye.motor_torques,
    ("agile_eye", "sweep"): test_agile_eye.motor_torques,
    ("delta_hinges", "pick"): test_delta_hinges.motor_torques,
    ("delta_hinges", "pick-mirrored"): test_delta_hinges.motor_torques,
    ("three_upu", "across"): test_three_upu.motor_torques,
    ("three_upu", "around"): test_three_upu.motor_torques,
}
LINKAGES = {"four_bar": test_four_bar, "slider_crank": test_slider_crank}  # of one freedom, in sixty digits
PLANAR = {"three_rpr": test_three_rpr, "three_rrr": test_three_rrr}  # three legs, whose lines may meet


class Unprepared(NamedTuple):
    """A scene that meets Type 2 without condition (8)."""

    scene: str
    s: Callable[[Path], float] | None = None  # of the singular point of the rigid robot
    flexibilities: tuple[str, ...] = ("rigid",)  # springs behind drives and in rods, of robots of each kind
    behind_drives: float = 1e-12  # of s, where the drives are elastic
    options: Mapping[str, Any] = MappingProxyType({})


DRIVES, RODS = ("rigid", "flexible_joints"), ("rigid", "flexible_links")
# deflections with a pole are not resolved
LOOSELY = {"behind_drives": 1e-9, "flexibilities": DRIVES}
UNPREPARED = {
    "biglide": Unprepared("unprepared", lambda path: test_biglide.CROSSING, **LOOSELY),
    "bricard": Unprepared("dead_point", None, RODS, options={"times": []}),
    "four_bar": Unprepared(
        "unprepared", lambda path: (1.4 - test_four_bar.dead_points()[0]) / 1.8, **LOOSELY
    ),
    "humanoid_knee": Unprepared("unprepared", None, DRIVES),
    "slider_crank": Unprepared("unprepared", lambda path: (1.0 - test_slider_crank.OUTER) / 1.8, **LOOSELY),
    "three_rpr": Unprepared("crossing", test_three_rpr.closed_form_crossing, RODS, options={"times": []}),
    "three_rrr": Unprepared("crossing", test_three_rrr.closed_form_crossing, options={"times": []}),
    **{name: Unprepared(known.unprepared, known.s) for name, known in CROSSINGS.items()},
    "delta": Unprepared(test_delta.CROSSING.unprepared, test_delta.CROSSING.s, FLEXIBILITIES),
}


@pytest.fixture(params=CROSSINGS, scope="module")
def plan(request) -> CrossingPlan:
    return plan_scene(robots.load(request.param), CROSSINGS[request.param].scene)


@pytest.mark.parametrize("name", KINEMATICS)
def test_motors_have_their_closed_form(name):
    robot, known = robots.load(name), KINEMATICS[name]
    for x in known.places:
        motors = robot.actuated_coordinates(assemble(robot, x).q[None])[0]
        np.testing.assert_allclose(motors, known.motors(x), rtol=0, atol=known.motors_within)


@pytest.mark.parametrize("name", ["delta", "delta_hinges", "orthoglide"])
def test_a_platform_that_only_parallelograms_hold_stays_level(name):
    robot = robots.load(name)
    for x in KINEMATICS[name].places:
        at = frames_at(robot, assemble(robot, x).q[None])
        np.testing.assert_allclose(at.position[0, 0], x, atol=1e-13)
        np.testing.assert_allclose(at.rotation[0, 0], np.eye(3), atol=1e-12)


@pytest.mark.parametrize("name", KINEMATICS)
def test_A_and_B_have_their_closed_form(name):
    robot, known = robots.load(name), KINEMATICS[name]
    for x in known.places:
        A, B, _ = velocity_matrices(robot, assemble(robot, x).q)
        np.testing.assert_allclose(np.linalg.solve(B, A), known.rates(x), atol=known.rates_within)


@pytest.mark.parametrize("name", PLANAR)
def test_A_and_B_are_those_of_three_lines_up_to_the_choice_of_rows(name):
    robot, known = robots.load(name), PLANAR[name]
    for x in known.PLACES:
        ours, (A, B) = velocity_matrices(robot, assemble(robot, x).q), known.matrices(x)
        np.testing.assert_allclose(ours.B, ours.A @ np.linalg.inv(A) @ B, atol=1e-12)


@pytest.mark.parametrize("name", PLANAR)
def test_the_singular_point_is_where_three_lines_meet_and_torques_do_the_work_of_all_masses(name):
    robot, known = robots.load(name), PLANAR[name]
    path = scene_path(robot.description.scenes["crossing"])
    (point,) = locate_singularities(robot, path)
    assert point.s == pytest.approx(known.closed_form_crossing(path), abs=1e-12)
    assert (point.kind, point.contact, point.corank) == ("type_2", "transversal", 1)
    x = path(point.s)
    px, py = (float(v) for v in known.meeting_point(x))
    twist = np.array([py - x[1], x[0] - px, 1.0])  # a turn about the meeting point
    twist /= np.hypot(*twist[:2])
    np.testing.assert_allclose(point.twist, twist * np.sign(twist @ point.twist), atol=known.TWIST_WITHIN)
    np.testing.assert_allclose(known.matrices(x)[0] @ point.twist, 0, atol=1e-12)
    assert not locate_singularities(robot, scene_path(robot.description.scenes["clear"]))
    plan = plan_scene(robot, "crossing")
    assert_virtual_work(plan, known.bodies, known.GEAR, known.WORK_WITHIN)
    assert plan.certificate.tail < 1e-9
    assert plan.certificate.monotone


@pytest.mark.parametrize(("name", "scene"), CLEAR)
def test_torques_where_nothing_is_singular_satisfy_lagrange(name, scene):
    plan = plan_scene(robots.load(name), scene)
    assert not plan.crossings
    assert plan.certificate.tail < (1e-12 if name == "three_upu" else 1e-9)
    for t in np.linspace(0.0, plan.duration, 13):
        expected = CLEAR[name, scene](*(plan.platform(t, order) for order in range(3)))
        np.testing.assert_allclose(plan.torque(t), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["standing_quadruped", "two_arms"])
def test_redundant_motors_leave_no_singularity_on_the_scenes(name):
    robot = robots.load(name)
    for scene in robot.description.scenes.values():
        assert locate_singularities(robot, scene_path(scene)) == ()


@pytest.mark.parametrize("name", LINKAGES)
def test_torque_of_a_linkage_agrees_with_lagrange_at_its_dead_point_too(name):
    known = LINKAGES[name]
    plan = plan_scene(robots.load(name), known.CROSSED)
    exact = lagrange_crossing(known.linkage(), near=known.NEAR, smoothness=2, **known.SCENE)
    assert plan.crossings[0].s == pytest.approx(float(exact.s), abs=1e-14)
    assert plan.crossings[0].residual < 1e-12
    assert plan.certificate.tail < 1e-9
    times = instants(known.SCENE["duration"], known.SCENE["time"])
    expected = [exact.torque(t) for t in times]
    np.testing.assert_allclose(plan.torque(times)[:, 0], expected, rtol=0, atol=1e-10)  # of 0.01 N m


@pytest.mark.parametrize("name", LINKAGES)
def test_torque_and_deflection_behind_an_elastic_drive_agree_with_lagrange(name):
    known = LINKAGES[name]
    plan = plan_scene(robots.load(name, flexibility="flexible_joints"), known.CROSSED)
    exact = lagrange_crossing(known.linkage(), near=known.NEAR, smoothness=4, **known.SCENE)
    times = instants(known.SCENE["duration"], known.SCENE["time"], 6)
    torque, deflection = np.transpose([exact.torque_behind_spring(t, known.STIFFNESS) for t in times])
    np.testing.assert_allclose(plan.torque(times)[:, 0], torque, rtol=0, atol=1e-10)
    np.testing.assert_allclose(plan.deflection(times)[:, 0], deflection, rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", CROSSINGS)
def test_singular_point_and_twist_are_those_of_the_lines(name):
    robot, known = robots.load(name), CROSSINGS[name]
    path, clear = (scene_path(robot.description.scenes[scene]) for scene in (known.scene, known.clear))
    (point,) = locate_singularities(robot, path)
    assert (point.kind, point.contact, point.corank) == ("type_2", "transversal", 1)
    assert point.s == pytest.approx(known.s(path), abs=1e-12)
    values = np.linalg.svd(known.lines(point.platform), compute_uv=False)
    assert values[-1] < 1e-12 < 0.1 < values[-2]
    twist = known.twist(point.platform)
    twist *= np.sign(twist @ point.twist)
    np.testing.assert_allclose(point.twist, twist, rtol=0, atol=known.twist_within)
    assert not locate_singularities(robot, clear)


def test_torques_satisfy_lagrange_at_all_instants(plan):
    (crossing,), known = plan.crossings, CROSSINGS[plan.robot.name]
    for t in np.append(np.linspace(0.0, plan.duration, 17), crossing.time):
        x, dx, ddx = (plan.platform(t, k) for k in range(3))
        force, rates = known.force(x, dx, ddx), known.rates(x)
        pushed = rates.T @ (known.gear * plan.torque(t))
        np.testing.assert_allclose(pushed, force, rtol=0, atol=known.force_within(force))
        if known.torque_within is not None and abs(t - crossing.time) > known.away:
            torque = np.linalg.solve(rates.T, force) / known.gear
            np.testing.assert_allclose(plan.torque(t), torque, rtol=0, atol=known.torque_within(torque))


def test_condition_8_is_the_virtual_power_of_the_free_motion(plan):
    """Lagrange's force on the platform does no work along the motion that locked motors allow."""
    (crossing,), known = plan.crossings, CROSSINGS[plan.robot.name]
    x, dx, ddx = (plan.platform(crossing.time, k) for k in range(3))
    force, free = known.force(x, dx, ddx), np.linalg.svd(known.rates(x))[2][-1]
    within = known.power or known.power_within * np.linalg.norm(force)
    assert abs(force @ free) < within
    platform, n = plan.robot.platform, plan.robot.n
    twists, _ = platform.twist(np.tile(x, (n, 1)), np.eye(n))  # of each coordinate's rate
    assert abs(force @ np.linalg.solve(twists.T, crossing.twist)) < within


def test_a_share_of_the_acceleration_is_not_enough(plan):
    """Through the right point at the right time, but too slowly turning."""
    (crossing,), known = plan.crossings, CROSSINGS[plan.robot.name]
    values = (crossing.s, crossing.speed, known.share * crossing.acceleration)
    wrong = [Condition(crossing.time, order, value) for order, value in enumerate(values)]
    with pytest.raises(UnboundedTorque):
        inverse_dynamics(plan.robot, plan.path, Law.rest_to_rest(plan.duration, 2, wrong))


@pytest.mark.parametrize(
    ("name", "flexibility"), [(name, one) for name, case in UNPREPARED.items() for one in case.flexibilities]
)
def test_a_law_without_condition_8_gets_no_torques(name, flexibility):
    case, robot = UNPREPARED[name], robots.load(name, flexibility=flexibility)
    with pytest.raises(UnboundedTorque, match=r"t_s \. W_p = ") as caught:
        plan_scene(robot, case.scene, **case.options)
    if case.s is not None and flexibility != "flexible_links":  # elastic links move the singular point
        s = case.s(scene_path(robot.description.scenes[case.scene]))
        within = 1e-12 if flexibility == "rigid" else case.behind_drives
        assert caught.value.s == pytest.approx(s, abs=within)
