"""The measure that figures show."""

import numpy as np
import pytest

import robots
from framework import Line, track_path
from framework.kinematics.loop_matrices import type2_matrix
from framework.planning.scenes import scene_path
from framework.singularity.type2 import singularity_measure

S = np.linspace(0.0, 1.0, 301)
START, END = np.array([0.12, 0.06, 0.55]), np.array([-0.08, -0.04, 0.62])
BESIDE = 5e-5 * np.array([1.0, -2.0, 0.0]) / np.sqrt(5.0)  # [m] from the axis on which two values vanish


def linearised_on(robot, path):
    return track_path(robot, path).close(S).linearised


@pytest.mark.parametrize(
    ("name", "path"),
    [
        ("three_upu", Line(START + BESIDE, END + BESIDE)),
        ("par4", "pick"),  # two singular values come near one another
        ("five_bar", "C"),
        ("slider_crank", "full_turn"),
    ],
)
def test_g_moves_no_more_than_P_does(name, path):
    """Weyl's inequality, on either side of zero: no step where singular values change places."""
    robot = robots.load(name)
    path = scene_path(robot.description.scenes[path]) if isinstance(path, str) else path
    linearised = linearised_on(robot, path)
    P, measure = type2_matrix(robot, linearised), singularity_measure(robot, linearised)
    assert np.all(
        np.abs(np.diff(measure.g)) <= np.linalg.norm(np.diff(P, axis=0), ord=2, axis=(1, 2)) + 1e-14
    )
    np.testing.assert_array_equal(np.sign(measure.g), np.linalg.slogdet(P)[0])
    np.testing.assert_allclose(np.abs(measure.g), np.linalg.norm(P, ord=-2, axis=(1, 2)), atol=1e-14)
    assert np.all(np.sum(measure.motion[1:] * measure.motion[:-1], axis=1) > 0)


def test_a_robot_of_motors_alone_has_nothing_to_escape():
    robot = robots.load("two_arms")
    measure = singularity_measure(robot, linearised_on(robot, scene_path(robot.description.scenes["lift"])))
    np.testing.assert_array_equal(measure.g, 1.0)
    np.testing.assert_array_equal(measure.motion, 0.0)
