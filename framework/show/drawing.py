"""A robot as a picture in matplotlib, `draw_robot(robot, q, ax)`, and several side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from framework.errors import check_choice
from framework.kinematics.assembly import configuration
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import carried_points, joint_poses, planar_normal
from framework.model.visuals import Shape
from framework.numerics.arrays import LEAST_DIVISOR, Array
from framework.show.captions import display_name
from framework.show.sight import Projection, Sight, robot_sight
from framework.show.style import ensure_axes, figure_file, use_style

ROUND_OUTLINE_CORNERS = 32  # corners of a round outline
LIGHT_DIRECTION = np.array([0.3, -0.5, 0.8])  # from where meshes are lit


def draw_robot(
    robot: ParallelRobot, q: Any = None, ax: Axes | None = None, *, sight: Sight | None = None
) -> Axes:
    """Draw the bodies and motors of a robot at q (nq,) or an assembled pose.

    The reference when None. On new axes when `ax` is None. Planar robots lie flat on the paper, the axes are
    the base's [m]. Others have no axes, and are seen from where most of them is to be seen at the reference,
    or as `sight` says; `sight.onto` tells where a point lies.
    """
    ax = ensure_axes(ax, 3.0)
    q = configuration(robot, robot.reference if q is None else q)
    sight = robot_sight(robot) if sight is None else sight
    drawn = visible_outlines(robot, q, sight)
    colors, lines = np.array([color for _, _, color in drawn]), [line for _, line, _ in drawn]
    # a solid has a dark outline, a triangle of a mesh none of its own
    edges = np.array([color * ((1.0 if len(line) == 3 else 0.6,) * 3 + (1,)) for _, line, color in drawn])
    ax.add_collection(PolyCollection(lines, facecolors=colors, edgecolors=edges, linewidths=0.4, zorder=1))
    ax.autoscale_view()
    ax.set_aspect("equal")
    ax.grid(visible=False)
    if planar_normal(robot) is None:
        ax.set_axis_off()
    else:
        ax.set(xlabel=f"{_axis_name(sight.onto.right)}  [m]", ylabel=f"{_axis_name(sight.onto.up)}  [m]")
    return ax


def draw_scale_bar(ax: Axes, length: float) -> None:
    """Draw a bar of a round length below the picture, about a third of `length` [m]."""
    from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar  # takes time to import

    size = float(f"{length / 3.0:.0e}")
    below: dict[str, Any] = {"bbox_to_anchor": (0.0, 0.0), "bbox_transform": ax.transAxes}
    style = {"frameon": False, "fontproperties": {"size": 6}}
    ax.add_artist(AnchoredSizeBar(ax.transData, size, f"{size:g} m", "upper left", **style, **below))


def visible_outlines(robot: ParallelRobot, q: Array, sight: Sight) -> list[tuple[int, Array, Array]]:
    """Return node, outline (m, 2) and colour (4,) of the visible faces at q (nq,).

    The farthest come first.
    """
    onto = sight.onto
    pose = joint_poses(robot, q[None])[0]
    pieces = [
        (depth, shape.node, outline, color)
        for shape in sight.shapes
        for depth, outline, color in _project_shape(shape, pose[shape.node], onto)
    ]
    return [piece[1:] for piece in sorted(pieces, key=lambda piece: -piece[0])]


def _axis_name(direction: Array) -> str:
    """Return the base axis nearest to a direction (3,), with its sign."""
    axis = np.argmax(np.abs(direction))
    return ("" if direction[axis] > 0 else "−") + "xyz"[axis]


def _project_shape(shape: Shape, joint: Array, onto: Projection) -> list[tuple[float, Array, Array]]:
    """Return depth, outline (m, 2) and colour (4,) of a shape's faces.

    `joint` (7,) is the pose of its joint.
    """
    color = np.array(shape.color, dtype=float)
    if shape.vertices is not None and shape.faces is not None:
        vertices = carried_points(joint, shape.to_node(shape.vertices))
        return _project_triangles(vertices[shape.faces], color, onto)
    center = carried_points(joint, shape.to_node(np.zeros((1, 3))))[0]
    return [(float(center @ onto.ahead), _project_outline(shape, joint, onto), color)]


def _project_triangles(corners: Array, color: Array, onto: Projection) -> list[tuple[float, Array, Array]]:
    """Return depth, outline (3, 2) and shade (4,) of triangles by corners (F, 3, 3)."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), LEAST_DIVISOR)[:, None]
    light = LIGHT_DIRECTION / np.linalg.norm(LIGHT_DIRECTION)
    brightness = 0.55 + 0.45 * np.abs(normals @ light)  # (F,)
    shades = color * np.where(np.arange(4) < 3, brightness[:, None], 1.0)  # the opacity stays
    depths = corners.mean(axis=1) @ onto.ahead
    return list(zip(depths.tolist(), onto(corners), shades, strict=True))


def _project_outline(shape: Shape, joint: Array, onto: Projection) -> Array:
    """Return the outline (m, 2) of a sphere, a cylinder or a box.

    `joint` (7,) is the pose of its joint.
    """
    angle = np.linspace(0.0, 2 * np.pi, ROUND_OUTLINE_CORNERS, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros(ROUND_OUTLINE_CORNERS)], axis=1)
    if shape.kind == "sphere":
        center = carried_points(joint, shape.to_node(np.zeros((1, 3))))
        return onto(center) + shape.size[0] * circle[:, :2]
    corners = shape.corners()
    if shape.kind == "cylinder":
        radius, length = shape.size
        half = np.array([0.0, 0.0, 0.5 * length])
        corners = shape.to_node(np.concatenate([radius * circle - half, radius * circle + half]))
    return convex_hull(onto(carried_points(joint, corners)))


def convex_hull(points: Array) -> Array:
    """Compute the convex hull of points (m, 2), counter-clockwise.

    By Andrew's monotone chain.
    """
    ordered = sorted(points.tolist())
    halves = []
    for direction in (ordered, ordered[::-1]):
        chain: list[list[float]] = []
        for point in direction:
            while len(chain) > 1 and not _turns_left(chain[-2], chain[-1], point):
                chain.pop()
            chain.append(point)
        halves.append(chain[:-1])
    return np.array(halves[0] + halves[1])


def _turns_left(a: list[float], b: list[float], c: list[float]) -> bool:
    """Return whether the turn at b from a to c is to the left."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0


COLUMNS = 5
CELL = 1.7  # [in] of one robot
GALLERY_KINDS = ("png", "svg", "pdf")


def gallery_picture(robots: Sequence[ParallelRobot], kind: str) -> bytes:
    """Draw robots side by side, with their names.

    Raises:
        InvalidInput: `kind` is not one of GALLERY_KINDS.
    """
    check_choice("kind of picture", kind, GALLERY_KINDS)
    rows = -(-len(robots) // COLUMNS)
    with use_style():
        drawing = Figure(figsize=(CELL * COLUMNS, CELL * rows), layout="constrained")
        cells = drawing.subplots(rows, COLUMNS, squeeze=False).ravel()
        for cell in cells:
            cell.set_axis_off()
        for robot, cell in zip(robots, cells, strict=False):
            draw_robot(robot, ax=cell)
            cell.set_axis_off()
            cell.set_title(display_name(robot.name))
        return figure_file(drawing, kind, dpi=110)
