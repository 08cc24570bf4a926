"""How short a motion may be under the optimal law, told before one is sought."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import Line, NoLaw, ParallelRobot, fidelity_study, largest_load, plan_crossing
from framework.planning.feasibility import optimal_durations
from framework.planning.optimal.peak_bound import bound_plan
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


@pytest.mark.slow
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


# limits of torque and speed in the robot file bind every plan, unless they are lifted


ENOUGH = 0.06  # [N m]: the polynomial over 1.5 s peaks at 0.16, the least peak is 0.0397


def limited(torque: float) -> ParallelRobot:
    """The 5R whose file states a limit [N m] of both motors."""
    description = robots.load("five_bar").description
    motors = tuple(replace(motor, torque_limit=torque) for motor in description.actuators)
    return ParallelRobot.from_description(replace(description, actuators=motors))


def peak(plan) -> float:
    return float(np.abs(plan.torque(np.linspace(0.0, plan.duration, 5001))).max())


def test_another_law_keeps_a_limit_that_the_polynomial_exceeds():
    plan = plan_crossing(limited(ENOUGH), LINE, duration=1.5)
    assert plan.law.kind == "optimal"
    assert peak(plan) <= ENOUGH
    assert plan.exceeded == {}


def test_a_polynomial_within_the_limits_stays():
    plan = plan_crossing(limited(0.2), LINE, duration=1.5)
    assert plan.law.kind == "polynomial"
    assert peak(plan) <= 0.2


@pytest.mark.slow
def test_limits_that_no_law_keeps_are_a_refusal():
    with pytest.raises(NoLaw, match=r"least peak of torque found is .* times the limits"):
        plan_crossing(limited(0.03), LINE, duration=1.5)


@pytest.mark.parametrize("options", [{}, {"times": [1.0], "speeds": [1.5]}])
def test_a_polynomial_that_was_asked_for_is_refused_beyond_the_limits(options):
    with pytest.raises(NoLaw, match=r"torque_limit and speed_limit none .* lift"):
        plan_crossing(limited(ENOUGH), LINE, law="polynomial", duration=1.5, **options)
    lifted = plan_crossing(
        limited(ENOUGH), LINE, law="polynomial", duration=1.5, torque_limit=np.inf, **options
    )
    assert peak(lifted) > ENOUGH
    assert "right_motor" in lifted.exceeded


@pytest.mark.slow
def test_a_largest_load_is_within_the_limits_of_the_file(monkeypatch):
    monkeypatch.setattr("framework.fidelity.capacity.BRACKET_RATIO", 1.0)  # doubling will do here
    capacity = largest_load(limited(0.2), LINE, wrenches={"left_tip": [0, -1, 0, 0, 0, 0]}, duration=1.5)
    assert capacity.multiple > 0.0
    assert peak(capacity.plan) <= 0.2


def test_levels_of_a_study_are_compared_without_limits():
    description = robots.load("five_bar").description
    motors = tuple(replace(motor, speed_limit=20.0) for motor in description.actuators)
    robot = ParallelRobot.from_description(replace(description, actuators=motors))
    study = fidelity_study(robot, "C", tolerance=0.1, speed_limit=np.inf)
    assert all(comparison.motion is not None for comparison in study.levels)


# a motor without a limit of torque is not bounded by the limits of the others


AMPLE = 10.0  # [N m], a hundred times what any of these motions asks for


def five_bar(left: float | None, right: float | None) -> ParallelRobot:
    """The paper's 5R with these limits of torque [N m] in its robot file."""
    description = robots.load("five_bar").description
    limits = zip(description.actuators, (left, right), strict=True)
    motors = tuple(replace(motor, torque_limit=limit) for motor, limit in limits)
    return ParallelRobot.from_description(replace(description, actuators=motors))


def peaks(plan) -> np.ndarray:
    """Largest torque of each motor [N m]."""
    return np.abs(plan.torque(np.linspace(0.0, plan.duration, 4001))).max(axis=0)


def test_in_least_time_it_is_as_good_as_an_ample_limit():
    free, ample = (plan_crossing(five_bar(0.1, limit), LINE, optimize="time") for limit in (None, AMPLE))
    np.testing.assert_allclose(free.duration, ample.duration, rtol=1e-5)
    assert peaks(free)[0] <= 0.1 < 1.5 * 0.1 < peaks(free)[1]
    for plan in (free, ample):  # whatever the limits, there is a bound, and a good one
        assert 1.0 < plan.duration / bound_plan(plan).value < 1.01


@pytest.mark.slow
def test_the_least_energy_is_that_of_an_ample_limit():
    free, ample = (
        plan_crossing(five_bar(0.03, limit), LINE, duration=1.5, optimize="energy") for limit in (None, AMPLE)
    )
    t, weights = np.polynomial.legendre.leggauss(200)
    energies = [weights @ (plan.torque(0.75 * (t + 1)) ** 2).sum(axis=1) for plan in (free, ample)]
    # the ample limit weighs a torque of its motor less in the goal: no less energy of both alike
    assert energies[0] <= energies[1] * (1.0 + 1e-3)
    assert peaks(free)[0] <= 0.03 < peaks(free)[1]


@pytest.mark.slow
def test_the_least_peak_weighs_it_and_bounds_the_others():
    plan = plan_crossing(five_bar(0.03, None), LINE, duration=1.5, law="optimal")
    assert plan.duration == 1.5
    assert peaks(plan)[0] <= 0.03 < peaks(plan)[1]
    ample = plan_crossing(five_bar(0.03, AMPLE), LINE, duration=1.5, law="optimal")
    assert peaks(plan)[1] <= peaks(ample)[1] * (1.0 + 1e-3)
    assert peaks(plan)[1] / 0.03 > bound_plan(plan).value  # which does not count the limit of the other


@pytest.mark.slow
def test_a_refusal_tells_the_least_peak_of_the_motors_with_a_limit():
    with pytest.raises(NoLaw) as refused:
        plan_crossing(five_bar(0.02, None), LINE, duration=1.5, law="optimal")
    least = 0.02 * refused.value.evidence.torque_peak
    assert peaks(plan_crossing(five_bar(1.01 * least, None), LINE, duration=1.5, law="optimal"))[1] > least
    with pytest.raises(NoLaw):
        plan_crossing(five_bar(0.99 * least, None), LINE, duration=1.5, law="optimal")
