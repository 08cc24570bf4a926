"""The lines along which the motors' forces act on the platform.

Row k of G (`platform_wrench`) is the wrench on the platform that motor k exerts with a torque of 1 N m. It is
a force along a line or, on a platform that only turns, a moment about an axis. At a Type 2 singularity
G t_s = 0: all these lines are reciprocal to t_s (J.-P. Merlet, Parallel Robots, 2006, on line geometry).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.platform import FramePlatform
from framework.numerics.arrays import Array
from framework.tolerances import FILE_ROUNDING, RANK_ROUNDING


class ActionLines(NamedTuple):
    """The line of each motor's force at F instants, relative to the platform's origin."""

    point: Array  # (F, n_a, 3) [m] the point of the line that is nearest to the origin
    direction: Array  # (F, n_a, 3) unit vector


def action_lines(robot: ParallelRobot, motor_speed: Array) -> ActionLines | None:
    """Compute the lines of the motors' forces, or the axes of their moments, from G (F, n_a, n).

    A force f along a line through p has the moment p x f. G contains only the components along the platform's
    axes. With fewer than six axes several lines have these components; the result is the one nearest to the
    origin.

    Returns:
        None for a single motor, for a wrench that is not a force along a line (zero, or a screw with pitch),
        and if the platform's axes are not those of the base.
    """
    platform = robot.platform
    if robot.n_a < 2 or not isinstance(platform, FramePlatform) or not platform.constant:
        return None
    wrench = np.zeros((*motor_speed.shape[:2], 6))
    wrench[:, :, platform.axes] = motor_speed
    force, moment = wrench[:, :, :3], wrench[:, :, 3:]
    vector = force if platform.translations.any() else moment
    norm = np.linalg.norm(vector, axis=2, keepdims=True)
    if not np.all(np.isfinite(wrench)) or np.any(norm <= 0):
        return None
    direction = vector / norm
    rotations = [axis - 3 for axis in platform.axes if axis >= 3]
    if not rotations or not platform.translations.any():
        return ActionLines(np.zeros_like(direction), direction)
    # Solve point x direction = moment / norm on the platform's axes of rotation, for the shortest point.
    arm = (moment / norm)[:, :, rotations]  # [m] moments of unit forces
    products = np.cross(np.eye(3), direction[:, :, None, :])  # row i: unit vector i x direction
    cross_matrix = products.swapaxes(2, 3)[:, :, rotations]
    point = np.einsum("fkij,fkj->fki", np.linalg.pinv(cross_matrix, rcond=RANK_ROUNDING), arm)
    error = np.abs(np.einsum("fkij,fkj->fki", cross_matrix, point) - arm).max()
    if error > FILE_ROUNDING * max(robot.length, np.abs(arm).max()):
        return None
    return ActionLines(point, direction)
