"""The phase plane of a plan: s' and s" over s within the limits of its motors, which close at a crossing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from framework.laws.law import law_derivatives
from framework.planning.optimal.limit_curves import LimitCurves, limit_curves
from framework.planning.result import CrossingPlan
from framework.show.style import BAND, Style, draw_dashed, draw_dot, figure, legend_above, line_style

AXIS_OVER_LARGEST_LAW = 1.5  # the highest value shown over the largest of the laws
TIME_SAMPLES = 601


def plot_phase_plane(
    plan: CrossingPlan, axes: Sequence[Axes] | None = None, *, beside: CrossingPlan | None = None
) -> list[Axes]:
    """Plot s' and s" over s, on two axes: the plan's law, and the range that its motors' limits leave.

    The range of s" is that at the plan's own s'; it closes to a point at each crossing, condition (8).

    Args:
        beside: another plan on the same path, whose law is drawn too.
    """
    axes = figure(2, height=1.9)[1] if axes is None else list(axes)
    plans = [plan] if beside is None else [plan, beside]
    laws = [law_derivatives(each.law, np.linspace(0.0, each.duration, TIME_SAMPLES)) for each in plans]
    tops = [AXIS_OVER_LARGEST_LAW * max(np.abs(law[order]).max() for law in laws) for order in (1, 2)]
    _draw_limits(axes, limit_curves(plan), tops, plan.robot.torque_units[0])
    for k, (each, law) in enumerate(zip(plans, laws, strict=True)):
        for ax, values in zip(axes, law[1:], strict=True):
            ax.plot(law[0], values, label=f"{each.law.kind}, {each.duration:.3g} s", **line_style(k))
    for crossing in plan.crossings:
        for ax, value in zip(axes, (crossing.speed, crossing.acceleration), strict=True):
            draw_dashed(ax, crossing.s)
            draw_dot(ax, crossing.s, value)
    axes[0].set(xlim=(0.0, 1.0), ylim=(0.0, tops[0]), ylabel=r"$\dot s$  [1/s]")
    axes[1].set(xlim=(0.0, 1.0), ylim=(-tops[1], tops[1]), ylabel=r"$\ddot s$  [1/s$^2$]")
    axes[1].set_xlabel("path coordinate  $s$")
    legend_above(axes[0], 2)
    return axes


def _draw_limits(axes: Sequence[Axes], curves: LimitCurves, tops: Sequence[float], unit: str) -> None:
    """Draw the ranges of s' and s" within the limits, and the least limit of s' if beyond the axis."""
    limits = ", ".join(f"{limit:.3g}" for limit in np.unique(curves.torque_limit))
    highest = np.nan_to_num(curves.highest_speed, posinf=2 * tops[0])
    axes[0].fill_between(curves.s, 0.0, highest, label=f"within {limits} {unit}", **BAND)
    accelerations = [curves.lowest_acceleration, curves.highest_acceleration]
    axes[1].fill_between(curves.s, *np.clip(accelerations, -2 * tops[1], 2 * tops[1]), **BAND)
    least = np.nanmin(curves.highest_speed)
    if np.isfinite(least) and least > tops[0]:
        text = rf"$\dot s$ may be {least:.3g} 1/s everywhere"
        box = {"facecolor": "white", "alpha": 0.7, "linewidth": 0, "pad": 1.5}
        corner: Style = {"transform": axes[0].transAxes, "ha": "right", "va": "top", "bbox": box}
        axes[0].text(0.98, 0.95, text, fontsize=7, **corner)
