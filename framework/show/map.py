"""Maps of a robot over its workspace, and its singular locus alone.

On a map bright is good, grey not reached, purple singular. Maps are figures, or a page that shows the values
of the pose under the pointer: one file, nothing fetched.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from html import escape
from pathlib import Path as FilePath
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patheffects import withStroke

from framework.atlas.nonsingular_mode_change import AssemblyModeChange
from framework.atlas.quantities import Quantity, quantity_unit, softest_directions
from framework.atlas.workspace_map import WorkspaceMap
from framework.dynamics.loading import LOAD_WORDS, LoadReason
from framework.errors import InvalidInput, check_choice
from framework.kinematics.continuation.tracking import assemble
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.path import Path
from framework.numerics.arrays import Array, BoolArray
from framework.numerics.output import Document, select_fields
from framework.planning.result import CrossingPlan
from framework.show.captions import display_name
from framework.show.page import page_part, standalone_page
from framework.show.plots import save_figure
from framework.show.scene import encode_array
from framework.show.style import (
    AXIS,
    BEYOND,
    COLORS,
    COLUMN_WIDTH,
    CROSSING,
    LOCUS,
    NOT_CARRIED,
    PATH,
    UNREACHED,
    ColumnLayout,
    Style,
    draw_curves,
    draw_dot,
    ensure_axes,
    legend_above,
    line_style,
)
from framework.singularity.drawn_locus import locus_curves
from framework.singularity.traced_locus import TracedLocus
from framework.tolerances import SAME_PLACE

# Both palettes are legible in grey, and without telling red from green.
SEQUENTIAL, DIVERGING = "cividis", "BrBG"
COLOR_PERCENTILES = (2.0, 98.0)  # of the values, ends of the colour scale: a pole would take all colours
PATH_SAMPLES = 401
DIRECTIONS = 12  # along the longer edge of a map, at which the softest direction is drawn
TYPE_2, OF_LOOPS = "singular locus (Type 2)", "singularity of loops or legs"
UNEXPLAINED, NOT_TRACED = "g changes sign, no curve found", "locus not traced"
WINDOW_EDGE, ASIDE, ABOVE = 3.4, 1.45, 1.4  # [in] of the window drawn, and of labels beside and above it
LETTERS = 60  # in a line of the title


def quantity_colours(workspace: WorkspaceMap, quantity: Quantity) -> tuple[Colormap, Normalize]:
    """Return palette and range of a quantity: bright is good; 0 is white if signed."""
    values = workspace.values[quantity.key]
    finite = values[np.isfinite(values)]
    if quantity.signed:
        largest = np.percentile(np.abs(finite), COLOR_PERCENTILES[1]) if finite.size else 1.0
        return colormaps[DIVERGING], Normalize(-largest, largest)
    palette = colormaps[SEQUENTIAL if quantity.large_is_good else f"{SEQUENTIAL}_r"]
    if quantity.decades:
        finite = finite[finite > 0]
    low, high = np.percentile(finite, COLOR_PERCENTILES) if finite.size else (0.1, 1.0)
    if high <= low:  # one value everywhere: a scale that is not empty
        high = low + max(abs(low), 1e-12) * 1e-6
    return palette, LogNorm(low, high) if quantity.decades else Normalize(min(low, 0.0), high)


def plot_map(workspace: WorkspaceMap, key: str = "g", *, path: Path | None = None) -> Axes:
    """Plot one quantity of a map, with the singular locus and a path of the platform on top.

    Without a path the reference is marked. Over one coordinate the quantity is a curve.
    """
    quantities = {quantity.key: quantity for quantity in workspace.quantities}
    check_choice("quantity of the map", key, quantities)
    quantity = quantities[key]
    if len(workspace.window.axes) == 1:
        return _plot_stroke(workspace, quantity, path)
    ax = _make_axes(workspace, quantity)
    ax.set_facecolor(UNREACHED)
    legend_entries = []  # colour and label of each shade
    for poses, colour, label in (
        (mask_not_carried(workspace, quantity), NOT_CARRIED, "load not carried"),
        (workspace.beyond_ranges, BEYOND, "beyond a limit"),
    ):
        if poses.any():
            shade = np.ma.masked_where(~poses, poses)
            _draw_cells(workspace, shade, ax, cmap=ListedColormap([colour]))
            legend_entries.append((colour, f"{label}: {poses.sum()} poses"))
    _draw_values(workspace, quantity, ax)
    if quantity.softest:
        _draw_softest(workspace, quantity, ax)
    halo = [withStroke(linewidth=2.8, foreground="white")]
    _draw_locus(workspace, ax, halo)
    _draw_path(workspace, path, ax, halo)
    # cells have no entry in the legend: a marker without points stands for each shade
    for colour, label in legend_entries:
        ax.plot([], [], "s", color=colour, label=label)
    ax.plot([], [], "s", color=UNREACHED, markeredgecolor=AXIS, label="not reached")
    ax.figure.legend(loc="lower left", ncols=2)
    return ax


def _plot_stroke(workspace: WorkspaceMap, quantity: Quantity, path: Path | None) -> Axes:
    """Plot a quantity over the only coordinate; shade where no pose counts, and mark singular points."""
    robot = workspace.robot
    ax = ensure_axes(None, height=2.6)
    values = workspace.values[quantity.key][:, 0]
    x = workspace.window.spans[0]
    _, norm = quantity_colours(workspace, quantity)
    ax.plot(x, values, **line_style(0))
    if quantity.decades:
        ax.set_yscale("log")
    if (np.abs(values[np.isfinite(values)]) > 10.0 * abs(norm.vmax or np.inf)).any():
        ax.set_ylim(norm.vmin, norm.vmax)  # a pole would hide the rest
    lower, upper = _window_edges(workspace)[0]
    for is_missing, colour, label in (
        (~(workspace.reached | workspace.beyond_ranges)[:, 0], UNREACHED, "not reached"),
        (workspace.beyond_ranges[:, 0], BEYOND, "beyond a limit"),
        (mask_not_carried(workspace, quantity)[:, 0], NOT_CARRIED, "load not carried"),
    ):
        if is_missing.any():
            shaded = np.repeat(is_missing, 2)  # of each cell its two edges
            edges = np.repeat(np.linspace(lower, upper, len(x) + 1), 2)[1:-1]
            whole = ax.get_xaxis_transform()
            ax.fill_between(edges, 0, 1, shaded, transform=whole, color=colour, linewidth=0, label=label)
    for is_type2, label, dash in ((True, TYPE_2, "-"), (False, OF_LOOPS, ":")):
        points = [curve.x[0, 0] for curve in workspace.locus.curves if curve.is_type2 == is_type2]
        for k, point in enumerate(points):
            ax.axvline(point, color=LOCUS, linewidth=1.4, linestyle=dash, label=None if k else label)
    if path is None:
        ax.axvline(robot.reference.x[0], color="black", linewidth=0.6, linestyle="--", label="reference")
    else:
        line, _ = path_on_map(workspace, path)
        ax.axvspan(line.min(), line.max(), ymax=0.03, color=PATH, label="path")
    ax.set(xlim=(lower, upper), xlabel=f"{robot.axis_names[0]}  [{robot.axis_units[0]}]")
    ax.set_ylabel(fill(_quantity_label(workspace, quantity), LETTERS // 2))
    _set_heading(ax, workspace, quantity)
    ax.figure.legend(loc="outside lower left", ncols=2)
    return ax


def _quantity_label(workspace: WorkspaceMap, quantity: Quantity) -> str:
    """Return the name of a quantity with its unit."""
    unit = quantity_unit(workspace.robot, quantity)
    return f"{display_name(quantity.key)}  [{unit}]".replace("[1]", "(no unit)")


def _set_heading(ax: Axes, workspace: WorkspaceMap, quantity: Quantity) -> None:
    """Write what a quantity is, and the title of the map, above a figure."""
    heading = [fill(line, LETTERS) for line in (quantity.name, map_title(workspace))]
    drawing = ax.figure
    assert isinstance(drawing, Figure)
    drawing.suptitle("\n".join(heading), fontsize=8, x=0.02, ha="left")


def _draw_cells(workspace: WorkspaceMap, values: np.ma.MaskedArray, ax: Axes, **colours: Any) -> AxesImage:
    """Draw masked values (I, J) as coloured cells about the poses of the window."""
    edges = tuple(_window_edges(workspace).ravel().tolist())
    style = Style(origin="lower", interpolation="nearest", aspect="auto", extent=edges)
    return ax.imshow(values.T, **style, **colours)


def _draw_values(workspace: WorkspaceMap, quantity: Quantity, ax: Axes) -> None:
    """Draw the values of a quantity as colours, and the colour scale."""
    palette, norm = quantity_colours(workspace, quantity)
    values = workspace.values[quantity.key]
    mesh = _draw_cells(workspace, np.ma.masked_invalid(values), ax, cmap=palette, norm=norm)
    finite = values[np.isfinite(values)]
    # the scale gets an arrow at each end beyond which there are values
    below = finite.min(initial=np.inf) < norm.vmin
    above = finite.max(initial=-np.inf) > norm.vmax
    extend = ("both" if above else "min") if below else ("max" if above else "neither")
    width = 0.04 * max(1.0, ax.get_box_aspect() or 1.0)  # over the width of the window
    bar = ax.figure.colorbar(mesh, cax=ax.inset_axes((1.0 + width, 0.0, width, 1.0)), extend=extend)
    bar.set_label(_quantity_label(workspace, quantity))


def _draw_softest(workspace: WorkspaceMap, quantity: Quantity, ax: Axes) -> None:
    """Draw the softest direction of poses all over the map as short lines, seen on its plane."""
    axes = list(workspace.window.axes)
    if not is_to_scale(workspace):
        return
    stride = max(1, max(workspace.reason.shape) // DIRECTIONS)
    shown = np.zeros(workspace.reason.shape, dtype=bool)
    shown[stride // 2 :: stride, stride // 2 :: stride] = True
    shown &= np.isfinite(workspace.values[quantity.key])
    twists = softest_directions(workspace.robot, quantity, workspace.q[shown])[:, axes]  # (k, 2)
    rows, columns = np.nonzero(shown)
    first, second = workspace.window.spans
    middle = np.column_stack([first[rows], second[columns]])
    half = 0.4 * stride * workspace.window.cell.min() * twists
    lines = np.stack([middle - half, middle + half], axis=1)
    style = Style(
        colors="black", linewidths=1.0, path_effects=[withStroke(linewidth=2.4, foreground="white")]
    )
    ax.add_collection(LineCollection(list(lines), label="softest direction", **style))


def _draw_locus(workspace: WorkspaceMap, ax: Axes, halo: list[withStroke]) -> None:
    """Draw the curves of the locus, and crosses where g changes sign without a curve.

    The `halo` is a white edge that sets curves off the colours of the map.
    """
    locus = workspace.locus
    style = Style(color=LOCUS, linewidth=1.4, path_effects=halo)
    draw_curves(ax, [curve.x for curve in locus.curves if curve.is_type2], TYPE_2, **style)
    others = [curve.x for curve in locus.curves if not curve.is_type2]
    draw_curves(ax, others, OF_LOOPS, **style, linestyle=":")
    if len(locus.unexplained):
        ax.plot(*locus.unexplained.T, "x", color=LOCUS, markersize=3, label=UNEXPLAINED)
    if locus.why_not:
        ax.plot([], [], " ", label=NOT_TRACED)


def _draw_path(workspace: WorkspaceMap, path: Path | None, ax: Axes, halo: list[withStroke]) -> None:
    """Draw a path with a dot at its start; draw the reference when None."""
    line, projected = path_on_map(workspace, path)
    if path is None:
        style = Style(color="black", markeredgecolor="white", markersize=6)
        ax.plot(*line[0], "P", label=f"reference{projected}", **style)
        return
    ax.plot(*line.T, color=PATH, linewidth=1.6, linestyle="--", path_effects=halo, label=f"path{projected}")
    ax.plot(*line[0], "o", color=PATH, markersize=4, markeredgecolor="white", markeredgewidth=0.8)


def mask_not_carried(workspace: WorkspaceMap, quantity: Quantity) -> BoolArray:
    """Mask the poses (I, J) that are reached but do not carry the load."""
    if workspace.load is None or not quantity.loaded:
        return np.zeros(workspace.reason.shape, dtype=bool)
    return workspace.reached & (workspace.load != LoadReason.CARRIED)


def path_on_map(workspace: WorkspaceMap, path: Path | None) -> tuple[Array, str]:
    """Return points (m, 2) of a path, or the reference, and ", projected" if they are off the map's plane."""
    window = workspace.window
    axes = list(window.axes)
    reference = workspace.robot.reference.x
    x = reference[None] if path is None else path(np.linspace(0.0, 1.0, PATH_SAMPLES))  # (m, n)
    offsets = (x - window.constants) / workspace.robot.platform_scale
    offsets[:, axes] = 0.0
    return x[:, axes], "" if np.abs(offsets).max() < SAME_PLACE else ", projected"


