"""plan.json: a plan written down, and read back for its request and its law.

Crossings, torques and certificate are computed anew from the law and compared with the file, value by value:
nothing in the file is believed.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from framework.catalogue import catalogue
from framework.catalogue import robot_file as robot_file_of
from framework.crossing.crossing_points import path_to_cross
from framework.crossing.options import OPTIONS
from framework.crossing.request import Request
from framework.crossing.result import Crossing, CrossingPlan, Optimality, certified_plan
from framework.crossing.scenes import path_of
from framework.crossing.specification import specification_of
from framework.crossing.timing import CrossingTime
from framework.dynamics.inverse_dynamics import GEOMETRIES, check_law, resolve_law
from framework.dynamics.result import Certificate
from framework.errors import InvalidInput, NoAnswer, RobotFileError, choose_from, finite_numbers, short
from framework.fields import (
    Field,
    Table,
    anything,
    list_of,
    mapping_of,
    not_negative,
    number,
    one_of,
    optional,
    or_null,
    positive,
    read_table,
    record,
    required,
    table_of,
    text,
    text_or_empty,
    truth,
    whole,
)
from framework.input import read_text
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.description import FLEXIBILITIES, GOALS
from framework.model.documents import naming
from framework.model.robot_keys import PATHS, one_path
from framework.motion.law import Law, PlannedLaw, check_duration
from framework.motion.optimal_law import HIGHEST_SMOOTHNESS, OptimalLaw
from framework.motion.path import PointPath
from framework.output import Document, json_text, write_file
from framework.singularity.points_on_path import search_path
from framework.tolerances import FILE_ROUNDING

FILE = "plan.json"
VERSION = 3  # of plan.json; before, an optimal law was one Chebyshev series
MAX_DOCUMENT_SIZE = 1_000_000_000  # bytes
LAW_KINDS = (Law.kind, OptimalLaw.kind)

# ------------------------------------------------------------------ the keys


def _read_series(where: str, given: Any) -> tuple[float, ...]:
    """Read the coefficients of a law, of which even the slowest has two."""
    coefficients = list_of(number)(where, given)
    if len(coefficients) < 2:
        raise InvalidInput(f"{where}: needs at least two numbers, got {len(coefficients)}")
    return coefficients


def _read_law(where: str, given: Any) -> Document:
    kind = read_table(where, given, _KIND, others=None)["kind"]
    return read_table(where, given, _LAWS[kind])


_NUMBERS = list_of(number)
_KIND: Table = {"kind": optional(one_of("kind of law", LAW_KINDS), Law.kind)}
_ANY_LAW: Table = {**_KIND, "degree": required(whole), "domain": required(_NUMBERS)}
_LAWS: Mapping[str, Table] = {
    Law.kind: {**_ANY_LAW, "chebyshev": required(_read_series)},
    OptimalLaw.kind: {
        **_ANY_LAW,
        "smoothness": required(whole),
        "squared_speed": required(_read_series),
        "cells": required(_NUMBERS),
        "turns": required(whole),
        "dense_at": required(_NUMBERS),
    },
}
_CERTIFICATE = table_of(Certificate, {"int": whole, "float": not_negative, "bool": truth})
_OPTIMALITY: Table = {
    "optimize": required(one_of("goal", GOALS)),
    "reference": required(list_of(positive)),
    "gap": required(not_negative),
}
_TIME: Table = {"time": required(number), "speed": required(number)}
_READ: Table = {
    "version": required(whole),
    "robot_file": required(text),
    "parameters": optional(mapping_of(number), {}),
    "flexibility": required(one_of("flexibility", FLEXIBILITIES)),
    "geometry": required(one_of("geometry", GEOMETRIES)),
    "duration": required(positive),
    "request": required(  # options are checked as those of a call
        record({"path": required(record(PATHS, one_path)), **{name: Field(anything) for name in OPTIONS}})
    ),
    "law": required(_read_law),
    "crossings": required(list_of(lambda where, given: read_table(where, given, _TIME, others=None))),
    "certificate": required(record(_CERTIFICATE, lambda _, values: Certificate(**values))),
    "reason": required(text_or_empty),
    "optimality": required(or_null(record(_OPTIMALITY))),
    "seconds": required(not_negative),
}
_COMPUTED = ("robot", "peak_torque", "exceeded", "neglected_friction", "neglected")
_BESIDE_PLAN = ("bend", "fidelity")  # keys that commands add

# ------------------------------------------------------------------ writing


def save_plan(plan: CrossingPlan, folder: str | FilePath) -> FilePath:
    """Write plan.json into a folder, for `load_plan`, and return the file.

    Raises:
        InvalidInput: see `plan_document`.
        OutputError: it cannot be written.
    """
    file = FilePath(folder) / FILE
    write_file(file, json_text(plan_document(plan, file.parent)), option="save_plan")
    return file


def plan_document(plan: CrossingPlan, folder: FilePath | None = None) -> Document:
    """Return the content of plan.json, SI units.

    Args:
        folder: where the file is to stand; the robot file is then stated relative to it, where it can be.

    Raises:
        InvalidInput: the path or the law is of the user's own making, and cannot be written down.
    """
    best, loaded_points = plan.optimality, plan.loaded_points
    return {
        "version": VERSION,
        "robot": plan.robot.name,
        "robot_file": robot_place(plan.robot, folder),
        "parameters": dict(plan.robot.description.parameters),
        "flexibility": plan.robot.flexibility,
        "geometry": plan.geometry,
        "duration": plan.duration,
        "request": _request_document(plan.request),
        "law": _law_document(plan.law),
        "crossings": [
            _crossing_document(crossing)
            | {"loaded": None if loaded is None else {"s": loaded.s, "distance": loaded.distance}}
            for crossing, loaded in zip(plan.crossings, loaded_points, strict=True)
        ],
        "peak_torque": plan.peak_torque,
        "exceeded": plan.exceeded,
        "neglected_friction": plan.neglected_friction,
        "neglected": [effect._asdict() for effect in plan.neglected],
        "certificate": asdict(plan.certificate),
        "reason": plan.reason,
        "optimality": best
        and {
            "optimize": best.specification.goal,
            "reference": best.reference.tolist(),
            "gap": best.gap,
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


def _request_document(request: Request) -> Document:
    """Return the request as a document: path by its points, and all options."""
    path = request.path
    if not isinstance(path, PointPath):
        raise InvalidInput(
            f"path: only lines, arcs, splines and polylines can be written down, not {type(path).__name__}; "
            f"save the motion with plan.to_csv"
        )
    blend = {} if path.blend is None else {"blend": path.blend}
    return {
        "path": {path.kind: path.points.tolist(), **blend},
        **{name: getattr(request, name) for name in OPTIONS},
    }


def _law_document(law: object) -> Document:
    """Return the law as a document; refuse a law of a kind that cannot be read again."""
    document = law.to_dict() if isinstance(law, PlannedLaw) else {"kind": type(law).__name__}
    kind = document.get("kind", Law.kind)
    if kind not in LAW_KINDS:
        raise InvalidInput(
            f"law: {choose_from('kind of law', kind, LAW_KINDS)}, in a plan that is saved; plan.to_csv "
            f"saves its motion"
        )
    return document


def _crossing_document(crossing: Crossing) -> Document:
    """Return a crossing as a document, arrays as lists."""
    condition = crossing.condition
    return vars(crossing) | {
        "twist": crossing.twist.tolist(),
        "platform": crossing.platform.tolist(),
        "condition": condition and condition._asdict(),
    }


# ------------------------------------------------------------------ reading


def is_plan_folder(name: str) -> bool:
    """Whether a folder of this name with a plan.json exists."""
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
    return plan_from_document(read_document(file, "plan"), file, robot_file=robot_file)


def plan_from_document(
    saved: Document, file: FilePath, *, robot_file: str | FilePath | None = None
) -> CrossingPlan:
    """Return the plan of which `plan_document` gave `saved`.

    Args:
        file: where that stands, for complaints; paths in it are relative to its folder.

    Raises:
        InvalidInput, RobotFileError: see `load_plan`.
    """
    stated = _read_plan(saved, file)
    robot = _find_robot(stated, file, robot_file)
    with naming(file, InvalidInput):
        request = _request(robot, stated["request"])
        _check_request(stated, request)
        law, optimality = _law(stated, request), None
        if stated["optimality"] is not None:
            reference = stated["optimality"]["reference"]
            optimality = Optimality(
                specification_of(robot, request),
                finite_numbers("optimality.reference", reference, robot.n_a),
                stated["optimality"]["gap"],
            )
        check_law(law)
    timing = [CrossingTime(**times) for times in stated["crossings"]]
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
        _check_same(saved, plan)
    return plan


def stated_certificate(folder: str | FilePath) -> Certificate:
    """Return the certificate that the plan.json of a folder states; raises InvalidInput as `load_plan`."""
    file = FilePath(folder) / FILE
    certificate: Certificate = _read_plan(read_document(file, "plan"), file)["certificate"]
    return certificate


def _read_plan(saved: Document, file: FilePath) -> Document:
    """Return the values of plan.json by its keys."""
    if saved.get("version") != VERSION:
        raise InvalidInput(
            f"{file}: version: this program reads plans of version {VERSION}, got "
            f"{short(saved['version']) if 'version' in saved else 'none, as before version 2'}; plan again"
        )
    with naming(file, InvalidInput):
        return read_table("", saved, _READ, others=(*_COMPUTED, *_BESIDE_PLAN))


def read_document(file: FilePath, command: str) -> Document:
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


def _find_robot(stated: Document, file: FilePath, robot_file: str | FilePath | None) -> ParallelRobot:
    """Load the robot of `robot_file` if given, else of the file that the plan states."""
    if robot_file is not None:
        place = robot_file_of(str(robot_file))
    else:
        entries, name = catalogue(), stated["robot_file"]
        place = entries[name].file if name in entries else file.parent / name
        if not os.path.exists(place):
            raise RobotFileError(
                f"{file}: robot_file: there is no {place}; if it has moved, name it again (--robot-file, or "
                f"robot_file= of load_plan)"
            )
    return ParallelRobot.from_file(place, flexibility=stated["flexibility"], parameters=stated["parameters"])


def _request(robot: ParallelRobot, stated: Document) -> Request:
    """Return the request of the file, checked for the robot."""
    path = stated.pop("path")
    with naming("request", InvalidInput):
        return Request.of(robot, path_of(*path), **stated)


def _check_request(stated: Document, request: Request) -> None:
    """Raise InvalidInput where the file contradicts its request."""
    check_duration(stated["duration"])
    kind, optimality = stated["law"]["kind"], stated["optimality"]
    if (optimality is None) != (kind == Law.kind):
        raise InvalidInput(f"optimality: got {short(optimality)} with a {kind} law")
    values: list[tuple[str, object, object]] = [("geometry", stated["geometry"], request.geometry)]
    if request.duration is not None:
        values.append(("duration", stated["duration"], request.duration))
    if optimality is not None:
        values.append(("optimality.optimize", optimality["optimize"], request.goal))
    for key, value, requested in values:
        if value != requested:
            raise InvalidInput(f"{key}: got {value!r}, but the request says {requested!r}")


def _law(stated: Document, request: Request) -> PlannedLaw:
    """Return the law by its kind; raise InvalidInput where its keys contradict the law."""
    duration, saved = stated["duration"], stated["law"]
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
        if saved[key] != (tuple(value) if isinstance(value, list) else value):
            raise InvalidInput(f"law.{key}: got {short(saved[key])}, must be {short(value)}")
    return law


def _check_same(saved: Document, plan: CrossingPlan) -> None:
    """Raise InvalidInput where a file contradicts the plan that was computed anew."""
    peaks = dict.fromkeys(plan.peak_torque, max(plan.peak_torque.values()))
    _compare("peak_torque", saved.get("peak_torque"), plan.peak_torque, peaks)
    if len(saved["crossings"]) != len(plan.crossings):
        raise _mismatch("crossings", len(saved["crossings"]), len(plan.crossings))
    for k, (one, crossing) in enumerate(zip(saved["crossings"], plan.crossings, strict=True)):
        computed = _crossing_document(crossing)
        _compare(f"crossings[{k}]", one, computed, _crossing_sizes(computed["condition"], plan))
    _compare("certificate.monotone", saved["certificate"]["monotone"], plan.certificate.monotone, None)


def _crossing_sizes(condition: dict[str, float] | None, plan: CrossingPlan) -> Document:
    """Return the size of each number of a crossing; differences up to FILE_ROUNDING of the size pass.

    Coefficients have the size of the largest term of condition (8) at s' = 1 / duration and s" = s'^2.
    """
    pace = 1.0 / plan.duration
    rates = {"alpha": pace**2, "beta": pace**2, "gamma": 1.0, "delta": pace}
    term = max(abs(value) * rates[key] for key, value in condition.items()) if condition else 0.0
    return {
        "kind": None,
        "s": 1.0,
        "time": plan.duration,
        "speed": pace,
        "acceleration": pace**2,
        "twist": 1.0,
        "platform": plan.robot.length,
        "condition": {key: term / rate for key, rate in rates.items()},
    }


def _compare(key: str, stated: Any, computed: Any, size: Any) -> None:
    """Raise InvalidInput unless values agree: mappings key by key, numbers within rounding of their size."""
    if all(isinstance(value, dict) for value in (size, stated, computed)) and size.keys() <= stated.keys():
        for name, its_size in size.items():
            _compare(f"{key}.{name}", stated[name], computed[name], its_size)
        return
    is_same = stated == computed
    if not (is_same or size is None or isinstance(size, dict) or computed is None):
        try:
            values, sizes = np.array(stated, dtype=float), np.maximum(size, np.abs(computed))
            gaps = np.abs(values - computed) if values.shape == sizes.shape else np.inf
            is_same = bool(np.all(gaps <= FILE_ROUNDING * sizes))
        except (TypeError, ValueError, OverflowError):  # no numbers
            pass
    if not is_same:
        raise _mismatch(key, stated, computed)


def _mismatch(key: str, stated: object, computed: object) -> InvalidInput:
    """Return the error for a value of the file that the robot contradicts."""
    return InvalidInput(
        f"{key}: the file says {stated}, the robot now needs {computed}: the robot has changed since; plan "
        f"again"
    )
