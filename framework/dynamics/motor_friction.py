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

from framework.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.kinematics.parallel_robot import ParallelRobot
from framework.tolerances import AT_REST

FRICTIONS = ("driven", "none")
SPEED_SAMPLES = 1001  # instants for the speed's sign; two reversals between samples are not seen


def motor_friction(robot: ParallelRobot, friction: str) -> Array:
    """Return the dry friction (n_a,) [N m or N], motor side, of plans with friction "driven" or "none"."""
    if friction == "none":
        return np.zeros(robot.n_a)
    return robot.joint_friction[robot.actuated] / np.abs(robot.gear_ratio)


def signs(speeds: Array) -> Array:
    """Return the signs (T, n_a) of motor speeds (T, n_a), zero at a standstill."""
    size = np.abs(speeds)
    return np.where(size > AT_REST * size.max(initial=0.0), np.sign(speeds), 0.0)


@dataclass(frozen=True, eq=False)
class PlannedFriction(ReadOnlyArrays):
    """The torque of dry friction as a function of time.

    instants: for each motor the ascending instants (k,) between which its sign is constant: both ends of the
        motion, and where it reverses, stops or starts [s].
    between: for each motor the torque (k - 1,) between them, motor side [N m or N].
    """

    instants: tuple[Array, ...]
    between: tuple[Array, ...]

    @staticmethod
    def from_speed(size: Array, speed: Callable[[Array], Array], duration: float) -> PlannedFriction | None:
        """Return friction of a size (n_a,) for motor speeds (T, n_a) at t (T,); None for zero."""
        if not size.any():
            return None
        t = np.linspace(0.0, duration, SPEED_SAMPLES)
        sampled = signs(speed(t))
        instants, between = [], []
        for k, friction in enumerate(size):
            edges, constant = _intervals(t, sampled[:, k], speed, k)
            instants.append(edges)
            between.append(friction * constant)
        return PlannedFriction(tuple(instants), tuple(between))

    def __call__(self, t: ArrayLike) -> Array:
        """Return the torque (T, n_a) at t (T,), (n_a,) at a scalar; 0 at the instants themselves."""
        times = np.asarray(t, dtype=float)
        values = []
        for instants, between in zip(self.instants, self.between, strict=True):
            after = np.clip(np.searchsorted(instants, times, side="right") - 1, 0, len(between) - 1)
            outside = (times <= instants[0]) | (times >= instants[-1])
            values.append(np.where(outside | np.isin(times, instants), 0.0, between[after]))
        return np.stack(values, axis=-1)


def _intervals(t: Array, sign: Array, speed: Callable[[Array], Array], motor: int) -> tuple[Array, Array]:
    """Return instants (k,) and the constant sign (k - 1,) of each interval, from samples of the sign.

    A motion starts and stops so gently that its first and last samples may have no sign; they take that of
    their neighbours. So does a single sample, a zero of the speed; several are a standstill.
    """
    from scipy.optimize import brentq  # takes time to import, and most robots have no dry friction

    def motor_speed(instant: float) -> float:
        return float(speed(np.array([instant]))[0, motor])

    moving = np.flatnonzero(sign)
    if not len(moving):
        return t[[0, -1]], np.zeros(1)
    instants, between = [t[0]], [sign[moving[0]]]
    for i, j in pairwise(moving):
        if j - i > 2:
            instants += [t[i + 1], t[j - 1]]
            between += [0.0, sign[j]]
        elif sign[i] != sign[j]:
            instants.append(brentq(motor_speed, t[i], t[j], xtol=1e-15 * t[-1]))
            between.append(sign[j])
    return np.array([*instants, t[-1]]), np.array(between)
