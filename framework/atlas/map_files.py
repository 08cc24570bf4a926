"""A map as files: arrays in map.npz, a table in map.csv, settings and a summary in map.json.

The files contain no dates or durations, so the same map gives the same files, byte for byte.
"""

from __future__ import annotations

import csv
import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from framework.atlas.quantities import Quantity, find_wrench, quantity_unit, softest_directions
from framework.atlas.survey import Window
from framework.atlas.workspace_map import WorkspaceMap
from framework.dynamics.loading import LOAD_WORDS, LoadReason
from framework.dynamics.stiffness import direction_in_words
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.output import json_text, package_versions

DOCUMENT = "map.json"
STATISTICS = ("least", "median", "largest")  # of a quantity over the map


def robot_hash(robot: ParallelRobot) -> str:
    """Return the SHA-256 hash of the robot file together with its URDF."""
    file = robot.description.file
    robot_file = file.read_bytes() if file.is_file() else b""
    return hashlib.sha256(robot_file + robot.description.urdf_text.encode()).hexdigest()


def map_setup(workspace: WorkspaceMap) -> dict[str, Any]:
    """Return the settings of a finished map, as a document of JSON."""
    setup = setup_document(workspace.robot, workspace.window, workspace.quantities)
    return setup | {"keep_limits": workspace.keeps_limits}


def setup_document(robot: ParallelRobot, window: Window, quantities: Sequence[Quantity]) -> dict[str, Any]:
    """Return the settings of a map over a window, as a document of JSON."""
    names = robot.axis_names
    constants = window.constants.tolist()
    return {
        "robot": robot.name,
        "robot_hash": robot_hash(robot),
        "platform": robot.description.platform.frame,
        "motors": list(robot.actuator_names),
        "reference": robot.reference.q.tolist(),  # determines the working mode
        "flexibility": robot.flexibility,
        "axes": [names[k] for k in window.axes],
        "lower": window.lower.tolist(),
        "upper": window.upper.tolist(),
        "shape": list(window.shape),
        # coordinates that are constant over the map
        "held": {names[k]: constants[k] for k in range(robot.n) if k not in window.axes},
        "quantities": [quantity.key for quantity in quantities],
        "wrench": find_wrench(quantities),
        "parameters": dict(robot.description.parameters),
        "versions": package_versions(),
    }


def map_document(workspace: WorkspaceMap) -> dict[str, Any]:
    """Return the settings and results of a map in numbers, as a document of JSON."""
    document = map_setup(workspace) | {
        "working_mode": workspace.working_mode,
        "characteristic_length": workspace.robot.length,
        "poses": workspace.counts,
        "open_edges": list(workspace.open_edges),
    }
    if workspace.load is not None:
        document["load"] = workspace.load_counts
    # a change of sign between neighbours that no traced curve explains may be a missing part of the locus
    document["locus"] = {
        "status": workspace.locus_sentence,
        "traced": not workspace.locus.why_not,
        "curves": len(workspace.locus.curves),
        "kinds": [curve.kind for curve in workspace.locus.curves],
        "sign_changes_of_g": workspace.locus.sign_changes,
        "unexplained_sign_changes": workspace.locus.unexplained.tolist(),
    }
    document["quantities"] = {
        quantity.key: {
            "name": quantity.name,
            "unit": quantity_unit(workspace.robot, quantity),
            **value_range(workspace.values[quantity.key]),
            **_describe_softest(workspace, quantity),
        }
        for quantity in workspace.quantities
    }
    return document


def _describe_softest(workspace: WorkspaceMap, quantity: Quantity) -> dict[str, Any]:
    """Say where a stiffness is least, and in which direction; empty for other quantities."""
    robot, values = workspace.robot, workspace.values[quantity.key]
    if not quantity.softest or not np.isfinite(values).any():
        return {}
    row, column = np.unravel_index(np.nanargmin(values), values.shape)
    window = workspace.window
    x = window.constants.copy()
    x[list(window.axes)] = [span[k] for span, k in zip(window.spans, (row, column), strict=False)]
    (twist,) = softest_directions(robot, quantity, workspace.q[row, column][None])
    words = direction_in_words(robot.axis_names, twist)
    return {"softest": {"place": robot.place(x), "direction": twist.tolist(), "words": words}}


