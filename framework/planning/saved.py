"""plan.json: write a plan, and read its request and its law back.

Everything else is computed anew from these two. Geometry, crossings with their condition (8), peak torques,
the goal and whether the law always advances are then compared with the file leaf by leaf, numbers within the
rounding of one table, `_rounding_sizes`. `reason`, `seconds`, and the reference and gap of an optimal law are
taken from the file. The other numbers of the file, such as those of the certificate and of the neglected
effects, must be there, but are not used.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from framework.catalogue import find_entry
from framework.catalogue import robot_file as robot_file_of
from framework.dynamics.inverse_dynamics import check_law, resolve_law
from framework.errors import (
    InvalidInput,
    NoAnswer,
    RobotFileError,
    choose_from,
    finite_numbers,
    real_numbers,
    short,
)
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import Law, PlannedLaw, check_duration
from framework.laws.optimal_law import HIGHEST_SMOOTHNESS, OptimalLaw
from framework.laws.path import Part, Path, PointPath
from framework.model.description import FLEXIBILITIES
from framework.model.documents import prefix_errors
from framework.model.robot_keys import PATHS, select_path
from framework.numerics.fields import (
    Field,
    Table,
    anything,
    below,
    list_of,
    mapping,
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
from framework.numerics.output import Document, json_text, plain, select_fields, write_files
from framework.planning.chain import DepartingCurve, MotionPath, chain_plans
from framework.planning.crossing_points import CrossingTime, path_to_cross
from framework.planning.joint_path import with_platform_joints
from framework.planning.options import OPTIONS
from framework.planning.request import Request, share_load, specification_of
from framework.planning.result import CrossingPlan, Optimality, certified_plan
from framework.planning.scenes import path_of
from framework.singularity.points_on_path import Condition8, search_path
from framework.tolerances import FILE_ROUNDING

FILE = "plan.json"
VERSION = 3  # of plan.json; in earlier versions an optimal law was one Chebyshev series
MAX_COEFFICIENTS = 2000  # of a law, several times as many as any search ends with
MISSING = "nothing"  # in messages, for a value that the file does not have
LAW_KINDS = (Law.kind, OptimalLaw.kind)

# ------------------------------------------------------------------ the keys that are read


def _read_series(where: str, raw: Any) -> tuple[float, ...]:
    """Read the 2 to MAX_COEFFICIENTS coefficients of a law from the raw value at `where` in the file."""
    coefficients = list_of(number)(where, raw)
    if not 2 <= len(coefficients) <= MAX_COEFFICIENTS:
        raise InvalidInput(f"{where}: needs 2 to {MAX_COEFFICIENTS} numbers, got {len(coefficients)}")
    return coefficients


def _read_law(where: str, raw: Any) -> Document:
    """Read the keys of a law at `where` in the file: first its kind, then the keys of this kind."""
    kind = read_table(where, raw, _KIND_TABLE, others=None)["kind"]
    return read_table(where, raw, {**_KIND_TABLE, **_LAW_TABLES[kind]}, others=_DERIVED)


_NUMBERS = list_of(number)
_DERIVED = ("degree", "domain", "turns", "moving")  # keys of a law that follow from others and the request
_KIND_TABLE: Table = {"kind": optional(one_of("kind of law", LAW_KINDS), Law.kind)}
_LAW_TABLES: Mapping[str, Table] = {
    Law.kind: {"chebyshev": required(_read_series)},
    OptimalLaw.kind: {
        "smoothness": required(whole),
        "squared_speed": required(_read_series),
        "cells": required(_NUMBERS),
        "dense_at": required(_NUMBERS),
    },
}
_OPTIMALITY_TABLE: Table = {"reference": required(list_of(positive)), "gap": required(not_negative)}
_CROSSING_TABLE: Table = {"time": required(number), "speed": required(number)}
_CROSSING_KEYS = ("s", "time", "speed", "acceleration", "kind", "twist", "platform", "residual")
# keys that must be in the file, whose values are computed anew
_COMPUTED = ("robot", "geometry", "peak_torque", "exceeded", "neglected_friction", "neglected", "certificate")
_PATH_TABLE: Table = {  # a path of a scene, or one of a restarted plan, and the parts taken in turn
    **PATHS,
    "powers": optional(list_of(list_of(number))),
    "chain": optional(record({"plans": required(list_of(mapping)), "leaves": required(list_of(positive))})),
    "parts": optional(list_of(list_of(number)), ()),
}
_PLAN_TABLE: Table = {
    "version": required(whole),
    "robot_file": required(text),
    "parameters": optional(mapping_of(number), {}),
    "flexibility": required(one_of("flexibility", FLEXIBILITIES)),
    "platform_joints": optional(or_null(list_of(text)), None),
    "duration": required(positive),
    "request": required(  # options are checked as those of a call
        record({"path": required(record(_PATH_TABLE)), **{name: Field(anything) for name in OPTIONS}})
    ),
    "law": required(_read_law),
    "crossings": required(list_of(lambda where, raw: read_table(where, raw, _CROSSING_TABLE, others=None))),
    "reason": required(text_or_empty),
    "optimality": required(
        or_null(lambda where, raw: read_table(where, raw, _OPTIMALITY_TABLE, others=("optimize",)))
    ),
    "seconds": required(not_negative),
    "motor_use": optional(anything),  # not in plans of version 0.8
    **dict.fromkeys(_COMPUTED, required(anything)),
}

# ------------------------------------------------------------------ writing


def save_plan(plan: CrossingPlan, folder: str | os.PathLike[str]) -> FilePath:
    """Write plan.json into a folder, for `load_plan`, and return the file.

    Raises:
        InvalidInput: see `plan_document`.
        OutputError: it cannot be written.
    """
    file = FilePath(folder) / FILE
    write_files({file: json_text(plan_document(plan, file.parent))}, option="save_plan", overwrite=True)
    return file


def plan_document(plan: CrossingPlan, folder: FilePath | None = None) -> Document:
    """Return the content of plan.json, SI units.

    Args:
        folder: the folder of the file; the path of the robot file is then relative to it if possible.

    Raises:
        InvalidInput: the path or the law is a user's own function, or the robot a model in memory, which
            cannot be written.
    """
    robot = plan.robot
    if not robot.description.file.exists():
        raise InvalidInput(
            f"robot: only a robot of a file can be written down, and {robot.name} has none, such as one of a "
            f"pinocchio model in memory; save the motion with plan.to_csv"
        )
    best = plan.optimality  # None for a polynomial
    optimality = None
    if best is not None:
        optimality = {"optimize": best.specification.goal, "reference": best.reference, "gap": best.gap}
    document: Document = plain(
        {
            "version": VERSION,
            "robot": robot.name,
            "robot_file": robot_name_or_file(robot, folder),
            "parameters": robot.description.parameters,
            "flexibility": robot.flexibility,
            "platform_joints": robot.description.platform.joints or None,
            "geometry": plan.geometry,
            "duration": plan.duration,
            "request": {
                "path": _path_document(plan.path, folder),
                **select_fields(plan.request, *OPTIONS),
            },
            **_compared_document(plan),
            "exceeded": plan.exceeded,
            "motor_use": [use._asdict() for use in plan.motor_use],
            "neglected_friction": plan.neglected_friction,
            "neglected": [effect._asdict() for effect in plan.neglected],
            "certificate": asdict(plan.certificate),
            "reason": plan.reason,
            "optimality": optimality,
            "seconds": plan.seconds,
        }
    )
    for crossing, loaded in zip(document["crossings"], plan.loaded_points, strict=True):
        crossing["loaded"] = None if loaded is None else {"s": loaded.s, "distance": loaded.distance}
    return document


def robot_name_or_file(robot: ParallelRobot, folder: FilePath | None = None) -> str:
    """Return the robot's catalogue name, or else the path of its file.

    The path is relative to `folder` if possible, and absolute without a folder. A relative path begins with a
    folder, such as `.`, so that it is no catalogue name.
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


