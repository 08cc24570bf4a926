"""A study of a robot's dimensions: one small map for each set of its named parameters, told by a few numbers.

The sets are the grid of all values that the robot file declares, or the rows of a table. They go out in
chunks of `DESIGNS_PER_TASK`, here or through any `concurrent.futures.Executor`; a set that makes no robot is
told why, and the others go on.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from framework.arrays import Array, ReadOnlyArrays
from framework.atlas.map_files import package_versions
from framework.atlas.quantities import QUANTITIES, choose_quantities, unit_of
from framework.atlas.survey import survey_window
from framework.atlas.window import Window, map_axes
from framework.atlas.workspace_map import WorkspaceMap, workspace_map
from framework.errors import FrameworkError, InvalidInput, choose_from
from framework.input import read_text
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.parameters import declared_parameters
from framework.output import json_text
from framework.parallel.kept import ArrayField, KeptChunks, complete_chunks
from framework.statics.loading import LoadReason

DESIGNS_PER_TASK = 4  # designs of a task
MAX_DESIGNS = 1_000_000  # designs
DOCUMENT = "study.json"
STATISTICS = ("least", "median", "largest")
Chunk = Mapping[str, NDArray[Any]]


class Designs(NamedTuple):
    """Sets of parameters: their names and values (D, P)."""

    names: tuple[str, ...]
    values: Array


class StudyTask(NamedTuple):
    """The quantities to be computed of each design."""

    file: str
    names: tuple[str, ...]
    flexibility: str
    axes: tuple[str, str]
    window: (
        tuple[float, ...] | None
    )  # least and largest of the first axis, then of the second; None: its reach
    size: int
    keys: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class DesignStudy(ReadOnlyArrays):
    """The results of D designs; numbers are NaN for one that makes no robot."""

    task: StudyTask
    designs: Designs
    columns: Mapping[str, Array]  # (D,) see `units`
    units: Mapping[str, str]
    why: tuple[str, ...]  # (D,) empty, or why there is no map


def designs_of(file: str | Path, table: str | Path | None = None) -> Designs:
    """Return the grid of all values that a robot file declares for its parameters, or rows of a CSV table.

    Args:
        table: its first line names parameters, each further one has their values.

    Raises:
        InvalidInput: the file declares no parameters; a table with other names, or what is no number.
    """
    text = read_text(file, f"{file}: cannot read it")
    declared = declared_parameters(text)
    if not declared:
        raise InvalidInput(
            f"{file}: a study needs named parameters in the robot file, such as parameters: "
            f"{{l1: [0.2, 0.3]}}, and ${{l1}} where they count"
        )
    if table is not None:
        return _read_table(Path(table), declared)
    count = math.prod(len(values) for values in declared.values())
    if count > MAX_DESIGNS:
        raise InvalidInput(f"{file}: {count} designs; at most {MAX_DESIGNS} are studied")
    return Designs(tuple(declared), np.array(list(product(*declared.values())), dtype=float))


def design_study(
    task: StudyTask,
    designs: Designs,
    *,
    executor: Executor | None = None,
    keeper: KeptChunks | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> DesignStudy:
    """Map all designs and reduce each map to areas and ranges. Options as for `workspace_map`."""
    parts = {}
    for first in range(0, len(designs.values), DESIGNS_PER_TASK):
        values = designs.values[first : first + DESIGNS_PER_TASK]
        parts[f"{first:07d}-{first + len(values):07d}"] = values
    columns = complete_chunks(
        partial(map_designs, task),
        parts,
        partial(_part_arrays, task),
        executor=executor,
        keeper=keeper,
        progress=lambda names: progress(sum(len(parts[name]) for name in names)),
    )
    why = tuple(columns.pop("why").tolist())
    robot = ParallelRobot.from_file(task.file, flexibility=task.flexibility)
    return DesignStudy(task, designs, columns, column_units(robot, task), why)


def _part_arrays(task: StudyTask, values: Array) -> dict[str, ArrayField]:
    """Return the fields of the chunk of designs (D, P)."""
    numbers = dict.fromkeys(column_names(task), ArrayField("f", (len(values),)))
    return numbers | {"why": ArrayField("U", (len(values),))}


def map_designs(task: StudyTask, values: Array) -> dict[str, NDArray[Any]]:
    """Map designs (D, P); return their numbers by column, and the reasons why some have none."""
    rows: list[dict[str, float]] = []
    why: list[str] = []
    for design in values:
        try:
            workspace = _map_design(task, dict(zip(task.names, design.tolist(), strict=True)))
            rows.append(_statistics(workspace))
            why.append("")
        except FrameworkError as error:
            rows.append({})
            why.append(str(error))
    columns: dict[str, NDArray[Any]] = {
        key: np.array([row.get(key, np.nan) for row in rows]) for key in column_names(task)
    }
    return columns | {"why": np.array(why, dtype=np.str_)}


def column_names(task: StudyTask) -> tuple[str, ...]:
    """Return the names of the columns of a study."""
    loaded = ["carried_area"] if any(QUANTITIES[key].loaded for key in task.keys) else []
    return ("area", "free_area", *loaded, *(f"{key}_{part}" for key in task.keys for part in STATISTICS))


def column_units(robot: ParallelRobot, task: StudyTask) -> dict[str, str]:
    """Return the units of the columns."""
    edges = {"m" if robot.translations[k] else "rad" for k in map_axes(robot, task.axes)}
    area = "m^2" if edges == {"m"} else "rad^2" if edges == {"rad"} else "m rad"
    units = {
        f"{quantity.key}_{part}": unit_of(robot, quantity)
        for quantity in choose_quantities(robot, task.keys)
        for part in STATISTICS
    }
    return {key: area for key in column_names(task) if key.endswith("area")} | units


def _map_design(task: StudyTask, parameters: Mapping[str, float]) -> WorkspaceMap:
    """Map the robot of one design."""
    robot = ParallelRobot.from_file(task.file, flexibility=task.flexibility, parameters=parameters)
    if task.window is None:
        window = survey_window(robot, axes=task.axes, size=task.size)
    else:
        ends, shape = np.array(task.window), (task.size, task.size)
        window = Window(map_axes(robot, task.axes), ends[::2], ends[1::2], shape, robot.reference.x)
    return workspace_map(robot, window, task.keys)


def _statistics(workspace: WorkspaceMap) -> dict[str, float]:
    """Return areas of poses: all reached, on the reference's side, under load; and ranges."""
    distance = np.abs(workspace.window.points() - workspace.robot.reference.x).max(axis=2)
    side = workspace.assembly.flat[np.argmin(np.where(workspace.reached, distance, np.inf))]
    cell = float(np.prod(workspace.window.cell))
    columns = {
        "area": cell * int(workspace.reached.sum()),
        "free_area": cell * int((workspace.reached & (workspace.assembly == side)).sum()),
    }
    if workspace.load is not None:
        columns["carried_area"] = cell * int(
            (workspace.reached & (workspace.load == LoadReason.CARRIED)).sum()
        )
    for quantity in workspace.quantities:
        values = workspace.values[quantity.key][workspace.reached]
        values = values[np.isfinite(values)]
        if values.size:
            numbers = (values.min(), np.median(values), values.max())
            columns |= {
                f"{quantity.key}_{part}": float(value)
                for part, value in zip(STATISTICS, numbers, strict=True)
            }
    return columns


