"""Derivatives by differences.

What goes wrong: the rotor's torque needs the second derivative of the motor angle, and an elastic drive the
second derivative of a torque. By forward differences over a step h the error is of size h plus eps / h^2:
whatever the step, half of the digits and more are gone, and a small step is worse than a large one.
Why: the difference of two nearly equal numbers keeps their rounding and loses their value.
What we do: functions of time are series, and derivatives are exact for them; the rounding of 64 nodes is
amplified by about 64^2 and 64^4 / 10, and that much of it is seen.
"""

from functools import cache

import numpy as np

import robots
from framework import plan_scene
from tests.oracles import five_bar as oracle
from tests.oracles import naive

STEPS = 10.0 ** -np.arange(1, 9)  # [s]
TIMES = (0.2, 0.5, 0.9, 1.0, 1.2)  # [s]


@cache
def plan():
    return plan_scene(robots.load("five_bar", flexibility="flexible_joints"), "C")


@cache
def exact(t: float) -> np.ndarray:
    """Second time derivative of the motor angles (2,) [rad/s^2] by differences with fifty digits."""
    solved, h = oracle.solve("C", "flexible_joints", "deformed"), oracle.mp.mpf(10) ** -12
    ahead, here, back = (solved.motor_angle(oracle.mp.mpf(t) + k * h) for k in (1, 0, -1))
    return np.array([float((a - 2 * b + c) / h**2) for a, b, c in zip(ahead, here, back, strict=True)])


def naive_error(step: float) -> float:
    """Relative error of forward differences of our own angles, themselves good to 1e-14."""
    found = np.array([naive.second_difference(plan().motor_angle, t, step) for t in TIMES])
    return _relative(found)


def our_error() -> float:
    """Relative error of the derivative of our series."""
    return _relative(np.array([plan().motor_angle(t, 2) for t in TIMES]))


def _relative(found: np.ndarray) -> float:
    true = np.array([exact(t) for t in TIMES])
    return float(np.abs(found - true).max() / np.abs(true).max())


def test_no_step_is_a_good_step():
    errors = np.array([naive_error(step) for step in STEPS])
    assert errors.min() > 1e-5  # eleven digits of sixteen are gone
    assert errors[-1] > 1.0  # nothing but rounding
    assert our_error() < 1e-10
