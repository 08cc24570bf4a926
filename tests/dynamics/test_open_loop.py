"""What grows without feedback, against the closed form of a row of standing rods."""

import numpy as np
import pytest

import robots
from framework import plan_scene
from framework.dynamics.open_loop import fall_exponent, open_loop_growth, repelling_rates

# N-four-bar, N = 2: three rods of 1 kg and 1 m about their feet, two bars of 1 kg at their heads, a rotor
INERTIA = 3.0 / 3.0 + 2.0 + 3.3e-5 * 100**2  # [kg m^2]
WEIGHT = (3 * 0.5 + 2 * 1.0) * 9.81  # [N m] about the feet, lying down


@pytest.mark.parametrize("duration", [0.75, 3.0])
def test_a_row_of_standing_rods_falls_like_a_pendulum_upside_down(duration):
    motion = plan_scene(robots.load("n_four_bar"), "swing", duration=duration).dynamics
    times = np.linspace(0.0, duration, 65)
    rate = np.sqrt(WEIGHT * np.cos(motion.platform(times)[:, 0]) / INERTIA)
    np.testing.assert_allclose(repelling_rates(motion, times), rate, rtol=1e-6)
    exponent = np.sum(0.5 * (rate[1:] + rate[:-1]) * np.diff(times))
    assert open_loop_growth(fall_exponent(motion)) == pytest.approx(
        2 * (np.cosh(exponent) - 1) / exponent**2, rel=1e-4
    )


def test_on_a_flat_robot_torques_alone_repel_as_much_in_any_duration():
    quick, slow = (plan_scene(robots.load("five_bar"), "A", duration=t).dynamics for t in (1.5, 15.0))
    assert fall_exponent(quick) == pytest.approx(fall_exponent(slow), rel=1e-5)
    assert open_loop_growth(fall_exponent(quick)) > 1.0
