"""A study of a robot's dimensions: one small map, reduced to a few numbers, for each design.

A design is a set of values of named parameters: a point of the grid that the robot file declares, or a row of
a table. Designs are computed in chunks of `DESIGNS_PER_TASK`, in this process or by any
`concurrent.futures.Executor`. If a design makes no robot, the reason is recorded and the study continues.
"""

from __future__ import annotations

import hashlib
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
from framework.atlas.quantities import QUANTITIES, choose_quantities, has_loaded, quantity_unit
from framework.atlas.survey import Window, grid_shape, map_axes, survey_window
from framework.atlas.workspace_map import workspace_map
from framework.dynamics.loading import LoadReason
from framework.errors import FrameworkError, InvalidInput, check_choice, choose_from, finite_numbers
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.parameters import declared_parameters
from framework.moved_modules import renamed_names
from framework.numerics.arrays import Array, ReadOnlyArrays
from framework.numerics.input import csv_rows, read_text
from framework.numerics.kept import WHY, ArrayField, KeptChunks, complete_chunks, compute_rows
from framework.numerics.output import package_versions

DESIGNS_PER_TASK = 4
MAX_DESIGNS = 1_000_000
DOCUMENT = "study.json"
SIZES = {1: "stroke", 2: "area"}  # column of what is reached, by the number of axes


class Designs(NamedTuple):
    """D designs: the names and values of P parameters."""

    names: tuple[str, ...]  # of the parameters
    values: Array  # (D, P)


class StudyTask(NamedTuple):
    """The robot file and the settings of the maps of a study."""

    file: str  # robot file
    names: tuple[str, ...]  # of the parameters
    flexibility: str  # of the robots
    axes: tuple[str, ...]  # names of the platform coordinates of the maps, two or the only one
    window: tuple[float, ...] | None  # least and largest value of each axis; None: the reach of each robot
    size: int  # poses along an edge
    keys: tuple[str, ...]  # of `QUANTITIES`

    def robot(self, parameters: Mapping[str, float] | None = None) -> ParallelRobot:
        """Return the robot with named parameters, by default as declared in the file."""
        return ParallelRobot.from_file(self.file, flexibility=self.flexibility, parameters=parameters)


@dataclass(frozen=True, eq=False)
class DesignStudy(ReadOnlyArrays):
    """The results of D designs; numbers are NaN for a design without a map."""

    task: StudyTask
    designs: Designs
    columns: Mapping[str, Array]  # (D,) by the names of `column_names`
    units: Mapping[str, str]  # by the names of the columns
    why: tuple[str, ...]  # (D,) reason why a design has no map; empty if it has one


