"""Torque-speed curves and RMS torque limits of motors, and the shares of them that a motion uses.

Up to its corner speed w_c a motor has its largest torque T_0. From there the torque falls linearly to zero at
the no-load speed w_0, as under a limit of voltage. A motor that brakes keeps T_0, up to speeds beyond w_0 on
the same line. With k = (w_0 - w_c) / T_0 these are two bounds, linear in torque T and speed w:

    |T| <= T_0,        |w + k T| <= w_0.

The second is not reached by a braking motor below w_0, since k T_0 <= w_0. The largest ratio of a side to its
bound is 1 on the curve; limits that are all multiplied by a share divide it by that share.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from framework.dynamics.motor_limits import Limit, motor_limits
from framework.dynamics.result import InverseDynamics
from framework.errors import InvalidInput
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, BoolArray
from framework.numerics.chebyshev import gauss_legendre, peak_sizes


class DriveLimits(NamedTuple):
    """Torque-speed curves and RMS torque limits of motors, motor side, (n_a,) each.

    torque_limit: T_0 [N m, N].
    corner_speed: w_c [rad/s, m/s]; infinite without a curve.
    no_load_speed: w_0 [rad/s, m/s]; infinite without a curve.
    rms_torque_limit: [N m, N]; infinite without a limit.
    cycle_time: [s] over which squared torques are averaged; None for the duration of the motion.
    """

    torque_limit: Array
    corner_speed: Array
    no_load_speed: Array
    rms_torque_limit: Array
    cycle_time: float | None

    def scale(self, share: float) -> DriveLimits:
        """Return the limits multiplied by a share."""
        return DriveLimits(
            share * self.torque_limit,
            share * self.corner_speed,
            share * self.no_load_speed,
            share * self.rms_torque_limit,
            self.cycle_time,
        )

    @property
    def has_curve(self) -> BoolArray:
        """The mask (n_a,) of motors with a torque-speed curve."""
        return np.isfinite(self.no_load_speed)

    @property
    def per_speed(self) -> Array:
        """The factor (n_a,) of the speed in (w + k T) / w_0: 1 / w_0; 0 without a curve."""
        return 1.0 / self.no_load_speed

    @property
    def per_torque(self) -> Array:
        """The factor (n_a,) of the torque in (w + k T) / w_0: k / w_0; 0 without a curve."""
        factor = np.zeros(len(self.no_load_speed))
        corner = self.corner_speed[self.has_curve] / self.no_load_speed[self.has_curve]
        factor[self.has_curve] = (1.0 - corner) / self.torque_limit[self.has_curve]
        return factor

    def largest_torque(self, speed: Array) -> Array:
        """Return the largest torque (..., n_a) [N m] that drives motors at speeds (..., n_a) [rad/s]."""
        with np.errstate(divide="ignore", invalid="ignore"):
            on_line = (1.0 - np.abs(speed) * self.per_speed) / self.per_torque
        on_line = np.where(self.has_curve, np.maximum(on_line, 0.0), np.inf)
        return np.minimum(self.torque_limit, on_line)

    def curve_ratio(self, torque: Array, speed: Array) -> Array:
        """Compute (w + k T) / w_0 (..., n_a) of torques [N m] and speeds [rad/s]; 0 without a curve."""
        return self.per_torque * torque + self.per_speed * speed


def drive_limits(
    robot: ParallelRobot,
    torque_limit: Array,
    corner_speed: Limit = None,
    no_load_speed: Limit = None,
    rms_torque_limit: Limit = None,
    cycle_time: float | None = None,
) -> DriveLimits | None:
    """Return the curves and RMS limits of motors; None without any.

    Limits that are not stated are those of the robot file. A curve ends at the torque limit, so that it does
    not count for a motor whose torque limit is lifted.

    Args:
        torque_limit: (n_a,) [N m], infinite for motors without one.

    Raises:
        InvalidInput: a limit is not valid, or a curve lacks one of its numbers.
    """
    stated = {"corner_speed": corner_speed, "no_load_speed": no_load_speed}
    is_stated = not (corner_speed is None and no_load_speed is None and rms_torque_limit is None)
    if not is_stated and not _has_drives(robot):
        return None
    corner, no_load = (motor_limits(robot, name, limit) for name, limit in stated.items())
    rms = motor_limits(robot, "rms_torque_limit", rms_torque_limit)
    has_corner, curved = np.isfinite(corner), np.isfinite(no_load)
    names = np.array(robot.actuator_names)
    for missing, lacks_it in (
        ("no_load_speed", has_corner & ~curved),
        ("corner_speed", curved & ~has_corner),
    ):
        if lacks_it.any():
            joint = names[lacks_it][0]
            raise InvalidInput(f"{missing}: needed for the torque-speed curve of {joint}, which has none")
    if (curved & (corner >= no_load)).any():
        k = np.flatnonzero(curved & (corner >= no_load))[0]
        raise InvalidInput(
            f"corner_speed: {names[k]} needs less than its no_load_speed {no_load[k]:g}, got {corner[k]:g}"
        )
    # without a torque limit there is no curve: an error if one is asked for, no curve if the limit was lifted
    is_lifted = np.isinf(torque_limit)
    if (curved & is_lifted).any() and any(limit is not None for limit in stated.values()):
        raise InvalidInput(
            f"torque_limit: needed for the torque-speed curve of {names[curved & is_lifted][0]}, has none"
        )
    no_load = np.where(is_lifted, np.inf, no_load)
    corner = np.where(is_lifted, np.inf, corner)
    if np.isinf(no_load).all() and np.isinf(rms).all():
        return None
    return DriveLimits(torque_limit, corner, no_load, rms, cycle_time)


@lru_cache(maxsize=16)
def _has_drives(robot: ParallelRobot) -> bool:
    """Return whether the robot file states a curve or an RMS limit."""
    return any(
        motor.no_load_speed is not None or motor.rms_torque_limit is not None
        for motor in robot.description.actuators
    )


def curve_ratios(dynamics: InverseDynamics, drives: DriveLimits) -> Array:
    """Compute the largest |w + k T| / w_0 (n_a,) of a motion; 0 for motors without a curve."""
    return peak_sizes(
        lambda t: drives.curve_ratio(dynamics.torque(t), dynamics.motor_angle(t, 1)), dynamics.torques.grid
    )


def rms_torques(dynamics: InverseDynamics, cycle_time: float | None = None) -> Array:
    """Compute the RMS torques (n_a,) [N m, N] of a motion or a cycle.

    Each panel has as many Gauss points as the torques have coefficients, so that their squares are integrated
    exactly.

    Args:
        cycle_time: [s], in the rest of which there is no torque; None for the duration of the motion.
    """
    edges = dynamics.torques.edges
    nodes, weights = gauss_legendre(dynamics.torques.coefficients.shape[1])
    half_widths = 0.5 * np.diff(edges)[:, None]
    t = (0.5 * (edges[:-1] + edges[1:])[:, None] + half_widths * nodes).ravel()
    squares = (half_widths * weights).ravel() @ dynamics.torque(t) ** 2
    return np.asarray(np.sqrt(squares / (cycle_time or edges[-1] - edges[0])))
