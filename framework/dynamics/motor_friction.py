"""Dry friction of driven joints along a planned motion, with the sign of the planned speed.

Dry friction f of a motor's joint adds f sign(dq_a/dt) / gear ratio to the motor's torque. If the law
advances, the sign is that of dq_a/ds. Friction jumps where a motor reverses, so it is added to the Chebyshev
series of the torques instead of being part of them. At a standstill it is zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from framework.errors import real_numbers
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.tolerances import AT_REST

FRICTIONS = ("driven", "none")  # the first one is the default


def motor_friction(robot: ParallelRobot, friction: str) -> Array:
    """Return the dry friction (n_a,) [N m or N] of the motors, motor side.

    Args:
        friction: one of FRICTIONS: "driven" joints have friction, or "none".
    """
    if friction == "none":
        return np.zeros(robot.n_a)
    return robot.joint_friction[robot.actuated] / np.abs(robot.gear_ratio)


def speed_signs(speeds: Array) -> Array:
    """Return the signs (T, n_a) of motor speeds (T, n_a), zero at a standstill.

    A motor stands still below AT_REST times the largest speed of all motors and instants.
    """
    size = np.abs(speeds)
    return np.where(size > AT_REST * size.max(initial=0.0), np.sign(speeds), 0.0)


@dataclass(frozen=True, eq=False)
class PlannedFriction(ReadOnlyArrays):
    """The torque of dry friction as a function of time, piecewise constant.

    instants: for each motor the ascending ends (k,) [s] of the intervals of constant friction. They are both
        ends of the motion, and the instants at which the motor reverses, stops or starts.
    between: for each motor the torque (k - 1,) on these intervals, motor side [N m or N].
    """

    instants: tuple[Array, ...]
    between: tuple[Array, ...]

    @staticmethod
    def from_speed(
        size: Array,
        speed: Callable[[Array], Array],
        duration: float,
        *,
        # instants at which signs are sampled; two reversals between samples stay unseen
        speed_samples: int = 1001,
    ) -> PlannedFriction | None:
        """Return the friction along a motion; None if all sizes are zero.

        Args:
            size: dry friction (n_a,) of the motors, motor side [N m or N].
            speed: speeds (T, n_a) of the motors as a function of time (T,) [s].
            duration: duration of the motion [s].
        """
        if not size.any():
            return None
        t = np.linspace(0.0, duration, speed_samples)
        sampled_signs = speed_signs(speed(t))
        intervals = [_constant_sign_intervals(t, signs, speed, k) for k, signs in enumerate(sampled_signs.T)]
        instants, interval_signs = zip(*intervals, strict=True)
        return PlannedFriction(instants, tuple(map(np.multiply, interval_signs, size)))

    def __call__(self, t: ArrayLike) -> Array:
        """Evaluate the torque (T, n_a) [N m] at t (T,), or (n_a,) at a scalar.

        It is zero at the ends of intervals, and outside the motion.
        """
        times = real_numbers("t", t)
        torques = []  # of each motor
        for instants, between in zip(self.instants, self.between, strict=True):
            with_outside = np.pad(between, 1)  # zero before and after the motion
            torque = with_outside[np.searchsorted(instants, times, side="right")]  # 0: before the motion
            torques.append(np.where(np.isin(times, instants), 0.0, torque))
        return np.stack(torques, axis=-1)


def _constant_sign_intervals(
    t: Array, sign: Array, speed: Callable[[Array], Array], motor: int
) -> tuple[Array, Array]:
    """Return the ends (k,) [s] of intervals of constant sign of a motor's speed, and their signs (k - 1,).

    A motion that starts and stops smoothly has first and last samples that may be zero; they belong to the
    adjacent interval. So does a single zero sample. Two or more are a standstill, an interval of sign 0.

    Args:
        t: instants (T,) [s] of the samples.
        sign: sampled signs (T,) of the motor's speed.
        speed: speeds (T, n_a) of all motors as a function of time.
        motor: index of the motor.
    """
    from scipy.optimize import brentq  # slow to import, and most robots have no dry friction

    def motor_speed(instant: float) -> float:
        """Evaluate the speed of the motor at an instant [s]."""
        return float(speed(np.array([instant]))[0, motor])

    moving = np.flatnonzero(sign)
    if not len(moving):
        return t[[0, -1]], np.zeros(1)
    # friction acts at an end in motion, too: its interval goes on beyond
    ends = [-np.inf if sign[0] else t[0]]
    signs = [sign[moving[0]]]
    for i, j in pairwise(moving):  # successive samples at which the motor moves
        if j - i > 2:  # a standstill between samples i and j
            ends += [t[i + 1], t[j - 1]]
            signs += [0.0, sign[j]]
        elif sign[i] != sign[j]:
            ends.append(brentq(motor_speed, t[i], t[j], xtol=1e-15 * t[-1]))
            signs.append(sign[j])
    return np.array([*ends, np.inf if sign[-1] else t[-1]]), np.array(signs)
