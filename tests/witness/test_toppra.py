"""Least time without a crossing, against toppra (Pham and Pham, IEEE T-RO 34, 2018): extra `witness`."""

from __future__ import annotations

import numpy as np
import pytest

import robots
from framework import Line, plan_crossing
from framework.crossing.bound import estimated_best
from framework.crossing.phase_plane import demand
from framework.kinematics.tracking import track_path
from framework.motion.optimal_law import Smoothstep

toppra = pytest.importorskip("toppra", reason="the extra witness brings it")

CLEAR = Line([0.1, 0.345], [-0.05, 0.295])
LIMIT = 0.165  # [N m]


def toppra_duration(points: int = 2001) -> float:
    """The same limits on the same torques, ends at rest and nothing smoother, by toppra's own solver."""
    from toppra import algorithm, constraint

    robot = robots.load("five_bar")
    branch = track_path(robot, CLEAR)
    grid = np.linspace(0.0, 1.0, points)
    torque = demand(branch, Smoothstep(0), grid, None, "rigid").torque

    def at(q, dq, ddq):  # the path is s itself: q = (s,), and its torques are affine in (dq^2, ddq)
        k = round(float(q[0]) * (points - 1))
        return torque.constant[k] + torque.per_z[k] * dq[0] ** 2 + torque.per_u[k] * ddq[0]

    path = toppra.SplineInterpolator([0.0, 1.0], np.array([[0.0], [1.0]]))
    rows, bounds = np.vstack([np.eye(2), -np.eye(2)]), np.full(4, LIMIT)
    limits = constraint.SecondOrderConstraint(
        at,
        lambda q: rows,
        lambda q: bounds,
        1,
        discretization_scheme=constraint.DiscretizationType.Collocation,
    )
    found = algorithm.TOPPRA([limits], path, gridpoints=grid, solver_wrapper="seidel")
    speeds = found.compute_parameterization(0.0, 0.0, return_data=True)[1]
    return float(np.sum(2.0 * np.diff(grid) / (speeds[1:] + speeds[:-1])))


@pytest.mark.slow
def test_the_estimate_of_the_least_time_is_toppras():
    plan = plan_crossing(robots.load("five_bar"), CLEAR, optimize="time", torque_limit=LIMIT)
    theirs = toppra_duration()
    assert estimated_best(plan) == pytest.approx(theirs, rel=1e-3)
    assert 1.0 < plan.duration / theirs < 1.01
