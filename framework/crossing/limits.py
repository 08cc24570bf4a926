"""Limits of the motors that a law is to keep: those asked for, or the robot file's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from framework.arrays import Array
from framework.crossing.optimal import Specification
from framework.crossing.request import Request
from framework.kinematics.parallel_robot import ParallelRobot


def motor_limits(robot: ParallelRobot, request: Request) -> tuple[Array, Array]:
    """Largest torques [N m] and speeds [rad/s] (n_a,) of the motors, motor side, the margin taken off.

    Infinite where neither the request nor the robot file has a limit.
    """
    motors, share = robot.description.actuators, 1.0 - request.margin
    torque = _limits(request.torque_limit, [motor.torque_limit for motor in motors])
    speed = _limits(request.speed_limit, [motor.speed_limit for motor in motors])
    return torque * share, speed * share


def _limits(asked: Sequence[float] | None, in_file: Sequence[float | None]) -> Array:
    if asked is not None:
        return np.broadcast_to(np.array(asked), (len(in_file),)).copy()
    return np.array([np.inf if limit is None else limit for limit in in_file])


def specification_of(robot: ParallelRobot, request: Request) -> Specification:
    """What an optimal law for this request is to be best at, with the limits of this robot's motors."""
    limits = motor_limits(robot, request)
    return Specification(request.goal, request.duration, request.longest, *limits, request.smoothness)
