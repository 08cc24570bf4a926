"""The goal and the limits of an optimal law, as stated in the request or the robot file."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from framework.dynamics.motor_friction import motor_friction
from framework.dynamics.motor_limits import motor_limits
from framework.dynamics.result import InverseDynamics
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, BoolArray, ReadOnlyArrays
from framework.numerics.peaks import peak_sizes
from framework.planning.request import Request


@dataclass(frozen=True, eq=False)
class Specification(ReadOnlyArrays):
    """The goal of an optimal law, and its limits.

    goal: "time"; "peak_torque", the largest torque divided by its limit; or "energy", the integral of the sum
        of (torque over limit)^2. In these ratios the largest limit of the other motors replaces a missing
        limit, without bounding the torque; if no motor has a limit, all have the same weight.
    duration: exact duration [s]; None if open.
    longest: largest duration [s]; None if unbounded.
    torque_limit, speed_limit: (n_a,) [N m], [rad/s], motor side; infinite for motors without a limit.
    smoothness: order up to which derivatives of s vanish at both ends.
    friction: (n_a,) dry friction, which is part of the motors' torques [N m], motor side.
    """

    goal: str
    duration: float | None
    longest: float | None
    torque_limit: Array
    speed_limit: Array
    smoothness: int
    friction: Array

    def scale_limits(self, share: float) -> Specification:
        """Return the specification with its limits multiplied by `share`."""
        return replace(self, torque_limit=self.torque_limit * share, speed_limit=self.speed_limit * share)

    @property
    def limited(self) -> bool:
        """Whether any torque has a limit."""
        return bool(self.limited_motors.any())

    @property
    def limited_motors(self) -> BoolArray:
        """The mask (n_a,) of motors whose torque has a limit."""
        return np.isfinite(self.torque_limit)

    @property
    def limited_speeds(self) -> bool:
        """Whether any speed has a limit."""
        return bool(np.isfinite(self.speed_limit).any())

    @property
    def max_duration(self) -> float | None:
        """The largest admissible duration [s], if any."""
        return self.duration or self.longest


def specification_of(robot: ParallelRobot, request: Request) -> Specification:
    """Return the goal and the limits of a request, less its margin.

    The robot file has the limits that the request does not state.
    """
    share = 1.0 - request.margin
    return Specification(
        goal=request.goal,
        duration=request.duration,
        longest=request.longest,
        torque_limit=share * motor_limits(robot, "torque_limit", request.torque_limit),
        speed_limit=share * motor_limits(robot, "speed_limit", request.speed_limit),
        smoothness=request.smoothness,
        friction=motor_friction(robot, request.friction),
    )


def motor_peaks(dynamics: InverseDynamics) -> tuple[Array, Array]:
    """Compute the largest torques [N m, N] and speeds [rad/s, m/s] (n_a,) of a motion.

    They are peaks of Chebyshev series, so that peaks between nodes count. The series have the panels and the
    number of coefficients of the torques.
    """
    edges = dynamics.torques.edges
    coefficient_count = dynamics.torques.coefficients.shape[1]
    torque = peak_sizes(dynamics.torque, edges, coefficient_count)
    speed = peak_sizes(lambda t: dynamics.motor_angle(t, 1), edges, coefficient_count)
    return torque, speed


def limit_excess(dynamics: InverseDynamics, specification: Specification) -> float:
    """Return the largest ratio of a torque or speed to its limit; 0 without limits."""
    if not (specification.limited or specification.limited_speeds):
        return 0.0
    torque, speed = motor_peaks(dynamics)
    torque_ratio = (torque / specification.torque_limit).max()
    speed_ratio = (speed / specification.speed_limit).max()
    return float(max(torque_ratio, speed_ratio))
