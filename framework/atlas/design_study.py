"""A study of a robot's dimensions: one small map for each set of named parameters, and a few numbers of it.

The sets are the grid of all values that the robot file declares, or the rows of a table. They are computed in
chunks of `DESIGNS_PER_TASK`, in this process or by any `concurrent.futures.Executor`. For a set that makes no
robot the reason is recorded, and the others go on.
"""

from __future__ import annotations

import csv
import hashlib
import io
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

from framework.atlas.map_files import (
    STATISTICS,
    robot_hash,
    table_cells,
    value_range,
    write_document_and_arrays,
)
from framework.atlas.quantities import QUANTITIES, choose_quantities, quantity_unit
from framework.atlas.survey import Window, map_axes, survey_window
from framework.atlas.workspace_map import WorkspaceMap, workspace_map
from framework.dynamics.loading import LoadReason
from framework.errors import FrameworkError, InvalidInput, choose_from, finite_numbers
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.parameters import declared_parameters
from framework.numerics.arrays import Array, ReadOnlyArrays
from framework.numerics.input import read_text
from framework.numerics.kept import WHY, ArrayField, KeptChunks, complete_chunks, compute_rows
from framework.numerics.output import package_versions

DESIGNS_PER_TASK = 4  # designs of a task
MAX_DESIGNS = 1_000_000  # designs
DOCUMENT = "study.json"
Chunk = Mapping[str, NDArray[Any]]


class Designs(NamedTuple):
    """Sets of P parameters: their names and values (D, P)."""

    names: tuple[str, ...]
    values: Array


class StudyTask(NamedTuple):
    """The settings of the maps of a study, and the robot file.

    window: least and largest of the first axis, then of the second; None: its reach.
    """

    file: str
    names: tuple[str, ...]
    flexibility: str
    axes: tuple[str, str]
    window: tuple[float, ...] | None
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


