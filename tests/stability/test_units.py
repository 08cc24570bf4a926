"""The same robot in metres, in millimetres, in kilometres.

What goes wrong: "singular if det A < 1e-6" or "sigma_min < 1e-3" compares a number with a dimension. In
millimetres the determinant of the 5R is a million times as large, and a pose that was singular is not; for a
robot that also turns, sigma_min weighs metres against radians.
Why: a threshold without a unit has one all the same.
What we do: loop equations are made dimensionless by the robot's own length before rank or singularity is
judged. The crossing is the same to rounding, torques scale with the square of the length.
"""

from functools import cache

import numpy as np
import pytest

import robots
from framework import Line, ParallelRobot, locate_singularities, plan_scene
from tests.oracles.planar import crossing_coordinate, rods_cross
from tests.robots.transformed import scaled

SIZES = 10.0 ** np.arange(-9, 10, 3)  # units of length in one metre: 1000 describes it in millimetres


@cache
def robot_of(size: float, flexibility: str = "rigid") -> ParallelRobot:
    return ParallelRobot.from_description(
        scaled(robots.load("five_bar").description, float(size)), flexibility=flexibility
    )


def naive_singular_share(size: float, threshold: float = 1e-3) -> float:
    """Share of scene C's path that |det A| < threshold calls singular; det A in squared units of length."""
    s = np.linspace(0.0, 1.0, 4001)
    points = Line([0.1, 0.345], [-0.05, 0.195])(s)
    determinant = 4 * size**2 * np.array([rods_cross(*map(float, point)) for point in points])
    return float(np.mean(np.abs(determinant) < threshold))


def our_crossing(size: float) -> float:
    """s of the crossing."""
    scene = robot_of(size).description.scenes["C"]
    (point,) = locate_singularities(robot_of(size), Line(*scene.points))
    return point.s


def torque_error(size: float, flexibility: str) -> float:
    """Largest difference of the torques to those in metres, over the largest, the square of size removed."""
    one, other = (plan_scene(robot_of(unit, flexibility), "C") for unit in (1.0, size))
    t = np.linspace(0.0, one.duration, 101)
    return float(np.abs(other.torque(t) / size**2 - one.torque(t)).max() / np.abs(one.torque(t)).max())


def test_a_threshold_with_a_unit_sees_everything_or_nothing():
    assert naive_singular_share(1e-3) == 1.0  # a robot of 0.4 mm: all of the path is "singular"
    assert naive_singular_share(1e3) == 0.0  # in millimetres: none of it
    assert 0 < naive_singular_share(1.0) < 0.1


@pytest.mark.parametrize("size", SIZES)
def test_the_crossing_is_where_it_is_in_all_units(size):
    assert our_crossing(size) == pytest.approx(float(crossing_coordinate()), abs=1e-14)


@pytest.mark.parametrize("flexibility", ["rigid", "flexible_links"])
@pytest.mark.parametrize("size", SIZES)
def test_torques_scale_with_the_square_of_the_length(size, flexibility):
    assert torque_error(size, flexibility) < 1e-10