def is_to_scale(workspace: WorkspaceMap) -> bool:
    """Return whether both axes of the map have the same unit."""
    lengths = workspace.robot.translations[list(workspace.window.axes)]
    return bool(lengths.all() or not lengths.any())


def _make_axes(workspace: WorkspaceMap, quantity: Quantity) -> Axes:
    """Make labelled axes for the window, titled by the quantity and the robot."""
    robot = workspace.robot
    axes = workspace.window.axes
    wide, high = workspace.window.upper - workspace.window.lower
    shape = high / wide if is_to_scale(workspace) else 0.8
    width = WINDOW_EDGE / max(1.0, shape)  # [in]
    drawing = Figure(figsize=(max(width + ASIDE, COLUMN_WIDTH), width * shape + ABOVE), layout=ColumnLayout())
    ax = drawing.subplots()
    ax.set_box_aspect(shape)
    ax.grid(False)
    ax.locator_params(axis="x", nbins=int(np.clip(9 / shape, 2, 9)))
    xlim, ylim = _window_edges(workspace)
    xlabel, ylabel = (f"{robot.axis_names[k]}  [{robot.axis_units[k]}]" for k in axes)
    ax.set(xlim=xlim, ylim=ylim, xlabel=xlabel, ylabel=ylabel)
    _set_heading(ax, workspace, quantity)
    return ax


