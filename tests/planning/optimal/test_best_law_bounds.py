"""The estimates of the best laws against plans, and against the known optimum of the flat 5R."""

from __future__ import annotations

import numpy as np
import pytest

import robots
from framework import Line, plan_crossing
from tests.planning.optimal.best_law_bounds import (
    BestLaws,
    conditions_at,
    least_energy_lasting,
    torques_along,
)
from tests.planning.optimal.random_crossings import random_crossing

TIME, PEAK = 0.73395, 0.039482  # [s] at 0.164918 N m, [N m] over 1.5 s: of the flat 5R, scene C


@pytest.mark.parametrize("k", [0, 3, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2, 4))])
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


def test_a_longer_duration_costs_energy_where_the_motors_hold_a_weight():
    one = random_crossing(0)
    laws = BestLaws(one.robot, one.path, 100)
    least = laws.least_energy(one.duration)
    lasting = least_energy_lasting(laws, one.duration)
    power = (torques_along(one.robot, one.path, np.linspace(0.0, 0.75, 50)).constant ** 2).sum(axis=1).min()
    assert lasting > least + 0.5 * power * one.duration
