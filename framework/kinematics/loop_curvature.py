"""The derivative of the loop forces J(q)' lambda by q at fixed multipliers.

The second derivative of a frame's motion is a product of its first ones: with i a column of the joint of j
or of one before it, d(omega_j)/dq_i = omega_i x omega_j and d^2 p/dq_i dq_j = omega_i x l_j, with (l_j,
omega_j) column j of the frame's Jacobian. So the whole derivative comes from the Jacobians that are
there anyway.
Source of the rule: Bruyninckx and De Schutter 1996, "Symbolic differentiation of the velocity mapping for a
serial kinematic chain", Mechanism and Machine Theory 31(2).
"""

from __future__ import annotations

import numpy as np

from framework.arrays import Array
from framework.kinematics.closures import first_axes, row_displacements, second_axes
from framework.kinematics.frame_variations import tree_columns
from framework.kinematics.frames import FrameStack
from framework.kinematics.mechanism import Mechanism
from framework.linalg.ordered_sums import cross
from framework.model.loop_rows import LoopRows


def loop_curvature(mechanism: Mechanism, rows: LoopRows, frames: FrameStack, multipliers: Array) -> Array:
    """Compute d(J' lambda)/dq (T, nv, nv) for multipliers (T, m), row by row along the second index."""
    jacobian = frames.jacobian.transpose(0, 1, 3, 2)  # (T, F, nv, 6)
    slides, turns = jacobian[..., :3], jacobian[..., 3:]
    turn1 = turns[:, rows.first]  # (T, m, nv, 3)
    slide = slides[:, rows.second] - slides[:, rows.first]
    e = first_axes(rows, frames)[:, :, None]  # (T, m, 1, 3)
    d = row_displacements(rows, frames)[:, :, None]
    swing = cross(turn1, e)  # (T, m, nv, 3) how e turns
    load = multipliers[:, :, None]  # (T, m, 1)
    turning, distance = rows.rotation[:, None], rows.distance[:, None]

    # the force that each row puts on the second frame, what acts on its first axis, and how that changes
    push, held, offset, change = load * e[:, :, 0], load[..., None], d, slide
    if rows.distance.any():
        push = load * np.where(distance, d[:, :, 0] / rows.length[:, None], e[:, :, 0])
        held = np.where(distance, 0.0, load)[..., None]  # (T, m, 1, 1)
    if rows.rotation.any():
        w = rows.sign[:, None, None] * second_axes(rows, frames)[:, :, None]
        turn2 = turns[:, rows.second]
        swing2 = cross(turn2, w)
        push = np.where(turning, 0.0, push)
        offset = np.where(turning[:, None], w, d)
        change = np.where(turning[:, None], swing2, slide)

    # second derivatives of the points
    ends = np.eye(frames.position.shape[1])
    force = np.einsum("mf,tmx->tfx", ends[rows.second] - ends[rows.first], push)
    upper = _products(cross(force[:, :, None], turns), slides)
    # second derivatives of the axis on the first frame: e_ij . d = -(omega_j x e) . (omega_i x d)
    upper -= _products(cross(turn1, offset), held * swing)
    # products of first derivatives
    if rows.rotation.any():
        turned = np.where(turning, load, 0.0)[..., None]
        upper -= _products(cross(turn2, e), turned * swing2)
    mixed = _products(held * swing, change)
    symmetric = mixed + mixed.transpose(0, 2, 1)
    if rows.distance.any():
        stretched = np.where(distance, load / rows.length[:, None], 0.0)[..., None]
        symmetric += _products(stretched * slide, slide)
    before = tree_columns(mechanism).before
    strictly = before & ~before.T  # not two columns of one ball, whose order matters
    return np.asarray(
        symmetric + (upper * before).transpose(0, 2, 1) + np.where(strictly, upper, 0.0), dtype=float
    )


def _products(a: Array, b: Array) -> Array:
    """Compute sums of a_i . b_j over rows or frames, (T, nv, nv), of vectors (T, rows, nv, 3)."""
    count, _, nv, _ = a.shape
    left = a.transpose(0, 2, 1, 3).reshape(count, nv, -1)
    return left @ b.transpose(0, 1, 3, 2).reshape(count, -1, nv)
