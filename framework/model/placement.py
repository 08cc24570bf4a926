"""Rigid placements as 4 x 4 matrices, and the conventions in which files write rotations."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from framework.numerics.arrays import Array


def placement(rotation: Array | None = None, translation: Sequence[float] | Array = (0.0, 0.0, 0.0)) -> Array:
    """Return the placement (4, 4) of a rotation (3, 3), none by default, and a translation (3,) [m]."""
    matrix = np.eye(4)
    if rotation is not None:
        matrix[:3, :3] = rotation
    matrix[:3, 3] = translation
    return matrix


def invert_placement(matrix: Array) -> Array:
    """Invert a placement (4, 4)."""
    turn = matrix[:3, :3].T
    return placement(turn, -turn @ matrix[:3, 3])


def unit_vector(axis: str) -> Array:
    """Return the unit vector (3,) of an axis x, y or z."""
    return np.eye(3)["xyz".index(axis)]


def rotation_about(axis: Sequence[float] | Array, angle: float) -> Array:
    """Compute the rotation (3, 3) by an angle [rad] about an axis of any length.

    R = 1 + sin(angle) K + (1 - cos(angle)) K K with K = [axis]x (Rodrigues).
    """
    skew = pin.skew(np.divide(axis, np.linalg.norm(axis)))
    return np.eye(3) + math.sin(angle) * skew + (1.0 - math.cos(angle)) * skew @ skew


def from_rpy(rpy: Sequence[float] | Array) -> Array:
    """Return the rotation (3, 3) of a URDF's roll, pitch and yaw [rad]."""
    about_x, about_y, about_z = map(rotation_about, np.eye(3), rpy)
    return about_z @ about_y @ about_x


def to_rpy(rotation: Array) -> tuple[float, float, float]:
    """Compute roll, pitch and yaw [rad] of a rotation (3, 3).

    Exact to rounding at every pitch. At a pitch of 90 degrees only the sum or the difference of roll and yaw
    is determined; the roll is therefore read from the rotation that remains once the yaw is removed.
    """
    # the x axis of the rotated frame: (cos yaw cos pitch, sin yaw cos pitch, -sin pitch)
    x, y, z = rotation[:, 0]
    pitch = math.atan2(-z, math.hypot(x, y))
    yaw = math.atan2(y, x)
    without_yaw = rotation_about((0, 0, 1), -yaw) @ rotation
    return math.atan2(-without_yaw[1, 2], without_yaw[1, 1]), pitch, yaw


def from_quaternion(w: float, x: float, y: float, z: float) -> Array:
    """Return the rotation (3, 3) of a quaternion of any length above zero."""
    return pin.Quaternion(w, x, y, z).normalized().toRotationMatrix()


def to_quaternion(rotation: Array) -> Array:
    """Return a unit quaternion w, x, y, z (4,) of a rotation (3, 3)."""
    return np.roll(pin.Quaternion(rotation).coeffs(), 1)  # pinocchio puts w last


def rotation_with_axis(name: str, axis: Sequence[float] | Array) -> Array:
    """Return a rotation (3, 3) whose column `name` (x, y, z) is the axis."""
    column = "xyz".index(name)
    unit_axis = np.divide(axis, np.linalg.norm(axis))
    if unit_axis[column] == 1.0:
        return np.eye(3)
    least_parallel = np.eye(3)[np.abs(unit_axis).argmin()]  # x, y or z: its cross product is far from zero
    second = np.cross(unit_axis, least_parallel)
    second /= np.linalg.norm(second)
    right_handed = np.array([unit_axis, second, np.cross(unit_axis, second)])
    return np.roll(right_handed, column, axis=0).T  # a cyclic permutation stays right-handed
