"""A scene as a still picture: the robot, its path, the singular locus, t_s, W_p and the motors' forces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from framework.arrays import Array
from framework.kinematics.placements import (
    joint_poses,
    platform_positions,
    platform_twists,
    platform_wrenches,
)
from framework.show.drawing import draw, hull
from framework.show.film import Film
from framework.show.scene import locus_lines
from framework.show.sight import projection
from framework.show.style import ALARM, GIVEN, LOCUS, PATH, TWIST, WRENCH
from framework.singularity.locus import locus_curves

ARROW = 0.32  # length of t_s, over the robot's; the page's too
POLYGONS = 7  # of forces along the path


def plot_still(
    film: Film,
    ax: Axes | None = None,
    *,
    frame: int | None = None,
    limit: Array | None = None,
    locus: Sequence[Array] | None = None,
    alone: bool = False,
) -> Axes:
    """A film at one of its frames, at its first singular instant when None, else halfway.

    Args:
        limit: torque limits (n_a,); a platform that moves in a plane then gets the polygons of the forces
            that such motors can give, some along the path, in a common scale; with `alone` that of the
            frame only.
        locus: curves (m, 3) of the singular locus, when they are known already; see `locus_of`.
    """
    robot, k = film.robot, telling_frame(film) if frame is None else frame
    ax = draw(robot, film.q[k], ax)
    onto, platform = projection(robot), platform_positions(robot, joint_poses(robot, film.q))
    way, here = onto(platform), platform[k]
    for line in locus_of(film) if locus is None else locus:
        ax.plot(*onto(line).T, color=LOCUS, linewidth=1.4, zorder=2)
    ax.plot(*way.T, color=PATH, linewidth=1.4, zorder=3)
    for instant in film.instants:
        at = way[int(np.argmin(np.abs(film.time - instant.time)))]
        ax.plot(*at, "o", color=LOCUS if film.proved else ALARM, markersize=4, zorder=6)
    if limit is not None and robot.n == 2 and robot.platform.is_point:
        _polygons(film, ax, way, limit, [k] if alone else None)
    arrows = (
        (platform_twists(robot, film.q, film.t_s), TWIST, True, ARROW),
        (platform_wrenches(robot, film.q, film.W_p), WRENCH, False, ARROW),
    )
    for six, color, both, size in arrows:
        largest = np.linalg.norm(six[:, :3], axis=1).max()
        if largest > 0 and not np.isnan(film.g).any():
            tip = six[k, :3] * size * robot.length / (np.linalg.norm(six[k, :3]) or 1.0 if both else largest)
            _arrow(ax, onto(here), onto(tip), color, both)
    ax.autoscale_view()
    return ax


def locus_of(film: Film) -> list[Array]:
    """Curves (m, 3) of the locus, of a platform that moves in a plane."""
    robot = film.robot
    if np.isnan(film.g).any() or not robot.platform.is_point:
        return []
    platform = platform_positions(robot, joint_poses(robot, film.q))
    return locus_lines(robot, locus_curves(robot, film.q[0], film.x[0]), platform)


def telling_frame(film: Film) -> int:
    """The frame of the first singular instant, else the one in the middle."""
    if not film.instants:
        return len(film.time) // 2
    return int(np.argmin(np.abs(film.time - film.instants[0].time)))


def _arrow(ax: Axes, at: Array, way: Array, color: str, both: bool) -> None:
    if np.linalg.norm(way) > 0.02 * np.ptp(ax.get_xlim()):
        style = {
            "arrowstyle": "<|-|>" if both else "-|>",
            "color": color,
            "linewidth": 1.2,
            "shrinkA": 0,
            "shrinkB": 0,
        }
        ax.annotate("", tuple(at + way), tuple(at - way if both else at), arrowprops=style, zorder=7)
        ax.plot(*np.stack([at + way, at - way if both else at], axis=1), alpha=0)  # so that it is in sight


def _polygons(film: Film, ax: Axes, way: Array, limit: Array, frames: Sequence[int] | None) -> None:
    vertices = film.motors.vertices(limit)  # (F, c, 2)
    scale = 0.35 * film.robot.length / np.linalg.norm(vertices, axis=2).max()
    if frames is None:
        spread = np.linspace(0, len(film.time) - 1, POLYGONS).astype(int)
        frames = [int(k) for k in np.unique(np.append(spread, telling_frame(film)))]
    for k in frames:
        corners = way[k] + scale * hull(vertices[k])
        ax.add_patch(Polygon(corners, facecolor=GIVEN, alpha=0.18, zorder=3.5))
        ax.add_patch(Polygon(corners, fill=False, edgecolor=GIVEN, linewidth=0.8, zorder=3.6))
