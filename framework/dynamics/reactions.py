"""What loops and joints carry.

With r the forces of the open tree (RNEA, less the wrenches of the world), S the motors' columns, J the
Jacobian of all loop equations, redundant ones too,

    r = S tau_joint + J' lambda.

lambda is unique only where J' has no null space: what the null space can reach, in a loop or in a joint, is
indeterminate in a rigid robot, and is NaN here instead of one choice of many.

A joint carries what it gives to all that is behind it, less what the world and the loops give there: a sum of
wrenches about the base's origin, each counted for the joints that carry its body.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.arrays import Array, ArrayLike
from framework.dynamics.forces import tree_forces
from framework.errors import InvalidInput, choose_from, finite_numbers, short
from framework.kinematics.frames import carriers, cross, rotations, scratch_of
from framework.kinematics.inverse_kinematics import Motion, System
from framework.kinematics.mechanism import frame_of
from framework.kinematics.parallel_robot import ParallelRobot
from framework.linalg.ordered_sums import matmul, matvec

REACHED = 1e-9  # [N, lengths] by which a unit of what may be added to lambda moves what is not rounding


class Load(NamedTuple):
    """A wrench of the world on the body that a joint carries."""

    joint: int
    wrench: Array  # (T, 6) about the base's origin
    generalised: Array  # (T, nv)


class LoopLoads(NamedTuple):
    """All loop equations as wrenches, and how much of each acts."""

    wrench: Array  # (T, rows, 6) on the second body, at the origin of the second frame
    position: Array  # (T, rows, 3) of that origin
    displacement: Array  # (T, rows, 3) to it from the origin of the first frame
    multipliers: Array  # (T, rows) the smallest that balance the robot
    free: Array  # (T, rows, rows) what may be added to them, and no joint feels it; zero rows are none


Wrenches = Mapping[str, Array]  # by URDF link or joint (T, 6): ON its body, at its frame's origin, base axes


def given_wrenches(robot: ParallelRobot, given: Mapping[str, ArrayLike] | None, count: int) -> Wrenches:
    """The wrenches that a caller gives, (6,) or (T, 6) each, at T = `count` configurations.

    Raises:
        InvalidInput: a frame that is not there, or not 6 finite numbers.
    """
    if not isinstance(given, Mapping | None):
        raise InvalidInput(f"wrenches: needs a wrench by frame, {{name: (6,)}}, got {short(given)}")
    model = robot.model
    for frame in given or {}:
        if not model.existFrame(str(frame)) or frame == model.frames[0].name:  # the universe carries nothing
            names = [one.name for one in model.frames[1:]]
            raise InvalidInput(f"wrenches: {choose_from('frame', frame, names)}")
    return {
        frame: stacked_rows(f"wrenches: {frame}", wrench, 6, count) for frame, wrench in (given or {}).items()
    }


def stacked_rows(name: str, given: ArrayLike, width: int, count: int) -> Array:
    """The given numbers, (width,) for all or (count, width), as an array (count, width).

    Raises:
        InvalidInput: they are not finite numbers, or not as many.
    """
    values = finite_numbers(name, given, width, stacks=True)
    if values.ndim == 2 and len(values) != count:
        raise InvalidInput(f"{name}: got {len(values)} rows for {count} configurations")
    return values if values.ndim == 2 else np.repeat(values[None], count, axis=0)


def loads_on(robot: ParallelRobot, motion: Motion, wrenches: Wrenches) -> tuple[Load, ...]:
    """Wrenches of the world, (6,) or (T, 6) each, along a motion."""
    return tuple(_load_on(robot, motion, frame, wrench) for frame, wrench in wrenches.items())


def loaded_tree_forces(robot: ParallelRobot, motion: Motion, loads: Sequence[Load]) -> Array:
    """Forces (T, nv) of the open tree, less those of the world."""
    r = tree_forces(robot, motion)
    for load in loads:
        r = r - load.generalised
    return r


def _load_on(robot: ParallelRobot, motion: Motion, frame: str, wrench: Array) -> Load:
    model, data = robot.model, scratch_of(robot).data
    index, at = frame_of(model, frame), np.empty((len(motion.q), 3))
    for k, q in enumerate(motion.q):
        pin.forwardKinematics(model, data, q)
        at[k] = pin.updateFramePlacement(model, data, index).translation
    joint = int(model.frames[index].parentJoint)
    wrench = _moved(np.broadcast_to(wrench, (len(at), 6)), at)
    carried = carriers(model, np.array([joint]))[0]
    along = matvec(motion.system.frames.screws, wrench)
    return Load(joint, wrench, along * carried)


def loop_loads(robot: ParallelRobot, system: System, r: Array, joint_torque: Array) -> LoopLoads:
    """Solve r = S tau + J' lambda for all rows of J and the joints that follow; r (T, nv), tau (T, n_a)."""
    rows, columns, at = robot.rows, robot.moving, system.frames
    wrench, position = system.loops.wrench, at.position[:, rows.second]
    signs = at.carried[rows.second] - at.carried[rows.first]
    screws = at.screws.swapaxes(1, 2)[:, :, columns]
    jacobian = matmul(_moved(wrench, position), screws) * signs[:, columns]
    scale = robot.column_scale[columns]  # columns in radians and robot lengths, and so are the rows
    lengths = robot.row_lengths
    left = r[:, columns].copy()
    left[:, : robot.n_a] -= joint_torque
    # J' lambda = left by the singular value decomposition of J
    along_rows, sizes, along_columns = np.linalg.svd(jacobian * scale / lengths[:, None])
    count = sizes.shape[1]
    sound = sizes > REACHED * sizes.max(axis=1, initial=0.0)[:, None]
    parts = matvec(along_columns[:, :count], left * scale)
    parts = np.where(sound, parts / np.where(sound, sizes, 1.0), 0.0)
    free = along_rows.swapaxes(1, 2).copy()
    free[:, :count] *= ~sound[:, :, None]
    multipliers = matvec(along_rows[:, :, :count], parts)
    displacement = position - at.position[:, rows.first]
    return LoopLoads(wrench, position, displacement, multipliers / lengths, free / lengths)


