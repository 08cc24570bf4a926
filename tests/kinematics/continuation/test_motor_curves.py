"""The equations of motor curves by differences, and what is noted on the way against small steps."""

import numpy as np
import pytest

import robots
from framework.kinematics.continuation import motor_curves
from framework.kinematics.continuation.motor_curves import (
    close_at_motors,
    follow_curves,
    rates_closing_loops,
)
from framework.kinematics.frames import frames_at, full_motion, integrate
from framework.kinematics.linearised_loops import clearance, linearised_at, linearised_at_reference
from tests.kinematics.continuation.small_steps import are_same, turn

NAMES = ["five_bar", "slider_crank", "three_rrr"]


def motors_turned(robot, count: int, size: float) -> np.ndarray:
    """Motions (count, nv) of the motors alone, up to `size` [rad, robot lengths]."""
    rng = np.random.default_rng(2)
    scale = robot.column_scale[robot.actuated]
    return full_motion(robot, robot.actuated, rng.uniform(-size, size, (count, robot.n_a)) * scale)


@pytest.mark.parametrize("name", NAMES)
def test_equations_have_the_slopes_of_their_differences(name):
    robot, step = robots.load(name), 1e-6
    aside = 0.02 * np.random.default_rng(1).standard_normal((3, robot.nv)) * robot.column_scale
    q, motors = (
        integrate(robot, robot.reference.q[None].repeat(3, axis=0), aside),
        motors_turned(robot, 3, 1.0),
    )

    def equations(moved):
        return motor_curves._motor_equations(robot, linearised_at(robot, integrate(robot, q, moved)), motors)

    unit = np.diag(robot.column_scale)
    ways = [*(np.tile(unit[k], (3, 1)) for k in robot.following), motors]  # passive joints, then the share
    differences = [(equations(step * w).values - equations(-step * w).values) / (2 * step) for w in ways]
    np.testing.assert_allclose(equations(0 * motors).slopes, np.stack(differences, axis=2), atol=1e-8)


@pytest.mark.parametrize("name", NAMES)
def test_clearances_on_the_way_are_those_of_small_steps(name):
    robot, count = robots.load(name), 4
    motions = motors_turned(robot, count, 0.25)
    linearised = linearised_at_reference(robot)
    targets = robot.actuated_coordinates(robot.reference.q[None]) + motions[:, robot.actuated]
    found, loops = follow_curves(robot, linearised, robot.reference.x, targets)
    arrived = found.share == 1.0
    assert arrived.sum() > 1
    np.testing.assert_allclose(robot.actuated_coordinates(found.q)[arrived], targets[arrived], atol=1e-14)
    assert (found.least <= clearance(robot, loops) * (1 + 1e-6)).all()
    at_rest = robot.platform.unwrap(robot.platform.coordinates(frames_at(robot, found.q)), robot.reference.x)
    np.testing.assert_allclose(found.x[arrived], at_rest[arrived], atol=1e-9)
    shares = np.linspace(0.0, 1.0, 9)
    for k in np.flatnonzero(arrived):
        way = turn(robot, shares[:, None] * motions[k, robot.actuated], 16)
        assert are_same(robot, way[-1:], found.q[[k]]).all()
        on_way = clearance(robot, linearised_at(robot, way))
        ends = on_way[[0, -1]]
        assert on_way.min() - 1e-3 < found.least[k] <= ends.min() + 1e-9
        assert ends.max() - 1e-9 <= found.largest[k] < on_way.max() + 1e-3
        assert found.steps[k] >= 1


@pytest.mark.parametrize("name", NAMES)
def test_loops_close_with_the_motors_where_they_are_told(name):
    robot = robots.load(name)
    start, motions = robot.reference.q, motors_turned(robot, 4, 0.05)
    starts = start[None].repeat(4, axis=0)
    rates = rates_closing_loops(robot, linearised_at(robot, starts), motions)
    np.testing.assert_allclose(rates[:, robot.actuated], motions[:, robot.actuated], atol=0)
    closed = close_at_motors(robot, start, motions, integrate(robot, starts, 0.9 * rates))
    assert closed.closed.all()
    turned = robot.actuated_coordinates(closed.q) - robot.actuated_coordinates(start[None])
    np.testing.assert_allclose(turned, motions[:, robot.actuated], atol=1e-14)
    # rates are the first order of the way there
    ahead = close_at_motors(robot, start, 1e-6 * motions, starts).q
    np.testing.assert_allclose((ahead - start) / 1e-6, rates, atol=1e-4 * np.abs(rates).max())
