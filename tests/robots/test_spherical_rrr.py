"""The spherical 3-RRR with short arcs against closed forms: unit vectors, Lagrange, integration."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

import robots
from framework import (
    Condition,
    Law,
    UnboundedTorque,
    assemble,
    inverse_dynamics,
    locate_singularities,
    plan_scene,
    velocity_matrices,
)
from framework.planning.scenes import scene_path
from tests.oracles.spherical import GEAR, Spherical

ORACLE = Spherical(np.pi / 3, (1, 1, 1))


@pytest.fixture(scope="module")
def robot():
    return robots.load("spherical_rrr")


@pytest.fixture(scope="module")
def plan(robot):
    return plan_scene(robot, "cross")


def places(count):
    return [-0.1, 0, -0.1] + 0.25 * np.random.default_rng(2).uniform(-1, 1, (count, 3))


def exact_singular_s(path):
    return brentq(lambda s: ORACLE.measure(path(s)), 0.1, 0.95, xtol=1e-15, rtol=1e-15)


def test_motor_angles_have_their_closed_form(robot):
    for x in places(20):
        q = assemble(robot, x).q
        np.testing.assert_allclose(q[robot.actuated], ORACLE.motor_angles(x), rtol=0, atol=1e-12)


def test_A_and_B_are_those_of_the_unit_vectors(robot):
    for x in places(10):
        A, B, _ = velocity_matrices(robot, assemble(robot, x).q)
        ours, theirs = np.linalg.solve(B, A), ORACLE.matrices(x)
        np.testing.assert_allclose(ours, np.linalg.solve(theirs[1], theirs[0]).real, atol=1e-11)


def test_singular_point_and_twist_are_those_of_the_distal_arcs(robot, plan):
    (point,) = locate_singularities(robot, plan.path)
    assert (point.kind, point.contact, point.corank) == ("type_2", "transversal", 1)
    assert point.s == pytest.approx(exact_singular_s(plan.path), abs=1e-12)
    # the planes of the arcs, of normals w x v, meet in a line: the camera may turn about it
    line = np.linalg.svd(ORACLE.matrices(point.platform)[0].real)[2][-1]
    np.testing.assert_allclose(point.twist, line * np.sign(line @ point.twist), atol=1e-10)
    assert not locate_singularities(robot, scene_path(robot.description.scenes["clear"]))


def test_torques_satisfy_lagrange_at_all_instants(plan):
    (crossing,) = plan.crossings
    for t in np.append(np.linspace(0.0, plan.duration, 17), crossing.time):
        x, dx, ddx = (plan.platform(t, k) for k in range(3))
        force = ORACLE.platform_force(x, dx, ddx)
        pushed = ORACLE.rates(x).T @ (GEAR * plan.torque(t))
        np.testing.assert_allclose(pushed, force, rtol=0, atol=1e-11)
        if abs(t - crossing.time) > 0.1:
            torque = np.linalg.solve(ORACLE.rates(x).T, force) / GEAR
            np.testing.assert_allclose(plan.torque(t), torque, rtol=0, atol=1e-11)


def test_condition_8_is_the_virtual_power_of_the_free_turn(plan):
    (crossing,) = plan.crossings
    x, dx, ddx = (plan.platform(crossing.time, k) for k in range(3))
    free = np.linalg.svd(ORACLE.rates(x))[2][-1]  # on the rotation vector
    assert abs(ORACLE.platform_force(x, dx, ddx) @ free) < 1e-11


@pytest.mark.parametrize("flexibility", ["rigid", "flexible_joints", "flexible_links"])
def test_a_law_without_condition_8_gets_no_torques(flexibility):
    robot = robots.load("spherical_rrr", flexibility=flexibility)
    path = scene_path(robot.description.scenes["cross"])
    with pytest.raises(UnboundedTorque, match=r"t_s \. W_p = .* N m") as caught:
        plan_scene(robot, "cross-unprepared")
    if flexibility != "flexible_links":  # deformed links move the pole
        assert caught.value.s == pytest.approx(exact_singular_s(path), abs=1e-12)


def test_half_of_the_acceleration_is_not_enough(robot, plan):
    (crossing,) = plan.crossings
    t = crossing.time
    half = 0.5 * crossing.acceleration
    wrong = [Condition(t, 0, crossing.s), Condition(t, 1, crossing.speed), Condition(t, 2, half)]
    with pytest.raises(UnboundedTorque):
        inverse_dynamics(robot, plan.path, Law.rest_to_rest(plan.duration, 2, wrong))
