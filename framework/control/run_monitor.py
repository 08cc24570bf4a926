"""Runs of a controlled crossing: what they have in common, how they are followed, and which of them pass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from framework.arrays import Array, ReadOnlyArrays
from framework.control.variation import Variation
from framework.errors import InvalidInput, check_choice
from framework.kinematics.parallel_robot import ParallelRobot

SENSORS = ("motors", "joints")
MAX_DEVIATION = 1.0  # [robot lengths, rad] from the plan: beyond, the run is over
PERIODS_PER_CHECK = 5  # sampling periods between two comparisons of the platform with the plan


@dataclass(frozen=True)
class ControlLoop:
    """Tolerances, torque limits and sensors of all runs.

    A run passes if the platform never leaves the plan by more than `tolerance` on the way and ends within
    `end` of the end of the path, in robot lengths and radians. `limit` (n_a) is the largest motor
    torque [N m]; None: the torque limits of the robot file, or else ten times the peaks of the plan.
    """

    tolerance: float = 2.5e-3
    end: float = 2.5e-3
    limit: tuple[float, ...] | None = None
    sensors: str = "motors"  # encoders on the motors alone, or on "joints": all of them

    def __post_init__(self) -> None:
        for name in ("tolerance", "end"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InvalidInput(f"{name}: must be a positive number, got {value!r}")
        check_choice("sensors", self.sensors, SENSORS)


@dataclass(frozen=True, eq=False, kw_only=True)
class Outcomes(ReadOnlyArrays):
    """The outcomes of R runs. `passed`: the platform came to rest near the end, see `ControlLoop`."""

    passed: NDArray[np.bool_]  # (R,)
    why: tuple[str, ...]  # (R,) empty for those that passed
    tracking_error: Array  # (R,) [robot lengths, rad] largest distance from the plan on the way
    end_error: Array  # (R,) the same at the end
    peak_torque: Array  # (R, n_a) [N m], motor side
    payload: Array  # (R,) factor


@dataclass(frozen=True, eq=False, kw_only=True)
class Run(Outcomes):
    """R runs that were driven together."""

    x: Array  # (checks, R, n) where the platforms went, every PERIODS_PER_CHECK sampling periods
    torque: Array | None = None  # (K, R, n_a) if it was recorded


@dataclass(eq=False)
class RunMonitor:
    """Errors and torques of R runs, with the reasons of failures."""

    robot: ParallelRobot
    alive: NDArray[np.bool_]
    why: list[str]
    worst: Array
    error: Array
    peak: Array
    places: list[Array]
    torques: list[Array]

    @staticmethod
    def of(count: int, robot: ParallelRobot) -> RunMonitor:
        zero = np.zeros(count)
        return RunMonitor(
            robot, np.ones(count, bool), [""] * count, zero, zero, np.zeros((count, robot.n_a)), [], []
        )

    def check(self, time: float, x: Array, planned: Array) -> None:
        """Compare platforms x (R, n) with the plan (n,); end runs far off or not finite."""
        size = self.robot.platform_scale
        self.error = np.nan_to_num(np.abs((x - planned) / size), nan=MAX_DEVIATION).max(axis=1)
        self.end(time, ~(self.error < MAX_DEVIATION))
        self.worst = np.maximum(self.worst, np.where(self.alive, self.error, MAX_DEVIATION))
        self.places.append(np.where(self.alive[:, None], x, np.nan))

    def end(self, time: float, runs: NDArray[np.bool_]) -> None:
        """End the runs marked in (R,) that are not over yet."""
        for run in np.flatnonzero(self.alive & runs):
            self.why[run] = f"lost at t = {time:.4g} s"
        self.alive = self.alive & ~runs

    def act(self, torque: Array, *, record: bool) -> None:
        """Note the peaks of the torques (R, n_a) of one sampling period; `record` keeps all torques."""
        self.peak = np.fmax(self.peak, np.where(self.alive[:, None], np.abs(torque), 0.0))
        if record:
            self.torques.append(torque)

    def verdict(self, loop: ControlLoop, variations: Sequence[Variation]) -> Run:
        """Return who passed, and why the others did not."""
        error = np.where(self.alive, self.error, MAX_DEVIATION)
        for run in np.flatnonzero(self.alive & (self.worst > loop.tolerance)):
            self.why[run] = f"{self.worst[run]:.3g} off the plan on the way"
        for run in np.flatnonzero(self.alive & (self.worst <= loop.tolerance) & (error > loop.end)):
            self.why[run] = f"{error[run]:.3g} off at the end"
        return Run(
            passed=self.alive & (self.worst <= loop.tolerance) & (error <= loop.end),
            why=tuple(self.why),
            tracking_error=self.worst,
            end_error=error,
            peak_torque=self.peak,
            payload=np.array([variation.payload for variation in variations]),
            x=np.array(self.places),
            torque=np.array(self.torques) if self.torques else None,
        )
