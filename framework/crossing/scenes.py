"""Scenes of a robot file: their path, and their plan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from framework.crossing.plan import plan_crossing
from framework.crossing.result import CrossingPlan
from framework.errors import InvalidInput, choose_from
from framework.kinematics.parallel_robot import ParallelRobot
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
    return path_of(scene.kind, scene.points)


def path_of(kind: str, points: Sequence[Sequence[float]]) -> Path:
    """A line (start, end), an arc (start, via, end) or a spline through points (m, n).

    Raises:
        InvalidInput: another kind, or points that do not make such a path.
    """
    count = {"line": 2, "arc": 3, "spline": None}
    if kind not in count:
        raise InvalidInput(choose_from("path", kind, count))
    if count[kind] not in (None, len(points)):
        raise InvalidInput(f"{kind}: needs {count[kind]} points, got {len(points)}")
    if kind == "line":
        return Line(*points)
    return Arc(*points) if kind == "arc" else Spline(points)


def plan_scene(robot: ParallelRobot, name: str, **options: Any) -> CrossingPlan:
    """`plan_crossing` with what the scene says; keyword options override it."""
    chosen = scene(robot, name)
    return plan_crossing(robot, scene_path(chosen), **{**asked_by_scene(chosen, options), **options})


def asked_by_scene(scene: Scene, options: Mapping[str, Any]) -> dict[str, Any]:
    """What a scene says of the motion, as far as it fits a law of these options of `plan_crossing`.

    The timing of its crossings belongs to the polynomial; its duration not to a law that finds its own.
    """
    given = {"duration": scene.duration, "times": scene.times, "speeds": scene.speeds, "at": scene.at}
    wanted = [options.get(key) for key in ("optimize", "longest", "torque_limit", "speed_limit", "margin")]
    if options.get("law") == "optimal" or any(value is not None for value in wanted):
        given.update(times=None, speeds=None)
    if options.get("optimize") == "time" or options.get("longest") is not None:
        given.update(duration=None)
    return given
