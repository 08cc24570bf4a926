"""A motor without a limit of torque is not bounded by the limits of the others."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import Line, NoLaw, ParallelRobot, plan_crossing
from framework.planning.optimal.peak_bound import bound_plan

LINE = Line([0.1, 0.345], [-0.05, 0.195])
AMPLE = 10.0  # [N m], a hundred times what any of these motions asks for


def five_bar(left: float | None, right: float | None) -> ParallelRobot:
    """The paper's 5R with these limits of torque [N m] in its robot file."""
    description = robots.load("five_bar").description
    limits = zip(description.actuators, (left, right), strict=True)
    motors = tuple(replace(motor, torque_limit=limit) for motor, limit in limits)
    return ParallelRobot.from_description(replace(description, actuators=motors))


def peaks(plan) -> np.ndarray:
    """Largest torque of each motor [N m]."""
    return np.abs(plan.torque(np.linspace(0.0, plan.duration, 4001))).max(axis=0)


def test_in_least_time_it_is_as_good_as_an_ample_limit():
    free, ample = (plan_crossing(five_bar(0.1, limit), LINE, optimize="time") for limit in (None, AMPLE))
    np.testing.assert_allclose(free.duration, ample.duration, rtol=1e-5)
    assert peaks(free)[0] <= 0.1 < 1.5 * 0.1 < peaks(free)[1]
    for plan in (free, ample):  # whatever the limits, there is a bound, and a good one
        assert 1.0 < plan.duration / bound_plan(plan).value < 1.01


@pytest.mark.slow
def test_the_least_energy_is_that_of_an_ample_limit():
    free, ample = (
        plan_crossing(five_bar(0.03, limit), LINE, duration=1.5, optimize="energy") for limit in (None, AMPLE)
    )
    t, weights = np.polynomial.legendre.leggauss(200)
    energies = [weights @ (plan.torque(0.75 * (t + 1)) ** 2).sum(axis=1) for plan in (free, ample)]
    # the ample limit weighs a torque of its motor less in the goal: no less energy of both alike
    assert energies[0] <= energies[1] * (1.0 + 1e-3)
    assert peaks(free)[0] <= 0.03 < peaks(free)[1]


@pytest.mark.slow
def test_the_least_peak_weighs_it_and_bounds_the_others():
    plan = plan_crossing(five_bar(0.03, None), LINE, duration=1.5, law="optimal")
    assert plan.duration == 1.5
    assert peaks(plan)[0] <= 0.03 < peaks(plan)[1]
    ample = plan_crossing(five_bar(0.03, AMPLE), LINE, duration=1.5, law="optimal")
    assert peaks(plan)[1] <= peaks(ample)[1] * (1.0 + 1e-3)
    assert peaks(plan)[1] / 0.03 > bound_plan(plan).value  # which does not count the limit of the other


@pytest.mark.slow
def test_a_refusal_tells_the_least_peak_of_the_motors_with_a_limit():
    with pytest.raises(NoLaw) as refused:
        plan_crossing(five_bar(0.02, None), LINE, duration=1.5, law="optimal")
    least = 0.02 * refused.value.evidence.least.torque_peak
    assert peaks(plan_crossing(five_bar(1.01 * least, None), LINE, duration=1.5, law="optimal"))[1] > least
    with pytest.raises(NoLaw):
        plan_crossing(five_bar(0.99 * least, None), LINE, duration=1.5, law="optimal")