def _path_document(path: Path, folder: FilePath | None) -> Document:
    """Return a path as a document: points, powers of s, or the plans of a chain, and the part it is of these.

    Raises:
        InvalidInput: the path is a user's own function.
    """
    if isinstance(path, Part):
        whole = _path_document(path.path, folder)
        return {**whole, "parts": [*whole.get("parts", []), [path.start, path.end]]}
    if isinstance(path, DepartingCurve):
        return {"powers": path.powers}
    if isinstance(path, MotionPath):
        plans = [plan_document(plan, folder) for plan in path.plans]
        return {"chain": {"plans": plans, "leaves": path.leaves}}
    if not isinstance(path, PointPath):
        raise InvalidInput(
            f"path: only lines, arcs, splines and polylines can be written down, not {type(path).__name__}; "
            f"save the motion with plan.to_csv"
        )
    blend = {} if path.blend is None else {"blend": path.blend}
    return {path.kind: path.points, **blend}


# ------------------------------------------------------------------ reading

# `stated` has the checked values of plan.json, by key, or those of the key that a function is named after.


def is_plan_folder(name: str) -> bool:
    """Return whether a folder of this name has a plan.json."""
    return os.path.isfile(os.path.join(name, FILE))


def load_plan(folder: str | FilePath, *, robot_file: str | FilePath | None = None) -> CrossingPlan:
    """Return the plan of a folder written by `crossing plan --out` or `save_plan`.

    Request, law, reason and seconds are those of the file. Crossings, torques and certificate are computed
    anew from the law. For a rigid robot the numbers are the same. For a deformed robot, whose deflections
    start from another guess, they agree to the accuracy of the certificate.

    Args:
        robot_file: the robot file, or its catalogue name, if the file has moved since.

    Raises:
        InvalidInput: there is no plan.json, it has another version or lacks a key, or its robot has changed
            since.
        RobotFileError: the robot file is missing or broken.
    """
    file = FilePath(folder) / FILE
    return plan_from_document(read_document(file, "plan"), file, robot_file=robot_file)


