"""Friction of the motors and delay of their torques, between a controller and its robot."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from framework.arrays import Array, IntArray
from framework.control.estimation import Controller
from framework.control.variation import Variation
from framework.kinematics.parallel_robot import ParallelRobot

FRICTION_SMOOTHING = 0.02  # of the largest planned motor speed: below, Coulomb friction is smoothed
MIN_SPEED = 1e-12  # [rad/s] for motors that stand still all the time: 0 / 0 otherwise


@dataclass(frozen=True, eq=False)
class MotorFriction:
    """Coulomb friction on the motors, smoothed at speeds that are small for this plan."""

    size: Array  # (R, n_a) [N m]
    slow: Array  # (n_a,) [rad/s]
    robot: ParallelRobot

    @staticmethod
    def of(controller: Controller, variations: Sequence[Variation]) -> MotorFriction:
        ref = controller.reference
        size = np.array([variation.friction for variation in variations]) * np.abs(ref.torque).max(axis=0)
        slow = FRICTION_SMOOTHING * np.maximum(np.abs(ref.motor_speed).max(axis=0), MIN_SPEED)
        return MotorFriction(size, slow, ref.robot)

    def torque(self, v: Array) -> Array:
        """Return the torque of friction (R, n_a) [N m], motor side."""
        speed = self.robot.gear_ratio * v[:, self.robot.actuated]
        return np.asarray(self.size * np.tanh(speed / self.slow))


@dataclass(frozen=True, eq=False)
class DelayLine:
    """Torques that arrive a whole number of sampling periods late, each run by its own."""

    delays: IntArray  # (R,)
    past: deque[Array]

    @staticmethod
    def of(controller: Controller, variations: Sequence[Variation]) -> DelayLine:
        ref = controller.reference
        periods = np.rint([variation.delay / ref.period for variation in variations])
        delays = np.minimum(periods, len(ref.times)).astype(np.intp)  # longer: never in this motion
        return DelayLine(delays, deque(maxlen=int(delays.max(initial=0)) + 1))

    def delayed(self, torque: Array) -> Array:
        """Return the torques (R, n_a) that act now; the first ones until they have come through."""
        self.past.append(torque)
        if len(self.past) == 1:
            return torque
        late = np.minimum(self.delays, len(self.past) - 1)
        return np.array([self.past[-1 - d][r] for r, d in enumerate(late)])
