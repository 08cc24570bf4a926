"""The motions of all levels of fidelity: one motion, and the torques that each level needs along it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

from framework.dynamics.result import InverseDynamics
from framework.errors import NoAnswer
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.description import RobotDescription
from framework.model.fidelity_levels import LEVELS, Level, with_bodies
from framework.planning.model_on_motion import ModelOnMotion


class LevelMotion(NamedTuple):
    """The motion with the torques of one level, and their computing time [s].

    dynamics: None where the level's model cannot make the motion, for a `reason`.
    """

    dynamics: InverseDynamics | None
    seconds: float
    reason: str = ""


def level_motions(
    description: RobotDescription, motion: InverseDynamics, own: Level, seconds: float
) -> Iterator[tuple[str, LevelMotion]]:
    """Yield the name of each level and its torques along a motion, which was planned with the level `own`.

    The law meets the condition (8) of each level.

    Args:
        seconds: time that the motion took.
    """
    for level in LEVELS:
        if level is own:
            yield level.name, LevelMotion(motion, seconds)
            continue
        started = time.perf_counter()
        try:
            dynamics = ModelOnMotion.of(motion, model_of(description, level)).resolve(level.geometry)
            yield level.name, LevelMotion(dynamics, time.perf_counter() - started)
        except NoAnswer as refusal:
            yield level.name, LevelMotion(None, 0.0, f"no torques: {refusal}")


def model_of(description: RobotDescription, level: Level) -> ParallelRobot:
    """Return the robot with the masses and springs of a level."""
    simplified = with_bodies(description, level.bodies)
    robot = ParallelRobot.from_description(simplified, flexibility=level.flexibility)
    return robot if level.elastic_inertia else replace(robot, elastic_inertia=False)
