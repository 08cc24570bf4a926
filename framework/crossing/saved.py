"""A plan read back from the folder that `crossing plan --out` wrote.

What was saved is the law; torques and proof are computed anew from it, and must be those of the file.
"""

from __future__ import annotations

import json
import os
import time
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from framework.catalogue import robot_file
from framework.crossing.plan import reported_crossings
from framework.crossing.request import Request, checked_smoothness
from framework.crossing.result import CrossingPlan, Optimality
from framework.crossing.scenes import path_of
from framework.dynamics.inverse_dynamics import inverse_dynamics
from framework.errors import InvalidInput, NoAnswer, choose_from
from framework.input import read_text
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.description import FLEXIBILITIES
from framework.model.readers.recognise import read_any
from framework.motion.law import Law, PlannedLaw, check_duration
from framework.motion.optimal_law import OptimalLaw
from framework.motion.path import Path

LARGEST_DOCUMENT = 1_000_000_000  # bytes
SAME = 1e-6  # peak torques of the file and of the plan computed anew may differ by this share


def is_plan_folder(name: str) -> bool:
    """Whether this is a folder with a plan.json in it."""
    return os.path.isfile(os.path.join(name, "plan.json"))


def load_plan(folder: str | FilePath) -> CrossingPlan:
    """The plan of a folder written by `crossing plan --out`.

    Raises:
        InvalidInput: there is no plan.json, it is not one of ours, or its robot has changed since.
        RobotFileError: the robot file is gone or broken.
    """
    file = FilePath(folder) / "plan.json"
    return restored_plan(read_document(file, "plan"), file)


def restored_plan(saved: dict[str, Any], file: FilePath) -> CrossingPlan:
    """The plan of which `CrossingPlan.to_dict` gave `saved`; `file` is where that stood, for complaints.

    Raises:
        InvalidInput, RobotFileError: see `load_plan`.
    """
    started = time.perf_counter()
    try:
        robot = _robot(saved)
        path = _path(file, saved)
        law = _law(robot, saved["law"], float(saved["duration"]))
        optimality = None
        if isinstance(law, OptimalLaw):
            optimality = Optimality.from_dict(saved["optimality"], law.smoothness)
        geometry, peaks = saved["geometry"], {k: float(v) for k, v in saved["peak_torque"].items()}
    except InvalidInput:
        raise
    except (KeyError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise InvalidInput(
            f"{file}: not a plan that `crossing plan --out` wrote ({type(error).__name__}: {error}); "
            f"plan again"
        ) from None
    try:
        dynamics = inverse_dynamics(robot, path, law, geometry=geometry)
    except NoAnswer as error:
        raise InvalidInput(
            f"{file}: the robot has changed since, its law fits no more; plan again ({error})"
        ) from None
    crossings = reported_crossings(dynamics, law)
    # the degree of a polynomial counts its conditions
    smoothness = (law.degree + 1 - 3 * len(crossings)) // 2 - 1
    if isinstance(law, OptimalLaw):
        smoothness = law.smoothness
    request = Request(path=path, duration=law.duration, smoothness=smoothness, geometry=dynamics.geometry)
    certificate = replace(dynamics.certificate, monotone=law.advance(max(smoothness, 0)) > 0)
    seconds, reason = time.perf_counter() - started, str(saved.get("reason", ""))
    plan = CrossingPlan(robot, request, law, crossings, dynamics, certificate, seconds, reason, optimality)
    largest = max(plan.peak_torque.values())
    for joint, peak in plan.peak_torque.items():
        if not abs(peak - peaks.get(joint, np.inf)) <= SAME * largest:
            raise InvalidInput(
                f"{file}: peak torque of {joint}: the file says {peaks.get(joint)}, the robot now needs "
                f"{peak:.9g}: the robot has changed since; plan again"
            )
    return plan


def _law(robot: ParallelRobot, saved: dict[str, Any], duration: float) -> PlannedLaw:
    """The law of plan.json, by its kind; a polynomial if it names none.

    Raises:
        InvalidInput, KeyError, TypeError, ValueError: it is no law.
    """
    check_duration(duration)
    kind = saved.get("kind", Law.kind)
    if kind not in (Law.kind, OptimalLaw.kind):
        raise InvalidInput(choose_from("kind of law", kind, (Law.kind, OptimalLaw.kind)))
    key = "chebyshev" if kind == Law.kind else "squared_speed"
    series = np.array(saved[key], dtype=float)
    if series.ndim != 1 or series.size < 2 or not np.all(np.isfinite(series)):
        raise InvalidInput(f"law: {key} must be a list of finite numbers")
    if kind == Law.kind:
        return Law(series, duration)
    dense_at = tuple(float(sigma) for sigma in saved.get("dense_at", ()))
    return OptimalLaw(series, checked_smoothness(robot, saved["smoothness"]), duration, dense_at)


def read_document(file: FilePath, command: str) -> dict[str, Any]:
    """The JSON object that a command wrote into the folder of --out.

    Raises:
        InvalidInput: there is none.
    """
    complaint = f"{file}: cannot be read; give a folder of `crossing {command} --out`"
    text = read_text(file, complaint, largest=LARGEST_DOCUMENT)
    try:
        saved = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InvalidInput(f"{file}: not JSON ({error})") from None
    if not isinstance(saved, dict):
        raise InvalidInput(f"{file}: must be one JSON object, got {type(saved).__name__}")
    return saved


def _robot(saved: dict[str, Any]) -> ParallelRobot:
    flexibility = saved["flexibility"]
    if flexibility not in FLEXIBILITIES:
        raise ValueError(f"flexibility {flexibility!r}")
    return ParallelRobot.from_description(read_any(robot_file(saved["robot_file"])), flexibility=flexibility)


def _path(file: FilePath, saved: dict[str, Any]) -> Path:
    given = saved["path"]
    if given is None:
        raise InvalidInput(
            f"{file}: path: was not a line, an arc or a spline; such a plan cannot be read back"
        )
    ((kind, points),) = given.items()
    return path_of(kind, points)
