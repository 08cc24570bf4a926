"""The sentences in which the catalogue says why a robot is singular, and what they say of its motors.

At the singular instant of the first scene that crosses, without a Jacobian.
"""

from functools import cache

import numpy as np
import pytest

import robots
from framework.show.film import Film
from framework.singularity.jogging import move_platform_straight
from tests.browser.pages import filmed
from tests.robots.every_robot import KINDS

CROSSING = {
    "biglide": "across",
    "bricard": "dead_point",
    "delta": "cross",
    "diamond": "cross",
    "five_bar": "C",
    "five_bar_heavy": "C",
    "four_bar": "dead_point",
    "gough_stewart": "turn",
    "humanoid_knee": "deep",
    "orthoglide": "cross",
    "par4": "cross",
    "slider_crank": "dead_centre",
    "spherical_rrr": "cross",
    "three_rpr": "crossing",
    "three_rrr": "crossing",
}

# Each is proved by the closed form of the robot: see the tests of its singular points.
SENTENCES = {
    "biglide": "lie in one line",
    "delta": "pairs of rods are parallel to one plane",
    "diamond": "lie in one line",
    "five_bar": "lie in one line",
    "five_bar_heavy": "lie in one line",
    "four_bar": "Crank and coupler lie in one line",
    "gough_stewart": "lines of the six legs depend on one another",
    "humanoid_knee": "The rod points at the axis of the knee",
    "orthoglide": "legs are parallel to one plane",
    "par4": "a shift with a turn of the bars",
    "slider_crank": "Crank and rod lie in one line",
    "spherical_rrr": "planes of the three distal arcs meet in one line",
    "three_rpr": "lines of the three legs meet in one point",
    "three_rrr": "lines of the three rods meet in one point",
}


def test_every_sentence_is_known_here():
    told = {name for name, entry in robots.CATALOGUE.items() if entry.why}
    elsewhere = {"humanoid_ankle"}  # no scene of it crosses: see test_humanoid_ankle.py
    assert told == set(CROSSING) | elsewhere
    assert set(CROSSING) == {*SENTENCES, "bricard"}


@cache
def crossed(name: str) -> tuple[Film, int]:
    """A film, and its frame at the first singular instant."""
    film = filmed(name, CROSSING[name])
    return film, int(np.argmin(np.abs(film.time - film.instants[0].time)))


@pytest.mark.parametrize("name", SENTENCES)
def test_the_sentence_tells_the_reason(name):
    assert SENTENCES[name] in robots.CATALOGUE[name].why


@pytest.mark.parametrize("name", [name for name in KINDS if name in CROSSING])
def test_no_motor_moves_as_the_platform_starts_along_t_s(name):
    """Neither a leg's length, nor an arm: the motors' derivative along t_s, by central difference."""
    film, k = crossed(name)
    robot, t_s = film.robot, film.t_s[k]
    unit = np.eye(robot.n)  # coordinates of turns are a rotation vector: dx = T^-1 t_s
    rates_to_twist = robot.platform.twist(np.repeat(film.x[k][None], robot.n, axis=0), unit)[0].T
    way = np.linalg.solve(rates_to_twist, t_s)
    step = 1e-4 * min(robot.length, 1.0) / np.abs(way).max()
    poses = [move_platform_straight(robot, film.q[k], film.x[k] + side * step * way) for side in (1, -1)]
    np.testing.assert_allclose(poses[0].x - poses[1].x, 2 * step * way, atol=1e-12)
    rates = (poses[0].motors - poses[1].motors) / (2 * step)
    assert np.abs(rates).max() < 1e-5 * np.abs(way).max() / min(robot.length, 1.0)


def test_the_driven_hinge_of_bricard_turns_back_while_every_second_one_turns_on():
    film, k = crossed("bricard")
    assert "The driven hinge turns back here" in robots.CATALOGUE["bricard"].why
    assert "every second hinge turns on" in robots.CATALOGUE["bricard"].why
    h = 20  # frames
    before, there, after = film.q[k - h], film.q[k], film.q[k + h]
    still = [0, 2, 4]
    turning = [1, 3, 5]
    assert film.robot.actuator_names == ("hinge_1",)
    assert np.all((after - there)[still] * (before - there)[still] > 0)  # both times to the same side
    assert np.all((after - there)[turning] * (before - there)[turning] < 0)
    assert np.abs(after - before)[still].max() < 0.1 * np.abs(after - before)[turning].min()
