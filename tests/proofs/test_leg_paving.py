"""The bounds that a paving of joints rests on, and that it misses nothing."""

import numpy as np
import pytest

import robots
from framework.kinematics.frames import difference
from framework.kinematics.modes import legs
from framework.proofs import leg_paving
from framework.proofs.leg_paving import are_leg_solutions_complete
from framework.proofs.passive_joints import distinct_rows
from framework.proofs.working_modes import working_modes
from framework.tolerances import DISTINCT_SOLUTIONS


def posed(robot, leg):
    """A leg's columns, and those that are given."""
    given = np.ones(robot.model.nv, dtype=bool)
    given[robot.moving] = False
    given[robot.moving[leg.needed]] = True
    return robot.moving[leg.columns], given


@pytest.mark.parametrize(
    "name", ["five_bar", "three_rpr", "agile_eye", "humanoid_ankle", "orthoglide", "gough_stewart"]
)
def test_no_equation_bends_more_than_its_bound(name):
    """|F(c + d) - F(c) - J d| in boxes of all sizes, at their corners and inside."""
    robot, rng = robots.load(name), np.random.default_rng(1)
    for leg in legs(robot):
        own, given = posed(robot, leg)
        equations = leg_paving.LegEquations.of(robot, own, given, robot.reference.q, robot.reference.x)
        r = 10.0 ** rng.uniform(-3, 0.5, (200, len(own)))
        c, xi = rng.uniform(-2, 2, r.shape), np.clip(rng.uniform(-1.5, 1.5, r.shape), -1, 1)
        lines, there = equations(c, r), equations(c + xi * r, 0 * r).values
        rest = np.abs(there - lines.values - (lines.slopes @ (xi * r)[:, :, None])[:, :, 0])
        assert np.all(rest <= lines.errors)


@pytest.mark.parametrize("name", ["five_bar", "three_rpr", "agile_eye", "humanoid_ankle", "slider_crank"])
def test_a_solution_that_is_not_known_leaves_the_leg_open(name):
    robot = robots.load(name)
    modes = working_modes(robot, robot.reference.x)
    q = modes.modes[0].q
    assert modes.status == "proved"
    for leg in legs(robot):
        if len(leg.needed):
            continue
        own, given = posed(robot, leg)
        near = np.array([difference(robot, q, mode.q)[own] for mode in modes.modes]) / robot.column_scale[own]
        near = near[distinct_rows(near)]
        assert are_leg_solutions_complete(robot, own, given, q, near, robot.reference.x)
        for k in range(len(near)):
            rest = np.delete(near, k, axis=0)
            assert not are_leg_solutions_complete(robot, own, given, q, rest, robot.reference.x)


def test_a_row_repeats_only_those_that_stay():
    steps = 0.6 * DISTINCT_SOLUTIONS * np.arange(5.0)
    assert distinct_rows(steps[:, None]) == [0, 2, 4]
    assert distinct_rows(np.array([[0.0, 1.0], [2 * np.pi, 1.0], [0.0, 1.1]])) == [0, 2]