def read_designs(file: str | Path, table: str | Path | None = None) -> Designs:
    """Return the grid of all declared parameter values, or the rows of a table.

    Either has at most MAX_DESIGNS designs.

    Args:
        file: robot file that declares the parameters.
        table: CSV file with parameter names in the first line and the values of a design in each other line.

    Raises:
        InvalidInput: the file declares no parameters; the table has undeclared names, or cells that are not
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
        text = read_text(Path(table), f"{table}: cannot read the table")
        rows = [cells for _, cells in csv_rows(f"{table}", text)]
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
        values = [finite_numbers(f"{table}: a design", _read_row(row), len(names)) for row in rows[1:]]
        return Designs(names, np.array(values))
    count = math.prod(map(len, declared.values()))
    if count > MAX_DESIGNS:
        raise InvalidInput(f"{file}: {count} designs; at most {MAX_DESIGNS} are studied")
    return Designs(tuple(declared), np.array(list(product(*declared.values())), dtype=float))


def _read_row(cells: Sequence[str]) -> list[float] | Sequence[str]:
    """Return the numbers of a row of a table, or the cells if any is no number."""
    try:
        return [float(cell) for cell in cells]
    except ValueError:
        return cells


def design_study(
    task: StudyTask,
    designs: Designs,
    *,
    executor: Executor | None = None,
    keeper: KeptChunks | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> DesignStudy:
    """Map all designs and reduce each map to areas and ranges.

    Args:
        task: robot file, window and quantities of the maps.
        designs: names and values of the parameters of D designs.
        executor: computes chunks of designs; None computes them in this process.
        keeper: a folder of finished chunks, which are not computed again; None stores nothing.
        progress: called with the number of finished designs.
    """
    if len(task.axes) not in SIZES:
        raise InvalidInput(f"axes: needs one or two of the platform's, got {task.axes!r}")
    for key in task.keys:
        check_choice("quantity", key, QUANTITIES)
    chunks = {}  # the designs of each chunk, by the name under which the chunk is stored
    for first in range(0, len(designs.values), DESIGNS_PER_TASK):
        values = designs.values[first : first + DESIGNS_PER_TASK]
        chunks[f"{first:07d}-{first + len(values):07d}"] = values
    columns = complete_chunks(
        partial(map_designs, task),
        chunks,
        # a stored chunk is computed again if its columns (D,), of D designs, have other types or shapes
        lambda values: (
            dict.fromkeys(column_names(task), ArrayField("f", (len(values),)))
            | {WHY: ArrayField("U", (len(values),))}
        ),
        executor=executor,
        keeper=keeper,
        progress=lambda names: progress(sum(len(chunks[name]) for name in names)),
    )
    why = tuple(columns.pop(WHY).tolist())  # reasons are a field of their own, not a column of numbers
    return DesignStudy(task, designs, columns, column_units(task.robot(), task), why)


def map_designs(task: StudyTask, values: Array) -> dict[str, NDArray[Any]]:
    """Map designs (D, P); return columns (D,) of statistics, and of the reasons for designs without a map."""
    compute = partial(_map_design, task)
    return compute_rows(compute, column_names(task), (FrameworkError,), values.tolist())


def column_names(task: StudyTask) -> tuple[str, ...]:
    """Return the names of the columns: areas or strokes, then statistics of each quantity."""
    size = SIZES[len(task.axes)]
    loaded = [f"carried_{size}"] if has_loaded([QUANTITIES[key] for key in task.keys]) else []
    return (size, f"free_{size}", *loaded, *(f"{key}_{part}" for key in task.keys for part in STATISTICS))


def column_units(robot: ParallelRobot, task: StudyTask) -> dict[str, str]:
    """Return the units of the columns of a study, by name.

    A quantity has the columns `{key}_least`, `{key}_median` and `{key}_largest`.
    """
    units_of_axes = ["m" if robot.translations[k] else "rad" for k in map_axes(robot, task.axes)]
    size_unit = {1: units_of_axes[0], 2: "m rad"}[len(units_of_axes)]
    if units_of_axes[1:] == units_of_axes[:1]:
        size_unit = f"{units_of_axes[0]}^2"
    # such as area, free_area and carried_area; no quantity's column ends with a size
    units = {key: size_unit for key in column_names(task) if key.endswith(tuple(SIZES.values()))}
    for quantity in choose_quantities(robot, task.keys):
        unit = quantity_unit(robot, quantity)
        units |= {f"{quantity.key}_{part}": unit for part in STATISTICS}
    return units


def _map_design(task: StudyTask, design: Sequence[float]) -> dict[str, float]:
    """Map the robot of one design (P,), as the task says; return the statistics of the map by column."""
    parameters = dict(zip(task.names, design, strict=True))
    robot = task.robot(parameters)
    if task.window is None:
        window = survey_window(robot, axes=task.axes, size=task.size)
    else:
        ranges = np.reshape(task.window, (-1, 2))  # one axis a row: least value, largest value
        axes = map_axes(robot, task.axes)
        window = Window(axes, ranges[:, 0], ranges[:, 1], grid_shape(axes, task.size), robot.reference.x)
    # areas, or lengths of a stroke: of all reached poses, of those in the assembly mode of the reached pose
    # nearest to the reference (`free_`), and of those that carry the load (`carried_`)
    workspace = workspace_map(robot, window, task.keys)
    reached = workspace.reached
    distance = np.abs(workspace.window.points() - workspace.robot.reference.x).max(axis=2)
    nearest = np.argmin(np.where(reached, distance, np.inf))  # index of the flattened grid
    has_reference_mode = workspace.assembly == workspace.assembly.flat[nearest]

    size = SIZES[len(workspace.window.axes)]
    masks = {size: reached, f"free_{size}": reached & has_reference_mode}
    if workspace.load is not None:
        masks[f"carried_{size}"] = reached & (workspace.load == LoadReason.CARRIED)

    cell_area = np.prod(workspace.window.cell)
    columns = {key: float(cell_area * mask.sum()) for key, mask in masks.items()}
    for quantity in workspace.quantities:
        values = value_range(workspace.values[quantity.key])
        columns |= {f"{quantity.key}_{part}": value for part, value in values.items() if value is not None}
    return columns


# ------------------------------------------------------------------ files


def study_setup(task: StudyTask, designs: Designs) -> dict[str, Any]:
    """Return the settings of a study, as a document of JSON.

    A hash stands for the robot file, whose path does not count.
    """
    robot = task.robot()
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
    document = study_setup(study.task, study.designs) | {"units": dict(study.units)}
    parameters = dict(zip(study.designs.names, study.designs.values.T, strict=True))
    arrays: dict[str, NDArray[Any]] = {WHY: np.array(study.why, dtype=np.str_)}
    arrays |= {f"parameter_{name}": values for name, values in parameters.items()}
    arrays |= study.columns
    columns = [*parameters.items(), *study.columns.items()]
    table = [*((name, table_cells(values)) for name, values in columns), (WHY, study.why)]
    # the document is stored with the arrays too
    return write_document_and_arrays(folder / DOCUMENT, document, document, arrays, table)


__getattr__ = renamed_names(__name__, {"designs_of": "read_designs"})
