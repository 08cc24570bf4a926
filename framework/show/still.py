"""One frame of a film as a picture: robot, path, singular locus, t_s, W_p and the motors' forces."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch, Polygon
from matplotlib.path import Path

from framework.dynamics.platform_wrench import action_lines
from framework.kinematics.placements import planar_normal
from framework.numerics.arrays import LEAST_DIVISOR, Array
from framework.show.drawing import convex_hull, draw_robot, draw_scale_bar
from framework.show.film import Film
from framework.show.scene import locus_lines
from framework.show.shapes import placement_with_z_along
from framework.show.sight import Projection, film_sight
from framework.show.style import ALARM, GIVEN, LOCUS, PATH, TWIST, WRENCH, Style, draw_curves, legend_above
from framework.singularity.drawn_locus import locus_curves

ARROW_LENGTH = 0.32  # length of t_s over the robot's length, as on the page
MIN_TURN, MAX_TURN = 0.1, 2.6  # [rad] half of the arc of t_s: too short to draw; its ends must not meet


def plot_still(
    film: Film,
    ax: Axes | None = None,
    *,
    frame: int | None = None,
    limit: Array | None = None,
) -> Axes:
    """Draw one frame of a film.

    Args:
        frame: when None the first singular instant, or else the frame halfway.
        limit: torque limits (n_a,). With them and a platform that moves in a plane, the polygons of the
            forces that such motors can give are drawn to one scale: at `frame`, or when None along the path.
    """
    robot, k = film.robot, film.key_frame if frame is None else frame
    sight = film_sight(film)
    ax = draw_robot(robot, film.q[k], ax, sight=sight)
    onto = sight.onto
    curves = [onto(line) for line in film_locus(film)]
    draw_curves(ax, curves, "singular locus", color=LOCUS, linewidth=1.4, zorder=2)
    path = onto(film.platform)  # (F, 2)
    label = "path" if np.ptp(path, axis=0).max() > 0 else None
    ax.plot(*path.T, color=PATH, linewidth=1.4, zorder=3, label=label)
    instants = [film.frame_at(instant.time) for instant in film.instants]
    dots: Style = {"color": LOCUS if film.proved else ALARM, "markersize": 4, "zorder": 6}
    ax.plot(*path[instants].T, "o", **dots)
    if limit is not None and robot.n == 2 and robot.platform.is_point:
        _draw_force_polygons(film, ax, path, limit, frame)
    if film.instants and k == film.key_frame and len(robot.platform.sliding):
        _draw_action_lines(film, ax, k, onto)
    if film.has_measure:
        _draw_arrows(film, ax, k, onto)
    ax.autoscale_view()
    if planar_normal(robot) is None:  # planar robots have axes instead
        draw_scale_bar(ax, robot.length)
    legend_above(ax, 3, fontsize=6)
    return ax


def _draw_arrows(film: Film, ax: Axes, k: int, onto: Projection) -> None:
    """Draw t_s and W_p at frame k.

    A platform that only turns has the axes of its rotation and its torque.
    """
    reach = min(film.robot.length, 0.8 * np.ptp(ax.get_xlim()))
    foot = onto(film.platform[k])
    part = slice(3) if len(film.robot.platform.sliding) else slice(3, 6)
    twist, demands = film.twists[k, part], film.demands[:, part]
    largest = np.linalg.norm(demands, axis=1).max()
    twist = twist * ARROW_LENGTH * reach / (np.linalg.norm(twist) or 1.0)
    demand = demands[k] * ARROW_LENGTH * reach / (largest or 1.0)
    label = r"$\mathbf{t}_s$" if film.instants else "least controlled motion"
    _draw_arrow(ax, foot, onto(twist), TWIST, True, label)
    _draw_arrow(ax, foot, onto(demand), WRENCH, False, r"$\mathbf{W}_p$")
    _draw_turn(film, ax, k, onto)


def _draw_turn(film: Film, ax: Axes, k: int, onto: Projection) -> None:
    """Draw the rotation of t_s at frame k as an arc about its axis."""
    shift, turn = np.split(film.twists[k], 2)
    rate, speed = float(np.linalg.norm(turn)), max(float(np.linalg.norm(shift)), LEAST_DIVISOR)
    arrow_time = ARROW_LENGTH * film.robot.length / speed
    angle = min(rate * arrow_time, MAX_TURN)  # turned while the platform moves along its arrow
    if angle < MIN_TURN:
        return
    first, second = placement_with_z_along(np.zeros(3), turn)[:3, :2].T  # both across the axis
    phase = np.linspace(-angle, angle, 41)[:, None]
    arc = np.cos(phase) * first + np.sin(phase) * second
    line = onto(film.platform[k] - 0.2 * film.robot.length * arc)
    style: Style = {
        "arrowstyle": "<|-|>",
        "mutation_scale": 10,
        "color": TWIST,
        "linewidth": 1.2,
        "zorder": 7,
    }
    ax.add_patch(FancyArrowPatch(path=Path(line), **style))


def _draw_action_lines(film: Film, ax: Axes, k: int, onto: Projection) -> None:
    """Draw the motors' lines of action at frame k."""
    lines = action_lines(film.robot, film.motors.motor_speed[k : k + 1])
    if lines is None:
        return
    half = 0.45 * film.robot.length * lines.direction[0]  # (n_a, 3)
    middle = film.platform[k] + lines.point[0]
    ends = onto(np.stack([middle - half, middle + half], axis=1))  # (n_a, 2, 2)
    style: Style = {"color": GIVEN, "linewidth": 0.8, "linestyle": (0, (1, 1.5)), "zorder": 3.2}
    draw_curves(ax, ends, "lines of the motors' forces", **style)


@lru_cache(maxsize=16)
def film_locus(film: Film) -> list[Array]:
    """Return the curves (m, 3) of the locus; none unless the platform is a point."""
    robot = film.robot
    if not film.has_measure or not robot.platform.is_point:
        return []
    return locus_lines(robot, locus_curves(robot, film.q[0], film.x[0]), film.platform)


def _draw_arrow(ax: Axes, foot: Array, arrow: Array, color: str, both: bool, label: str) -> None:
    """Draw an arrow (2,) at a foot (2,), or to `both` sides; skip one too short to see."""
    if not np.linalg.norm(arrow) > 0.02 * np.ptp(ax.get_xlim()):  # NaN without a twist
        return
    tip, tail = foot + arrow, foot - arrow if both else foot
    line: Style = {"color": color, "linewidth": 1.2}
    head = {"arrowstyle": "<|-|>" if both else "-|>", "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", tuple(tip), tuple(tail), arrowprops=head | line, zorder=7)
    ax.plot(*np.stack([tip, tail], axis=1), alpha=0)  # the limits of the axes ignore annotations
    ax.plot([], [], label=label, **line)


def _draw_force_polygons(film: Film, ax: Axes, line: Array, limit: Array, frame: int | None) -> None:
    """Draw the polygons of motor forces on a line (F, 2), at one frame or several."""
    vertices = film.motors.vertices(limit)  # (F, c, 2)
    scale = 0.35 * film.robot.length / np.linalg.norm(vertices, axis=2).max()
    along_path = np.linspace(0, len(film.time) - 1, 7).astype(int)
    for k in np.unique([*along_path, film.key_frame]) if frame is None else [frame]:
        corners = line[k] + scale * convex_hull(vertices[k])
        ax.add_patch(Polygon(corners, facecolor=GIVEN, alpha=0.18, zorder=3.5))
        ax.add_patch(Polygon(corners, fill=False, edgecolor=GIVEN, linewidth=0.8, zorder=3.6))
