"""Accelerations are those of the motion: at rest at both ends, and the rates of the velocities."""

import numpy as np
import pytest

import robots
from framework import plan_scene


@pytest.mark.parametrize("flexibility", ["rigid", "flexible_links"])
def test_accelerations_are_rates_of_velocities_and_vanish_at_the_ends(flexibility):
    plan = plan_scene(robots.load("five_bar", flexibility=flexibility), "C")
    t, step = np.linspace(0.1, plan.duration - 0.1, 14), 1e-4
    for velocity, acceleration in (
        (lambda t: plan.motor_angle(t, 1), lambda t: plan.motor_angle(t, 2)),
        (lambda t: plan.dynamics.velocity(t), lambda t: plan.dynamics.velocity(t, 2)),
        (lambda t: plan.dynamics.deflection(t, 1), lambda t: plan.dynamics.deflection(t, 2)),
    ):
        if velocity(t).size == 0:
            continue
        size = np.abs(acceleration(t)).max()
        difference = (velocity(t + step) - velocity(t - step)) / (2 * step)
        np.testing.assert_allclose(acceleration(t), difference, rtol=0, atol=1e-5 * size)
    ends = np.array([0.0, plan.duration])
    # four derivatives of s vanish there, and deflections follow the second
    assert np.abs(plan.motor_angle(ends, 2)).max() < 1e-10 * np.abs(plan.motor_angle(t, 2)).max()
    np.testing.assert_allclose(plan.motor_angle(0.3, 2), plan.motor_angle(np.array([0.3]), 2)[0], rtol=1e-12)


@pytest.mark.slow
def test_an_elastic_robot_begins_and_ends_at_rest_under_an_optimal_law():
    robot = robots.load("n_four_bar", flexibility="flexible_links")
    plan = plan_scene(robot, next(iter(robot.description.scenes)), law="optimal")
    motor = plan.motor_angle(np.linspace(0.0, plan.duration, 41), 2)
    assert np.abs(motor[[0, -1]]).max() < 1e-4 * np.abs(motor).max()
    # at rest springs hold the weight alone, under whatever law
    still = plan_scene(robot, next(iter(robot.description.scenes)), geometry="deformed")
    ends = np.array([0.0, plan.duration])
    size = np.abs(still.deflection(ends * still.duration / plan.duration)).max()
    np.testing.assert_allclose(
        plan.deflection(ends), still.deflection(ends * still.duration / plan.duration), atol=1e-5 * size
    )
