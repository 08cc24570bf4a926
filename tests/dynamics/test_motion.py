"""The motion of an inverse dynamics: closed loops, rates that belong together, power that balances."""

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import Line, plan_crossing
from framework.dynamics.wrench import wrench_along, wrench_curves
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
    curves = wrench_curves(robot, plan.dynamics.motion(t))

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
    power = np.sum(curves.wrench * plan.platform(t, 1), axis=1)
    np.testing.assert_allclose(power, rate, rtol=0, atol=1e-6 * np.abs(rate).max())


def test_at_the_crossing_g_and_the_power_vanish_together(plan):
    (crossing,) = plan.crossings
    t = crossing.time + np.array([-1e-3, 0.0, 1e-3])
    g, power = wrench_along(plan.dynamics, t)
    assert abs(g[1]) < 1e-11
    assert g[0] * g[2] < 0
    assert abs(power[1]) < 1e-9
