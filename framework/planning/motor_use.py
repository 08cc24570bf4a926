"""The shares of its limits that each motor uses along a motion."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from framework.dynamics.drive_limits import DriveLimits, curve_ratios, rms_torques
from framework.dynamics.result import InverseDynamics
from framework.errors import format_distinct, round_up
from framework.numerics.arrays import Array
from framework.planning.refusals import PRINTED_DIGITS, RAISED_RATIO
from framework.planning.request import PEAK_SAMPLES, Specification, motor_peaks


class MotorUse(NamedTuple):
    """The largest ratio of a motor to one of its limits.

    joint: name of the motor's joint.
    limit: "torque", "speed", "torque-speed curve" or "RMS torque".
    size: torque, speed or RMS torque with its unit; for a curve the torque, "at" the speed.
    allowed: largest value of the same, with its unit.
    time, s: instant [s] of the largest ratio, and the path coordinate; None for an RMS torque.
    """

    joint: str
    limit: str
    ratio: float
    size: str
    allowed: str
    time: float | None
    s: float | None

    @property
    def sentence(self) -> str:
        """The use in words."""
        if self.time is None:
            return f"{self.joint} needs an RMS torque of {self.size}, and may {self.allowed}"
        return (
            f"{self.joint} needs {self.size} at t = {self.time:.4g} s, s = {self.s:.4g}, where its "
            f"{self.limit} allows {self.allowed}"
        )


def motor_uses(dynamics: InverseDynamics, specification: Specification) -> Iterator[MotorUse]:
    """Yield the use of each limit of each motor, motor by motor."""
    robot, drives = dynamics.robot, specification.drives
    times = np.linspace(0.0, dynamics.duration, PEAK_SAMPLES)
    torque, speed = dynamics.torque(times), dynamics.motor_angle(times, 1)
    s = dynamics.law(times)
    peak_torques, peak_speeds = motor_peaks(dynamics)
    if drives is not None:
        on_curves = np.abs(drives.curve_ratio(torque, speed))
        most_on_curves = curve_ratios(dynamics, drives)
        averages = rms_torques(dynamics, drives.cycle_time)
    for k, joint in enumerate(robot.actuator_names):
        torque_unit, speed_unit = robot.torque_units[k], robot.speed_units[k]
        for limit, peak, largest, values, unit in (
            ("torque", peak_torques[k], specification.torque_limit[k], torque[:, k], torque_unit),
            ("speed", peak_speeds[k], specification.speed_limit[k], speed[:, k], speed_unit),
        ):
            if np.isfinite(largest):
                i = int(np.abs(values).argmax())
                size, allowed = (f"{text} {unit}" for text in format_distinct(peak, largest))
                yield MotorUse(joint, limit, peak / largest, size, allowed, times[i], float(s[i]))
        if drives is None:
            continue
        if drives.curved[k]:
            i = int(on_curves[:, k].argmax())
            allowed_torque = drives.largest_torque(np.abs(speed[i]))[k]
            size, allowed = format_distinct(abs(torque[i, k]), allowed_torque)
            place = f"{size} {torque_unit} at {abs(speed[i, k]):.4g} {speed_unit}"
            yield MotorUse(
                joint,
                "torque-speed curve",
                float(most_on_curves[k]),
                place,
                f"{allowed} {torque_unit}",
                times[i],
                float(s[i]),
            )
        if np.isfinite(drives.rms_torque_limit[k]):
            size, allowed = format_distinct(averages[k], drives.rms_torque_limit[k])
            yield MotorUse(
                joint,
                "RMS torque",
                float(averages[k] / drives.rms_torque_limit[k]),
                f"{size} {torque_unit}",
                f"{allowed} {torque_unit}",
                None,
                None,
            )


def find_largest_use(dynamics: InverseDynamics, specification: Specification) -> MotorUse | None:
    """Return the use of largest ratio; None without limits."""
    return max(motor_uses(dynamics, specification), key=lambda use: use.ratio, default=None)


def raise_drives(dynamics: InverseDynamics, drives: DriveLimits, share: float) -> dict[str, Array]:
    """Return curves and RMS torque limits, by option, raised until a motion within the torque limits fits.

    A curve (w + k T) / w_0 <= 1 with k = (w_0 - w_c) / T_0 holds w and T if w_0 and w_c are multiplied by
    w / (w_0 - k T).

    Args:
        dynamics: the motion.
        drives: the limits that it exceeds.
        share: of the limits of a request that its margin leaves.
    """
    times = np.linspace(0.0, dynamics.duration, PEAK_SAMPLES)
    torque, speed = dynamics.torque(times), dynamics.motor_angle(times, 1)
    room = 1.0 - drives.per_torque * torque * np.sign(speed)  # over w_0
    factor = np.max(np.abs(speed) * drives.per_speed / np.maximum(room, 1e-3), axis=0, initial=1.0)
    rms = np.maximum(rms_torques(dynamics, drives.cycle_time) / drives.rms_torque_limit, 1.0)
    raised = {
        "corner_speed": (factor, drives.corner_speed),
        "no_load_speed": (factor, drives.no_load_speed),
        "rms_torque_limit": (rms, drives.rms_torque_limit),
    }
    return {
        name: np.array(
            [
                round_up(each, PRINTED_DIGITS)
                for each in np.where(ratio > 1.0, RAISED_RATIO * ratio, 1.0) * limit / share
            ]
        )
        for name, (ratio, limit) in raised.items()
        if ratio.max() > 1.0
    }
