"""Limits of torque and speed in the robot file bind every plan, unless they are lifted."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import Line, NoLaw, ParallelRobot, fidelity_study, largest_load, plan_crossing

LINE = Line([0.1, 0.345], [-0.05, 0.195])
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


def test_limits_that_no_law_keeps_are_a_refusal():
    with pytest.raises(NoLaw, match=r"least peak of torque found is .* times the limits"):
        plan_crossing(limited(0.03), LINE, duration=1.5)


@pytest.mark.parametrize("options", [{"law": "polynomial"}, {"times": [1.0], "speeds": [1.5]}])
def test_a_polynomial_that_was_asked_for_is_refused_beyond_the_limits(options):
    with pytest.raises(NoLaw, match=r"torque_limit and speed_limit none .* lift"):
        plan_crossing(limited(ENOUGH), LINE, duration=1.5, **options)
    lifted = plan_crossing(limited(ENOUGH), LINE, duration=1.5, torque_limit=np.inf, **options)
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
