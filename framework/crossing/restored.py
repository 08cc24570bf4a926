"""plan.json read back: a plan whose torques and certificate are computed anew.

The request and the law are those of the file. What the law does must be what the file says: nothing in the
file is believed.
"""

from __future__ import annotations

import json
import os
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from framework.catalogue import catalogue
from framework.catalogue import robot_file as robot_file_of
from framework.crossing.condition import Condition8
from framework.crossing.crossing_points import path_to_cross
from framework.crossing.request import Request
from framework.crossing.result import CrossingPlan, Optimality, certified_plan
from framework.crossing.saved import FILE
from framework.crossing.saved_keys import BESIDE_PLAN, PLAN, VERSION
from framework.crossing.scenes import path_of
from framework.crossing.specification import specification_of
from framework.crossing.timing import CrossingTime
from framework.dynamics.certificate import Certificate
from framework.dynamics.inverse_dynamics import check_law, resolve_law
from framework.errors import InvalidInput, NoAnswer, RobotFileError, finite_numbers, short
from framework.fields import read_table
from framework.input import read_text
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.documents import naming
from framework.motion.law import Law, PlannedLaw, check_duration
from framework.motion.optimal_law import HIGHEST_SMOOTHNESS, OptimalLaw
from framework.singularity.points_on_path import search_path
from framework.tolerances import FILE_ROUNDING

MAX_DOCUMENT_SIZE = 1_000_000_000  # bytes


def is_plan_folder(name: str) -> bool:
    """Whether this is a folder with a plan.json in it."""
    return os.path.isfile(os.path.join(name, FILE))


def load_plan(folder: str | FilePath, *, robot_file: str | FilePath | None = None) -> CrossingPlan:
    """Return the plan of a folder written by `crossing plan --out` or `save_plan`.

    Request, law, reason and seconds are those of the file. Crossings, torques and certificate are computed
    anew from the law: the same numbers again for a rigid robot, equal to the accuracy of the certificate
    for a deformed one, whose deflections then start from another guess.

    Args:
        robot_file: the robot file, or its name in the catalogue, where it is no longer where the plan says.

    Raises:
        InvalidInput: there is no plan.json, it is not one of this version, or its robot has changed since.
        RobotFileError: the robot file is gone or broken.
    """
    file = FilePath(folder) / FILE
    return restored_plan(read_document(file, "plan"), file, robot_file=robot_file)


def restored_plan(
    saved: dict[str, Any], file: FilePath, *, robot_file: str | FilePath | None = None
) -> CrossingPlan:
    """Return the plan of which `plan_document` gave `saved`.

    Args:
        file: where that stands, for complaints; paths in it are relative to its folder.

    Raises:
        InvalidInput, RobotFileError: see `load_plan`.
    """
    stated = _stated(saved, file)
    robot = _robot(stated, file, robot_file)
    with naming(file, InvalidInput):
        request = _request(robot, stated["request"])
        law = _law(stated, request)
        if stated["geometry"] != request.geometry:
            raise InvalidInput(f"geometry: {stated['geometry']!r}, but the request says {request.geometry!r}")
        optimality = _optimality(stated, robot, request)
        check_law(law)
    timing = [CrossingTime(crossing["time"], crossing["speed"]) for crossing in stated["crossings"]]
    try:
        to_cross = path_to_cross(search_path(robot, request.path), request)
        dynamics = resolve_law(
            to_cross.searched,
            law,
            geometry=request.geometry,
            tolerance=request.tolerance,
            friction=request.friction,
        )
        plan = certified_plan(
            to_cross,
            request,
            dynamics,
            law,
            timing,
            seconds=stated["seconds"],
            reason=stated["reason"],
            optimality=optimality,
        )
    except (NoAnswer, InvalidInput) as error:
        raise InvalidInput(
            f"{file}: the robot has changed since, its law fits no more; plan again ({error})"
        ) from None
    with naming(file, InvalidInput):
        _check_same(stated, plan)
    return plan


def stated_certificate(folder: str | FilePath) -> Certificate:
    """Return the certificate that the plan.json of a folder states; raises InvalidInput as `load_plan`."""
    file = FilePath(folder) / FILE
    certificate: Certificate = _stated(read_document(file, "plan"), file)["certificate"]
    return certificate


def _stated(saved: dict[str, Any], file: FilePath) -> dict[str, Any]:
    """Return the values of plan.json by its keys."""
    if saved.get("version") != VERSION:
        raise InvalidInput(
            f"{file}: version: this program reads plans of version {VERSION}, got "
            f"{short(saved['version']) if 'version' in saved else 'none, as before version 2'}; plan again"
        )
    with naming(file, InvalidInput):
        return read_table("", saved, PLAN, others=BESIDE_PLAN)


def read_document(file: FilePath, command: str) -> dict[str, Any]:
    """Return the JSON object that a command wrote into the folder of --out.

    Raises:
        InvalidInput: there is none.
    """
    complaint = f"give a folder of `crossing {command} --out`: {file} cannot be read"
    text = read_text(file, complaint, largest=MAX_DOCUMENT_SIZE)
    try:
        saved = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InvalidInput(f"{file}: not JSON ({error})") from None
    if not isinstance(saved, dict):
        raise InvalidInput(f"{file}: must be one JSON object, got {type(saved).__name__}")
    return saved


