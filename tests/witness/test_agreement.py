"""The two simulators against each other, where the robot does not do what was planned."""

import numpy as np
import pytest

from tests.benchmarks.chart.peers.five_bar import FiveBar
from tests.witness.installed import witness
from tests.witness.plans import DURATION, ROBOTS, plan_of, wrong_law

exudyn = witness("exudyn", "tests.benchmarks.chart.peers.exudyn_five_bar")
mujoco = witness("mujoco", "tests.benchmarks.chart.peers.mujoco_forward")


@pytest.mark.parametrize("name", ROBOTS)
def test_a_wrong_law_takes_both_off_the_path_to_the_same_place(name):
    """Scene B with motors that suffice for scene C: 9.8 mm off with light legs, 8.8 mm with heavy ones."""
    wrong = wrong_law(name, "rigid", "B")
    limit = 1.2 * max(plan_of(name, "rigid").peak_torque.values())
    robot, start = FiveBar.of(name, "rigid"), wrong.platform(0.0)
    ends = [
        simulator.simulate(
            robot, lambda t: np.clip(wrong.torque(t), -limit, limit), start, step=5e-4, duration=DURATION
        ).platform[-1]
        for simulator in (exudyn, mujoco)
    ]
    off = np.linalg.norm(ends - wrong.platform(DURATION), axis=1)
    assert np.all(off > 5e-3)
    assert np.linalg.norm(ends[0] - ends[1]) < 2e-3 * off.min()
