"""What is drawn as the locus is singular, by each mechanism's own geometry."""

import numpy as np
import pytest

import robots
from framework import assemble, locate_singularities
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.linearised_loops import passive_matrix
from framework.planning.scenes import scene_path
from framework.singularity.drawn_locus import locus_curves, locus_patch

MOTORS, LINK = np.array([[-0.2, 0.0], [0.2, 0.0]]), 0.25  # the 5R of the paper


def elbows(point):
    """The 5R's elbows, both outward, with C at a point: two circles about each motor and C."""
    found = []
    for motor, side in zip(MOTORS, (1.0, -1.0), strict=True):
        reach = point - motor
        half = np.linalg.norm(reach) / 2
        angle = np.arctan2(reach[1], reach[0]) + side * np.arccos(half / LINK)
        found.append(motor + LINK * np.array([np.cos(angle), np.sin(angle)]))
    return found


def test_on_the_curves_of_the_5r_its_rods_lie_in_line():
    robot = robots.load("five_bar")
    start = assemble(robot)
    drawn = locus_curves(robot, start.q, start.x)
    assert drawn.axes == (0, 1)
    points = np.concatenate(drawn.curves)
    assert len(points) > 40
    for point in points:
        left, right = ((elbow - point) / LINK for elbow in elbows(point))
        assert abs(left[0] * right[1] - left[1] * right[0]) < 1e-9
    # the paper's path crosses it at (0, sqrt(0.06)): some piece of the drawing passes by, a grid step at most
    assert np.linalg.norm(points - [0.0, np.sqrt(0.06)], axis=1).min() < 0.03


def test_the_biglide_is_singular_half_way_between_its_rails():
    robot = robots.load("biglide")
    start = assemble(robot)
    points = np.concatenate(locus_curves(robot, start.q, start.x).curves)
    np.testing.assert_allclose(points[:, 0], 0.0, atol=1e-12)
    assert np.ptp(points[:, 1]) > 1.0


@pytest.mark.parametrize(("name", "scene"), [("delta", "cross"), ("gough_stewart", "turn")])
def test_the_patch_is_singular_and_passes_the_crossing(name, scene):
    robot = robots.load(name)
    found = locate_singularities(robot, scene_path(robot.description.scenes[scene]))[0]
    patch = locus_patch(robot, found.q, found.platform)
    middle = len(patch) // 2
    np.testing.assert_allclose(patch[middle, middle], found.platform[:3], atol=1e-9)
    targets = np.repeat(found.platform[None], patch[..., 0].size, axis=0)
    targets[:, :3] = patch.reshape(-1, 3)
    linearised = close_loops(robot, targets, np.repeat(found.q[None], len(targets), axis=0)).linearised
    smallest = np.linalg.svd(passive_matrix(robot, linearised), compute_uv=False)[:, -1]
    aside = np.linalg.svd(passive_matrix(robot, linearised), compute_uv=False)[:, 0].max()
    assert smallest.max() < 1e-6 * aside


def test_nothing_is_drawn_where_nothing_can_be():
    robot = robots.load("two_arms")  # every joint has a motor
    start = assemble(robot)
    assert locus_curves(robot, start.q, start.x) is None
    assert locus_patch(robot, start.q, start.x) is None
