"""Dry friction of driven joints along a planned motion, with the sign of the planned speed.

Dry friction f of its joint adds f sign(dq_a/dt) / gear ratio to the torque of a motor. Along a path that
advances the sign is that of dq_a/ds. It jumps where a motor reverses, so this share is no Chebyshev series
and is added to the series of the rest. At a standstill it is zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.tolerances import AT_REST

FRICTIONS = ("driven", "none")
SPEED_SAMPLES = 1001  # instants for the speed's sign; two reversals between samples are not seen


def motor_friction(robot: ParallelRobot, friction: str) -> Array:
    """Return the dry friction (n_a,) [N m or N], motor side, of plans with friction "driven" or "none"."""
    if friction == "none":
        return np.zeros(robot.n_a)
    return robot.joint_friction[robot.actuated] / np.abs(robot.gear_ratio)


def speed_signs(speeds: Array) -> Array:
    """Return the signs (T, n_a) of motor speeds (T, n_a), zero at a standstill."""
    size = np.abs(speeds)
    return np.where(size > AT_REST * size.max(initial=0.0), np.sign(speeds), 0.0)


@dataclass(frozen=True, eq=False)
class PlannedFriction(ReadOnlyArrays):
    """The torque of dry friction as a function of time, constant on intervals.

    instants: for each motor the ascending ends (k,) [s] of its intervals: both ends of the motion, and where
        the motor reverses, stops or starts.
    between: for each motor the torque (k - 1,) on its intervals, motor side [N m or N].
    """

    instants: tuple[Array, ...]
    between: tuple[Array, ...]

    @staticmethod
    def from_speed(size: Array, speed: Callable[[Array], Array], duration: float) -> PlannedFriction | None:
        """Return friction of `size` (n_a,) along motor speeds (T, n_a) at t (T,); None without friction."""
        if not size.any():
            return None
        t = np.linspace(0.0, duration, SPEED_SAMPLES)
        sampled_signs = speed_signs(speed(t))
        instants, between = [], []
        for k, friction in enumerate(size):
            ends, interval_signs = _constant_sign_intervals(t, sampled_signs[:, k], speed, k)
            instants.append(ends)
            between.append(friction * interval_signs)
        return PlannedFriction(tuple(instants), tuple(between))

    def __call__(self, t: ArrayLike) -> Array:
        """Return the torque (T, n_a) [N m] at t (T,), (n_a,) at a scalar; 0 at a change of sign."""
        times = np.asarray(t, dtype=float)
        values = []
        for instants, between in zip(self.instants, self.between, strict=True):
            interval = np.clip(np.searchsorted(instants, times, side="right") - 1, 0, len(between) - 1)
            outside = (times <= instants[0]) | (times >= instants[-1])
            values.append(np.where(outside | np.isin(times, instants), 0.0, between[interval]))
        return np.stack(values, axis=-1)


def _constant_sign_intervals(
    t: Array, sign: Array, speed: Callable[[Array], Array], motor: int
) -> tuple[Array, Array]:
    """Return the ends (k,) [s] of intervals of constant sign, and the signs (k - 1,), from samples at t.

    The first and last samples, where the motion starts and stops smoothly, may be zero: they belong to their
    neighbours' interval. So does a single zero sample; two and more are a standstill of sign 0.
    """
    from scipy.optimize import brentq  # takes time to import, and most robots have no dry friction

    def motor_speed(instant: float) -> float:
        return float(speed(np.array([instant]))[0, motor])

    moving = np.flatnonzero(sign)
    if not len(moving):
        return t[[0, -1]], np.zeros(1)
    ends, signs = [t[0]], [sign[moving[0]]]
    for i, j in pairwise(moving):
        if j - i > 2:  # a standstill between samples i and j
            ends += [t[i + 1], t[j - 1]]
            signs += [0.0, sign[j]]
        elif sign[i] != sign[j]:
            ends.append(brentq(motor_speed, t[i], t[j], xtol=1e-15 * t[-1]))
            signs.append(sign[j])
    return np.array([*ends, t[-1]]), np.array(signs)
