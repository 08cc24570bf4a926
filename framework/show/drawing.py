"""Draw a robot in matplotlib, `draw_robot(robot, q, ax)`, or several robots side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

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

ROUND_OUTLINE_CORNERS = 32  # polygon corners of a round outline
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
    ax = ensure_axes(ax, 3.0)
    q = configuration(robot, robot.reference if q is None else q)
    sight = robot_sight(robot) if sight is None else sight
    faces = project_faces(robot, q, sight)
    colors = np.array([face.color for face in faces])  # (faces, 4)
    edges = colors.copy()
    is_solid = [len(face.outline) != 3 for face in faces]
    edges[is_solid, :3] *= 0.6  # a solid has a dark outline, a triangle of a mesh none of its own
    outlines = [face.outline for face in faces]
    ax.add_collection(PolyCollection(outlines, facecolors=colors, edgecolors=edges, linewidths=0.4, zorder=1))
    ax.autoscale_view()
    ax.set_aspect("equal")
    ax.grid(visible=False)
    if planar_normal(robot) is None:
        ax.set_axis_off()
    else:
        ax.set(xlabel=f"{_axis_name(sight.onto.right)}  [m]", ylabel=f"{_axis_name(sight.onto.up)}  [m]")
    return ax


def draw_scale_bar(ax: Axes, length: float) -> None:
    """Draw a scale bar below the picture, about a third of `length` [m], rounded."""
    from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar  # takes time to import

    size = float(f"{length / 3.0:.0e}")
    below: dict[str, Any] = {"bbox_to_anchor": (0.0, 0.0), "bbox_transform": ax.transAxes}
    style = {"frameon": False, "fontproperties": {"size": 6}}
    ax.add_artist(AnchoredSizeBar(ax.transData, size, f"{size:g} m", "upper left", **style, **below))


def project_faces(robot: ParallelRobot, q: Array, sight: Sight) -> list[Face]:
    """Project the faces of all solids at q (nq,) onto the paper, farthest first."""
    poses = joint_poses(robot, q[None])[0]  # (joints, 7)
    faces: list[Face] = []
    for shape in sight.shapes:
        faces += _project_shape(shape, poses[shape.node], sight.onto)
    return sorted(faces, key=lambda face: -face.depth)


def _axis_name(direction: Array) -> str:
    """Name the base axis nearest to a direction (3,), with its sign."""
    axis = np.argmax(np.abs(direction))
    return ("" if direction[axis] > 0 else "−") + "xyz"[axis]


def _project_shape(shape: Shape, joint: Array, onto: Projection) -> list[Face]:
    """Project the faces of a shape, carried by its joint at the pose (7,)."""
    color = np.array(shape.color, dtype=float)
    if shape.vertices is not None and shape.faces is not None:
        vertices = carried_points(joint, shape.to_node(shape.vertices))
        return _project_triangles(shape.node, vertices[shape.faces], color, onto)
    center = carried_points(joint, shape.to_node(np.zeros((1, 3))))[0]
    return [Face(float(center @ onto.ahead), shape.node, _project_outline(shape, joint, onto), color)]


def _project_triangles(node: int, corners: Array, color: Array, onto: Projection) -> list[Face]:
    """Project and shade the triangles of a mesh by their corners (F, 3, 3)."""
    first, second, third = corners.transpose(1, 0, 2)  # each (F, 3)
    normals = np.cross(second - first, third - first)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals /= np.maximum(lengths, LEAST_DIVISOR)
    light = LIGHT_DIRECTION / np.linalg.norm(LIGHT_DIRECTION)
    shades = np.tile(color, (len(corners), 1))
    shades[:, :3] *= 0.55 + 0.45 * np.abs(normals @ light)[:, None]  # both sides lit; opacity unchanged
    depths = corners.mean(axis=1) @ onto.ahead
    return [Face(depth, node, *face) for depth, *face in zip(depths, onto(corners), shades, strict=True)]


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

    Andrew's monotone chain, which also takes points on one line.
    """
    ordered = sorted(points.tolist())
    return np.array(_chain_left_turns(ordered) + _chain_left_turns(ordered[::-1]))


def _chain_left_turns(points: list[list[float]]) -> list[list[float]]:
    """Return one side of the hull of sorted points, without its last point."""
    chain: list[list[float]] = []
    for point in points:
        while len(chain) > 1 and not _turns_left(chain[-2], chain[-1], point):
            chain.pop()
        chain.append(point)
    return chain[:-1]


def _turns_left(a: list[float], b: list[float], c: list[float]) -> bool:
    """Return whether the path from a over b to c turns left at b."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0


COLUMNS = 5
CELL = 1.7  # [in] edge of the picture of one robot
GALLERY_KINDS = ("png", "svg", "pdf")


def gallery_picture(robots: Sequence[ParallelRobot], kind: str) -> bytes:
    """Draw robots side by side with their names; return the file.

    Raises:
        InvalidInput: `kind` is not one of GALLERY_KINDS.
    """
    check_choice("kind of picture", kind, GALLERY_KINDS)
    rows = -(-len(robots) // COLUMNS)
    with use_style():
        drawing = Figure(figsize=(CELL * COLUMNS, CELL * rows), layout="constrained")
        cells = drawing.subplots(rows, COLUMNS, squeeze=False).ravel()
        for robot, cell in zip(robots, cells, strict=False):  # the last row may have empty cells
            draw_robot(robot, ax=cell)
            cell.set_title(display_name(robot.name))
        for cell in cells:
            cell.set_axis_off()
        return figure_file(drawing, kind, dpi=110)
