"""Maps of a robot over its workspace: bright is good, grey not reached, purple singular.

As figures, and as a page of its own with the values of the pose under the pointer: one file, nothing fetched.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from html import escape
from pathlib import Path as FilePath
from textwrap import fill

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from framework.atlas.quantities import Quantity, quantity_unit
from framework.atlas.workspace_map import WorkspaceMap
from framework.dynamics.loading import LOAD_WORDS, LoadReason
from framework.laws.path import Path
from framework.numerics.arrays import Array, BoolArray
from framework.numerics.output import Document, select_fields
from framework.show.captions import display_name
from framework.show.plots import save_figure
from framework.show.standalone import encode_array, page_part, standalone_page
from framework.show.style import (
    AXIS,
    BEYOND,
    COLUMN_WIDTH,
    LOCUS,
    NOT_CARRIED,
    PATH,
    UNREACHED,
    Style,
    draw_curves,
)
from framework.tolerances import SAME_PLACE

# Both can be told apart without red and green, and in grey.
SEQUENTIAL, DIVERGING = "cividis", "BrBG"
COLOR_PERCENTILES = (2.0, 98.0)  # percentiles between which colours change: a pole would take them all
PATH_SAMPLES = 401  # of a path
UNEXPLAINED, NOT_TRACED = "g changes sign, no curve found", "locus not traced"
WINDOW_EDGE, ASIDE, ABOVE = 3.4, 1.45, 1.4  # [in] of the window drawn, and of labels beside and above it
LETTERS = 60  # of a line above the window


def quantity_colours(workspace: WorkspaceMap, quantity: Quantity) -> tuple[Colormap, Normalize]:
    """Return palette and range of a quantity: bright is good; g is white on the locus."""
    values = workspace.values[quantity.key]
    finite = values[np.isfinite(values)]
    if quantity.signed:
        largest = np.percentile(np.abs(finite), COLOR_PERCENTILES[1]) if finite.size else 1.0
        return colormaps[DIVERGING], Normalize(-largest, largest)
    palette = colormaps[SEQUENTIAL if quantity.large_is_good else f"{SEQUENTIAL}_r"]
    if quantity.decades:
        finite = finite[finite > 0]
    low, high = np.percentile(finite, COLOR_PERCENTILES) if finite.size else (0.1, 1.0)
    high = high if high > low else low + max(abs(low), 1e-12) * 1e-6
    return palette, LogNorm(low, high) if quantity.decades else Normalize(min(low, 0.0), high)


def plot_map(workspace: WorkspaceMap, key: str = "g", *, path: Path | None = None) -> Axes:
    """Plot one quantity of a map, with the singular locus and a path on top."""
    quantity = next(quantity for quantity in workspace.quantities if quantity.key == key)
    lacking = [
        (mask_not_carried(workspace, quantity), NOT_CARRIED, "load not carried"),
        (workspace.beyond_ranges, BEYOND, "beyond a limit"),
    ]
    lacking = [entry for entry in lacking if entry[0].any()]
    ax = _make_axes(workspace, quantity)
    edges = [cell_edges(span) for span in workspace.window.spans]
    ax.set_facecolor(UNREACHED)
    for poses, colour, _ in lacking:
        shade = np.ma.masked_where(~poses, poses)
        ax.pcolormesh(*edges, shade.T, cmap=ListedColormap([colour]), rasterized=True, linewidth=0)
    _draw_values(workspace, quantity, edges, ax)
    halo = [withStroke(linewidth=2.8, foreground="white")]
    _draw_locus(workspace, ax, halo)
    _draw_path(workspace, path, ax, halo)
    for poses, colour, label in lacking:
        ax.plot([], [], "s", color=colour, label=f"{label}: {poses.sum()} poses")
    ax.plot([], [], "s", color=UNREACHED, markeredgecolor=AXIS, label="not reached")
    ax.figure.legend(loc="outside lower left", ncols=2)
    return ax


def _draw_values(workspace: WorkspaceMap, quantity: Quantity, edges: Sequence[Array], ax: Axes) -> None:
    """Draw the values of a quantity as colours, and their scale."""
    palette, norm = quantity_colours(workspace, quantity)
    values = workspace.values[quantity.key]
    mesh = ax.pcolormesh(
        *edges, np.ma.masked_invalid(values).T, cmap=palette, norm=norm, rasterized=True, linewidth=0
    )
    finite = values[np.isfinite(values)]
    below, above = finite.min(initial=np.inf) < norm.vmin, finite.max(initial=-np.inf) > norm.vmax
    extend = "both" if below and above else "min" if below else "max" if above else "neither"
    width = 0.04 * max(1.0, ax.get_box_aspect() or 1.0)  # of the window
    bar = ax.figure.colorbar(mesh, cax=ax.inset_axes((1.0 + width, 0.0, width, 1.0)), extend=extend)
    unit = quantity_unit(workspace.robot, quantity)
    bar.set_label(f"{display_name(quantity.key)}  [{unit}]".replace("[1]", "(no unit)"))


def _draw_locus(workspace: WorkspaceMap, ax: Axes, halo: list[withStroke]) -> None:
    """Draw the curves of the locus, and crosses at singular poses without a curve."""
    locus, style = workspace.locus, Style(color=LOCUS, linewidth=1.4, path_effects=halo)
    draw_curves(ax, [curve.x for curve in locus.curves], "singular locus (Type 2)", **style)
    if len(locus.unexplained):
        ax.plot(*locus.unexplained.T, "x", color=LOCUS, markersize=3, label=UNEXPLAINED)
    if locus.why_not:
        ax.plot([], [], " ", label=NOT_TRACED)


def _draw_path(workspace: WorkspaceMap, path: Path | None, ax: Axes, halo: list[withStroke]) -> None:
    """Draw a path from the dot on, or the reference without one."""
    if path is None:
        start = workspace.robot.reference.x[list(workspace.window.axes)]
        ax.plot(*start, "P", color="black", markeredgecolor="white", markersize=6, label="reference")
        return
    line, projected = path_on_map(workspace, path)
    ax.plot(*line.T, color=PATH, linewidth=1.6, linestyle="--", path_effects=halo, label=f"path{projected}")
    ax.plot(*line[0], "o", color=PATH, markersize=4, markeredgecolor="white", markeredgewidth=0.8)


def mask_not_carried(workspace: WorkspaceMap, quantity: Quantity) -> BoolArray:
    """Mask poses (I, J) that are reached but do not carry the load."""
    if workspace.load is None or not quantity.loaded:
        return np.zeros(workspace.reason.shape, dtype=bool)
    return workspace.reached & (workspace.load != LoadReason.CARRIED)


def path_on_map(workspace: WorkspaceMap, path: Path) -> tuple[Array, str]:
    """Return points (m, 2) of a path, and ", projected" for a path off the map's plane."""
    x, axes = path(np.linspace(0.0, 1.0, PATH_SAMPLES)), list(workspace.window.axes)
    offset = np.delete((x - workspace.window.constants) / workspace.robot.platform_scale, axes, axis=1)
    return x[:, axes], "" if np.abs(offset).max(initial=0.0) < SAME_PLACE else ", projected"


