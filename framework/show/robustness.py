"""Figure of a robustness study: how far the runs leave the plan, and what the motors had to give."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

from framework.control.study import Study
from framework.show.style import figure, line_style


def plot_robustness(studies: Sequence[Study], axes: Sequence[Axes] | None = None) -> Axes:
    """Share of the runs that stay below a tracking error, and below a peak torque; one curve a controller."""
    axes = figure(2, height=1.9, shared=False)[1] if axes is None else list(axes)
    for k, study in enumerate(studies):
        count = len(study.passed)
        share = np.arange(1, count + 1) / count
        label = f"{study.controller.replace('_', ' ')}: {study.probability:.1%} passed"
        for ax, values in zip(axes, (study.tracking_error, study.peak_torque.max(axis=1)), strict=True):
            ax.step(np.sort(values), share, where="post", label=label, **line_style(k))
    axes[0].set_xlabel("largest tracking error  [robot lengths, rad]")
    axes[1].set_xlabel("peak motor torque  [N m]")
    for ax in axes:
        ax.set_xscale("log")
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.set_ylabel("share of the runs")
        ax.set_ylim(0.0, 1.05)
    axes[1].xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes[1].xaxis.set_major_formatter(FormatStrFormatter("%g"))
    axes[0].legend(loc="lower center", bbox_to_anchor=(0.45, 1.0))
    return axes[0]
