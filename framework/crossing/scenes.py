"""Scenes of a robot file: their path, their request and their plan."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from framework.crossing.options import OPTIONS
from framework.crossing.plan import plan_request
from framework.crossing.request import Request
from framework.crossing.result import CrossingPlan
from framework.dynamics.motor_limits import is_limited
from framework.errors import InvalidInput, choose_from, short
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.model.description import Scene
from framework.motion.path import Arc, Line, Path, Polyline, Spline


def scene(robot: ParallelRobot, name: str) -> Scene:
    """Return the scene of that name.

    Raises:
        InvalidInput: the robot has no such scene; lists those it has.
    """
    expect_robot(robot)
    scenes = robot.description.scenes
    if not scenes:
        raise InvalidInput(f"{robot.name}: unknown scene {short(name)}: it has no scenes")
    if name not in scenes:
        raise InvalidInput(f"{robot.name}: {choose_from('scene', name, scenes)}")
    return scenes[name]


def scene_path(scene: Scene) -> Path:
    """Return the path of a scene."""
    return path_of(scene.kind, scene.points, scene.blend)


def path_of(kind: str, points: Sequence[Sequence[float]], blend: float | None = None) -> Path:
    """Return a line (start, end), an arc (start, via, end), a spline or a polyline through points (m, n).

    Raises:
        InvalidInput: another kind, or points that do not make such a path.
    """
    if kind == Spline.kind:
        return Spline(points)
    if kind == Polyline.kind:
        return Polyline(points, blend)
    kinds: dict[str, tuple[Callable[..., Path], int]] = {Line.kind: (Line, 2), Arc.kind: (Arc, 3)}
    if kind not in kinds:
        raise InvalidInput(choose_from("path", kind, [*kinds, Spline.kind, Polyline.kind]))
    make, count = kinds[kind]
    if len(points) != count:
        raise InvalidInput(f"{kind}: needs {count} points, got {len(points)}")
    return make(*points)


def plan_scene(robot: ParallelRobot, name: str, **options: Any) -> CrossingPlan:
    """Plan the request of a scene; keyword options of `plan_crossing` override the scene's."""
    return plan_request(robot, scene_request(robot, name, **options))


def scene_request(robot: ParallelRobot, name: str, **options: Any) -> Request:
    """Return the request of a scene; keyword options of `plan_crossing` override the scene's.

    A scene's times and speeds of crossings belong to the polynomial. They are left out where the options ask
    for an optimal law, and the duration where they ask for a law that finds its own.

    Raises:
        InvalidInput: the robot has no such scene, or see `Request.of`.
    """
    chosen = scene(robot, name)
    stated = {key: getattr(chosen, key) for key in OPTIONS if hasattr(chosen, key)}
    has_duration = options.get("duration") is not None and chosen.optimize == "time"
    if has_duration or options.get("law") == "polynomial" or options.get("times") is not None:
        stated.update(optimize=None)
    asked = {**stated, **options}
    asks_for_optimal = options.get("law") == "optimal"
    asks_for_optimal |= any(asked.get(key) is not None for key in ("optimize", "longest", "margin"))
    asks_for_optimal |= any(is_limited(options.get(key)) for key in ("torque_limit", "speed_limit"))
    if asks_for_optimal:
        stated.update(times=None, speeds=None)
    if options.get("optimize") == "time" or options.get("longest") is not None:
        stated.update(duration=None)
    return Request.of(robot, scene_path(chosen), **{**stated, **options})
