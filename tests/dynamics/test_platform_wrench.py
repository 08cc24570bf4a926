"""W = G' tau: what a motion asks of the platform is what its motor torques give there."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

import robots
from framework import plan_scene
from framework.dynamics.platform_wrench import PlatformWrench, _unscale_polytope, hold_at, platform_wrench
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.motion_rates import motor_speeds
from framework.numerics.polytope import zonotope
from framework.singularity.jogging import describe_jogged_pose, move_platform


def planned(name, scene, flexibility="rigid"):
    """A plan and its motion at a few instants, the crossing left out (there G' tau is 0 times a limit)."""
    plan = plan_scene(robots.load(name, flexibility=flexibility), scene)
    t = np.linspace(0.03, 0.97, 41) * plan.duration
    return plan, t, plan.dynamics.motion(t)


def test_on_massless_legs_it_is_the_payload_and_the_rotors():
    """10 kg at the tip of the 5R, horizontal: m x" and the rotors, Eqs. (5) and (9)."""
    plan, t, motion = planned("five_bar", "C")
    wrench = platform_wrench(plan.robot, motion)
    rotors = 6.4e-6 * plan.motor_angle(t, 2)
    payload = wrench.bodies + wrench.rotors - np.einsum("tan,ta->tn", wrench.motor_speed, rotors)
    assert payload == pytest.approx(10.0 * plan.platform(t, 2), abs=1e-9)


def test_along_t_s_the_motors_can_give_nothing_at_the_crossing_and_much_beside_it():
    plan = plan_scene(robots.load("five_bar"), "C")
    (crossing,) = plan.crossings
    s = np.array([crossing.s - 0.05, crossing.s])
    closed = close_loops(plan.robot, plan.path(s), plan.dynamics.configuration(plan.duration * s))
    G, _ = motor_speeds(plan.robot, closed)
    reach = np.abs(G @ crossing.twist).sum(axis=1)
    assert reach[1] < 1e-9 * np.abs(G).max()  # G t_s = 0 at s to rounding, and G is steep there
    assert reach[0] > 1e-2 * np.abs(G[0]).max()


@pytest.mark.parametrize("name", ["five_bar", "delta", "orthoglide"])
def test_torques_that_hold_a_push_do_its_work_along_any_small_way(name):
    robot = robots.load(name)
    here = describe_jogged_pose(robot, robot.reference.q)
    push = np.arange(1.0, robot.n + 1.0)
    torque = hold_at(robot, here.q, push).torque
    for k in range(robot.n):  # a way of 1 um there and back, by inverse kinematics alone
        ends = [move_platform(robot, here.q, k, float(here.x[k]) + side * 1e-6) for side in (-1.0, 1.0)]
        motors, way = (ends[1].motors - ends[0].motors) * robot.gear_ratio, ends[1].x - ends[0].x
        assert torque @ motors == pytest.approx(push @ way, rel=1e-6)


def test_no_torque_holds_a_push_along_t_s_on_the_locus():
    robot = robots.load("five_bar")
    at = move_platform(robot, move_platform(robot, robot.reference.q, 0, 0.0).q, 1, 0.2475)
    sizes = []
    for step in range(4):  # each time a tenth as far from the locus, ten times the torque
        y = float(np.sqrt(0.06)) + 2.5e-3 * 0.1**step
        at = move_platform(robot, at.q, 1, y)
        sizes.append(np.abs(hold_at(robot, at.q, np.array([0.0, 1.0])).torque).max())
    assert np.divide(sizes[1:], sizes[:-1]) == pytest.approx(10.0, rel=0.05)


def test_a_polytope_in_other_units_contains_the_same_points():
    rng = np.random.default_rng(3)
    scale = np.array([1.0, 20.0, 0.1])
    scaled = zonotope(rng.standard_normal(3), rng.standard_normal((4, 3)))
    converted = _unscale_polytope(scaled, scale)
    points = scaled.vertices.mean(axis=0) + 1.5 * rng.standard_normal((200, 3))
    inside = scaled.contains(points)
    assert 10 < inside.sum() < 190
    np.testing.assert_array_equal(converted.contains(points / scale), inside)
    np.testing.assert_allclose(np.linalg.norm(converted.normals, axis=1), 1.0)
    assert converted.contains(converted.vertices).all()


def test_motors_at_their_limits_push_with_all_their_signs():
    G, limits = np.random.default_rng(0).standard_normal((2, 3, 4)), np.array([0.5, 2.0, 3.0])
    found = PlatformWrench.vertices(SimpleNamespace(motor_speed=G), limits)
    for at, pushes in zip(G, found, strict=True):
        expected = [np.array(signs) * limits @ at for signs in product((-1.0, 1.0), repeat=3)]
        np.testing.assert_allclose(sorted(pushes.tolist()), sorted(np.array(expected).tolist()), atol=1e-14)
