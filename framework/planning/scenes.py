"""Scenes of a robot file: path, request and plan."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from framework.dynamics.motor_limits import is_limited
from framework.errors import InvalidInput, check_choice, choose_from, short
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.laws.path import Arc, Line, Path, Polyline, Spline
from framework.model.description import Scene
from framework.model.documents import prefix_errors
from framework.planning.options import OPTIONS
from framework.planning.plan import plan_request
from framework.planning.request import Request
from framework.planning.result import CrossingPlan


def scene(robot: ParallelRobot, name: str) -> Scene:
    """Return the scene of a name.

    Raises:
        InvalidInput: the robot has no such scene; the message lists those that it has.
        RobotFileError: the path of the scene is invalid.
    """
    expect_robot(robot)
    scenes = robot.description.scenes
    if not scenes:
        raise InvalidInput(f"{robot.name}: unknown scene {short(name)}: it has no scenes")
    if name not in scenes:
        raise InvalidInput(f"{robot.name}: {choose_from('scene', name, scenes)}")
    with prefix_errors(f"{robot.description.file}: scenes.{name}"):
        scene_path(scenes[name])
    return scenes[name]


def scene_path(scene: Scene) -> Path:
    """Return the path of a scene."""
    return path_of(scene.kind, scene.points, scene.blend)


def path_of(kind: str, points: Sequence[Sequence[float]], blend: float | None = None) -> Path:
    """Return the path of a kind through points (m, n).

    A line needs (start, end), an arc (start, via, end).

    Raises:
        InvalidInput: an unknown kind, or points that do not make such a path.
    """
    check_choice("path", kind, [Line.kind, Arc.kind, Spline.kind, Polyline.kind])
    if kind == Spline.kind:
        return Spline(points)
    if kind == Polyline.kind:
        return Polyline(points, blend)
    path, count = (Line, 2) if kind == Line.kind else (Arc, 3)
    if len(points) != count:
        raise InvalidInput(f"{kind}: needs {count} points, got {len(points)}")
    return path(*points)


def plan_scene(robot: ParallelRobot, name: str, **options: Any) -> CrossingPlan:
    """Plan the request of a scene; options of `plan_crossing` override the scene's."""
    return plan_request(robot, scene_request(robot, name, **options))


def scene_request(robot: ParallelRobot, name: str, **options: Any) -> Request:
    """Return the request of a scene; options of `plan_crossing` override the scene's.

    Times and speeds of crossings in a scene are for the polynomial. They are left out if the options ask for
    an optimal law, and the scene's duration if they ask for a law that finds its own.

    Raises:
        InvalidInput: the robot has no such scene, or as `Request.of`.
    """
    chosen = scene(robot, name)
    stated = {key: getattr(chosen, key) for key in OPTIONS if hasattr(chosen, key)}
    given = {key for key, value in options.items() if value is not None}
    fixes_duration = "duration" in given and chosen.optimize == "time"
    if fixes_duration or options.get("law") == "polynomial" or "times" in given:
        stated["optimize"] = None
    wants_limits = any(is_limited(options.get(key)) for key in ("torque_limit", "speed_limit"))
    has_goal = any({**stated, **options}.get(key) is not None for key in ("optimize", "longest", "margin"))
    if options.get("law") == "optimal" or has_goal or wants_limits:
        stated.update(times=None, speeds=None)
    if options.get("optimize") == "time" or "longest" in given:
        stated["duration"] = None
    return Request.of(robot, scene_path(chosen), **{**stated, **options})