def map_title(workspace: WorkspaceMap) -> str:
    """Return the title: robot, working mode, and the constant coordinates."""
    robot = workspace.robot
    window = workspace.window
    flexible = "" if robot.flexibility == "rigid" else f", {display_name(robot.flexibility)}"
    coordinates = []
    coordinate = "{}\u00a0=\u00a0{:.4g}\u00a0{}"  # no line is broken inside
    constants = window.constants.round(9) + 0.0  # no -0
    for k, axis in enumerate(zip(robot.axis_names, constants, robot.axis_units, strict=True)):
        if k not in window.axes:
            coordinates.append(coordinate.format(*axis))
    place = f", at {', '.join(coordinates)}" if coordinates else ""
    return f"{display_name(robot.name)}{flexible}: working mode of the reference{place}"


def _window_edges(workspace: WorkspaceMap) -> Array:
    """Return the two outer edges of the cells along both axes, (2, 2), one axis a row."""
    window = workspace.window
    return np.column_stack([window.lower - 0.5 * window.cell, window.upper + 0.5 * window.cell])


def save_map_figures(
    workspace: WorkspaceMap,
    folder: FilePath,
    *,
    path: Path | None = None,
    keys: Sequence[str] | None = None,
) -> list[FilePath]:
    """Write a PDF and a PNG of each quantity, or of those of `keys`, into a folder: map_g.pdf and so on."""
    files = []
    for key in [quantity.key for quantity in workspace.quantities] if keys is None else keys:
        files += save_figure(partial(plot_map, workspace, key, path=path), folder / f"map_{key}")
    return files