def is_to_scale(workspace: WorkspaceMap) -> bool:
    """Return whether both axes have one unit."""
    lengths = workspace.robot.translations[list(workspace.window.axes)]
    return bool(lengths.all() or not lengths.any())


def _make_axes(workspace: WorkspaceMap, quantity: Quantity) -> Axes:
    """Make labelled axes for the window, to scale, below the name of the quantity and the title."""
    robot, axes = workspace.robot, workspace.window.axes
    wide, high = workspace.window.upper - workspace.window.lower
    shape = high / wide if is_to_scale(workspace) else 0.8
    width = WINDOW_EDGE * min(1.0, 1.0 / shape)
    drawing = Figure(figsize=(max(width + ASIDE, COLUMN_WIDTH), width * shape + ABOVE), layout="compressed")
    ax = drawing.subplots()
    ax.set_box_aspect(shape)
    ax.grid(False)
    ax.locator_params(axis="x", nbins=int(np.clip(9 / shape, 2, 9)))
    xlim, ylim = (cell_edges(span)[[0, -1]] for span in workspace.window.spans)
    labels = [f"{robot.axis_names[k]}  [{robot.axis_units[k]}]" for k in axes]
    ax.set(xlim=xlim, ylim=ylim, xlabel=labels[0], ylabel=labels[1])
    heading = "\n".join([fill(quantity.name, LETTERS), fill(map_title(workspace), LETTERS)])
    drawing.suptitle(heading, fontsize=8, x=0.02, ha="left")
    return ax


def map_title(workspace: WorkspaceMap) -> str:
    """Return the title: robot, working mode, and the constant coordinates."""
    robot, axes = workspace.robot, workspace.window.axes
    coordinates = [
        f"{robot.axis_names[k]}\u00a0=\u00a0{round(value, 9) + 0.0:.4g}\u00a0{robot.axis_units[k]}"
        for k, value in enumerate(workspace.window.constants)
        if k not in axes
    ]
    flexible = "" if robot.flexibility == "rigid" else f", {display_name(robot.flexibility)}"
    place = f", at {', '.join(coordinates)}" if coordinates else ""
    return f"{display_name(robot.name)}{flexible}: working mode of the reference{place}"


def cell_edges(span: Array) -> Array:
    """Return the edges (m + 1,) of the cells around equal steps (m,)."""
    half = 0.5 * (span[1] - span[0])
    return np.append(span - half, span[-1] + half)


