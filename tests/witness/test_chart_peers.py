"""The simulators as rows of the chart."""

import numpy as np
import pytest

from tests.benchmarks.test_chart_methods import row
from tests.witness.installed import witness

witness("exudyn", "tests.benchmarks.chart.peers.exudyn_five_bar")
witness("mujoco", "tests.benchmarks.chart.peers.mujoco_forward")


def test_mujoco_agrees():
    assert row("torque", "mujoco", 513, 3).error < 1e-9


@pytest.mark.parametrize("method", ["exudyn_alpha", "mujoco"])
def test_other_simulators_go_along_the_path_too(method):
    coarse, fine = (row("forward", method, step).error for step in (1e-2, 5e-3))
    assert fine < 1e-4
    assert 1.5 < np.log2(coarse / fine) < 4.5


@pytest.mark.slow
def test_toppra_keeps_the_limit_at_its_nodes_and_ours_between_them_too():
    pytest.importorskip("toppra")
    ours, toppra = row("optimal", "ours", 500), row("optimal", "toppra", 400)
    assert ours.error < 1e-9
    assert toppra.error > 10.0  # the pole at the singular point
    assert toppra.profile[0] < ours.profile[0] < 1.01 * toppra.profile[0]
