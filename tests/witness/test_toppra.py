"""Least time against toppra (Pham and Pham, IEEE T-RO 34, 2018), with a crossing too: extra `witness`."""

from typing import NamedTuple

import numpy as np
import pytest

import robots
from framework import Line, plan_crossing, track_path
from framework.laws.optimal_law import Smoothstep
from framework.planning.optimal.peak_bound import bound_plan
from framework.planning.optimal.phase_plane import demand
from framework.planning.plan import plan_request
from framework.planning.request import Request
from framework.tolerances import SMOOTHNESS_COST

toppra = pytest.importorskip("toppra", reason="the extra witness brings it")

CLEAR = Line([0.1, 0.345], [-0.05, 0.295])
ACROSS = Line([0.1, 0.345], [-0.05, 0.195])
LIMIT = 0.165  # [N m]
DENSER = 10  # times, where laws are looked at that were solved on a grid


class Profile(NamedTuple):
    """toppra's s'^2 [1/s2] on its grid of s, and the torques as it was given them."""

    grid: np.ndarray
    squared: np.ndarray

    @property
    def duration(self) -> float:
        speeds = np.sqrt(self.squared)
        return float(np.sum(2.0 * np.diff(self.grid) / (speeds[1:] + speeds[:-1])))

    def torques_between(self, path: Line) -> np.ndarray:
        """Torques (T, 2) [N m] of the same law, DENSER times as densely as it was solved.

        Between the points of its grid toppra's s" is constant and s'^2 linear in s.
        """
        points = (len(self.grid) - 1) * DENSER
        s = (np.arange(points) + 0.5) / points
        slope = np.repeat(np.diff(self.squared) / np.diff(self.grid), DENSER)
        torque = torques_on(path, s)
        squared = np.interp(s, self.grid, self.squared)[:, None]
        return torque.constant + torque.per_z * squared + torque.per_u * 0.5 * slope[:, None]


def torques_on(path: Line, s: np.ndarray):
    """Torques of the 5R as affine functions of s'^2 and s"."""
    return demand(track_path(robots.load("five_bar"), path), Smoothstep(0), s).torque


def toppra_profile(path: Line, points: int = 2001) -> Profile:
    """The same limits on the same torques, ends at rest and nothing smoother, by toppra's own solver."""
    from toppra import algorithm, constraint

    grid = np.linspace(0.0, 1.0, points)
    torque = torques_on(path, grid)

    def at(q, dq, ddq):  # the path is s itself: q = (s,), and its torques are affine in (dq^2, ddq)
        k = round(float(q[0]) * (points - 1))
        return torque.constant[k] + torque.per_z[k] * dq[0] ** 2 + torque.per_u[k] * ddq[0]

    line = toppra.SplineInterpolator([0.0, 1.0], np.array([[0.0], [1.0]]))
    rows, bounds = np.vstack([np.eye(2), -np.eye(2)]), np.full(4, LIMIT)
    limits = constraint.SecondOrderConstraint(
        at,
        lambda q: rows,
        lambda q: bounds,
        1,
        discretization_scheme=constraint.DiscretizationType.Collocation,
    )
    found = algorithm.TOPPRA([limits], line, gridpoints=grid, solver_wrapper="seidel")
    speeds = found.compute_parameterization(0.0, 0.0, return_data=True)[1]
    return Profile(grid, np.asarray(speeds) ** 2)


@pytest.mark.slow
def test_the_bound_of_the_duration_is_just_below_toppras():
    plan = plan_crossing(robots.load("five_bar"), CLEAR, optimize="time", torque_limit=LIMIT)
    theirs = toppra_profile(CLEAR).duration
    assert 0.996 < bound_plan(plan).value / theirs < 1.0 + 1e-4
    assert 1.0 < plan.duration / theirs < 1.0 + SMOOTHNESS_COST + 1e-3  # s" = 0 at the ends, and a smooth law


@pytest.mark.slow
def test_at_rest_at_the_ends_and_no_smoother_the_least_time_is_toppras():
    request = Request(path=CLEAR, optimize="time", torque_limit=(LIMIT,), smoothness=1)
    plan = plan_request(robots.load("five_bar"), request)
    assert 1.0 < plan.duration / toppra_profile(CLEAR).duration < 1.0 + SMOOTHNESS_COST + 1e-3


@pytest.mark.slow
def test_with_a_crossing_only_the_optimal_law_keeps_its_limit_between_its_points():
    plan = plan_crossing(robots.load("five_bar"), ACROSS, optimize="time", torque_limit=LIMIT)
    t = np.linspace(0.0, plan.duration, DENSER * plan.certificate.nodes)
    assert np.abs(plan.torque(t)).max() <= LIMIT
    for points in (101, 501, 2001):
        assert np.abs(toppra_profile(ACROSS, points).torques_between(ACROSS)).max() > 2.0 * LIMIT
