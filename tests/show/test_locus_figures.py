"""Maps: the locus of the 5R is where its rods are in line, by the geometry of the robot alone."""

import numpy as np
import pytest

import robots
from framework import InvalidInput, plan_scene
from framework.show.locus_figures import plot_locus
from framework.show.style import LOCUS


def rods_in_line(x, y):
    """Sine of the angle between the rods of the 5R, elbows outward."""
    ends = []
    for motor, side in ((np.array([-0.2, 0.0]), 1.0), (np.array([0.2, 0.0]), -1.0)):
        way = np.array([x, y]) - motor
        half = np.linalg.norm(way) / 2
        across = side * np.sqrt(max(0.25**2 - half**2, 0.0)) * np.array([-way[1], way[0]]) / (2 * half)
        rod = np.array([x, y]) - (motor + way / 2 + across)
        ends.append(rod / np.linalg.norm(rod))
    return ends[0][0] * ends[1][1] - ends[0][1] * ends[1][0]


def test_the_locus_on_the_map_is_where_the_rods_are_in_line():
    robot = robots.load("five_bar")
    ax = plot_locus(robot, plan_scene(robot, "C"))
    drawn = [line.get_xydata() for line in ax.lines if line.get_color() == LOCUS]
    points = np.concatenate(drawn)
    points = points[np.isfinite(points).all(axis=1)]
    assert len(points) > 50
    assert max(abs(rods_in_line(*point)) for point in points) < 1e-6
    assert ax.get_xlabel() == "x  [m]"


def test_a_robot_without_a_plane_has_no_map():
    with pytest.raises(InvalidInput, match="two translations"):
        plot_locus(robots.load("gough_stewart"))
