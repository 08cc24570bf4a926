"""A plan whose time is up, or that Ctrl-C ends, is certified, or one line says that none was found yet."""

import re
import signal
import time
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest

import robots
from framework import InvalidInput, plan_scene
from framework.cli import main
from framework.cli.console import Progress
from framework.numerics.interruption import interruptible
from framework.numerics.time_limit import (
    SearchEnded,
    check_time,
    end_searches_by_ctrl_c,
    limit_time,
    report_result,
)


def test_a_search_without_a_result_ends_in_one_line():
    with pytest.raises(SearchEnded) as end:
        plan_scene(robots.load("five_bar"), "C", law="optimal", time_limit=1e-9)
    assert str(end.value) == "five_bar: the search was ended after 1e-09 s, and no law was found yet"


def test_a_goal_without_time_is_planned_with_the_polynomial():
    plan = plan_scene(robots.load("five_bar"), "C", optimize="peak_torque", time_limit=1e-9)
    assert plan.law.kind == "polynomial"
    assert "the search was ended after 1e-09 s" in plan.reason
    assert plan.certificate.tail < 1e-8


def test_a_law_that_is_returned_is_certified(monkeypatch):
    """With more time no law becomes a law whose search was ended, and this one a whole search."""
    outcomes = []
    for seconds in (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 1e9):
        clock = SimpleNamespace(monotonic=map(float, count()).__next__)  # a second passes at each look
        monkeypatch.setattr("framework.numerics.time_limit.time", clock)
        try:
            plan = plan_scene(robots.load("five_bar"), "A", law="optimal", time_limit=seconds)
        except SearchEnded:
            outcomes.append(0)
            continue
        assert plan.certificate.tail < 1e-8
        assert np.isfinite(plan.torque(np.linspace(0.0, plan.duration, 9))).all()
        outcomes.append(1 if "ended" in plan.reason else 2)
    assert outcomes == sorted(outcomes)
    assert set(outcomes) == {0, 1, 2}


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


@pytest.mark.slow
def test_ctrl_c_ends_a_search_with_its_law(hearing, capsys, monkeypatch):
    """The signal comes as soon as there is a law, the best so far, which the command proves and prints."""
    shown = []

    def interrupt_when_improving(self: Progress, doing: str) -> None:
        shown.append(doing)
        if "best law so far" in doing:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(Progress, "start", interrupt_when_improving)
    arguments = ["plan", "standing_quadruped", "--scene", "sway", "--flexibility", "flexible_links"]
    assert main([*arguments, "--law", "optimal"]) == 0
    out, err = capsys.readouterr()
    assert shown[-2] == "planning"
    assert re.fullmatch(r"planning: best law so far peak torque [\d.]+ N m; Ctrl-C ends .*", shown[-1])
    assert re.search(r"the search was ended after \d+\.?\d* s, there may be better laws", out)
    assert "joints in balance to" in out
    assert err == ""


def interrupt(results: int, interruptions: int) -> None:
    """Search with Ctrl-C: one after each result, the others behind; then ask whether the time is up."""
    with end_searches_by_ctrl_c(lambda words: None), limit_time(None):
        for k in range(interruptions):
            if k < results:
                report_result("1 s")
            signal.raise_signal(signal.SIGINT)
        check_time()
        raise AssertionError("the search goes on")


@pytest.mark.parametrize(("results", "interruptions"), [(0, 1), (1, 2), (1, 1)])
def test_ctrl_c_interrupts_without_a_law_twice_or_where_none_is_proved(hearing, results, interruptions):
    with pytest.raises(KeyboardInterrupt):
        interrupt(results, interruptions)


def test_a_second_ctrl_c_does_not_interrupt_what_cleans_up_after_a_search(hearing):
    cleaned = []

    def search_and_clean_up() -> None:
        with interruptible():
            try:
                interrupt(results=0, interruptions=1)
            finally:
                signal.raise_signal(signal.SIGINT)
                cleaned.append("all")

    with pytest.raises(KeyboardInterrupt):
        search_and_clean_up()
    assert cleaned == ["all"]
