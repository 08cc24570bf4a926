"""What is drawn as the locus is singular, by each mechanism's own geometry."""

from types import SimpleNamespace

import numpy as np
import pytest

import robots
from framework import assemble, locate_singularities
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.linearised_loops import passive_matrix
from framework.planning.scenes import scene_path
from framework.singularity import drawn_locus, locus_on_map
from framework.singularity.drawn_locus import LocusCurves, locus_curves, locus_patch

MOTORS, LINK = np.array([[-0.2, 0.0], [0.2, 0.0]]), 0.25  # the 5R of the paper


def elbows(point):
    """The 5R's elbows, both outward, with C at a point: two circles about each motor and C."""
    found = []
    for motor, side in zip(MOTORS, (1.0, -1.0), strict=True):
        reach = point - motor
        half = np.linalg.norm(reach) / 2
        angle = np.arctan2(reach[1], reach[0]) + side * np.arccos(half / LINK)
        found.append(motor + LINK * np.array([np.cos(angle), np.sin(angle)]))
    return found


def test_on_the_curves_of_the_5r_its_rods_lie_in_line():
    robot = robots.load("five_bar")
    start = assemble(robot)
    drawn = locus_curves(robot, start.q, start.x)
    assert drawn.axes == (0, 1)
    points = np.concatenate(drawn.curves)
    assert len(points) > 40
    for point in points:
        left, right = ((elbow - point) / LINK for elbow in elbows(point))
        assert abs(left[0] * right[1] - left[1] * right[0]) < 1e-9
    # the paper's path crosses it at (0, sqrt(0.06)): some piece of the drawing passes by, a grid step at most
    assert np.linalg.norm(points - [0.0, np.sqrt(0.06)], axis=1).min() < 0.03


def test_the_biglide_is_singular_half_way_between_its_rails():
    robot = robots.load("biglide")
    start = assemble(robot)
    points = np.concatenate(locus_curves(robot, start.q, start.x).curves)
    np.testing.assert_allclose(points[:, 0], 0.0, atol=1e-12)
    assert np.ptp(points[:, 1]) > 1.0


@pytest.mark.parametrize(("name", "scene"), [("delta", "cross"), ("gough_stewart", "turn")])
def test_the_patch_is_singular_and_passes_the_crossing(name, scene):
    robot = robots.load(name)
    found = locate_singularities(robot, scene_path(robot.description.scenes[scene]))[0]
    patch = locus_patch(robot, found.q, found.platform)
    middle = len(patch) // 2
    np.testing.assert_allclose(patch[middle, middle], found.platform[:3], atol=1e-9)
    targets = np.repeat(found.platform[None], patch[..., 0].size, axis=0)
    targets[:, :3] = patch.reshape(-1, 3)
    linearised = close_loops(robot, targets, np.repeat(found.q[None], len(targets), axis=0))
    smallest = np.linalg.svd(passive_matrix(robot, linearised), compute_uv=False)[:, -1]
    aside = np.linalg.svd(passive_matrix(robot, linearised), compute_uv=False)[:, 0].max()
    assert smallest.max() < 1e-6 * aside


@pytest.mark.parametrize("slope", [0.0, 0.15, -0.15, 0.3])
def test_a_patch_that_is_high_anywhere_is_not_drawn(monkeypatch, slope):
    """Of a locus that rises along x from the platform: a fifth of the robot's length is too high."""
    robot = robots.load("delta")
    start, length, up = assemble(robot), robot.length, np.array([0.0, 0.0, 1.0])
    shifts = length * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])

    def closed(robot, targets, guess, farthest):
        return SimpleNamespace(closed=np.ones(len(targets), dtype=bool), linearised=targets - start.x)

    def measured(robot, moved):
        return moved[:, 2] - slope * moved[:, 0], np.tile(up, (len(moved), 1))

    monkeypatch.setattr(drawn_locus, "close_each", closed)
    monkeypatch.setattr(drawn_locus, "_measure_in_space", measured)
    patch = drawn_locus._move_onto_locus(robot, start.q, start.x, shifts, up)
    if abs(slope) < 0.2:
        np.testing.assert_allclose(patch, shifts + slope * shifts[:, :1] * up, atol=1e-12)
    else:
        assert patch is None


def test_nothing_is_drawn_where_nothing_can_be():
    robot = robots.load("two_arms")  # every joint has a motor
    start = assemble(robot)
    assert locus_curves(robot, start.q, start.x) is None
    assert locus_patch(robot, start.q, start.x) is None


