"""The command line, or the call, that a report tells asks for the plan that the report is about."""

from __future__ import annotations

import shlex
from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import Arc, Line, Spline, plan_crossing, plan_scene, public
from framework.cli import arguments
from framework.cli.commands import OneLineParser
from framework.cli.parser import add_flexibility, add_motion, add_path, add_robot
from framework.show.report import command_line, given_options, python_call

LINE = Line([0.1, 0.345], [-0.05, 0.195])
ARC = Arc([0.1, 0.345], [0.03, 0.28], [-0.05, 0.195])


@pytest.fixture(scope="module")
def plan():
    return plan_scene(robots.load("five_bar"), "C")


def asked(plan, line):
    """The request of a command line for the robot of a plan."""
    parser = OneLineParser()
    for add in (add_robot, add_path, add_flexibility, add_motion):
        add(parser)
    parser.add_argument("--out")
    parser.add_argument("--keep-limits", action="store_true", default=None)
    command, verb, *words = shlex.split(line.replace("\\\n", " "))
    assert (command, verb) == ("crossing", "plan")
    options = parser.parse_args(words)
    assert (options.robot, options.flexibility) == ("five_bar", plan.robot.flexibility)
    return arguments.request(options, plan.robot)


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
    ],
)
def test_a_command_line_asks_for_the_same(plan, change):
    same = replace(plan, request=replace(plan.request, **change))
    assert asked(same, command_line(same, "again")) == same.request


def test_a_scene_stands_for_a_path_that_no_option_can_say(plan):
    printed = robots.load("five_bar").description.scenes["C-printed"]
    same = replace(plan, request=replace(plan.request, at=printed.at, times=printed.times))
    line = command_line(same, "again")
    assert "--scene C-printed" in line
    assert asked(same, line) == same.request


@pytest.mark.parametrize("change", [{"path": ARC}, {"at": (0.5,)}, {"tolerance": 1e-9}])
def test_what_no_command_line_can_ask_is_told_as_a_call(plan, change):
    same = replace(plan, request=replace(plan.request, **change))
    assert command_line(same, "again") is None
    calls = []

    def record(robot, path, **options):
        calls.append((robot, path, options))

    eval(python_call(same), {**vars(public), "plan_crossing": record})
    ((robot, path, options),) = calls
    assert robot.description == plan.robot.description
    assert path == same.path
    assert options == given_options(same)


def test_a_path_says_how_to_make_it():
    spline = Spline([[0.0, 0.1], [1.0, 1.0], [2.0, 0.5]])
    for path in (LINE, ARC, spline):
        assert eval(repr(path), vars(public)) == path


def test_the_plan_of_the_command_is_the_plan(plan):
    again = plan_crossing(plan.robot, plan.path, **given_options(plan))
    np.testing.assert_array_equal(again.law.coefficients, plan.law.coefficients)