# ------------------------------------------------------------------ as a page

LEAD = "All poses are reached from the robot's reference without leaving its working mode."
ON_LOCUS = "On the purple locus (Type 2) the motors do not hold the platform."


def map_page(workspace: WorkspaceMap, *, path: Path | None = None) -> str:
    """Return the page of a map as HTML."""
    heading = map_title(workspace)
    has_type2 = any(curve.is_type2 for curve in workspace.locus.curves)
    return standalone_page(
        heading,
        page_part(
            "map.html",
            title=escape(heading),
            lead=escape(f"{LEAD} {ON_LOCUS}" if has_type2 else LEAD),
            found=escape(f"Singular locus: {workspace.locus_sentence}."),
        ),
        _map_document(workspace, path),
        styles=["map.css"],
        scripts=["map.js"],
    )


def _map_document(workspace: WorkspaceMap, path: Path | None) -> Document:
    """Return the data of the map's page: quantities, reasons, curves and legend."""
    robot = workspace.robot
    window = workspace.window
    unexplained = workspace.locus.unexplained  # points at which g changes its sign without a curve
    kinds = {curve.is_type2 for curve in workspace.locus.curves}
    # points, colour, width and dashes of each line
    lines = [(curve.x, LOCUS, 2.0, [] if curve.is_type2 else [2, 3]) for curve in workspace.locus.curves]
    # text, colour, whether an area
    legend = [(text, LOCUS, False) for kind, text in ((True, TYPE_2), (False, OF_LOOPS)) if kind in kinds]
    if len(unexplained):
        legend.append((UNEXPLAINED, LOCUS, False))
    line, projected = path_on_map(workspace, path)
    if path is None:
        legend.append((f"dot: the reference{projected}", "var(--twist)", False))
    else:
        lines.append((line, PATH, 2.5, [7, 4]))
        legend.append((f"path, from the dot on{projected}", PATH, False))
    if workspace.load is not None:
        lost = int(workspace.reached.sum()) - workspace.load_counts[LOAD_WORDS[LoadReason.CARRIED]]
        legend.append((f"load not carried: {lost} poses", NOT_CARRIED, True))
    within_limits = " within all limits" if workspace.keeps_limits else ""
    legend.append((f"not reached{within_limits}", UNREACHED, True))
    return {
        "shape": window.shape,
        "axes": [f"{robot.axis_names[k]} [{robot.axis_units[k]}]" for k in window.axes],
        "spans": window.spans,
        "edges": _window_edges(workspace),
        "to_scale": is_to_scale(workspace),
        "quantities": [_quantity_document(workspace, quantity) for quantity in workspace.quantities],
        "reason": encode_array(workspace.reason.astype(np.uint8)),
        "reasons": workspace.reason_words,
        "assembly": encode_array(workspace.assembly.astype(np.int8).view(np.uint8)),
        "has_sides": robot.n_a == robot.n and len(robot.passive) > 0,
        "load": None if workspace.load is None else encode_array(workspace.load),
        "loads": [LOAD_WORDS[kind] for kind in LoadReason],
        "unreached": list(bytes.fromhex(UNREACHED[1:])),  # red, green and blue of #rrggbb
        "not_carried": list(bytes.fromhex(NOT_CARRIED[1:])),
        "curves": [
            {"points": np.round(points, 9), "colour": colour, "width": width, "dash": dash}
            for points, colour, width, dash in lines
        ],
        "marks": [np.round(line[0], 9)],
        "crosses": np.round(unexplained, 9),
        "legend": legend,
    }


