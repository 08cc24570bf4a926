"""The lines along which the motors' forces act on the platform.

Row k of G (framework.dynamics.platform_wrench) is the wrench that a torque of 1 N m of motor k gives the
platform: a force along a line, or a torque about an axis on a platform that only turns. At a Type 2
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

    A wrench is known on the platform's own axes alone: where those are fewer than six, the line is one of
    those that give it, the nearest to the origin. None for one motor, or where a wrench is no force along a
    line (a screw with pitch), or is none at all, or where the platform's axes are not those of the base.
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
    # place x way = arm, on the axes about which the platform turns: place = -[way]x^+ arm there
    crossing = np.cross(np.eye(3), way[:, :, None, :])  # (F, n_a, 3, 3): row i is e_i x way
    of_place = np.swapaxes(crossing, 2, 3)[:, :, turning, :]
    to_place = np.linalg.pinv(of_place, rcond=RANK_ROUNDING)
    place = np.einsum("fkij,fkj->fki", to_place, arm[:, :, turning])
    missed = np.abs(np.einsum("fkij,fkj->fki", of_place, place) - arm[:, :, turning]).max()
    if missed > FILE_ROUNDING * max(robot.length, float(np.abs(arm).max())):
        return None
    return ActionLines(place, way)
