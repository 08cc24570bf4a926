"""Poses for many sets of motor angles at once, and for a stream of motor angles.

All curves of a stack are followed together from one start (`motor_curves`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from framework.errors import NotAssembled
from framework.kinematics.assembly import Configuration
from framework.kinematics.continuation.forward_kinematics import (
    ForwardPose,
    check_motors_are_free,
    curve_end_error,
    forward_kinematics,
    motor_joints_of,
    start_pose,
)
from framework.kinematics.continuation.motor_curves import follow_curves
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays, select
from framework.numerics.rotations import whole_turns


@dataclass(frozen=True, eq=False)
class PoseStack(ReadOnlyArrays):
    """Poses for T sets of motor angles, see `ForwardPose`; the rows in `refused` are NaN."""

    q: Array  # (T, nq)
    x: Array  # (T, n)
    residual: Array  # (T,) largest residual of all loop equations [m or rad]
    clearance: Array  # (T,) least singular value of P on the curve (radians, robot lengths)
    refused: Mapping[int, NotAssembled]  # errors by row; a `Type2Singularity` says where it lies


def forward_kinematics_stack(robot: ParallelRobot, q_a: ArrayLike) -> PoseStack:
    """Compute the poses for T sets of motor joints (T, n_a), each from the reference.

    Raises:
        InvalidInput: q_a has the wrong shape or is not finite, or no motor can move alone. The errors of
            single rows (Type2Singularity, NotAssembled) are in `refused` of the result.
    """
    expect_robot(robot)
    targets = np.atleast_2d(motor_joints_of(robot, q_a, stacks=True))
    check_motors_are_free(robot)
    start = start_pose(robot, None)
    ends = follow_curves(robot, start.curve, start.linearised, targets)
    linearised = linearised_at(robot, ends.q, None)
    refused: dict[int, NotAssembled] = {}
    for k in np.flatnonzero(ends.share < 1.0).tolist():
        end = select(ends, slice(k, k + 1))
        refused[k] = curve_end_error(robot, end, linearised.select(k), targets[k])
    # as in `PoseStack`; copies, because the errors refer to the arrays of `ends`
    poses = (ends.q.copy(), ends.x.copy(), linearised.gap, ends.least.copy())
    for values in poses:
        values[list(refused)] = np.nan
    return PoseStack(*poses, refused=MappingProxyType(refused))


def follow_motors(
    robot: ParallelRobot,
    samples: Iterable[ArrayLike],
    *,
    near: ArrayLike | Configuration | None = None,
    single_turn: bool = False,
) -> Iterator[ForwardPose]:
    """Yield the pose of each sample of the motor joints, starting from the previous pose.

    The platform's whole turns are counted through the whole stream.

    Args:
        samples: motor joints (n_a,), joint side of the gears [rad, m], for instance from encoders.
        near: an assembled configuration (nq,) to start from, the reference by default.
        single_turn: whether hinges are measured modulo a turn. If so, each sample is shifted by the whole
            turns that bring it nearest to the previous one. Otherwise full turns count.

    Raises:
        InvalidInput, Type2Singularity, NotAssembled: a sample has no pose, see `forward_kinematics`. The
            stream ends after the pose of the previous sample.
    """
    expect_robot(robot)
    turning = ~robot.sliding[robot.actuated]
    pose = start_pose(robot, near)
    for sample in samples:
        q_a = motor_joints_of(robot, sample)
        if single_turn:
            turns = whole_turns(robot.actuated_coordinates(pose.q[None])[0] - q_a)
            q_a = np.where(turning, q_a + turns, q_a)
        pose = forward_kinematics(robot, q_a, near=pose)
        yield pose
