"""The sizes that errors of a motion are relative to: length of its path, and largest torque.

Turns are multiplied by the robot's length so that they count beside distances.
"""

from __future__ import annotations

import numpy as np

from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.path import Path
from framework.numerics.arrays import Array


def coordinate_sizes(robot: ParallelRobot) -> Array:
    """Return the length (n,) [m] of each platform coordinate's unit.

    It is 1 for m, the robot's length for rad.
    """
    return np.where(robot.translations, 1.0, robot.length)


def path_length(robot: ParallelRobot, path: Path) -> float:
    """Compute the length of a path [m], as that of a polygon."""
    points = path(np.linspace(0.0, 1.0, 1001)) * coordinate_sizes(robot)
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def largest_by_unit(robot: ParallelRobot, torques: Array) -> Array:
    """Compute for each motor the largest torque (n_a,) of motors of its unit.

    The torques (n_a,) are not negative.
    """
    units = np.array(robot.torque_units)
    largest = np.array([torques[units == unit].max() for unit in units])
    return np.maximum(largest, np.finfo(float).tiny)
