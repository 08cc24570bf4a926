"""Planned torques with proportional and derivative feedback at each motor.

The planned torque is finite at the crossing, and the feedback does not invert A: the controller works at a
singularity as elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.arrays import Array
from framework.control.estimation import Measurement
from framework.control.reference import Reference
from framework.dynamics.platform_wrench import motor_speeds
from framework.dynamics.pointwise_dynamics import dynamics_at

MAX_SAMPLED_DAMPING = 0.5  # damping over that which stops a rotor within one sampling period; 2 is unstable


@dataclass(frozen=True, eq=False)
class FeedforwardPD:
    """tau = tau_plan + k_p (motor angle error) + k_d (motor speed error)."""

    reference: Reference
    k_p: Array  # (n_a,) [N m/rad], motor side
    k_d: Array  # (n_a,) [N m s/rad]

    @staticmethod
    def tune(reference: Reference, *, frequency: float = 40.0, damping: float = 1.0) -> FeedforwardPD:
        """Return the controller whose gains give each motor the natural `frequency` [rad/s].

        k_p = w^2 I and k_d = 2 damping w I, with I the inertia that a motor moves alone at the start of the
        motion. With springs a fast motor moves only its rotor: w is lowered to a damping k_d that is stable
        with this sampling period.
        """
        robot, motion = reference.robot, reference.motion
        M_x = dynamics_at(robot, motion.q[0]).platform_inertia
        dx_dmotor = np.linalg.pinv(motor_speeds(robot, motion.linearised.select(0))[0][0])
        inertia = np.diag(dx_dmotor.T @ M_x @ dx_dmotor)  # (n_a,) [kg m^2], motor side
        w = np.full(robot.n_a, frequency)
        if robot.n_e and robot.rotor_inertia.all():
            highest = MAX_SAMPLED_DAMPING * robot.rotor_inertia / (2 * damping * inertia * reference.period)
            w = np.minimum(w, highest)
        return FeedforwardPD(reference, k_p=w**2 * inertia, k_d=2 * damping * w * inertia)

    def torque(self, k: int, measurement: Measurement) -> Array:
        """Compute motor torques (R, n_a) [N m]."""
        ref = self.reference
        return (
            ref.period_torque[k]
            + self.k_p * (ref.motor_angle[k] - measurement.motor_angle)
            + self.k_d * (ref.motor_speed[k] - measurement.motor_speed)
        )
