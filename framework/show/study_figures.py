"""One figure for each kind of study: of dimensions, of levels of fidelity, of robustness."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from framework.atlas.design_study import DesignStudy
from framework.atlas.quantities import QUANTITIES
from framework.control.sensors import ControlLoop
from framework.control.study import Study
from framework.fidelity.fidelity_study import ERROR_ROUNDING, FidelityStudy
from framework.show.captions import display_name
from framework.show.style import ALARM, AXIS, GOOD, draw_dashed, legend_above, line_style, new_figure

CELL_SIZE = 1.5  # [in] of a cell
AREAS = {
    "area": "area reached",
    "free_area": "area on the reference's side of the locus",
    "carried_area": "area in which the load is carried",
}
COLORING_QUANTITY = "free_area"  # its value colours the marks of a design in all cells
PALETTE = "cividis"


def plot_study(study: DesignStudy) -> Axes:
    """Plot areas, and ranges of quantities, over each parameter of a study.

    A design has the same colour in all cells. A design that makes no robot is a cross at the bottom. The axes
    returned stand for the whole figure.
    """
    parameters = dict(zip(study.designs.names, study.designs.values.T, strict=True))
    rows = [*(key for key in AREAS if key in study.columns), *study.task.keys]
    # marks are areas or, with lines from the least to the largest value, medians
    marked = {key: key if key in AREAS else f"{key}_median" for key in rows}
    units = {key: study.units[column].replace("^2", "\u00b2") for key, column in marked.items()}
    size = (CELL_SIZE * len(parameters) + 1.6, CELL_SIZE * len(rows) + 0.4)
    drawing = Figure(figsize=size, layout="constrained")
    axes = drawing.subplots(len(rows), len(parameters), sharex="col", sharey="row", squeeze=False)
    colours = study.columns[COLORING_QUANTITY]
    finite = colours[np.isfinite(colours)]
    norm = Normalize(finite.min(), finite.max()) if finite.size else Normalize(0.0, 1.0)
    for row, key in zip(axes, rows, strict=True):
        for ax, values in zip(row, parameters.values(), strict=True):
            middle = study.columns[marked[key]]
            if key not in AREAS:
                least, largest = study.columns[f"{key}_least"], study.columns[f"{key}_largest"]
                ax.vlines(values, least, largest, color=AXIS, linewidth=0.8)
                if QUANTITIES[key].decades and np.nanmin(least, initial=np.inf) > 0:
                    ax.set_yscale("log")
            marks = ax.scatter(values, middle, s=12, zorder=3, c=colours, cmap=PALETTE, norm=norm)
        name = AREAS[key] if key in AREAS else QUANTITIES[key].name
        row[0].set_ylabel("\n".join([*wrap(name, 24), f"[{units[key]}]"]))
    refused = np.array(study.why) != ""
    for ax, (name, values) in zip(axes[-1], parameters.items(), strict=True):
        ax.set_xlabel(name)
        crosses = values[refused]  # at the bottom, 0.03 of the height of the axes
        height = np.full(len(crosses), 0.03)
        whole = ax.get_xaxis_transform()
        ax.plot(crosses, height, "x", color=ALARM, markersize=4, transform=whole, clip_on=False)
    bar = drawing.colorbar(marks, ax=axes, pad=0.02, aspect=40)
    bar.set_label(f"colour: {AREAS[COLORING_QUANTITY]}  [{units[COLORING_QUANTITY]}]")
    refusals = f", {refused.sum()} of them make no robot (crosses)" if refused.any() else ""
    heading = f"{len(refused)} designs{refusals}\ndots: medians over the map, lines: least to largest"
    drawing.suptitle(heading, fontsize=8, x=0.02, ha="left")
    first: Axes = axes[0, 0]
    return first


def plot_fidelity(study: FidelityStudy) -> Axes:
    """Plot the torque and platform errors of each level along s.

    Torque errors are over the peak torque, platform errors over the path's length. A level has no curve if it
    has no torques, or those of a lower level.
    """
    axes = new_figure(2, height=2.0)
    s = study.highest.law(study.times)
    drawn = [each for each in study.levels if each.motion is not None and not each.same_as]
    for k, comparison in enumerate(drawn):
        label = display_name(comparison.level.name)
        for ax, errors in zip(axes, (comparison.torque_error, comparison.platform_error), strict=True):
            ax.plot(s, np.where(errors > ERROR_ROUNDING, errors, np.nan), label=label, **line_style(k))
    for ax, label in zip(axes, ("torque error  [peak]", "platform error  [path lengths]"), strict=True):
        ax.set(yscale="log", ylabel=label)
        ax.axhline(study.tolerance, color=ALARM, linewidth=0.8, label=f"tolerance {study.tolerance:.2g}")
        for crossing in study.highest.crossings:
            draw_dashed(ax, crossing.s)
    axes[-1].set_xlabel("path coordinate  $s$" + "  (dashed: singular)" * bool(study.highest.crossings))
    legend_above(axes[0], columns=2)
    return axes[0]


def plot_robustness(
    studies: Sequence[Study],
    axes: Sequence[Axes] | None = None,
    *,
    loop: ControlLoop,
    length: float | None = None,
) -> Axes:
    """Plot the share of runs below a tracking error, and below a peak torque.

    Each controller has one curve. Upright lines are the tolerance and the torque limits of the control loop;
    limits far above all torques are told in the label of the axis. With the robot's `length` [m] the
    tolerance is told in millimetres too.
    """
    axes = new_figure(2, height=1.9, shared=False) if axes is None else list(axes)
    for k, study in enumerate(studies):
        count = len(study.passed)
        share = np.arange(1, count + 1) / count
        label = f"{display_name(study.controller)}: {study.probability:.1%} passed"
        for ax, values in zip(axes, (study.tracking_error, study.peak_torque.max(axis=1)), strict=True):
            ax.step(np.sort(values), share, where="post", label=label, **line_style(k))
    errors, torques = axes
    for ax in axes:
        ax.set(ylabel="share of the runs", ylim=(0.0, 1.05))
    errors.set(xscale="log", xlabel="largest tracking error  [robot lengths, rad]")
    in_millimetres = "" if length is None else f" ({1e3 * length * loop.tolerance:.3g} mm)"
    label = f"tolerance {loop.tolerance:.2g}{in_millimetres}"
    errors.axvline(loop.tolerance, color=GOOD, linewidth=0.8, label=label)
    low, high = errors.get_xlim()
    digits = (1.0, 2.0, 5.0) if high < 50 * low else (1.0,)  # as many as have room
    errors.xaxis.set_major_locator(LogLocator(subs=digits, numticks=8))
    errors.xaxis.set_major_formatter("{x:g}")
    errors.xaxis.set_minor_formatter("")
    limits = np.unique(loop.limit or ())
    is_near = limits < 2.0 * torques.get_xlim()[1]
    for limit in limits[is_near]:
        draw_dashed(torques, limit, ALARM, linewidth=0.8)
    notes = ["dashed: limits"] if is_near.any() else []
    far = [f"{limit:.3g}" for limit in limits[~is_near & np.isfinite(limits)]]
    if far:
        notes.append(f"limits beyond: {', '.join(far)}")
    in_brackets = f"\n({'; '.join(notes)})" if notes else ""
    torques.set_xlabel(f"peak motor torque  [N m]{in_brackets}")
    legend_above(errors)
    return errors
