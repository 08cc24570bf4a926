"""A reference away from singularities, for files whose reference is singular or nearly so.

From the reference the joints move in each direction that the loops allow until a sign of a mode changes. The
whole Jacobian of the loops keeps its rank at Type 1 and Type 2 singularities, so these motions lead there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.kinematics.assembly import allowed_joint_motions, move_closed
from framework.kinematics.frames import frames_at
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.modes import mode_signs
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import positions_beyond_limits
from framework.numerics.arrays import Array
from framework.tolerances import REFERENCE_DISTANCE

STEP = 0.05  # [rad, robot lengths] of the joint that moves most
STEPS = 12  # of a motion that looks for a singularity
STEPS_AWAY = 4  # of a motion that leaves one, after which all directions are looked at again


class NearSingularity(NamedTuple):
    """The singularity that is nearest to a pose."""

    kind: str  # "Type 1" or "Type 2"; "" if none is nearer than REFERENCE_DISTANCE
    distance: float  # [rad, robot lengths] of the platform to Type 1, of the motors to Type 2
    direction: Array  # (joints,) of the motion that leads there


def find_near_singularity(robot: ParallelRobot, q: Array) -> NearSingularity:
    """Find the nearest singularity to a pose q (nq,) on motions along basis vectors of the allowed ones.

    The sign of the working mode changes where a motion passes Type 1, that of the assembly mode at Type 2.
    Each motion ends where it is farther than the nearest singularity so far.
    """
    nearest = NearSingularity("", REFERENCE_DISTANCE, np.zeros(len(robot.joints)))
    # of combined loop equations, on which the signs depend
    bases = linearised_at(robot, q[None]).bases[0] if robot.structure.varies else None
    allowed = allowed_joint_motions(robot, q)  # (f, joints)
    for direction in [*allowed, *-allowed]:
        poses = _move(robot, q, direction, STEPS, nearest.distance)  # (T, nq)
        signs = mode_signs(robot, linearised_at(robot, poses, bases=bases))  # (T,) each: working, assembly
        for kind, distances, sign in zip(("Type 1", "Type 2"), _distances(robot, poses), signs, strict=True):
            changed = np.flatnonzero(sign != sign[0])  # the poses behind a singularity
            if len(changed) and distances[changed[0]] < nearest.distance:
                nearest = NearSingularity(kind, float(distances[changed[0]]), direction)
    return nearest


def _distances(robot: ParallelRobot, poses: Array) -> Array:
    """Compute distances (2, T) of platform and motors at poses (T, nq) from the first [rad, lengths]."""
    x = robot.platform.coordinates(frames_at(robot, poses))
    x = robot.platform.unwrap(x, x[0]) / robot.platform_scale
    motors = robot.actuated_coordinates(poses) / robot.column_scale[robot.actuated]
    return np.array([np.abs(each - each[0]).max(axis=1) for each in (x, motors)])


def regular_reference(robot: ParallelRobot) -> tuple[NearSingularity, Array | None]:
    """Find the singularity near the reference, and a pose q (nq,) away from singularities.

    The pose is in the same modes and within the joints' ranges; None if no singularity is near, or if there
    is no such pose.
    """
    max_moves = 4
    first = near = find_near_singularity(robot, robot.reference.q)
    q = robot.reference.q
    for _ in range(max_moves):
        if not near.kind:
            break
        q = _move(robot, q, -near.direction, STEPS_AWAY)[-1]
        near = find_near_singularity(robot, q)
    is_better = not near.kind and not positions_beyond_limits(robot.limits, q[None])
    return first, q if first.kind and is_better else None


def _move(robot: ParallelRobot, q: Array, direction: Array, steps: int, farthest: float = np.inf) -> Array:
    """Return poses (T, nq) from q along a direction (joints,).

    The motion ends where loops open, or where platform and motors are `farthest` from q.
    """
    poses = [q]
    for _ in range(steps):
        allowed = allowed_joint_motions(robot, poses[-1])  # (f, joints)
        direction = (allowed @ direction) @ allowed
        closed = move_closed(robot, poses[-1], STEP * direction / np.abs(direction).max())
        if closed is None:
            break
        poses.append(closed)
        if _distances(robot, np.array([q, closed]))[:, 1].min() > farthest:
            break
    return np.array(poses)
