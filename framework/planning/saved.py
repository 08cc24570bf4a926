"""plan.json: a plan written down, and read back for its request and its law.

Everything else is computed anew from these two. Geometry, crossings with their condition (8), peak torques,
the goal and whether the platform always advances are compared with the file, numbers by the table of
`_rounding_sizes`. The file is believed for `reason`, `seconds`, and the reference and gap of an optimal law;
its other numbers, as those of the certificate and of what is left out, are not used.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from framework.catalogue import find_entry
from framework.catalogue import robot_file as robot_file_of
from framework.dynamics.inverse_dynamics import check_law, resolve_law
from framework.errors import InvalidInput, NoAnswer, RobotFileError, choose_from, finite_numbers, short
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import Law, PlannedLaw, check_duration
from framework.laws.optimal_law import HIGHEST_SMOOTHNESS, OptimalLaw
from framework.laws.path import PointPath
from framework.model.description import FLEXIBILITIES
from framework.model.documents import prefix_errors
from framework.model.robot_keys import PATHS, select_path
from framework.numerics.fields import (
    Field,
    Table,
    anything,
    below,
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
    text,
    text_or_empty,
    whole,
)
from framework.numerics.input import read_text
from framework.numerics.output import Document, json_text, plain, select_fields, write_file
from framework.planning.crossing_points import path_to_cross
from framework.planning.options import OPTIONS
from framework.planning.request import Request
from framework.planning.result import CrossingPlan, Optimality, certified_plan
from framework.planning.scenes import path_of
from framework.planning.specification import specification_of
from framework.planning.timing import CrossingTime
from framework.singularity.points_on_path import search_path
from framework.tolerances import FILE_ROUNDING

FILE = "plan.json"
VERSION = 3  # of plan.json; before, an optimal law was one Chebyshev series
LAW_KINDS = (Law.kind, OptimalLaw.kind)

# ------------------------------------------------------------------ the keys that are read


def _read_series(where: str, given: Any) -> tuple[float, ...]:
    """Read the coefficients of a law, of which even the slowest has two."""
    coefficients = list_of(number)(where, given)
    if len(coefficients) < 2:
        raise InvalidInput(f"{where}: needs at least two numbers, got {len(coefficients)}")
    return coefficients


def _read_law(where: str, given: Any) -> Document:
    """Read the keys of a law by its kind."""
    kind = read_table(where, given, _KIND, others=None)["kind"]
    return read_table(where, given, {**_KIND, **_LAWS[kind]}, others=("degree", "domain", "turns"))


_NUMBERS = list_of(number)
_KIND: Table = {"kind": optional(one_of("kind of law", LAW_KINDS), Law.kind)}
_LAWS: Mapping[str, Table] = {
    Law.kind: {"chebyshev": required(_read_series)},
    OptimalLaw.kind: {
        "smoothness": required(whole),
        "squared_speed": required(_read_series),
        "cells": required(_NUMBERS),
        "dense_at": required(_NUMBERS),
    },
}
_OPTIMALITY: Table = {"reference": required(list_of(positive)), "gap": required(not_negative)}
_TIME: Table = {"time": required(number), "speed": required(number)}
_READ: Table = {
    "version": required(whole),
    "robot_file": required(text),
    "parameters": optional(mapping_of(number), {}),
    "flexibility": required(one_of("flexibility", FLEXIBILITIES)),
    "duration": required(positive),
    "request": required(  # options are checked as those of a call
        record({"path": required(record(PATHS, select_path)), **{name: Field(anything) for name in OPTIONS}})
    ),
    "law": required(_read_law),
    "crossings": required(list_of(lambda where, given: read_table(where, given, _TIME, others=None))),
    "reason": required(text_or_empty),
    "optimality": required(
        or_null(lambda where, given: read_table(where, given, _OPTIMALITY, others=("optimize",)))
    ),
    "seconds": required(not_negative),
}

_COMPUTED = ("robot", "geometry", "peak_torque", "exceeded", "neglected_friction", "neglected", "certificate")

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
    best = plan.optimality
    document: Document = plain(
        {
            "version": VERSION,
            "robot": plan.robot.name,
            "robot_file": robot_name_or_file(plan.robot, folder),
            "parameters": plan.robot.description.parameters,
            "flexibility": plan.robot.flexibility,
            "geometry": plan.geometry,
            "duration": plan.duration,
            "request": _request_document(plan.request),
            **_compared_document(plan),
            "exceeded": plan.exceeded,
            "neglected_friction": plan.neglected_friction,
            "neglected": [effect._asdict() for effect in plan.neglected],
            "certificate": asdict(plan.certificate),
            "reason": plan.reason,
            "optimality": best
            and {"optimize": best.specification.goal, "reference": best.reference, "gap": best.gap},
            "seconds": plan.seconds,
        }
    )
    for crossing, loaded in zip(document["crossings"], plan.loaded_points, strict=True):
        crossing["loaded"] = loaded and {"s": loaded.s, "distance": loaded.distance}
    return document


def robot_name_or_file(robot: ParallelRobot, folder: FilePath | None = None) -> str:
    """Return the robot's catalogue name, or else the path of its file.

    The path is relative to a folder, if one is given.
    """
    name, file = robot.name, robot.description.file
    entry = find_entry(name)
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
        "path": {path.kind: path.points, **blend},
        **select_fields(request, *OPTIONS),
    }


def _law_document(law: object) -> Document:
    """Return the law as a document.

    Refuse a law of a kind that cannot be read again.
    """
    document = law.to_dict() if isinstance(law, PlannedLaw) else {"kind": type(law).__name__}
    kind = document.get("kind", Law.kind)
    if kind not in LAW_KINDS:
        raise InvalidInput(
            f"law: {choose_from('kind of law', kind, LAW_KINDS)}, in a plan that is saved; plan.to_csv "
            f"saves its motion"
        )
    return document


# ------------------------------------------------------------------ reading


def is_plan_folder(name: str) -> bool:
    """Return whether a folder of this name with a plan.json exists."""
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
    with prefix_errors(file, InvalidInput):
        request = _make_request(robot, stated["request"], stated["duration"])
        law = _make_law(stated["law"], stated["duration"], request)
        optimality = _make_optimality(robot, request, stated["optimality"], law.kind)
        check_law(law)
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
            timing=[CrossingTime(**times) for times in stated["crossings"]],
            reason=stated["reason"],
            optimality=optimality,
        )
    except (NoAnswer, InvalidInput) as error:
        raise InvalidInput(
            f"{file}: the robot has changed since, its law fits no more; plan again ({error})"
        ) from None
    with prefix_errors(file, InvalidInput):
        _check_leaves(saved, plan)
    return replace(plan, seconds=stated["seconds"])


def _read_plan(saved: Document, file: FilePath) -> Document:
    """Return the values of plan.json by its keys."""
    if saved.get("version") != VERSION:
        raise InvalidInput(
            f"{file}: version: this program reads plans of version {VERSION}, got "
            f"{short(saved['version']) if 'version' in saved else 'none, as before version 2'}; plan again"
        )
    with prefix_errors(file, InvalidInput):
        return read_table("", saved, _READ, others=(*_COMPUTED, "bend", "fidelity"))  # which commands add


def read_document(file: FilePath, command: str) -> Document:
    """Return the JSON object that a command wrote into the folder of --out.

    Raises:
        InvalidInput: there is none.
    """
    complaint = f"give a folder of `crossing {command} --out`: {file} cannot be read"
    content = read_text(file, complaint, largest=1_000_000_000)  # bytes
    try:
        saved = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise InvalidInput(f"{file}: not JSON ({error})") from None
    if not isinstance(saved, dict):
        raise InvalidInput(f"{file}: must be one JSON object, got {type(saved).__name__}")
    return saved


def _find_robot(stated: Document, file: FilePath, robot_file: str | FilePath | None) -> ParallelRobot:
    """Load the robot of a plan, or of `robot_file` if given."""
    if robot_file is not None:
        found = robot_file_of(str(robot_file))
    else:
        entry = find_entry(stated["robot_file"])
        found = file.parent / stated["robot_file"] if entry is None else entry.file
        if not os.path.exists(found):
            raise RobotFileError(
                f"{file}: robot_file: there is no {found}; if it has moved, name it again (--robot-file, or "
                f"robot_file= of load_plan)"
            )
    return ParallelRobot.from_file(found, flexibility=stated["flexibility"], parameters=stated["parameters"])


def _make_request(robot: ParallelRobot, stated: Document, duration: float) -> Request:
    """Return the request of the file, checked for robot and duration [s]."""
    path = path_of(*stated.pop("path"))
    with prefix_errors("request", InvalidInput):
        request = Request.of(robot, path, **stated)
    if request.duration not in (None, duration):
        raise InvalidInput(f"duration: got {duration!r}, but the request says {request.duration!r}")
    return request


def _make_law(stated: Document, duration: float, request: Request) -> PlannedLaw:
    """Return the law of the file, of a duration [s]."""
    check_duration(duration)
    if stated["kind"] == Law.kind:
        return Law(np.array(stated["chebyshev"]), duration)
    smoothness = stated["smoothness"]
    if not request.smoothness <= smoothness <= HIGHEST_SMOOTHNESS:
        raise InvalidInput(
            f"law.smoothness: got {smoothness}, but the request says {request.smoothness} (at most "
            f"{HIGHEST_SMOOTHNESS})"
        )
    coefficients = np.array(stated["squared_speed"])
    return OptimalLaw(coefficients, smoothness, duration, stated["dense_at"], stated["cells"])


def _make_optimality(
    robot: ParallelRobot, request: Request, stated: Document | None, kind: str
) -> Optimality | None:
    """Return the stated optimality of a law; None of a polynomial."""
    if (stated is None) != (kind == Law.kind):
        raise InvalidInput(f"optimality: got {short(stated)} with a {kind} law")
    if stated is None:
        return None
    reference = finite_numbers("optimality.reference", stated["reference"], robot.n_a)
    return Optimality(specification_of(robot, request), reference, stated["gap"])


# ------------------------------------------------------------------ comparing


def _compared_document(plan: CrossingPlan) -> Document:
    """Return the part of plan.json that is computed anew and compared as a whole."""
    crossings = [
        vars(crossing) | {"condition": crossing.condition and crossing.condition._asdict()}
        for crossing in plan.crossings
    ]
    return {
        "geometry": plan.geometry,
        "duration": plan.duration,
        "law": _law_document(plan.law),
        "crossings": crossings,
        "peak_torque": plan.peak_torque,
    }


def _rounding_sizes(plan: CrossingPlan) -> dict[str, float]:
    """Return the size of each computed number of plan.json, by key.

    FILE_ROUNDING of that is rounding. Coefficients of condition (8) have the size of its largest term at s' =
    1 / duration and s" = s'^2. A residual is rounding itself.
    """
    pace = 1.0 / plan.duration
    rates = {"alpha": pace**2, "beta": pace**2, "gamma": 1.0, "delta": pace}
    sizes = dict.fromkeys(
        (f"peak_torque.{joint}" for joint in plan.peak_torque), max(plan.peak_torque.values())
    )
    for k, crossing in enumerate(plan.crossings):
        condition = crossing.condition
        terms = [abs(value) * rates[key] for key, value in condition._asdict().items()] if condition else []
        of_crossing = {
            "s": 1.0,
            "time": plan.duration,
            "speed": pace,
            "acceleration": pace**2,
            "twist": 1.0,
            "platform": plan.robot.length,
            "residual": np.inf,
            **{f"condition.{key}": max(terms, default=0.0) / rate for key, rate in rates.items()},
        }
        sizes |= {f"crossings[{k}].{key}": size for key, size in of_crossing.items()}
    return sizes


def _check_leaves(saved: Document, plan: CrossingPlan) -> None:
    """Refuse a file that contradicts the plan computed anew.

    Raises InvalidInput with the key.
    """
    document, best = _compared_document(plan), plan.optimality
    document["certificate"] = {"monotone": plan.certificate.monotone}
    document["optimality"] = best and {"optimize": best.specification.goal}
    stated, sizes = dict(_yield_leaves(saved)), _rounding_sizes(plan)
    for key, computed in _yield_leaves(plain(document)):
        if key not in stated or not _values_agree(stated[key], computed, sizes.get(key)):
            raise InvalidInput(
                f"{key}: the file says {short(stated.get(key, 'nothing'))}, the robot now needs "
                f"{short(computed)}: the robot has changed since; plan again"
            )


def _yield_leaves(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the key and the value of each leaf of a document.

    A list of mappings also has its length.
    """
    if isinstance(value, Mapping):
        for name, part in value.items():
            yield from _yield_leaves(part, below(key, name))
    elif isinstance(value, list) and all(isinstance(part, Mapping) for part in value):
        yield key, len(value)
        for k, part in enumerate(value):
            yield from _yield_leaves(part, f"{key}[{k}]")
    else:
        yield key, value


def _values_agree(stated: Any, computed: Any, size: float | None) -> bool:
    """Return whether two values agree within rounding of a size.

    The rounding is FILE_ROUNDING of the size, or of the values themselves.
    """
    if size is None or computed is None or stated == computed:
        return bool(stated == computed)
    try:
        numbers = np.array(stated, dtype=float)
    except (TypeError, ValueError, OverflowError):  # no numbers
        return False
    allowed = FILE_ROUNDING * np.maximum(size, np.abs(computed))
    return numbers.shape == allowed.shape and bool(np.all(np.abs(numbers - computed) <= allowed))