# ------------------------------------------------------------------ files


def study_setup(task: StudyTask, designs: Designs) -> dict[str, Any]:
    """Return all settings of a study, a document of JSON."""
    robot = ParallelRobot.from_file(task.file, flexibility=task.flexibility)
    content = hashlib.sha256(Path(task.file).read_bytes() + robot.description.urdf_text.encode())
    return {
        "robot": robot.name,
        "robot_hash": content.hexdigest(),
        **{key: value for key, value in task._asdict().items() if key != "file"},
        "designs": hashlib.sha256(designs.values.tobytes()).hexdigest(),
        "count": len(designs.values),
        "versions": package_versions(),
    }


def write_study(study: DesignStudy, folder: Path) -> list[Path]:
    """Write study.json, study.npz and study.csv into a folder; the same study gives the same bytes."""
    files = [folder / DOCUMENT, folder / "study.npz", folder / "study.csv"]
    document = {**study_setup(study.task, study.designs), "units": dict(study.units)}
    files[0].write_text(json_text(document), encoding="utf-8")
    parameters = dict(zip(study.designs.names, study.designs.values.T, strict=True))
    arrays = {f"parameter_{name}": values for name, values in parameters.items()} | dict(study.columns)
    np.savez_compressed(
        files[1],
        allow_pickle=False,
        setup=np.array(json.dumps(document, sort_keys=True)),
        why=np.array(study.why, dtype=np.str_),
        **arrays,
    )
    with open(files[2], "w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([*parameters, *study.columns, "why"])
        values = np.column_stack([*parameters.values(), *study.columns.values()]).tolist()
        writer.writerows(
            [*("" if value != value else value for value in row), why]
            for row, why in zip(values, study.why, strict=True)
        )
    return files


def _read_table(table: Path, declared: Mapping[str, Sequence[float]]) -> Designs:
    rows = list(csv.reader(io.StringIO(read_text(table, f"{table}: cannot read the table"))))
    rows = [row for row in rows if row]
    if len(rows) < 2:
        raise InvalidInput(f"{table}: needs a line of parameters and a line of values for each design")
    names = tuple(name.strip() for name in rows[0])
    for name in names:
        if name not in declared:
            raise InvalidInput(f"{table}: {choose_from('parameter', name, declared)}")
    if len(set(names)) < len(names):
        raise InvalidInput(f"{table}: needs each parameter once, got {', '.join(names)}")
    short = next((row for row in rows if len(row) != len(names)), None)
    if short is not None:
        raise InvalidInput(f"{table}: needs {len(names)} numbers in each line, got {', '.join(short)}")
    if len(rows) > MAX_DESIGNS:
        raise InvalidInput(f"{table}: {len(rows) - 1} designs; at most {MAX_DESIGNS} are studied")
    try:
        values = np.array(rows[1:], dtype=float)
    except ValueError as error:
        raise InvalidInput(f"{table}: {error}") from None
    for row in values[~np.isfinite(values).all(axis=1)]:
        raise InvalidInput(f"{table}: needs finite numbers, got {row.tolist()}")
    return Designs(names, values)
