"""Charts made several times: whether a comparison outside the drawn spreads changes its sign between them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from itertools import combinations
from pathlib import Path

from framework import InvalidInput
from tests.benchmarks.chart import stages, table
from tests.benchmarks.chart.measure import Row, Stage
from tests.benchmarks.chart.reading import Time, finite, time_to

Comparison = tuple[
    str, int
]  # what is compared; 1: the second is quicker, -1: the first, 0: within the spread


def comparisons(stage: Stage, rows: Sequence[Row]) -> Iterator[Comparison]:
    """All pairs of methods of a panel: times to each goal, or times at each setting."""
    for one, other in combinations(stage.methods, 2):
        if one.panel != other.panel:
            continue
        label = f"{stage.name}: {one.name} against {other.name}"
        for goal in stage.goals:
            times = [time_to(stage, rows, method.name, goal) for method in (one, other)]
            if any(times):
                yield f"{label} to {goal:.0e}", sign(*times)
        if not stage.goals and stage.timed:
            known = [
                {row.setting: Time(m, row.seconds, row.upper) for row in finite(rows, m.name)}
                for m in (one, other)
            ]
            for setting in known[0].keys() & known[1].keys():
                yield f"{label} at {setting[0]:g}", sign(known[0][setting], known[1][setting])


def sign(one: Time | None, other: Time | None) -> int:
    """Who is quicker; a method that does not come to the error is slower than one that does."""
    if one is None or other is None:
        return int(other is not None) - int(one is not None)
    if one.least < other.upper and other.least < one.upper:
        return 0
    return 1 if other.least < one.least else -1


def report(folders: Sequence[Path]) -> tuple[str, int]:
    """What to say of these charts, and how many comparisons change their sign.

    Raises:
        InvalidInput: fewer than two charts, or a folder without a table.
    """
    if len(folders) < 2:
        raise InvalidInput("--compare: needs at least two folders of charts")
    found: dict[str, list[int]] = {}
    for folder in folders:
        files = [folder / f"{name}.json" for name in stages.NAMES]
        known = [file for file in files if file.is_file()]
        if not known:
            raise InvalidInput(f"--compare: {folder} has no table of a chart, such as {files[0].name}")
        for file in known:
            rows = table.read_rows(json.loads(file.read_text(encoding="utf-8")))
            for key, value in comparisons(stages.stage(file.stem), rows):
                found.setdefault(key, []).append(value)
    turned = [key for key, signs in found.items() if {-1, 1} <= set(signs)]
    equal = sum(0 in signs for signs in found.values())
    words = f"{len(found)} comparisons in {len(folders)} charts, {equal} within the spread at least once"
    return "\n".join([f"{words}; {len(turned)} change their sign:", *turned]), len(turned)