def loop_forces(robot: ParallelRobot, loops: LoopLoads) -> dict[str, Array]:
    """BY b's body ON a's body, at a's origin, by closure with frames [a, b], (T, 6); NaN: indeterminate."""
    at_first, found, first = _moved(loops.wrench, loops.displacement), {}, 0
    for closure in robot.description.closures:
        rows = slice(first, first + len(closure.axes))
        first = rows.stop
        wrench = -matvec(at_first[:, rows].swapaxes(1, 2), loops.multipliers[:, rows])
        found[closure.name] = _determinate(robot, wrench, loops.free[:, :, rows] @ at_first[:, rows])
    return found


def joint_reactions(
    robot: ParallelRobot, motion: Motion, loads: Sequence[Load], loops: LoopLoads
) -> dict[str, Array]:
    """BY the body before a joint ON the one behind it, at the joint's origin, (T, 6); NaN: indeterminate."""
    model, scratch, count = robot.model, scratch_of(robot), len(motion.q)
    poses, own = np.empty((count, *scratch.joints.shape)), np.empty((count, *scratch.forces.shape))
    for k, (q, v, a) in enumerate(zip(motion.q, motion.v, motion.a, strict=True)):
        pin.forwardKinematics(model, scratch.data, q)
        pin.rnea(model, scratch.data, q, v, a)
        if scratch.refresh is not None:
            scratch.refresh()
        poses[k], own[k] = scratch.joints, scratch.forces
    position = poses[..., 9:]
    turned = matvec(rotations(poses)[:, :, None], own.reshape(*own.shape[:2], 2, 3))
    reactions = turned.reshape(own.shape)
    carrying = _carrying(model)
    ends = np.array([model.frames[frame].parentJoint for frame in robot.frames], dtype=np.intp)
    of_loops = carrying[ends[robot.rows.second]] - carrying[ends[robot.rows.first]]  # (rows, joints)
    about_base = _moved(loops.wrench, loops.position)
    # wrenches about the base's origin, summed for each joint and moved to its own
    given = matmul(of_loops.T, loops.multipliers[:, :, None] * about_base)
    for load in loads:
        given += carrying[load.joint][:, None] * load.wrench[:, None]
    reactions -= _moved(given, -position)
    moved = np.einsum("mj,tkm,tmi->tjki", of_loops, loops.free, about_base)
    moved = _moved(moved, -position[:, :, None])
    names = {j: str(model.names[j]) for j in range(1, model.njoints)}
    return {name: _determinate(robot, reactions[:, j], moved[:, j]) for j, name in names.items()}


def _moved(wrench: Array, arm: Array) -> Array:
    """A wrench (..., 6) at a point, about the place from which an arm (..., 3) leads there."""
    moved = wrench.copy()
    moved[..., 3:] += cross(arm, wrench[..., :3])
    return moved


def _carrying(model: pin.Model) -> Array:
    """1 where a joint (the second index) carries the body of another or its own, (joints, joints)."""
    carrying = np.zeros((model.njoints, model.njoints))
    for joint in range(model.njoints):
        carrying[joint, list(model.supports[joint])] = 1.0
    return carrying


def _determinate(robot: ParallelRobot, wrench: Array, moved: Array) -> Array:
    """Wrenches (T, 6), NaN where a unit of what may be added to lambda moves them, moved (T, k, 6)."""
    lever = np.repeat([1.0, robot.length], 3)
    reached = np.abs(moved / lever).max(axis=1, initial=0.0) * robot.length
    return np.where(reached > REACHED, np.nan, wrench)
