"""Choose the direction of view that shows most of a robot.

A planar robot is seen along its normal, from one side or the other. Other robots are seen from all around,
from eye level to halfway up. The visible area of a body is the number of cells of the picture in which this
body is nearest to the eye.

A projection takes points (..., 3) onto the paper, (..., 2).
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import carried_points, joint_poses, planar_normal
from framework.model.visuals import Shape
from framework.numerics.arrays import LEAST_DIVISOR, Array, IntArray
from framework.show.film import Film
from framework.show.shapes import body_shapes, motor_shapes, surface_points
from framework.singularity.drawn_locus import locus_patch

USUAL_DIRECTION = np.array([0.75, -1.35, 0.65])  # from the robot to the eye: decides between equal views
USUAL_NORMAL = np.array([0.2, -1.0, 2.0])  # a planar robot is seen from this side of its plane
FLAT_VIEW_SLOPE = np.tan(np.radians(10.0))  # tilt on a page that shows the depth of planar robots
AZIMUTHS, ELEVATIONS = np.radians(np.arange(0, 360, 15)), np.radians([10, 20, 30, 40])


class ShownObjects(NamedTuple):
    """Objects that a picture must show beside the bodies."""

    path: Array  # (m, 3)
    arrow: Array  # (3,), such as t_s, to be seen at full length
    normal: Array | None  # (3,) of a surface, to be seen from its face


class Projection(NamedTuple):
    """The projection of points onto the paper [m], without perspective."""

    right: Array  # (3,)
    up: Array  # (3,)
    ahead: Array  # (3,) from the eye

    def __call__(self, points: Array) -> Array:
        """Project points (..., 3) onto the paper, (..., 2)."""
        return points @ np.stack([self.right, self.up], axis=1)


class Sight(NamedTuple):
    """A robot's solids and the direction to the eye, for all pictures of one motion."""

    bodies: list[Shape]
    motors: list[Shape]
    toward: Array  # (3,) from the robot to the eye, flat-on for planar robots
    planar: bool

    @property
    def shapes(self) -> list[Shape]:
        """All solids."""
        return self.bodies + self.motors

    @property
    def onto(self) -> Projection:
        """Projection onto the paper."""
        return project_along(self.toward)


def robot_sight(robot: ParallelRobot, q: Array | None = None, wanted: ShownObjects | None = None) -> Sight:
    """Choose the view of a robot at q (nq,), its reference when None."""
    bodies = body_shapes(robot)
    motors = motor_shapes(robot, bodies)
    normal = planar_normal(robot)
    # points (m, 3) on all solids, in units of a cell, 40 along the largest extent; their nodes (m,)
    shapes = bodies + motors
    poses = joint_poses(robot, robot.reference.q[None] if q is None else q[None])[0]
    boxes = [carried_points(poses[shape.node], shape.corners()) for shape in shapes]
    cell = np.ptp(np.concatenate(boxes), axis=0).max() / 40
    surfaces = [carried_points(poses[shape.node], surface_points(shape, cell)) for shape in shapes]
    points = np.concatenate(surfaces) / cell
    nodes = np.repeat([shape.node for shape in shapes], list(map(len, surfaces)))
    # The direction to the eye has the best score: the visible share of the bodies, reduced by up to 30 % with
    # the angle from the usual direction. For a spatial robot it is multiplied by the share of the wanted
    # arrow that lies across the line of sight, and by the roots, which count less, of this share of the path
    # and of the cosine between the eye and the normal of the wanted surface.
    directions, usual = _candidate_directions(normal)
    # (k, nodes) visible cells of each body in each of k directions
    areas = np.array([_count_visible_cells(points, nodes, project_along(toward)) for toward in directions])
    angles = np.arccos(np.clip(directions @ usual, -1.0, 1.0))
    scores = _score_visibility(areas) * (1.0 - 0.3 * (angles / np.pi))
    if wanted is not None and normal is None:
        scores *= _fraction_across(wanted.arrow[None], directions)
        scores *= np.sqrt(_fraction_across(np.diff(wanted.path, axis=0), directions))
        if wanted.normal is not None:
            scores *= np.sqrt(np.abs(directions @ wanted.normal))
    toward = directions[np.argmax(scores)]
    return Sight(bodies, motors, toward, normal is not None)


