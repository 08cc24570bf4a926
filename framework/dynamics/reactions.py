"""Wrenches in loops and joints.

With the forces r of the open tree (RNEA less external wrenches), the selection S of the actuated joints, and
the Jacobian J of all loop equations, redundant ones included,

    r = S' tau_joint + J' lambda.

lambda is unique only if J' has no null space. Wrenches of loops and joints that change along the null space
are indeterminate in a rigid robot. They are NaN, since any number would be an arbitrary choice.

The wrench in a joint is the inertial wrench of all bodies that the joint carries, less the external wrenches
and the loop wrenches on these bodies. All are summed about the base's origin.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.errors import InvalidInput, finite_numbers
from framework.kinematics.external_wrenches import (
    applied_wrench,
    check_frame,
    expect_wrenches,
)
from framework.kinematics.frames import move_wrench, rotation_matrices, scratch_of, tree_columns
from framework.kinematics.linearised_loops import LinearisedLoops
from framework.kinematics.motion_rates import Motion
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike
from framework.numerics.ordered_sums import matmul, matvec
from framework.tolerances import RANK_ROUNDING


class LoopLoads(NamedTuple):
    """The unit wrenches of all loop equations (rows), and the multipliers that balance the robot."""

    wrench: Array  # (T, rows, 6) of a unit multiplier on the second body, at the second frame's origin
    position: Array  # (T, rows, 3) of that origin
    displacement: Array  # (T, rows, 3) from the origin of the first frame to that of the second
    multipliers: Array  # (T, rows) of least norm
    free: Array  # (T, rows, rows) each row a vector in the null space of J', or zeros


Wrenches = Mapping[str, Array]  # by URDF link or joint: (T, 6) ON the body, at the frame's origin, base axes


def stack_wrenches(robot: ParallelRobot, wrenches: Mapping[str, ArrayLike] | None, count: int) -> Wrenches:
    """Stack wrenches, each (6,) or (T, 6), for T = `count` configurations.

    Raises:
        InvalidInput: an unknown frame, or not 6 finite numbers.
    """
    expect_wrenches(wrenches)
    stacked = {}
    for frame, wrench in (wrenches or {}).items():
        check_frame(robot, frame)
        stacked[frame] = stacked_rows(f"wrenches: {frame}", wrench, 6, count)
    return stacked


def stacked_rows(name: str, entries: ArrayLike, width: int, count: int) -> Array:
    """Return rows (count, width); repeat a single row (width,).

    Raises:
        InvalidInput: `entries` has another shape, or numbers that are not finite.
    """
    values = finite_numbers(name, entries, width, stacks=True)
    if values.ndim == 2 and len(values) != count:
        raise InvalidInput(f"{name}: got {len(values)} rows for {count} configurations")
    return values if values.ndim == 2 else np.repeat(values[None], count, axis=0)


def apply_wrenches(robot: ParallelRobot, motion: Motion, wrenches: Wrenches) -> Motion:
    """Return the motion with external wrenches, each (6,) or (T, 6)."""
    frames = motion.linearised.frames
    applied = (applied_wrench(robot, frames, frame, wrench) for frame, wrench in wrenches.items())
    return motion.with_wrenches(tuple(applied))


def loop_loads(robot: ParallelRobot, linearised: LinearisedLoops, r: Array, joint_torque: Array) -> LoopLoads:
    """Solve r (T, nv) = S' tau_joint + J' lambda for the multipliers of all rows of J.

    The row of J for a loop equation contains the power of its unit wrench along the screw of each joint. The
    power is positive if the joint carries the second body of the loop alone, negative if it carries the first
    alone, and zero otherwise.
    """
    rows, columns, frames = robot.rows, robot.moving, linearised.frames
    wrench, position = linearised.loops.wrench, frames.position[:, rows.second]
    signs = frames.carried[rows.second] - frames.carried[rows.first]
    screws = frames.screws.swapaxes(1, 2)[:, :, columns]
    jacobian = matmul(move_wrench(wrench, position), screws) * signs[:, columns]
    jacobian += rows.coupling_jacobian(robot.nv)[:, columns]
    loop_forces = r[:, columns].copy()
    loop_forces[:, : robot.n_a] -= joint_torque
    scale, lengths = robot.column_scale[columns], robot.row_lengths
    scaled_jacobian = jacobian * scale / lengths[:, None]  # in radians and robot lengths
    multipliers, free = _least_multipliers(scaled_jacobian, loop_forces * scale)
    displacement = position - frames.position[:, rows.first]
    return LoopLoads(wrench, position, displacement, multipliers / lengths, free / lengths)


def _least_multipliers(J: Array, forces: Array) -> tuple[Array, Array]:
    """Solve J' lambda = forces (T, f) for lambda (T, rows) of least norm; span the null space.

    With the singular value decomposition J = U S V', lambda = U S^-1 V' forces over the nonzero singular
    values. The other columns of U span the null space of J'.

    Returns:
        lambda, and an array (T, rows, rows) whose nonzero rows span the null space.
    """
    U, singular_values, V_rows = np.linalg.svd(J)
    count = singular_values.shape[1]
    nonzero = singular_values > RANK_ROUNDING * singular_values.max(axis=1, initial=0.0)[:, None]
    components = matvec(V_rows[:, :count], forces)
    components = np.where(nonzero, components / np.where(nonzero, singular_values, 1.0), 0.0)
    null_space = U.swapaxes(1, 2).copy()
    null_space[:, :count] *= ~nonzero[:, :, None]  # keeps the columns of U with zero singular values
    return matvec(U[:, :, :count], components), null_space


def closure_wrenches(robot: ParallelRobot, loops: LoopLoads) -> dict[str, Array]:
    """Compute the wrench (T, 6) of each closure, by name; NaN if indeterminate.

    A closure of frames [a, b] has the wrench BY b's body ON a's body, at a's origin: minus the sum of the
    closure's unit wrenches times their multipliers.
    """
    unit_wrenches = move_wrench(loops.wrench, loops.displacement)  # at the origins of the first frames
    wrenches, first_row = {}, 0
    for closure in robot.description.closures:
        rows = slice(first_row, first_row + len(closure.axes))
        first_row = rows.stop
        wrench = -matvec(unit_wrenches[:, rows].swapaxes(1, 2), loops.multipliers[:, rows])
        free = loops.free[:, :, rows] @ unit_wrenches[:, rows]
        wrenches[closure.name] = _mark_indeterminate(robot, wrench, free)
    return wrenches


def coupling_torques(robot: ParallelRobot, loops: LoopLoads) -> dict[str, Array]:
    """Compute the torque (T,) [N m, N] of each coupling on the first joint, by name; NaN if indeterminate.

    The torque on the second joint is minus the ratio times this torque.
    """
    rows = np.flatnonzero(robot.rows.coupled)
    # largest component of a null-space vector at each coupling (T, couplings)
    freedom = np.abs(loops.free[:, :, rows] * robot.row_lengths[rows]).max(axis=1, initial=0.0)
    torque = np.where(freedom > RANK_ROUNDING, np.nan, loops.multipliers[:, rows])
    names = [coupling.name for coupling in robot.description.couplings]
    return dict(zip(names, torque.T, strict=True))


def joint_reactions(robot: ParallelRobot, motion: Motion, loops: LoopLoads) -> dict[str, Array]:
    """Compute the wrench (T, 6) in each joint, by name; NaN if indeterminate.

    It is exerted BY the parent body of the joint ON the child body, at the joint's origin: the wrench in the
    open tree, less the loop wrenches and external wrenches on all bodies that the joint carries.
    """
    model = robot.model
    reactions, position = _tree_reactions(robot, motion)  # at the joints' origins
    first_columns = [model.joints[j].idx_v for j in range(1, model.njoints)]
    carried_by_joint = tree_columns(robot).carried[:, first_columns]
    carried_by_joint = np.insert(carried_by_joint, 0, 1.0, axis=1)  # (bodies, joints): the base carries all
    bodies, rows = scratch_of(robot).bodies, robot.rows
    signs = carried_by_joint[bodies[rows.second]] - carried_by_joint[bodies[rows.first]]  # (rows, joints)
    # sum the wrenches of each joint about the base's origin, then move the sums to the joints' origins
    about_base = move_wrench(loops.wrench, loops.position)
    loads = matmul(signs.T, loops.multipliers[:, :, None] * about_base)
    for load in motion.wrenches:
        loads += carried_by_joint[load.joint][:, None] * load.wrench[:, None]
    reactions -= move_wrench(loads, -position)
    # the wrench in joint j of each null-space vector k: sum over rows m
    free = np.einsum("mj,tkm,tmi->tjki", signs, loops.free, about_base)
    free = move_wrench(free, -position[:, :, None])
    return {
        str(model.names[j]): _mark_indeterminate(robot, reactions[:, j], free[:, j])
        for j in range(1, model.njoints)
    }


def _tree_reactions(robot: ParallelRobot, motion: Motion) -> tuple[Array, Array]:
    """Compute wrenches (T, joints, 6) in the joints of the open tree, and the joints' origins.

    Wrenches [N, N m] are about the joint's origin, on the axes of the base; origins (T, joints, 3) [m].
    """
    scratch, count = scratch_of(robot), len(motion.q)
    poses = np.empty((count, *scratch.joints.shape))  # of the joints: rotation (9 entries), origin
    forces = np.empty((count, *scratch.forces.shape))  # in the joints, on their own axes
    for k, (q, v, a) in enumerate(zip(motion.q, motion.v, motion.a, strict=True)):
        pin.forwardKinematics(robot.model, scratch.data, q)
        pin.rnea(robot.model, scratch.data, q, v, a)
        poses[k], forces[k] = scratch.joints, scratch.forces
    rotations = rotation_matrices(poses)[:, :, None]
    on_base_axes = matvec(rotations, forces.reshape(*forces.shape[:2], 2, 3))  # forces and moments apart
    return on_base_axes.reshape(forces.shape), poses[..., 9:]


def _mark_indeterminate(robot: ParallelRobot, wrench: Array, free: Array) -> Array:
    """Replace indeterminate components of wrenches (T, 6) by NaN.

    `free` (T, k, 6) are the wrenches of unit vectors in the null space of J'. A component to which one of
    these wrenches contributes is indeterminate.
    """
    moment_arms = np.repeat([1.0, robot.length], 3)  # convert moments to forces
    freedom = np.abs(free / moment_arms).max(axis=1, initial=0.0) * robot.length
    return np.where(freedom > RANK_ROUNDING, np.nan, wrench)
