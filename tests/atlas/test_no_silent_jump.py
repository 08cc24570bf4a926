"""Poses that are neighbours on a map are neighbours of one branch, whichever way each was reached."""

import numpy as np
import pytest

import robots
from framework.atlas.survey import survey_window
from framework.atlas.sweep import STEP_PARTS, PoseReason, step_poses
from framework.atlas.workspace_map import workspace_map

CATALOGUE = (
    *("delta", "gough_stewart", "three_rrr", "three_rpr", "agile_eye", "par4", "orthoglide", "three_upu"),
    *("biglide", "spherical_rrr", "five_bar_heavy", "two_arms", "standing_quadruped"),
)


def pairs(found):
    """Steps between all neighbours that are both reached: where they should lead, and where they do."""
    robot, x, q, reached = found.robot, found.window.points(), found.q, found.reached
    for one, other in ((np.s_[:-1, :], np.s_[1:, :]), (np.s_[:, :-1], np.s_[:, 1:])):
        both = reached[one] & reached[other]
        yield q[other][both], step_poses(robot, q[one][both], x[one][both], x[other][both], STEP_PARTS)


def turns_apart(robot, one, two):
    """Largest difference (T,) of joints, whole turns of hinges left out."""
    apart = one - two
    apart = np.where(robot.sliding, apart / robot.length, np.mod(apart + np.pi, 2 * np.pi) - np.pi)
    return np.abs(apart).max(axis=1)


@pytest.mark.parametrize(
    ("name", "size"),
    [("five_bar", 21), *(pytest.param(name, 32, marks=pytest.mark.slow) for name in CATALOGUE)],
)
def test_a_step_between_neighbours_leads_from_the_one_to_the_other(name, size):
    robot = robots.load(name)
    window = survey_window(robot, size=size)
    found = workspace_map(robot, window, ["g"])
    asked = refused = 0
    for expected, step in pairs(found):
        told = step.reason == PoseReason.REACHED
        asked, refused = asked + len(told), refused + int(np.sum(~told))
        assert turns_apart(robot, expected[told], step.q[told]).max() < 1e-5
    assert asked > size**2 / 2
    assert refused < 1.5 * size  # beside a stretched leg, on the rim, no single step is trusted
