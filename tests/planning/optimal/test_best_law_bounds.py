"""The estimates of the best laws against plans, and against the known optimum of the flat 5R."""

import numpy as np
import pytest

import robots
from framework import Line, plan_crossing
from framework.planning.optimal.peak_bound import bound_plan
from tests.planning.optimal.best_law_bounds import (
    BestLaws,
    conditions_at,
    least_energy_lasting,
    torques_along,
)
from tests.planning.optimal.law_contradictions import Asked, answer
from tests.planning.optimal.random_crossings import random_crossing

TIME, PEAK = 0.73395, 0.039482  # [s] at 0.164918 N m, [N m] over 1.5 s: of the flat 5R, scene C


@pytest.mark.parametrize("k", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2, 3, 4))])
def test_torques_and_condition_8_are_those_of_a_plan(k):
    one = random_crossing(k)
    plan = plan_crossing(*one.plan_arguments(), law="optimal", duration=one.duration)
    t = np.linspace(0.02, 0.98, 25) * plan.duration
    t = t[np.abs(t - plan.crossings[0].time) > 1e-3 * plan.duration]
    along = torques_along(one.robot, one.path, plan.law(t))
    z, u = plan.law(t, 1)[:, None] ** 2, plan.law(t, 2)[:, None]
    torque = along.constant + along.per_z * z + along.per_u * u
    assert np.abs(torque - plan.torque(t)).max() < 1e-6 * np.abs(plan.torque(t)).max()
    crossing = plan.crossings[0]
    gamma, beta, alpha = conditions_at(one.robot, one.path, np.array([crossing.s]))[0]
    terms = np.array([gamma, beta * crossing.speed**2, alpha * crossing.acceleration])
    assert abs(terms.sum()) < 1e-7 * np.abs(terms).max()


def test_estimates_of_the_flat_5r_are_the_known_optima():
    laws = BestLaws(robots.load("five_bar"), Line([0.1, 0.345], [-0.05, 0.195]))
    assert laws.least_time(0.164918) == pytest.approx(TIME, rel=2e-3)
    assert laws.least_peak(1.5) == pytest.approx(PEAK, rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("k", [2, 15])
def test_the_energy_of_a_required_duration_is_nearly_the_least_though_motors_hold_a_weight(k):
    one = random_crossing(k)
    laws, duration = BestLaws(one.robot, one.path, 100), 1.5 * one.duration
    least = least_energy_lasting(laws, duration)
    assert least > 1.02 * laws.least_energy(duration)  # within it a quicker law takes less
    lasting = answer(*one.plan_arguments(), Asked("energy", duration=duration))
    assert lasting.value == pytest.approx(least, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("k", [0, 2, 3, 15, 20])
def test_laws_of_random_robots_are_nearly_the_best(k):
    """Near, no more: accelerations of the estimates may jump. What is a bound of all laws is below."""
    one = random_crossing(k)
    best = BestLaws(one.robot, one.path, 400)
    plans = {
        goal: answer(*one.plan_arguments(), Asked(goal, longest=one.duration))
        for goal in ("peak_torque", "energy")
    }
    least = best.least_peak(one.duration)
    assert plans["peak_torque"].value == pytest.approx(least, rel=0.04)
    gentle = plans["peak_torque"].plan
    assert (
        1.0
        < plans["peak_torque"].value / (bound_plan(gentle).value * gentle.optimality.reference.max())
        < 1.02
    )
    assert plans["energy"].value == pytest.approx(best.least_energy(one.duration), rel=0.04)
    quickest = answer(*one.plan_arguments(), Asked("time", torque_limit=1.25 * least))
    assert quickest.value == pytest.approx(best.least_time(1.25 * least), rel=0.04)
