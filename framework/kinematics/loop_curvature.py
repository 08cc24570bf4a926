"""The derivative of the loop forces J(q)' lambda by q at fixed multipliers.

The second derivative of a frame's motion is a product of first ones (Bruyninckx and De Schutter 1996,
"Symbolic differentiation of the velocity mapping for a serial kinematic chain", Mechanism and Machine Theory
31(2)): with i a column of the joint of j or of one before it, an axis or origin c of a frame has

    d^2 c / dq_i dq_j = omega_i x dc/dq_j.

Every row is a product a . b of two vectors that are linear in axes and origins (`row_factors`), and so its
second derivative is a_i . b_j + a_j . b_i, plus the sum of omega_i x c_j . g over all c, g = d(a . b)/dc.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from framework.arrays import Array, IntArray
from framework.kinematics.closures import row_factors
from framework.kinematics.frame_variations import tree_columns
from framework.kinematics.frames import FrameStack
from framework.kinematics.mechanism import Mechanism
from framework.linalg.ordered_sums import cross
from framework.model.loop_rows import LoopRows


def loop_curvature(mechanism: Mechanism, rows: LoopRows, frames: FrameStack, multipliers: Array) -> Array:
    """Compute d(J' lambda)/dq (T, nv, nv) for multipliers (T, m), row by row along the second index."""
    slopes = frames.slopes  # (T, F, 4, nv, 3)
    count, size, _, nv, _ = slopes.shape
    load = (rows.weight * multipliers)[..., None]  # (T, m, 1)
    mixed = _products(*_factor_slopes(rows, slopes, load))

    used, *shares = _used_vectors(rows, size)
    gradient = _gradients(rows, frames, load, shares)
    turns = frames.screws[:, None, :, 3:] * frames.carried[used // 4, :, None]  # (T, used, nv, 3)
    upper = _products(cross(gradient[:, :, None], turns), slopes.reshape(count, 4 * size, nv, 3)[:, used])
    before = tree_columns(mechanism).before
    strictly = before & ~before.T  # not two columns of one ball, whose order matters
    second = (upper * before).swapaxes(1, 2) + np.where(strictly, upper, 0.0)
    return np.asarray(mixed + mixed.swapaxes(1, 2) + second, dtype=float)


def _factor_slopes(rows: LoopRows, slopes: Array, load: Array) -> list[Array]:
    """Return the derivatives (T, m, nv, 3) of load a and of b along the joints."""
    count, size, _, nv, _ = slopes.shape
    da, db = row_factors(rows, slopes.reshape(count, size, 4, 3 * nv))
    return [part.reshape(count, -1, nv, 3) for part in (load * da, db)]


@lru_cache(maxsize=64)
def _used_vectors(rows: LoopRows, size: int) -> tuple[IntArray, Array, Array]:
    """Return the k axes and origins c in a or b, and their shares (m, k) in each."""
    in_a, in_b = row_factors(rows, np.eye(4 * size).reshape(size, 4, 4 * size))
    used = np.flatnonzero(np.any([in_a, in_b], axis=(0, 1)))
    return used, in_a[:, used], in_b[:, used]


def _gradients(rows: LoopRows, frames: FrameStack, load: Array, shares: Sequence[Array]) -> Array:
    """Compute sums g (T, k, 3) of load d(a . b)/dc over rows, from shares (m, k) of c."""
    a, b = row_factors(rows, frames.placements)  # (T, m, 3)
    from_a = np.einsum("mc,tmx->tcx", shares[0], load * b)
    return from_a + np.einsum("mc,tmx->tcx", shares[1], load * a)


def _products(a: Array, b: Array) -> Array:
    """Compute sums of a_i . b_j over vectors, (T, nv, nv), of stacks (T, vectors, nv, 3)."""
    count, _, nv, _ = a.shape
    left = a.transpose(0, 2, 1, 3).reshape(count, nv, -1)
    return left @ b.transpose(0, 1, 3, 2).reshape(count, -1, nv)
