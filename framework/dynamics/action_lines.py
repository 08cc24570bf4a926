"""The lines along which the motors' forces act on the platform.

Row k of G (framework.dynamics.platform_wrench) is the wrench of a torque of 1 N m of motor k on the platform:
a force along a line, or a torque about an axis on a platform that only turns. At a Type 2
singularity G t_s = 0: all these lines are reciprocal to t_s (J.-P. Merlet, Parallel Robots, 2006, on
singularities by line geometry).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.platform import FramePlatform
from framework.tolerances import FILE_ROUNDING, RANK_ROUNDING


class ActionLines(NamedTuple):
    """A line for each of F instants and each motor, from the platform's origin."""

    place: Array  # (F, n_a, 3) [m] the point of the line that is nearest to the origin
    way: Array  # (F, n_a, 3) unit


def action_lines(robot: ParallelRobot, motor_speed: Array) -> ActionLines | None:
    """Compute the lines of the motors' forces, from G (F, n_a, n), or the axes of their torques.

    A wrench is known on the platform's own axes alone: if these are fewer than six, several lines have the
    same wrench, and the one nearest to the origin is returned. None for one motor, for a wrench that is no
    force along a line (a screw with pitch, or zero), or if the platform's axes are not those of the base.
    """
    platform = robot.platform
    if robot.n_a < 2 or not isinstance(platform, FramePlatform) or not platform.constant:
        return None
    six = np.zeros((*motor_speed.shape[:2], 6))
    six[:, :, platform.axes] = motor_speed
    force, moment = six[:, :, :3], six[:, :, 3:]
    if not platform.translations.any():
        force, moment = moment, np.zeros_like(moment)
    size = np.linalg.norm(force, axis=2, keepdims=True)
    if not np.all(np.isfinite(six)) or np.any(size <= 0):
        return None
    way, arm = force / size, moment / size
    turning = [axis - 3 for axis in platform.axes if axis >= 3] if platform.translations.any() else []
    if not turning:
        return ActionLines(np.zeros_like(way), way)
    # place x way = arm on the axes about which the platform turns: solve for the place of least norm
    arms = np.cross(np.eye(3), way[:, :, None, :]).swapaxes(2, 3)[
        :, :, turning
    ]  # (F, n_a, turns, 3) of places
    place = np.einsum("fkij,fkj->fki", np.linalg.pinv(arms, rcond=RANK_ROUNDING), arm[:, :, turning])
    error = np.abs(np.einsum("fkij,fkj->fki", arms, place) - arm[:, :, turning]).max()
    if error > FILE_ROUNDING * max(robot.length, float(np.abs(arm).max())):
        return None
    return ActionLines(place, way)
