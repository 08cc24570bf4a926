"""The derivatives of the equations along the joints, and bounds on how they change over boxes."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import ParallelRobot
from framework.kinematics.frames import difference
from framework.kinematics.linearised_loops import linearised_at_reference, type1_matrix
from framework.kinematics.modes import legs
from framework.model.description import Actuator, Closure, Platform
from framework.proofs import derivative_bounds
from framework.proofs.derivative_bounds import DerivativeBounds
from framework.proofs.leg_paving import are_leg_solutions_complete, collect_leg_equations
from framework.proofs.passive_joints import distinct_rows
from framework.proofs.working_modes import working_modes
from framework.tolerances import DISTINCT_SOLUTIONS
from tests.mutated_code import mutated_code

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


# the bounds that a paving of joints rests on, and that it misses nothing


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
        equations = collect_leg_equations(robot, own, given, robot.reference.q, robot.reference.x, 2.0)
        r = 10.0 ** rng.uniform(-3, 0.5, (200, len(own)))
        c, xi = rng.uniform(-2, 2, r.shape), np.clip(rng.uniform(-1.5, 1.5, r.shape), -1, 1)
        lines, there = equations.enclose(c, r), equations.enclose(c + xi * r, 0 * r).values
        rest = np.abs(there - lines.values - (lines.slopes @ (xi * r)[:, :, None])[:, :, 0])
        assert np.all(rest <= lines.errors)


@pytest.mark.parametrize("name", ["five_bar", "agile_eye", "slider_crank"])
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
        near = near[distinct_rows(np.exp(1j * near))]
        assert are_leg_solutions_complete(robot, own, given, q, near, robot.reference.x)
        for k in range(len(near)):
            rest = np.delete(near, k, axis=0)
            assert not are_leg_solutions_complete(robot, own, given, q, rest, robot.reference.x)


def test_a_row_repeats_only_those_that_stay():
    steps = 0.6 * DISTINCT_SOLUTIONS * np.arange(5.0)
    assert distinct_rows(steps[:, None]) == [0, 2, 4]
    angles = np.array([[0.0, 1.0], [2 * np.pi, 1.0], [0.0, 1.1]])
    assert distinct_rows(np.exp(1j * angles)) == [0, 2]


def robot_of(name, motors, platform, frames):
    """A robot of the catalogue whose loop is closed by a rod of 0.12 m between two frames instead."""
    description = replace(
        robots.load(name).description,
        actuators=tuple(Actuator(motor) for motor in motors),
        platform=platform,
        closures=(Closure("rod", frames, ("distance",), 0.12),),
        springs=(),
        scenes={},
    )
    return ParallelRobot.from_description(description)


def check_thirds() -> None:
    """The sum of |d3F_ijk| r_k at corners of boxes, about poses where levers vanish or a crank lies along x.

    The links of the 5R are folded onto each other. Of a slider at s and the end of a crank at x = L, with the
    rod between them, |p|^2 = s^2 + L^2 - 2 s L cos has the third derivatives 2 L and 2 s L.
    """
    slide = ("slide", "crank_pin"), Platform("rod", ("x", "rz")), ("slider", "rod")
    bars = ("left_motor", "left_elbow", "right_motor"), Platform("left_tip", ("x", "y", "rz"))
    for robot, joints, angle in (
        (robots.load("five_bar"), ("left_elbow", "right_elbow"), np.pi),
        (robot_of("five_bar", *bars, ("left_tip", "right_tip")), (), 0.0),
        (robot_of("slider_crank", *slide), ("crank_bearing",), 0.0),
    ):
        bounds, rng = DerivativeBounds.of(robot), np.random.default_rng(1)
        k, n = len(bounds.unknowns), robot.n
        u, radii = rng.uniform(-1, 1, (24, k)), rng.choice([0.0, 0.5, 1.0], (24, k))
        for joint in joints:
            column = robot.model.joints[robot.model.getJointId(joint)].idx_v
            u[:, robot.moving == column] = angle - robot.reference.q[column]
        bound = bounds.evaluate(bounds.configurations(u)).remainders(radii).hessians[:, n:]
        corner = u + radii * rng.choice([-1.0, 0.0, 1.0], radii.shape)
        total = np.zeros_like(bound)
        for joint, step in enumerate(STEP * np.eye(k)):
            ahead, behind = (bounds.evaluate(bounds.configurations(corner + s * step)) for s in (1, -1))
            rates = (ahead.hessians - behind.hessians)[:, n:] / (2 * STEP)
            total += np.abs(rates) * radii[:, joint, None, None, None]
        assert (total <= bound + 1e-7).all()


def test_third_derivatives_are_within_their_bounds():
    check_thirds()


@pytest.mark.parametrize(
    ("function", "old", "new"),
    [
        (derivative_bounds._bound_levers, "widened[:, j] += travel", "pass"),
        (derivative_bounds._bound_levers, "travel + radii[:, j] * widened[:, j]", "travel"),
        (derivative_bounds._bound_square_thirds, "(mixed + mixed.swapaxes(1, 2)", "(mixed"),
        (derivative_bounds._bound_square_thirds, "(mixed + mixed.swapaxes(1, 2)", "(mixed.swapaxes(1, 2)"),
        (derivative_bounds._bound_square_thirds, "travel * seconds + ", ""),
        (derivative_bounds._bound_square_thirds, " + largest_distance * thirds", ""),
        (derivative_bounds._bound_thirds, "abs(term.factor) * thirds", "thirds / 1.1"),
    ],
)
def test_no_term_of_third_derivatives_is_idle(function, old, new, monkeypatch):
    monkeypatch.setattr(function, "__code__", mutated_code(function, old, new))
    with pytest.raises(AssertionError):
        check_thirds()
