"""Rigid placements as 4 x 4 matrices, and the ways in which files write turns."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from framework.numerics.arrays import Array

Vector3 = tuple[float, float, float]


def placement(rotation: Array | None = None, translation: Sequence[float] | Array = (0.0, 0.0, 0.0)) -> Array:
    """Return the placement (4, 4) of a rotation (3, 3) and a translation (3,) [m]."""
    matrix = np.eye(4)
    if rotation is not None:
        matrix[:3, :3] = rotation
    matrix[:3, 3] = translation
    return matrix


def invert_placement(matrix: Array) -> Array:
    """Invert a placement (4, 4)."""
    turn = matrix[:3, :3].T
    return placement(turn, -turn @ matrix[:3, 3])


def rotation_about(axis: Sequence[float] | Array, angle: float) -> Array:
    """Compute the rotation (3, 3) by an angle [rad] about an axis of any length.

    R = 1 + sin(angle) K + (1 - cos(angle)) K K with K = [axis]x (Rodrigues).
    """
    skew = pin.skew(np.divide(axis, np.linalg.norm(axis)))
    return np.eye(3) + math.sin(angle) * skew + (1.0 - math.cos(angle)) * skew @ skew


def from_rpy(rpy: Sequence[float] | Array) -> Array:
    """Return the rotation (3, 3) of a URDF's roll, pitch and yaw [rad]."""
    roll, pitch, yaw = rpy
    return rotation_about((0, 0, 1), yaw) @ rotation_about((0, 1, 0), pitch) @ rotation_about((1, 0, 0), roll)


def to_rpy(rotation: Array) -> Vector3:
    """Compute roll, pitch and yaw [rad] of a rotation (3, 3).

    Exact to rounding at every pitch: the yaw is taken out before the roll is read, so that the two fit each
    other at a pitch of a quarter turn, where only their sum or difference is determined.
    """
    pitch = math.atan2(-rotation[2, 0], math.hypot(rotation[0, 0], rotation[1, 0]))
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    rest = rotation_about((0, 0, 1), -yaw) @ rotation
    return math.atan2(-rest[1, 2], rest[1, 1]), pitch, yaw


def from_quaternion(w: float, x: float, y: float, z: float) -> Array:
    """Return the rotation (3, 3) of a quaternion of any length but zero."""
    return pin.Quaternion(w, x, y, z).normalized().toRotationMatrix()


def rotation_with_axis(name: str, axis: Sequence[float] | Array) -> Array:
    """Return a rotation (3, 3) whose column `name` (x, y, z) is the axis."""
    first = "xyz".index(name)
    main = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    if main[first] == 1.0:
        return np.eye(3)
    second = np.cross(main, np.eye(3)[int(np.argmin(np.abs(main)))])
    second /= np.linalg.norm(second)
    columns = np.array([main, second, np.cross(main, second)])  # right-handed, in cyclic order
    return np.roll(columns, first, axis=0).T