def test_signs_that_change_are_those_between_all_neighbours():
    """Of a measure with poses that are not reached; and the minima are less than all of their neighbours."""
    rng = np.random.default_rng(0)
    g = rng.standard_normal((7, 9))
    g[2, 3] = g[6, 8] = np.nan
    changes = {tuple(map(tuple, pair.reshape(2, 2).tolist())) for pair in locus_on_map._sign_changes(g)}
    pairs = [((i, j), (i + 1, j)) for i in range(6) for j in range(9)]
    pairs += [((i, j), (i, j + 1)) for i in range(7) for j in range(8)]
    assert changes == {(one, two) for one, two in pairs if g[one] * g[two] < 0}
    poses = SimpleNamespace(lower=np.array([1.0, 2.0]), cell=np.array([0.1, 0.2]))
    np.testing.assert_allclose(locus_on_map._midpoints(poses, np.array([[3, 4, 3, 5]])), [[1.3, 2.9]])
    minima = {tuple(pair) for pair in locus_on_map._find_minima(g, max_minima=99).tolist()}
    beside = [(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if (a, b) != (0, 0)]
    padded = np.pad(np.nan_to_num(np.abs(g), nan=np.inf), 1, constant_values=np.inf)
    least = {
        (i, j)
        for i, j in np.ndindex(g.shape)
        if all(padded[i + 1, j + 1] < padded[i + 1 + a, j + 1 + b] for a, b in beside)
    }
    assert minima == least
    size = np.abs(g[tuple(np.array(sorted(minima)).T)])
    (best,) = locus_on_map._find_minima(g, max_minima=1).tolist()
    assert abs(g[tuple(best)]) == size.min()


def test_neighbours_are_the_nine_poses_about_a_point_of_the_map():
    i, j = np.indices((4, 5))
    x = np.stack([0.1 * i, 0.2 * j], axis=2)
    reached = np.ones((4, 5), dtype=bool)
    reached[1, 2] = False
    poses = SimpleNamespace(
        lower=np.zeros(2), cell=np.array([0.1, 0.2]), g=np.zeros((4, 5)), x=x, q=x, reached=reached
    )
    for point in ([0.31, 0.79], [0.0, 0.0], [0.11, 0.41]):
        middle = np.round(np.divide(point, poses.cell)) * poses.cell
        about, _, is_reached = locus_on_map._neighbouring_poses(poses, np.array([point]))
        near = [
            tuple(x[index])
            for index in np.ndindex(4, 5)
            if reached[index] and (np.abs(x[index] - middle) < 1.1 * poses.cell).all()
        ]
        assert sorted(map(tuple, about[0, is_reached[0]])) == sorted(near)


def test_a_curve_is_cut_where_it_leaves_the_branch_and_where_an_angle_jumps(monkeypatch):
    """Points 0..4 on the branch, 5..7 off it, 8..12 on it again, with a turn between 9 and 10."""
    turns = np.append(np.linspace(2.0, 3.1, 10), np.linspace(-3.1, -3.0, 3))
    x = np.column_stack([turns, np.arange(13.0)])
    off = np.isin(np.arange(13), (5, 6, 7))
    monkeypatch.setattr(locus_on_map, "_compare_branches", lambda *given: (~off, off))
    structure = SimpleNamespace(varies=False)
    robot = SimpleNamespace(translations=np.array([False, True]), structure=structure)
    equations = SimpleNamespace(robot=robot)
    poses, curve = SimpleNamespace(axes=(0, 1)), SimpleNamespace(x=x, q=x, kind="type_2")
    parts = [part.x[:, 1].tolist() for part in locus_on_map._parts_on_branch(equations, poses, curve)]
    assert parts == [[0, 1, 2, 3, 4], [8, 9], [10, 11, 12]]


def test_curves_cover_poses_well_inside_their_square_in_their_slice():
    curves = LocusCurves([], (0, 2), np.array([1.0, 5.0, -1.0]), reach=0.4)
    inside = np.array([[1.19, 5.0, -1.19], [0.81, 5.0, -0.81]])
    assert curves.covers(inside)
    for column, step in ((0, 0.02), (2, -0.02), (1, 1e-3)):
        beside = inside.copy()
        beside[0, column] += step
        assert not curves.covers(beside)
