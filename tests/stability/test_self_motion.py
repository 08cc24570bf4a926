"""A finite self-motion: the 5R with equal rods, its elbows on one point.

What goes wrong: when both elbows meet, the payload may turn about them on a whole circle with the motors at
rest. Forward kinematics has a circle of answers for one pose of the motors; Newton's method returns any of
them with a perfect residual.
Why: the motors' angles do not say where the payload is, so nothing computed from them alone can.
What we do: positions come from the path, by inverse kinematics, which is regular there. Each point of the
circle is a crossing like others; a path along the circle is refused.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import robots
from framework import Arc, Line, ParallelRobot, SingularPath, locate_singularities, plan_crossing
from tests.oracles import naive

CENTRE, RADIUS = np.array([0.0, 0.15]), 0.25  # where the elbows meet: 0.25 m from both motors [m]
MOTORS = np.array([np.arctan2(0.15, 0.2), np.pi - np.arctan2(0.15, 0.2)])  # [rad]


@cache
def robot() -> ParallelRobot:
    """The 5R with both elbows inward: only so do they meet below the payload."""
    inward = {"left_motor": 0.8, "left_elbow": 0.9, "right_motor": np.pi - 0.8, "right_elbow": -0.9}
    return ParallelRobot.from_description(replace(robots.load("five_bar").description, reference=inward))


def on_circle(degrees: float, radius: float = RADIUS) -> np.ndarray:
    angle = np.deg2rad(degrees)
    return CENTRE + radius * np.array([np.cos(angle), np.sin(angle)])


def newton_answers(starts: int = 20) -> tuple[np.ndarray, np.ndarray]:
    """Payloads (starts, 2) [m] that Newton's method gives for one pose of the motors; closure errors [m]."""
    found = np.array(
        [naive.newton_platform(MOTORS, on_circle(a, 0.27)) for a in np.linspace(20, 160, starts)]
    )
    return found, np.abs(np.linalg.norm(found - CENTRE, axis=1) - RADIUS)


def our_crossings() -> tuple[np.ndarray, np.ndarray]:
    """Distance [m] of the located points from the circle, and motor angles (k, 2) there [rad]."""
    errors, motors = [], []
    for degrees in (75, 85, 90, 95, 105):
        path = Line(on_circle(degrees, 0.26), on_circle(degrees, 0.2) + np.array([0.02, 0.0]))
        (point,) = locate_singularities(robot(), path)
        errors.append(abs(np.linalg.norm(point.platform - CENTRE) - RADIUS))
        motors.append(point.q[robot().actuated])
    return np.array(errors), np.array(motors)


def test_all_points_of_the_circle_belong_to_one_pose_of_the_motors():
    errors, motors = our_crossings()
    assert errors.max() < 1e-14
    np.testing.assert_allclose(motors, np.tile(MOTORS, (len(motors), 1)), rtol=0, atol=1e-12)


def test_the_twist_is_tangent_to_the_circle_and_the_crossing_is_planned():
    path = Arc(on_circle(75, 0.27), on_circle(85, 0.25), on_circle(95, 0.2))
    (point,) = locate_singularities(robot(), path)
    assert abs(point.twist @ (point.platform - CENTRE)) < 1e-12
    plan = plan_crossing(robot(), path, duration=1.0)
    first, second = (path(point.s, order) for order in (1, 2))
    expected = -(point.twist @ second) / (point.twist @ first)  # massless legs: condition (8) of the payload
    (crossing,) = plan.crossings
    assert crossing.acceleration / crossing.speed**2 == pytest.approx(expected, rel=1e-9)
    assert plan.certificate.tail < 1e-10


def test_a_path_along_the_circle_is_refused():
    with pytest.raises(SingularPath, match="runs along a singularity"):
        plan_crossing(robot(), Arc(on_circle(110), on_circle(90), on_circle(70)), duration=1.0)
