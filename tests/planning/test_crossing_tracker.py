"""Singular points that are followed to a deflected robot, against bisection of a determinant."""

import numpy as np
import pytest
from scipy.optimize import brentq

import robots
from framework.kinematics.frames import integrate
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.linearised_loops import type2_matrix
from framework.planning.crossing_tracker import TrackedPoints, track_points
from framework.planning.scenes import scene_path
from framework.singularity.points_on_path import search_path


@pytest.mark.parametrize("size", [1e-2, 3e-4, 1e-5, 1e-8])
@pytest.mark.parametrize(
    ("name", "scene"), [("four_bar", "full_turn"), ("five_bar", "B"), ("biglide", "bow")]
)
def test_points_of_the_deflected_robot_are_singular_to_rounding(name, scene, size):
    """Also where a step is small only because the deflections have opened the loops."""
    robot = robots.load(name, flexibility="flexible_links")
    searched = search_path(robot, scene_path(robot.description.scenes[scene]))
    branch = searched.branch
    spring_step = np.zeros(robot.nv)
    spring_step[robot.elastic] = size * np.cos(np.arange(robot.n_e))
    for point in searched.points:
        start = TrackedPoints.from_undeformed(branch, [point])
        tracked = track_points(branch, start, spring_step[None, robot.elastic])
        (s,), P = tracked.s, type2_matrix(robot, tracked.pose)[0]
        values = np.linalg.svd(P, compute_uv=False)
        assert values[-1] < 1e-14 * values[0]

        def determinant(s):
            x = branch.path(np.array([s]))
            q = integrate(robot, branch.guess(np.array([s])), spring_step[None])
            return np.linalg.det(type2_matrix(robot, close_loops(robot, x, q)))[0]

        beside = max(10.0 * abs(s - point.s), 1e-6)
        assert s == pytest.approx(brentq(determinant, s - beside, s + beside, xtol=1e-15), rel=0, abs=1e-13)
