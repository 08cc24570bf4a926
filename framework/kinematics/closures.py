"""The loop equations closures(q) = 0 and the platform coordinates, with Jacobian and drift, stacked.

Built from frame Jacobians alone. One table of rows (`ParallelRobot.rows`) serves every kind of joint:
a kind is data, not code.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.kinematics.frames import FrameStack
from framework.model import ParallelRobot
from framework.model.parallel_robot import LoopRows

_NEXT, _AFTER = [1, 2, 0], [2, 0, 1]


def cross(a: Array, b: Array) -> Array:
    """Cross product over the last axis; several times faster than np.cross on stacks."""
    return a[..., _NEXT] * b[..., _AFTER] - a[..., _AFTER] * b[..., _NEXT]


class LoopEquations(NamedTuple):
    """Values and derivatives of m loop equations at T configurations."""

    residual: Array  # (T, m) [m] in translation rows, [rad] to first order in rotation rows
    jacobian: Array  # (T, m, nv) along pinocchio's velocity vector


def loop_equations(rows: LoopRows, at: FrameStack) -> LoopEquations:
    """closures(q) and its derivative.

    Translation: d/dt e.d = e.(v2 - v1) + (e x d).w1 with e carried by the first frame.
    Rotation: d/dt u.w = (u x w).(w1 - w2).
    """
    e, w, d = _row_vectors(rows, at)
    first, second = at.jacobian[:, rows.first], at.jacobian[:, rows.second]  # (T, m, 6, nv)
    if not rows.rotation.any():
        residual = np.einsum("tmi,tmi->tm", e, d)
        jacobian = np.einsum("tmi,tmiv->tmv", e, second[:, :, :3] - first[:, :, :3])
        jacobian += np.einsum("tmi,tmiv->tmv", cross(e, d), first[:, :, 3:])
        return LoopEquations(residual, jacobian)
    turning = rows.rotation[:, None]
    other = np.where(turning, rows.sign[:, None] * w, d)
    arm = cross(e, other)
    jacobian = np.einsum("tmi,tmiv->tmv", np.where(turning, 0.0, e), second[:, :, :3] - first[:, :, :3])
    jacobian += np.einsum("tmi,tmiv->tmv", arm, first[:, :, 3:])
    jacobian -= np.einsum("tmi,tmiv->tmv", np.where(turning, arm, 0.0), second[:, :, 3:])
    return LoopEquations(np.einsum("tmi,tmi->tm", e, other), jacobian)


def closure_drift(rows: LoopRows, at: FrameStack, v: Array, acceleration: Array) -> Array:
    """Second time derivative (T, m) of the loop equations when joint accelerations are zero.

    `v` is (T, nv); `acceleration` (T, F, 6) comes from `drift_accelerations`.
    """
    e, w, d = _row_vectors(rows, at)
    twist = np.einsum("tfiv,tv->tfi", at.jacobian, v)
    twist1, twist2 = twist[:, rows.first], twist[:, rows.second]
    acc1, acc2 = acceleration[:, rows.first], acceleration[:, rows.second]

    def swept(axis: Array, omega: Array, alpha: Array) -> tuple[Array, Array]:
        """First and second derivative of an axis fixed in a body."""
        rate = cross(omega, axis)
        return rate, cross(alpha, axis) + cross(omega, rate)

    de, dde = swept(e, twist1[..., 3:], acc1[..., 3:])
    dw, ddw = swept(w, twist2[..., 3:], acc2[..., 3:])
    dd, ddd = twist2[..., :3] - twist1[..., :3], acc2[..., :3] - acc1[..., :3]
    translation = dde * d + 2 * de * dd + e * ddd
    rotation = rows.sign[:, None] * (dde * w + 2 * de * dw + e * ddw)
    return np.sum(np.where(rows.rotation[:, None], rotation, translation), axis=-1)


def _row_vectors(rows: LoopRows, at: FrameStack) -> tuple[Array, Array, Array]:
    """For every row: the axis on the first frame, the one on the second, p2 - p1; each (T, m, 3)."""
    e = at.rotation[:, rows.first, :, rows.first_axis].transpose(1, 0, 2)
    w = at.rotation[:, rows.second, :, rows.second_axis].transpose(1, 0, 2)
    return e, w, at.position[:, rows.second] - at.position[:, rows.first]


# ------------------------------------------------------------------ without dimension


def scaled(robot: ParallelRobot, matrix: Array, rows: LoopRows | None) -> Array:
    """A matrix (..., m, nv) made dimensionless: metres in lengths of the robot.

    `rows` is its table of loop equations, or None when its rows are the platform's coordinates.
    Conditioning and singularity are judged on this, so a robot drawn in millimetres is judged alike.
    """
    turning = rows.rotation if rows is not None else robot.platform_axes >= 3
    row_scale = np.where(turning, 1.0, 1.0 / robot.length)
    return matrix * row_scale[:, None] * column_scale(robot)


@lru_cache(maxsize=128)
def column_scale(robot: ParallelRobot) -> Array:
    """Length of the robot for sliding joints, 1 for turning ones, shape (nv,)."""
    scale = np.ones(robot.model.nv)
    for joint in robot.model.joints[1:]:
        if joint.shortname().startswith("JointModelP"):
            scale[joint.idx_v] = robot.length
    scale.flags.writeable = False
    return scale


# ------------------------------------------------------------------ the platform


def platform_coordinates(robot: ParallelRobot, at: FrameStack) -> Array:
    """Coordinates x (T, n) of the platform on its axes, in the base frame [m, rad].

    The coordinate of a platform that turns about one axis is its twist angle about that axis.
    """
    axes = robot.platform_axes
    x = np.empty((len(at.position), robot.n))
    x[:, axes < 3] = at.position[:, 0, axes[axes < 3]]
    turning = axes[axes >= 3] - 3
    if len(turning) == 1:
        x[:, axes >= 3] = _twist_angle(at.rotation[:, 0], int(turning[0]))[:, None]
    return x


def platform_residual(robot: ParallelRobot, at: FrameStack, x: Array) -> Array:
    """platform(q) - x, (T, n); differences of one angle are taken the short way round."""
    difference = platform_coordinates(robot, at) - x
    turning = robot.platform_axes >= 3
    difference[:, turning] = np.mod(difference[:, turning] + np.pi, 2 * np.pi) - np.pi
    return difference


def platform_jacobian(robot: ParallelRobot, at: FrameStack) -> Array:
    """Derivative (T, n, nv) of the platform's twist on its axes along pinocchio's velocity vector."""
    return at.jacobian[:, 0, robot.platform_axes]


def _twist_angle(rotation: Array, axis: int) -> Array:
    """Angle (T,) about one base axis in the swing-twist decomposition of rotations (T, 3, 3)."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    return np.arctan2(rotation[:, k, j] - rotation[:, j, k], rotation[:, j, j] + rotation[:, k, k])