def plan_from_document(
    saved: Document, file: FilePath, *, robot_file: str | FilePath | None = None
) -> CrossingPlan:
    """Return the plan from the content `saved` of its plan.json.

    Args:
        file: the plan.json, for messages; paths in it are relative to its folder.
        robot_file: the robot file, or its catalogue name, if the file has moved since.

    Raises:
        InvalidInput, RobotFileError: see `load_plan`.
    """
    # robot, request and law of the file
    if saved.get("version") != VERSION:
        raise InvalidInput(
            f"{file}: version: this program reads plans of version {VERSION}, got "
            f"{short(saved['version']) if 'version' in saved else 'none, as before version 2'}; plan again"
        )
    with prefix_errors(file, InvalidInput):
        stated = read_table("", saved, _PLAN_TABLE, others=("bend", "fidelity", "robust"))  # of commands
    robot = _find_robot(stated, file, robot_file)
    stated_path = stated["request"].pop("path")
    plans = () if stated_path["chain"] is None else stated_path["chain"]["plans"]
    chained = [plan_from_document(plan, file, robot_file=robot_file) for plan in plans]
    with prefix_errors(file, InvalidInput):
        path = _make_path(stated_path, chained)
        with prefix_errors("request", InvalidInput):
            request = Request.of(robot, path, **stated["request"])
        if request.duration not in (None, stated["duration"]):
            raise InvalidInput(
                f"duration: got {stated['duration']!r}, but the request says {request.duration!r}"
            )
        law = _make_law(stated["law"], stated["duration"], request)
        if isinstance(path, MotionPath) and law.degree == 1:  # that of a chain alone
            plan = chain_plans(path.plans, path.leaves[:-1])
            _check_plan(saved, plan)
            return replace(plan, seconds=stated["seconds"])
        best, optimality = stated["optimality"], None
        if (best is None) != (law.kind == Law.kind):  # a polynomial has none, every other law has one
            raise InvalidInput(f"optimality: got {short(best)} with a {law.kind} law")
        if best is not None:
            reference = finite_numbers("optimality.reference", best["reference"], robot.n_a)
            optimality = Optimality(specification_of(robot, request), reference, best["gap"])
        check_law(law)

    # the plan computed anew, which must agree with the file
    try:
        to_cross = path_to_cross(search_path(robot, request.path), request)
        dynamics = resolve_law(to_cross.searched, law, **request.model_options)
        dynamics = share_load(dynamics, request, optimal=law.kind == OptimalLaw.kind)
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
        _check_plan(saved, plan)
    return replace(plan, seconds=stated["seconds"])


