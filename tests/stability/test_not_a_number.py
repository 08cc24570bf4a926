"""Inputs that are no numbers: NaN, infinities, numbers whose square overflows.

What goes wrong: every comparison with NaN is false, so `error > allowed` lets it pass, and it comes out of
the other end of a thousand lines as a torque of NaN. A number of 1e200 does the same one multiplication
later.
Why: checks are written for what is too large, not for what is no number.
What we do: each public entry refuses what is not a finite number of a size that can be worked with, and names
it. Instants outside the motion are refused as well: a polynomial goes on there, and means nothing.
"""

import math
from functools import cache

import numpy as np
import pytest

import robots
from framework import (
    Arc,
    Condition,
    InvalidInput,
    Law,
    Line,
    NoAnswer,
    ParallelRobot,
    Spline,
    assemble,
    inverse_dynamics,
    plan_crossing,
    velocity_matrices,
)
from framework.dynamics.finite_differences import finite_difference_torques
from tests.oracles.planar import LINE

BAD = [math.nan, math.inf, -math.inf]
HUGE = [1e200, -1e200]


@cache
def robot():
    return robots.load("five_bar")


@cache
def plan():
    return plan_crossing(robot(), LINE, duration=1.5)


class Constant:
    """A law brought by a user that is one value throughout."""

    duration = 1.5

    def __init__(self, value: float) -> None:
        self.value = value

    def __call__(self, t, order=0):
        return np.full(np.shape(t), self.value)


ENTRIES = {
    "line": lambda bad: Line([0.1, bad], [0.0, 0.2]),
    "arc": lambda bad: Arc([0.1, 0.345], [0.0, bad], [0.1, 0.3]),
    "spline": lambda bad: Spline([[0.1, 0.345], [bad, 0.3], [0.1, 0.2]]),
    "duration": lambda bad: plan_crossing(robot(), LINE, duration=bad),
    "time": lambda bad: plan_crossing(robot(), LINE, duration=1.5, times=[bad]),
    "speed": lambda bad: plan_crossing(robot(), LINE, duration=1.5, speeds=[bad]),
    "time and speed": lambda bad: plan_crossing(robot(), LINE, duration=1.5, times=[1.0], speeds=[bad]),
    "at": lambda bad: plan_crossing(robot(), LINE, duration=1.5, at=[bad]),
    "tolerance": lambda bad: plan_crossing(robot(), LINE, duration=1.5, tolerance=bad),
    "smoothness": lambda bad: plan_crossing(robot(), LINE, duration=1.5, smoothness=bad),
    "law": lambda bad: inverse_dynamics(robot(), LINE, Constant(bad)),
    "condition": lambda bad: Law.rest_to_rest(1.0, 2, [Condition(bad, 0, 0.5)]),
    "torque": lambda bad: plan().torque(bad),
    "torques": lambda bad: plan().torque([0.1, bad]),
    "motor angle": lambda bad: plan().motor_angle(bad),
    "law of a plan": lambda bad: plan().law(bad),
    "platform": lambda bad: plan().platform(bad),
    "samples": lambda bad: plan().samples(bad),
    "raw samples": lambda bad: finite_difference_torques(robot(), LINE, plan().law, samples=bad),
}


CASES = [
    (entry, bad) for entry in ENTRIES for bad in (*BAD, *HUGE) if "samples" not in entry or bad not in HUGE
]


@pytest.mark.parametrize(("entry", "bad"), CASES)
def test_every_entry_refuses_what_is_no_number(entry, bad):
    with pytest.raises(InvalidInput):
        ENTRIES[entry](bad)


@pytest.mark.parametrize("bad", BAD, ids=repr)
def test_configurations_are_refused_too(bad):
    with pytest.raises(InvalidInput):
        assemble(robot(), [0.1, bad])
    with pytest.raises(InvalidInput):
        velocity_matrices(robot(), [0.1, bad, 0.0, 0.0])


@pytest.mark.parametrize("key", ["stiffness", "gear_ratio", "reference", "gravity", "duration"])
@pytest.mark.parametrize("bad", [".nan", ".inf", "1e999"])
def test_a_robot_file_with_such_a_number_names_the_key(write_robot, key, bad):
    value = float(bad.replace(".", "")) if bad != "1e999" else bad
    place = {
        "stiffness": "springs.0.stiffness",
        "gear_ratio": "actuators.0.gear_ratio",
        "reference": "reference.left_motor",
        "gravity": "gravity",
        "duration": "scenes.A.duration",
    }[key]
    content = [0.0, value, 0.0] if key == "gravity" else value
    with pytest.raises(InvalidInput, match=key):
        ParallelRobot.from_file(write_robot((place, content)))


@pytest.mark.parametrize("t", [-1.0, -1e-6, 1.5 + 1e-6, 3.0])
def test_instants_outside_the_motion_are_refused(t):
    # the polynomial of degree 8 would go on: at 3 s to s = 1e3 and more
    beyond = np.polynomial.chebyshev.chebval(2 * t / 1.5 - 1, plan().law.coefficients)
    assert abs(t) < 1.6 or abs(beyond) > 1e2
    for ask in (plan().law, plan().torque, plan().platform, plan().motor_angle):
        with pytest.raises(InvalidInput, match="outside"):
            ask(t)


def test_points_too_far_apart_to_be_worked_with_are_refused_or_out_of_reach():
    for far in (1e3, 1e9, 1e20, 1e29):
        with pytest.raises((NoAnswer, InvalidInput)):
            plan_crossing(robot(), Line([0.1, 0.345], [0.1, far]), duration=1.0)
    with pytest.raises(InvalidInput, match="too uneven"):
        Spline([[0.1, 0.3], [0.1, 1e20], [0.0, 0.3], [0.0, 0.2]])
