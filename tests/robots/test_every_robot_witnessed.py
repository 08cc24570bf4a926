"""Planned motions obey the equations of motion as the tests write them: for every robot and flexibility.

Generated: a robot added to the catalogue is tested here without a line written. `simulate` shares frames,
loop equations, their choice and the platform's coordinates with the planner, and would go along with a fault
in them. The witness here shares the tree and the words of the robot file (see `tests.equations_of_motion`).
It looks at instants and costs little; `test_every_robot_simulated.py` integrates.
"""

from __future__ import annotations

import sys

import numpy as np
import pytest

import robots
from framework import CrossingPlan, simulate
from framework.kinematics import closures
from tests.equations_of_motion import Defects, defects
from tests.robots.every_robot import CASES, crossing

SHIFT = 0.01  # [m]
SHIFTED = ("five_bar", "biglide", "three_rpr", "three_rrr", "delta", "gough_stewart")


def defects_of(plan: CrossingPlan) -> Defects:
    """What 23 instants of a plan leave of the equations of motion."""
    t = np.linspace(0.0, plan.duration, 23)
    motion = plan.dynamics
    return defects(
        plan.robot,
        q=motion.configuration(t),
        v=motion.velocity(t),
        a=motion.velocity(t, 2),
        torque=plan.torque(t),
        x=plan.platform(t),
    )


@pytest.mark.parametrize("case", CASES, ids="-".join)
def test_a_plan_obeys_the_equations_of_motion_written_anew(case):
    name, flexibility = case
    robot = robots.load(name, flexibility=flexibility)
    found = defects_of(crossing(robot))
    size = max(robot.length, 1.0)
    assert found.open < 1e-12 * size  # measured: 1e-14 at most
    assert found.platform < 1e-12 * size
    # derivatives of Chebyshev series lose four digits a time; measured: 7e-11, 2e-7, 3e-8 at most
    assert found.speed < 1e-9
    assert found.acceleration < 1e-5
    assert found.force < 1e-6


@pytest.mark.parametrize("name", SHIFTED)
def test_loops_shifted_in_the_code_that_all_share_are_seen_by_the_witness_alone(name, monkeypatch):
    """Every loop closes 10 mm beside itself, along the x axis of its first frame."""
    original = closures.loop_wrenches

    def shifted(rows, at):
        loops = original(rows, at)
        along_x = ~rows.rotation & ~rows.distance & (rows.first_axis == 0)
        return loops._replace(residual=loops.residual + SHIFT * along_x)

    for module in [module for key, module in sys.modules.items() if key.startswith("framework.")]:
        if getattr(module, "loop_wrenches", None) is original:
            monkeypatch.setattr(module, "loop_wrenches", shifted)
    robot = robots.load(name)
    plan = crossing(robot, times=None, speeds=None)
    assert plan.certificate.max_closure_error < 1e-12
    followed = simulate(robot, plan)
    assert followed.closure_error < 1e-11
    assert followed.tracking_error < 1e-7  # a wrong robot, and nobody who could tell
    assert defects_of(plan).open > 0.5 * SHIFT
