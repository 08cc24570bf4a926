"""Figures of the singular locus."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from framework.atlas.nonsingular_mode_change import AssemblyModeChange
from framework.errors import InvalidInput
from framework.kinematics.continuation.tracking import assemble
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.planning.result import CrossingPlan
from framework.show.style import COLORS, CROSSING, LOCUS, draw_curves, draw_dot, ensure_axes, line_style
from framework.singularity.drawn_locus import locus_curves
from framework.singularity.traced_locus import TracedLocus


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
    ax = ensure_axes(ax, 3.2)
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
    ax = ensure_axes(None, 3.2)
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
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    return ax


def _range_about(values: Array) -> tuple[float, float]:
    """Return the limits of an axis about values (m,), four times as wide as their range."""
    middle = 0.5 * (values.min() + values.max())
    half = 2.0 * max(np.ptp(values), 1e-6)  # not empty where all values are the same
    return middle - half, middle + half
