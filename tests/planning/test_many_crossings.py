"""Paths with many crossings: the cost of a plan grows no faster than their number."""

import sys

import numpy as np
import pytest

import robots
from framework import Spline, plan_crossing
from framework.planning import polynomial
from tests.oracles.equations_of_motion import defects_of

ACROSS, ALONG = np.array([1.0, 1.0]) / 2**0.5, np.array([-1.0, 1.0]) / 2**0.5
MIDDLE, WIDTH, PROGRESS = np.array([0.0, 0.245]), 0.05, 0.008  # [m] on the locus; across it; along it
PACE = 0.9  # [s] for each crossing


def zigzag(crossings: int) -> Spline:
    """The path to and fro across the locus of the flat five-bar."""
    turns = np.arange(crossings + 1)
    sides = WIDTH * (-1.0) ** turns
    return Spline(MIDDLE + sides[:, None] * ACROSS + PROGRESS * (turns - crossings / 2)[:, None] * ALONG)


def count_calls(crossings: int) -> int:
    """Count the interpreter's calls of a plan."""
    calls = 0

    def note(_frame, event, _argument) -> None:
        nonlocal calls
        calls += event in ("call", "c_call")

    robot, path = robots.load("five_bar"), zigzag(crossings)
    sys.setprofile(note)
    try:
        plan = plan_crossing(robot, path, duration=PACE * crossings)
    finally:
        sys.setprofile(None)
    assert len(plan.crossings) == crossings
    return calls


@pytest.mark.slow
def test_calls_grow_no_faster_than_the_number_of_crossings():
    four, twelve = count_calls(4), count_calls(12)
    assert twelve < 3.0 * four


def test_no_polynomials_are_searched_where_a_free_law_is_quicker_to_find(monkeypatch):
    tried = []
    measure = polynomial.speed_ratios_and_peaks
    monkeypatch.setattr(
        polynomial, "speed_ratios_and_peaks", lambda *of: tried.append(len(of[2])) or measure(*of)
    )
    plan = plan_crossing(robots.load("five_bar"), zigzag(4), duration=4 * PACE)
    assert sum(tried) < 10
    assert plan.law.kind == "optimal"
    assert len(plan.crossings) == 4
    defect = defects_of(plan)
    assert max(defect.open, defect.acceleration, defect.force) < 1e-8


def test_a_polynomial_through_many_points_is_searched_where_it_is_asked_for():
    robot = robots.load("five_bar")
    plan = plan_crossing(robot, zigzag(3), duration=3 * PACE, law="polynomial")
    assert plan.law.kind == "polynomial"
    assert plan.certificate.monotone
