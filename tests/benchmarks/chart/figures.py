"""Figures of the chart: what a method costs and what it gives, one curve a method; or a map a method.

Colours of ours are none of the others'; a formula written for the one robot is black. Marker and dash tell
methods apart in grey. The legend and the reader's sentence stand below the axes and cover nothing.
"""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

from framework.show import DASHES
from framework.show.style import save_pages
from tests.benchmarks.chart.measure import Method, Row, Stage
from tests.benchmarks.chart.reading import LEAST, WRONG, finite, front, sentence

PALETTE = {
    "ours": ("#0072B2", "#009E73", "#56B4E9", "#332288", "#117733", "#44AA99", "#555555"),
    "peer": ("#D55E00", "#CC79A7", "#E69F00", "#882255", "#999933", "#8c510a", "#dd6677"),
    "frontier": ("#000000",),
}
WIDTH, AXES = 9.0, 2.7  # [in] of a figure; height of axes
TOP, BELOW, LINE, LEFT, BETWEEN = 0.32, 0.46, 0.145, 0.62, 0.62  # [in]
TIME = "processor time  [ms]"
FEW = 300.0  # largest over smallest on an axis that still takes 1, 2, 5, 10
MARKERS = "os^Dv<>Pphd*X"
LEGEND_COLUMNS, LETTERS = 2, 175  # of the legend, and letters in a line of the sentence
MAP_COLUMNS, MAP_AXES, MAP_LEFT, MAP_BELOW = 4, 1.5, 0.55, 0.62  # maps side by side; their size [in]
SHORT_SIZE = (6.2, 3.0)  # [in] of the figure read at a glance
ROUNDING = 1e-16  # an error that has lost no digit
DIGITS = 16  # that a cell may lose


