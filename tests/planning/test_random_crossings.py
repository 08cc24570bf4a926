"""Random crossings of planar and spatial robots: no torque is accepted that is wrong beside the locus.

The equations of motion that the tests write anew are held at the crossing and 1e-9, 1e-6 and 1e-3 s beside
it, where the quotient 0/0 of the torques would show an error of the crossing's place.
"""

import numpy as np
import pytest

from framework import NoAnswer, plan_crossing
from tests.oracles.equations_of_motion import defects_at
from tests.planning.random_lines import SCENES, random_crossings

COUNT, SEED = 29, 54  # of each robot, 203 in all
PLAIN = {"five_bar": 2, "delta": 1}  # a few of one planar and one spatial robot for every day
BESIDE = [-1e-3, -1e-6, -1e-9, 0.0, 1e-9, 1e-6, 1e-3]  # [s]


def check_crossings(name, count):
    robot, motions = random_crossings(name, count, SEED)
    planned = 0
    for line, duration in motions:
        try:
            plan = plan_crossing(robot, line, duration=duration, law="polynomial")
        except NoAnswer:
            continue
        planned += 1
        t = np.concatenate([crossing.time + np.array(BESIDE) for crossing in plan.crossings])
        found = defects_at(plan, t)
        assert found.open < 1e-12 * max(robot.length, 1.0)
        assert found.speed < 1e-12
        assert found.acceleration < 1e-12
        assert found.force < 1e-9
    return planned


@pytest.mark.parametrize("name", PLAIN)
def test_torques_beside_a_crossing_move_the_robot(name):
    check_crossings(name, PLAIN[name])


@pytest.mark.slow
# no polynomial crosses on the lines about the scene of par4
@pytest.mark.parametrize("name", [name for name in SCENES if name != "par4"])
def test_torques_beside_many_crossings_move_the_robot(name):
    assert check_crossings(name, COUNT) >= 3
