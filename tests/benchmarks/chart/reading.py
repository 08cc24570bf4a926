"""What the rows of a stage say: times to an error along a method's curve, and who is quickest to it.

One rule for all methods. The curve of a method are its rows that no other of its rows beats in both time and
error, joined by straight lines in the logarithms; the time to an error is read off it, and so is its spread.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tests.benchmarks.chart.measure import Method, Row, Stage

WRONG = 0.1  # relative error of an answer that has no digit right
LEAST = 1e-17  # stands for an error of zero


class Time(NamedTuple):
    """Processor time of a method to an error [s]: the least of the repeats and their upper quartile."""

    method: Method
    least: float
    upper: float


def finite(rows: Sequence[Row], method: str) -> list[Row]:
    """The rows of a method that have a result."""
    return [row for row in rows if row.method == method and np.isfinite(row.error)]


def best(rows: Sequence[Row], method: str) -> Row | None:
    """The row of a method with the least error."""
    return min(finite(rows, method), key=lambda row: row.error, default=None)


def front(rows: Sequence[Row]) -> list[Row]:
    """Of the rows of a method, from quick to slow, each that has less error than all that are quicker."""
    least, kept = np.inf, []
    for row in sorted(rows, key=lambda row: row.seconds):
        if row.error < least:
            least = row.error
            kept.append(row)
    return kept


def time_to(stage: Stage, rows: Sequence[Row], method: str, error: float) -> Time | None:
    """The time to an error, interpolated; None where the method does not come to it."""
    curve = front(finite(rows, method))
    if not curve or curve[-1].error > error:
        return None
    errors = -np.log([max(row.error, LEAST) for row in curve])
    least, upper = (
        float(np.exp(np.interp(-np.log(error), errors, np.log([getattr(row, name) for row in curve]))))
        for name in ("seconds", "upper")
    )
    return Time(stage.method(method), least, upper)


def times_to(stage: Stage, rows: Sequence[Row], error: float, panel: str = "") -> list[Time]:
    """The times of all methods of a panel that come to an error, quickest first."""
    found = [time_to(stage, rows, m.name, error) for m in stage.methods if m.panel == panel]
    return sorted((time for time in found if time is not None), key=lambda time: time.least)


def sentence(stage: Stage, rows: Sequence[Row]) -> str:
    """What a figure says: who is quickest to each goal in each panel, ours or another, and the remark."""
    lines = []
    for panel in stage.panels:
        for goal in stage.goals:
            words = compared(times_to(stage, rows, goal, panel), alone=not stage.has_peers)
            if words:
                where = f"{panel}, to" if panel else "to"
                lines.append(f"{where[0].upper()}{where[1:]} {goal:.0e}: {words}.")
    return " ".join([*lines, stage.remark(rows)]).strip()


def counts(stage: Stage, rows: Sequence[Row]) -> str:
    """Cells of a map: how many answers of each method are wrong or refused, and the worst of the others."""
    words = []
    for method in stage.methods:
        cells = [row for row in rows if row.method == method.name]
        refused = sum(not np.isfinite(row.error) for row in cells)
        wrong = sum(WRONG <= row.error < np.inf for row in cells)
        worst = max((row.error for row in cells if row.error < WRONG), default=None)
        if cells:
            words.append(
                f"{method.label} {wrong} of {len(cells)} wrong, {refused} refused, else within {short(worst)}"
            )
    return "; ".join(words)


def compared(times: Sequence[Time], *, alone: bool = False) -> str:
    """Ours against the quickest other, and the frontier; `times` of each kind from quick to slow.

    Ours `alone` where a stage has no other's methods.
    """
    quickest = {kind: next((t for t in times if t.method.kind == kind), None) for kind in ("ours", "peer")}
    ours, peer = quickest["ours"], quickest["peer"]
    words = "; ".join(_words(time) for time in (ours, peer) if time is not None)
    if ours is not None and peer is not None:
        ratio = ours.least / peer.least
        if ours.least < peer.upper and peer.least < ours.upper:
            words += " (equal within the spread)"
        else:
            words += f" ({max(ratio, 1 / ratio):.2g} times {'more' if ratio > 1 else 'less'} for ours)"
    elif words and not alone:
        words += ", no other comes to it" if peer is None else ", ours does not come to it"
    frontier = next((time for time in times if time.method.kind == "frontier"), None)
    return words if frontier is None else f"{words}; {_words(frontier)}".removeprefix("; ")


def _words(time: Time) -> str:
    return f"{time.method.label} {1e3 * time.least:.3g} ms"


def short(value: float | None) -> str:
    """A number of one digit."""
    return "-" if value is None else f"{value:.0e}"
