"""The loop equations closures(q) = 0 with Jacobian and drift, stacked.

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

_NEXT, _AFTER = np.array([1, 2, 0]), np.array([2, 0, 1])


def cross(a: Array, b: Array) -> Array:
    """Cross product over the last axis; several times faster than np.cross on stacks."""
    return a.take(_NEXT, -1) * b.take(_AFTER, -1) - a.take(_AFTER, -1) * b.take(_NEXT, -1)


class LoopEquations(NamedTuple):
    """Values and derivatives of m loop equations at T configurations."""

    residual: Array  # (T, m) [m] in translation rows, [rad] to first order in rotation rows
    jacobian: Array  # (T, m, nv) along pinocchio's velocity vector


def loop_equations(rows: LoopRows, at: FrameStack) -> LoopEquations:
    """closures(q) and its derivative.

    Translation: d/dt e.d = e.(v2 - v1) + (e x d).w1 with e carried by the first frame.
    Rotation: d/dt u.w = (u x w).(w1 - w2). Distance L: d/dt (d.d - L^2) / 2L = (d / L).(v2 - v1).
    """
    e, w, d = _row_vectors(rows, at)
    first, second = at.jacobian[:, rows.first], at.jacobian[:, rows.second]  # (T, m, 6, nv)
    if rows.only_translations:
        residual = np.einsum("tmi,tmi->tm", e, d)
        jacobian = np.einsum("tmi,tmiv->tmv", e, second[:, :, :3] - first[:, :, :3])
        jacobian += np.einsum("tmi,tmiv->tmv", cross(e, d), first[:, :, 3:])
        return LoopEquations(residual, jacobian)
    turning, distance = rows.rotation[:, None], rows.distance[:, None]
    length = np.where(rows.distance, rows.length, 1.0)
    other = np.where(turning, rows.sign[:, None] * w, d)
    linear = np.where(turning, 0.0, np.where(distance, d / length[:, None], e))
    arm = np.where(distance, 0.0, cross(e, other))
    jacobian = np.einsum("tmi,tmiv->tmv", linear, second[:, :, :3] - first[:, :, :3])
    jacobian += np.einsum("tmi,tmiv->tmv", arm, first[:, :, 3:])
    jacobian -= np.einsum("tmi,tmiv->tmv", np.where(turning, arm, 0.0), second[:, :, 3:])
    gap = (np.einsum("tmi,tmi->tm", d, d) - length**2) / (2 * length)
    return LoopEquations(np.where(rows.distance, gap, np.einsum("tmi,tmi->tm", e, other)), jacobian)


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
    dd, ddd = twist2[..., :3] - twist1[..., :3], acc2[..., :3] - acc1[..., :3]
    translation = np.sum(dde * d + 2 * de * dd + e * ddd, axis=-1)
    if rows.only_translations:
        return translation
    dw, ddw = swept(w, twist2[..., 3:], acc2[..., 3:])
    rotation = rows.sign * np.sum(dde * w + 2 * de * dw + e * ddw, axis=-1)
    distance = np.sum(dd * dd + d * ddd, axis=-1) / np.where(rows.distance, rows.length, 1.0)
    return np.where(rows.rotation, rotation, np.where(rows.distance, distance, translation))


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
