"""Derivatives of screws, frames and loop forces with respect to the configuration of a robot.

Let S_i be the screws of the joints about the base's origin. A small motion eta displaces the body of joint i
by Phi_i = sum eta_j S_j, over the joints j that move this body, and changes S_i by the bracket [Phi_i, S_i]
of screws. Source of these rules: J. Carpentier and N. Mansard, Analytical Derivatives of Rigid Body Dynamics
Algorithms, Robotics: Science and Systems 2018.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from framework.kinematics.closures import base_wrenches, wrench_changes
from framework.kinematics.frames import FrameStack, frame_velocities
from framework.kinematics.mechanism import Mechanism
from framework.kinematics.pinocchio_memory import carrying_joints
from framework.model.loop_rows import LoopRows
from framework.numerics.arrays import Array, BoolArray, IntArray
from framework.numerics.ordered_sums import cross, dot


class TreeColumns(NamedTuple):
    """Relation of the columns of pinocchio's velocity vector to the bodies of the tree."""

    owner: IntArray  # (nv,) joint of each column; also the index of this joint's body
    carried: Array  # (bodies, nv) 1 where the column moves the body, else 0
    precedes: BoolArray  # (nv, nv) whether column i moves the body of column j, and so its screw


@lru_cache(maxsize=64)
def tree_columns(mechanism: Mechanism) -> TreeColumns:
    """Return which bodies and screws each column moves."""
    model = mechanism.model
    owner = np.repeat(np.arange(1, model.njoints), [joint.nv for joint in model.joints[1:]])
    carried = carrying_joints(model, np.arange(model.njoints))
    return TreeColumns(owner, carried, carried[owner].T > 0.0)


def bracket(a: Array, b: Array) -> Array:
    """Compute the bracket [a, b] (..., 6): the rate of a screw b fixed to a body with twist a.

    With a = (v, w) and b = (c, u), all (..., 3), it is (w x c + v x u, w x u).
    """
    parts = b.reshape(*b.shape[:-1], 2, 3)  # c and u
    rates = cross(a[..., None, 3:], parts)  # w x c and w x u
    rates[..., 0, :] += cross(a[..., :3], parts[..., 1, :])  # v x u
    return rates.reshape(*rates.shape[:-2], 6)


def loop_curvature(mechanism: Mechanism, rows: LoopRows, frames: FrameStack, multipliers: Array) -> Array:
    """Compute the derivative d(J' lambda)/dq (T, nv, nv) of loop forces at fixed multipliers (T, m).

    Row i, column j is the change of the force on joint i by a unit motion of joint j.
    """
    units = np.eye(mechanism.nv)[None]
    wrenches = base_wrenches(rows, frames)
    return loop_force_changes(mechanism, rows, frames, wrenches, multipliers, units).swapaxes(1, 2)


def loop_force_changes(
    mechanism: Mechanism,
    rows: LoopRows,
    frames: FrameStack,
    wrenches: Array,
    multipliers: Array,
    motions: Array,
) -> Array:
    """Compute changes (T, k, nv) of the loop forces J' lambda by motions (T, k, nv).

    The multipliers lambda (T, m) are constant. The force on joint i is S_i . W_i, with W_i the sum of the
    loops' `wrenches` (T, m, 6) on the bodies that joint i carries. S_i changes with the joints that precede
    i, and W_i with the frames.
    """
    screws, placements = frames.screws, frames.placements[:, None]
    carried = (multipliers[..., None] * rows.joint_signs(frames.carried)).swapaxes(1, 2)  # (T, nv, m)
    steps = screws[:, None] * motions[..., None]  # (T, k, nv, 6) twists by the motion of each joint alone
    frame_changes = frame_velocities(frames.carried @ steps, placements)  # (T, k, F, 4, 3)
    changes = wrench_changes(rows, placements, frame_changes)  # (T, k, m, 6)
    by_wrenches = dot(carried[:, None] @ changes, screws[:, None])
    displacements = tree_columns(mechanism).precedes.T.astype(float) @ steps  # Phi (T, k, nv, 6)
    by_screws = dot(displacements, bracket_wrenches(screws, carried @ wrenches)[:, None])
    return by_wrenches + by_screws


def bracket_wrenches(screws: Array, wrenches: Array) -> Array:
    """Compute the wrenches (T, nv, 6) whose power on a twist V is [V, S] . W.

    For screws S = (v, w) and wrenches W = (f, m), (T, nv, 6), they are (w x f, v x f + w x m).
    """
    linear, angular = screws[..., :3], screws[..., 3:]
    force, moment = wrenches[..., :3], wrenches[..., 3:]
    return np.concatenate([cross(angular, force), cross(linear, force) + cross(angular, moment)], axis=-1)