def _quantity_document(workspace: WorkspaceMap, quantity: Quantity) -> Document:
    """Return a quantity for the page: values, range and colours."""
    palette, norm = quantity_colours(workspace, quantity)
    shades = palette(np.linspace(0.0, 1.0, 256))[:, :3]
    reading = f"Bright is {'large' if quantity.large_is_good else 'small'}, and good."
    if quantity.signed:
        reading = "White is 0, on the locus; the two colours are its two sides, deeper with |g|."
    return {
        **select_fields(quantity, "key", "name", "decades", "loaded"),
        "unit": quantity_unit(workspace.robot, quantity),
        "reading": reading,
        "values": encode_array(workspace.values[quantity.key].astype("<f4")),
        "range": [norm.vmin or 0.0, norm.vmax or 0.0],
        "colours": np.round(255 * shades).astype(int),
    }


# ------------------------------------------------------------------ the singular locus alone


def plot_locus(robot: ParallelRobot, plan: CrossingPlan | None = None, ax: Axes | None = None) -> Axes:
    """Plot the singular locus over the plane of the platform, with a plan's path.

    The locus is that of the reference's working mode, with springs at rest.

    Raises:
        InvalidInput: the platform has not exactly two translations, or the motors are redundant.
        NotAssembled: the loops do not close at the reference.
    """
    reference = assemble(robot)
    locus = locus_curves(robot, reference.q, reference.x)
    if locus is None:
        raise InvalidInput(
            f"{robot.name}: a map needs a platform with two translations and a motor for each of its axes, "
            f"it has {', '.join(robot.axis_names)} and {robot.n_a} motors"
        )
    axes = list(locus.axes)
    ax = ensure_axes(ax, height=3.2)
    draw_curves(ax, locus.curves, "singular locus", color=LOCUS, linewidth=1.4)
    if plan is None:
        ax.plot(*reference.x[axes], "+", color=CROSSING, markersize=6, label="reference")
    else:
        _draw_from_dot(ax, plan.path(np.linspace(0.0, 1.0, 201))[:, axes], "path")
        for crossing in plan.crossings:
            draw_dot(ax, *crossing.platform[axes])
    ax.set_aspect("equal")
    return _label_axes(ax, [f"{robot.axis_names[k]}  [m]" for k in axes])


