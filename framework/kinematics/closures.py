"""The loop equations closures(q) = 0 with Jacobian and drift, stacked.

Each equation is written as a wrench between its two bodies. The power of the wrench on the screw of a joint
that carries one of them is the derivative along that joint (Ball's reciprocal product). So one table of rows
(`Mechanism.rows`) serves every kind of joint: a kind is data, not code. A joint that carries both bodies or
neither has no entry.

An equation that locks no axis, as `distance`, is a flag of `LoopRows` (model/loop_rows) with its value, its
derivative and its drift here, and its curvature in loop_curvature. The proofs
know it by a term of proofs/equation_terms with bounds in proofs/derivative_bounds.

This module also has the directions that closures keep alike. They tell a closed loop from one turned over.

A rotation is locked by keeping axes of the two frames perpendicular (see `LoopRows`). That is exact near the
right pose. It also holds with a hinge's axis turned round, or two welded frames turned by 120 degrees about
(1, 1, 1) or by 180 degrees about an axis: the equations are closed in these poses, but no motion leads to
them. The vector between an axis on the one frame and the same on the other vanishes in the right pose alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from framework.arrays import Array, IntArray
from framework.kinematics.frames import FrameMotions, FrameStack
from framework.kinematics.mechanism import Mechanism
from framework.linalg.ordered_sums import cross, dot, matmul
from framework.model.loop_rows import LockedDirections, LoopRows

TURNED_OVER_DISTANCE = 1.0  # between the ends of unit axes: 0 where loops are closed, else sqrt(2) or more


class LoopEquations(NamedTuple):
    """Values and derivatives of m loop equations at T configurations."""

    residual: Array  # (T, m) [m] in translation rows, [rad] to first order in rotation rows
    jacobian: Array  # (T, m, nv) along pinocchio's velocity vector


class LoopWrenches(NamedTuple):
    """Values of m loop equations at T configurations, and each as a wrench on its second body.

    The derivative of the equation is the power of the wrench on the twist of the second body relative to the
    first.
    """

    residual: Array  # (T, m)
    wrench: Array  # (T, m, 6) force and couple at the origin of the second frame


def loop_equations(rows: LoopRows, frames: FrameStack) -> LoopEquations:
    """Compute closures(q) and its derivative, of any rows of a robot."""
    residual, wrench = loop_wrenches(rows, frames)
    wrench[..., 3:] += cross(frames.position[:, rows.second], wrench[..., :3])  # about the base's origin
    signs = frames.carried[rows.second] - frames.carried[rows.first]
    jacobian = matmul(wrench, frames.screws.swapaxes(1, 2)) * signs
    if rows.has_couplings:
        jacobian += rows.coupling_jacobian(jacobian.shape[2])
    return LoopEquations(residual, jacobian)


def loop_wrenches(rows: LoopRows, frames: FrameStack) -> LoopWrenches:
    """Compute the loop equations as wrenches; couplings of joints have a value and no wrench.

    Translation: d/dt e.d = e.(v2 - v1 - w1 x d) with e carried by the first frame: the force e. Distance
    L: d/dt (d.d - L^2) / 2L = (d / L).(v2 - v1): the force d / L. Rotation: d/dt u.w =
    (w x u).(w2 - w1): the couple w x u.
    """
    loops = _frame_wrenches(rows, frames)
    if rows.has_couplings:
        loops.residual[:, rows.coupled] = rows.coupling_residual(frames.q)
    return loops


def _frame_wrenches(rows: LoopRows, frames: FrameStack) -> LoopWrenches:
    """Compute the loop equations between frames as wrenches."""
    e, d = first_axes(rows, frames), row_displacements(rows, frames)
    if rows.only_translations:
        return LoopWrenches(dot(e, d), _stacked_wrenches(rows, e, d))
    w = second_axes(rows, frames) * rows.sign[:, None]
    gap = (dot(d, d) - rows.length**2) / (2 * rows.length)
    along = dot(e, np.where(rows.rotation[:, None], w, d))
    residual = np.where(rows.distance, gap, along)
    return LoopWrenches(residual, _stacked_wrenches(rows, e, d, cross(w, e)))


def _stacked_wrenches(rows: LoopRows, along: Array, apart: Array, couple: Array | None = None) -> Array:
    """Return wrenches (T, m, 6) of translations, distances and rotations, or their rates, each (T, m, 3)."""
    wrench = np.zeros((*along.shape[:2], 6))
    if couple is None:  # translations only
        wrench[..., :3] = along
        return wrench
    turning, distance = rows.rotation[:, None], rows.distance[:, None]
    wrench[..., :3] = np.where(turning, 0.0, np.where(distance, apart / rows.length[:, None], along))
    wrench[..., 3:] = np.where(turning, couple, 0.0)
    return wrench


def wrench_rates(rows: LoopRows, frames: FrameStack, twists: Array) -> Array:
    """Compute the rates (T, m, 6) of the wrenches of `loop_wrenches` for twists (T, F, 6) of the frames."""
    e, twist1, twist2 = first_axes(rows, frames), twists[:, rows.first], twists[:, rows.second]
    de, dd = cross(twist1[..., 3:], e), twist2[..., :3] - twist1[..., :3]
    if rows.only_translations:
        return _stacked_wrenches(rows, de, dd)
    w = second_axes(rows, frames) * rows.sign[:, None]
    dw = cross(twist2[..., 3:], w)
    return _stacked_wrenches(rows, de, dd, cross(dw, e) + cross(w, de))


def closure_drift(rows: LoopRows, frames: FrameStack, motions: FrameMotions) -> Array:
    """Compute the second time derivative (T, m) of the loop equations when joint accelerations are zero."""
    e, d = first_axes(rows, frames), row_displacements(rows, frames)
    first = motions.rates.take(rows.first, axis=2)  # twists and drifts, (2, T, m, 6)
    apart = motions.rates.take(rows.second, axis=2) - first
    # seen from the first frame, in which e rests, p2 moves with `velocity` and `acceleration`
    omega, dragged = first[0, ..., 3:], cross(first[..., 3:], d)
    velocity = apart[0, ..., :3] - dragged[0]
    acceleration = apart[1, ..., :3] - dragged[1] - cross(omega, apart[0, ..., :3] + velocity)
    translation = dot(e, acceleration)
    if rows.only_translations:
        return translation
    w, turning = second_axes(rows, frames), apart[0, ..., 3:]
    turned = cross(apart[1, ..., 3:] - cross(omega, turning), w) + cross(turning, cross(turning, w))
    distance = (dot(velocity, velocity) + dot(d, acceleration)) / rows.length
    along = np.where(rows.rotation, rows.sign * dot(e, turned), translation)
    return np.where(rows.distance, distance, along)


def row_factors(rows: LoopRows, placed: Array) -> tuple[Array, Array]:
    """Select the two vectors (..., m, 3) whose product is each row, of axes and origins (..., F, 4, 3).

    The first is an axis of the first frame, or p2 - p1 of a distance; the second is p2 - p1, or an axis of
    the second frame. Rates of axes and origins give rates of the vectors.
    """
    vectors = placed.reshape(*placed.shape[:-3], -1, 3).take(rows.vectors, axis=-2)  # (..., 4, m, 3)
    first, apart = vectors[..., 0, :, :], vectors[..., 3, :, :] - vectors[..., 2, :, :]
    if rows.only_translations:
        return first, apart
    second = np.where(rows.rotation[:, None], vectors[..., 1, :, :] * rows.sign[:, None], apart)
    return np.where(rows.distance[:, None], apart, first), second


def first_axes(rows: LoopRows, frames: FrameStack) -> Array:
    """Return the axis of every row on its first frame, (T, m, 3)."""
    return frames.rotation.swapaxes(2, 3)[:, rows.first, rows.first_axis]


def row_displacements(rows: LoopRows, frames: FrameStack) -> Array:
    """Compute p2 - p1 of every row, (T, m, 3)."""
    return frames.position[:, rows.second] - frames.position[:, rows.first]


def second_axes(rows: LoopRows, frames: FrameStack) -> Array:
    """Return the axis of every row on its second frame, (T, m, 3)."""
    return frames.rotation.swapaxes(2, 3)[:, rows.second, rows.second_axis]


def scale_jacobian(mechanism: Mechanism, matrix: Array, turning: NDArray[np.bool_]) -> Array:
    """Make a matrix (..., m, nv) dimensionless: metres in lengths of the mechanism.

    `turning` (m,) tells the rows that are angles. Conditioning and singularity are judged on the result, so a
    robot drawn in millimetres is judged alike.
    """
    return matrix * row_weights(mechanism, turning)[:, None] * mechanism.column_scale


def row_weights(mechanism: Mechanism, turning: NDArray[np.bool_]) -> Array:
    """Return factors (m,) that make equations dimensionless: 1 for angles, else 1 / length."""
    return np.where(turning, 1.0, 1.0 / mechanism.length)


def direction_gaps(directions: LockedDirections, frames: FrameStack) -> Array:
    """Compute the vectors (T, d, 3) from each axis on the first frame to the same on the second."""
    axes = frames.rotation.swapaxes(2, 3)
    return np.asarray(
        axes[:, directions.second, directions.axis] - axes[:, directions.first, directions.axis]
    )


def direction_slopes(directions: LockedDirections, stack: FrameStack) -> Array:
    """Compute the derivatives (T, d, 3, nv) of `direction_gaps`: de/dt = w x e of an axis e."""
    axes, turns = stack.rotation.swapaxes(2, 3), stack.jacobian[:, :, 3:].swapaxes(2, 3)  # (T, F, nv, 3)

    def change(frames: IntArray) -> Array:
        e = axes[:, frames, directions.axis][:, :, None]  # (T, d, 1, 3)
        return cross(turns[:, frames], np.broadcast_to(e, turns[:, frames].shape)).swapaxes(2, 3)

    return np.asarray(change(directions.second) - change(directions.first))


def find_turned_over(mechanism: Mechanism, frames: FrameStack) -> str | None:
    """Return the closure that is farthest from its right pose, T = 1; None unless one is turned over."""
    directions = mechanism.directions
    lengths = np.linalg.norm(direction_gaps(directions, frames)[0], axis=1)
    return directions.closures[int(np.argmax(lengths))] if np.any(lengths > TURNED_OVER_DISTANCE) else None
