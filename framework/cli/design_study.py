"""`crossing map --study`: small maps over the named parameters of a robot file."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from framework.atlas.design_study import (
    DOCUMENT,
    DesignStudy,
    StudyTask,
    design_study,
    designs_of,
    study_setup,
    write_study,
)
from framework.atlas.quantities import chosen
from framework.atlas.window import map_axes
from framework.catalogue import robot_file
from framework.cli.parser import Report, progress_bar
from framework.errors import InvalidInput
from framework.kinematics.parallel_robot import ParallelRobot
from framework.output import written_together
from framework.parallel.kept import KeptChunks, forget
from framework.parallel.tasks import executor_of

STUDY_EDGE_POSES = 41  # by default
MAX_PRINTED_DESIGNS = 20
NOT_FOR_STUDIES = ("scene", "at", "nearest", "wrench", "platform", "axes", "motors", "reference", "base")


def report_design_study(options: argparse.Namespace) -> Report:
    """One study, told and written."""
    for key in NOT_FOR_STUDIES:
        if getattr(options, key) is not None:
            raise InvalidInput(f"--{key}: not for a study, whose robots have references of their own")
    file = robot_file(options.robot)
    designs = designs_of(file, options.table)
    robot = ParallelRobot.from_file(file, flexibility=options.flexibility)
    axes = map_axes(robot, None if options.over is None else tuple(options.over))
    task = StudyTask(
        file=str(file.resolve()),
        names=designs.names,
        flexibility=options.flexibility,
        axes=(robot.axis_names[axes[0]], robot.axis_names[axes[1]]),
        window=None if options.window is None else finite_window(options),
        size=options.size or STUDY_EDGE_POSES,
        keys=tuple(one.key for one in chosen(robot, options.quantity)),
    )

    def computed(kept: KeptChunks | None) -> DesignStudy:
        with (
            executor_of(workers=options.workers, dask=options.dask) as executor,
            progress_bar(len(designs.values), "design", silent=options.json) as progress,
        ):
            return design_study(task, designs, executor=executor, keeper=kept, progress=progress)

    if options.out is None:
        return _told(computed(None), robot.name)
    out = Path(options.out)
    kept = KeptChunks.of(out, study_setup(task, designs))
    with written_together(out, document=DOCUMENT) as folder:
        try:
            found = computed(kept)
        except KeyboardInterrupt as stop:
            count = len(kept.found())
            words = [f"{count} chunks are kept in {out}, and the same command goes on from them"]
            raise type(stop)(*words[: bool(count)]) from None
        write_study(found, folder)
        _draw(found, folder)
    forget(out)
    document, text = _told(found, robot.name)
    return document, f"{text}\n  written to        {options.out}"


def _draw(found: DesignStudy, folder: Path) -> None:
    from framework.show.design_study import save_study_figure

    save_study_figure(found, folder)


def finite_window(options: argparse.Namespace) -> tuple[float, ...]:
    """The numbers of --window."""
    if not np.all(np.isfinite(options.window)):
        raise InvalidInput("--window: needs four finite numbers")
    return tuple(options.window)


def _told(found: DesignStudy, robot: str) -> Report:
    count = len(found.why)
    refused = sum(bool(why) for why in found.why)
    shown = {key: found.columns[key] for key in ("area", "free_area", *_medians(found))}
    heads = [*found.designs.names, *(f"{key} [{found.units[key]}]" for key in shown)]
    lines = [
        f"{robot}: {count} designs, {task_size(found)} poses each, {refused} make no robot",
        "  " + "  ".join(heads),
    ]
    for k in range(min(count, MAX_PRINTED_DESIGNS)):
        numbers = [*found.designs.values[k], *(values[k] for values in shown.values())]
        told = [f"{value:.4g}".ljust(len(head)) for value, head in zip(numbers, heads, strict=True)]
        if found.why[k]:
            told[len(found.designs.names) :] = [found.why[k]]
        lines.append("  " + "  ".join(told).rstrip())
    if count > MAX_PRINTED_DESIGNS:
        lines.append(f"  and {count - MAX_PRINTED_DESIGNS} more; --out or --json keeps all")
    document = {
        "robot": robot,
        "designs": [
            {
                "parameters": dict(zip(found.designs.names, values.tolist(), strict=True)),
                **{key: _number(column[k]) for key, column in found.columns.items()},
                "why": found.why[k],
            }
            for k, values in enumerate(found.designs.values)
        ],
        "units": dict(found.units),
    }
    return document, "\n".join(lines)


def task_size(found: DesignStudy) -> str:
    """The poses of one map."""
    return f"{found.task.size} x {found.task.size}"


def _medians(found: DesignStudy) -> list[str]:
    return [key for key in found.columns if key.endswith("_median")]


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
