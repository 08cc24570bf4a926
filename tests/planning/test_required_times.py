"""Required times of crossings: no refusal where a linear program finds a monotone polynomial.

The requests are drawn once: a random robot, and times of its crossings between 0.2 and 0.8 of its duration.
"""

from functools import partial

import numpy as np
import pytest

import robots
from framework import Line, NoAnswer, NoLaw, plan_crossing, simulate
from framework.planning.crossing_points import path_to_cross
from framework.planning.request import Request
from framework.singularity.points_on_path import search_path
from tests.dynamics.upright_robots import Crossing, drawn, is_right, judged, rigid_crossing
from tests.oracles.equations_of_motion import defects_of
from tests.oracles.monotone_laws import advances

SEED, REQUESTS, ROBOTS = 20261128, 200, 42
EARLIEST, LATEST, APART = 0.2, 0.8, 0.05  # times over the duration; between two of them
CHEAP = (1, 10, 12, 16)  # requests of the plain tests


def draw(k: int) -> tuple[Crossing, list[float], bool]:
    """The k-th request: a robot, the times [s] of its crossings, whether speeds are given too."""
    rng = np.random.default_rng([SEED, k])
    one = rigid_crossing(int(rng.integers(ROBOTS)))
    count = len(search_path(one.robot, one.path).points)
    while True:
        shares = np.sort(rng.uniform(EARLIEST, LATEST, count))
        if np.diff(shares).min(initial=1.0) > APART:
            return one, (one.duration * shares).tolist(), False


def has_monotone_law(one: Crossing, times: list[float], degree: int) -> bool:
    """Whether the oracle finds a law; condition (8) gives s" at each crossing."""
    request = Request.of(one.robot, one.path, duration=one.duration, times=times)
    to_cross = path_to_cross(search_path(one.robot, one.path), request)
    places = [point.s for point in to_cross.crossing_points]
    given = [point.condition for point in to_cross.crossing_points]

    def acceleration(condition, v: float) -> float:
        return -(condition.beta * v**2 + condition.gamma + condition.delta * v) / condition.alpha

    accelerations = [partial(acceleration, condition) for condition in given]
    return advances(one.duration, request.smoothness, places, times, accelerations, degree=degree)


@pytest.mark.parametrize(
    "k", [pytest.param(k, marks=() if k in CHEAP else pytest.mark.slow) for k in range(REQUESTS)]
)
def test_no_times_are_refused_for_which_the_oracle_finds_a_law(k):
    one, times, _ = draw(k)
    plan = refusal = None
    try:
        plan = plan_crossing(one.robot, one.path, duration=one.duration, times=times)
    except NoAnswer as failure:
        refusal = failure
    if plan is None:
        assert not has_monotone_law(one, times, degree=24), f"{one.name}: {refusal}"
        return
    np.testing.assert_allclose([crossing.time for crossing in plan.crossings], times, rtol=1e-9)
    assert plan.certificate.monotone
    defect = defects_of(plan)
    assert max(defect.open / max(one.robot.length, 1.0), defect.acceleration, defect.force) < 1e-8


OWN = (0.9, 1.0, 1.1)  # of the time that the planner chooses by itself


@pytest.mark.parametrize("k", [34, *(pytest.param(k, marks=pytest.mark.slow) for k in (3, 5, 9, 17, 20, 41))])
def test_times_near_the_planners_own_are_not_refused(k):
    one = rigid_crossing(k)
    own = plan_crossing(one.robot, one.path, duration=one.duration)
    times = np.array([crossing.time for crossing in own.crossings])
    for ratio in OWN:
        plan = plan_crossing(one.robot, one.path, duration=one.duration, times=times * ratio)
        np.testing.assert_allclose([crossing.time for crossing in plan.crossings], times * ratio, rtol=1e-9)


@pytest.mark.parametrize("k", [12, pytest.param(3, marks=pytest.mark.slow)])
def test_the_polynomials_own_times_are_answered_by_a_law_as_gentle(k):
    one = rigid_crossing(k)
    own = plan_crossing(one.robot, one.path, duration=one.duration, law="polynomial")
    times = [crossing.time for crossing in own.crossings]
    again = plan_crossing(one.robot, one.path, duration=one.duration, times=times)
    assert again.law.degree == own.law.degree
    assert max(again.peak_torque.values()) <= 1.01 * max(own.peak_torque.values())


@pytest.mark.parametrize("flexibility", ["rigid", "flexible_joints", "flexible_links"])
def test_an_early_time_is_met_by_a_law_of_higher_degree_and_simulated(flexibility):
    """The polynomials of degree 8 and 12 turn back there."""
    robot = robots.load("five_bar", flexibility=flexibility)
    plan = plan_crossing(robot, Line([0.1, 0.345], [-0.05, 0.195]), duration=1.5, times=[0.55])
    assert plan.law.degree > 12
    assert plan.certificate.monotone
    assert plan.crossings[0].time == pytest.approx(0.55, abs=1e-12)
    assert simulate(robot, plan).tracking_error < 1e-9


@pytest.mark.slow
def test_springs_follow_a_law_of_still_higher_degree():
    """The first degree at which the rigid law advances bends too much for deflections to be found."""
    one = drawn(23)
    time = one.duration * float(np.random.default_rng([55, 23]).uniform(EARLIEST, LATEST))
    plan = plan_crossing(one.robot(1.0), one.path, duration=one.duration, times=[time])
    assert plan.crossings[0].time == pytest.approx(time, rel=1e-9)
    assert is_right(judged(plan))


def test_a_given_speed_is_met_too():
    robot, path = robots.load("five_bar"), Line([0.1, 0.345], [-0.05, 0.195])
    plan = plan_crossing(robot, path, duration=1.5, times=[0.6], speeds=[1.0])
    assert plan.certificate.monotone
    assert plan.crossings[0].speed == pytest.approx(1.0, abs=1e-9)
    assert plan.law(0.6, 1) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.slow
def test_given_times_are_planned_within_limits_by_the_optimal_law_or_refused_with_the_time():
    robot, path = robots.load("five_bar"), Line([0.1, 0.345], [-0.05, 0.195])
    request = {"duration": 1.5, "times": [0.7]}
    peak = max(plan_crossing(robot, path, **request).peak_torque.values())
    assert plan_crossing(robot, path, **request, margin=0.1, torque_limit=1.2 * peak).crossings[0].time == 0.7
    lower = plan_crossing(robot, path, **request, torque_limit=0.8 * peak)
    assert lower.reason == "the polynomial needs 1.25 times the limits"
    assert max(lower.peak_torque.values()) <= 0.8 * peak
    assert lower.crossings[0].time == pytest.approx(0.7, rel=1e-12)
    late = r"at t = 1\.4 s, but from t = 1\.4 s to the end the quickest found within the limits takes 0\.4"
    with pytest.raises(NoLaw, match=late):
        plan_crossing(robot, path, duration=1.5, times=[1.4], law="optimal", torque_limit=0.1)
