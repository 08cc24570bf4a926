"""The program of elastic robots: what it foresees, against motions in balance beside it."""

import numpy as np
import pytest

import robots
from framework import plan_scene
from framework.planning import scenes
from framework.planning.crossing_points import PathToCross
from framework.planning.optimal.elastic_loop import (
    LOOSE,
    _balance,
    _equalities,
    _find_start,
    _foresee_deflections,
)
from framework.planning.optimal.elastic_program import Costs, GoalWeights
from framework.planning.optimal.optimal_task import Task, find_crossing_points
from framework.planning.request import Request, specification_of
from framework.singularity.points_on_path import search_path


def start_of(**options):
    """The search for a law of the 5R with elastic joints, and its first motion in balance."""
    robot = robots.load("five_bar", flexibility="flexible_joints")
    path = scenes.scene_path(scenes.scene(robot, "C"))
    request = Request.of(robot, path, law="optimal", **options)
    searched = search_path(robot, path)
    task = Task(PathToCross(searched, searched.points), request, specification_of(robot, request))
    return _find_start(task, find_crossing_points(task), LOOSE)


GOALS = [
    {"optimize": "time", "torque_limit": 2.0},
    {"optimize": "peak_torque", "duration": 1.5},
    pytest.param({"optimize": "energy", "duration": 1.5}, marks=pytest.mark.slow),
]


@pytest.mark.parametrize("options", GOALS)
def test_torques_and_deflections_are_foreseen_to_second_order(options):
    """A step a tenth as large has errors a hundredth as large: here within a fiftieth."""
    search, iterate = start_of(**options)
    errors = []
    for trust in (1e-2, 1e-3):
        proposal = search.program.propose(iterate, GoalWeights(1e-4), trust, _equalities(search, iterate))
        assert proposal.step <= 1.05 * trust
        reached = _balance(search, proposal.y, iterate.balance.deflections)
        y = reached.law.coefficients  # the proposal's, but for the exact duration
        foreseen = values(_foresee_deflections(iterate, y))
        off = np.abs(values(reached.balance.deflections) - foreseen).max() / np.abs(foreseen).max()
        errors.append((off, abs(peak(reached, y) - peak(iterate, y))))
    assert np.all(np.array(errors[1]) < 0.02 * np.array(errors[0]) + 1e-7)
    assert errors[0][1] < 1e-2


def values(deflections):
    """Deflections at points of the path."""
    return deflections.splines.evaluate(deflections.series, np.linspace(-1.0, 1.0, 101))


def peak(iterate, y):
    """The largest torque [N m] that the response of a motion foresees for a law."""
    return np.abs(iterate.motors.torque + iterate.motors.slopes @ (y - iterate.response.y)).max()


@pytest.mark.slow
def test_a_better_law_is_not_missed_behind_one_that_rests_more():
    """Searches whose laws were slowed down at the ends took 0.4458 s; a law of 0.4344 s is known."""
    robot = robots.load("three_rrr", flexibility="flexible_links")
    plan = plan_scene(robot, "crossing", optimize="time", torque_limit=2.0, law="optimal")
    assert plan.duration <= 0.4441
    assert max(plan.peak_torque.values()) <= 2.0


def test_a_certificate_that_finds_more_lowers_what_programs_may_use():
    weights = GoalWeights(1e-4)
    costs = Costs(goal=1.0, duration=1.0, roughness=1.0, limit_ratio=0.9995, end_rate=0.5)
    assert weights.learn(costs, excess=1.0004, unrest=0.5).limit_ratio == pytest.approx(
        1.0004 / 0.9995, rel=2e-5
    )
    assert weights.learn(costs, excess=0.9999, unrest=0.5) == weights
    assert weights.learn(costs, excess=0.9, unrest=1.5).rest_ratio == pytest.approx(3.0)
