"""How short a motion may be under the optimal law, told before one is sought."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import Line, NoLaw, ParallelRobot, plan_crossing
from framework.planning.feasibility import optimal_durations
from framework.planning.request import Request
from framework.singularity.points_on_path import search_path

LINE = Line([0.1, 0.345], [-0.05, 0.195])
UPRIGHT = Line([0.03, 0.33], [-0.02, 0.18])


def under(gravity) -> ParallelRobot:
    """The paper's 5R, a payload on massless legs, with this gravity in its plane [m/s^2]."""
    description = robots.load("five_bar").description
    return ParallelRobot.from_description(replace(description, gravity=(0.0, -gravity, 0.0)))


def of_free_laws(robot, path, **limits):
    return optimal_durations(search_path(robot, path), Request.of(robot, path, duration=1.0, **limits))


def test_without_weight_four_times_the_torque_takes_half_of_the_time():
    robot = robots.load("five_bar")
    weak, strong = (of_free_laws(robot, LINE, torque_limit=limit).shortest for limit in (0.1, 0.4))
    np.testing.assert_allclose(strong, 0.5 * weak, rtol=1e-4)


def test_laws_of_free_shape_begin_where_it_is_told_and_do_not_end():
    robot, limit = under(9.81), 3.0  # N m
    found = of_free_laws(robot, UPRIGHT, torque_limit=limit)
    assert "within the limits the quickest law of free shape found takes" in found.sentence
    with pytest.raises(NoLaw, match="the quickest law found takes"):
        plan_crossing(robot, UPRIGHT, duration=0.95 * found.shortest, torque_limit=limit)
    for longer in (1.05, 30.0):
        plan = plan_crossing(robot, UPRIGHT, duration=longer * found.shortest, torque_limit=limit)
        assert max(plan.peak_torque.values()) <= limit


def test_without_limits_nothing_bounds_a_law_of_free_shape_and_with_little_torque_there_is_none():
    robot = under(9.81)
    assert of_free_laws(robot, UPRIGHT).shortest == 0.0
    weak = of_free_laws(robot, UPRIGHT, torque_limit=0.01)
    assert weak.shortest is None
    assert "must hold" in weak.sentence


def test_where_no_law_crosses_there_is_no_duration():
    robot = robots.load("five_bar")
    searched, request = search_path(robot, LINE), Request.of(robot, LINE, duration=1.0)
    for changed in ({"corank": 2}, {"contact": "tangential"}, {"s": 0.0}):
        points = tuple(replace(at, **changed) for at in searched.points)
        hopeless = searched._replace(points=points)
        assert optimal_durations(hopeless, request) is None
