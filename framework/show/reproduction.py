"""The command line, or the call, that makes a plan again."""

from __future__ import annotations

import shlex
from collections.abc import Iterable
from dataclasses import fields
from typing import Any

from framework.crossing.request import Request
from framework.crossing.result import CrossingPlan
from framework.crossing.saved import robot_name_or_file
from framework.crossing.scenes import scene_request
from framework.errors import InvalidInput
from framework.motion.path import Line, Polyline

ONLY_CALLED = ("at", "tolerance")  # options of `plan_crossing` that a command line lacks


def command_line(plan: CrossingPlan, folder: str) -> str | None:
    """Return the `crossing plan` that makes the same plan into a folder; None without one."""
    typed = {key: value for key, value in given_options(plan).items() if key not in ONLY_CALLED}
    wrenches = plan.dynamics.wrenches.entries
    if any(wrench.turns or wrench.rows.ndim > 1 for wrench in wrenches):
        typed.pop("wrenches")  # only a scene can state them
    motion = _path_options(plan, typed)
    if motion is None:
        return None
    robot = f"crossing plan {shlex.quote(robot_name_or_file(plan.robot))}"
    parameters = plan.robot.description.parameters
    if parameters:
        motion += ["--set " + " ".join(f"{name}={value!r}" for name, value in parameters.items())]
    words = [robot, *motion, f"--flexibility {plan.robot.flexibility}"]
    words += [_format_option(key, value) for key, value in typed.items()]
    return " \\\n    ".join([*words, f"--out {shlex.quote(folder)}"])


def python_call(plan: CrossingPlan) -> str:
    """Return the call of `plan_crossing` that makes the same plan."""
    file = str(plan.robot.description.file)
    parameters = dict(plan.robot.description.parameters)
    stated = f", parameters={parameters!r}" * bool(parameters)
    robot = f"ParallelRobot.from_file({file!r}, flexibility={plan.robot.flexibility!r}{stated})"
    options = [f"{key}={value!r}" for key, value in given_options(plan).items()]
    return "plan_crossing(\n    " + ",\n    ".join([robot, repr(plan.path), *options]) + ",\n)"


def given_options(plan: CrossingPlan) -> dict[str, Any]:
    """Return the options of `plan_crossing` beside the path that differ from their defaults.

    Options whose default depends on the robot are always among them.
    """
    always = ("smoothness", "geometry") if plan.robot.n_e else ("smoothness",)
    options = {}
    for field in fields(Request):
        value = getattr(plan.request, field.name)
        if field.name != "path" and (field.name in always or value != field.default):
            options[field.name] = value
    return options


def _path_options(plan: CrossingPlan, typed: dict[str, Any]) -> list[str] | None:
    """Return the path as options: the ends of a line, or a scene with the path; None without either."""
    path = plan.path
    if isinstance(path, Line | Polyline) and Request.of(plan.robot, path, **typed) == plan.request:
        start, *via, end = map(_format_numbers, path.points)
        blend = [] if path.blend is None else [f"--blend {path.blend!r}"]
        return [f"--from {start}", *(f"--via {corner}" for corner in via), f"--to {end}", *blend]
    for name in plan.robot.description.scenes:
        try:
            of_scene = scene_request(plan.robot, name, **typed)
        except InvalidInput:  # the options do not go with this scene
            continue
        if of_scene == plan.request:
            return [f"--scene {shlex.quote(name)}"]
    return None


def _format_option(key: str, value: Any) -> str:
    """Return one option in the form of the command line."""
    option = f"--{key.replace('_', '-')}"
    if value is True:
        return option
    if key == "wrenches":
        return " ".join(
            f"--wrench-on {shlex.quote(frame)} {_format_numbers(numbers)}" for frame, numbers in value.items()
        )
    return f"{option} {_format_numbers(value)}".rstrip() if isinstance(value, tuple) else f"{option} {value}"


def _format_numbers(values: Iterable[float | None]) -> str:
    return " ".join("none" if value is None else repr(float(value)) for value in values)
