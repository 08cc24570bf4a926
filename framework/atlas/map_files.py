"""A map as files: arrays in map.npz, a table in map.csv, and what they are in map.json.

None of them tells when or how long: the same map gives the same files, byte for byte.
"""

from __future__ import annotations

import csv
import hashlib
import json
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from framework.atlas.quantities import Quantity, unit_of
from framework.atlas.sweep import REASON_WORDS, PoseReason
from framework.atlas.window import Window
from framework.atlas.workspace_map import WorkspaceMap
from framework.kinematics.parallel_robot import ParallelRobot
from framework.statics.loading import LOAD_WORDS, LoadReason

DOCUMENT = "map.json"
PACKAGES = ("parallel-singularity-crossing", "pin", "numpy", "scipy")


def robot_hash(robot: ParallelRobot) -> str:
    """SHA-256 of the robot file and of the URDF that it leads to."""
    found = hashlib.sha256()
    file = robot.description.file
    if file.is_file():
        found.update(file.read_bytes())
    found.update(robot.description.urdf_text.encode())
    return found.hexdigest()


def package_versions() -> dict[str, str]:
    """Return the versions that results depend on, to the last bit."""
    return {package: version(package) for package in PACKAGES}


def map_setup(found: WorkspaceMap) -> dict[str, Any]:
    """Return what a map depends on, a document of JSON."""
    return setup_document(found.robot, found.window, found.quantities)


def setup_document(robot: ParallelRobot, window: Window, quantities: Sequence[Quantity]) -> dict[str, Any]:
    """Return what a map of a robot over a window depends on."""
    names = robot.axis_names
    return {
        "robot": robot.name,
        "robot_hash": robot_hash(robot),
        "platform": robot.description.platform.frame,
        "motors": list(robot.actuator_names),
        "reference": robot.reference.q.tolist(),  # which working mode is mapped
        "flexibility": robot.flexibility,
        "axes": [names[k] for k in window.axes],
        "lower": window.lower.tolist(),
        "upper": window.upper.tolist(),
        "shape": list(window.shape),
        "held": {
            name: float(value)
            for k, (name, value) in enumerate(zip(names, window.held, strict=True))
            if k not in window.axes
        },
        "quantities": [one.key for one in quantities],
        "wrench": next((one.wrench for one in quantities if one.loaded), None),
        "parameters": dict(robot.description.parameters),
        "versions": package_versions(),
    }


def map_document(found: WorkspaceMap) -> dict[str, Any]:
    """Return a summary of a map in numbers, a document of JSON."""
    document = map_setup(found)
    document["working_mode"] = found.working_mode
    document["characteristic_length"] = found.robot.length
    document["poses"] = found.counts
    if found.load is not None:
        document["load"] = found.load_counts
    document["locus"] = {
        "status": found.locus.sentence,
        "traced": not found.locus.why_not,
        "curves": len(found.locus.curves),
        "sign_changes_of_g": found.locus.sign_changes,
        "unexplained_sign_changes": found.locus.unexplained.tolist(),
    }
    document["quantities"] = {
        one.key: {"name": one.name, "unit": unit_of(found.robot, one), **_range(found.values[one.key])}
        for one in found.quantities
    }
    return document


def write_map(found: WorkspaceMap, folder: Path) -> list[Path]:
    """Write map.json, map.npz and map.csv into a folder."""
    files = [folder / DOCUMENT, folder / "map.npz", folder / "map.csv"]
    text = json.dumps(map_document(found), indent=2, allow_nan=False)
    files[0].write_text(text + "\n", encoding="utf-8")
    first, second = found.window.spans
    np.savez_compressed(
        files[1],
        allow_pickle=False,
        setup=np.array(json.dumps(map_setup(found), sort_keys=True)),
        first=first,
        second=second,
        q=found.q,
        reason=found.reason,
        assembly=found.assembly,
        **_locus_arrays(found),
        **({} if found.load is None else {"load": found.load}),
        **found.values,
    )
    with open(files[2], "w", encoding="utf-8", newline="") as stream:
        _write_table(found, stream)
    return files


def _locus_arrays(found: WorkspaceMap) -> dict[str, np.ndarray]:
    """The points of all curves (m, ...), and which curve each belongs to."""
    curves = found.locus.curves
    return {
        "locus": np.concatenate([np.zeros((0, 2)), *(curve.x for curve in curves)]),
        "locus_q": np.concatenate([np.zeros((0, found.q.shape[2])), *(curve.q for curve in curves)]),
        "locus_curve": np.repeat(np.arange(len(curves)), [len(curve.x) for curve in curves]),
    }


def _write_table(found: WorkspaceMap, stream: Any) -> None:
    names = found.robot.axis_names
    keys = [one.key for one in found.quantities]
    columns = [names[k] for k in found.window.axes]
    writer = csv.writer(stream, lineterminator="\n")
    loads = [] if found.load is None else ["load"]
    writer.writerow([*columns, "reached", "assembly_mode", *loads, *keys])
    x = found.window.points()[..., list(found.window.axes)].reshape(-1, 2)
    words = {int(kind): REASON_WORDS[kind] for kind in PoseReason}
    why = [words[kind] for kind in found.reason.ravel().tolist()]
    values = np.stack([found.values[key].ravel() for key in keys], axis=1)
    load = [_load_word(found, k) for k in range(len(x))]
    rows = zip(x.tolist(), why, found.assembly.ravel().tolist(), load, values.tolist(), strict=True)
    writer.writerows([*at, reached, mode or "", *word, *_cells(row)] for at, reached, mode, word, row in rows)


def _load_word(found: WorkspaceMap, k: int) -> list[str]:
    if found.load is None:
        return []
    return [LOAD_WORDS[LoadReason(int(found.load.flat[k]))] if found.reached.flat[k] else ""]


def _cells(row: list[float]) -> list[float | str]:
    return ["" if value != value else value for value in row]


def _range(values: np.ndarray) -> dict[str, float | None]:
    known = values[np.isfinite(values)]
    if not known.size:
        return {"least": None, "median": None, "largest": None}
    return {
        "least": float(known.min()),
        "median": float(np.median(known)),
        "largest": float(known.max()),
    }
