"""Draw robots in matplotlib: one, `draw_robot(robot, q, ax)`, several side by side, and a frame of a film.

A frame shows robot, path, singular locus, t_s, W_p and the motors' forces. `onto` projects points (..., 3)
onto the paper, (..., 2), and k is the number of a frame. The pose (7,) of a node is the position and the
quaternion.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Polygon
from matplotlib.path import Path

from framework.dynamics.platform_wrench import action_lines
from framework.errors import check_choice
from framework.kinematics.assembly import configuration
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import carried_points, frame_origins, joint_poses, planar_normal
from framework.model.visuals import Shape
from framework.moved_modules import renamed_names
from framework.numerics.arrays import LEAST_DIVISOR, Array
from framework.show.captions import display_name
from framework.show.film import Film
from framework.show.scene import locus_lines
from framework.show.shapes import placement_with_z_along
from framework.show.sight import Projection, Sight, film_sight, robot_sight
from framework.show.style import (
    ALARM,
    CROSSING,
    GIVEN,
    LOCUS,
    PATH,
    TWIST,
    WRENCH,
    Style,
    draw_curves,
    ensure_axes,
    figure_file,
    legend_above,
    use_style,
)
from framework.singularity.drawn_locus import locus_curves
from framework.tolerances import SAME_PLACE

ROUND_OUTLINE_CORNERS = 32  # polygon corners of a round outline
COILS = 6  # of a spring between two points
LIGHT_DIRECTION = np.array([0.3, -0.5, 0.8])  # from a mesh to the light


class Face(NamedTuple):
    """A solid, or one triangle of a mesh, projected onto the paper."""

    depth: float  # [m] along the line of sight, larger if farther
    node: int  # joint that carries the solid
    outline: Array  # (m, 2) [m]
    color: Array  # (4,)


def draw_robot(
    robot: ParallelRobot, q: Any = None, ax: Axes | None = None, *, sight: Sight | None = None
) -> Axes:
    """Draw the bodies and motors of a robot at q (nq,) or at an assembled pose.

    A planar robot lies flat on the paper, and the axes are the base's [m]. A spatial robot is drawn without
    axes.

    Args:
        q: the reference when None.
        ax: new axes when None.
        sight: the view; when None the one that shows most of the robot at its reference. `sight.onto`
            projects points onto the picture.
    """
    ax = ensure_axes(ax, height=3.0)
    q = configuration(robot, robot.reference if q is None else q)
    sight = robot_sight(robot) if sight is None else sight
    faces = project_faces(robot, q, sight)
    colors = np.array([face.color for face in faces])  # (faces, 4)
    edges = colors.copy()
    is_solid = [len(face.outline) != 3 for face in faces]
    edges[is_solid, :3] *= 0.6  # a solid has a dark outline, a triangle of a mesh none of its own
    outlines = [face.outline for face in faces]
    ax.add_collection(PolyCollection(outlines, facecolors=colors, edgecolors=edges, linewidths=0.4, zorder=1))
    for line in _coil_lines(robot, q):
        ax.plot(*sight.onto(line).T, color=CROSSING, linewidth=0.8, zorder=2)
    ax.autoscale_view()
    ax.set_aspect("equal")
    ax.grid(visible=False)
    if planar_normal(robot) is None:
        ax.set_axis_off()
    else:
        ax.set(xlabel=f"{_axis_name(sight.onto.right)}  [m]", ylabel=f"{_axis_name(sight.onto.up)}  [m]")
    return ax


def _coil_lines(robot: ParallelRobot, q: Array) -> list[Array]:
    """Return zigzag lines (m, 3) [m] that show the springs between points at q (nq,).

    A spring is straight over a fifth of its length at each end. Between, it zigzags by 2 % of the robot's
    length: in the plane of a planar robot, up and down for others.
    """
    straight, width = 0.2, 0.02
    poses = joint_poses(robot, q[None])
    origins = [frame_origins(robot, poses, frame)[0] for frame in robot.frames]  # (3,) each
    normal = planar_normal(robot)  # None of a spatial robot
    along = np.linspace(straight, 1.0 - straight, 2 * COILS + 1)  # shares of the spring's length
    sideways = width * robot.length * np.array([0.0, *[1.0, -1.0] * COILS])
    lines = []
    for first, second in zip(robot.line_springs.first, robot.line_springs.second, strict=True):
        start, end = origins[first], origins[second]
        offset = end - start
        if np.linalg.norm(offset) < SAME_PLACE * robot.length:
            continue
        direction = np.array([0.0, 0.0, 1.0]) if normal is None else np.cross(normal, offset)
        across = direction / (np.linalg.norm(direction) or 1.0)
        coil = start + along[:, None] * offset + sideways[:, None] * across
        lines.append(np.concatenate([[start], coil, [start + (1.0 - straight) * offset, end]]))
    return lines


def draw_scale_bar(ax: Axes, length: float) -> None:
    """Draw a scale bar below the picture, about a third of `length` [m], rounded."""
    from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar  # takes time to import

    size = float(f"{length / 3.0:.0e}")
    below: dict[str, Any] = {"bbox_to_anchor": (0.0, 0.0), "bbox_transform": ax.transAxes}
    style = {"frameon": False, "fontproperties": {"size": 6}}
    ax.add_artist(AnchoredSizeBar(ax.transData, size, f"{size:g} m", "upper left", **style, **below))


def project_faces(robot: ParallelRobot, q: Array, sight: Sight) -> list[Face]:
    """Project the faces of all solids at q (nq,) onto the paper, farthest first.

    The F triangles of a mesh are shaded: 55 % ambient light, 45 % by the angle to the light, on both sides.
    """
    onto = sight.onto
    light = LIGHT_DIRECTION / np.linalg.norm(LIGHT_DIRECTION)
    poses = joint_poses(robot, q[None])[0]  # (joints, 7) position and quaternion of each
    faces: list[Face] = []
    for shape in sight.shapes:
        joint = poses[shape.node]
        color = np.array(shape.color, dtype=float)  # (4,) opacity last
        if shape.vertices is None or shape.faces is None:
            center = carried_points(joint, shape.to_node(np.zeros((1, 3))))[0]
            outline = _project_outline(shape, joint, onto)
            faces.append(Face(float(center @ onto.ahead), shape.node, outline, color))
            continue
        corners = carried_points(joint, shape.to_node(shape.vertices))[shape.faces]  # (F, 3, 3)
        first, second, third = corners.swapaxes(0, 1)  # (F, 3) each
        normals = np.cross(second - first, third - first)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), LEAST_DIVISOR)
        shades = np.tile(color, (len(corners), 1))
        shades[:, :3] *= 0.55 + 0.45 * np.abs(normals @ light)[:, None]
        depths = corners.mean(axis=1) @ onto.ahead  # (F,)
        for depth, outline, shade in zip(depths, onto(corners), shades, strict=True):
            faces.append(Face(depth, shape.node, outline, shade))
    return sorted(faces, key=lambda face: -face.depth)


def _axis_name(direction: Array) -> str:
    """Name the base axis nearest to a direction (3,), with its sign."""
    axis = np.argmax(np.abs(direction))
    return ("" if direction[axis] > 0 else "−") + "xyz"[axis]


def _project_outline(shape: Shape, joint: Array, onto: Projection) -> Array:
    """Return the outline (m, 2) of a sphere, a cylinder or a box at its joint's pose (7,)."""
    angle = np.linspace(0.0, 2 * np.pi, ROUND_OUTLINE_CORNERS, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros(ROUND_OUTLINE_CORNERS)], axis=1)
    if shape.kind == "sphere":
        center = carried_points(joint, shape.to_node(np.zeros((1, 3))))
        return onto(center) + shape.size[0] * circle[:, :2]
    corners = shape.corners()
    if shape.kind == "cylinder":
        radius, length = shape.size
        half_axis = np.array([0.0, 0.0, 0.5 * length])
        rims = [radius * circle - half_axis, radius * circle + half_axis]
        corners = shape.to_node(np.concatenate(rims))
    return convex_hull(onto(carried_points(joint, corners)))


