"""The loop equations closures(q) = 0 with Jacobian and drift, stacked.

Each equation is written as a wrench between its two bodies. The power of the wrench on the screw of a joint
that carries one of them is the derivative along that joint (Ball's reciprocal product). So one table of rows
(`Mechanism.rows`) serves every kind of joint: a kind is data, not code. A joint that carries both bodies or
neither has no entry.

Every equation is a product of two vectors that are linear in the axes and origins of frames (`row_factors`).
Residual, Jacobian and exact derivatives (`wrench_changes`, `frame_variations`) follow from these.

This module also has the directions that closures keep alike. They tell a closed loop from a flipped one.

A rotation is locked by keeping axes of the two frames perpendicular (see `LoopRows`). That is exact near the
right pose. It also holds with a hinge's axis turned round, or two welded frames turned by 120 degrees about
(1, 1, 1) or by 180 degrees about an axis: the equations are closed in these poses, but no motion leads to
them. The vector between an axis on the one frame and the same on the other vanishes in the right pose alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from framework.kinematics.frames import FrameMotions, FrameStack, move_frames, move_wrench
from framework.kinematics.mechanism import Mechanism
from framework.model.loop_rows import LockedDirections, LoopRows
from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import cross, dot, matmul

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
    """Compute the residual (T, m) and the Jacobian (T, m, nv) of m rows at T configurations.

    An entry of the Jacobian is the power of the row's wrench on the joint's screw.
    """
    residual, wrench = loop_wrenches(rows, frames)
    at_base = move_wrench(wrench, frames.position[:, rows.second])  # (T, m, 6)
    powers = matmul(at_base, frames.screws.swapaxes(1, 2))  # (T, m, nv)
    jacobian = powers * rows.joint_signs(frames.carried)
    if rows.has_couplings:
        jacobian += rows.coupling_jacobian(jacobian.shape[2])
    return LoopEquations(residual, jacobian)


def base_wrenches(rows: LoopRows, frames: FrameStack) -> Array:
    """Compute the wrenches (T, m, 6) of `loop_wrenches` about the base's origin."""
    return move_wrench(loop_wrenches(rows, frames).wrench, frames.position[:, rows.second])


def loop_wrenches(rows: LoopRows, frames: FrameStack) -> LoopWrenches:
    """Compute residuals (T, m) and wrenches (T, m, 6) of m rows; couplings have no wrench.

    An axis u turns with the first frame, an axis w with the second, and d leads from origin to origin. Of the
    three kinds of products the rates, with velocities v and angular velocities w_1, w_2 of the frames, are

        (u . d)' = u . (v_2 - v_1 - w_1 x d)      power of the force u
        (d . d)' = 2 d . (v_2 - v_1)              power of the force 2 d
        (u . w)' = (w x u) . (w_2 - w_1)          power of the couple w x u
    """
    a, b = row_factors(rows, frames.placements)
    residual = rows.weight * dot(a, b) - rows.constant
    if rows.has_couplings:
        residual[:, rows.coupled] = rows.coupling_residual(frames.q)
    wrench = np.zeros((*a.shape[:2], 6))
    wrench[..., :3] = rows.force_weight[:, None] * a
    if not rows.only_translations:
        wrench[..., 3:] = rows.couple_weight[:, None] * cross(b, a)
    return LoopWrenches(residual, wrench)


def wrench_changes(rows: LoopRows, placements: Array, changes: Array) -> Array:
    """Compute the changes (..., m, 6) of the wrenches of `loop_wrenches` about the base's origin.

    Axes and origins of frames (..., F, 4, 3) change by `changes` of the same shape, to first order. With the
    force f and the couple b x a at p they are (f', b' x a + b x a' + p' x f + p x f').
    """
    (a, b), (da, db) = row_factors(rows, placements), row_factors(rows, changes)
    p, dp = placements[..., rows.second, 3, :], changes[..., rows.second, 3, :]
    force, force_change = rows.force_weight[:, None] * a, rows.force_weight[:, None] * da
    couple = cross(dp, force) + cross(p, force_change)
    if not rows.only_translations:
        couple += rows.couple_weight[:, None] * (cross(db, a) + cross(b, da))
    return np.concatenate(np.broadcast_arrays(force_change, couple), axis=-1)


def closure_drift(rows: LoopRows, motions: FrameMotions) -> Array:
    """Compute the second time derivative (..., m) of the loop equations for motions of the frames.

    (a . b)" = a" . b + 2 a' . b' + a . b". For motions without joint accelerations it is the drift dJ/dt v.
    """
    a, b = row_factors(rows, motions.rates)  # (3, ..., m, 3) each: values and two derivatives
    terms = a[2] * b[0] + 2.0 * a[1] * b[1] + a[0] * b[2]  # (..., m, 3)
    return rows.weight * (terms[..., 0] + terms[..., 1] + terms[..., 2])


def row_factors(rows: LoopRows, placed: Array) -> tuple[Array, Array]:
    """Select the two vectors (..., m, 3) whose product is each row.

    `placed` (..., F, 4, 3) are axes and origins of the frames, or their rates, since both vectors are linear
    in these. The first is u, or d of a square; the second is d, or w of a rotation (`LoopRows`).
    """
    *stack, count, four, width = placed.shape
    selected = placed.reshape(*stack, count * four, width).take(rows.vectors, axis=-2)  # (..., 4, m, 3)
    u, w = selected[..., 0, :, :], selected[..., 1, :, :]
    d = selected[..., 3, :, :] - selected[..., 2, :, :]
    if rows.only_translations:
        return u, d
    return np.where(rows.square[:, None], d, u), np.where(rows.rotation[:, None], w, d)


def scale_jacobian(mechanism: Mechanism, matrix: Array, turning: NDArray[np.bool_]) -> Array:
    """Return a matrix (..., m, nv) without dimension: metres in lengths of the mechanism.

    `turning` (m,) marks the rows that are angles. Conditioning and singularity are judged on the result, so a
    robot drawn in millimetres is judged alike.
    """
    return matrix * row_weights(mechanism, turning)[:, None] * mechanism.column_scale


def row_weights(mechanism: Mechanism, turning: NDArray[np.bool_]) -> Array:
    """Return factors (m,) that make equations dimensionless: 1 for angles, else 1 / length."""
    return np.where(turning, 1.0, 1.0 / mechanism.length)


def direction_gaps(directions: LockedDirections, frames: FrameStack) -> Array:
    """Compute the vectors (T, d, 3) from each axis on the first frame to the same on the second."""
    first, second, axis, _ = directions
    return frames.placements[:, second, axis] - frames.placements[:, first, axis]


def direction_gap_derivatives(directions: LockedDirections, frames: FrameStack) -> Array:
    """Compute the derivatives (T, d, 3, nv) of `direction_gaps` along the joints."""
    first, second, axis, _ = directions
    twists = frames.screws[:, :, None] * frames.carried.T[..., None]  # (T, nv, F, 6)
    slopes = move_frames(twists, frames.placements[:, None])
    return (slopes[:, :, second, axis] - slopes[:, :, first, axis]).transpose(0, 2, 3, 1)


def find_flipped_closure(mechanism: Mechanism, frames: FrameStack) -> str | None:
    """Return the name of the closure that is most flipped; None without any.

    The frames of a flipped closure point apart. T is 1.
    """
    directions = mechanism.directions
    lengths = np.linalg.norm(direction_gaps(directions, frames)[0], axis=1)
    if not np.any(lengths > TURNED_OVER_DISTANCE):
        return None
    return directions.closures[int(np.argmax(lengths))]
