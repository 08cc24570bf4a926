"""The direction from which a robot is looked at: of many, the one that shows most of the robot.

A planar robot is seen along its normal, from one side or the other; any other from all around, from eye
level to halfway up. A body is measured by the cells of the picture in which it is nearest to the eye.
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

USUAL_DIRECTION = np.array([0.75, -1.35, 0.65])  # from the robot to the eye: of directions alike the nearest
USUAL_NORMAL = np.array([0.2, -1.0, 2.0])  # on whose side the eye is, of a planar robot
FLAT_VIEW_SLOPE = np.tan(np.radians(10.0))  # planar robots on a page: bodies still show a depth
AZIMUTHS, ELEVATIONS = np.radians(np.arange(0, 360, 15)), np.radians([10, 20, 30, 40])


class ShownObjects(NamedTuple):
    """Objects that a picture must show beside the bodies."""

    path: Array  # (m, 3)
    arrow: Array  # (3,) that is to lie across the sight, such as t_s
    normal: Array | None  # (3,) of a surface that is not to be seen from its edge


class Projection(NamedTuple):
    """The projection of points of space onto the paper, without perspective [m]."""

    right: Array  # (3,)
    up: Array  # (3,)
    ahead: Array  # (3,) from the eye

    def __call__(self, points: Array) -> Array:
        """Return the places (..., 2) of points (..., 3)."""
        return points @ np.stack([self.right, self.up], axis=1)


class Sight(NamedTuple):
    """A robot's solids and the direction to the eye, shared by all pictures of one motion."""

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
    """Choose the sight on a robot at q (nq,), its reference when None."""
    bodies = body_shapes(robot)
    motors = motor_shapes(robot, bodies)
    normal = planar_normal(robot)
    points, nodes = _sample_surfaces(robot, robot.reference.q if q is None else q, bodies + motors)
    return Sight(bodies, motors, _best_direction(points, nodes, normal, wanted), normal is not None)


@lru_cache(maxsize=16)
def film_sight(film: Film) -> Sight:
    """Choose the sight on a motion at its first singular instant, or else halfway."""
    robot, k = film.robot, film.key_frame
    q, arrow, normal = film.q[k], np.zeros(3), None
    if film.instants:
        twist = film.twists[k]
        arrow = twist[:3] if len(robot.platform.sliding) else twist[3:]
        patch = locus_patch(robot, q, film.x[k])
        if patch is not None:
            normal = np.cross(patch[-1, -1] - patch[0, 0], patch[0, -1] - patch[-1, 0])  # of its diagonals
            normal /= np.linalg.norm(normal)
    return robot_sight(robot, q, ShownObjects(film.platform, arrow, normal))


def project_along(toward: Array) -> Projection:
    """Return the projection for an eye in direction (3,) from the robot.

    z is up on paper, or else y.
    """
    upright = np.array([0.0, 1.0, 0.0]) if abs(toward[2]) > 0.7 else np.array([0.0, 0.0, 1.0])
    right = np.cross(upright, toward)
    right = right / np.linalg.norm(right)
    return Projection(right, np.cross(toward, right), -toward)


def tilt_direction(toward: Array) -> Array:
    """Tilt the direction (3,) of an eye a little aside of a planar robot's normal."""
    aside = np.array([0.0, -1.0, 0.0]) if abs(toward[2]) > 0.7 else np.array([0.5, 0.0, 0.8])
    direction = toward + FLAT_VIEW_SLOPE * aside
    return direction / np.linalg.norm(direction)


def _best_direction(
    points: Array, nodes: IntArray, normal: Array | None, wanted: ShownObjects | None
) -> Array:
    """Choose the direction (3,) to the eye that shows most of the robot.

    The score is the share of each body that is seen, of the most that any direction shows of it, times how
    far arrow and path lie across the sight and the surface faces it.
    """
    directions, usual = _candidate_directions(normal)
    areas = np.array([_count_visible_cells(points, nodes, project_along(toward)) for toward in directions])
    away = np.arccos(np.clip(directions @ usual, -1.0, 1.0)) / np.pi
    scores = _score_visibility(areas) * (
        1.0 - 0.3 * away
    )  # what the direction opposite to the usual one loses
    if wanted is not None and normal is None:
        scores *= _fraction_across(wanted.arrow[None], directions)
        scores *= np.sqrt(_fraction_across(np.diff(wanted.path, axis=0), directions))
        if wanted.normal is not None:
            scores *= np.sqrt(np.abs(directions @ wanted.normal))
    return directions[np.argmax(scores)]


def _candidate_directions(normal: Array | None) -> tuple[Array, Array]:
    """Return the directions (k, 3) to choose from, and the usual one (3,)."""
    if normal is not None:
        usual = normal * (np.sign(normal @ USUAL_NORMAL) or 1.0)
        return np.stack([usual, -usual]), usual
    azimuth, elevation = (each.ravel() for each in np.meshgrid(AZIMUTHS, ELEVATIONS))
    level = np.cos(elevation)
    around = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=1)
    return around, USUAL_DIRECTION / np.linalg.norm(USUAL_DIRECTION)


def _sample_surfaces(robot: ParallelRobot, q: Array, shapes: list[Shape]) -> tuple[Array, IntArray]:
    """Return points (m, 3) all over the solids [cells], and the node (m,) of each."""
    poses = joint_poses(robot, q[None])[0]

    boxes = [carried_points(poses[shape.node], shape.corners()) for shape in shapes]
    # 40 cells along the largest extent
    spacing = np.ptp(np.concatenate(boxes), axis=0).max() / 40
    points = [carried_points(poses[shape.node], surface_points(shape, spacing)) for shape in shapes]
    nodes = np.repeat([shape.node for shape in shapes], list(map(len, points)))
    return np.concatenate(points) / spacing, nodes


def _count_visible_cells(points: Array, nodes: IntArray, onto: Projection) -> IntArray:
    """Count the cells (nodes,) in which each node's body is nearest to the eye."""
    across, up = np.floor(onto(points)).astype(np.int64).T
    order = np.lexsort((-(points @ onto.ahead), up, across))  # the nearest last in its cell
    nearest = np.append((np.diff(across[order]) != 0) | (np.diff(up[order]) != 0), True)
    return np.bincount(nodes[order[nearest]], minlength=nodes.max() + 1)


def _score_visibility(areas: IntArray) -> Array:
    """Score the visibility (k,) of the moving bodies, by areas (k, nodes).

    Node 0 is the base. The score is a weighted geometric mean of the fractions seen.
    """
    moving = areas[:, 1:][:, areas[:, 1:].max(axis=0) > 0]
    if not moving.shape[1]:
        return np.ones(len(areas))
    # one cell at least: a hidden body weighs, but does not decide alone
    share = np.maximum(moving, 1) / moving.max(axis=0)
    weight = np.sqrt(moving.max(axis=0))
    share = np.exp(np.log(share) @ weight / weight.sum())
    filled = moving.sum(axis=1) / areas.sum(axis=1)
    return share * np.sqrt(filled)


def _fraction_across(arrows: Array, directions: Array) -> Array:
    """Return which fraction (k,) of the arrows' (m, 3) length lies across each sight.

    1 without length.
    """
    length = np.linalg.norm(arrows, axis=1)
    along = directions @ arrows.T
    seen = np.sqrt(np.clip(length**2 - along**2, 0.0, None)).sum(axis=1)
    return seen / length.sum() if length.sum() > LEAST_DIVISOR else np.ones(len(directions))