def read_designs(file: str | Path, table: str | Path | None = None) -> Designs:
    """Return the grid of all declared parameter values, or the rows of a table.

    Args:
        table: CSV file with names of parameters in the first line and values in each further one.

    Raises:
        InvalidInput: the file declares no parameters; the table has other names, or cells that are no
            numbers.
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
    count = math.prod(map(len, declared.values()))
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
    """Map all designs, and reduce each map to areas and ranges.

    Options as for `workspace_map`.
    """
    chunks = {}
    for first in range(0, len(designs.values), DESIGNS_PER_TASK):
        values = designs.values[first : first + DESIGNS_PER_TASK]
        chunks[f"{first:07d}-{first + len(values):07d}"] = values
    columns = complete_chunks(
        partial(map_designs, task),
        chunks,
        partial(_chunk_arrays, task),
        executor=executor,
        keeper=keeper,
        progress=lambda names: progress(sum(len(chunks[name]) for name in names)),
    )
    why = tuple(columns.pop(WHY).tolist())
    robot = ParallelRobot.from_file(task.file, flexibility=task.flexibility)
    return DesignStudy(task, designs, columns, column_units(robot, task), why)


def _chunk_arrays(task: StudyTask, values: Array) -> dict[str, ArrayField]:
    """Return types and shapes of the columns of a chunk of designs (D, P)."""
    numbers = dict.fromkeys(column_names(task), ArrayField("f", (len(values),)))
    return numbers | {WHY: ArrayField("U", (len(values),))}


def map_designs(task: StudyTask, values: Array) -> dict[str, NDArray[Any]]:
    """Map designs (D, P); return columns (D,) of statistics, and `why` without a map."""
    compute = partial(_map_design, task)
    return compute_rows(compute, column_names(task), (FrameworkError,), values.tolist())


def column_names(task: StudyTask) -> tuple[str, ...]:
    """Return the names of the columns of a study."""
    loaded = ["carried_area"] if any(QUANTITIES[key].loaded for key in task.keys) else []
    return ("area", "free_area", *loaded, *(f"{key}_{part}" for key in task.keys for part in STATISTICS))


def column_units(robot: ParallelRobot, task: StudyTask) -> dict[str, str]:
    """Return the units of the columns, by name."""
    edge_units = {"m" if robot.translations[k] else "rad" for k in map_axes(robot, task.axes)}
    area_unit = "m rad"
    if len(edge_units) == 1:
        area_unit = f"{edge_units.pop()}^2"
    units = {
        f"{quantity.key}_{part}": quantity_unit(robot, quantity)
        for quantity in choose_quantities(robot, task.keys)
        for part in STATISTICS
    }
    return {key: area_unit for key in column_names(task) if key.endswith("area")} | units


def _map_design(task: StudyTask, design: Sequence[float]) -> dict[str, float]:
    """Map the robot of one design (P,); return its statistics by column.

    The map is over the task's window, or over the robot's own reach.
    """
    parameters = dict(zip(task.names, design, strict=True))
    robot = ParallelRobot.from_file(task.file, flexibility=task.flexibility, parameters=parameters)
    if task.window is None:
        window = survey_window(robot, axes=task.axes, size=task.size)
    else:
        ends, shape = np.array(task.window), (task.size, task.size)
        window = Window(
            axes=map_axes(robot, task.axes),
            lower=ends[::2],
            upper=ends[1::2],
            shape=shape,
            constants=robot.reference.x,
        )
    return _statistics(workspace_map(robot, window, task.keys))


def _statistics(workspace: WorkspaceMap) -> dict[str, float]:
    """Return areas and ranges of quantities of a map, by column.

    Areas are those of all reached poses, of poses in the reference's assembly mode (free_area), and of poses
    that carry the load. That mode is the mode of the pose nearest to the reference.
    """
    reached = workspace.reached
    distance = np.abs(workspace.window.points() - workspace.robot.reference.x).max(axis=2)
    reference_mode = workspace.assembly.flat[np.argmin(np.where(reached, distance, np.inf))]
    cell_area = float(np.prod(workspace.window.cell))
    columns = {
        "area": cell_area * int(reached.sum()),
        "free_area": cell_area * int((reached & (workspace.assembly == reference_mode)).sum()),
    }
    if workspace.load is not None:
        columns["carried_area"] = cell_area * int((reached & (workspace.load == LoadReason.CARRIED)).sum())
    for quantity in workspace.quantities:
        values = value_range(workspace.values[quantity.key])
        columns |= {f"{quantity.key}_{part}": value for part, value in values.items() if value is not None}
    return columns


# ------------------------------------------------------------------ files


def study_setup(task: StudyTask, designs: Designs) -> dict[str, Any]:
    """Return all settings of a study, a document of JSON."""
    robot = ParallelRobot.from_file(task.file, flexibility=task.flexibility)
    return {
        "robot": robot.name,
        "robot_hash": robot_hash(robot),
        **{key: value for key, value in task._asdict().items() if key != "file"},
        "designs": hashlib.sha256(designs.values.tobytes()).hexdigest(),
        "count": len(designs.values),
        "versions": package_versions(),
    }


def write_study(study: DesignStudy, folder: Path) -> list[Path]:
    """Write study.json, study.npz and study.csv; the same study gives the same bytes."""
    document = {**study_setup(study.task, study.designs), "units": dict(study.units)}
    parameters = dict(zip(study.designs.names, study.designs.values.T, strict=True))
    arrays = {f"parameter_{name}": values for name, values in parameters.items()} | dict(study.columns)
    columns = [(name, table_cells(values)) for name, values in (*parameters.items(), *study.columns.items())]
    return write_document_and_arrays(
        folder / DOCUMENT,
        document,
        document,
        {WHY: np.array(study.why, dtype=np.str_), **arrays},
        [*columns, (WHY, study.why)],
    )


def _read_table(table: Path, declared: Mapping[str, Sequence[float]]) -> Designs:
    """Read designs from a CSV table; raises as `read_designs`."""
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
    if len(rows) > MAX_DESIGNS:
        raise InvalidInput(f"{table}: {len(rows) - 1} designs; at most {MAX_DESIGNS} are studied")
    return Designs(
        names, np.array([finite_numbers(f"{table}: a design", row, len(names)) for row in rows[1:]])
    )
