"""Following a path: the branch of a closed form, whichever way and in whatever steps it is followed."""

import numpy as np
import pytest

import robots
from framework import Arc, InvalidInput, Line, NoAnswer, assemble, track_path
from framework.identification.base_parameters import random_poses
from framework.kinematics.continuation.tracking import follow_path, reach_of_links
from framework.kinematics.frames import frames_at
from framework.kinematics.linearised_loops import count_lost_ranks, linearised_at
from tests.dynamics import random_five_bars
from tests.kinematics.continuation.small_steps import PLACES, draw_path, ends_at_singularity, is_followed
from tests.oracles.closure_rows import closure_errors
from tests.oracles.forward_simulation import kinematics
from tests.robots.every_robot import RIGID, first_path

MOTORS, LINK = np.array([[-0.2, 0.0], [0.2, 0.0]]), 0.25  # the 5R of the paper
LINE = Line([0.1, 0.345], [-0.05, 0.195])
SEVERAL = [
    pytest.param(name, marks=() if name in ("five_bar", "delta", "three_rpr") else pytest.mark.slow)
    for name in robots.CATALOGUE
]


def cranks(points):
    """Crank angles (T, 2) of the 5R with both elbows outward, by the law of cosines."""
    found = []
    for motor, side in zip(MOTORS, (1.0, -1.0), strict=True):
        reach = points - motor
        half = np.linalg.norm(reach, axis=1) / 2
        found.append(np.arctan2(reach[:, 1], reach[:, 0]) + side * np.arccos(half / LINK))
    return np.stack(found, axis=1)


@pytest.mark.parametrize(
    "path",
    [
        LINE,
        Line([0.1, 0.345], [0.0, 0.02]),
        Arc([0.1, 0.3], [-0.1, 0.33], [-0.15, 0.2]),
        Line([0.1, 0.3], [-0.05, 0.42]),  # close to where the right leg is stretched
    ],
)
def test_the_5r_keeps_the_elbows_of_its_reference(path):
    robot = robots.load("five_bar")
    branch = track_path(robot, path)
    s = np.linspace(0.0, 1.0, 301)
    np.testing.assert_allclose(branch.close(s).q[:, robot.actuated], cranks(path(s)), atol=1e-12)


@pytest.mark.parametrize("name", SEVERAL)
def test_knots_are_closed_tangents_are_tangents_and_guesses_lie_between(name):
    robot = RIGID[name]
    branch = track_path(robot, first_path(robot))
    model, data = robot.model, robot.model.createData()
    for q in branch.guess(branch.s):
        kinematics(model, data, q, np.zeros(model.nv))
        assert np.abs(closure_errors(model, data, robot.description.closures)).max() < 1e-11 * max(
            robot.length, 1.0
        )
    assert branch.s[0] == 0.0
    assert branch.s[-1] == 1.0
    s, h = np.linspace(0.07, 0.93, 9), 1e-5
    slope = (branch.close(s + h).q - branch.close(s - h).q) / (2 * h)
    cubic = (branch.guess(s + h) - branch.guess(s - h)) / (2 * h)
    largest = np.abs(slope).max()
    np.testing.assert_allclose(cubic, slope, rtol=0, atol=0.2 * largest)
    off = np.abs(branch.guess(s) - branch.close(s).q) / robot.column_scale
    assert off.max() < 0.03


def test_guesses_go_on_beyond_both_ends_of_the_path():
    robot, s = robots.load("five_bar"), np.array([-0.01, -1e-4, 0.5, 1.0 + 1e-4, 1.01])
    guess = track_path(robot, LINE).guess(s)
    np.testing.assert_allclose(guess[:, robot.actuated], cranks(LINE(s)), atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["five_bar", "biglide", "orthoglide", "par4", "three_rpr"])
def test_random_motions_stay_on_their_branch_or_are_refused_at_a_singularity(name):
    robot, rng = RIGID[name], np.random.default_rng(0)
    refusals, followed = [], 0
    for k in range(24):
        path = draw_path(robot, k, rng)
        try:
            q = track_path(robot, path).close(PLACES).q
        except NoAnswer as refusal:
            refusals.append((path, refusal))
        else:
            followed += 1
            assert is_followed(robot, path, q), k
    assert followed >= 6
    assert all(ends_at_singularity(robot, path, refusal) for path, refusal in refusals)


def test_springs_keep_their_deflections_along_a_path():
    robot = robots.load("five_bar", flexibility="flexible_links")
    q = assemble(robot).q
    way = follow_path(robot, Line(assemble(robot).x, [0.05, 0.3]), linearised_at(robot, q[None]))
    for poses in (*way.panels, *way.steps):
        deflections = poses.q[:, robot.elastic]
        np.testing.assert_array_equal(deflections, np.broadcast_to(q[robot.elastic], deflections.shape))


def test_a_path_of_other_coordinates_is_refused():
    with pytest.raises(InvalidInput, match=r"3 coordinates, the platform of five_bar has 2 \(x, y\)"):
        track_path(robots.load("five_bar"), Line([0, 0, 0], [1, 1, 1]))
    with pytest.raises(InvalidInput, match="must be 2 finite numbers"):
        assemble(robots.load("five_bar"), [0.0, np.inf])


def test_turns_in_degrees_are_told_at_once():
    with pytest.raises(InvalidInput, match=r"turns rz by 260 rad, 41\.4 turns; .* points are in rad"):
        track_path(robots.load("four_bar"), Line([80.0], [-180.0]))
    with pytest.raises(InvalidInput, match="the way from the reference to the point turns rz by"):
        assemble(robots.load("four_bar"), [400.0])


def test_a_rank_is_lost_by_the_share_of_the_largest_singular_value():
    """By numpy's values of J in radians and robot lengths, counted on either side of the least one."""
    robot = robots.load("delta")
    at = linearised_at(robot, robot.reference.q[None])
    scaled = at.closures[0] / robot.loop_lengths[:, None] * robot.column_scale
    values = np.linalg.svd(scaled[:, np.sort(robot.moving)], compute_uv=False)
    assert values[0] > 1.1
    for level, count in ((0.999 * values[-1] / values[0], 0), (1.001 * values[-1] / values[0], 1)):
        assert count_lost_ranks(robot, at, level)[0] == count


@pytest.mark.parametrize("seed", range(4))
def test_the_links_of_the_shorter_leg_bound_the_reach(tmp_path, seed):
    drawn = random_five_bars._drawn(np.random.default_rng(seed), inertia=False)
    robot = drawn.robot(tmp_path)
    assert reach_of_links(robot, np.zeros(robot.nv)) == pytest.approx(
        drawn.base + (drawn.cranks + drawn.rods).min()
    )


@pytest.mark.parametrize("name", ["five_bar", "slider_crank", "delta", "orthoglide", "gough_stewart"])
def test_no_closed_pose_lies_beyond_the_links_and_the_travel_of_slides(name):
    robot = robots.load(name)
    q, _ = random_poses(robot, 40, np.random.default_rng(4))
    travel = np.abs(robot.coordinates.positions(q)).max(axis=0)  # (nv,) [m] of slides
    distance = np.linalg.norm(frames_at(robot, q).platform_origin, axis=1)
    assert distance.max() <= reach_of_links(robot, travel) < 20.0 * robot.length
