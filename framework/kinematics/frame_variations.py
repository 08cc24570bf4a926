"""How frames and loop equations of a moving robot change with its configuration, rates and accelerations.

With the screws S_i of the joints about the base's origin, V_p and A_p the twist and its rate of the body
before joint i, and eta a small motion, a frame is displaced by Phi = sum eta_i S_i over the joints that carry
it, and

    dV = Phi' + Phi x V + sum S_i dv_i,                 Phi'  = sum eta_i (V_p x S_i),
    dA = Phi" + Phi' x V + Phi x A + (what dv, da add),  Phi" = sum eta_i (V_p x (V_p x S_i) + A_p x S_i),

x the bracket of screws. Every loop equation is a product of two vectors of frames (`LoopRows`), so its value,
rates and their changes are those of a product. Source of the rules for screws: J. Carpentier and N. Mansard,
Analytical Derivatives of Rigid Body Dynamics Algorithms, Robotics: Science and Systems 2018.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray, IntArray
from framework.kinematics.closures import row_factors
from framework.kinematics.frames import FrameStack, move_frames, turn_vectors
from framework.kinematics.mechanism import Mechanism
from framework.kinematics.pinocchio_memory import carriers, scratch_of
from framework.linalg.ordered_sums import cross, dot
from framework.model.loop_rows import LoopRows


class TreeColumns(NamedTuple):
    """How the columns of pinocchio's velocity vector belong to the bodies of the tree."""

    owner: IntArray  # (nv,) the joint of each column, which is the body that it moves
    parent: IntArray  # (nv,) the body before it
    carried: Array  # (bodies, nv) 1 where the column moves the body
    before: BoolArray  # (nv, nv) True where column i moves what column j turns about or slides along


@lru_cache(maxsize=64)
def tree_columns(mechanism: Mechanism) -> TreeColumns:
    """Return the table of a mechanism's tree."""
    model = mechanism.model
    owner = np.repeat(np.arange(1, model.njoints), [joint.nv for joint in model.joints[1:]])
    carried = carriers(model, np.arange(model.njoints))
    return TreeColumns(owner, np.array(model.parents)[owner], carried, carried[owner].T > 0.0)


def bracket(a: Array, b: Array) -> Array:
    """Compute the bracket of screws (..., 6): the rate of b where it moves along with twist a."""
    turning = a[..., 3:]
    linear = cross(turning, b[..., :3]) + cross(a[..., :3], b[..., 3:])
    return np.concatenate([linear, cross(turning, b[..., 3:])], axis=-1)


class FrameRates(NamedTuple):
    """The axes of frames and their origins, one below the other, and two time derivatives."""

    value: Array  # (..., F, 4, 3)
    rate: Array
    second: Array


@dataclass(frozen=True, eq=False)
class TreeMotion:
    """Twists and accelerations of bodies and frames at T instants, about the base's origin."""

    columns: TreeColumns
    frames: FrameStack
    v: Array  # (T, nv)
    moved_screws: Array  # (T, nv, 18) S, V_p x S and V_p x (V_p x S) + A_p x S
    own_rates: Array  # (T, nv, 6) time derivatives of the screws as they move with their own body
    twist: Array  # (T, F, 6) V
    acceleration: Array  # (T, F, 6) A = dV/dt
    rates: FrameRates

    @staticmethod
    def of(mechanism: Mechanism, frames: FrameStack, v: Array, a: Array) -> TreeMotion:
        """Compute the motion for rates and accelerations v, a (T, nv) at the configurations of `frames`."""
        columns, S = tree_columns(mechanism), frames.screws
        V = columns.carried @ (S * v[..., None])  # (T, bodies, 6)
        own = bracket(V[:, columns.owner], S)
        A = columns.carried @ (S * a[..., None] + own * v[..., None])
        before, quicker = V[:, columns.parent], A[:, columns.parent]
        once = bracket(before, S)
        twice = bracket(before, once) + bracket(quicker, S)
        bodies = scratch_of(mechanism).bodies
        twist, acceleration = V[:, bodies], A[:, bodies]
        rate = move_frames(twist, frames.placements)
        second = move_frames(acceleration, frames.placements) + turn_vectors(twist, rate)
        moved = np.concatenate([S, once, twice], axis=2)
        rates = FrameRates(frames.placements, rate, second)
        return TreeMotion(columns, frames, v, moved, own, twist, acceleration, rates)

    def variation(self, dq: Array, dv: Array, da: Array) -> FrameVariation:
        """Compute what small motions dq (T, k, nv), changes of rates dv and of accelerations da make."""
        carried, S = self.frames.carried, self.frames.screws[:, None]
        displaced = (dq[:, :, None] * carried) @ self.moved_screws[:, None]  # (T, k, F, 18)
        phi, once, twice = displaced[..., :6], displaced[..., 6:12], displaced[..., 12:]
        V, A = self.twist[:, None], self.acceleration[:, None]
        quicker, sooner = S * dv[..., None], S * da[..., None] + self.own_rates[:, None] * dv[..., None]
        if dv.any():
            bodies = self.columns.carried @ quicker
            sooner = sooner + bracket(bodies[:, :, self.columns.owner], S) * self.v[:, None, :, None]
        dV = once + bracket(phi, V) + carried @ quicker
        dA = twice + bracket(once, V) + bracket(phi, A) + carried @ sooner
        value, rate = self.rates.value[:, None], self.rates.rate[:, None]
        moved = move_frames(phi, value)
        moved_rate = move_frames(dV, value) + turn_vectors(V, moved)
        moved_second = (
            move_frames(dA, value)
            + turn_vectors(A, moved)
            + turn_vectors(dV, rate)
            + turn_vectors(V, moved_rate)
        )
        return FrameVariation(phi, dV, dA, FrameRates(moved, moved_rate, moved_second))


class FrameVariation(NamedTuple):
    """What k small changes make of the frames at T instants; screws about the base's origin."""

    displacement: Array  # (T, k, F, 6) Phi
    twist: Array  # (T, k, F, 6) dV
    acceleration: Array  # (T, k, F, 6) dA
    rates: FrameRates  # (T, k, F, 4, 3)


def row_variation(rows: LoopRows, motion: TreeMotion, variation: FrameVariation) -> tuple[Array, Array]:
    """Compute the changes (T, k, m) of the first and the second time derivative of loop equations."""
    (a0, b0), (a1, b1), (a2, b2) = (row_factors(rows, part[:, None]) for part in motion.rates)
    (da0, db0), (da1, db1), (da2, db2) = (row_factors(rows, part) for part in variation.rates)
    once = dot(da1, b0) + dot(a1, db0) + dot(da0, b1) + dot(a0, db1)
    twice = dot(da2, b0) + dot(a2, db0) + dot(da0, b2) + dot(a0, db2) + 2.0 * (dot(da1, b1) + dot(a1, db1))
    return rows.weight * once, rows.weight * twice
