"""Balls that are proved regular: as large as closed forms allow, and nothing singular in any."""

import numpy as np
import pytest

import robots
from framework import assemble
from framework.atlas.nearest import nearest_singular_pose
from framework.atlas.sweep import STEP_PARTS, PoseReason, step_poses
from framework.kinematics.linearised_loops import linearised_at
from framework.proofs.regular_ball import prove_regular_ball
from framework.singularity.distances import Distances
from framework.singularity.type2 import signed_measure
from tests.oracles import five_bar_pose

LENGTH, MOTORS = five_bar_pose.LENGTH, five_bar_pose.BASES


def ball(name, x=None, within=0.5, max_cells=2000):
    robot = robots.load(name)
    here = robot.reference if x is None else assemble(robot, x)
    return robot, here, prove_regular_ball(robot, here.q, here.x, within, max_cells=max_cells)


def sine(x):
    """Of the angle between the rods of the 5R."""
    return float(five_bar_pose.pose(np.atleast_2d(x)).sine[0])


@pytest.mark.slow
@pytest.mark.parametrize("x", [(0.1, 0.345), (0.0, 0.4)])
def test_the_ball_of_the_5r_reaches_to_where_a_leg_is_stretched(x):
    """The nearest singularity, closer than any of Type 2: a leg of two links in line."""
    robot, _, radius = ball("five_bar", x, within=0.2, max_cells=20000)
    edge = 2 * LENGTH - np.linalg.norm(np.array(x) - MOTORS, axis=1).max()
    assert 0.98 * edge < radius * robot.length <= edge


def test_the_margin_of_the_5r_is_known_to_a_thousandth():
    """Both bounds, one by a proof and one by a pose that is singular."""
    robot = robots.load("five_bar")
    found = nearest_singular_pose(robot, assemble(robot, (0.02, 0.15)))
    assert found.at_least <= found.distance < 1.001 * found.at_least
    assert abs(sine(found.x)) < 1e-7


def test_a_near_miss_is_proved_regular_and_a_singular_pose_is_not():
    """Four micrometres from the locus, sigma_min below 4e-5: a tolerance would call it singular."""
    robot = robots.load("five_bar")
    on_locus = nearest_singular_pose(robot, assemble(robot, (0.02, 0.15)), max_cells=1)
    away = np.array([0.02, 0.15]) - on_locus.x
    x = on_locus.x + 4e-6 * away / np.linalg.norm(away)
    here = assemble(robot, x)
    assert Distances(robot, linearised_at(robot, here.q[None], here.x[None])).sigma_A[0] < 4e-5
    near = nearest_singular_pose(robot, here, within=1e-3)
    assert near.distance == pytest.approx(4e-6, rel=1e-3)
    assert 0.9 * near.distance < near.at_least <= near.distance
    assert prove_regular_ball(robot, on_locus.q, on_locus.x, 0.01, max_cells=500) < 1e-6


def test_the_ball_of_the_biglide_reaches_to_the_edge_of_its_workspace():
    """A rod square to its rail: the edge is a straight line."""
    robot, here, radius = ball("biglide", within=0.05, max_cells=20000)
    edge = abs((0.2 - 0.2 * np.sqrt(2)) - here.x[0])
    assert 0.99 * edge < radius * robot.length <= edge


# translations; with an angle; rotation vectors; joints as platform; one coordinate; no chart that is known
LEAST = {
    "three_rpr": 0.01,
    "spherical_rrr": 0.01,
    "gough_stewart": 0.01,
    "humanoid_ankle": 0.01,
    "four_bar": 0.4,
    "orthoglide": 0.01,
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name == "orthoglide")) for name in LEAST]
)
def test_no_way_out_of_the_pose_meets_a_singularity_in_the_ball(name):
    robot, here, radius = ball(name, max_cells=150)
    assert radius > LEAST[name]
    ways = np.random.default_rng(3).standard_normal((12, robot.n))
    ways *= 0.999 * radius / np.linalg.norm(ways, axis=1, keepdims=True)
    start, q = np.repeat(here.x[None], len(ways), axis=0), np.repeat(here.q[None], len(ways), axis=0)
    ends = start + ways * robot.platform_scale
    first = signed_measure(robot, linearised_at(robot, q[:1], start[:1]))[0]
    for part in range(4):
        one, two = (start + (ends - start) * (part + more) / 4 for more in (0, 1))
        step = step_poses(robot, q, one, two, STEP_PARTS)
        assert (step.reason == PoseReason.REACHED).all()
        q = step.q
        at = signed_measure(robot, linearised_at(robot, q, two))
        assert (np.sign(at) == np.sign(first)).all()


def test_turns_that_no_bound_is_known_for_are_not_called_regular():
    assert ball("par4")[2] == 0.0
