"""Wrenches in loops and joints.

With r the forces of the open tree (RNEA, less the wrenches of the world), S the motors' columns, J the
Jacobian of all loop equations, redundant ones too,

    r = S tau_joint + J' lambda.

lambda is unique only where J' has no null space: what the null space can reach, in a loop or in a joint, is
indeterminate in a rigid robot, and is NaN here instead of one choice of many.

A joint carries what it gives to all that is behind it, less what the world and the loops give there: a sum of
wrenches about the base's origin, each counted for the joints that carry its body.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.arrays import Array, ArrayLike
from framework.errors import InvalidInput, finite_numbers
from framework.kinematics.external_wrenches import (
    applied_wrench,
    check_frame,
    expect_wrenches,
    move_wrench,
)
from framework.kinematics.frames import rotations
from framework.kinematics.linearised_loops import LinearisedLoops
from framework.kinematics.motion_rates import Motion
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.pinocchio_memory import scratch_of
from framework.linalg.ordered_sums import matmul, matvec
from framework.tolerances import RANK_ROUNDING


class LoopLoads(NamedTuple):
    """All loop equations as wrenches, and how much of each acts."""

    wrench: Array  # (T, rows, 6) on the second body, at the origin of the second frame
    position: Array  # (T, rows, 3) of that origin
    displacement: Array  # (T, rows, 3) to it from the origin of the first frame
    multipliers: Array  # (T, rows) the smallest that balance the robot
    free: Array  # (T, rows, rows) what may be added to them, and no joint feels it; zero rows are none


Wrenches = Mapping[str, Array]  # by URDF link or joint (T, 6): ON its body, at its frame's origin, base axes


def given_wrenches(robot: ParallelRobot, wrenches: Mapping[str, ArrayLike] | None, count: int) -> Wrenches:
    """Check wrenches, (6,) or (T, 6) each, and stack them for T = `count` configurations.

    Raises:
        InvalidInput: a frame that is not there, or not 6 finite numbers.
    """
    expect_wrenches(wrenches)
    for frame in wrenches or {}:
        check_frame(robot, frame)
    return {
        frame: stacked_rows(f"wrenches: {frame}", wrench, 6, count)
        for frame, wrench in (wrenches or {}).items()
    }


def stacked_rows(name: str, entries: ArrayLike, width: int, count: int) -> Array:
    """Return numbers, (width,) for all or (count, width), as an array (count, width).

    Raises:
        InvalidInput: they are not finite numbers, or not as many.
    """
    values = finite_numbers(name, entries, width, stacks=True)
    if values.ndim == 2 and len(values) != count:
        raise InvalidInput(f"{name}: got {len(values)} rows for {count} configurations")
    return values if values.ndim == 2 else np.repeat(values[None], count, axis=0)


def under_wrenches(robot: ParallelRobot, motion: Motion, wrenches: Wrenches) -> Motion:
    """Return the motion under wrenches of the world, (6,) or (T, 6) each."""
    frames = motion.linearised.frames
    return motion.with_wrenches(
        tuple(applied_wrench(robot, frames, frame, wrench) for frame, wrench in wrenches.items())
    )


def loop_loads(robot: ParallelRobot, linearised: LinearisedLoops, r: Array, joint_torque: Array) -> LoopLoads:
    """Solve r = S tau + J' lambda for all rows of J and the joints that follow; r (T, nv), tau (T, n_a)."""
    rows, columns, frames = robot.rows, robot.moving, linearised.frames
    wrench, position = linearised.loops.wrench, frames.position[:, rows.second]
    signs = frames.carried[rows.second] - frames.carried[rows.first]
    screws = frames.screws.swapaxes(1, 2)[:, :, columns]
    jacobian = matmul(move_wrench(wrench, position), screws) * signs[:, columns]
    jacobian = jacobian + rows.coupling_jacobian(robot.model.nv)[:, columns]
    scale = robot.column_scale[columns]  # columns in radians and robot lengths, and so are the rows
    lengths = robot.row_lengths
    left = r[:, columns].copy()
    left[:, : robot.n_a] -= joint_torque
    # J' lambda = left by the singular value decomposition of J
    along_rows, sizes, along_columns = np.linalg.svd(jacobian * scale / lengths[:, None])
    count = sizes.shape[1]
    sound = sizes > RANK_ROUNDING * sizes.max(axis=1, initial=0.0)[:, None]
    parts = matvec(along_columns[:, :count], left * scale)
    parts = np.where(sound, parts / np.where(sound, sizes, 1.0), 0.0)
    free = along_rows.swapaxes(1, 2).copy()
    free[:, :count] *= ~sound[:, :, None]
    multipliers = matvec(along_rows[:, :, :count], parts)
    displacement = position - frames.position[:, rows.first]
    return LoopLoads(wrench, position, displacement, multipliers / lengths, free / lengths)


