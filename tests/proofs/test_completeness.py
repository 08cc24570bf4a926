"""Paving against circles that meet or do not."""

import numpy as np
import pytest

import robots
from framework.kinematics.frames import difference
from framework.proofs.branch_and_bound import Boxes
from framework.proofs.interval_newton import LinearEnclosure
from framework.proofs.leg_paving import KnownSolutions, _bound_slides, has_only_known_solutions


def circles(apart, radius):
    """x^2 + y^2 = 1 and (x - apart)^2 + y^2 = radius^2, exact to second order."""

    def equations(c, r):
        off = c[:, None] - np.array([[0.0, 0.0], [apart, 0.0]])
        values = np.sum(off**2, axis=2) - np.array([1.0, radius**2])
        errors = np.repeat(np.sum(r**2, axis=1, keepdims=True), 2, axis=1) + 1e-13
        return LinearEnclosure(values, 2 * off, errors)

    return equations


def paved(equations, points):
    known = KnownSolutions(
        np.reshape(points, (-1, 2)), np.full(len(points), 0.05), np.array([np.inf, np.inf])
    )
    return has_only_known_solutions(equations, Boxes(np.zeros((1, 2)), np.full((1, 2), 4.0)), known)


def test_all_points_of_two_circles_are_known_or_one_is_missed():
    x = (1.0 + 1.2**2 - 0.9**2) / (2 * 1.2)
    meet = [(x, sign * np.sqrt(1 - x * x)) for sign in (1, -1)]
    assert paved(circles(1.2, 0.9), meet)
    for one in meet:
        assert not paved(circles(1.2, 0.9), [one])
    assert not paved(circles(1.2, 0.9), [])


@pytest.mark.parametrize(("apart", "radius"), [(3.0, 1.0), (0.0, 0.5), (2.001, 1.0), (0.4, 0.5)])
def test_circles_that_do_not_meet_are_paved_without_a_solution(apart, radius):
    assert paved(circles(apart, radius), [])


@pytest.mark.parametrize(("apart", "radius"), [(2.0, 1.0), (0.0, 1.0)])
def test_circles_that_touch_or_are_one_are_left_open(apart, radius):
    assert not paved(circles(apart, radius), [])


@pytest.mark.parametrize("name", ["three_rpr", "biglide", "gough_stewart", "orthoglide"])
def test_no_slide_is_longer_than_its_bound(name):
    """In the reference, of which the longest slide is a good share of the bound."""
    robot = robots.load(name)
    slides = robot.sliding[robot.moving]
    offsets = difference(robot, robot.neutral, robot.reference.q[None])[0, robot.moving][slides]  # [m]
    for x in (robot.reference.x, None):
        assert np.abs(offsets).max() / robot.length <= _bound_slides(robot, robot.reference.q, x) < 20.0
