"""Limits that are too low: refused with numbers that would do, and planned with these."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import robots
from framework import Line, NoLaw, ParallelRobot, plan_crossing
from framework.errors import format_distinct
from framework.laws.law import Ends
from framework.model.description import JointDynamics
from framework.planning.optimal import undeformed_law
from framework.planning.optimal.least_cost import NoneFound

LINE = Line([0.1, 0.345], [-0.05, 0.195])
DURATION = 1.5  # [s]
NEAR = 0.99  # of limits that would do: they are the least ones to 1 %


def refused(*arguments, plan=plan_crossing, **options):
    """The least limits that a refusal found, as options; each set of them would do."""
    with pytest.raises(NoLaw, match="would do") as caught:
        plan(*arguments, **options)
    evidence = caught.value.evidence
    for name, limit in evidence.limits.items():
        assert name in str(caught.value)
        assert np.all(limit >= np.array(options[name], dtype=float) * (1 - 1e-12)) or evidence.together
    return evidence.options


def kept(plan, torque_limit=np.inf, speed_limit=np.inf):
    times = np.linspace(0.0, plan.duration, 20001)
    assert np.all(np.abs(plan.torque(times)).max(axis=0) <= torque_limit)
    assert np.all(np.abs(plan.motor_angle(times, 1)).max(axis=0) <= speed_limit)


@pytest.mark.slow  # at once: test_limits_of_a_law_of_its_own_change_nothing_and_lower_ones_name_what_would_do
@pytest.mark.parametrize(
    "limits",
    [{"torque_limit": 0.03}, {"speed_limit": 10.0}, {"torque_limit": 0.03, "speed_limit": 20.0}],
    ids=["torque", "speed", "both"],
)
def test_a_limit_that_is_too_low_is_refused_with_one_that_would_do(limits):
    robot = robots.load("five_bar")
    for enough in refused(robot, LINE, duration=DURATION, **limits):
        kept(plan_crossing(robot, LINE, duration=DURATION, **{**limits, **enough}), **{**limits, **enough})
        less = {name: NEAR * limit for name, limit in enough.items()}
        refused(robot, LINE, duration=DURATION, **{**limits, **less})


def test_a_speed_limit_is_kept_to_rounding_between_samples_too():
    plan = plan_crossing(robots.load("five_bar"), LINE, optimize="time", speed_limit=(100, 70))
    kept(plan, speed_limit=(100, 70))


@pytest.mark.parametrize("other", [0.92114, 0.921100001, 0.9211 * (1 + 1e-14), 1.0, -0.9211])
def test_two_numbers_that_differ_are_shown_with_the_digits_that_differ(other):
    one, two = format_distinct(0.9211, other)
    assert one != two
    assert float(one) == pytest.approx(0.9211, rel=1e-3)
    assert format_distinct(other, other)[0] == format_distinct(other, other)[1]


def damped(*, damping: float, friction: float) -> ParallelRobot:
    """The five-bar with a left motor that has damping [N m s] and dry friction [N m] on the joint side."""
    description = robots.load("five_bar").description
    joints = {"left_motor": JointDynamics(friction=friction, damping=damping)}
    return ParallelRobot.from_description(replace(description, joints=joints))


@pytest.mark.slow
@pytest.mark.parametrize("options", [{"duration": DURATION}, {"optimize": "time", "longest": 1.0}])
@pytest.mark.parametrize(("damping", "friction"), [(0.4, 1.5), (10.0, 0.0), (40.0, 0.0)])
def test_limits_and_durations_that_would_do_count_damping_and_friction(damping, friction, options):
    """A remedy of the robot without its damping would be refused in its turn; the bound shows the same."""
    robot = damped(damping=damping, friction=friction)
    least = max(plan_crossing(robot, LINE, duration=DURATION, law="optimal").peak_torque.values())
    options = {**options, "torque_limit": 0.7 * least}
    with pytest.raises(NoLaw, match="would do") as refused:
        plan_crossing(robot, LINE, **options)
    evidence, remedy = refused.value.evidence, refused.value.remedy
    for change in (evidence.limits, remedy):
        limit = change.get("torque_limit", options["torque_limit"])
        kept(plan_crossing(robot, LINE, **{**options, **change}), torque_limit=limit)
    assert f"{evidence.limits['torque_limit'].max():.6g} N m would do" in str(refused.value)
    assert 1.0 < evidence.torque_peak / refused.value.proof.value < 1.1  # no law has less than the bound


@pytest.mark.slow
def test_a_limit_that_would_do_leaves_the_margin_free_that_was_asked_for():
    robot = robots.load("five_bar")
    options = {"duration": DURATION, "margin": 0.2}
    with pytest.raises(NoLaw, match="would do") as refused:
        plan_crossing(robot, LINE, torque_limit=0.03, **options)
    limit = refused.value.evidence.limits["torque_limit"]
    kept(plan_crossing(robot, LINE, torque_limit=limit, **options), torque_limit=0.8 * limit)


@pytest.mark.parametrize("share", [0.9, 0.4, 0.05])
def test_the_quickest_start_from_which_a_law_brakes_is_the_same_motion_slowed(monkeypatch, share):
    """With laws from 2 v at most: s' slows with v, s" with v^2; nothing slower than a tenth is tried."""

    def find_least_cost(ends):
        return NoneFound(None, "") if ends.start[0] > 2.0 * share + 1e-9 else ends

    monkeypatch.setattr(undeformed_law, "find_least_cost", find_least_cost)
    specification = SimpleNamespace(ends=Ends(start=(2.0, -3.0)), goal="time")
    problem = SimpleNamespace(specification=specification, with_goal=lambda goal, ends: ends)
    start = undeformed_law._find_slower_start(problem)
    assert start is None if share < 0.1 else start == pytest.approx((2.0 * share, -3.0 * share**2))
