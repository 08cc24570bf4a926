"""`crossing map --study`: small maps over the named parameters of a robot file."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

import numpy as np

from framework.atlas.design_study import (
    DOCUMENT,
    Designs,
    DesignStudy,
    StudyTask,
    design_study,
    designs_of,
    study_setup,
    write_study,
)
from framework.atlas.quantities import choose_quantities
from framework.atlas.window import map_axes
from framework.catalogue import robot_file
from framework.cli.parser import Report
from framework.cli.writing import written_stepwise
from framework.errors import InvalidInput
from framework.kinematics.parallel_robot import ParallelRobot
from framework.parallel.kept import KeptChunks
from framework.parallel.tasks import executor_of

STUDY_EDGE_POSES = 41  # by default
MAX_PRINTED_DESIGNS = 20
NOT_FOR_STUDIES = (
    "scene",
    "at",
    "nearest",
    "within",
    "wrench",
    "platform",
    "axes",
    "motors",
    "reference",
    "base",
    "set",
)


def report_design_study(options: Namespace) -> Report:
    """Map each design of a study; report and write the results."""
    for key in NOT_FOR_STUDIES:
        if getattr(options, key) is not None:
            raise InvalidInput(f"--{key}: not for a study, whose robots have values of their own")
    file = robot_file(options.robot)
    designs = designs_of(file, options.table)
    robot = ParallelRobot.from_file(file, flexibility=options.flexibility)
    first, second = map_axes(robot, None if options.over is None else tuple(options.over))
    task = StudyTask(
        file=str(file.resolve()),
        names=designs.names,
        flexibility=options.flexibility,
        axes=(robot.axis_names[first], robot.axis_names[second]),
        window=None if options.window is None else finite_window(options),
        size=options.size or STUDY_EDGE_POSES,
        keys=tuple(quantity.key for quantity in choose_quantities(robot, options.quantity)),
    )
    if options.out is None:
        return _report(_compute_study(options, task, designs, None), robot.name)
    store = KeptChunks.of(Path(options.out), study_setup(task, designs))
    with written_stepwise(options, DOCUMENT, lambda: len(store.read()), "chunks") as folder:
        from framework.show.design_study import plot_study
        from framework.show.plots import save

        study = _compute_study(options, task, designs, store)
        write_study(study, folder)
        options.progress.start("drawing the figure")
        save(lambda: plot_study(study), folder / "study")
    return _report(study, robot.name)


def _compute_study(
    options: Namespace, task: StudyTask, designs: Designs, store: KeptChunks | None
) -> DesignStudy:
    """Map all designs by several processes; `store` keeps finished chunks."""
    progress = options.progress.start("mapping", len(designs.values), "designs")
    with executor_of(workers=options.workers, dask=options.dask) as executor:
        return design_study(task, designs, executor=executor, keeper=store, progress=progress)


def finite_window(options: Namespace) -> tuple[float, ...]:
    """Return the numbers of --window."""
    if not np.all(np.isfinite(options.window)):
        raise InvalidInput(f"--window: needs four finite numbers, got {options.window}")
    return tuple(options.window)


def _report(study: DesignStudy, robot: str) -> Report:
    """Return the results of all designs as a document, and a table of the first ones."""
    names, designs = study.designs.names, study.designs.values
    document = {
        "robot": robot,
        "designs": [
            {
                "parameters": dict(zip(names, design, strict=True)),
                **{key: column[k] for key, column in study.columns.items()},
                "why": study.why[k],
            }
            for k, design in enumerate(designs)
        ],
        "units": study.units,
    }
    count, size = len(designs), study.task.size
    refused = sum(map(bool, study.why))
    lines = [f"{robot}: {count} designs, {size} x {size} poses each, {refused} make no robot"]
    lines += _table(study, with_reasons=refused > 0)
    if count > MAX_PRINTED_DESIGNS:
        lines.append(f"  and {count - MAX_PRINTED_DESIGNS} more; --out or --json keeps all")
    return document, "\n".join(lines)


def _table(study: DesignStudy, *, with_reasons: bool) -> list[str]:
    """Return the lines of a table of the first designs: parameters, areas, medians, why no robot."""
    columns = [key for key in study.columns if key in ("area", "free_area") or key.endswith("_median")]
    heads = [*study.designs.names, *(f"{key} [{study.units[key]}]" for key in columns)]
    numbers = np.column_stack([study.designs.values, *(study.columns[key] for key in columns)])
    rows = [[f"{value:.4g}" if np.isfinite(value) else "-" for value in row] for row in numbers]
    if with_reasons:
        heads.append("why no robot")
        rows = [[*row, why] for row, why in zip(rows, study.why, strict=True)]
    return ["  " + "\t".join(row) for row in [heads, *rows[:MAX_PRINTED_DESIGNS]]]
