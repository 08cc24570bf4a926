"""What condition (8) asks for before a law is sought: coefficients, shares, and which way to go."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import Arc, InvalidInput, Line, NoLaw, ParallelRobot, plan_crossing
from framework.planning.feasibility import feasibility_on_path
from framework.singularity.points_on_path import search_path

LINE = Line([0.1, 0.345], [-0.05, 0.195])
UPRIGHT = Line([0.03, 0.33], [-0.02, 0.18])


def payload_under(gravity) -> ParallelRobot:
    """The paper's 5R, a payload on massless legs, with this gravity."""
    description = robots.load("five_bar").description
    return ParallelRobot.from_description(replace(description, gravity=gravity), flexibility="rigid")


def asked(robot, path):
    (found,) = feasibility_on_path(search_path(robot, path))
    return found


@pytest.mark.parametrize("path", [LINE, UPRIGHT, Arc([0.1, 0.345], [0.0, 0.29], [-0.05, 0.195])])
def test_of_a_payload_on_massless_legs_it_is_newtons_law_along_t_s(path):
    robot = payload_under((0.0, -9.81, 0.0))
    searched = search_path(robot, path)
    (found,) = feasibility_on_path(searched)
    t_s, mass = searched.points[0].twist, 10.0  # kg, the paper's
    slope, bend = (path(found.s, order) for order in (1, 2))
    np.testing.assert_allclose(found.condition.alpha, mass * t_s @ slope, rtol=1e-9)
    np.testing.assert_allclose(found.condition.gamma, mass * t_s @ [0.0, 9.81], rtol=1e-9)
    np.testing.assert_allclose(found.condition.beta, mass * t_s @ bend, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.weight_share, abs(t_s[1]) / np.linalg.norm(t_s), rtol=1e-9)
    share = abs(t_s @ slope) / np.linalg.norm(t_s) / np.linalg.norm(slope)
    np.testing.assert_allclose(found.tangent_share, share, rtol=1e-9)
    np.testing.assert_allclose(0.5 * abs(found.acceleration[0]) * found.pace**2, 1.0, rtol=1e-12)


def test_lying_flat_nothing_is_asked_but_s2_zero():
    found = asked(robots.load("five_bar"), LINE)
    assert found.weightless
    assert found.pace is None
    assert found.weight_share == 0.0
    unweighed = 's" = 0; no weight enters, so a law that meets it may be stretched to any duration'
    assert unweighed in found.sentence


def test_the_pace_tells_quick_motions_with_a_polynomial_from_slow_ones_without():
    robot = payload_under((0.0, -9.81, 0.0))
    pace = asked(robot, UPRIGHT).pace
    assert plan_crossing(robot, UPRIGHT, duration=pace, law="polynomial").certificate.monotone
    told = rf"100 % of the weight.*which covers the path from rest in {pace:.3g} s"
    backward = Line(UPRIGHT(np.ones(1))[0], UPRIGHT(np.zeros(1))[0])  # the same s" brakes
    assert asked(robot, backward).short_sentence.endswith(f"which covers the path to rest in {pace:.3g} s")
    with pytest.raises(NoLaw, match=told) as caught:
        plan_crossing(robot, UPRIGHT, duration=4 * pace, law="polynomial")
    assert len(str(caught.value)) < 400  # five lines of a terminal
    assert plan_crossing(robot, UPRIGHT, duration=4 * pace, law="optimal").certificate.monotone


def test_a_path_orthogonal_to_t_s_leaves_a_steady_speed_or_nothing():
    found = asked(payload_under((0.0, -9.81, 0.0)), UPRIGHT)
    condition = found.condition._replace(alpha=0.0, beta=2.0, gamma=-8.0)
    level = replace(found, condition=condition)
    assert level.steady_speed == 2.0
    assert "only s' = 2 does; turn the path towards t_s" in level.sentence
    nearly_linear = replace(level, condition=condition._replace(beta=1e-320, gamma=-1.0, delta=1.0))
    assert nearly_linear.steady_speed == 1.0
    hopeless = replace(level, condition=condition._replace(beta=0.0))
    assert "no law meets it; turn the path towards t_s" in hopeless.sentence
    assert hopeless.acceleration is None


def test_a_bent_path_is_told_to_be_smoother():
    found = asked(robots.load("five_bar"), LINE)
    bent = replace(found, condition=found.condition._replace(beta=-10.0 * found.condition.alpha))
    assert "s' changes e-fold over 0.1 of the path there: make it smoother" in bent.sentence


def test_where_several_motions_escape_no_single_condition_is_told():
    robot = robots.load("five_bar")
    searched = search_path(robot, LINE)
    twofold = tuple(replace(at, corank=2) for at in searched.points)
    assert feasibility_on_path(searched._replace(points=twofold)) == (None,)


def test_times_of_another_duration_are_named():
    with pytest.raises(InvalidInput, match=r"1500 s through t = 1 s \(s' = 1.5 1/s\).*or take law optimal"):
        plan_crossing(robots.load("five_bar"), LINE, duration=1500.0, times=[1.0], speeds=[1.5])
