"""A plan whose time is up is certified, or one line says that none was found yet."""

from __future__ import annotations

import time

import numpy as np
import pytest

import robots
from framework import InvalidInput, plan_scene
from framework.numerics.time_limit import SearchEnded, check_time, limit_time


def test_a_search_without_a_result_ends_in_one_line():
    with pytest.raises(SearchEnded) as end:
        plan_scene(robots.load("five_bar"), "C", law="optimal", time_limit=1e-9)
    assert str(end.value) == "five_bar: the search was ended after 1e-09 s, and no law was found yet"


def test_a_goal_without_time_is_planned_with_the_polynomial():
    plan = plan_scene(robots.load("five_bar"), "C", optimize="peak_torque", time_limit=1e-9)
    assert plan.law.kind == "polynomial"
    assert "the search was ended after 1e-09 s" in plan.reason
    assert plan.certificate.tail < 1e-8


@pytest.mark.parametrize("seconds", [0.05, 0.2, 1e9])
def test_a_law_that_is_returned_is_certified(seconds):
    """Whatever the time of this machine allows."""
    try:
        plan = plan_scene(robots.load("five_bar"), "A", law="optimal", time_limit=seconds)
    except SearchEnded:
        assert seconds < 1.0
        return
    assert plan.certificate.tail < 1e-8
    assert np.isfinite(plan.torque(np.linspace(0.0, plan.duration, 9))).all()
    assert ("ended" in plan.reason) <= (seconds < 1.0)


def test_a_limit_is_that_of_its_block_alone():
    with limit_time(1e-9) as clock:
        time.sleep(1e-3)
        with limit_time(None):
            check_time()
        with pytest.raises(SearchEnded):
            check_time()
    assert clock.has_ended
    check_time()


def test_no_time_is_no_limit():
    with pytest.raises(InvalidInput, match="0"):
        plan_scene(robots.load("five_bar"), "C", time_limit=0.0)
