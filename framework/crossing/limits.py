"""Limits of the motors that a law is to keep: given, or the robot file's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from framework.arrays import Array
from framework.errors import InvalidInput
from framework.kinematics.parallel_robot import ParallelRobot
from framework.motion.law import is_number

Limit = float | Sequence[float] | None


def motor_limits(
    robot: ParallelRobot, torque_limit: Limit, speed_limit: Limit, margin: float
) -> tuple[Array, Array]:
    """Largest torques [N m] and speeds [rad/s] (n_a,) of the motors, motor side; infinite if unlimited.

    Args:
        torque_limit, speed_limit: a number for all motors, one for each, or None for the robot file's.
        margin: share of the limits that is left to the controllers.

    Raises:
        InvalidInput: a limit is not positive, there are not as many as motors, the margin is not in [0, 1).
    """
    if not (is_number(margin) and 0 <= margin < 1):
        raise InvalidInput(f"margin: must lie in [0, 1), got {margin!r}")
    motors = robot.description.actuators
    torque = _limits(robot, "torque_limit", torque_limit, [motor.torque_limit for motor in motors])
    speed = _limits(robot, "speed_limit", speed_limit, [motor.speed_limit for motor in motors])
    return torque * (1.0 - margin), speed * (1.0 - margin)


def _limits(robot: ParallelRobot, name: str, given: Limit, in_file: Sequence[float | None]) -> Array:
    if given is None:
        return np.array([np.inf if limit is None else limit for limit in in_file])
    try:
        values = np.atleast_1d(np.array(given, dtype=float))
    except (TypeError, ValueError):
        values = np.empty(0)
    if values.shape not in ((1,), (robot.n_a,)) or not np.all(np.isfinite(values)) or np.any(values <= 0):
        raise InvalidInput(
            f"{name}: needs one positive number, or one for each motor "
            f"({', '.join(robot.actuator_names)}), got {given!r}"
        )
    return np.broadcast_to(values, (robot.n_a,)).copy()
