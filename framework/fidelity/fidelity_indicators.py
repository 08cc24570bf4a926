"""The motions of all levels of fidelity, and indicators: estimates of their errors without simulation.

All levels follow one motion, each with the torques that its model needs along this motion. The torques of a
level lack the effects that the level leaves out, so that a real platform would leave the motion. So a level
has two errors:

* of torque: the difference of the level's torques from those of the highest level, divided by their peak;
* of the platform: the displacement under the missing wrench, which is G' times the difference of the torques
  (`dynamics.open_loop`), plus the distance of the two levels' motions, divided by the path's length.

Both are finite at Type 2: each level meets its own condition (8), and the equations of the displacement are
regular there.
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
from framework.planning.result import CrossingPlan

INSTANTS = 65  # instants of the motion between which the error dynamics are interpolated
STEPS = 512  # integration steps of the platform's error


class LevelMotion(NamedTuple):
    """The motion with the torques of one level.

    dynamics: the motion with its torques; None if the level's model cannot follow the motion.
    seconds: computing time of the torques [s].
    reason: why the model cannot follow the motion; empty otherwise.
    """

    dynamics: InverseDynamics | None
    seconds: float
    reason: str = ""


def compute_level_motions(
    description: RobotDescription, plan: CrossingPlan, own: Level
) -> dict[str, LevelMotion]:
    """Compute the torques of each level, by name, along the motion of a plan.

    The law is corrected to meet the condition (8) of each level.

    Args:
        own: the level with which the plan was made.
    """
    motions = {}
    for level in LEVELS:
        started = time.perf_counter()
        try:
            if level is own:
                motions[level.name] = LevelMotion(plan.dynamics, plan.seconds)
                continue
            model = ModelOnMotion.of(plan.dynamics, robot_at_level(description, level))
            dynamics = model.resolve(level.geometry)
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

    torque: error of the torques, divided by their peak.
    platform: error of the platform, divided by the path's length.
    """

    torque: float = np.inf
    platform: float = np.inf

    @property
    def words(self) -> str:
        """Both errors in words; empty if unknown."""
        if not np.isfinite(self.torque):
            return ""
        return f"torques {format_percent(self.torque)}, platform {format_percent(self.platform)}"


class Indicators(NamedTuple):
    """The estimated error of each level, by name, as a number and in words."""

    error: Mapping[str, float]
    words: Mapping[str, str]

    @staticmethod
    def of(errors: Mapping[str, LevelError]) -> Indicators:
        """Return indicators in which no level's error is less than that of a level above.

        In a single level errors may cancel by chance. A missing error and NaN count as infinite. The error of
        the highest level is zero.
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
    """Compute the indicators from the levels' motions, by name.

    Args:
        control: feedback of the motors, if any.
    """
    highest, rigid = motions[LEVELS[-1].name].dynamics, motions["rigid"].dynamics
    if highest is None or rigid is None:
        return Indicators.of({})
    times = np.linspace(0.0, rigid.duration, STEPS + 1)
    try:
        motor_speed = platform_wrench(rigid.robot, rigid.motion(times)).motor_speed
        dynamics = _interpolate_error_dynamics(rigid, times)
    except NoAnswer:  # at the boundary of the workspace
        return Indicators.of({})
    if control is not None:
        dynamics = dynamics.with_control(control, motor_speed)
    errors = {}
    reference = highest.torque_without_friction(times)
    peaks = largest_by_unit(rigid.robot, np.abs(reference).max(axis=0))
    sizes = coordinate_sizes(rigid.robot) / path_length(rigid.robot, rigid.path)
    for name, motion in motions.items():
        if motion.dynamics is None:
            continue
        missing = reference - motion.dynamics.torque_without_friction(times)
        missing_wrench = np.einsum("tan,ta->tn", motor_speed, missing)  # G' (difference of the torques)
        displacement = open_loop_error(dynamics, times, missing_wrench)
        displacement += highest.platform(times) - motion.dynamics.platform(times)
        distances = np.linalg.norm(displacement * sizes, axis=1)
        errors[name] = LevelError((np.abs(missing) / peaks).max(), distances.max())
    return Indicators.of(errors)


def _interpolate_error_dynamics(rigid: InverseDynamics, times: Array) -> ErrorDynamics:
    """Interpolate the error dynamics of the platform at t (T,) [s]."""
    instants = np.linspace(0.0, rigid.duration, INSTANTS)
    matrices = error_dynamics(rigid, instants)  # three stacks (INSTANTS, n, n)
    return ErrorDynamics(*CubicSpline(instants, matrices, axis=1)(times))


def format_percent(share: float) -> str:
    """Format a share in per cent, with two digits below 10 % and no decimals above."""
    return f"{100.0 * share:.0f} %" if share >= 0.1 else f"{100.0 * share:.2g} %"
