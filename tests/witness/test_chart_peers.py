"""A simulator as a row of the chart."""

from tests.benchmarks.test_chart_methods import row
from tests.witness.installed import witness

witness("mujoco", "tests.benchmarks.chart.peers.mujoco_inverse")


def test_mujoco_agrees():
    assert row("torque", "mujoco", 513, 3).error < 1e-9
