"""Targets that the robot cannot reach.

What goes wrong: the law of cosines with its argument clipped to [-1, 1] always has an answer; the leg ends
where it ends, and the gap to the target goes unnoticed. Newton's method without bounds wanders or divides by
zero.
Why: a solver that cannot say no says something else.
What we do: the path is followed to the last pose that closes, and the error says where that is, which leg
ends there, and how far it got.
"""

import numpy as np
import pytest

import robots
from framework import Line, OutOfReach, assemble, plan_crossing
from tests.oracles.planar import BASES, LENGTH

START = np.array([0.1, 0.345])
TARGETS = [(0.1, 0.41), (0.1, 0.6), (0.0, 5.0), (1e3, 0.0), (-0.6, 0.1), (1e6, 1e6)]
REACH = 2 * LENGTH


def last_reachable(target) -> tuple[float, str]:
    """s at which the straight way from START leaves the reach of a leg, in closed form, and its motor."""
    way, found = np.array(target) - START, []
    for base in BASES:
        arm = START - [base, 0.0]
        a, b, c = way @ way, arm @ way, arm @ arm - REACH**2
        found.append(-c / (b + np.sqrt(b * b - a * c)))  # c < 0: the positive root, without cancelling
    first = int(np.argmin(found))
    return float(found[first]), ("left_motor", "right_motor")[first]


@pytest.mark.parametrize("target", TARGETS)
def test_we_say_where_the_reach_ends(target):
    s, motor = last_reachable(target)
    with pytest.raises(OutOfReach, match=f"leg of {motor}") as caught:
        plan_crossing(robots.load("five_bar"), Line(START, target), duration=1.0)
    way = np.linalg.norm(np.array(target) - START)
    step = 2e-7 * max(way, 1.0)  # [m]: the shortest step of the follower is 1e-7 of the path
    assert abs(caught.value.s - s) * way < step + 1e-9
    with pytest.raises(OutOfReach):
        assemble(robots.load("five_bar"), target)


@pytest.mark.parametrize("name", ["delta", "par4", "three_rrr", "biglide"])
def test_other_robots_say_so_too(name):
    robot = robots.load(name)
    x = assemble(robot).x
    far = x.copy()
    far[0] += 100 * robot.length
    with pytest.raises(OutOfReach, match="the leg of"):
        plan_crossing(robot, Line(x, far), duration=1.0)
