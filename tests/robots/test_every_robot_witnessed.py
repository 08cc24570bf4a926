"""Planned motions obey the equations of motion as the tests write them: for every robot and flexibility.

Generated: a robot added to the catalogue is tested here without a line written. `simulate` shares frames,
loop equations, their choice and the platform's coordinates with the planner, and would go along with a fault
in them. The witness here shares the tree and the words of the robot file (see `equations_of_motion`).
It looks at instants and costs little; `test_every_robot_simulated.py` integrates.
"""

import numpy as np
import pytest

import robots
from tests.oracles.equations_of_motion import defects_of
from tests.robots.every_robot import STAGED, crossing

# [N m], on the motor side, of rigid robots' first crossings
PEAK_TORQUE = {"delta": 10.0, "gough_stewart": 500.0, "orthoglide": 0.5, "par4": 2.0, "spherical_rrr": 0.5}


@pytest.mark.parametrize("case", STAGED)
def test_a_plan_obeys_the_equations_of_motion_written_anew(case):
    name, flexibility = case
    robot = robots.load(name, flexibility=flexibility)
    plan = crossing(robot)
    assert plan.certificate.tail < 1e-9
    speed = plan.law(plan.duration * np.linspace(0.0, 1.0, 2001)[1:-1], 1)
    assert plan.certificate.monotone == (speed.min() > 0.0)
    assert all(point.residual < 1e-12 for point in plan.crossings)
    if flexibility == "rigid" and name in PEAK_TORQUE:
        assert plan.certificate.monotone
        assert max(plan.peak_torque.values()) < PEAK_TORQUE[name]
    found = defects_of(plan)
    size = max(robot.length, 1.0)
    assert found.open < 1e-12 * size  # measured: 1e-14 at most
    assert found.platform < 1e-12 * size
    # derivatives of Chebyshev series lose three digits a time or more; measured: 1e-11, 2e-8, 3e-8 at most
    assert found.speed < 1e-9
    assert found.acceleration < 1e-6
    assert found.force < 1e-6
