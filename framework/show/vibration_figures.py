"""Stiffness and vibrations: a pose with its softest direction and first modes, and both along a path."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from framework.dynamics.stiffness import PlatformStiffness
from framework.dynamics.vibrations import Vibrations, platform_vibrations
from framework.errors import InvalidInput
from framework.kinematics.placements import (
    frame_origins,
    joint_poses,
    platform_frame_twists,
    platform_positions,
)
from framework.numerics.arrays import Array
from framework.planning.result import CrossingPlan
from framework.show.captions import display_name
from framework.show.drawing import ARROW_LENGTH, draw_arrow, draw_robot
from framework.show.sight import ShownObjects, robot_sight
from framework.show.style import ALARM, CROSSING, TWIST, draw_dashed, figure_file, line_style, use_style

SHOWN_MODES = 5  # vibrations that are drawn
DRAWN_MOTION = 0.15  # [rad, robot lengths] of the joint that a mode moves most
COLUMNS = 3  # of poses in a figure
PATH_POSES = 61  # of a plan, at equal steps in time


def plot_modes(result: PlatformStiffness) -> Figure:
    """Draw a pose with the direction in which its platform is softest, and its first vibrations.

    The robot at rest is grey lines. A vibration is drawn so large that the joint that moves most moves by
    DRAWN_MOTION.
    """
    robot = result.robot
    poses = joint_poses(robot, result.q[None])
    foot = platform_positions(robot, poses)[0]
    twist = platform_frame_twists(robot, result.q[None], result.softest_direction[None])[0, :3]
    size = float(np.linalg.norm(twist))
    arrow = twist * (size > 0.1 * robot.length)  # of a unit in robot lengths; a turn has none
    sight = robot_sight(robot, result.q, ShownObjects(np.array([foot, foot + arrow]), arrow, None))
    count = min(len(result.squares), SHOWN_MODES)
    rows = -(-(count + 1) // COLUMNS)  # rounded up
    drawing = Figure(figsize=(2.4 * COLUMNS, 2.5 * rows), layout="constrained")
    first, *others = drawing.subplots(rows, COLUMNS, squeeze=False).ravel()
    draw_robot(robot, result.q, first, sight=sight)
    if arrow.any():
        draw_arrow(first, sight.onto(foot), sight.onto(ARROW_LENGTH * robot.length * arrow / size), TWIST)
    first.set_title(f"softest {result.softest_in_words}", fontsize=7)
    origins, model = poses[0, :, :3], robot.model
    # from each joint to those behind and to frames
    lines = [(origins[model.parents[j]], origins[j]) for j in range(2, model.njoints) if model.parents[j]]
    for frame in robot.frames:
        if joint := model.frames[frame].parentJoint:
            lines.append((origins[joint], frame_origins(robot, poses, frame)[0]))
    rest = sight.onto(np.array(lines))  # (m, 2, 2)
    for k, ax in enumerate(others):
        if k < count:
            draw_robot(robot, result.displace_pose(k, DRAWN_MOTION), ax, sight=sight)
            ax.add_collection(LineCollection(list(rest), colors=CROSSING, linewidths=0.8, zorder=4))
            ax.set_title(f"vibration {k + 1}: {result.frequencies[k]:.4g} Hz", fontsize=7)
    panels = [first, *others]
    drawn = np.array([[*ax.get_xlim(), *ax.get_ylim()] for ax in panels[: count + 1]])  # (panels, 4)
    for ax in panels:  # all to one scale
        ax.set(xlim=(drawn[:, 0].min(), drawn[:, 1].max()), ylim=(drawn[:, 2].min(), drawn[:, 3].max()))
        ax.set_axis_off()
    return drawing


def modes_picture(result: PlatformStiffness, kind: str) -> bytes:
    """Return the picture of `plot_modes` as a file: png, svg or pdf."""
    with use_style():
        return figure_file(plot_modes(result), kind)


@lru_cache(maxsize=1)
def path_vibrations(plan: CrossingPlan) -> tuple[Array, Vibrations] | None:
    """Return path coordinates (T,) at equal steps in time, and the vibrations of a plan's poses there.

    None without springs, and if a motor moves neither mass nor a spring, which has no response.
    """
    if not plan.robot.n_e:
        return None
    times = np.linspace(0.0, plan.duration, PATH_POSES)
    try:
        vibrations = platform_vibrations(plan.robot, plan.dynamics.configuration(times))
    except InvalidInput:
        return None
    gain = vibrations.gain  # (T, F)
    s = np.clip(plan.law(times), 0.0, 1.0)  # of a polynomial up to rounding
    return (s, vibrations) if np.isfinite(gain).all() and gain.min() > 0.0 else None


def plot_vibrations(plan: CrossingPlan) -> Axes:
    """Plot over the path natural frequencies, and the platform's acceleration by motor torques."""
    on_path = path_vibrations(plan)
    assert on_path is not None
    s, result = on_path
    drawing = Figure(figsize=(3.5, 4.6), layout="constrained")
    top, ax = drawing.subplots(2, 1, sharex=True)
    for k, curve in enumerate(result.natural.T):
        top.semilogy(s, np.where(curve > 0.0, curve, np.nan), **line_style(k))
    top.set_ylabel("natural frequencies,\nmotors locked  [Hz]")
    acceleration = result.gain.T * (2 * np.pi * result.frequency[:, None]) ** 2  # (F, T)
    mesh = ax.pcolormesh(
        s, result.frequency, acceleration, norm=LogNorm(), shading="nearest", rasterized=True, linewidth=0
    )
    ax.set_yscale("log")
    ax.grid(visible=False)
    unit = "m" if plan.robot.translations.any() else "rad"
    drawing.colorbar(mesh, ax=ax, label=f"acceleration per torque  [{unit}/s²/(N m)]", location="bottom")
    singular = "  (dashed: singular)" if plan.crossings else ""
    ax.set(xlabel=f"path coordinate  $s${singular}", ylabel="frequency, motors free  [Hz]")
    for crossing in plan.crossings:
        for axes in (top, ax):
            draw_dashed(axes, crossing.s, ALARM if axes is ax else CROSSING)
    top.set_title(f"{display_name(plan.robot.name)}: vibrations at rest", fontsize=8, loc="left")
    return ax