def _robot(stated: dict[str, Any], file: FilePath, named: str | FilePath | None) -> ParallelRobot:
    """Return the robot in the file that is named anew, or else in the one that the plan says."""
    if named is not None:
        return ParallelRobot.from_file(robot_file_of(str(named)), flexibility=stated["flexibility"])
    entries, name = catalogue(), stated["robot_file"]
    place = entries[name].file if name in entries else file.parent / name
    if not os.path.exists(place):
        raise RobotFileError(
            f"{file}: robot_file: there is no {place}; if it has moved, name it again (--robot-file, or "
            f"robot_file= of load_plan)"
        )
    return ParallelRobot.from_file(place, flexibility=stated["flexibility"])


def _request(robot: ParallelRobot, stated: dict[str, Any]) -> Request:
    options = {key: value for key, value in stated.items() if key != "path"}
    with naming("request", InvalidInput):
        return Request.of(robot, path_of(*stated["path"]), **options)


def _law(stated: dict[str, Any], request: Request) -> PlannedLaw:
    """Return the law by its kind; all that the file says of it must be so."""
    duration, saved = stated["duration"], stated["law"]
    check_duration(duration)
    if request.duration not in (None, duration):
        raise InvalidInput(f"duration: got {duration}, but the request says {request.duration}")
    law: PlannedLaw
    if saved["kind"] == Law.kind:
        law = Law(np.array(saved["chebyshev"]), duration)
    else:
        smoothness = saved["smoothness"]
        if not request.smoothness <= smoothness <= HIGHEST_SMOOTHNESS:
            raise InvalidInput(
                f"law.smoothness: got {smoothness}, but the request says {request.smoothness} (at most "
                f"{HIGHEST_SMOOTHNESS})"
            )
        law = OptimalLaw(
            np.array(saved["squared_speed"]), smoothness, duration, saved["dense_at"], saved["cells"]
        )
    for key, value in law.to_dict().items():
        if np.any(saved[key] != np.array(value)):
            raise InvalidInput(f"law.{key}: got {short(saved[key])}, must be {short(value)}")
    return law


def _optimality(stated: dict[str, Any], robot: ParallelRobot, request: Request) -> Optimality | None:
    """Return what an optimal law is best at; None with a polynomial."""
    if (stated["optimality"] is None) != (stated["law"]["kind"] == Law.kind):
        raise InvalidInput(
            f"optimality: got {short(stated['optimality'])} with a {stated['law']['kind']} law"
        )
    if stated["optimality"] is None:
        return None
    goal, reference = stated["optimality"]["optimize"], stated["optimality"]["reference"]
    if goal != request.goal:
        raise InvalidInput(f"optimality.optimize: got {goal!r}, but the request says {request.goal!r}")
    reference = finite_numbers("optimality.reference", reference, robot.n_a)
    return Optimality(specification_of(robot, request), reference, stated["optimality"]["gap"])


def _check_same(saved: dict[str, Any], plan: CrossingPlan) -> None:
    """Raise InvalidInput where a file says other than the plan that was computed anew from it."""
    largest = max(plan.peak_torque.values())
    if saved["peak_torque"].keys() != plan.peak_torque.keys():
        raise _changed("peak_torque", list(saved["peak_torque"]), list(plan.peak_torque))
    for joint, peak in plan.peak_torque.items():
        _check_number(f"peak_torque.{joint}", saved["peak_torque"][joint], peak, largest)
    if len(saved["crossings"]) != len(plan.crossings):
        raise _changed("crossings", len(saved["crossings"]), len(plan.crossings))
    pace = 1.0 / plan.duration
    sizes = {"s": 1.0, "time": plan.duration, "speed": pace, "acceleration": pace**2}
    for k, (stated, crossing) in enumerate(zip(saved["crossings"], plan.crossings, strict=True)):
        where = f"crossings[{k}]"
        if stated["kind"] != crossing.kind:
            raise _changed(f"{where}.kind", stated["kind"], crossing.kind)
        for key, size in sizes.items():
            computed = getattr(crossing, key)
            _check_number(f"{where}.{key}", stated[key], computed, max(size, abs(computed)))
        _check_number(f"{where}.twist", stated["twist"], crossing.twist, 1.0)
        _check_number(f"{where}.platform", stated["platform"], crossing.platform, plan.robot.length)
        if (stated["condition"] is None) != (crossing.condition is None):
            raise _changed(f"{where}.condition", stated["condition"], crossing.condition)
        if crossing.condition is not None:
            for key, (computed, size) in _sizes(crossing.condition, pace).items():
                _check_number(f"{where}.condition.{key}", stated["condition"][key], computed, size)
    if saved["certificate"].monotone is not plan.certificate.monotone:
        raise _changed("certificate.monotone", saved["certificate"].monotone, plan.certificate.monotone)


def _sizes(condition: Condition8, pace: float) -> dict[str, tuple[float, float]]:
    """Return the coefficients by name, each with the size of the largest term at s' = pace, s" = pace^2."""
    rates = {"alpha": pace**2, "beta": pace**2, "gamma": 1.0, "delta": pace}
    largest = max(abs(value) * rates[key] for key, value in condition._asdict().items())
    return {key: (value, largest / rates[key]) for key, value in condition._asdict().items()}


def _check_number(key: str, stated: Any, computed: ArrayLike, size: float) -> None:
    """Raise InvalidInput unless what the file says is within FILE_ROUNDING of its size."""
    values = np.array(stated, dtype=float)
    if values.shape != np.shape(computed) or not np.all(np.abs(values - computed) <= FILE_ROUNDING * size):
        raise _changed(key, stated, computed)


def _changed(key: str, stated: object, computed: object) -> InvalidInput:
    return InvalidInput(
        f"{key}: the file says {stated}, the robot now needs {computed}: the robot has changed since; plan "
        f"again"
    )
