"""Placements and velocities of a robot's joints and frames at F configurations, for drawing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.kinematics.frames import frames_at, tree_columns
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import matvec
from framework.tolerances import FILE_ROUNDING


def joint_poses(robot: ParallelRobot, q: Array) -> Array:
    """Compute the poses (F, njoints, 7) of all joints at q (F, nq).

    A pose is (x, y, z, qx, qy, qz, qw). Both signs of a quaternion describe the same attitude. The sign is
    chosen so that quaternions are continuous from configuration to configuration.
    """
    model, data = robot.model, robot.model.createData()
    poses = np.empty((len(q), model.njoints, 7))
    for k in range(len(q)):
        pin.forwardKinematics(model, data, q[k])
        for j, placement in enumerate(data.oMi):
            poses[k, j] = pin.SE3ToXYZQUAT(placement)
    quaternions = poses[:, :, 3:]
    cosines = np.sum(quaternions[1:] * quaternions[:-1], axis=2)  # (F - 1, njoints) of successive ones
    signs = np.cumprod(np.where(cosines < 0, -1.0, 1.0), axis=0)
    quaternions[1:] *= signs[:, :, None]
    return poses


def platform_positions(robot: ParallelRobot, poses: Array) -> Array:
    """Compute the origin (F, 3) [m] of the platform's frame at `poses` of `joint_poses`."""
    return frame_origins(robot, poses, robot.frames[0])


def platform_frame_twists(robot: ParallelRobot, q: Array, v: Array) -> Array:
    """Compute twists (F, 6) of the platform's frame, base axes, for v (F, n) at q (F, nq)."""
    return robot.platform.frame_twist(frames_at(robot, q), v)


def platform_wrenches(robot: ParallelRobot, q: Array, W: Array) -> Array:
    """Compute wrenches (F, 6) at the platform's origin, base axes, for W (F, n) at q (F, nq)."""
    units = np.broadcast_to(robot.platform.wrenches(frames_at(robot, q)), (len(W), robot.n, 6))
    return matvec(units.swapaxes(1, 2), W)


def frame_origins(robot: ParallelRobot, poses: Array, frame: int) -> Array:
    """Compute the origin (F, 3) [m] of one of pinocchio's frames at F configurations.

    Args:
        poses: (F, njoints, 7) of the joints: positions [m], then quaternions (x, y, z, w).
        frame: index of the frame in the model.
    """
    placed = robot.model.frames[frame]
    joint = poses[:, placed.parentJoint]
    return joint[:, :3] + rotate_vector(joint[:, 3:], placed.placement.translation)


def frame_positions(robot: ParallelRobot, poses: Array) -> Array:
    """Compute all positions (m, 3) [m] of joints, platform and loop frames, which a view has to show.

    Args:
        poses: (F, njoints, 7) of the joints: positions [m], then quaternions (x, y, z, w).
    """
    ends = [frame_origins(robot, poses, frame) for frame in robot.frames]
    # the positions of all joints but joint 0, the world
    return np.concatenate([poses[:, 1:, :3].reshape(-1, 3), *ends])


def rotate_vector(quaternion: Array, vector: Array) -> Array:
    """Rotate vectors u (3,) or (F, 3) by unit quaternions (F, 4), each (x, y, z, w).

    With the vector part a = (x, y, z) the result is u + 2 w a x u + 2 a x (a x u).
    """
    a, w = quaternion[:, :3], quaternion[:, 3:]
    doubled = 2 * np.cross(a, vector)  # 2 a x u
    return vector + w * doubled + np.cross(a, doubled)


def carried_points(pose: Array, points: Array) -> Array:
    """Convert points (m, 3) from the frame of a joint at a `pose` (7,) to the base."""
    return pose[:3] + rotate_vector(pose[None, 3:], points)


class JointAxis(NamedTuple):
    """The axis of a coordinate in the frame of one of pinocchio's joints."""

    joint: int  # index of the joint; 0 is the base
    place: Array  # (3,) [m] a point on the axis
    axis: Array  # (3,) unit direction


def joint_axis(robot: ParallelRobot, column: int) -> JointAxis:
    """Return the axis of a column in the frame of the joint that carries its joint."""
    joint, _, axis = carried_axis(robot, column)
    placement = robot.model.jointPlacements[joint]
    return JointAxis(
        joint=int(robot.model.parents[joint]), place=placement.translation, axis=placement.rotation @ axis
    )


def carried_axis(robot: ParallelRobot, column: int) -> JointAxis:
    """Return the axis of a column in the frame of its own joint."""
    model = robot.model
    joint = int(tree_columns(robot).owner[column])  # the joint to which the column belongs
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    jacobian = pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL).reshape(6, -1)
    linear, angular = jacobian[:, column].reshape(2, 3)
    axis = linear if robot.sliding[column] else angular
    return JointAxis(joint, place=np.zeros(3), axis=axis / np.linalg.norm(axis))


def planar_normal(robot: ParallelRobot) -> Array | None:
    """Compute the unit normal (3,) of a planar robot in the base frame; None if not planar.

    All hinges of a planar robot are parallel to the normal, all slides are perpendicular to it.
    """
    screws = frames_at(robot, robot.reference.q[None]).screws[0]  # (nv, 6)
    turning = screws[:, 3:].any(axis=1)  # slides have no angular velocity
    if not turning.any():
        return None
    hinges, slides = screws[turning, 3:], screws[~turning, :3]  # unit axes
    normal = hinges[0]
    hinge_tilt = np.linalg.norm(np.cross(hinges, normal), axis=1).max()
    slide_slope = np.abs(slides @ normal).max(initial=0.0)
    return normal if max(hinge_tilt, slide_slope) < FILE_ROUNDING else None