def plot_motor_locus(locus: TracedLocus, change: AssemblyModeChange | None = None) -> Axes:
    """Plot the locus over two free motors, with its cusps and a change of mode.

    Raises:
        InvalidInput: the locus was traced over coordinates of the platform.
    """
    robot = locus.robot
    if locus.free[0] not in robot.actuator_names:
        raise InvalidInput("locus: needs one that was traced in two motors, see the `free` of `trace_locus`")
    free = [robot.actuator_names.index(name) for name in locus.free]
    ax = ensure_axes(None, height=3.2)
    curves = [curve.motors[:, free] for curve in locus.curves if curve.kind == "type_2"]
    draw_curves(ax, curves, "singular locus", color=LOCUS, linewidth=1.4)
    cusps = [cusp.motors[free] for cusp in locus.cusps]
    draw_curves(ax, cusps, "cusp", color=CROSSING, marker="o", linestyle="", markersize=4, zorder=3)
    if change is not None:
        line = change.motors[:, free]
        _draw_from_dot(ax, line, "to another mode")
        ax.set(xlim=_range_about(line[:, 0]), ylim=_range_about(line[:, 1]))
    return _label_axes(ax, [f"{robot.actuator_names[k]}  [{robot.motor_joint_units[k]}]" for k in free])


def _draw_from_dot(ax: Axes, line: Array, label: str) -> None:
    """Draw a line (m, 2), with a dot at its start."""
    ax.plot(*line.T, label=label, **line_style(0))
    ax.plot(*line[0], "o", color=COLORS[0], markersize=3)


def _label_axes(ax: Axes, labels: list[str]) -> Axes:
    """Label both axes, and put the legend above; return the axes."""
    ax.set(xlabel=labels[0], ylabel=labels[1])
    legend_above(ax, columns=2)
    return ax


def _range_about(values: Array) -> tuple[float, float]:
    """Return the limits of an axis about values (m,), four times as wide as their range."""
    middle = 0.5 * (values.min() + values.max())
    half = 2.0 * max(np.ptp(values), 1e-6)  # not empty where all values are the same
    return middle - half, middle + half
