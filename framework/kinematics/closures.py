"""The loop equations closures(q) = 0 with their derivatives, for stacks of configurations.

Each equation has a wrench between its two bodies. The derivative of the equation along a joint is the power
of this wrench on the joint's screw (Ball's reciprocal product) if the joint carries one of the bodies, and
zero if it carries both or neither. So one table of rows (`Mechanism.rows`) describes every kind of closure: a
kind is data, not code.

Every equation is a product of two vectors that are linear in the axes and origins of frames (`row_factors`).
Residual, Jacobian and exact derivatives (`wrench_changes`, `loop_force_changes`) follow from these vectors.

The module also compares directions of the two frames of a closure, to tell a closed loop from a flipped one.
A rotation is locked by equations that keep axes of the two frames perpendicular (see `LoopRows`). They
describe the closure exactly near the right pose. But they also hold if the axis of a hinge is reversed, or if
one of two welded frames is turned by 120 degrees about (1, 1, 1) or by 180 degrees about an axis. In such
flipped poses all equations are satisfied, yet no motion leads there. Only in the right pose does each locked
axis have the same direction in both frames.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.kinematics.couplings import (
    coupling_derivatives,
    coupling_drift,
    coupling_force_changes,
    coupling_jacobian,
)
from framework.kinematics.frames import (
    FrameMotions,
    FrameStack,
    bracket_wrenches,
    frame_velocities,
    move_wrench,
    tree_columns,
)
from framework.kinematics.mechanism import Mechanism
from framework.model.loop_rows import LockedDirections, LoopRows
from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import cross, dot, matmul


class LoopEquations(NamedTuple):
    """Values and derivatives of m loop equations at T configurations."""

    residual: Array  # (T, m) [m] in translation rows, [rad] to first order in rotation rows
    jacobian: Array  # (T, m, nv) along pinocchio's velocity vector


class LoopWrenches(NamedTuple):
    """Values of m loop equations at T configurations, each with its wrench on its second body.

    The time derivative of an equation is the power of its wrench on the twist of the second body relative to
    the first.
    """

    residual: Array  # (T, m)
    wrench: Array  # (T, m, 6) force and couple at the origin of the second frame


def loop_equations(rows: LoopRows, frames: FrameStack) -> LoopEquations:
    """Compute the residuals (T, m) and the Jacobian (T, m, nv) of m rows at T configurations.

    An entry of the Jacobian is the power of the row's wrench on the joint's screw.
    """
    residual, wrench = loop_wrenches(rows, frames)
    at_base = move_wrench(wrench, frames.position[:, rows.second])  # (T, m, 6) about the base's origin
    powers = matmul(at_base, frames.screws.swapaxes(1, 2))  # (T, m, nv)
    # 1 if the joint carries only the second body of the row, -1 if only the first, 0 if both or neither
    jacobian = powers * rows.joint_signs(frames.carried)
    if rows.has_couplings:
        jacobian += coupling_jacobian(rows, frames.q, jacobian.shape[2])
    return LoopEquations(residual, jacobian)


def loop_wrenches(rows: LoopRows, frames: FrameStack) -> LoopWrenches:
    """Compute residuals (T, m) and wrenches (T, m, 6) of m rows; couplings have zero wrenches.

    The residual of a row is weight (a . b) - constant, with its `row_factors` a and b. The axis u turns with
    the first frame and the axis w with the second; d leads from the first origin to the second. With
    velocities v_1, v_2 and angular velocities w_1, w_2 of the frames the three kinds of products have the
    rates

        (u . d)' = u . (v_2 - v_1 - w_1 x d)      power of the force u
        (d . d)' = 2 d . (v_2 - v_1)              power of the force 2 d
        (u . w)' = (w x u) . (w_2 - w_1)          power of the couple w x u
    """
    a, b = row_factors(rows, frames.placements)
    residual = rows.weight * dot(a, b) - rows.constant
    if rows.has_couplings:
        residual[:, rows.coupled] = coupling_derivatives(rows, frames.q, 0)
    # force a and couple b x a, of which each row has one: the weight of the other is zero
    wrench = np.zeros((*a.shape[:2], 6))
    wrench[..., :3] = rows.force_weight[:, None] * a
    if not rows.only_translations:
        wrench[..., 3:] = rows.couple_weight[:, None] * cross(b, a)
    return LoopWrenches(residual, wrench)


def wrench_changes(rows: LoopRows, placements: Array, changes: Array) -> Array:
    """Compute changes (..., m, 6) of the rows' wrenches about the base's origin, to first order.

    The wrench of a row consists of a force f along a and a couple along b x a, with the `row_factors` a and
    b, at the second frame's origin p. With primes for changes, f changes by f'. The moment changes by
    p' x f + p x f' and, in rotation rows, by the weighted b' x a + b x a'.

    Args:
        placements: axes and origins (..., F, 4, 3) of the frames.
        changes: changes of these (..., F, 4, 3); the leading dimensions of both are broadcast.
    """
    a, b = row_factors(rows, placements)
    da, db = row_factors(rows, changes)
    p, dp = (vectors[..., rows.second, 3, :] for vectors in (placements, changes))  # 3: the origin
    weight = rows.force_weight[:, None]
    force_change = weight * da
    moment_change = cross(dp, weight * a) + cross(p, force_change)
    if not rows.only_translations:  # the couples of other rows are zero
        moment_change += rows.couple_weight[:, None] * (cross(db, a) + cross(b, da))
    wrench_change = np.empty((*moment_change.shape[:-1], 6), moment_change.dtype)
    wrench_change[..., :3] = force_change
    wrench_change[..., 3:] = moment_change
    return wrench_change


def closure_drift(rows: LoopRows, motions: FrameMotions, q: Array, v: Array) -> Array:
    """Compute the drift dJ/dt v (T, m) of loop equations at q (T, nq) and rates v (T, nv).

    With the `row_factors` a, b of a row, (a . b)" = a" . b + 2 a' . b' + a . b" is multiplied by the row's
    weight. The `motions` of the frames are those without joint accelerations.
    """
    (a, da, dda), (b, db, ddb) = row_factors(rows, motions.rates)  # (..., m, 3) each
    terms = dda * b + 2.0 * da * db + a * ddb
    # added in this order, so that the sum does not depend on the size of the stack
    drift: Array = rows.weight * (terms[..., 0] + terms[..., 1] + terms[..., 2])
    if rows.has_couplings:
        drift[..., rows.coupled] = coupling_drift(rows, q, v)
    return drift


def row_factors(rows: LoopRows, placements: Array) -> tuple[Array, Array]:
    """Select the two vectors a, b (..., m, 3) of m rows; each row keeps a . b constant.

    The axis u belongs to the first frame of a row and the axis w to the second; d leads from the first origin
    to the second. a is u, or d in a row d . d. b is d, or w in a rotation row u . w. Both are linear in
    `placements` (..., F, 4, 3), the axes and origins of the frames. So rates of `placements` give rates of
    the vectors.
    """
    *stack, frames, vectors, _ = placements.shape  # 4 vectors of each frame: three axes, then the origin
    flat = placements.reshape(*stack, frames * vectors, 3)
    selected = flat.take(rows.vectors, axis=-2)  # (..., 4, m, 3): u, w and both origins of each row
    u = selected[..., 0, :, :]  # (..., m, 3)
    w = selected[..., 1, :, :]
    d = selected[..., 3, :, :] - selected[..., 2, :, :]
    if rows.only_translations:
        return u, d
    return np.where(rows.square[:, None], d, u), np.where(rows.rotation[:, None], w, d)


def scaled_equations(mechanism: Mechanism, rows: LoopRows, frames: FrameStack) -> LoopEquations:
    """Compute `loop_equations` made dimensionless: in radians and lengths of the mechanism."""
    residual, jacobian = loop_equations(rows, frames)
    lengths = mechanism.unit_lengths(rows.rotation)
    return LoopEquations(residual * (1.0 / lengths), scale_jacobian(mechanism, jacobian, lengths))


def scale_jacobian(mechanism: Mechanism, matrix: Array, lengths: Array) -> Array:
    """Return a Jacobian `matrix` (..., m, nv) made dimensionless: metres become lengths of the mechanism.

    `lengths` (m,) are the `unit_lengths` of the rows. Rank and conditioning are judged on the result, so they
    do not depend on the unit of length.
    """
    return matrix * (1.0 / lengths)[:, None] * mechanism.column_scale


def direction_gaps(directions: LockedDirections, frames: FrameStack) -> Array:
    """Compute the differences (T, d, 3) of the unit axes of d pairs that should be parallel, `directions`."""
    first, second, axis, _ = directions  # (d,) two frames, and the axis 0..2 that they share
    return frames.placements[:, second, axis] - frames.placements[:, first, axis]


def direction_gap_derivatives(directions: LockedDirections, frames: FrameStack) -> Array:
    """Compute the derivatives (T, d, 3, nv) of the `direction_gaps` of d pairs along the joints."""
    first, second, axis, _ = directions
    # (T, nv, F, 6) of each frame by each joint: zero if the joint does not carry the frame
    twists = frames.screws[:, :, None] * frames.carried.T[..., None]
    slopes = frame_velocities(twists, frames.placements[:, None])  # (T, nv, F, 4, 3)
    gap_slopes = slopes[:, :, second, axis] - slopes[:, :, first, axis]  # (T, nv, d, 3)
    return np.moveaxis(gap_slopes, 1, 3)


def find_flipped_closure(mechanism: Mechanism, frames: FrameStack) -> str | None:
    """Return the name of the flipped closure with the largest direction gap (T = 1); None without one."""
    directions = mechanism.directions
    distances = np.linalg.norm(direction_gaps(directions, frames)[0], axis=1)  # (d,) between tips of axes
    # a distance is 0 in the right pose, and sqrt(2) or more in a flipped one
    return str(directions.closures[np.argmax(distances)]) if np.any(distances > 1.0) else None


def loop_curvature(mechanism: Mechanism, rows: LoopRows, frames: FrameStack, multipliers: Array) -> Array:
    """Compute the derivative d(J' lambda)/dq (T, nv, nv) of loop forces at fixed multipliers (T, m).

    Row i, column j is the change of the force on joint i by a unit motion of joint j.
    """
    unit_motions = np.eye(mechanism.nv)[None]
    wrenches = move_wrench(loop_wrenches(rows, frames).wrench, frames.position[:, rows.second])
    changes = loop_force_changes(mechanism, rows, frames, wrenches, multipliers, unit_motions)
    return changes.swapaxes(1, 2)


def loop_force_changes(
    mechanism: Mechanism,
    rows: LoopRows,
    frames: FrameStack,
    wrenches: Array,
    multipliers: Array,
    motions: Array,
) -> Array:
    """Compute changes (T, k, nv) of the loop forces J' lambda by motions (T, k, nv).

    The force on joint i is S_i . W_i, with its screw S_i and the sum W_i of the loops' wrenches, times their
    multipliers, on the bodies that it carries. S_i changes with the joints that precede i, and W_i with the
    frames.

    Args:
        wrenches: (T, m, 6) of the rows at unit multipliers, about the base's origin.
        multipliers: lambda (T, m), constant.
        motions: k tangent vectors (T, k, nv).
    """
    screws, placements = frames.screws, frames.placements[:, None]
    shares = multipliers[..., None] * rows.joint_signs(frames.carried)  # (T, m, nv) of each wrench on a joint
    joint_shares = shares.swapaxes(1, 2)  # (T, nv, m)
    steps = screws[:, None] * motions[..., None]  # (T, k, nv, 6) twists by the motion of each joint alone

    # changes of the wrenches, which move with their frames
    frame_changes = frame_velocities(frames.carried @ steps, placements)  # (T, k, F, 4, 3)
    of_wrenches = wrench_changes(rows, placements, frame_changes)  # (T, k, m, 6)
    by_wrenches = dot(joint_shares[:, None] @ of_wrenches, screws[:, None])  # (T, k, nv)

    # changes of the screws: a joint moves with all joints that precede it
    displacements = tree_columns(mechanism).precedes.T.astype(float) @ steps  # (T, k, nv, 6)
    carried_wrenches = joint_shares @ wrenches  # W_i (T, nv, 6)
    by_screws = dot(displacements, bracket_wrenches(screws, carried_wrenches)[:, None])
    changes = by_wrenches + by_screws
    if rows.has_couplings:
        changes += coupling_force_changes(rows, frames.q, multipliers, motions)
    return changes