def closure_wrenches(robot: ParallelRobot, loops: LoopLoads) -> dict[str, Array]:
    """Compute the wrench (T, 6) of each closure, by its name; NaN: indeterminate.

    Of a closure with frames [a, b] it is exerted BY b's body ON a's body, at a's origin.
    """
    at_first, wrenches, first = move_wrench(loops.wrench, loops.displacement), {}, 0
    for closure in robot.description.closures:
        rows = slice(first, first + len(closure.axes))
        first = rows.stop
        wrench = -matvec(at_first[:, rows].swapaxes(1, 2), loops.multipliers[:, rows])
        wrenches[closure.name] = _determinate(robot, wrench, loops.free[:, :, rows] @ at_first[:, rows])
    return wrenches


def coupling_torques(robot: ParallelRobot, loops: LoopLoads) -> dict[str, Array]:
    """Compute what each coupling gives its first joint (T,) [N m, N], by its name; NaN: indeterminate.

    Its second joint gets that times minus the ratio.
    """
    rows = np.flatnonzero(robot.rows.coupled)
    reached = np.abs(loops.free[:, :, rows] * robot.row_lengths[rows]).max(axis=1, initial=0.0)
    torque = np.where(reached > RANK_ROUNDING, np.nan, loops.multipliers[:, rows])
    names = [coupling.name for coupling in robot.description.couplings]
    return dict(zip(names, torque.T, strict=True))


def joint_reactions(robot: ParallelRobot, motion: Motion, loops: LoopLoads) -> dict[str, Array]:
    """Compute the wrench (T, 6) in each joint, by its name; NaN: indeterminate.

    It is exerted BY the body before the joint ON the one behind it, at the joint's origin.
    """
    model, scratch, count = robot.model, scratch_of(robot), len(motion.q)
    poses, own = np.empty((count, *scratch.joints.shape)), np.empty((count, *scratch.forces.shape))
    for k, (q, v, a) in enumerate(zip(motion.q, motion.v, motion.a, strict=True)):
        pin.forwardKinematics(model, scratch.data, q)
        pin.rnea(model, scratch.data, q, v, a)
        scratch.update()
        poses[k], own[k] = scratch.joints, scratch.forces
    position = poses[..., 9:]
    turned = matvec(rotations(poses)[:, :, None], own.reshape(*own.shape[:2], 2, 3))
    reactions = turned.reshape(own.shape)
    carrying = _carrying(model)
    ends = np.array([model.frames[frame].parentJoint for frame in robot.frames], dtype=np.intp)
    of_loops = carrying[ends[robot.rows.second]] - carrying[ends[robot.rows.first]]  # (rows, joints)
    about_base = move_wrench(loops.wrench, loops.position)
    # wrenches about the base's origin, summed for each joint and moved to its own
    carried = matmul(of_loops.T, loops.multipliers[:, :, None] * about_base)
    for load in motion.wrenches:
        carried += carrying[load.joint][:, None] * load.wrench[:, None]
    reactions -= move_wrench(carried, -position)
    moved = np.einsum("mj,tkm,tmi->tjki", of_loops, loops.free, about_base)
    moved = move_wrench(moved, -position[:, :, None])
    names = {j: str(model.names[j]) for j in range(1, model.njoints)}
    return {name: _determinate(robot, reactions[:, j], moved[:, j]) for j, name in names.items()}


def _carrying(model: pin.Model) -> Array:
    """Return 1 where a joint (the second index) carries the body of another or its own, (joints, joints)."""
    carrying = np.zeros((model.njoints, model.njoints))
    for joint in range(model.njoints):
        carrying[joint, list(model.supports[joint])] = 1.0
    return carrying


def _determinate(robot: ParallelRobot, wrench: Array, moved: Array) -> Array:
    """Replace by NaN what is indeterminate of wrenches (T, 6).

    `moved` (T, k, 6) is what a unit of each direction that may be added to lambda adds to them.
    """
    lever = np.repeat([1.0, robot.length], 3)
    reached = np.abs(moved / lever).max(axis=1, initial=0.0) * robot.length
    return np.where(reached > RANK_ROUNDING, np.nan, wrench)
