"""The direction of sight on a robot: planar ones along the normal of their plane, others from a corner."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import planar_normal

CORNER_DIRECTION = np.array([0.75, -1.35, 0.65])  # from the robot to the eye
FLAT_VIEW_SLOPE = np.tan(np.radians(10.0))  # planar robots on a page: bodies still show a depth


def seen_from(robot: ParallelRobot, *, flat: bool = False) -> tuple[Array, bool]:
    """Return the direction (3,) from the robot to the viewer, and whether the robot is planar.

    `flat`: planar robots exactly flat-on.
    """
    normal = planar_normal(robot)
    if normal is None:
        return CORNER_DIRECTION / np.linalg.norm(CORNER_DIRECTION), False
    normal = normal * (np.sign(normal @ np.array([0.2, -1.0, 2.0])) or 1.0)
    aside = np.array([0.0, -1.0, 0.0]) if abs(normal[2]) > 0.7 else np.array([0.5, 0.0, 0.8])
    direction = normal if flat else normal + FLAT_VIEW_SLOPE * aside
    return direction / np.linalg.norm(direction), True


class Projection(NamedTuple):
    """The projection of points of space onto the paper, without perspective [m]."""

    right: Array  # (3,)
    up: Array  # (3,)
    ahead: Array  # (3,) from the eye

    def __call__(self, points: Array) -> Array:
        """Return the places (..., 2) of points (..., 3)."""
        return np.asarray(points @ np.stack([self.right, self.up], axis=1))


def projection(robot: ParallelRobot) -> Projection:
    """Return the projection of a robot; flat-on for planar ones, whose figures have the base's axes [m]."""
    toward, _ = seen_from(robot, flat=True)
    upright = np.array([0.0, 1.0, 0.0]) if abs(toward[2]) > 0.7 else np.array([0.0, 0.0, 1.0])
    right = np.cross(upright, toward)
    right = right / np.linalg.norm(right)
    return Projection(right, np.cross(toward, right), -toward)
