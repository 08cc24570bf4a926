"""Admissible wrenches and speeds of the platform: at their corners the motors are at their limits."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import robots
from framework import InvalidInput, SingularPose, assemble, dynamics_at, platform_limits, velocity_matrices
from framework.dynamics.platform_wrench import hold_at
from framework.kinematics.placements import platform_wrenches
from tests.robots.test_humanoid_ankle import cranks, derivative

# translations; with a turn; a rotation vector; translations and a rotation vector; joints
NAMES = ["five_bar_heavy", "three_rrr", "agile_eye", "gough_stewart", "humanoid_ankle", "humanoid_knee"]


def posed(name):
    robot = robots.load(name)
    rng = np.random.default_rng(1)
    step = 0.03 * robot.platform_scale
    return robot, assemble(robot, robot.reference.x + step * rng.uniform(-1, 1, robot.n)).q


@pytest.mark.parametrize("name", NAMES)
def test_at_a_corner_all_motors_are_at_their_limits(name):
    """What the platform gives the world pushes back on it, and the equations of motion tell the torques."""
    robot, q = posed(name)
    torque, speed = np.linspace(0.5, 1.5, robot.n_a), np.linspace(20, 30, robot.n_a)
    limits = platform_limits(robot, q, torque_limit=torque, speed_limit=speed)
    frame = robot.description.platform.frame
    assert len(limits.wrenches.vertices) == len(limits.speeds.vertices) == 2**robot.n
    for U in limits.wrenches.vertices[:8]:
        pushed = platform_wrenches(robot, q[None], -U[None])[0]
        found = dynamics_at(robot, q, wrenches={frame: pushed}).torque
        np.testing.assert_allclose(np.abs(found), torque, rtol=1e-9)
    A, B, _ = velocity_matrices(robot, q)
    for v in limits.speeds.vertices[:8]:
        rates = robot.gear_ratio * np.linalg.solve(B, A @ v)
        np.testing.assert_allclose(np.abs(rates), speed, rtol=1e-9)


def test_without_weight_it_is_the_force_polygon_of_the_5r():
    robot = robots.load("five_bar")  # horizontal
    q = assemble(robot, [0.1, 0.345]).q
    found = platform_limits(robot, q, torque_limit=0.2).wrenches.vertices
    G = hold_at(robot, q, np.zeros(2)).motor_speed
    corners = 0.2 * np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) @ G
    assert ConvexHull(np.concatenate([found, corners])).volume == pytest.approx(
        ConvexHull(corners).volume, rel=1e-12
    )
    np.testing.assert_allclose(np.sort(found, axis=0), np.sort(corners, axis=0), atol=1e-12)


def test_joints_of_the_ankle_have_the_limits_of_its_closed_form():
    """Torques of pitch and roll are J' times those of the cranks, 43 N m, less the weight of the foot."""
    robot = robots.load("humanoid_ankle")
    for x in ([0.0, 0.0], [-0.6, 0.3]):
        limits = platform_limits(robot, assemble(robot, x).q)
        torque = limits.wrenches.vertices + limits.weight
        across = np.linalg.solve(derivative(cranks, np.array(x)).T, torque.T)
        np.testing.assert_allclose(np.abs(across), 18 * 2.3889, rtol=1e-10)
    # level, the foot is no box: what pitch gives alone it cannot give while roll gives what it can alone
    level = platform_limits(robot, assemble(robot, [0.0, 0.0]).q).wrenches
    assert not level.contains(level.axis_ranges()[:, 1])


def test_at_type_2_the_wrenches_are_flat_along_t_s_and_its_speed_has_no_bound():
    robot = robots.load("five_bar")
    q = assemble(robot, [0.0, np.sqrt(0.06)]).q
    with pytest.raises(SingularPose):
        dynamics_at(robot, q)
    limits = platform_limits(robot, q, torque_limit=0.2, speed_limit=100.0)
    G = hold_at(robot, q, np.zeros(2)).motor_speed
    t_s = np.linalg.svd(G)[2][-1]
    assert np.abs(limits.wrenches.vertices @ t_s).max() < 1e-6 * np.abs(limits.wrenches.vertices).max()
    low, high = limits.speeds.reach(t_s)
    assert -low == high > 1e6 * limits.speeds.reach(np.array([t_s[1], -t_s[0]]))[1]


def test_motors_without_limits_leave_nothing_to_say():
    robot, q = posed("five_bar_heavy")
    limits = platform_limits(robot, q)
    assert limits.wrenches is None
    assert limits.speeds is None
    assert platform_limits(robot, q, speed_limit=[10, 20]).polytopes.keys() == {"speed"}
    for bad in (0.0, [1.0, 2.0, 3.0], float("nan"), "one"):
        with pytest.raises(InvalidInput, match="torque_limit: needs one positive number"):
            platform_limits(robot, q, torque_limit=bad)
