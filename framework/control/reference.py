"""The planned motion at the sampling instants of a controller, a `Reference`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from framework.dynamics.motor_limits import motor_limits
from framework.errors import InvalidInput
from framework.kinematics.external_wrenches import ExternalWrenches
from framework.kinematics.motion_rates import Motion, joint_rates
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import MotionLaw
from framework.numerics.arrays import Array, ReadOnlyArrays
from framework.planning.request import specification_of
from framework.planning.result import CrossingPlan
from framework.tolerances import SAME_PLACE

MAX_SAMPLES = 200_000  # of a planned motion
FRICTION_SMOOTHING = 0.02  # share of the largest planned motor speed below which friction is smoothed
MIN_SPEED = 1e-12  # [rad/s] in place of 0 for motors that never move, against 0 / 0


@dataclass(frozen=True, eq=False)
class Reference(ReadOnlyArrays):
    """The planned motion at the K sampling instants k * `period`."""

    robot: ParallelRobot  # the controller's model
    period: float  # [s]
    times: Array  # (K,) [s]
    motion: Motion  # q (K, nq), v, a (K, nv)
    x: Array  # (K, n) platform coordinates [m, rad]
    dx: Array  # (K, n) their rates
    ddx: Array  # (K, n) their accelerations
    torque: Array  # (K, n_a) [N m; N of motors of slides], motor side, without dry friction
    torque_limit: Array  # (n_a,) limits that the plan was made for, motor side; infinite without
    driving_limit: Array  # (K, n_a) of torques along the planned speeds, by torque-speed curves
    period_torque: Array  # (K, n_a) torque half a period after each instant, to be constant over the period
    motor_angle: Array  # (K, n_a) [rad, m], motor side
    motor_speed: Array  # (K, n_a) [rad/s, m/s], motor side
    N: Array  # (K, nv, n) dq/dx at constant deflections of the springs
    law: MotionLaw  # path coordinate over time
    wrenches: ExternalWrenches  # external wrenches, as planned

    @cached_property
    def peak_torque(self) -> Array:
        """Largest planned torque of each motor (n_a,) [N m, N], motor side."""
        return np.abs(self.torque).max(axis=0)

    @cached_property
    def friction_speed(self) -> Array:
        """Motor speed (n_a,) [rad/s, m/s] below which dry friction is smoothed, as tanh(speed / this)."""
        return FRICTION_SMOOTHING * np.maximum(np.abs(self.motor_speed).max(axis=0), MIN_SPEED)

    @cached_property
    def motor_maps(self) -> Array:
        """Motor angles per robot length or radian of the platform, (K, n_a, n), motor side."""
        robot = self.robot
        return robot.gear_ratio[:, None] * self.N[:, robot.actuated] * robot.platform_scale

    @cached_property
    def motor_thresholds(self) -> Array:
        """Singular values (n,) below which the motors do not determine the platform."""
        return fading_thresholds(self.motor_maps)


def reference_of(plan: CrossingPlan, *, period: float) -> Reference:
    """Sample the plan every `period` seconds.

    Raises:
        InvalidInput: the period is not positive, longer than a tenth of the motion, or so short that
            there would be more than 200000 samples.
    """
    shortest = plan.duration / MAX_SAMPLES
    longest = plan.duration / 10
    if not (np.isfinite(period) and shortest < period <= longest):
        raise InvalidInput(
            f"period: must lie in ({shortest:g}, {longest:g}] s for a motion of {plan.duration:g} s, "
            f"got {period!r}"
        )

    robot = plan.robot
    dynamics = plan.dynamics
    # rounding must not lose the instant at the end
    count = int(np.floor(plan.duration / period * (1 + SAME_PLACE))) + 1
    times = np.minimum(period * np.arange(count), plan.duration)
    middles = np.minimum(times + period / 2, plan.duration)  # of the sampling periods
    motion = dynamics.motion(times)
    x = plan.platform(times)  # (K, n)
    speed = plan.motor_angle(times, order=1)
    twists = np.moveaxis(robot.platform.rate_matrix(x), 2, 0)  # (n, K, n) one twist for each unit rate of x
    rates = joint_rates(robot, motion.linearised, twists, np.zeros((len(x), robot.n_e)))  # (n, K, nv)
    torque_limit = motor_limits(robot, "torque_limit", plan.request.torque_limit)
    drives = specification_of(robot, replace(plan.request, margin=0.0)).drives
    return Reference(
        robot=robot,
        period=period,
        times=times,
        motion=motion,
        x=x,
        dx=plan.platform(times, order=1),
        ddx=plan.platform(times, order=2),
        torque=dynamics.torques(times),
        torque_limit=torque_limit,
        driving_limit=torque_limit + np.zeros_like(speed) if drives is None else drives.largest_torque(speed),
        period_torque=dynamics.torques(middles),
        motor_angle=plan.motor_angle(times),
        motor_speed=speed,
        N=np.moveaxis(rates, 0, 2),
        law=plan.law,
        wrenches=dynamics.wrenches,
    )


def fading_thresholds(matrices: Array) -> Array:
    """Return a share of the largest singular values (k,) along a plan, for `solve_damped`.

    A singular value is small beside a Type 2 singularity, where it is small against its own values elsewhere
    on the plan. It may be small against the other singular values in every pose: a light leg, a short lever.

    Args:
        matrices: (K, m, k) along the plan, m >= k.
    """
    fading_ratio = 0.25
    return fading_ratio * np.linalg.svd(matrices, compute_uv=False).max(axis=0)