def save_map_figures(
    workspace: WorkspaceMap, folder: FilePath, *, path: Path | None = None
) -> list[FilePath]:
    """Write a PDF and a PNG of each quantity into a folder: map_g.pdf and so on."""
    return [
        file
        for quantity in workspace.quantities
        for file in save_figure(
            partial(plot_map, workspace, quantity.key, path=path), folder / f"map_{quantity.key}"
        )
    ]


# ------------------------------------------------------------------ as a page

LEAD = "All poses are reached from the robot's reference without leaving its working mode."
ON_LOCUS = "On the purple locus (Type 2) the motors do not hold the platform."


def map_page(workspace: WorkspaceMap, *, path: Path | None = None) -> str:
    """Return the map's page as HTML."""
    heading = map_title(workspace)
    return standalone_page(
        heading,
        page_part(
            "map.html",
            title=escape(heading),
            lead=escape(f"{LEAD} {ON_LOCUS}" if workspace.locus.curves else LEAD),
            found=escape(f"Singular locus: {workspace.locus.sentence}."),
        ),
        _map_document(workspace, path),
        styles=["map.css"],
        scripts=["map.js"],
    )


def _map_document(workspace: WorkspaceMap, path: Path | None) -> Document:
    """Return the data of the map's page: quantities, reasons, curves and legend."""
    robot, window = workspace.robot, workspace.window
    curves = [_curve_document(curve.x, LOCUS, 2.0, []) for curve in workspace.locus.curves]
    legend: list[tuple[str, str, bool]] = [("singular locus (Type 2)", LOCUS, False)] if curves else []
    if len(workspace.locus.unexplained):
        legend.append((UNEXPLAINED, LOCUS, False))
    mark = robot.reference.x[list(window.axes)]
    if path is not None:
        line, projected = path_on_map(workspace, path)
        curves.append(_curve_document(line, PATH, 2.5, [7, 4]))
        legend.append((f"path, from the dot on{projected}", PATH, False))
        mark = line[0]
    if workspace.load is not None:
        lost = int(workspace.reached.sum()) - workspace.load_counts[LOAD_WORDS[LoadReason.CARRIED]]
        legend.append((f"load not carried: {lost} poses", NOT_CARRIED, True))
    legend.append(
        ("not reached within all limits" if workspace.keeps_limits else "not reached", UNREACHED, True)
    )
    return {
        "shape": window.shape,
        "axes": [f"{robot.axis_names[k]} [{robot.axis_units[k]}]" for k in window.axes],
        "spans": window.spans,
        "edges": [cell_edges(span)[[0, -1]] for span in window.spans],
        "to_scale": is_to_scale(workspace),
        "quantities": [_quantity_document(workspace, quantity) for quantity in workspace.quantities],
        "reason": encode_array(workspace.reason.astype(np.uint8)),
        "reasons": workspace.reason_words,
        "assembly": encode_array(workspace.assembly.astype(np.int8).view(np.uint8)),
        "has_sides": robot.n_a == robot.n and len(robot.passive) > 0,
        "load": None if workspace.load is None else encode_array(workspace.load),
        "loads": [LOAD_WORDS[kind] for kind in LoadReason],
        "unreached": _rgb_values(UNREACHED),
        "not_carried": _rgb_values(NOT_CARRIED),
        "curves": curves,
        "marks": [np.round(mark, 9)],
        "crosses": np.round(workspace.locus.unexplained, 9),
        "legend": legend,
    }


def _quantity_document(workspace: WorkspaceMap, quantity: Quantity) -> Document:
    """Return a quantity for the page: values, range and colours."""
    palette, norm = quantity_colours(workspace, quantity)
    shades = np.round(255 * palette(np.linspace(0.0, 1.0, 256))[:, :3]).astype(int)
    return {
        **select_fields(quantity, "key", "name", "decades", "loaded"),
        "unit": quantity_unit(workspace.robot, quantity),
        "reading": _describe_colours(quantity),
        "values": encode_array(workspace.values[quantity.key].astype("<f4")),
        "range": [norm.vmin or 0.0, norm.vmax or 0.0],
        "colours": shades,
    }


def _describe_colours(quantity: Quantity) -> str:
    """Describe which colours of a quantity are good."""
    if quantity.signed:
        return "White is 0, on the locus; the two colours are its two sides, deeper with |g|."
    return f"Bright is {'large' if quantity.large_is_good else 'small'}, and good."


def _curve_document(points: Array, colour: str, width: float, dash: list[int]) -> Document:
    """Return a curve (m, 2) for the page, with its look."""
    return {"points": np.round(points, 9), "colour": colour, "width": width, "dash": dash}


def _rgb_values(colour: str) -> list[int]:
    """Return red, green and blue (0..255) of a colour #rrggbb."""
    return [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
