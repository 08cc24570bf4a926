"""Figure of a fidelity study: where along the path each rung is off, and by how much."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from framework.crossing.fidelity import ROUNDING, FidelityStudy
from framework.show.style import ALARM, CROSSING, figure, line_style


def plot_fidelity(study: FidelityStudy, axes: Sequence[Axes] | None = None) -> Axes:
    """Torque error over the peak and platform error over the path's length along s, one curve a rung.

    Rungs with the torques of a lower one, and those without a plan, have no curve.
    """
    axes = figure(2, height=2.0)[1] if axes is None else list(axes)
    s = study.highest.law(study.times)
    own = [judged for judged in study.rungs if judged.plan is not None and not judged.same_as]
    for k, judged in enumerate(own):
        for ax, errors in zip(axes, (judged.torque_error, judged.platform_error), strict=True):
            ax.plot(
                s,
                np.where(errors > ROUNDING, errors, np.nan),
                label=judged.rung.name.replace("_", " "),
                **line_style(k),
            )
    for ax, label in zip(axes, ("torque error  [peak]", "platform error  [path lengths]"), strict=True):
        ax.set_yscale("log")
        ax.set_ylabel(label)
        ax.axhline(study.tolerance, color=ALARM, linewidth=0.8)
        for crossing in study.highest.crossings:
            ax.axvline(crossing.s, color=CROSSING, linewidth=0.6, linestyle=(0, (4, 3)))
    axes[-1].set_xlabel("path coordinate  $s$")
    axes[0].legend(loc="lower center", bbox_to_anchor=(0.45, 1.0), ncols=2)
    return axes[0]
