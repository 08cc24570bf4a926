"""A figure of seconds over error of several methods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from framework.numerics.arrays import Array
from framework.show.style import axes_or_new, line_style


def plot_work_precision(
    curves: Mapping[str, Sequence[tuple[float, float]] | Array],
    ax: Axes | None = None,
    *,
    ours: str = "ours",
) -> Axes:
    """Plot seconds over error, one curve a method: down and to the left is better.

    `curves` holds (seconds, error [m]) of each setting. Methods whose name starts with `ours` are drawn bold.
    """
    ax = axes_or_new(ax, 3.4)
    for k, (label, points) in enumerate(curves.items()):
        finite = np.array([point for point in points if np.all(np.isfinite(point)) and point[1] > 0])
        if not len(finite):
            continue
        bold = label.startswith(ours)
        style = {**line_style(k), "linewidth": 1.8 if bold else 0.9}
        ax.plot(finite[:, 1], finite[:, 0], marker="o" if bold else ".", markersize=3, label=label, **style)
    ax.set(xscale="log", yscale="log")
    ax.set(xlabel="error  [m], better to the right", ylabel="wall time  [s]")
    ax.invert_xaxis()
    ax.legend(fontsize=6, ncols=2, loc="lower center", bbox_to_anchor=(0.45, 1.0))
    return ax
