"""The motion of an inverse dynamics: closed loops, rates that belong together, power that balances."""

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import Line, plan_crossing, plan_scene
from framework.dynamics.open_loop import fall_exponent, open_loop_growth, repelling_rates
from framework.dynamics.platform_wrench import platform_wrench, wrench_curves
from tests.robots.every_robot import planned

LINE = Line([0.1, 0.345], [-0.05, 0.195])


@pytest.fixture(scope="module", params=["rigid", "flexible_links"])
def plan(request):
    return plan_crossing(robots.load("five_bar", flexibility=request.param), LINE, duration=1.5)


@pytest.mark.parametrize("name", ["five_bar_heavy", "delta"])
def test_the_wrench_that_all_bodies_ask_for_does_the_work_that_goes_into_them(name):
    """W_p . v is the rate of kinetic and potential energy of all bodies, their motion led by the platform."""
    robot = robots.load(name)
    plan = planned(robot)
    t, h = np.linspace(0.1, 0.9, 17) * plan.duration, 1e-5 * plan.duration
    wrench = platform_wrench(robot, plan.dynamics.motion(t)).bodies

    def energy(times):
        motion = plan.dynamics.motion(times)
        data = robot.model.createData()
        return np.array(
            [
                pin.computeKineticEnergy(robot.model, data, q, v)
                + pin.computePotentialEnergy(robot.model, data, q)
                for q, v in zip(motion.q, motion.v, strict=True)
            ]
        )

    rate = (energy(t + h) - energy(t - h)) / (2 * h)
    power = np.sum(wrench * plan.platform(t, 1), axis=1)
    np.testing.assert_allclose(power, rate, rtol=0, atol=1e-6 * np.abs(rate).max())


def test_at_the_crossing_g_and_the_power_vanish_together(plan):
    (crossing,) = plan.crossings
    t = crossing.time + np.array([-1e-3, 0.0, 1e-3])
    g, _, power = wrench_curves(plan.robot, plan.dynamics.motion(t))
    assert abs(g[1]) < 1e-11
    assert g[0] * g[2] < 0
    assert abs(power[1]) < 1e-9


# what grows without feedback, against the closed form of a row of standing rods


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
