"""The shares of its limits that each motor uses along a motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.dynamics.drive_limits import DriveLimits, curve_ratios, rms_torques
from framework.dynamics.result import InverseDynamics
from framework.errors import format_distinct, round_up
from framework.kinematics.parallel_robot import ParallelRobot
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
    """Measure the largest ratio of each motor to each of its limits, limit by limit.

    The ratios are those of peaks, which may lie between samples; the instants are those of samples.
    """
    robot, drives = dynamics.robot, specification.drives
    times = np.linspace(0.0, dynamics.duration, PEAK_SAMPLES)  # (T,) [s]
    instants = np.stack([times, dynamics.law(times)])  # (2, T) times [s] and path coordinates
    torque, speed = dynamics.torque(times), dynamics.motor_angle(times, 1)  # (T, n_a), motor side
    peak_torque, peak_speed = motor_peaks(dynamics)  # (n_a,) each
    at_torque, at_speed = (instants[:, np.abs(values).argmax(axis=0)] for values in (torque, speed))
    uses = [
        *_list_uses(robot, "torque", peak_torque, specification.torque_limit, at_torque),
        *_list_uses(robot, "speed", peak_speed, specification.speed_limit, at_speed),
    ]
    if drives is None:
        return uses
    nearest = np.abs(drives.curve_ratio(torque, speed)).argmax(axis=0)  # (n_a,) samples, to the curves
    at_nearest = nearest, np.arange(robot.n_a)
    on_curve = np.where(drives.has_curve, drives.largest_torque(speed)[at_nearest], np.inf)  # (n_a,)
    curves = _list_uses(robot, CURVE, np.abs(torque[at_nearest]), on_curve, instants[:, nearest])
    ratios, speeds = curve_ratios(dynamics, drives), np.abs(speed[at_nearest])  # (n_a,) each
    for k, use in zip(np.flatnonzero(drives.has_curve).tolist(), curves, strict=True):
        uses.append(use._replace(ratio=float(ratios[k]), speed=f"{speeds[k]:.4g} {robot.speed_units[k]}"))
    rms = rms_torques(dynamics, drives.cycle_time)  # (n_a,)
    return [*uses, *_list_uses(robot, "RMS torque", rms, drives.rms_torque_limit)]


def _list_uses(
    robot: ParallelRobot, limit: str, sizes: Array, allowed: Array, instants: Array | None = None
) -> list[MotorUse]:
    """Return the use of a limit by each motor that has the limit.

    Args:
        sizes, allowed: (n_a,); `allowed` is infinite for motors without the limit.
        instants: (2, n_a) times [s] and path coordinates of the sizes, if they have instants.
    """
    units = robot.speed_units if limit == "speed" else robot.torque_units
    uses = []
    for k in np.flatnonzero(np.isfinite(allowed)).tolist():
        size, largest = float(sizes[k]), float(allowed[k])
        ratio = size / largest if largest > 0.0 else np.inf  # a curve leaves nothing beyond its no-load speed
        use = MotorUse(robot.actuator_names[k], limit, ratio, size, largest, units[k])
        if instants is not None:
            use = use._replace(time=float(instants[0, k]), s=float(instants[1, k]))
        uses.append(use)
    return uses


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
    torque, speed = dynamics.torque(times), dynamics.motor_angle(times, 1)  # (T, n_a)
    room = 1.0 - drives.per_torque * torque * np.sign(speed)  # (T, n_a) 1 - k T / w_0
    factors = np.abs(speed) * drives.per_speed / np.maximum(room, LEAST_SPEED_SHARE)  # (T, n_a)
    factor = factors.max(axis=0, initial=1.0)  # (n_a,)
    rms = np.maximum(rms_torques(dynamics, drives.cycle_time) / drives.rms_torque_limit, 1.0)
    raised = {
        "corner_speed": (factor, drives.corner_speed),
        "no_load_speed": (factor, drives.no_load_speed),
        "rms_torque_limit": (rms, drives.rms_torque_limit),
    }
    advised = {}
    for name, (ratio, limit) in raised.items():
        if ratio.max() > 1.0:
            needed = np.where(ratio > 1.0, RAISED_RATIO * ratio, 1.0) * limit / share  # (n_a,)
            advised[name] = np.array([round_up(each, PRINTED_DIGITS) for each in needed])
    return advised