def convex_hull(points: Array) -> Array:
    """Compute the convex hull of points (m, 2), counter-clockwise.

    The method is Andrew's monotone chain, which also takes points on one line. Points are sorted from left to
    right; the chain to the right is the lower side of the hull, the chain back is the upper side.
    """
    ordered = sorted(points.tolist())
    hull: list[list[float]] = []
    for one_way in (ordered, ordered[::-1]):
        chain: list[list[float]] = []  # it turns left at each point
        for x, y in one_way:
            while len(chain) > 1:
                (a_x, a_y), (b_x, b_y) = chain[-2:]
                if (b_x - a_x) * (y - a_y) - (b_y - a_y) * (x - a_x) > 0:  # a, b, (x, y) turn left at b
                    break
                chain.pop()
            chain.append([x, y])
        hull += chain[:-1]  # the last point begins the other side
    return np.array(hull)


COLUMNS = 5
CELL = 1.7  # [in] edge of the picture of one robot
GALLERY_KINDS = ("png", "svg", "pdf")


def gallery_picture(robots: Sequence[ParallelRobot], kind: str) -> bytes:
    """Draw robots side by side with their names; return the file.

    Raises:
        InvalidInput: `kind` is not one of GALLERY_KINDS.
    """
    check_choice("kind of picture", kind, GALLERY_KINDS)
    rows = -(-len(robots) // COLUMNS)  # rounded up
    with use_style():
        drawing = Figure(figsize=(CELL * COLUMNS, CELL * rows), layout="constrained")
        cells = drawing.subplots(rows, COLUMNS, squeeze=False).ravel()
        for robot, cell in zip(robots, cells, strict=False):  # the last row may have empty cells
            draw_robot(robot, ax=cell)
            cell.set_title(display_name(robot.name))
        for cell in cells:
            cell.set_axis_off()
        return figure_file(drawing, kind, dpi=110)


# ------------------------------------------------------------------ one frame of a film


ARROW_LENGTH = 0.32  # length of t_s over the robot's length, as on the page
MIN_TURN, MAX_TURN = 0.1, 2.6  # [rad] half of the arc of t_s: too short to draw; its ends must not meet


def plot_still(
    film: Film, ax: Axes | None = None, *, frame: int | None = None, limit: Array | None = None
) -> Axes:
    """Draw one frame of a film.

    Args:
        frame: when None the first singular instant, or else the frame halfway.
        limit: torque limits (n_a,). With them and a platform that moves in a plane, the polygons of the
            forces that such motors can give are drawn to one scale: at `frame`, or when None along the path.
    """
    robot = film.robot
    k = film.key_frame if frame is None else frame
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
        # the hull of the forces of all c combinations of torques at plus or minus the limit
        vertices = film.motors.vertices(limit)  # (F, c, 2) [N]
        scale = 0.35 * robot.length / np.linalg.norm(vertices, axis=2).max()  # [m/N]
        along_path = np.linspace(0, len(film.time) - 1, 7).astype(int)
        for i in np.unique([*along_path, film.key_frame]) if frame is None else [frame]:
            corners = path[i] + scale * convex_hull(vertices[i])
            ax.add_patch(
                Polygon(corners, facecolor=(GIVEN, 0.18), edgecolor=GIVEN, linewidth=0.8, zorder=3.5)
            )
    if film.instants and k == film.key_frame and len(robot.platform.sliding):
        _draw_action_lines(film, ax, k, onto)
    if film.has_measure:
        _draw_arrows(film, ax, k, onto)
    ax.autoscale_view()
    if planar_normal(robot) is None:  # planar robots have axes instead
        draw_scale_bar(ax, robot.length)
    legend_above(ax, columns=2, fontsize=6)
    return ax


def _draw_arrows(film: Film, ax: Axes, k: int, onto: Projection) -> None:
    """Draw t_s and W_p at frame k as arrows on the paper.

    The arrows are the linear parts or, of a platform that only turns, the angular parts. t_s has one length
    in all frames, and W_p has this length where it is largest. W_p stands beside, with a leader, where both
    lie on one another in the picture of the singular instant.
    """
    reach = min(film.robot.length, 0.8 * np.ptp(ax.get_xlim()))  # [m] the robot, or what is seen of it
    foot = onto(film.platform[k])
    part = slice(3) if len(film.robot.platform.sliding) else slice(3, 6)
    demands = film.demands[:, part]  # W_p of all frames
    largest = np.linalg.norm(demands, axis=1).max()
    twists = film.twists[[k, film.key_frame], part]  # (2, 3)
    speeds = np.maximum(np.linalg.norm(twists, axis=1, keepdims=True), LEAST_DIVISOR)
    twist, twist_there = onto(twists * ARROW_LENGTH * reach / speeds)
    demand, demand_there = onto(demands[[k, film.key_frame]] * ARROW_LENGTH * reach / (largest or 1.0))
    across = np.array([twist_there[1], -twist_there[0]])  # to the right of t_s
    overlap = abs(across @ demand_there) < 0.5 * np.linalg.norm(across) * np.linalg.norm(demand_there)
    beside = foot + 1.1 * across if overlap else foot
    ax.plot(*np.stack([foot, beside], axis=1), color=WRENCH, linewidth=0.6, linestyle=":", zorder=7)
    label = r"$\mathbf{t}_s$" if film.instants else "nearest to uncontrolled"
    draw_arrow(ax, foot, twist, TWIST, label)
    draw_arrow(ax, beside, demand, WRENCH, r"$\mathbf{W}_p$", both=False)
    _draw_turn(film, ax, k, onto)


def _draw_turn(film: Film, ax: Axes, k: int, onto: Projection) -> None:
    """Draw the rotation of t_s at frame k as an arc about its axis.

    To both sides the arc covers the angle by which the platform turns while it moves along the arrow of t_s.
    """
    shift, turn = np.split(film.twists[k], 2)  # linear and angular part of t_s, (3,) each
    speed = max(float(np.linalg.norm(shift)), LEAST_DIVISOR)
    arrow_time = ARROW_LENGTH * film.robot.length / speed  # in which t_s moves the platform by the arrow
    angle = min(float(np.linalg.norm(turn)) * arrow_time, MAX_TURN)  # [rad]
    if angle < MIN_TURN:
        return
    first, second = placement_with_z_along(np.zeros(3), turn)[:3, :2].T  # unit vectors across the axis
    phase = np.linspace(-angle, angle, 41)[:, None]
    arc = np.cos(phase) * first + np.sin(phase) * second  # (41, 3) on the unit circle about the axis
    line = onto(film.platform[k] - 0.2 * film.robot.length * arc)  # radius: a fifth of the robot's length
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


def draw_arrow(
    ax: Axes, foot: Array, arrow: Array, color: str, label: str = "", *, both: bool = True
) -> None:
    """Draw an arrow (2,) at a foot (2,), or to `both` sides; skip one too short to see."""
    if not np.linalg.norm(arrow) > 0.02 * np.ptp(ax.get_xlim()):  # NaN without a twist
        return
    tip = foot + arrow
    tail = foot - arrow if both else foot
    line: Style = {"color": color, "linewidth": 1.2}
    head = {"arrowstyle": "<|-|>" if both else "-|>", "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", tuple(tip), tuple(tail), arrowprops=head | line, zorder=7)
    ax.plot(*np.stack([tip, tail], axis=1), alpha=0)  # the limits of the axes ignore annotations
    ax.plot([], [], label=label or None, **line)
    if label.startswith("$"):  # a symbol, which stands at the tip too
        beyond = arrow / np.linalg.norm(arrow) * 6  # [points]
        ax.annotate(
            label,
            tuple(tip),
            tuple(beyond),
            textcoords="offset points",
            color=color,
            ha="center",
            va="center",
            fontsize=7,
            zorder=8,
        )


__getattr__ = renamed_names(__name__, {"hull": "convex_hull"})
