"""Placements for pictures: pinocchio's own, continuous quaternions, axes that move what they should."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import robots
from framework import track_path
from framework.kinematics.frames import frames_at
from framework.kinematics.placements import (
    carried_axis,
    frame_origins,
    joint_axis,
    joint_poses,
    planar_normal,
    platform_positions,
    rotate_vector,
)
from framework.planning.scenes import scene_path

NAMES = ["five_bar", "slider_crank", "delta", "gough_stewart", "standing_quadruped"]


def anywhere(robot, count: int):
    steps = np.random.default_rng(6).standard_normal((count, robot.model.nv))
    return np.array([pin.integrate(robot.model, robot.q_near, step) for step in steps])


def test_poses_are_those_of_pinocchio_and_turn_smoothly():
    robot = robots.load("four_bar")
    path = scene_path(robot.description.scenes["full_turn"])
    q = track_path(robot, path).close(np.linspace(0.0, 1.0, 301)).q
    poses = joint_poses(robot, q)
    data = robot.model.createData()
    for k in (0, 100, 300):
        pin.forwardKinematics(robot.model, data, q[k])
        for j, placement in enumerate(data.oMi):
            np.testing.assert_allclose(
                pin.XYZQUATToSE3(poses[k, j]).homogeneous, placement.homogeneous, atol=1e-12
            )
    assert np.sum(poses[1:, :, 3:] * poses[:-1, :, 3:], axis=2).min() > 0.99


@pytest.mark.parametrize("name", NAMES)
def test_frames_hang_on_their_joints(name):
    robot = robots.load(name, flexibility="flexible_links")
    q = anywhere(robot, 3)
    poses, at = joint_poses(robot, q), frames_at(robot, q)
    for k, frame in enumerate(robot.frames):
        found = frame_origins(robot, poses, frame)
        np.testing.assert_allclose(found, at.position[:, k], rtol=0, atol=1e-13 * max(robot.length, 1.0))
    np.testing.assert_array_equal(
        platform_positions(robot, poses), frame_origins(robot, poses, robot.frames[0])
    )


@pytest.mark.parametrize("name", NAMES)
def test_a_joint_s_axis_is_the_screw_that_it_moves_along(name):
    """Seen from the joint before it and seen from the joint itself, against pinocchio's Jacobian."""
    robot = robots.load(name)
    (q,) = anywhere(robot, 1)
    data = robot.model.createData()
    screws = pin.computeJointJacobians(robot.model, data, q)
    for column in range(robot.model.nv):
        slides = robot.sliding[column]
        for joint, place, axis in (joint_axis(robot, column), carried_axis(robot, column)):
            direction = data.oMi[joint].rotation @ axis
            expected = screws[:3, column] if slides else screws[3:, column]
            np.testing.assert_allclose(direction, expected, atol=1e-14)
            if not slides:  # the axis passes through the place: a point there does not move
                point = data.oMi[joint].act(place)
                still = screws[:3, column] + np.cross(direction, point)
                np.testing.assert_allclose(still, 0.0, atol=1e-13 * max(robot.length, 1.0))


def test_a_quaternion_turns_a_vector_as_its_matrix_does():
    turns = Rotation.from_quat(np.random.default_rng(1).standard_normal((20, 4)))
    vector = np.array([0.3, -1.2, 0.7])
    np.testing.assert_allclose(rotate_vector(turns.as_quat(), vector), turns.apply(vector), atol=1e-15)


@pytest.mark.parametrize(
    ("name", "normal"),
    [("five_bar", [0, 0, 1]), ("three_rrr", [0, 0, 1]), ("slider_crank", [0, 0, 1]), ("delta", None)],
)
def test_the_normal_of_a_planar_robot_is_the_axis_of_its_hinges(name, normal):
    found = planar_normal(robots.load(name))
    if normal is None:
        assert found is None
    else:
        np.testing.assert_allclose(np.abs(found), normal, atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_a_coordinate_slides_if_what_it_carries_does_not_turn(name):
    robot = robots.load(name, flexibility="flexible_links")
    (q,) = anywhere(robot, 1)
    screws = pin.computeJointJacobians(robot.model, robot.model.createData(), q)
    turns = np.linalg.norm(screws[3:], axis=0) > 0.5
    np.testing.assert_array_equal(robot.sliding, ~turns)
