"""The plan at the sampling instants of the controller."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.errors import InvalidInput
from framework.kinematics.external_wrenches import ExternalWrenches
from framework.kinematics.motion_rates import Motion, joint_rates
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import MotionLaw
from framework.numerics.arrays import Array, ReadOnlyArrays
from framework.planning.result import CrossingPlan

MAX_SAMPLES = 200_000
PERIOD_ROUNDING = 1e-12  # of the number of periods: rounding must not lose the instant at the end


@dataclass(frozen=True, eq=False)
class Reference(ReadOnlyArrays):
    """The planned motion at the K sampling instants k * `period`."""

    robot: ParallelRobot  # the controller's model
    period: float  # [s]
    times: Array  # (K,) [s]
    motion: Motion  # q (K, nq), v, a (K, nv)
    x: Array  # (K, n) [m, rad]
    dx: Array  # (K, n)
    ddx: Array  # (K, n)
    torque: Array  # (K, n_a) [N m], motor side
    period_torque: Array  # (K, n_a) in the middle of the period after each instant, to be constant over it
    motor_angle: Array  # (K, n_a) [rad], motor side
    motor_speed: Array  # (K, n_a)
    N: Array  # (K, nv, n) dq/dx at constant deflections of the springs
    law: MotionLaw
    wrenches: ExternalWrenches  # external wrenches, as planned

    @property
    def planned_wrenches(self) -> dict[str, Array]:
        """External wrenches (K, 6) along the planned motion, on base axes, by frame."""
        frames = self.motion.linearised.frames
        return self.wrenches.evaluate_on_base_axes(self.robot, frames, np.asarray(self.law(self.times)))


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
    robot, dynamics = plan.robot, plan.dynamics
    count = int(np.floor(plan.duration / period * (1 + PERIOD_ROUNDING))) + 1
    times = np.minimum(period * np.arange(count), plan.duration)
    middles = np.minimum(times + period / 2, plan.duration)
    motion = dynamics.motion(times)
    x = plan.platform(times)
    return Reference(
        robot=robot,
        period=period,
        times=times,
        motion=motion,
        x=x,
        dx=plan.platform(times, 1),
        ddx=plan.platform(times, 2),
        torque=dynamics.torque_without_friction(times),
        period_torque=dynamics.torque_without_friction(middles),
        motor_angle=plan.motor_angle(times),
        motor_speed=plan.motor_angle(times, 1),
        N=joint_rates_by_platform(robot, motion, x),
        law=plan.law,
        wrenches=dynamics.wrenches,
    )


def joint_rates_by_platform(robot: ParallelRobot, motion: Motion, x: Array) -> Array:
    """Compute N = dq/dx (T, nv, n) at x (T, n) along a motion, at constant deflections."""
    twists = np.moveaxis(robot.platform.rate_matrix(x), 2, 0)  # (n, T, n) one twist for each unit rate of x
    no_deflection_rates = np.zeros((len(x), robot.n_e))
    rates = joint_rates(robot, motion.linearised, twists, no_deflection_rates)  # (n, T, nv)
    return np.moveaxis(rates, 0, 2)
