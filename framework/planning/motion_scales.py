"""The scales by which errors of a motion are divided: the length of the path and the largest torque.

Angles are multiplied by the robot's length, so that they are comparable with distances.
"""

from __future__ import annotations

import numpy as np

from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.path import Path
from framework.numerics.arrays import Array


def coordinate_sizes(robot: ParallelRobot) -> Array:
    """Return the length (n,) [m] per unit of each platform coordinate.

    It is 1 for a coordinate in m, and the robot's length for one in rad.
    """
    return np.where(robot.translations, 1.0, robot.length)


def path_length(robot: ParallelRobot, path: Path) -> float:
    """Compute the length [m] of a path from a polygon through 1001 of its points."""
    points = path(np.linspace(0.0, 1.0, 1001)) * coordinate_sizes(robot)
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def largest_by_unit(robot: ParallelRobot, torques: Array) -> Array:
    """Compute for each motor (n_a,) the largest torque of all motors of the same unit.

    Args:
        torques: (n_a,) >= 0.

    Returns:
        Positive numbers: the least positive float stands for zero, so that they can be divisors.
    """
    units = np.array(robot.torque_units)
    largest = [torques[units == unit].max() for unit in units]
    return np.maximum(largest, np.finfo(float).tiny)
