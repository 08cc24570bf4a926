"""What the motors can give, as something to draw: all their forces together.

Within torque limits the sums of the rows of G (framework.dynamics.platform_wrench) fill a polygon or a
parallelepiped, which is flat across t_s at a Type 2 singularity.
"""

from __future__ import annotations

import numpy as np

from framework.arrays import Array
from framework.kinematics.parallel_robot import ParallelRobot


def drawn_sides(robot: ParallelRobot, motor_speed: Array, limit: Array) -> Array | None:
    """Edges (F, n_a, 3) of what motors within limits (n_a,) give: their forces, or torques, at full torque.

    None where that is no figure of the plane or of space: one motor, or forces together with torques.
    """
    if why_no_figure(robot) is not None or robot.n == 1:
        return None
    sides = np.zeros((*motor_speed.shape[:2], 3))
    sides[:, :, [axis % 3 for axis in robot.platform.axes]] = limit[:, None] * motor_speed
    return sides


def why_no_figure(robot: ParallelRobot) -> str | None:
    """Why the forces of the motors are not drawn as one figure; None where they are, or are one number."""
    shifts = robot.platform.translations
    if robot.n == 1:
        return None
    if shifts.any() and not shifts.all():
        return f"forces and torques have {robot.n} dimensions: not drawn in the scene"
    if robot.n == 2 and shifts.all():
        return None
    if robot.n == 3 and robot.n_a == 3:
        return None
    return f"{robot.n_a} motors for {robot.n} freedoms: not drawn in the scene"
