"""Laws of splines that become one series, as deflections need them."""

import numpy as np
import pytest

import robots
from framework import Line, plan_scene
from framework.laws.exact_duration import SpeedSpace
from framework.planning.crossing_points import PathToCross
from framework.planning.optimal.elastic_balance import _fit_series
from framework.planning.optimal.law_problem import condition_rows
from framework.planning.optimal.optimal_task import Task, find_crossing_points
from framework.planning.optimal.undeformed_law import problem_of, solve_problem
from framework.planning.request import Request
from framework.planning.specification import specification_of
from framework.singularity.points_on_path import search_path


@pytest.mark.parametrize("share", [0.08, 1.0])
def test_a_series_fitted_to_splines_keeps_duration_condition_and_speed(share):
    robot, path = robots.load("five_bar", flexibility="flexible_links"), Line([0.1, 0.345], [-0.05, 0.195])
    request = Request.of(robot, path, duration=1.5, law="optimal")
    searched = search_path(robot, path)
    task = Task(PathToCross(searched, searched.points), request, specification_of(robot, request))
    places = find_crossing_points(task)
    law = solve_problem(problem_of(task, places), share=share).law
    series = _fit_series(problem_of(task, places), law)
    assert not series.basis.is_spline
    duration = SpeedSpace(series.basis, series.stretch).duration(series.coefficients)
    assert duration == pytest.approx(1.5, rel=1e-11)
    rows = condition_rows(problem_of(task, places), series.basis)
    terms = np.abs(rows.matrix.toarray() * series.coefficients).sum(axis=1)
    assert np.all(np.abs(rows(series.coefficients)) <= 1e-11 * terms)
    sigma = np.linspace(0.0, 1.0, 301)
    np.testing.assert_allclose(series.squared_speed(sigma), law.squared_speed(sigma), rtol=0.05)


@pytest.mark.slow
def test_a_limit_that_is_exceeded_between_points_still_has_a_law():
    robot = robots.load("three_rrr", flexibility="flexible_joints")
    plan = plan_scene(robot, "crossing", law="optimal", optimize="time", torque_limit=30.0, duration=None)
    assert max(plan.peak_torque.values()) <= 30.0
    rigid = plan_scene(
        robots.load("three_rrr"), "crossing", law="optimal", optimize="time", torque_limit=30.0, duration=None
    )
    assert rigid.duration < plan.duration < 1.05 * rigid.duration
