"""The derivatives of the equations along the joints, and bounds on how they change over boxes."""

import numpy as np
import pytest

import robots
from framework.kinematics.linearised_loops import linearised_at_reference
from framework.kinematics.loop_matrices import type1_matrix
from framework.proofs.derivative_bounds import DerivativeBounds

# point rows on base axes and on a frame's, slides, directions, distances, turns and joints as platform
ROBOTS = ("biglide", "three_rpr", "agile_eye", "delta", "par4", "orthoglide", "humanoid_ankle", "bricard")
STEP = 1e-6


def setup(name, boxes=6):
    bounds = DerivativeBounds.of(robots.load(name))
    rng = np.random.default_rng(1)
    return bounds, rng, rng.uniform(-1, 1, (boxes, len(bounds.column_scale)))


def turn_from(middle, there, axes):
    """What of the turn R R_m' between frames is not symmetric, (S, turns)."""
    turned = there.frames.rotation[:, 0] @ middle.frames.rotation[:, 0].swapaxes(1, 2)
    return 0.5 * (turned - turned.swapaxes(1, 2))[:, [2, 0, 1], [1, 2, 0]][:, axes - 3]


def values(bounds, middle, there):
    """Values of all rows (S, R); those of the platform off the middle."""
    robot, found = bounds.robot, there.values - middle.values
    scale = robot.platform_scale
    coordinates = [robot.platform.coordinates(one.frames) for one in (there, middle)]
    found[:, : robot.n] = (coordinates[0] - coordinates[1]) / scale
    if not robot.translations.all() and hasattr(robot.platform, "turning"):
        turning = robot.platform.turning
        found[:, turning] = turn_from(middle, there, robot.platform.axes[turning])
    return found


@pytest.mark.parametrize("name", ROBOTS)
def test_slopes_and_second_slopes_are_derivatives(name):
    bounds, _, u = setup(name)
    n, at = bounds.robot.n, bounds.evaluate(bounds.configurations(u))
    for joint, step in enumerate(STEP * np.eye(u.shape[1])):
        ahead, behind = (bounds.evaluate(bounds.configurations(u + side * step)) for side in (1, -1))
        rates = (values(bounds, at, ahead) - values(bounds, at, behind)) / (2 * STEP)
        np.testing.assert_allclose(at.slopes[:, :, joint], rates, atol=1e-8)
        slope_rates = (ahead.slopes - behind.slopes)[:, n:] / (2 * STEP)
        np.testing.assert_allclose(at.hessians[:, n:, :, joint], slope_rates, atol=1e-8)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("size", [0.5, 0.02])
def test_nothing_in_a_box_is_beyond_the_bounds(name, size):
    bounds, rng, u = setup(name)
    n, at = bounds.robot.n, bounds.evaluate(bounds.configurations(u))
    radii = size * rng.uniform(0.1, 1.0, u.shape)
    remainders, rounding = at.remainders(radii), 4 * bounds.rounding
    for _ in range(12):
        d = radii * rng.choice([-1.0, 1.0, 0.5], radii.shape)
        there = bounds.evaluate(bounds.configurations(u + d))
        off = values(bounds, at, there) - np.einsum("sri,si->sr", at.slopes, d)
        assert (np.abs(off) <= remainders.values + rounding).all()
        assert (np.abs(there.slopes - at.slopes) <= remainders.slopes + rounding)[:, n:].all()
        assert (np.abs(there.hessians - at.hessians) <= remainders.hessians + rounding)[:, n:].all()


@pytest.mark.parametrize("name", ROBOTS)
def test_at_closed_loops_they_are_the_equations_of_the_robot(name):
    bounds = DerivativeBounds.of(robots.load(name))
    robot = bounds.robot
    at = bounds.evaluate(robot.reference.q[None])
    assert np.abs(at.values[:, robot.n :]).max() < 1e-9
    np.testing.assert_allclose(
        np.linalg.svd(at.slopes, compute_uv=False),
        np.linalg.svd(type1_matrix(robot, linearised_at_reference(robot)), compute_uv=False),
        rtol=1e-9,
    )
