"""The set of forces that the motors can give together, as a figure.

Within torque limits the sums of the rows of G (framework.dynamics.platform_wrench) fill a polygon or a
parallelepiped, which is flat across t_s at a Type 2 singularity.
"""

from __future__ import annotations

import numpy as np

from framework.arrays import Array
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.platform import FramePlatform


def drawn_sides(robot: ParallelRobot, motor_speed: Array, limit: Array) -> Array | None:
    """Compute the edges (F, n_a, 3) of that set: each motor's force or torque at its limit (n_a,).

    From G (F, n_a, n). None where that is no figure of the plane or of space: one motor, or forces together
    with torques.
    """
    if robot.n == 1 or why_no_figure(robot) is not None:
        return None
    return figure_vectors(robot, limit[:, None] * motor_speed)


def figure_vectors(robot: ParallelRobot, wrenches: Array) -> Array:
    """Return the forces (..., 3) of wrenches (..., n) on base axes, or torques if the platform only turns."""
    assert isinstance(robot.platform, FramePlatform)
    vectors = np.zeros((*wrenches.shape[:-1], 3))
    vectors[..., robot.platform.axes % 3] = wrenches
    return vectors


def why_no_figure(robot: ParallelRobot) -> str | None:
    """Return the reason why the motors' forces are not drawn as one figure; None if drawn or one number."""
    platform, kinds = robot.platform, len(set(robot.translations))
    if robot.n == 1:
        return None
    if not isinstance(platform, FramePlatform) or not platform.constant:
        return "on axes of its own: not drawn in the scene"
    if kinds > 1:
        return f"forces and torques have {robot.n} dimensions: not drawn in the scene"
    if (robot.n == 2 and platform.is_point) or (robot.n == 3 and robot.n_a == 3):
        return None
    return f"{robot.n_a} motors for {robot.n} freedoms: not drawn in the scene"
