"""Figure of a fidelity study: the errors of each level along the path."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from framework.fidelity.fidelity_study import ERROR_ROUNDING, FidelityStudy
from framework.show.captions import display_name
from framework.show.style import ALARM, draw_dashed, line_style, new_figure


def plot_fidelity(study: FidelityStudy) -> Axes:
    """Plot the torque and platform errors of each level along s.

    Over the peak, and over the path's length. Levels with the torques of a lower one, and those without
    torques, have no curve.
    """
    axes = new_figure(2, height=2.0)[1]
    s = study.highest.law(study.times)
    own = [
        comparison for comparison in study.levels if comparison.motion is not None and not comparison.same_as
    ]
    for k, comparison in enumerate(own):
        for ax, errors in zip(axes, (comparison.torque_error, comparison.platform_error), strict=True):
            ax.plot(
                s,
                np.where(errors > ERROR_ROUNDING, errors, np.nan),
                label=display_name(comparison.level.name),
                **line_style(k),
            )
    for ax, label in zip(axes, ("torque error  [peak]", "platform error  [path lengths]"), strict=True):
        ax.set(yscale="log", ylabel=label)
        ax.axhline(study.tolerance, color=ALARM, linewidth=0.8)
        for crossing in study.highest.crossings:
            draw_dashed(ax, crossing.s)
    axes[-1].set_xlabel("path coordinate  $s$")
    axes[0].legend(loc="lower center", bbox_to_anchor=(0.45, 1.0), ncols=2)
    return axes[0]
