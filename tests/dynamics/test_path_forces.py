"""Coefficients of the forces along a path: they give those of motions with any s' and s"."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import Arc, Line, ParallelRobot
from framework.dynamics.forces import tree_forces
from framework.dynamics.path_forces import PathForces
from framework.kinematics.continuation.tracking import track_path
from framework.kinematics.external_wrenches import ExternalWrenches
from framework.kinematics.motion_rates import motion_at
from framework.laws.path import time_derivatives
from framework.model.description import JointDynamics

S = np.array([0.0, 0.21, 0.5, 0.93])
ARC = Arc([0.1, 0.345], [0.03, 0.26], [-0.05, 0.195])


def damped_five_bar(flexibility: str) -> ParallelRobot:
    description = robots.load("five_bar").description
    joints = {"left_motor": JointDynamics(damping=0.4), "right_motor": JointDynamics(damping=0.1)}
    return ParallelRobot.from_description(replace(description, joints=joints), flexibility=flexibility)


CASES = {
    "damped": (lambda: damped_five_bar("rigid"), ARC, {"left_tip": [3.0, 0.0, -5.0, 0.0, 0.0, 0.0]}),
    "with springs": (lambda: damped_five_bar("flexible_links"), ARC, {}),
    "with turns": (
        lambda: robots.load("gough_stewart"),
        Line([0.0, 0.0, 2.0, 0.0, 0.0, 0.0], [0.3, -0.2, 2.3, 0.3, 0.2, 0.4]),
        {},
    ),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(("speed", "acceleration"), [(0.0, 0.0), (1.7, 0.0), (0.0, -4.0), (-2.3, 9.0)])
def test_forces_of_a_motion_are_the_sum_of_their_terms(case, speed, acceleration):
    load, path, wrenches = CASES[case]
    branch = track_path(load(), path).with_wrenches(ExternalWrenches.of(wrenches))
    robot, closed, one = branch.robot, branch.close(S), np.ones_like(S)
    forces = PathForces.compute(branch, S, closed)
    x, dx, ddx = time_derivatives(path, [S, speed * one, acceleration * one])
    np.testing.assert_array_equal(x, closed.x)
    expected = tree_forces(robot, branch.load_motion(motion_at(robot, closed, dx, ddx), S))
    summed = (
        forces.static
        + forces.centrifugal * speed**2
        + forces.inertial * acceleration
        + forces.damping * speed
    )
    np.testing.assert_allclose(summed, expected, rtol=0.0, atol=1e-13 * np.abs(expected).max())
