"""The energy of optimal laws against estimates of the least by another discretisation."""

import numpy as np
import pytest

from framework import plan_crossing
from framework.planning.optimal.peak_bound import bound_plan
from tests.dynamics.upright_robots import rigid_crossing
from tests.planning.optimal.law_contradictions import Asked, answer
from tests.planning.optimal.least_energy import (
    conditions_at,
    least_energy,
    least_energy_lasting,
    torques_along,
)


@pytest.mark.parametrize("k", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2, 3, 4))])
def test_torques_and_condition_8_are_those_of_a_plan(k):
    one = rigid_crossing(k)
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


@pytest.mark.slow
@pytest.mark.parametrize("k", [1, 15])
def test_the_energy_of_a_required_duration_is_nearly_the_least_though_motors_hold_a_weight(k):
    one = rigid_crossing(k)
    duration = 1.5 * one.duration
    least = least_energy_lasting(*one.plan_arguments(), duration)
    assert least > 1.02 * least_energy(*one.plan_arguments(), duration)  # within it a quicker law takes less
    lasting = answer(*one.plan_arguments(), Asked("energy", duration=duration))
    assert lasting.value == pytest.approx(least, rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("k", [0, 1, 2, 4, 5])
def test_laws_of_random_robots_are_nearly_the_best(k):
    """Near the estimated energy, no more, as its accelerations may jump; near the bounds of peak and time."""
    one = rigid_crossing(k)
    plans = {
        goal: answer(*one.plan_arguments(), Asked(goal, longest=one.duration))
        for goal in ("peak_torque", "energy")
    }
    gentle = plans["peak_torque"].plan
    bound = bound_plan(gentle).value * gentle.optimality.reference.max()
    assert 1.0 < plans["peak_torque"].value / bound < 1.02
    assert plans["energy"].value == pytest.approx(least_energy(*one.plan_arguments(), one.duration), rel=0.04)
    limit = 1.25 * plans["peak_torque"].value
    quickest = answer(*one.plan_arguments(), Asked("time", torque_limit=limit))
    assert 1.0 < quickest.value / bound_plan(quickest.plan).value < 1.03
