"""Figures of the chart: what a method costs and what it gives, one curve a method.

Colour, dash and marker each tell a method from the others, so that grey prints can be read. The legend and
the reader's sentence stand below the axes and cover nothing.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

from framework.show.style import COLORS, DASHES, save_figure, styled
from tests.benchmarks.chart.measure import Method, Row, Stage
from tests.benchmarks.chart.reading import LEAST

WIDTH, AXES = 7.2, 2.7  # [in] two journal columns, and the height of the axes
TOP, BELOW, LINE, LEFT, BETWEEN = 0.32, 0.46, 0.145, 0.62, 0.7  # [in]
MAP_LEFT = 0.5  # [in]
TIME = "processor time  [ms]   (better: left and down)"
FEW = 300.0  # largest over smallest on an axis that still takes 1, 2, 5, 10
POWERS = (-13.0, 1.0)  # of ten, the lightest and the darkest cell
MARKERS = "os^Dv<>Pphd*"
LEGEND_COLUMNS, LETTERS = 2, 140  # of the legend, and letters in a line of the sentence


def chart_figure(stage: Stage, rows: Sequence[Row]) -> Figure:
    """The figure of a stage: its problems side by side, and the profile of the error if it has one."""
    sentence = textwrap.wrap(stage.sentence(rows), LETTERS)
    if stage.missing:
        sentence += textwrap.wrap(f"Left out, not installed: {', '.join(stage.missing)}.", LETTERS)
    count = len(stage.panels) + bool(stage.profile)
    drawn = [method for method in stage.methods if any(row.method == method.name for row in rows)]
    named: dict[str, Method] = {}  # one entry a label, the first one's
    for method in drawn:
        named.setdefault(method.label, method)
    legend = -(-len(named) // LEGEND_COLUMNS)
    below = BELOW + LINE * (legend + len(sentence) + 1)
    height = TOP + AXES + below
    figure = Figure(figsize=(WIDTH, height))
    width = (WIDTH - LEFT - 0.1 - BETWEEN * (count - 1)) / count
    axes = [
        figure.add_axes(
            ((LEFT + k * (width + BETWEEN)) / WIDTH, below / height, width / WIDTH, AXES / height)
        )
        for k in range(count)
    ]
    looks = styles(stage)
    for ax, panel in zip(axes, stage.panels, strict=False):
        _plot_errors(ax, stage, [method for method in drawn if method.panel == panel], rows, looks)
        ax.set_title(panel or stage.title, loc="left")
    if stage.profile:
        _plot_profile(axes[-1], stage, drawn, rows, looks)
    handles = [
        axes[0].plot([], [], **looks[method.name], label=_label(method))[0] for method in named.values()
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
    figure.text(0.02, 0.05 / height, "\n".join(sentence), fontsize=7, va="bottom", linespacing=1.35)
    return figure


def map_figure(stage: Stage, rows: Sequence[Row]) -> Figure:
    """The figure of a stage that maps the error over a number and a step: a map a method."""
    assert stage.map_axes is not None
    sentence = textwrap.wrap(stage.sentence(rows), LETTERS)
    drawn = [method for method in stage.methods if len({y for _, y in method.settings}) > 1]
    below = BELOW + LINE * (len(sentence) + 1)
    height = TOP + AXES + below
    figure = Figure(figsize=(WIDTH, height))
    width = (WIDTH - MAP_LEFT - 0.1 - MAP_LEFT * (len(drawn) - 1)) / len(drawn)
    for k, method in enumerate(drawn):
        ax = figure.add_axes(
            ((MAP_LEFT + k * (width + MAP_LEFT)) / WIDTH, below / height, width / WIDTH, AXES / height)
        )
        _plot_map(ax, method, [row for row in rows if row.method == method.name])
        ax.set_xlabel(stage.map_axes[0])
        ax.set_ylabel(stage.map_axes[1])
        ax.set_title(method.label, loc="left")
    figure.text(0.02, 0.05 / height, "\n".join(sentence), fontsize=7, va="bottom", linespacing=1.35)
    return figure


def _brief(value: float) -> str:
    """A number, powers of ten as such where they are far from 1."""
    return f"{value:g}" if 1e-2 < value < 1e3 else f"$10^{{{np.log10(value):.0f}}}$"


def _plot_map(ax: Axes, method: Method, rows: Sequence[Row]) -> None:
    """Cells with the power of ten of the error; light is right, dark is wrong, in grey too."""
    across, up = (sorted({setting[k] for setting in method.settings}) for k in (0, 1))
    powers = np.full((len(up), len(across)), np.nan)
    for row in rows:
        if np.isfinite(row.error):
            cell = up.index(row.setting[1]), across.index(row.setting[0])
            powers[cell] = np.log10(max(row.error, LEAST))
    low, high = POWERS
    ax.imshow(
        np.ma.masked_invalid(powers), cmap="viridis_r", vmin=low, vmax=high, origin="lower", aspect="auto"
    )
    for (i, j), power in np.ndenumerate(powers):
        words = f"{power:.0f}" if np.isfinite(power) else "none"
        dark = power > 0.5 * (low + high)
        ax.text(j, i, words, ha="center", va="center", fontsize=7, color="white" if dark else "black")
    ax.set_xticks(range(len(across)), [_brief(value) for value in across])
    ax.set_yticks(range(len(up)), [f"{1e3 * value:.2g}" for value in up])
    ax.grid(False)


def save_chart(stage: Stage, rows: Sequence[Row], stem: Path) -> list[Path]:
    """Write `stem`.pdf and `stem`.png."""
    with styled():
        return save_figure(map_figure(stage, rows) if stage.map_axes else chart_figure(stage, rows), stem)


def _label(method: Method) -> str:
    return f"{method.label} ({method.given})"


def styles(stage: Stage) -> dict[str, dict[str, Any]]:
    """How each method is drawn: one look for one label, in whatever panel."""
    labels = list(dict.fromkeys(method.label for method in stage.methods))
    return {method.name: _style(labels.index(method.label), method) for method in stage.methods}


def _style(k: int, method: Method) -> dict[str, Any]:
    return {
        "color": COLORS[k % len(COLORS)],
        "linestyle": DASHES[(k + k // len(COLORS)) % len(DASHES)],
        "marker": MARKERS[k % len(MARKERS)],
        "markersize": 4 if method.ours else 3,
        "markerfacecolor": COLORS[k % len(COLORS)] if method.ours else "white",
        "markeredgewidth": 0.8,
        "linewidth": 1.8 if method.ours else 0.9,
    }


def _plot_errors(
    ax: Axes,
    stage: Stage,
    methods: Sequence[Method],
    rows: Sequence[Row],
    looks: dict[str, dict[str, Any]],
) -> None:
    """Errors over time, or over what the settings are."""
    for method in methods:
        found = [row for row in rows if row.method == method.name and np.isfinite(row.error)]
        ax.plot(_abscissa(stage, found), [max(row.error, LEAST) for row in found], **looks[method.name])
    _scaled(ax, stage)
    ax.set_ylabel(stage.error)


def _plot_profile(
    ax: Axes, stage: Stage, methods: Sequence[Method], rows: Sequence[Row], looks: dict[str, dict[str, Any]]
) -> None:
    """Errors in each class, of one setting of each method; of a single class over time, like the others."""
    for method in methods:
        found = [row for row in rows if row.method == method.name and row.profile and np.isfinite(row.error)]
        if len(stage.profile) == 1:
            ax.plot(
                _abscissa(stage, found), [max(row.profile[0], LEAST) for row in found], **looks[method.name]
            )
            continue
        shown = [row for row in found if row.setting == method.shown] or sorted(found, key=lambda r: r.error)[
            :1
        ]
        for row in shown:
            ax.plot(stage.profile, np.maximum(row.profile, LEAST), **looks[method.name])
    _scaled(ax, stage)
    if stage.profiled:
        ax.set_xscale("log")
        ax.set_xlabel(stage.profiled)
    ax.set_ylabel(stage.profile_error or stage.error)
    ax.set_title(stage.profile_title, loc="left")


def _abscissa(stage: Stage, rows: Sequence[Row]) -> list[float]:
    """Milliseconds, or what the settings are."""
    return [1e3 * row.seconds if stage.timed else row.setting[0] for row in rows]


def _scaled(ax: Axes, stage: Stage) -> None:
    """Logarithmic axes; plain numbers where they span few decades."""
    ax.set_yscale("log")
    ax.set_xlabel(TIME if stage.timed else stage.abscissa)
    if not stage.linear:
        ax.set_xscale("log")
        low, high = ax.get_xlim()
        if high < FEW * low:
            ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            ax.xaxis.set_major_formatter(FormatStrFormatter("%g"))
            ax.xaxis.set_minor_formatter(NullFormatter())
