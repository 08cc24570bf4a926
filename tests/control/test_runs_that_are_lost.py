"""A run that is lost, or a platform that turns round, does not change what is said of a run."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import plan_scene
from framework.control import (
    CONTROLLERS,
    ControlLoop,
    Spread,
    draw,
    reference_of,
    run_closed_loop,
    tuned_controller,
)


@pytest.mark.parametrize("sensors", ["motors", pytest.param("joints", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_run_that_runs_away_leaves_its_neighbours_alone(name, sensors):
    plan = plan_scene(robots.load("five_bar"), "C", smoothness=4)
    controller = tuned_controller(name, reference_of(plan, period=1e-2))
    good = draw(plan.robot, Spread(), (0, 0))
    wild = replace(good, friction=np.full(plan.robot.n_a, 1e200))  # not a number after one step
    alone = run_closed_loop(controller, ControlLoop(sensors=sensors), Spread(), [good])
    among = run_closed_loop(controller, ControlLoop(sensors=sensors), Spread(), [good, wild, good])
    assert "lost" in among.why[1]
    np.testing.assert_array_equal(among.tracking_error[[0, 2]], alone.tracking_error[0])


@pytest.mark.parametrize(
    "name",
    ["lqr", *(pytest.param(name, marks=pytest.mark.slow) for name in ("feedforward", "computed_torque"))],
)
def test_a_platform_may_turn_by_more_than_half_a_turn(name):
    plan = plan_scene(robots.load("four_bar"), "full_turn")
    assert plan.platform([plan.duration])[0, 0] < -np.pi
    controller = tuned_controller(name, reference_of(plan, period=5e-3))
    run = run_closed_loop(controller, ControlLoop(), Spread(), [draw(plan.robot, Spread(), (0, 0))])
    assert run.passed[0], run.why[0]
