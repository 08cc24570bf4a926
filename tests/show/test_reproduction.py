"""The call that a report tells asks for the plan that the report is about."""

from dataclasses import replace

import pytest

import framework
import robots
from framework import Arc, Line, Polyline, Spline, plan_scene
from framework.planning.request import Request
from framework.show.report import python_call

PUBLIC = {name: getattr(framework, name) for name in framework.__all__}
LINE = Line([0.1, 0.345], [-0.05, 0.195])
ARC = Arc([0.1, 0.345], [0.03, 0.28], [-0.05, 0.195])


@pytest.fixture(scope="module")
def plan():
    return plan_scene(robots.load("five_bar"), "C")


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"times": None, "speeds": None},
        {"times": ()},
        {"duration": 1.5000000000000002, "smoothness": 3, "keep_limits": True},
        {"times": None, "speeds": None, "optimize": "energy", "torque_limit": (0.3, 0.4), "margin": 0.1},
        {"times": None, "speeds": None, "duration": None, "longest": 1.7, "speed_limit": (99.0,)},
        {"times": None, "speeds": None, "torque_limit": (0.3, None)},
        {"path": ARC},
        {"path": Polyline([[0.1, 0.345], [0.0, 0.32], [0.0, 0.3]], blend=0.01)},
        {"at": (0.5,)},
        {"tolerance": 1e-9},
    ],
)
def test_the_call_of_a_report_asks_for_the_same(plan, change):
    same = replace(plan, request=replace(plan.request, **change))
    calls = []

    def record(robot, path, **options):
        calls.append((robot, path, options))

    eval(python_call(same), {**PUBLIC, "plan_crossing": record})
    ((robot, path, options),) = calls
    assert robot.description == plan.robot.description
    assert path == same.path
    assert Request.of(robot, path, **options) == same.request


def test_a_path_says_how_to_make_it():
    spline = Spline([[0.0, 0.1], [1.0, 1.0], [2.0, 0.5]])
    for path in (LINE, ARC, spline):
        assert eval(repr(path), PUBLIC) == path
