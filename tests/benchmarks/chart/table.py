"""The rows of a stage as a table: CSV for programs, Markdown for readers."""

from __future__ import annotations

import csv
import io
import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from tests.benchmarks.chart.measure import Row, Stage

PACKAGES = ("parallel-singularity-crossing", "pin", "numpy", "scipy", "mujoco", "exudyn")


def versions() -> dict[str, str]:
    """What the rows were made with."""
    found = {"python": platform.python_version(), "machine": platform.machine()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def csv_text(stage: Stage, rows: Sequence[Row]) -> str:
    """One line a row; errors in the unit that the stage names, times in seconds."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    classes = [f"error_at_{value:.3g}" for value in stage.profile]
    writer.writerow(
        [
            "row",
            "problem",
            "method",
            "given",
            "setting",
            "setting_is",
            "cpu_seconds",
            "error",
            *classes,
            "note",
        ]
    )
    for row in rows:
        method = stage.method(row.method)
        profile = row.profile if row.profile else ("",) * len(classes)
        writer.writerow(
            [
                row.key,
                method.panel,
                method.label,
                method.given,
                " ".join(f"{value:.12g}" for value in row.setting),
                method.unit,
                _number(row.seconds),
                _number(row.error),
                *(value if value == "" else _number(float(value)) for value in profile),
                row.note,
            ]
        )
    return text.getvalue()


def markdown(stage: Stage, rows: Sequence[Row]) -> str:
    """The table with what one has to know to read it."""
    lines = [
        f"# {stage.title}",
        "",
        stage.sentence(rows),
        "",
        f"Reference: {stage.reference}.",
        *([f"Left out, not installed: {', '.join(stage.missing)}."] if stage.missing else []),
        "Time is processor time, the least of several runs. "
        "`python -m tests.benchmarks.chart --row ROW` makes a row again.",
        "",
        f"| problem | method | given | setting | time [ms] | {stage.error} | row |",
        "|---|---|---|---|--:|--:|---|",
    ]
    for row in rows:
        method = stage.method(row.method)
        setting = ", ".join(f"{value:.6g}" for value in row.setting)
        error = f"{row.error:.1e}" if np.isfinite(row.error) else f"none: {row.note}"
        milliseconds = f"{1e3 * row.seconds:.3g}" if np.isfinite(row.seconds) else ""
        cells = [
            method.panel,
            method.label,
            method.given,
            f"{method.unit} {setting}",
            milliseconds,
            error,
            f"`{row.key}`",
        ]
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    made = ", ".join(f"{name} {what}" for name, what in versions().items())
    return "\n".join([*lines, "", f"Made with {made}.", ""])


def document(stage: Stage, rows: Sequence[Row]) -> dict[str, Any]:
    """The same for machines; what is no number is null."""
    return {
        "robot": "five_bar",  # by which files of this program are known
        "stage": stage.name,
        "versions": versions(),
        "title": stage.title,
        "reference": stage.reference,
        "sentence": stage.sentence(rows),
        "missing": list(stage.missing),
        "rows": [row_document(row) for row in rows],
    }


def summary(found: dict[str, Any]) -> list[str]:
    """A document of a stage in a few lines, as a command prints it."""
    left_out = [f"  left out, not installed: {', '.join(found['missing'])}"] if found["missing"] else []
    return [
        f"{found['stage']}: {found['title']}, {len(found['rows'])} rows",
        f"  {found['sentence']}",
        *left_out,
    ]


def line(stage: Stage, row: Row) -> str:
    """A row as a command prints it."""
    method = stage.method(row.method)
    if not np.isfinite(row.error):
        return f"{row.key}  no result: {row.note}"
    spent = f"{1e3 * row.seconds:.4g} ms"
    return f"{row.key}  {method.label}: {spent}, {stage.error}: {row.error:.3e}"


def row_document(row: Row) -> dict[str, Any]:
    """One row."""
    return {
        "row": row.key,
        "method": row.method,
        "setting": list(row.setting),
        "cpu_seconds": row.seconds if np.isfinite(row.seconds) else None,
        "error": row.error if np.isfinite(row.error) else None,
        "profile": [value if np.isfinite(value) else None for value in row.profile],
        "note": row.note,
    }


def _number(value: float) -> str:
    return f"{value:.6g}" if np.isfinite(value) else ""
