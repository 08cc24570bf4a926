"""A fault in what planner and simulator share: both go along with it, the witness of the tests does not.

`simulate` takes its loop equations from where the planner takes them. `equations_of_motion` writes them
anew from the words of the robot file.
"""

import sys

import pytest

import robots
from framework import simulate
from framework.kinematics import closures
from tests.oracles.equations_of_motion import defects_of
from tests.robots.every_robot import crossing

SHIFT = 0.01  # [m]


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("three_rpr", "three_rrr")]


@pytest.mark.parametrize("name", ["five_bar", "biglide", "delta", "gough_stewart", *SLOW])
def test_loops_shifted_in_the_code_that_all_share_are_seen_by_the_witness_alone(name, monkeypatch):
    """Every loop closes 10 mm beside itself, along the x axis of its first frame."""
    original = closures.loop_wrenches

    def shifted(rows, at):
        loops = original(rows, at)
        along_x = rows.translation & (rows.first_axis == 0)
        return loops._replace(residual=loops.residual + SHIFT * along_x)

    for module in [module for key, module in sys.modules.items() if key.startswith("framework.")]:
        if getattr(module, "loop_wrenches", None) is original:
            monkeypatch.setattr(module, "loop_wrenches", shifted)
    robot = robots.CATALOGUE[name].load()
    plan = crossing(robot, times=None, speeds=None)
    assert plan.certificate.max_closure_error < 1e-12
    followed = simulate(robot, plan)
    assert followed.closure_error < 1e-11
    assert followed.tracking_error < 1e-7  # a wrong robot, and nobody who could tell
    assert defects_of(plan).open > 0.5 * SHIFT
