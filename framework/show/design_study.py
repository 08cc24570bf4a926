"""The figure of a design study: each quantity over each parameter, one mark a design."""

from __future__ import annotations

from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from framework.atlas.design_study import DesignStudy
from framework.atlas.quantities import QUANTITIES
from framework.numerics.arrays import Array, BoolArray
from framework.show.style import ALARM, AXIS

CELL_SIZE = 1.5  # [in] of a cell
AREAS = {
    "area": "area reached",
    "free_area": "area on the reference's side of the locus",
    "carried_area": "area in which the load is carried",
}
COLORING_QUANTITY = "free_area"  # its colour identifies a design in all cells
PALETTE = "cividis"


def plot_study(study: DesignStudy) -> Axes:
    """Plot areas, and ranges of quantities, over each parameter of a study.

    A design has one colour in all cells. One that makes no robot is a cross below its parameters.
    """
    parameters = dict(zip(study.designs.names, study.designs.values.T, strict=True))
    rows = [*(key for key in AREAS if key in study.columns), *study.task.keys]
    size = (CELL_SIZE * len(parameters) + 1.6, CELL_SIZE * len(rows) + 0.4)
    drawing = Figure(figsize=size, layout="constrained")
    axes = drawing.subplots(len(rows), len(parameters), sharex="col", sharey="row", squeeze=False)
    norm = _color_scale(study.columns[COLORING_QUANTITY])
    for row, key in zip(axes, rows, strict=True):
        for ax, values in zip(row, parameters.values(), strict=True):
            marks = _draw_cell(study, key, values, ax, norm)
        row[0].set_ylabel("\n".join([*wrap(_row_name(key), 24), f"[{_row_unit(study, key)}]"]))
    refused = np.array(list(map(bool, study.why)))
    for ax, (name, values) in zip(axes[-1], parameters.items(), strict=True):
        ax.set_xlabel(name)
        _mark_refused(ax, values[refused])
    bar = drawing.colorbar(marks, ax=axes, pad=0.02, aspect=40)
    bar.set_label(f"colour: {AREAS[COLORING_QUANTITY]}  [{_row_unit(study, COLORING_QUANTITY)}]")
    drawing.suptitle(_describe_designs(refused), fontsize=8, x=0.02, ha="left")
    first: Axes = axes[0, 0]
    return first


def _describe_designs(refused: BoolArray) -> str:
    """Return the heading for designs of which some (a mask) make no robot."""
    refusals = f", {refused.sum()} of them make no robot (crosses)" if refused.any() else ""
    return f"{len(refused)} designs{refusals}\ndots: medians over the map, lines: least to largest"


def _color_scale(values: Array) -> Normalize:
    """Return the scale of colours over the finite values (designs,)."""
    finite = values[np.isfinite(values)]
    return Normalize(finite.min(), finite.max()) if finite.size else Normalize(0.0, 1.0)


def _mark_refused(ax: Axes, parameters: Array) -> None:
    """Mark designs that make no robot by crosses below their parameters (k,)."""
    height = np.full(len(parameters), 0.03)
    transform = ax.get_xaxis_transform()
    ax.plot(parameters, height, "x", color=ALARM, markersize=4, transform=transform, clip_on=False)


def _draw_cell(study: DesignStudy, key: str, places: Array, ax: Axes, norm: Normalize) -> PathCollection:
    """Draw the marks of one quantity over one parameter."""
    middle = study.columns[key if key in AREAS else f"{key}_median"]
    if key not in AREAS:
        least, largest = study.columns[f"{key}_least"], study.columns[f"{key}_largest"]
        ax.vlines(places, least, largest, color=AXIS, linewidth=0.8)
        if QUANTITIES[key].decades and np.nanmin(least, initial=np.inf) > 0:
            ax.set_yscale("log")
    return ax.scatter(
        places, middle, s=12, zorder=3, c=study.columns[COLORING_QUANTITY], cmap=PALETTE, norm=norm
    )


def _row_name(key: str) -> str:
    """Return the name of a quantity or area in words."""
    return AREAS[key] if key in AREAS else QUANTITIES[key].name


def _row_unit(study: DesignStudy, key: str) -> str:
    """Return the unit of a quantity or area."""
    return study.units[key if key in AREAS else f"{key}_median"].replace("^2", "\u00b2")


__all__ = ["plot_study"]
