"""How many calls a plan makes, numpy's and pinocchio's included: a plan computes each thing once.

Calls are counted by the interpreter, the same on every machine. A number below is lowered with the calls;
where it has to grow, the commit says for what.
"""

import gc
import sys

import pytest

import robots
from framework import plan_scene

MAX_GROWTH = 1.03
CALLS = {
    ("five_bar", "C", "rigid", "auto"): 4720,
    ("five_bar", "C", "flexible_joints", "auto"): 7150,
    ("five_bar", "C", "flexible_links", "auto"): 12170,
    ("five_bar", "C", "rigid", "optimal"): 37120,
    ("delta", "cross", "rigid", "auto"): 6280,
    ("gough_stewart", "tilt", "rigid", "auto"): 3420,
}


def count_calls(function):
    calls = 0

    def count(_frame, event, _argument):
        nonlocal calls
        calls += event in ("call", "c_call")

    former = sys.getprofile()
    gc.disable()  # collecting what other tests have left would make calls of its own
    sys.setprofile(count)
    try:
        function()
    finally:
        sys.setprofile(former)
        gc.enable()
    return calls


@pytest.mark.parametrize("case", CALLS, ids=" ".join)
def test_a_plan_makes_no_more_calls(case):
    name, scene, flexibility, law = case
    robot = robots.load(name, flexibility=flexibility)
    plan_scene(robot, scene, law=law)  # imports, and what is computed once for a robot
    assert count_calls(lambda: plan_scene(robot, scene, law=law)) <= MAX_GROWTH * CALLS[case]