def write_map(workspace: WorkspaceMap, folder: Path) -> list[Path]:
    """Write map.json, map.npz and map.csv into a folder; return the files."""
    spans = workspace.window.spans
    curves = workspace.locus.curves
    # empty arrays, so that a locus without curves is stored with the same number of columns
    no_x = np.zeros((0, len(spans)))  # points of curves are over the coordinates of the map
    no_q = np.zeros((0, workspace.q.shape[2]))
    arrays = {
        **dict(zip(("first", "second"), spans, strict=False)),
        "q": workspace.q,
        "reason": workspace.reason,
        "reason_words": np.array(workspace.reason_words),
        "assembly": workspace.assembly,
        "locus": np.concatenate([no_x, *(curve.x for curve in curves)]),
        "locus_q": np.concatenate([no_q, *(curve.q for curve in curves)]),
        "locus_curve": np.repeat(np.arange(len(curves)), [len(curve.x) for curve in curves]),
        **({} if workspace.load is None else {"load": workspace.load}),
        **workspace.values,
    }
    # the columns of the table by name, with one entry per pose
    points = workspace.window.points()  # (I, J, n)
    columns: dict[str, list[Any]] = {
        workspace.robot.axis_names[k]: points[..., k].ravel().tolist() for k in workspace.window.axes
    }
    columns["reached"] = [workspace.reason_words[code] for code in workspace.reason.flat]
    # 0 of poses that are not reached becomes an empty cell
    columns["assembly_mode"] = [mode or "" for mode in workspace.assembly.ravel().tolist()]
    if workspace.load is not None:
        words = np.array([LOAD_WORDS[kind] for kind in LoadReason])
        columns["load"] = np.where(workspace.reached, words[workspace.load], "").ravel().tolist()
    for quantity in workspace.quantities:
        columns[quantity.key] = table_cells(workspace.values[quantity.key])
    table = list(columns.items())
    document = map_document(workspace)
    setup = map_setup(workspace)
    return write_document_and_arrays(folder / DOCUMENT, document, setup, arrays, table)


def write_document_and_arrays(
    file: Path,
    document: Mapping[str, Any],
    setup: Mapping[str, Any],
    arrays: Mapping[str, np.ndarray],
    table: Sequence[tuple[str, Sequence[Any]]],
) -> list[Path]:
    """Write a document, and with the same stem its arrays (.npz) and a table of columns (.csv).

    Args:
        file: of the document, JSON.
        setup: settings, stored as JSON text in the array `setup`.
        table: names and cells of the columns.

    Returns:
        The three files.
    """
    array_file = file.with_suffix(".npz")
    table_file = file.with_suffix(".csv")
    file.write_text(json_text(document), encoding="utf-8")
    setup_text = np.array(json.dumps(setup, sort_keys=True))
    np.savez_compressed(array_file, allow_pickle=False, setup=setup_text, **arrays)
    with open(table_file, "w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        names, columns = zip(*table, strict=True)
        writer.writerow(names)
        writer.writerows(zip(*columns, strict=True))
    return [file, array_file, table_file]


def table_cells(values: np.ndarray) -> list[Any]:
    """Return numbers (...) as a list of table cells, empty for NaN."""
    return ["" if math.isnan(value) else value for value in values.ravel().tolist()]


def value_range(values: np.ndarray) -> dict[str, float | None]:
    """Return the `STATISTICS` of the finite values, by name; None if no value is finite."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return dict.fromkeys(STATISTICS)
    numbers = map(float, (finite.min(), np.median(finite), finite.max()))  # in the order of STATISTICS
    return dict(zip(STATISTICS, numbers, strict=True))