def read_document(file: FilePath, command: str) -> Document:
    """Return the JSON object in a file that a `crossing` command with --out has written.

    Args:
        command: name of that command, for messages.

    Raises:
        InvalidInput: the file cannot be read, or is no JSON object.
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
    """Load the robot that plan.json states, or the one of `robot_file` if given.

    The stated robot file is relative to the folder of `file`, the plan.json.

    Raises:
        InvalidInput, RobotFileError: the file is missing or broken.
    """
    if robot_file is not None:
        source = robot_file_of(str(robot_file))
    else:
        entry = find_entry(stated["robot_file"])  # None if this is no catalogue name
        source = file.parent / stated["robot_file"] if entry is None else entry.file
        if not os.path.exists(source):
            raise RobotFileError(
                f"{file}: robot_file: there is no {source}; if it has moved, name it again (--robot-file, or "
                f"robot_file= of load_plan)"
            )
    robot = ParallelRobot.from_file(
        source, flexibility=stated["flexibility"], parameters=stated["parameters"]
    )
    joints = stated["platform_joints"]
    return robot if joints is None else with_platform_joints(robot, joints)


def _make_path(stated: Document, chained: Sequence[CrossingPlan]) -> Path:
    """Return the path that plan.json states; that of a chain is the motion of its plans.

    Raises:
        InvalidInput: no path or several, or one that its numbers do not define.
    """
    powers, parts = stated.pop("powers"), stated.pop("parts")
    chain = stated.pop("chain")
    path: Path
    if chain is not None:
        path = MotionPath(tuple(chained), chain["leaves"])
        if not 0 < len(chained) == len(path.leaves):
            raise InvalidInput(f"request.path.chain: needs a leave for each plan, got {len(path.leaves)}")
    elif powers is not None:
        path = DepartingCurve(real_numbers("request.path.powers", powers))
    else:
        path = path_of(*select_path("request.path", stated))
    for part in parts:
        if not (len(part) == 2 and 0.0 <= part[0] < part[1] <= 1.0):
            raise InvalidInput(f"request.path.parts: needs pairs that ascend in [0, 1], got {list(part)}")
        path = Part(path, *part)
    return path


def _make_law(stated: Document, duration: float, request: Request) -> PlannedLaw:
    """Return the law that plan.json states.

    Args:
        stated: values of the part `law`. A polynomial has the key `chebyshev`, the coefficients of s(t). An
            optimal law has its smoothness, and under `squared_speed` the coefficients of z; `dense_at` and
            `cells` are the fields of `OptimalLaw`.
        duration: [s].
        request: the request that the plan answers.

    Raises:
        InvalidInput: the duration is invalid, or the law is less smooth than requested or smoother than
            optimal laws can be.
    """
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
    cells, dense_at = stated["cells"], stated["dense_at"]
    return OptimalLaw(coefficients, smoothness, duration, dense_at, cells, request.ends.moving)


# ------------------------------------------------------------------ comparing


def _compared_document(plan: CrossingPlan) -> Document:
    """Return the part of plan.json that `load_plan` computes anew and compares.

    Raises:
        InvalidInput: the law is of a kind that `load_plan` cannot read.
    """
    if plan.law.kind not in LAW_KINDS:
        raise InvalidInput(
            f"law: {choose_from('kind of law', plan.law.kind, LAW_KINDS)}, in a plan that is saved; "
            f"plan.to_csv saves its motion"
        )
    crossings = []
    for crossing in plan.crossings:
        condition = None if crossing.condition is None else crossing.condition._asdict()
        crossings.append(select_fields(crossing, *_CROSSING_KEYS) | {"condition": condition})
    return {
        "geometry": plan.geometry,
        "duration": plan.duration,
        "law": plan.law.to_dict(),
        "crossings": crossings,
        "peak_torque": plan.peak_torque,
    }


def _rounding_sizes(plan: CrossingPlan) -> Document:
    """Return the sizes of the computed numbers of plan.json, nested as in the file; one for all crossings.

    Differences of FILE_ROUNDING times the size are rounding. Coefficients of condition (8) have the size of
    the largest term of any crossing at s' = 1 / duration and s" = s'^2. A residual consists of rounding, so
    any value agrees. Values that have no size must be equal.
    """
    mean_speed = 1.0 / plan.duration  # [1/s] of s
    # the factors of the coefficients in condition (8), at this speed and acceleration
    factors = Condition8(alpha=mean_speed**2, beta=mean_speed**2, gamma=1.0, delta=mean_speed)
    conditions = [crossing.condition for crossing in plan.crossings if crossing.condition is not None]
    largest_term = np.abs(np.reshape(conditions, (-1, len(factors))) * factors).max(initial=0.0)
    crossing = {
        "s": 1.0,
        "time": plan.duration,
        "speed": mean_speed,
        "acceleration": mean_speed**2,
        "twist": 1.0,
        "platform": plan.robot.length,
        "residual": np.inf,
        "condition": {key: largest_term / factor for key, factor in factors._asdict().items()},
    }
    peak_torque = dict.fromkeys(plan.peak_torque, max(plan.peak_torque.values()))
    return {"crossings": crossing, "peak_torque": peak_torque}


def _check_plan(saved: Document, plan: CrossingPlan) -> None:
    """Refuse a file that contradicts the plan computed anew; name the first such key."""
    document = _compared_document(plan)
    # of certificate and optimality one value each is compared: whether the law always advances, and its goal
    document["certificate"] = {"monotone": plan.certificate.monotone}
    optimality = plan.optimality
    document["optimality"] = None if optimality is None else {"optimize": optimality.specification.goal}
    _check_value("", saved, plain(document), _rounding_sizes(plan))


def _check_value(key: str, stated: Any, computed: Any, size: Any) -> None:
    """Refuse a value of the file that contradicts the computed one, leaf by leaf.

    Args:
        key: of the value in the whole document, such as `crossings[0].condition`.
        size: of a number, which may differ by FILE_ROUNDING times the size, or times the computed number if
            that is larger; None for other values, which must be equal. For a mapping, the sizes of its values
            by key. For a list of mappings, the sizes in any of them.
    """
    if isinstance(computed, Mapping) and isinstance(stated, Mapping):  # key by key
        sizes = size or {}
        for name, part in computed.items():
            _check_value(below(key, name), stated.get(name, MISSING), part, sizes.get(name))
        return
    has_entries = isinstance(computed, list) and all(isinstance(entry, Mapping) for entry in computed)
    if has_entries and isinstance(stated, list):  # mapping by mapping, all with the same sizes
        _check_value(key, len(stated), len(computed), None)
        for k, (stated_entry, entry) in enumerate(zip(stated, computed, strict=True)):
            _check_value(f"{key}[{k}]", stated_entry, entry, size)
        return
    is_leaf = not isinstance(computed, Mapping) and not has_entries
    agrees = is_leaf and bool(stated == computed)
    if is_leaf and size is not None and computed is not None and not agrees:
        with suppress(InvalidInput):  # no numbers
            numbers = real_numbers("", stated)
            allowed = FILE_ROUNDING * np.maximum(size, np.abs(computed))
            agrees = numbers.shape == allowed.shape and bool(np.all(np.abs(numbers - computed) <= allowed))
    if not agrees:
        raise InvalidInput(
            f"{key}: the file says {short(stated)}, the robot now needs {short(computed)}: the robot has "
            f"changed since; plan again"
        )