@lru_cache(maxsize=16)
def film_sight(film: Film) -> Sight:
    """Choose the view of a motion at its first singular instant, or else halfway."""
    robot = film.robot
    k = film.key_frame
    arrow = np.zeros(3)
    normal = None  # to the locus
    if film.instants:
        shift, turn = np.split(film.twists[k], 2)
        arrow = shift if len(robot.platform.sliding) else turn
        patch = locus_patch(robot, film.q[k], film.x[k])
        if patch is not None:
            diagonal, other_diagonal = patch[-1, -1] - patch[0, 0], patch[0, -1] - patch[-1, 0]
            normal = np.cross(diagonal, other_diagonal)
            normal /= np.linalg.norm(normal)
    return robot_sight(robot, film.q[k], ShownObjects(film.platform, arrow, normal))


def project_along(toward: Array) -> Projection:
    """Return the projection for an eye in direction (3,) from the robot.

    z points up on the paper; in a view along z, or less than about 45 degrees off, y does.
    """
    upright = np.array([0.0, 1.0, 0.0]) if abs(toward[2]) > 0.7 else np.array([0.0, 0.0, 1.0])
    right = np.cross(upright, toward)
    right = right / np.linalg.norm(right)
    return Projection(right, np.cross(toward, right), -toward)


def tilt_direction(toward: Array) -> Array:
    """Tilt the direction (3,) to the eye a little off a planar robot's normal."""
    aside = np.array([0.0, -1.0, 0.0]) if abs(toward[2]) > 0.7 else np.array([0.5, 0.0, 0.8])
    direction = toward + FLAT_VIEW_SLOPE * aside
    return direction / np.linalg.norm(direction)


def _candidate_directions(normal: Array | None) -> tuple[Array, Array]:
    """Return the candidate directions (k, 3) to the eye, and the usual one (3,).

    With a `normal` (3,) to the plane of a planar robot, they are both sides of the plane.
    """
    if normal is not None:
        usual = normal * (np.sign(normal @ USUAL_NORMAL) or 1.0)
        return np.stack([usual, -usual]), usual
    azimuth, elevation = np.meshgrid(AZIMUTHS, ELEVATIONS)
    level = np.cos(elevation)
    around = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)
    return around.reshape(-1, 3), USUAL_DIRECTION / np.linalg.norm(USUAL_DIRECTION)


def _count_visible_cells(points: Array, nodes: IntArray, onto: Projection) -> IntArray:
    """Count the cells (nodes,) in which each node's body is nearest to the eye.

    `points` (m, 3) on the bodies are in units of a cell, with the node (m,) of each.
    """
    cells = np.floor(onto(points)).astype(np.int64)  # (m, 2)
    order = np.lexsort((points @ onto.ahead, cells[:, 1], cells[:, 0]))  # by cell, then nearest first
    _, first = np.unique(cells[order], axis=0, return_index=True)
    return np.bincount(nodes[order[first]], minlength=nodes.max() + 1)


def _score_visibility(areas: IntArray) -> Array:
    """Score how well the moving bodies are seen (k,), by areas (k, nodes).

    The score is the geometric mean of the visible shares of the bodies, weighted by the square roots of their
    largest areas, times the square root of the moving bodies' share of the picture. Node 0 is the base.
    """
    moving = areas[:, 1:]
    moving = moving[:, moving.any(axis=0)]
    if not moving.size:
        return np.ones(len(areas))
    largest = moving.max(axis=0)
    shares = np.maximum(moving, 1) / largest  # one cell at least: one hidden body must not decide alone
    weights = np.sqrt(largest)
    mean = np.exp(np.log(shares) @ weights / weights.sum())
    return mean * np.sqrt(moving.sum(axis=1) / areas.sum(axis=1))


def _fraction_across(arrows: Array, directions: Array) -> Array:
    """Return the share (k,) of the length of arrows (m, 3) across each line of sight.

    The lines of sight have the unit `directions` (k, 3). The share is 1 for arrows without length.
    """
    length = np.linalg.norm(arrows, axis=1)
    along = directions @ arrows.T  # (k, m)
    seen = np.sqrt(np.maximum(length**2 - along**2, 0.0)).sum(axis=1)
    return seen / length.sum() if length.sum() > LEAST_DIVISOR else np.ones(len(directions))
