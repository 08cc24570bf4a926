"""Figure of a robustness study: tracking errors of the runs, and peak torques of their motors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FormatStrFormatter, LogLocator, MaxNLocator, NullFormatter

from framework.control.run_monitor import ControlLoop
from framework.control.study import Study
from framework.show.captions import display_name
from framework.show.style import ALARM, GOOD, Style, draw_dashed, line_style, new_figure


def plot_robustness(
    studies: Sequence[Study], axes: Sequence[Axes] | None = None, *, loop: ControlLoop | None = None
) -> Axes:
    """Plot the share of runs below a tracking error, and below a peak torque.

    One curve a controller.

    `loop`: what the runs had in common; errors within its tolerance are shaded, its torque limits are lines.
    """
    axes = new_figure(2, height=1.9, shared=False)[1] if axes is None else list(axes)
    for k, study in enumerate(studies):
        count = len(study.passed)
        share = np.arange(1, count + 1) / count
        label = f"{display_name(study.controller)}: {study.probability:.1%} passed"
        for ax, values in zip(axes, (study.tracking_error, study.peak_torque.max(axis=1)), strict=True):
            ax.step(np.sort(values), share, where="post", label=label, **line_style(k))
    axes[0].set_xlabel("largest tracking error  [robot lengths, rad]")
    axes[1].set_xlabel("peak motor torque  [N m]")
    for ax in axes:
        ax.set(xscale="log", ylabel="share of the runs", ylim=(0.0, 1.05))
        ax.xaxis.set_minor_formatter(NullFormatter())
    low, high = axes[1].get_xlim()
    if high < 3.0 * low:  # torques that differ by less than that factor need no logarithms
        axes[1].set_xscale("linear")
        axes[1].xaxis.set_major_locator(MaxNLocator(5))
    else:
        axes[1].xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes[1].xaxis.set_major_formatter(FormatStrFormatter("%g"))
    if loop is not None:
        _draw_bounds(axes, loop)
    axes[0].legend(loc="lower center", bbox_to_anchor=(0.45, 1.0))
    return axes[0]


def _draw_bounds(axes: Sequence[Axes], loop: ControlLoop) -> None:
    """Draw the errors within which a run passes, and the limits of its motors."""
    errors, torques = axes
    low, high = errors.get_xlim()
    errors.axvspan(low, loop.tolerance, color=GOOD, alpha=0.1, linewidth=0)
    errors.axvline(loop.tolerance, color=GOOD, linewidth=0.8)
    errors.set_xlim(low, max(high, 1.5 * loop.tolerance))
    _write_note(errors, loop.tolerance, "within: passes", GOOD)
    limits = np.unique(np.asarray(loop.limit or ()))
    # limits beyond so many times the largest torque are told, not drawn
    drawn = limits[limits < 2.0 * torques.get_xlim()[1]]
    for limit in drawn:
        draw_dashed(torques, limit, ALARM, 0.8)
    if len(drawn):
        _write_note(torques, drawn[0], "torque limit", ALARM)
    elif len(limits):  # far off: no place for it in the picture
        label = f"torque limit: {limits[0]:.3g} N m, off to the right"
        torques.text(0.98, 0.04, label, color=ALARM, fontsize=7, ha="right", transform=torques.transAxes)


def _write_note(ax: Axes, x: float, text: str, color: str) -> None:
    """Write an upright note beside x, at half the height."""
    style: Style = {"fontsize": 7, "rotation": 90, "ha": "right", "va": "center", "color": color}
    ax.text(x, 0.5, text, transform=ax.get_xaxis_transform(), **style)
