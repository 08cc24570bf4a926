"""How frames and loop equations of a moving robot change with its configuration, rates and accelerations.

With the screws S_i of the joints about the base's origin, the twist of a body and its rate are

    V = sum S_i v_i,        A = sum S_i a_i + (V_i x S_i) v_i

over the joints that carry it, V_i the twist of the body behind joint i and x the bracket of screws. A small
motion eta displaces that body by Phi_i = sum eta_j S_j over the joints that carry it, and S_i by Phi_i x S_i.
All this, loop equations and velocities of the platform with it, is analytic in the motion: a complex step
differentiates them to rounding. Source of the rules for screws: J. Carpentier and N. Mansard, Analytical
Derivatives of Rigid Body Dynamics Algorithms, Robotics: Science and Systems 2018.

Here too is the derivative of the loop forces J(q)' lambda by q at fixed multipliers (`loop_curvature`). The
second derivative of a frame's motion is a product of first ones (Bruyninckx and De Schutter 1996, "Symbolic
differentiation of the velocity mapping for a serial kinematic chain", Mechanism and Machine Theory 31(2)):
with i a column of the joint of j or of one before it, an axis or origin c of a frame has

    d^2 c / dq_i dq_j = omega_i x dc/dq_j.

Every row is a product a . b of two vectors that are linear in axes and origins (`row_factors`), and so its
second derivative is a_i . b_j + a_j . b_i, plus the sum of omega_i x c_j . g over all c, g = d(a . b)/dc.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray, IntArray
from framework.kinematics.closures import row_factors
from framework.kinematics.frames import FrameStack, move_frames, turn_vectors
from framework.kinematics.mechanism import Mechanism
from framework.kinematics.pinocchio_memory import carriers
from framework.linalg.ordered_sums import cross, dot, product_rates
from framework.model.loop_rows import LoopRows

STEP: Any = 2.0**-120 * 1j  # of complex-step derivatives: its square is far below rounding


class TreeColumns(NamedTuple):
    """How the columns of pinocchio's velocity vector belong to the bodies of the tree."""

    owner: IntArray  # (nv,) the joint of each column, which is the body that it moves
    carried: Array  # (bodies, nv) 1 where the column moves the body
    before: BoolArray  # (nv, nv) True where column i moves the axis that column j turns about or slides along

    def screw_changes(self, screws: Array, steps: Array) -> Array:
        """Compute changes of screws (..., nv, 6) by small steps along each screw."""
        return bracket(self.before.T.astype(float) @ steps, screws)


@lru_cache(maxsize=64)
def tree_columns(mechanism: Mechanism) -> TreeColumns:
    """Return the table of a mechanism's tree."""
    model = mechanism.model
    owner = np.repeat(np.arange(1, model.njoints), [joint.nv for joint in model.joints[1:]])
    carried = carriers(model, np.arange(model.njoints))
    return TreeColumns(owner, carried, carried[owner].T > 0.0)


def bracket(a: Array, b: Array) -> Array:
    """Compute the bracket of screws (..., 6): the rate of a screw b that moves with twist a."""
    turning = a[..., 3:]
    linear = cross(turning, b[..., :3]) + cross(a[..., :3], b[..., 3:])
    return np.concatenate([linear, cross(turning, b[..., 3:])], axis=-1)


class FrameVariation(NamedTuple):
    """The frames at T instants, a complex step along k small changes of their motion, see `changes_of`."""

    twist: Array  # (T, k, F, 6)
    acceleration: Array  # (T, k, F, 6)
    rates: Array  # (3, T, k, F, 4, 3) axes and origins, one below the other, with two time derivatives


def vary_frames(
    mechanism: Mechanism, ahead: FrameStack, v: Array, a: Array | None, dv: Array
) -> FrameVariation:
    """Compute the motion of frames that are a step `ahead`, for changes dv (T, k, nv) of rates.

    v and the accelerations a are (T, nv). Without a, second derivatives are left out, as zeros.
    """
    columns, screws = tree_columns(mechanism), ahead.screws
    twists = screws * (v[:, None, :, None] + STEP * dv[..., None])
    twist = ahead.carried @ twists
    rate = move_frames(twist, ahead.placements)
    acceleration, second = np.zeros_like(twist), np.zeros_like(rate)
    if a is not None:
        turned = bracket(columns.carried[columns.owner] @ twists, twists)
        acceleration = ahead.carried @ (screws * a[:, None, :, None] + turned)
        second = move_frames(acceleration, ahead.placements) + turn_vectors(twist, rate)
    return FrameVariation(twist, acceleration, np.stack([ahead.placements, rate, second]))


def changes_of(values: Array) -> Array:
    """Return the changes of values along complex steps of frames."""
    return values.imag / STEP.imag


def step_frames(mechanism: Mechanism, frames: FrameStack, motions: Array) -> FrameStack:
    """Return frames and screws a complex step along small motions (T, ..., nv), see `changes_of`."""
    several = tuple(range(1, motions.ndim - 1))
    placements, screws = (np.expand_dims(part, several) for part in frames[:2])
    steps = screws * motions[..., None]
    return frames._replace(
        placements=placements + STEP * move_frames(frames.carried @ steps, placements),
        screws=screws + STEP * tree_columns(mechanism).screw_changes(screws, steps),
    )


def row_variation(rows: LoopRows, variation: FrameVariation, order: int) -> Array:
    """Compute the changes (T, k, m) of a derivative of loop equations, the first or the second."""
    a, b = row_factors(rows, variation.rates)
    return rows.weight * changes_of(product_rates(dot, a, b)[order])


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
