"""The motions of all levels of fidelity, and indicators: estimated errors of each, without a simulation.

All levels make one motion with the torques that each needs along it.

An effect that a level leaves out has a torque, which the level lacks, and a displacement, by which the
platform leaves the level's motion for want of that torque. The error of a level is that of all effects above
it, and two errors count:

* the difference of its torques from those of the highest level, over their peak;
* the displacement of the platform, over the path's length (`dynamics.open_loop`), under the missing wrench
  G' (difference of the torques), plus the distance of the two levels' motions.

Both are regular at Type 2. Each level crosses with its own condition (8), and no divisor of the second
vanishes there.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from framework.dynamics.open_loop import ErrorDynamics, MotorControl, error_dynamics, open_loop_error
from framework.dynamics.platform_wrench import platform_wrench
from framework.dynamics.result import InverseDynamics
from framework.errors import NoAnswer
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.description import RobotDescription
from framework.model.fidelity_levels import LEVELS, Level, with_bodies
from framework.numerics.arrays import Array
from framework.planning.model_on_motion import ModelOnMotion
from framework.planning.motion_scales import coordinate_sizes, largest_by_unit, path_length

INSTANTS = 65  # of the motion, at which the dynamics of the platform's error are computed
STEPS = 512  # of the integration of the platform's error


class LevelMotion(NamedTuple):
    """The motion with the torques of one level, and their computing time [s].

    dynamics: None where the level's model cannot make the motion, for a `reason`.
    """

    dynamics: InverseDynamics | None
    seconds: float
    reason: str = ""


def compute_level_motions(
    description: RobotDescription, motion: InverseDynamics, own: Level, seconds: float
) -> dict[str, LevelMotion]:
    """Compute the torques of each level along a motion planned with level `own`.

    By the levels' names. The law meets the condition (8) of each level.

    Args:
        seconds: time that the motion took.
    """
    motions = {level.name: LevelMotion(motion, seconds) for level in LEVELS}
    for level in LEVELS:
        if level is not own:
            started = time.perf_counter()
            try:
                dynamics = ModelOnMotion.of(motion, robot_at_level(description, level)).resolve(
                    level.geometry
                )
                motions[level.name] = LevelMotion(dynamics, time.perf_counter() - started)
            except NoAnswer as refusal:
                motions[level.name] = LevelMotion(None, 0.0, f"no torques: {refusal}")
    return motions


def robot_at_level(description: RobotDescription, level: Level) -> ParallelRobot:
    """Return the robot with the masses and springs of a level."""
    simplified = with_bodies(description, level.bodies)
    robot = ParallelRobot.from_description(simplified, flexibility=level.flexibility)
    return robot if level.elastic_inertia else replace(robot, elastic_inertia=False)


class LevelError(NamedTuple):
    """The estimated errors of a level.

    Of the torques over their peak, of the platform over the path's length.
    """

    torque: float = np.inf
    platform: float = np.inf

    @property
    def words(self) -> str:
        """Both errors in words; empty where unknown."""
        if not np.isfinite(self.torque):
            return ""
        return f"torques {format_percent(self.torque)}, platform {format_percent(self.platform)}"


class Indicators(NamedTuple):
    """The estimated error of each level by its name, and the same in words."""

    error: Mapping[str, float]
    words: Mapping[str, str]

    @staticmethod
    def of(errors: Mapping[str, LevelError]) -> Indicators:
        """Return indicators in which a level's error is at least that of levels above.

        Errors may cancel in a level by chance. An error that is missing or no number counts as infinite; that
        of the highest level is zero.
        """
        largest = 0.0
        error, words = {LEVELS[-1].name: largest}, {LEVELS[-1].name: ""}
        for level in reversed(LEVELS[:-1]):
            own = errors.get(level.name, LevelError())
            largest = max(largest, float(np.nan_to_num(max(own), nan=np.inf)))
            error[level.name] = largest
            words[level.name] = own.words
        return Indicators(error, words)

    def choose_level(self, tolerance: float) -> str:
        """Return the name of the least level whose error is within the tolerance."""
        return next(level.name for level in LEVELS if self.error[level.name] <= tolerance)


def compute_indicators(motions: Mapping[str, LevelMotion], control: MotorControl | None) -> Indicators:
    """Compute the indicators from the levels' motions by name.

    `control` is feedback of the motors, if any.
    """
    highest, rigid = motions[LEVELS[-1].name].dynamics, motions["rigid"].dynamics
    if highest is None or rigid is None:
        return Indicators.of({})
    times = np.linspace(0.0, rigid.duration, STEPS + 1)
    try:
        motor_speed = platform_wrench(rigid.robot, rigid.motion(times)).motor_speed
        dynamics = _interpolate_error_dynamics(rigid, times)
    except NoAnswer:  # at the border of the workspace
        return Indicators.of({})
    if control is not None:
        dynamics = dynamics.with_control(control, motor_speed)
    errors = {}
    needed = highest.torque_without_friction(times)
    peaks = largest_by_unit(rigid.robot, np.abs(needed).max(axis=0))
    length = path_length(rigid.robot, rigid.path)
    for name, motion in motions.items():
        if motion.dynamics is not None:
            missing = needed - motion.dynamics.torque_without_friction(times)
            missing_wrench = np.einsum("tan,ta->tn", motor_speed, missing)  # G' (difference of the torques)
            displacement = open_loop_error(dynamics, times, missing_wrench)
            displacement += highest.platform(times) - motion.dynamics.platform(times)
            distances = np.linalg.norm(displacement * coordinate_sizes(rigid.robot), axis=1)
            errors[name] = LevelError(float((np.abs(missing) / peaks).max()), float(distances.max()) / length)
    return Indicators.of(errors)


def _interpolate_error_dynamics(rigid: InverseDynamics, times: Array) -> ErrorDynamics:
    """Compute the error dynamics of the platform at t (T,), by interpolation."""
    few = np.linspace(0.0, rigid.duration, INSTANTS)
    matrices = np.stack(error_dynamics(rigid, few)).transpose(1, 0, 2, 3)
    return ErrorDynamics(*CubicSpline(few, matrices)(times).transpose(1, 0, 2, 3))


def format_percent(share: float) -> str:
    """Format a share in per cent, with two digits below 10 %."""
    return f"{100.0 * share:.0f} %" if share >= 0.1 else f"{100.0 * share:.2g} %"
