"""The nearest singular pose: for the 5R the nearest point of the curve on which its rods are in line."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq

import robots
from framework import InvalidInput, assemble
from framework.atlas import nearest
from framework.atlas.nearest import nearest_singular_pose
from framework.atlas.sweep import PoseReason
from framework.kinematics.linearised_loops import assembled_at
from framework.singularity.distances import Distances
from tests.oracles import five_bar_pose

ROBOT = "five_bar"
AROUND = 360
FEW = 100  # cells of the proof, where it is not what is tested


def sine(x):
    return float(five_bar_pose.pose(np.array([x])).sine[0])


def least_distance(x):
    """The least over 360 rays of where the rods come in line, first in steps, then by bracketing."""
    best = np.inf
    for angle in np.linspace(0.0, 2 * np.pi, AROUND, endpoint=False):
        way = np.array([np.cos(angle), np.sin(angle)])
        far = np.arange(0.0, min(best, 0.3) + 0.004, 0.004)
        points = x + far[:, None] * way
        inside = np.logical_and.accumulate(five_bar_pose.reachable(points) > 0)
        signs = np.sign(five_bar_pose.pose(points[inside]).sine)
        flips = np.flatnonzero(np.diff(signs))
        if len(flips):
            k = int(flips[0])
            best = min(best, brentq(lambda r, way=way: sine(x + r * way), far[k], far[k + 1]))
    return best


@pytest.mark.parametrize("x", [(0.1, 0.345), pytest.param((0.02, 0.15), marks=pytest.mark.slow)])
def test_the_nearest_singular_pose_of_the_5r_is_that_of_its_curve(robot, x):
    found = nearest_singular_pose(robot, assemble(robot, x), max_cells=FEW)
    expected = least_distance(np.array(x))
    # the curve turns from the circle about x by the square of what a ray misses: half a ray's angle at most
    assert found.distance <= expected
    assert found.distance == pytest.approx(expected, abs=0.3 * (np.pi / AROUND) ** 2 * 10)
    assert np.linalg.norm(found.x - x) == pytest.approx(found.distance, rel=1e-12)
    assert abs(sine(found.x)) < 1e-7
    assert found.at_least <= found.distance
    assert found.status.startswith("at least")
    assert "at most" in found.status
    # the rods are in line along t_s turned by a right angle
    rod = five_bar_pose.pose(found.x[None]).along[0, 0]
    assert abs(found.twist @ rod) < 1e-6


@pytest.mark.parametrize("x", [(-0.25, 0.2), pytest.param((0.0, 0.42), marks=pytest.mark.slow)])
def test_a_leg_ends_where_it_is_stretched(robot, x):
    found = nearest_singular_pose(robot, assemble(robot, x), max_cells=FEW)
    edge = five_bar_pose.reachable(np.array([x]))[0]  # of the annulus about the far base, by one circle
    assert found.leg_end == pytest.approx(edge, rel=2e-3)
    assert found.at_least <= found.leg_end < found.distance
    assert "a leg ends (Type 1)" in found.status


@pytest.mark.slow
def test_all_rays_that_meet_the_locus_count():
    robot = robots.load("par4")  # eight of 600 rays do, and Newton's method leaves it from some
    found = nearest_singular_pose(robot, assemble(robot, (-0.05, 0.05, -0.85, 1.0)), max_cells=FEW)
    assert found.distance < 0.39977
    assert Distances(robot, assembled_at(robot, found.q)).sigma_A[0] < 1e-7


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("delta", "orthoglide", "gough_stewart")]


@pytest.mark.parametrize("name", ["three_rpr", *SLOW])
def test_what_is_found_is_singular_and_lies_across_the_locus(name):
    robot = robots.load(name)
    found = nearest_singular_pose(robot, robot.reference, max_cells=FEW)
    assert 0 < found.at_least <= found.distance
    assert Distances(robot, assembled_at(robot, found.q)).sigma_A[0] < 1e-7
    scale = np.where(robot.translations, 1.0 if robot.translations.all() else robot.length, 1.0)
    assert np.linalg.norm((found.x - robot.reference.x) / scale) == pytest.approx(found.distance, rel=1e-12)


def test_nothing_found_is_told_apart_from_nothing_there(robot):
    at = assemble(robot, [0.1, 0.345])
    far = nearest_singular_pose(robot, at, within=0.05, max_cells=FEW)
    assert (far.x, far.distance) == (None, np.inf)
    assert "no Type 2 pose found within 0.05 m" in far.status
    near = nearest_singular_pose(robot, at, within=0.04)
    assert near.at_least == pytest.approx(0.04)
    assert "no singular pose in the ball searched" in near.status


@pytest.mark.parametrize(
    ("name", "within", "told"), [("two_arms", None, "sign"), ("five_bar", -1.0, "within")]
)
def test_what_has_no_margin_is_told_so(name, within, told):
    robot = robots.load(name)
    with pytest.raises(InvalidInput, match=told):
        nearest_singular_pose(robot, robot.reference, within=within)


def test_bisection_comes_as_near_to_a_change_of_sign_as_its_last_step():
    """g changes its sign at places x of rays from 0 to 1, and each step along them arrives."""
    places = np.random.default_rng(0).uniform(0.0, 1.0, 60)
    rays = np.arange(60.0)  # q is the ray's number and the place on it
    centre = SimpleNamespace(
        signs_of_g=lambda q: np.sign(places[q[:, 0].astype(int)] - q[:, 1]),
        step=lambda q, start, end: SimpleNamespace(
            reason=np.full(len(q), PoseReason.REACHED), q=np.column_stack([q[:, 0], end])
        ),
    )
    segments = nearest._RaySegments(np.column_stack([rays, 0 * rays]), np.zeros((60, 1)), np.ones((60, 1)))
    for halvings in (3, 12):
        reached = nearest._bisect_segments(centre, segments, halvings).start[:, 0]
        assert (reached < places).all()
        assert (places - reached < 0.5**halvings).all()


def test_bisection_ends_on_a_branch_on_which_no_step_is_long():
    """Steps of more than 1e-9 are refused and shorter ones arrive: 1e9 of them would lead to the end."""
    steps = []

    def step(q, start, end):
        steps.append(float(end[0, 0] - start[0, 0]))
        is_short = steps[-1] < 1e-9
        reason = PoseReason.REACHED if is_short else PoseReason.OTHER_MODE
        return SimpleNamespace(reason=np.array([reason]), q=end if is_short else q)

    centre = SimpleNamespace(signs_of_g=lambda q: np.ones(len(q)), step=step)
    segments = nearest._RaySegments(np.zeros((1, 1)), np.zeros((1, 1)), np.ones((1, 1)))
    reached = nearest._bisect_segments(centre, segments, 40).start[0, 0]
    assert len(steps) <= 8 * 40
    assert 0.0 < reached == pytest.approx(sum(length for length in steps if length < 1e-9))


def test_a_search_ends_after_so_many_steps_and_says_how_far_they_lead(robot, monkeypatch):
    """What is found within the shortened distance is what a search of that distance finds."""
    monkeypatch.setattr(nearest, "MAX_RAY_STEPS", 96 * 3)
    counted = []
    pose = assemble(robot, (0.1, 0.345))
    found = nearest_singular_pose(robot, pose, within=1e30, max_cells=1, progress=counted.append)
    assert counted[-1] <= 96 * 3
    assert found.within < found.asked == 1e30
    assert "asked for, 288 steps lead no farther" in found.status
    alone = nearest_singular_pose(robot, pose, within=found.within, max_cells=1)
    assert alone.within == alone.asked == found.within
    assert found.distance == pytest.approx(alone.distance, rel=1e-9)
    assert found.leg_end == pytest.approx(alone.leg_end, rel=1e-9)
    monkeypatch.setattr(nearest, "MAX_RAY_STEPS", 96)
    assert nearest_singular_pose(robot, pose, max_cells=1).asked == 0.5 * robot.length