def chart_figure(stage: Stage, rows: Sequence[Row]) -> Figure:
    """The figure of a stage: errors over times, axes for each of its problems, and the profile of all."""
    drawn = [method for method in stage.methods if any(row.method == method.name for row in rows)]
    named: dict[str, Method] = {}  # one entry a label, with what it is given in each panel
    given: dict[str, dict[str, None]] = {}
    for method in drawn:
        named.setdefault(method.label, method)
        given.setdefault(method.label, {})[method.given] = None
    text, columns = _below(stage, rows), len(stage.panels) + bool(stage.profile)
    below = BELOW + LINE * (-(-len(named) // LEGEND_COLUMNS) + len(text) + 1)
    height = below + TOP + AXES
    width = (WIDTH - LEFT - 0.1 - BETWEEN * (columns - 1)) / columns
    figure, looks = Figure(figsize=(WIDTH, height)), styles(stage)
    axes = [
        figure.add_axes(
            ((LEFT + k * (width + BETWEEN)) / WIDTH, below / height, width / WIDTH, AXES / height)
        )
        for k in range(columns)
    ]
    for panel, ax in zip(stage.panels, axes, strict=False):
        for method in drawn:
            if method.panel == panel:
                _plot_work(ax, finite(rows, method.name), looks[method.name])
        _scaled(ax, TIME)
        ax.set_ylabel(stage.error)
        ax.set_title(panel or stage.title, loc="left")
    if stage.profile:
        _plot_profile(axes[-1], stage, drawn, rows, looks)
    handles = [
        figure.axes[0].plot([], [], **looks[method.name], label=f"{label} ({' / '.join(given[label])})")[0]
        for label, method in named.items()
    ]
    figure.legend(
        handles=handles,
        loc="upper left",
        bbox_to_anchor=(0.02, (below - BELOW) / height),
        ncols=LEGEND_COLUMNS,
        fontsize=6.5,
        handlelength=3.2,
        borderaxespad=0.0,
        labelspacing=0.35,
    )
    figure.text(0.02, 0.05 / height, "\n".join(text), fontsize=7, va="bottom", linespacing=1.35)
    return figure


def map_figure(stage: Stage, rows: Sequence[Row]) -> Figure:
    """A map a method, over the two numbers of a setting: digits lost, wrong answers, refusals.

    Each problem of the stage begins a line.
    """
    text = _below(stage, rows)
    places, lines = list[tuple[Method, int, int]](), 0
    for panel in stage.panels:
        drawn = [one for one in stage.only(panel).methods if any(row.method == one.name for row in rows)]
        for k, method in enumerate(drawn):
            line, column = divmod(k, MAP_COLUMNS)
            places.append((method, lines + line, column))
        lines += -(-len(drawn) // MAP_COLUMNS)
    below = 0.1 + LINE * (len(text) + 1)
    height = lines * (TOP + MAP_AXES + MAP_BELOW) + below
    figure = Figure(figsize=(WIDTH, height))
    width = (WIDTH - 0.1) / MAP_COLUMNS - MAP_LEFT
    for method, line, column in places:
        left = MAP_LEFT + column * (width + MAP_LEFT)
        bottom = height - (line + 1) * (TOP + MAP_AXES) - line * MAP_BELOW
        ax = figure.add_axes((left / WIDTH, bottom / height, width / WIDTH, MAP_AXES / height))
        _plot_map(ax, method, [row for row in rows if row.method == method.name])
        across, up = method.unit.split(", ")
        ax.set_xlabel(across)
        if column == 0:
            ax.set_ylabel(up)
        ax.set_title(method.label, loc="left", fontsize=7)
    figure.text(0.02, 0.05 / height, "\n".join(text), fontsize=7, va="bottom", linespacing=1.35)
    return figure


def short_figure(stage: Stage, rows: Sequence[Row]) -> Figure:
    """Errors over times of the few methods of `Stage.short` in one panel."""
    figure, looks = Figure(figsize=SHORT_SIZE, layout="constrained"), styles(stage)
    ax = figure.add_subplot()
    for name, label in stage.short.items():
        times, errors = _points(front(finite(rows, name)))
        ax.plot(times, errors, **looks[name], label=label)
    _scaled(ax, TIME)
    ax.set_ylabel(stage.error)
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    return figure


def save_chart(stage: Stage, rows: Sequence[Row], stem: Path) -> list[Path]:
    """Write `stem`.pdf and `stem`.png, and `stem`_short.png where the stage has a short figure."""
    draw = map_figure if stage.is_map else chart_figure
    drawings = {stem.name: lambda: draw(stage, rows)}
    if stage.short:
        drawings[f"{stem.name}_short"] = lambda: short_figure(stage, rows)
    return save_pages(drawings, stem.with_suffix(".pdf"))


def styles(stage: Stage) -> dict[str, dict[str, Any]]:
    """How each method is drawn: one look for one label, in whatever panel."""
    kinds = {method.label: method.kind for method in stage.methods}
    colors = {
        label: PALETTE[kind][[one for one in kinds if kinds[one] == kind].index(label) % len(PALETTE[kind])]
        for label, kind in kinds.items()
    }
    looks = {}
    for method in stage.methods:
        k, ours = list(kinds).index(method.label), method.kind == "ours"
        looks[method.name] = {
            "color": colors[method.label],
            "linestyle": DASHES[k % len(DASHES)],
            "marker": MARKERS[k % len(MARKERS)],
            "markersize": 4 if ours else 3,
            "markerfacecolor": colors[method.label] if ours else "white",
            "markeredgewidth": 0.8,
            "linewidth": 1.8 if ours else 0.9,
        }
    return looks


def _below(stage: Stage, rows: Sequence[Row]) -> list[str]:
    """The lines below a figure."""
    missing = f"Left out, not installed: {', '.join(stage.missing)}." if stage.missing else ""
    key = "Cells: digits lost of 16; x: wrong answer (none of its digits right), grey r: refused."
    parts = [key if stage.is_map else "", sentence(stage, rows), missing]
    return [line for part in parts for line in textwrap.wrap(part, LETTERS)]


def _plot_work(ax: Axes, rows: Sequence[Row], look: dict[str, Any]) -> None:
    """Errors over time: the rows that no other beats with their spread, the others faint."""
    ax.plot(*_points(rows), ".", color=look["color"], markersize=1.5, alpha=0.4)
    curve = front(rows)
    times, errors = _points(curve)
    ax.plot(times, errors, **look)
    ax.hlines(errors, times, [1e3 * row.upper for row in curve], color=look["color"], linewidth=0.6)


def _points(rows: Sequence[Row]) -> tuple[list[float], list[float]]:
    """Times [ms] and errors."""
    return [1e3 * row.seconds for row in rows], [max(row.error, LEAST) for row in rows]


def _plot_profile(
    ax: Axes, stage: Stage, methods: Sequence[Method], rows: Sequence[Row], looks: dict[str, dict[str, Any]]
) -> None:
    """Errors in each class, of the best setting of each method."""
    for method in methods:
        known = [row for row in finite(rows, method.name) if row.profile]
        if known:
            chosen = min(known, key=lambda row: row.error)
            ax.plot(stage.profile, np.maximum(chosen.profile, LEAST), **looks[method.name])
    _scaled(ax, stage.profiled)
    ax.set_ylabel(stage.error)
    ax.set_title(stage.profile_title, loc="left")


def _scaled(ax: Axes, label: str) -> None:
    """Logarithmic axes; plain numbers where times span few decades."""
    ax.set_yscale("log")
    ax.yaxis.set_minor_formatter(NullFormatter())
    ax.set_xlabel(label)
    ax.set_xscale("log")
    low, high = ax.get_xlim()
    if high < FEW * low:
        ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.xaxis.set_major_formatter(FormatStrFormatter("%g"))
        ax.xaxis.set_minor_formatter(NullFormatter())


def _plot_map(ax: Axes, method: Method, rows: Sequence[Row]) -> None:
    """Cells with the digits lost; light is right, dark is wrong, in grey too; refusals are grey."""
    across, up = (sorted({setting[k] for setting in method.settings}) for k in (0, 1))
    lost = np.full((len(up), len(across)), np.nan)
    for row in rows:
        i, j = up.index(row.setting[1]), across.index(row.setting[0])
        if not np.isfinite(row.error):
            ax.text(j, i, "r", ha="center", va="center", fontsize=5.5, color="0.4")
            continue
        lost[i, j] = np.clip(np.log10(max(row.error, ROUNDING) / ROUNDING), 0, DIGITS)
        words = "x" if row.error >= WRONG else f"{lost[i, j]:.0f}"
        color = "white" if lost[i, j] > 0.5 * DIGITS else "black"
        ax.text(j, i, words, ha="center", va="center", fontsize=5.5, color=color)
    ax.set_facecolor("0.88")
    ax.imshow(
        np.ma.masked_invalid(lost), cmap="viridis_r", vmin=0, vmax=DIGITS, origin="lower", aspect="auto"
    )
    ax.set_xticks(range(len(across)), [_brief(value) for value in across], fontsize=5)
    ax.set_yticks(range(len(up)), [_brief(value) for value in up] if len(up) > 1 else [""], fontsize=5)
    ax.grid(False)


def _brief(value: float) -> str:
    """A number, powers of ten as such where they are far from 1."""
    if value == 0 or 1e-2 < abs(value) < 1e3:
        return f"{value:.3g}"
    power = int(np.floor(np.log10(abs(value)) + 1e-9))
    factor = value / 10.0**power
    return f"$10^{{{power}}}$" if abs(factor - 1) < 0.05 else f"{factor:.0f}e{power}"
