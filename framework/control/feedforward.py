"""Planned torques, and a spring and a damper on each motor.

The planned torque is finite at the crossing, and the feedback never inverts A: nothing here knows that
there is a singularity, and nothing has to.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.arrays import Array
from framework.control.estimation import Measurement
from framework.control.reference import Reference
from framework.dynamics.platform_wrench import motor_speeds
from framework.dynamics.pointwise_dynamics import dynamics_at

MAX_SAMPLED_DAMPING = 0.5  # of the damping at which a rotor stops within one sampling period; 2 is unstable


@dataclass(frozen=True, eq=False)
class FeedforwardPD:
    """tau = tau_plan + k_p (motor angle error) + k_d (motor speed error)."""

    reference: Reference
    k_p: Array  # (n_a,) [N m/rad], motor side
    k_d: Array  # (n_a,) [N m s/rad]

    @staticmethod
    def tune(reference: Reference, *, frequency: float = 40.0, damping: float = 1.0) -> FeedforwardPD:
        """Return the controller whose gains give each motor the natural `frequency` [rad/s].

        Each motor has it alone, at the start of the motion. With springs a motor feels its rotor first, and
        the frequency is lowered to the damping that a sampled controller may give a rotor.
        """
        robot, motion = reference.robot, reference.motion
        mass = dynamics_at(robot, motion.q[0]).platform_inertia
        from_motors = np.linalg.pinv(motor_speeds(robot, motion.linearised.select(0))[0][0])
        inertia = np.diag(from_motors.T @ mass @ from_motors)  # (n_a,) [kg m^2], what each motor turns
        rate = np.full(robot.n_a, frequency)
        if robot.n_e and robot.rotor_inertia.all():
            highest = MAX_SAMPLED_DAMPING * robot.rotor_inertia / (2 * damping * inertia * reference.period)
            rate = np.minimum(rate, highest)
        return FeedforwardPD(reference, rate**2 * inertia, 2 * damping * rate * inertia)

    def torque(self, k: int, measurement: Measurement) -> Array:
        """Compute motor torques (R, n_a) [N m]."""
        ref = self.reference
        return (
            ref.held[k]
            + self.k_p * (ref.motor_angle[k] - measurement.motor_angle)
            + self.k_d * (ref.motor_speed[k] - measurement.motor_speed)
        )
