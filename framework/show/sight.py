"""From where a robot is looked at: planar ones from the normal of their plane, others from a corner."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import planar_normal

CORNER_DIRECTION = np.array([0.75, -1.35, 0.65])  # from the robot to the eye
FLAT_VIEW_SLOPE = np.tan(np.radians(10.0))  # planar robots on a page: bodies still show a depth


def seen_from(robot: ParallelRobot, *, flat: bool = False) -> tuple[Array, bool]:
    """The direction (3,) from the robot to the eye, and whether the robot is planar.

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
    """Points of space onto the paper, without perspective: lengths across the sight stay as they are [m]."""

    right: Array  # (3,)
    up: Array  # (3,)
    ahead: Array  # (3,) from the eye

    def __call__(self, points: Array) -> Array:
        """Places (..., 2) of points (..., 3)."""
        return np.asarray(points @ np.stack([self.right, self.up], axis=1))


def projection(robot: ParallelRobot) -> Projection:
    """Flat-on for planar robots, so that the axes of a figure are those of the base [m]."""
    toward, _ = seen_from(robot, flat=True)
    upright = np.array([0.0, 1.0, 0.0]) if abs(toward[2]) > 0.7 else np.array([0.0, 0.0, 1.0])
    right = np.cross(upright, toward)
    right = right / np.linalg.norm(right)
    return Projection(right, np.cross(toward, right), -toward)
