"""The first frequency of free vibrations against a closed form, and by how it scales."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import assemble
from framework.dynamics.vibrations import free_motor_frequency
from tests.oracles.planar import cross, legs

DRIVE, ROD, ROTOR, PAYLOAD = 25000.0, 350000.0, 6.4e-6 * 50**2, 10.0  # [N m/rad], [N/m], [kg m^2], [kg]


@pytest.mark.parametrize("x", [(0.1, 0.345), (-0.05, 0.295), (0.0, 0.2449)])  # the last one beside Type 2
@pytest.mark.parametrize("flexibility", ["flexible_joints", "flexible_links"])
def test_the_paper_s_robot_vibrates_on_two_legs_of_springs_in_series(x, flexibility):
    robot = robots.load("five_bar", flexibility=flexibility)
    stiffness = np.zeros((4, 4))  # of x, y and the two motors
    for motor, (crank, rod) in enumerate(legs(*x)):
        rod = np.array(rod) / np.hypot(*rod)
        lever = cross(crank, rod)  # how fast the rod's near end moves along it, for a turn of the crank
        in_series = lever**2 / DRIVE + (1.0 / ROD if flexibility == "flexible_links" else 0.0)
        gap = np.array([*rod, 0.0, 0.0])
        gap[2 + motor] = -lever
        stiffness += np.outer(gap, gap) / in_series
    inertia = np.diag([PAYLOAD, PAYLOAD, ROTOR, ROTOR])
    squares = np.sort(np.linalg.eigvals(np.linalg.solve(inertia, stiffness)).real)
    found = free_motor_frequency(robot, assemble(robot, x).q[None])
    assert found[0] == pytest.approx(np.sqrt(squares[2]) / (2 * np.pi), rel=1e-6)


@pytest.mark.parametrize(
    "name", ["delta", "five_bar_heavy", "standing_quadruped", "two_arms", "gough_stewart"]
)
def test_four_times_the_stiffness_vibrates_twice_as_quickly(name):
    robot = robots.load(name, flexibility="flexible_links")
    stiffer = replace(robot, stiffness=4.0 * robot.stiffness)
    q = robot.reference.q[None]
    assert free_motor_frequency(stiffer, q)[0] == pytest.approx(
        2.0 * free_motor_frequency(robot, q)[0], rel=1e-6
    )


def test_a_rigid_robot_does_not_vibrate():
    robot = robots.load("five_bar")
    assert np.all(np.isinf(free_motor_frequency(robot, robot.reference.q[None])))
