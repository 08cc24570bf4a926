"""Runs of a controlled crossing: tolerances and limits, errors over time, and which runs pass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from framework.control.variation import Variation
from framework.errors import InvalidInput, check_choice
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, BoolArray, ReadOnlyArrays

SENSORS = ("motors", "joints")
MAX_DEVIATION = 1.0  # [robot lengths, rad] from the plan: beyond, the run is over
PERIODS_PER_CHECK = 5  # sampling periods between two comparisons of the platform with the plan


@dataclass(frozen=True)
class ControlLoop:
    """Tolerances, torque limits and sensors of all runs.

    A run passes if the platform is never farther than `tolerance` from the plan and ends within `end` of the
    end of the path, in robot lengths and radians. `limit` (n_a) are the largest motor torques [N m]; None:
    the torque limits of the robot file, or ten times the peaks of the plan.
    """

    tolerance: float = 2.5e-3
    end: float = 2.5e-3
    limit: tuple[float, ...] | None = None
    sensors: str = "motors"  # encoders on the motors, or on all "joints"

    def __post_init__(self) -> None:
        """Check tolerances and the name of the sensors."""
        for name in ("tolerance", "end"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InvalidInput(f"{name}: must be a positive number, got {value!r}")
        check_choice("sensors", self.sensors, SENSORS)


@dataclass(frozen=True, eq=False, kw_only=True)
class Outcomes(ReadOnlyArrays):
    """The outcomes of R runs.

    `passed`: the platform came to rest near the end, see `ControlLoop`.
    """

    passed: BoolArray  # (R,)
    why: tuple[str, ...]  # (R,) empty for those that passed
    tracking_error: Array  # (R,) [robot lengths, rad] largest distance from the plan
    end_error: Array  # (R,) the same at the end
    peak_torque: Array  # (R, n_a) [N m], motor side
    payload: Array  # (R,) factor


@dataclass(frozen=True, eq=False, kw_only=True)
class Run(Outcomes):
    """R runs that were driven together."""

    x: Array  # (checks, R, n) of the platforms, every PERIODS_PER_CHECK sampling periods
    torque: Array | None = None  # (K, R, n_a) if it was recorded


@dataclass(eq=False)
class RunMonitor:
    """Errors and torques of R runs so far, with the reasons of failures."""

    robot: ParallelRobot
    alive: BoolArray  # (R,) runs that are not over
    why: list[str]  # (R) reasons of failures
    worst: Array  # (R,) largest error
    error: Array  # (R,) last error
    peak: Array  # (R, n_a) largest torque [N m]
    positions: list[Array]  # (R, n) of platforms at each check
    torques: list[Array]  # (R, n_a) of each period, if recorded

    @staticmethod
    def of(count: int, robot: ParallelRobot) -> RunMonitor:
        """Return the monitor of `count` runs that have not begun."""
        return RunMonitor(
            robot=robot,
            alive=np.ones(count, bool),
            why=[""] * count,
            worst=np.zeros(count),
            error=np.zeros(count),
            peak=np.zeros((count, robot.n_a)),
            positions=[],
            torques=[],
        )

    def check(self, time: float, x: Array, planned: Array) -> None:
        """Compare platforms x (R, n) with the plan (n,); end runs that are too far off."""
        scale = self.robot.platform_scale
        self.error = np.nan_to_num(np.abs((x - planned) / scale), nan=MAX_DEVIATION).max(axis=1)
        self.end(time, ~(self.error < MAX_DEVIATION))
        self.worst = np.maximum(self.worst, np.where(self.alive, self.error, MAX_DEVIATION))
        self.positions.append(np.where(self.alive[:, None], x, np.nan))

    def end(self, time: float, runs: BoolArray) -> None:
        """End the runs of a mask (R,) that are not over yet."""
        for run in np.flatnonzero(self.alive & runs):
            self.why[run] = f"lost at t = {time:.4g} s"
        self.alive = self.alive & ~runs

    def add_torque(self, torque: Array, *, record: bool) -> None:
        """Update the peaks by torques (R, n_a) of one period; store all if `record`."""
        self.peak = np.fmax(self.peak, np.where(self.alive[:, None], np.abs(torque), 0.0))
        if record:
            self.torques.append(torque)

    def conclude(self, loop: ControlLoop, variations: Sequence[Variation]) -> Run:
        """Return the runs with the reasons why some did not pass."""
        error = np.where(self.alive, self.error, MAX_DEVIATION)
        is_near_plan = self.worst <= loop.tolerance
        is_near_end = error <= loop.end
        for run in np.flatnonzero(self.alive & ~is_near_plan):
            self.why[run] = f"{self.worst[run]:.3g} off the plan on the way"
        for run in np.flatnonzero(self.alive & is_near_plan & ~is_near_end):
            self.why[run] = f"{error[run]:.3g} off at the end"
        return Run(
            passed=self.alive & is_near_plan & is_near_end,
            why=tuple(self.why),
            tracking_error=self.worst,
            end_error=error,
            peak_torque=self.peak,
            payload=np.array([variation.payload for variation in variations]),
            x=np.array(self.positions),
            torque=np.array(self.torques) if self.torques else None,
        )
