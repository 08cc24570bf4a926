"""The scenes of a robot file: the path, the request and the plan of each.

A scene is a named motion: the points of a path, and options of its plan.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from framework.dynamics.motor_limits import is_limited
from framework.errors import InvalidInput, check_choice, choose_from, short
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.curves import Arc, Polyline, Spline
from framework.laws.path import Line, Path
from framework.model.description import Scene
from framework.model.documents import prefix_errors
from framework.planning.options import OPTIONS
from framework.planning.plan import plan_request
from framework.planning.request import MOTOR_LIMITS, Request
from framework.planning.result import CrossingPlan


def scene(robot: ParallelRobot, name: str) -> Scene:
    """Return the scene with a name.

    Raises:
        InvalidInput: the robot has no such scene; the message lists the names of its scenes.
        RobotFileError: the points of the scene make no path.
    """
    return _scene_and_path(robot, name)[0]


def _scene_and_path(robot: ParallelRobot, name: str) -> tuple[Scene, Path]:
    """Return a `scene` with its path; raise as `scene`."""
    scenes = robot.description.scenes
    if not scenes:
        raise InvalidInput(f"{robot.name}: unknown scene {short(name)}: it has no scenes")
    if name not in scenes:
        raise InvalidInput(f"{robot.name}: {choose_from('scene', name, scenes)}")
    with prefix_errors(f"{robot.description.file}: scenes.{name}"):
        return scenes[name], scene_path(scenes[name])


def scene_path(scene: Scene) -> Path:
    """Return the path of a scene."""
    return path_of(scene.kind, scene.points, scene.blend)


def path_of(kind: str, points: Sequence[Sequence[float]], blend: float | None = None) -> Path:
    """Return the line, arc, spline or polyline through points (m, n).

    Args:
        kind: "line", "arc", "spline" or "polyline", the `kind` of the path's class.
        points: (start, end) of a line, (start, via, end) of an arc.
        blend: distance from a polyline's corners at which their rounding begins.

    Raises:
        InvalidInput: an unknown kind, or points that do not define such a path.
    """
    check_choice("path", kind, [Line.kind, Arc.kind, Spline.kind, Polyline.kind])
    if kind == Spline.kind:
        return Spline(points)
    if kind == Polyline.kind:
        return Polyline(points, blend)
    path_type, count = (Line, 2) if kind == Line.kind else (Arc, 3)
    if len(points) != count:
        raise InvalidInput(f"{kind}: needs {count} points, got {len(points)}")
    return path_type(*points)


def plan_scene(robot: ParallelRobot, name: str, **options: Any) -> CrossingPlan:
    """Plan the request of a scene; options of `plan_crossing` override the scene's.

    Raises:
        InvalidInput, NoAnswer: as `scene_request` and `plan_crossing`.
    """
    return plan_request(robot, scene_request(robot, name, **options))


def scene_request(robot: ParallelRobot, name: str, **options: Any) -> Request:
    """Return the request of a scene; options of `plan_crossing` override the scene's.

    Options of a scene that contradict the given ones are left out. The scene's goal gives way to a
    polynomial, to an empty list of times, and, if the goal is the least time, to a duration. The scene's
    times and speeds of crossings are for its polynomial and give way to an optimal law. The scene's duration
    gives way to a law that finds its own duration.

    Raises:
        InvalidInput: the robot has no such scene, or as `Request.of`.
    """
    chosen, path = _scene_and_path(robot, name)
    stated = {key: value for key, value in vars(chosen).items() if key in OPTIONS}  # options of the scene

    # the scene's goal gives way
    fixes_duration = options.get("duration") is not None and chosen.optimize == "time"
    if fixes_duration or options.get("law") == "polynomial" or options.get("times") in ((), []):
        stated["optimize"] = None

    # its times and speeds give way to an optimal law
    has_limits = any(is_limited(options.get(key)) for key in MOTOR_LIMITS)
    combined = {**stated, **options}
    has_goal = any(combined.get(key) is not None for key in ("optimize", "longest", "margin"))
    if options.get("law") == "optimal" or has_goal or has_limits:
        stated.update(times=None, speeds=None)

    # its duration gives way to a law that finds its own
    if options.get("optimize") == "time" or options.get("longest") is not None:
        stated["duration"] = None
    return Request.of(robot, path, **{**stated, **options})
