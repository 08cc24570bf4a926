"""Accelerations are those of the motion: at rest at both ends, and the rates of the velocities."""

from __future__ import annotations

import numpy as np
import pytest

import robots
from framework.crossing.scenes import plan_scene


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
