"""What the motors allow along a path: against linear programs, and against certified torques."""

import numpy as np
import pytest
from scipy.optimize import linprog

import robots
from framework import Line, plan_crossing
from framework.planning.optimal.limit_curves import highest_speed, limit_curves
from framework.planning.optimal.phase_plane import AffineInSpeed, Demand

LINE = Line([0.1, 0.345], [-0.05, 0.195])


@pytest.fixture(scope="module")
def quickest():
    return plan_crossing(robots.load("five_bar"), LINE, optimize="time", torque_limit=0.165)


@pytest.mark.parametrize("motors", [2, 3, 6])
def test_the_highest_speed_is_that_of_a_linear_program(motors):
    rng = np.random.default_rng(motors)
    constant, per_z, per_u = rng.normal(size=(3, 40, motors)) * np.array([0.9, 1.0, 3.0])[:, None, None]
    speed, most = rng.uniform(0.5, 1.0, (40, motors)), 2.5
    limit = rng.uniform(1.0, 2.0, motors)
    demand = Demand(AffineInSpeed(constant, per_z, per_u), 0.0 * constant, speed)
    found = highest_speed(demand, limit, np.full(motors, most))
    refused = 0
    for k, value in enumerate(found):
        rows = np.stack([per_z[k], per_u[k]], axis=1)
        answer = linprog(
            [-1.0, 0.0],
            np.concatenate([rows, -rows]),
            np.concatenate([limit - constant[k], limit + constant[k]]),
            bounds=[(0.0, (most / speed[k].max()) ** 2), (None, None)],
        )
        refused += answer.status == 2
        expected = np.sqrt(answer.x[0]) if answer.status == 0 else np.nan
        np.testing.assert_allclose(value, expected, rtol=1e-6)
    assert refused < 40


@pytest.mark.parametrize("motors", [2, pytest.param(4, marks=pytest.mark.slow)])
def test_the_highest_speed_with_damping_is_that_of_a_scan(motors):
    """At each s' the limits leave a range of s"; the last s' at which it is not empty is the highest."""
    rng = np.random.default_rng(10 + motors)
    constant, per_speed, per_z, per_u = rng.normal(size=(4, 60, motors)) * [[[0.3]], [[0.5]], [[1]], [[3]]]
    limit = rng.uniform(1.0, 2.0, motors)
    demand = Demand(AffineInSpeed(constant, per_z, per_u), per_speed, np.ones_like(constant))
    found = highest_speed(demand, limit, np.full(motors, np.inf))
    speeds = np.linspace(0.0, 50.0, 50001)
    for k, value in enumerate(found):
        rest = constant[k] + np.outer(speeds, per_speed[k]) + np.outer(speeds**2, per_z[k])
        middle, half = -rest / per_u[k], limit / np.abs(per_u[k])
        possible = speeds[(middle - half).max(axis=1) <= (middle + half).min(axis=1)]
        assert len(possible) > 0
        if value < 49.0:
            assert value == pytest.approx(possible[-1], abs=2e-3)
        else:
            assert possible[-1] > 48.0


def test_without_limits_nothing_bounds_the_speed():
    ones = np.ones((5, 2))
    demand = Demand(AffineInSpeed(ones, ones, ones), ones, ones)
    assert np.all(np.isinf(highest_speed(demand, np.full(2, np.inf), np.full(2, np.inf))))


def test_a_torque_is_at_its_limit_where_the_law_is_at_the_edge(quickest):
    curves = limit_curves(quickest)
    width = curves.highest_acceleration - curves.lowest_acceleration
    above = (curves.highest_acceleration - curves.acceleration) / width
    t = np.linspace(0.0, quickest.duration, 20001)
    largest = np.interp(curves.s, quickest.law(t), np.abs(quickest.torque(t)).max(axis=1))
    away = np.abs(curves.s - quickest.crossings[0].s) > 0.05
    at_edge = away & (np.minimum(above, 1 - above) < 1e-3)
    assert at_edge.sum() > 10
    np.testing.assert_allclose(largest[at_edge], 0.165, rtol=5e-3)
    inside = away & (np.minimum(above, 1 - above) > 0.1)
    assert np.all(largest[inside] < 0.165 * 0.95)


def test_the_range_closes_at_the_crossing_around_its_acceleration(quickest):
    curves = limit_curves(quickest)
    (crossing,) = quickest.crossings
    beside = np.abs(curves.s - crossing.s)
    width = curves.highest_acceleration - curves.lowest_acceleration
    near = (beside > 1e-5) & (beside < 1e-2)
    slope = np.polyfit(np.log(beside[near]), np.log(width[near]), 1)[0]
    assert slope == pytest.approx(1.0, abs=0.02)  # in proportion to the distance
    closest = np.argmin(beside)
    assert curves.highest_acceleration[closest] == pytest.approx(crossing.acceleration, abs=1e-2)
