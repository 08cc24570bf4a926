"""Scenes of a robot file: their path, and their plan."""

from __future__ import annotations

from typing import Any

from framework.crossing.plan import plan_crossing
from framework.crossing.result import CrossingPlan
from framework.errors import InvalidInput, choose_from
from framework.model import ParallelRobot
from framework.model.description import Scene
from framework.motion.path import Arc, Line, Path, Spline


def scene(robot: ParallelRobot, name: str) -> Scene:
    """The scene of that name.

    Raises:
        InvalidInput: the robot has no such scene; lists those it has.
    """
    scenes = robot.description.scenes
    if name not in scenes:
        raise InvalidInput(f"{robot.name}: {choose_from('scene', name, scenes)}")
    return scenes[name]


def scene_path(scene: Scene) -> Path:
    """The path of a scene."""
    if scene.kind == "line":
        return Line(*scene.points)
    if scene.kind == "arc":
        return Arc(*scene.points)
    return Spline(scene.points)


def plan_scene(robot: ParallelRobot, name: str, **options: Any) -> CrossingPlan:
    """`plan_crossing` with what the scene says; keyword options override it."""
    chosen = scene(robot, name)
    given = {
        "duration": chosen.duration,
        "times": chosen.times,
        "speeds": chosen.speeds,
        "at": chosen.at,
    }
    return plan_crossing(robot, scene_path(chosen), **{**given, **options})
