"""The shares of its limits that each motor uses along a motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.dynamics.drive_limits import DriveLimits, curve_ratios, rms_torques
from framework.dynamics.result import InverseDynamics
from framework.errors import format_distinct, round_up
from framework.numerics.arrays import Array
from framework.planning.refusals import PRINTED_DIGITS, RAISED_RATIO
from framework.planning.request import PEAK_SAMPLES, Specification, motor_peaks

CURVE = "torque-speed curve"  # the limit of a `MotorUse`
LEAST_SPEED_SHARE = 1e-3  # of the no-load speed, that advised curves leave at the torques of a motion


class MotorUse(NamedTuple):
    """The largest ratio of a motor to one of its limits.

    joint: name of the motor's joint.
    limit: "torque", "speed", "torque-speed curve" or "RMS torque".
    size, allowed: torque, speed or RMS torque, and the largest that is allowed, in `unit`; for a curve the
        torque at `speed`, which else is empty.
    time, s: instant [s] of the largest ratio, and the path coordinate; None for an RMS torque.
    """

    joint: str
    limit: str
    ratio: float
    size: float
    allowed: float
    unit: str
    speed: str = ""
    time: float | None = None
    s: float | None = None

    @property
    def size_text(self) -> str:
        """The size with its unit, and of a curve its speed."""
        size, _ = format_distinct(self.size, self.allowed)
        return f"{size} {self.unit}{self.speed and f' at {self.speed}'}"

    @property
    def sentence(self) -> str:
        """The use in words."""
        _, allowed = format_distinct(self.size, self.allowed)
        if self.time is None:
            return f"{self.joint} needs an {self.limit} of {self.size_text}, and may {allowed} {self.unit}"
        return (
            f"{self.joint} needs {self.size_text} at t = {self.time:.4g} s, s = {self.s:.4g}, where its "
            f"{self.limit} allows {allowed} {self.unit}"
        )


def motor_uses(dynamics: InverseDynamics, specification: Specification) -> list[MotorUse]:
    """Measure how far each motor uses each of its limits, limit by limit."""
    robot, drives = dynamics.robot, specification.drives
    names, units = robot.actuator_names, robot.torque_units
    times = np.linspace(0.0, dynamics.duration, PEAK_SAMPLES)
    torque, speed = dynamics.torque(times), dynamics.motor_angle(times, 1)  # (T, n_a)
    s = dynamics.law(times)
    uses = list[MotorUse]()
    peak_torques, peak_speeds = motor_peaks(dynamics)
    for limit, values, peaks, limits, of_limit in (
        ("torque", torque, peak_torques, specification.torque_limit, units),
        ("speed", speed, peak_speeds, specification.speed_limit, robot.speed_units),
    ):
        for k in np.flatnonzero(np.isfinite(limits)).tolist():
            peak, largest, i = float(peaks[k]), float(limits[k]), int(np.abs(values[:, k]).argmax())
            instant = float(times[i]), float(s[i])
            uses.append(MotorUse(names[k], limit, peak / largest, peak, largest, of_limit[k], "", *instant))
    if drives is None:
        return uses

    on_curves = np.abs(drives.curve_ratio(torque, speed))  # (T, n_a)
    ratios = curve_ratios(dynamics, drives)
    allowed = drives.largest_torque(speed)
    for k in np.flatnonzero(drives.has_curve).tolist():
        i = int(on_curves[:, k].argmax())
        size, largest = abs(float(torque[i, k])), float(allowed[i, k])
        speed_text = f"{abs(speed[i, k]):.4g} {robot.speed_units[k]}"
        instant = float(times[i]), float(s[i])
        uses.append(
            MotorUse(names[k], CURVE, float(ratios[k]), size, largest, units[k], speed_text, *instant)
        )
    averages = rms_torques(dynamics, drives.cycle_time)
    for k in np.flatnonzero(np.isfinite(drives.rms_torque_limit)).tolist():
        size, largest = float(averages[k]), float(drives.rms_torque_limit[k])
        uses.append(MotorUse(names[k], "RMS torque", size / largest, size, largest, units[k]))
    return uses


def find_largest_use(dynamics: InverseDynamics, specification: Specification) -> MotorUse | None:
    """Return the use of largest ratio; None without limits."""
    return max(motor_uses(dynamics, specification), key=lambda use: use.ratio, default=None)


def raise_drives(dynamics: InverseDynamics, drives: DriveLimits, share: float) -> dict[str, Array]:
    """Return curves and RMS torque limits by option, raised to hold a motion.

    A curve (w + k T) / w_0 <= 1 with k = (w_0 - w_c) / T_0 holds w and T if w_0 and w_c are multiplied by
    w / (w_0 - k T).

    Args:
        dynamics: the motion, within the torque limits.
        drives: the limits that it exceeds.
        share: of the limits of a request that its margin leaves.
    """
    times = np.linspace(0.0, dynamics.duration, PEAK_SAMPLES)
    torque, speed = dynamics.torque(times), dynamics.motor_angle(times, 1)
    room = 1.0 - drives.per_torque * torque * np.sign(speed)  # over w_0
    factor = np.max(
        np.abs(speed) * drives.per_speed / np.maximum(room, LEAST_SPEED_SHARE), axis=0, initial=1.0
    )
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
