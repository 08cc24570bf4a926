"""How frames and loop equations of a moving robot change with its configuration, rates and accelerations.

With the screws S_i of the joints about the base's origin, V_p and A_p the twist and its rate of the body
before joint i, and eta a small motion, a frame is displaced by Phi = sum eta_i S_i over the joints that carry
it, and

    dV = Phi' + Phi x V + sum S_i dv_i,                 Phi'  = sum eta_i (V_p x S_i),
    dA = Phi" + Phi' x V + Phi x A + (terms of dv, da),  Phi" = sum eta_i (V_p x (V_p x S_i) + A_p x S_i),

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
from framework.linalg.ordered_sums import cross, dot, product_rates
from framework.model.loop_rows import LoopRows


class TreeColumns(NamedTuple):
    """How the columns of pinocchio's velocity vector belong to the bodies of the tree."""

    owner: IntArray  # (nv,) the joint of each column, which is the body that it moves
    parent: IntArray  # (nv,) the body before it
    carried: Array  # (bodies, nv) 1 where the column moves the body
    before: BoolArray  # (nv, nv) True where column i moves the axis that column j turns about or slides along


@lru_cache(maxsize=64)
def tree_columns(mechanism: Mechanism) -> TreeColumns:
    """Return the table of a mechanism's tree."""
    model = mechanism.model
    owner = np.repeat(np.arange(1, model.njoints), [joint.nv for joint in model.joints[1:]])
    carried = carriers(model, np.arange(model.njoints))
    return TreeColumns(owner, np.array(model.parents)[owner], carried, carried[owner].T > 0.0)


def bracket(a: Array, b: Array) -> Array:
    """Compute the bracket of screws (..., 6): the rate of a screw b that moves with twist a."""
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
        by_parent = bracket(V[:, columns.parent], S)
        twice = bracket(V[:, columns.parent], by_parent) + bracket(A[:, columns.parent], S)
        screws = np.concatenate([S, by_parent, twice], axis=2)
        bodies = scratch_of(mechanism).bodies
        twist, acceleration = V[:, bodies], A[:, bodies]
        rate = move_frames(twist, frames.placements)
        second = move_frames(acceleration, frames.placements) + turn_vectors(twist, rate)
        rates = FrameRates(frames.placements, rate, second)
        return TreeMotion(columns, frames, v, screws, own, twist, acceleration, rates)

    def variation(self, dq: Array, dv: Array, da: Array) -> FrameVariation:
        """Compute the changes of the frames for small motions dq (T, k, nv) and changes dv, da of rates."""
        carried, S = self.frames.carried, self.frames.screws[:, None]
        displaced = (dq[:, :, None] * carried) @ self.moved_screws[:, None]  # (T, k, F, 18)
        phi, dphi, ddphi = displaced[..., :6], displaced[..., 6:12], displaced[..., 12:]
        V, A = self.twist[:, None], self.acceleration[:, None]
        rate_twists = S * dv[..., None]
        acceleration_twists = S * da[..., None] + self.own_rates[:, None] * dv[..., None]
        if dv.any():
            bodies = self.columns.carried @ rate_twists
            turned_screws = bracket(bodies[:, :, self.columns.owner], S)
            acceleration_twists = acceleration_twists + turned_screws * self.v[:, None, :, None]
        dV = dphi + bracket(phi, V) + carried @ rate_twists
        dA = ddphi + bracket(dphi, V) + bracket(phi, A) + carried @ acceleration_twists
        return FrameVariation(phi, dV, dA, self._changed_rates(phi, dV, dA))

    def _changed_rates(self, phi: Array, dV: Array, dA: Array) -> FrameRates:
        """Compute the changes of axes and origins for a displacement and changes of twist, (T, k, F, 6)."""
        V, A = self.twist[:, None], self.acceleration[:, None]
        value, rate = self.rates.value[:, None], self.rates.rate[:, None]
        change = move_frames(phi, value)
        rate_change = move_frames(dV, value) + turn_vectors(V, change)
        second_change = move_frames(dA, value) + turn_vectors(A, change)
        second_change = second_change + turn_vectors(dV, rate) + turn_vectors(V, rate_change)
        return FrameRates(change, rate_change, second_change)


class FrameVariation(NamedTuple):
    """Changes of the frames at T instants by k small steps; screws about the base's origin."""

    displacement: Array  # (T, k, F, 6) Phi
    twist: Array  # (T, k, F, 6) dV
    acceleration: Array  # (T, k, F, 6) dA
    rates: FrameRates  # (T, k, F, 4, 3)


def row_variation(rows: LoopRows, motion: TreeMotion, variation: FrameVariation) -> tuple[Array, Array]:
    """Compute the changes (T, k, m) of the first and the second time derivative of loop equations."""
    a, b = row_factors(rows, np.stack(motion.rates)[:, :, None])
    da, db = row_factors(rows, np.stack(variation.rates))
    _, rate, second = rows.weight * (product_rates(dot, da, b) + product_rates(dot, a, db))
    return rate, second
