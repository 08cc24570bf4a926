"""The rows of a stage as a table: JSON for programs, Markdown for readers."""

import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from tests.benchmarks.chart.measure import FULL, Row, Stage
from tests.benchmarks.chart.reading import sentence, time_to

PACKAGES = ("parallel-singularity-crossing", "pin", "numpy", "scipy", "mujoco", "exudyn")


def versions() -> dict[str, str]:
    """What the rows were made with."""
    known = {"python": platform.python_version(), "machine": platform.machine()}
    for package in PACKAGES:
        try:
            known[package] = version(package)
        except PackageNotFoundError:
            continue
    return known


def markdown(stage: Stage, rows: Sequence[Row]) -> str:
    """The table with what one has to know to read it."""
    made = ", ".join(f"{name} {what}" for name, what in versions().items())
    sources = [f"- {method.label}: {method.source}." for method in stage.methods if method.source]
    parts = [
        [f"# {stage.title}", "", sentence(stage, rows), "", f"Reference: {stage.reference}."],
        [f"Left out, not installed: {', '.join(stage.missing)}."] if stage.missing else [],
        [
            f"Time is processor time, the least and the upper quartile of {FULL.repeats} runs in turns. "
            "`python -m tests.benchmarks.chart --row ROW` makes a row again."
        ],
        _times(stage, rows) if stage.goals else [],
        ["", "Settings of the others:", "", *sources] if sources else [],
        ["", f"| problem | method | given | setting | time [ms] | {stage.error} | row |"],
        ["|---|---|---|---|--:|--:|---|", *(_row(stage, row) for row in rows)],
        ["", f"Made with {made}.", ""],
    ]
    return "\n".join(line for part in parts for line in part)


def _times(stage: Stage, rows: Sequence[Row]) -> list[str]:
    """Times to the goals [ms], interpolated along each method's curve."""
    head = " | ".join(f"to {goal:.0e} [ms]" for goal in stage.goals)
    lines = ["", f"| problem | method | {head} |", "|---|---|" + "--:|" * len(stage.goals)]
    for method in stage.methods:
        if any(row.method == method.name for row in rows):
            times = [time_to(stage, rows, method.name, goal) for goal in stage.goals]
            cells = [_span(t.least, t.upper) if t else "never" for t in times]
            lines.append(_line([method.panel, method.label, *cells]))
    return lines


def _row(stage: Stage, row: Row) -> str:
    method = stage.method(row.method)
    setting = ", ".join(f"{value:.6g}" for value in row.setting)
    error = f"{row.error:.1e}" if np.isfinite(row.error) else f"none: {row.note}"
    spent = _span(row.seconds, row.upper) if np.isfinite(row.seconds) else ""
    return _line(
        [method.panel, method.label, method.given, f"{method.unit} {setting}", spent, error, f"`{row.key}`"]
    )


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _span(least: float, upper: float) -> str:
    """Times [ms]."""
    return f"{1e3 * least:.3g} to {1e3 * upper:.3g}"


def document(stage: Stage, rows: Sequence[Row]) -> dict[str, Any]:
    """The same for machines; what is no number is null."""
    return {
        "robot": "five_bar",  # by which files of this program are known
        "stage": stage.name,
        "versions": versions(),
        "title": stage.title,
        "reference": stage.reference,
        "sentence": sentence(stage, rows),
        "missing": list(stage.missing),
        "rows": [row_document(row) for row in rows],
    }


def row_document(row: Row) -> dict[str, Any]:
    """One row."""
    return {
        "row": row.key,
        "method": row.method,
        "setting": list(row.setting),
        "cpu_seconds": _or_null(row.seconds),
        "cpu_seconds_upper_quartile": _or_null(row.upper),
        "error": _or_null(row.error),
        "profile": [_or_null(value) for value in row.profile],
        "note": row.note,
    }


def summary(made: dict[str, Any]) -> list[str]:
    """A document of a stage in a few lines, as a command prints it."""
    left_out = [f"  left out, not installed: {', '.join(made['missing'])}"] if made["missing"] else []
    return [f"{made['stage']}: {made['title']}, {len(made['rows'])} rows", f"  {made['sentence']}", *left_out]


def line(stage: Stage, row: Row) -> str:
    """A row as a command prints it."""
    if not np.isfinite(row.error):
        return f"{row.key}  no result: {row.note}"
    spent = _span(row.seconds, row.upper)
    return f"{row.key}  {stage.method(row.method).label}: {spent} ms, {stage.error}: {row.error:.3e}"


def _or_null(value: float) -> float | None:
    return value if np.isfinite(value) else None
