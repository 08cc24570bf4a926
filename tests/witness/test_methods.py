"""The simulators as methods of the work-precision chart: an error that falls with the step."""

from __future__ import annotations

import math

import pytest

from tests.benchmarks.witness_methods import methods
from tests.witness.installed import witness

witness("exudyn", "tests.benchmarks.chart.peers.exudyn_five_bar")
witness("mujoco", "tests.benchmarks.chart.peers.mujoco_forward")

CASES = [("five_bar_heavy", "rigid"), ("five_bar", "flexible_links")]


@pytest.mark.parametrize(("name", "flexibility"), CASES)
def test_each_method_is_better_with_a_shorter_step(name, flexibility):
    found = methods(name, flexibility)
    assert len(found) == 5
    for label, method in found.items():
        (_, coarse), (seconds, fine) = method(1e-3), method(5e-4)
        assert seconds > 0, label
        assert 0.8 < math.log2(coarse / fine) < 2.2, label


def test_a_step_that_is_too_long_is_an_infinite_error():
    method = methods("five_bar", "flexible_links")["MuJoCo, RK4"]
    assert method(5e-3)[1] == math.inf
