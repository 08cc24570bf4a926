"""How frames and loop equations of a moving robot change with its configuration, rates and accelerations.

With the screws S_i of the joints about the base's origin, the twist of a body and its rate are

    V = sum S_i v_i,        A = sum S_i a_i + (V_i x S_i) v_i

over the joints that carry it, V_i the twist of the body behind joint i and x the bracket of screws. A small
motion eta displaces that body by Phi_i = sum eta_j S_j over the joints that carry it, and S_i by Phi_i x S_i.
All this, loop equations and velocities of the platform with it, is analytic in the motion: a complex step
differentiates them to rounding. Source of the rules for screws: J. Carpentier and N. Mansard, Analytical
Derivatives of Rigid Body Dynamics Algorithms, Robotics: Science and Systems 2018.

Here too is the derivative of the loop forces J(q)' lambda by q at fixed multipliers (`loop_curvature`).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from framework.kinematics.closures import loop_wrenches, row_joint_signs
from framework.kinematics.frames import FrameMotions, FrameStack, move_frames, move_wrench
from framework.kinematics.mechanism import Mechanism
from framework.kinematics.pinocchio_memory import carrying_joints
from framework.model.loop_rows import LoopRows
from framework.numerics.arrays import Array, BoolArray, IntArray
from framework.numerics.ordered_sums import cross, dot

STEP: Any = 2.0**-120 * 1j  # of complex-step derivatives: its square is far below rounding


class TreeColumns(NamedTuple):
    """How the columns of pinocchio's velocity vector belong to the bodies of the tree."""

    owner: IntArray  # (nv,) the joint of each column, which is the body that it moves
    carried: Array  # (bodies, nv) 1 where the column moves the body
    precedes: BoolArray  # (nv, nv) True where column i moves the axis that column j turns or slides along

    def screw_changes(self, screws: Array, steps: Array) -> Array:
        """Compute changes of screws (..., nv, 6) by small twists `steps` (..., nv, 6) of the joints.

        S_j changes by [Phi_j, S_j], Phi_j the sum of the twists of the joints that precede j.
        """
        Phi = self.precedes.T.astype(float) @ steps
        return bracket(Phi, screws)


@lru_cache(maxsize=64)
def tree_columns(mechanism: Mechanism) -> TreeColumns:
    """Return the table of which velocity columns move which bodies and axes."""
    model = mechanism.model
    owner = np.repeat(np.arange(1, model.njoints), [joint.nv for joint in model.joints[1:]])
    carried = carrying_joints(model, np.arange(model.njoints))
    return TreeColumns(owner, carried, carried[owner].T > 0.0)


def bracket(a: Array, b: Array) -> Array:
    """Compute the Lie bracket [a, b] (..., 6) of screws.

    It is the rate of a screw b that moves with twist a. With a = (v, w) and b = (p, s) it is (w x p + v x s,
    w x s).
    """
    w = a[..., 3:]
    linear = cross(w, b[..., :3]) + cross(a[..., :3], b[..., 3:])
    return np.concatenate([linear, cross(w, b[..., 3:])], axis=-1)


def step_frames(mechanism: Mechanism, frames: FrameStack, motions: Array) -> FrameStack:
    """Return frames and screws after complex steps along joint motions (T, ..., nv).

    Imaginary parts of all that is computed of them are derivatives, see `complex_step_derivative`.
    """
    step_axes = tuple(range(1, motions.ndim - 1))  # several steps for each of the T configurations
    placements = np.expand_dims(frames.placements, step_axes)
    screws = np.expand_dims(frames.screws, step_axes)
    steps = screws * motions[..., None]  # (T, ..., nv, 6) the twist of each joint's own motion
    return frames._replace(
        placements=placements + STEP * move_frames(frames.carried @ steps, placements),
        screws=screws + STEP * tree_columns(mechanism).screw_changes(screws, steps),
    )


def complex_step_derivative(values: Array) -> Array:
    """Return the derivatives of complex values along the steps of `step_frames`."""
    return values.imag / STEP.imag


def vary_motions(mechanism: Mechanism, ahead: FrameStack, v: Array, a: Array, dv: Array) -> FrameMotions:
    """Compute the motions (T, k, ...) of frames `ahead` of k complex steps.

    They follow from V and A of the header. Before the steps the joint rates are v (T, nv) and the
    accelerations a (T, nv); rates change by dv (T, k, nv) along the steps.
    """
    columns = tree_columns(mechanism)
    joint_twists = ahead.screws * (v[:, None, :, None] + STEP * dv[..., None])  # S_i v_i, (T, k, nv, 6)
    body_twists = columns.carried[columns.owner] @ joint_twists  # V_i of the body behind each joint
    twist_rates = ahead.screws * a[:, None, :, None] + bracket(body_twists, joint_twists)
    return FrameMotions.of(ahead.placements, ahead.carried @ joint_twists, ahead.carried @ twist_rates)


def loop_curvature(mechanism: Mechanism, rows: LoopRows, frames: FrameStack, multipliers: Array) -> Array:
    """Compute the derivative d(J' lambda)/dq (T, nv, nv) of loop forces at fixed multipliers (T, m).

    Row i, column j is the change of the force on joint i when joint j moves: each joint takes a complex step
    by itself, and the forces are those of the stepped frames.
    """
    count, nv = len(frames.q), mechanism.model.nv
    repeated = frames.select(np.repeat(np.arange(count), nv))  # nv copies of each instant, a joint each
    ahead = step_frames(mechanism, repeated, np.tile(np.eye(nv), (count, 1)))
    wrenches = move_wrench(loop_wrenches(rows, ahead).wrench, ahead.position[:, rows.second])
    loads = np.repeat(multipliers, nv, axis=0)[..., None] * wrenches  # (T nv, m, 6) about the base's origin
    on_joints = row_joint_signs(rows, frames).T @ loads  # (T nv, nv, 6) the wrench that each joint carries
    changes = complex_step_derivative(dot(on_joints, ahead.screws))
    return changes.reshape(count, nv, nv).swapaxes(1, 2)
