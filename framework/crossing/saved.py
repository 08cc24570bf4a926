"""plan.json: a plan written down, its request, law and verdict; `restored` reads it back."""

from __future__ import annotations

import os
from dataclasses import asdict, fields
from pathlib import Path as FilePath
from typing import Any

from framework.catalogue import catalogue
from framework.crossing.request import Request
from framework.crossing.result import Crossing, CrossingPlan
from framework.crossing.saved_keys import LAW_KINDS, VERSION
from framework.dynamics.loaded_measure import LoadedPoint
from framework.errors import InvalidInput, choose_from
from framework.kinematics.parallel_robot import ParallelRobot
from framework.motion.law import Law, PlannedLaw
from framework.motion.path import PointPath
from framework.output import json_text, write_file

FILE = "plan.json"


def save_plan(plan: CrossingPlan, folder: str | FilePath) -> FilePath:
    """Write plan.json into a folder, for `load_plan`, and return the file.

    Raises:
        InvalidInput: see `plan_document`.
        OutputError: it cannot be written.
    """
    file = FilePath(folder) / FILE
    write_file(file, json_text(plan_document(plan, file.parent)), option="save_plan")
    return file


def plan_document(plan: CrossingPlan, folder: FilePath | None = None) -> dict[str, Any]:
    """Return the content of plan.json, SI units.

    Args:
        folder: where the file is to stand; the robot file is then stated relative to it, where it can be.

    Raises:
        InvalidInput: the path or the law is of the user's own making, and cannot be written down.
    """
    return {
        "version": VERSION,
        "robot": plan.robot.name,
        "robot_file": robot_place(plan.robot, folder),
        "flexibility": plan.robot.flexibility,
        "geometry": plan.geometry,
        "duration": plan.duration,
        "request": _request_document(plan.request),
        "law": _law_document(plan.law),
        "crossings": [
            _crossing_document(crossing, loaded)
            for crossing, loaded in zip(plan.crossings, plan.loaded_points, strict=True)
        ],
        "peak_torque": plan.peak_torque,
        "exceeded": plan.exceeded,
        "neglected_friction": plan.neglected_friction,
        "neglected": [effect._asdict() for effect in plan.neglected],
        "certificate": asdict(plan.certificate),
        "reason": plan.reason,
        "optimality": None
        if plan.optimality is None
        else {
            "optimize": plan.optimality.specification.goal,
            "reference": plan.optimality.reference.tolist(),
            "gap": plan.optimality.gap,
        },
        "seconds": plan.seconds,
    }


def robot_place(robot: ParallelRobot, folder: FilePath | None = None) -> str:
    """Return the robot's name in the catalogue, or else the path of its file, relative to a folder."""
    name, file = robot.name, robot.description.file
    entry = catalogue().get(name)
    if entry is not None and file.exists() and entry.file.samefile(file):
        return name
    if folder is None:
        return str(file.resolve())
    try:
        relative = os.path.relpath(file.resolve(), folder.resolve())
    except ValueError:  # on another drive
        return str(file.resolve())
    return relative if os.path.dirname(relative) else os.path.join(os.curdir, relative)


def _request_document(request: Request) -> dict[str, Any]:
    path = request.path
    if not isinstance(path, PointPath):
        raise InvalidInput(
            f"path: only a line, an arc or a spline can be written down, not {type(path).__name__}; save the "
            f"motion with plan.to_csv"
        )
    rest = {field.name: getattr(request, field.name) for field in fields(request) if field.name != "path"}
    return {"path": {path.kind: path.points.tolist()}, **rest}


def _law_document(law: object) -> dict[str, Any]:
    document = law.to_dict() if isinstance(law, PlannedLaw) else {"kind": type(law).__name__}
    kind = document.get("kind", Law.kind)
    if kind not in LAW_KINDS:
        raise InvalidInput(
            f"law: {choose_from('kind of law', kind, LAW_KINDS)}, in a plan that is saved; plan.to_csv "
            f"saves its motion"
        )
    return document


def _crossing_document(crossing: Crossing, loaded: LoadedPoint | None) -> dict[str, Any]:
    condition = crossing.condition
    return {
        "s": crossing.s,
        "time": crossing.time,
        "speed": crossing.speed,
        "acceleration": crossing.acceleration,
        "kind": crossing.kind,
        "twist": crossing.twist.tolist(),
        "platform": crossing.platform.tolist(),
        "residual": crossing.residual,
        "condition": None if condition is None else condition._asdict(),
        "loaded": None if loaded is None else {"s": loaded.s, "distance": loaded.distance},
    }
