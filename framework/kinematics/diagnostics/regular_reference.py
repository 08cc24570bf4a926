"""A reference away from singularities, for files whose reference is singular or nearly so.

From the reference the joints move in each direction that the loops allow until a sign of a mode changes. The
whole Jacobian of the loops keeps its rank at Type 1 and Type 2 singularities, so these motions lead there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.kinematics.assembly import joint_loops_matrix, move_closed
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.modes import mode_signs
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import positions_beyond_limits
from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import split_row_space
from framework.tolerances import BRANCHES_MEET, REFERENCE_DISTANCE

STEP, STEPS = 0.05, 12  # [rad, robot lengths] of the joint that moves most, and number, of a motion


class Neighbour(NamedTuple):
    """The singularity that is nearest to a pose."""

    kind: str  # "Type 1" or "Type 2"; "" if none is nearer than REFERENCE_DISTANCE
    distance: float  # [rad, robot lengths] of the platform to Type 1, of the motors to Type 2
    direction: Array  # (joints,) of the motion that leads there


def nearest_neighbour(robot: ParallelRobot, q: Array) -> Neighbour:
    """Find the singularity nearest to the pose q (nq,) along the motions that the loops allow."""
    nearest = Neighbour("", REFERENCE_DISTANCE, np.zeros(len(robot.joints)))
    # of combined loop equations, on which the signs depend
    bases = linearised_at(robot, q[None]).bases[0] if robot.structure.varies else None
    _, allowed = split_row_space(joint_loops_matrix(robot, q), BRANCHES_MEET)
    for direction in [*allowed, *-allowed]:
        poses = _move(robot, q, direction)
        linearised = linearised_at(robot, poses, bases=bases)
        x = robot.platform.coordinates(linearised.frames)
        x = robot.platform.unwrap(x, x[0]) / robot.platform_scale
        motors = robot.actuated_coordinates(poses) / robot.column_scale[robot.actuated]
        signs = mode_signs(robot, linearised)
        for kind, moved, sign in zip(("Type 1", "Type 2"), (x, motors), signs, strict=True):
            changed = np.flatnonzero(sign != sign[0])
            if len(changed):
                distance = float(np.abs(moved[changed[0]] - moved[0]).max())
                nearest = min(nearest, Neighbour(kind, distance, direction), key=lambda each: each.distance)
    return nearest


def regular_reference(robot: ParallelRobot, *, max_moves: int = 4) -> tuple[Neighbour, Array | None]:
    """Find a pose q (nq,) away from singularities that are near the reference; None if none are near.

    The pose is in the same modes and within the joints' ranges. It is also None if there is no such pose.
    """
    first = neighbour = nearest_neighbour(robot, robot.reference.q)
    q = robot.reference.q
    for _ in range(max_moves):
        if not neighbour.kind:
            break
        q = _move(robot, q, -neighbour.direction)[:5][-1]
        neighbour = nearest_neighbour(robot, q)
    is_better = not neighbour.kind and not positions_beyond_limits(robot.limits, q[None])
    return first, q if first.kind and is_better else None


def _move(robot: ParallelRobot, q: Array, direction: Array) -> Array:
    """Return poses (T, nq) from q on along a direction (joints,)."""
    poses = [q]
    for _ in range(STEPS):
        _, allowed = split_row_space(joint_loops_matrix(robot, poses[-1]), BRANCHES_MEET)
        direction = (allowed @ direction) @ allowed
        closed = move_closed(robot, poses[-1], STEP * direction / np.abs(direction).max())
        if closed is None:
            break
        poses.append(closed)
    return np.array(poses)
