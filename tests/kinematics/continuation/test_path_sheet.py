"""A panel of a path whose poses jump to another working mode does not count, however near the modes are.

The 5R has cranks and rods of one length. A leg whose elbow turns from psi to -psi, and its crank by psi,
keeps the platform where it is: the other mode of this leg. Both modes meet where the leg is stretched.
"""

from functools import lru_cache

import numpy as np
import pytest

import robots
from framework import Line, assemble
from framework.kinematics.continuation import path_sheet
from framework.kinematics.continuation.path_sheet import BranchPoses, follow_panels, with_tangents
from framework.kinematics.continuation.tracking import track_path
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.linearised_loops import linearised_at

ROBOT = robots.load("five_bar")
STRETCHED = np.array([0.0, np.sqrt(0.5**2 - 0.2**2)])  # [m] both legs, of 0.5 m, from motors 0.4 m apart
DISTANCES = [1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12]  # [m]


def other_mode(q, sides):
    """The poses q (T, nq) with the legs of these sides in their other mode."""
    q, columns = q.copy(), {ROBOT.coordinates.name_of(k): k for k in range(ROBOT.nv)}
    positions = ROBOT.coordinates.positions(q)
    for side in sides:
        elbow = np.remainder(positions[:, columns[f"{side}_elbow"]] + np.pi, 2 * np.pi) - np.pi
        q[:, columns[f"{side}_elbow"]] -= 2 * elbow
        q[:, columns[f"{side}_motor"]] += elbow
    return q


@lru_cache
def panel_beside(distance):
    """A line below the point where both legs are stretched, its first pose, and its panel."""
    half = np.array([distance, 0.0])  # both legs keep about half of the room that they have in the middle
    middle = STRETCHED - [0.0, distance]
    path = Line(middle - half, middle + half)
    pose = linearised_at(ROBOT, assemble(ROBOT, path(0.0)).q[None], path(0.0)[None])
    closed = path_sheet._close_panel(ROBOT, path, pose, 0.0, 1.0)
    assert closed is not None
    return path, pose, *closed


@pytest.mark.parametrize("node", [1, 16, 30])
@pytest.mark.parametrize("sides", [("left",), ("right",), ("left", "right")])
@pytest.mark.parametrize("distance", DISTANCES)
def test_a_panel_that_jumps_to_another_mode_does_not_count(distance, sides, node):
    path, pose, panel, first_step = panel_beside(distance)
    q = np.concatenate([panel.q[:node], other_mode(panel.q[node:], sides)])
    jumped = close_loops(ROBOT, path(panel.s), q)
    apart = np.abs(jumped.frames.q[node:] - panel.q[node:]).max()
    assert apart > 0.1 * np.sqrt(distance)  # it is the other mode
    poses = with_tangents(ROBOT, path, panel.s, jumped)
    assert not path_sheet._is_one_branch(ROBOT, pose, poses, first_step)


@pytest.mark.parametrize("distance", DISTANCES)
def test_the_panel_of_one_mode_counts(distance):
    path, pose, panel, _ = panel_beside(distance)
    assert isinstance(panel, BranchPoses)
    (only,) = follow_panels(ROBOT, path, pose)
    np.testing.assert_allclose(only.q, panel.q, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["five_bar", "delta", "gough_stewart"])
@pytest.mark.parametrize("distance", [0.0, 4e-7])  # within what is rounding of a file
def test_a_path_that_starts_beside_the_reference_starts_at_its_own_pose(name, distance):
    robot = robots.load(name)
    start = robot.reference.x + distance
    path = Line(start, start + 0.02)
    branch = track_path(robot, path)
    (panel,) = branch.panels
    pose = close_loops(robot, path(np.zeros(1)), robot.reference.q[None])
    np.testing.assert_allclose(branch.origin, pose.q[0], rtol=0, atol=1e-13)
    assert np.abs(panel.linearised.residual).max() < 1e-13 * max(robot.length, 1.0)
    np.testing.assert_array_equal(panel.s[[0, -1]], [0.0, 1.0])
