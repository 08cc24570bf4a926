"""The phase plane of a plan: s' and s" over s between what its motors allow, which closes at a crossing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from framework.crossing.optimal.limit_curves import limit_curves
from framework.crossing.result import CrossingPlan
from framework.show.style import BAND, draw_dashed, draw_dot, figure, legend_above, line_style

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
    curves = limit_curves(plan)
    drawn = [plan] if beside is None else [plan, beside]
    laws = [
        [each.law(np.linspace(0.0, each.duration, TIME_SAMPLES), order) for order in range(3)]
        for each in drawn
    ]
    tops = [AXIS_OVER_LARGEST_LAW * max(float(np.abs(law[order]).max()) for law in laws) for order in (1, 2)]
    unit = plan.robot.torque_units[0]
    limits = ", ".join(f"{limit:.3g}" for limit in np.unique(curves.torque_limit))
    highest = np.where(np.isfinite(curves.highest_speed), curves.highest_speed, 2 * tops[0])
    highest = np.where(np.isnan(curves.highest_speed), 0.0, highest)
    axes[0].fill_between(curves.s, 0.0, highest, label=f"within {limits} {unit}", **BAND)
    accelerations = np.clip(
        [curves.lowest_acceleration, curves.highest_acceleration], -2 * tops[1], 2 * tops[1]
    )
    axes[1].fill_between(curves.s, *accelerations, **BAND)
    for k, (each, law) in enumerate(zip(drawn, laws, strict=True)):
        for ax, values in zip(axes, law[1:], strict=True):
            ax.plot(law[0], values, label=f"{each.law.kind}, {each.duration:.3g} s", **line_style(k))
    for crossing in plan.crossings:
        for ax, value in zip(axes, (crossing.speed, crossing.acceleration), strict=True):
            draw_dashed(ax, crossing.s)
            draw_dot(ax, crossing.s, value)
    least = float(np.nanmin(curves.highest_speed))
    if np.isfinite(least) and least > tops[0]:  # the range goes beyond what is shown
        text = rf"$\dot s$ may be {least:.3g} 1/s everywhere"
        plain = {"facecolor": "white", "alpha": 0.7, "linewidth": 0, "pad": 1.5}
        axes[0].text(
            0.98, 0.95, text, transform=axes[0].transAxes, ha="right", va="top", fontsize=7, bbox=plain
        )
    axes[0].set(xlim=(0.0, 1.0), ylim=(0.0, tops[0]), ylabel=r"$\dot s$  [1/s]")
    axes[1].set(xlim=(0.0, 1.0), ylim=(-tops[1], tops[1]), ylabel=r"$\ddot s$  [1/s$^2$]")
    axes[1].set_xlabel("path coordinate  $s$")
    legend_above(axes[0], 2)
    return axes
