"""Forward kinematics: all joints and the platform for prescribed motor joints, from a start pose.

The motors turn from the start to the target (`motor_curves`). Away from Type 2 singularities the matrix P of
the passive columns of the loop equations is regular, and the branch leads to the pose in the assembly mode of
the start. Where P loses rank the motors no longer determine the motion, and the branch ends. This is called
Type 2 here, whether the platform moves or only joints inside a leg; `singularity.pose_classes`
distinguishes the two.

All curves of a stack of motor angles are followed together from one start. In a stream of motor angles each
pose is the start of the next.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from framework.errors import InvalidInput, NotAssembled, Type2Singularity, finite_numbers, point
from framework.kinematics.assembly import Configuration
from framework.kinematics.continuation.motor_curves import MotorCurves, follow_curves
from framework.kinematics.linearised_loops import (
    LinearisedLoops,
    assembled_at,
    clearance,
    linearised_at_reference,
)
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays, freeze, select
from framework.numerics.rotations import whole_turns


@dataclass(frozen=True, eq=False)
class ForwardPose(Configuration):
    """The pose at prescribed motor joints, with its certificate.

    `x` (n,) includes whole turns of the platform since the start. `residual` is the largest of all loop
    equations [m or rad], redundant ones included; `iterations` is the number of steps taken. From `robot` and
    `linearised` the next pose of a stream of motor angles starts without another check that the loops are
    closed.
    """

    # the least singular value of P on the curve [rad, robot lengths]: 0 at a Type 2 singularity, infinite
    # without passive joints
    clearance: float
    robot: ParallelRobot = field(repr=False)
    linearised: LinearisedLoops = field(repr=False)  # at q, T = 1


def forward_kinematics(
    robot: ParallelRobot, q_a: ArrayLike, *, near: ArrayLike | Configuration | None = None
) -> ForwardPose:
    """Compute the pose for prescribed motor joints in the assembly mode of a start pose.

    Args:
        q_a: actuated joints (n_a,), joint side of the gears [rad, m], in the order of the robot file. Full
            turns of hinges count: to a target one turn away the motor makes a full turn.
        near: an assembled configuration (nq,) to start from, the reference by default. For a stream of angles
            give the previous result of this function. Springs keep the deflections of this configuration.

    Raises:
        InvalidInput: q_a or near has the wrong length or is not finite, the loops are open at near, or no
            motor can move alone.
        Type2Singularity: a singularity lies on the curve or at its start; carries its configuration.
        NotAssembled: the curve cannot be followed for another reason.
    """
    target = motor_joints_of(robot, q_a)
    check_motors_are_free(robot)
    start = start_pose(robot, near)
    end, linearised = follow_curves(robot, start.linearised, start.x, target[None])
    if end.share[0] < 1.0:  # the motors have not arrived
        raise curve_end_error(robot, end, linearised, target)
    return _pose_at(robot, linearised, end.x[0], int(end.steps[0]), float(end.least[0]))


def motor_joints_of(robot: ParallelRobot, q_a: ArrayLike, *, stacks: bool = False) -> Array:
    """Return motor joints q_a (n_a,), or (T, n_a) with `stacks`, as finite numbers."""
    return finite_numbers(f"q_a ({', '.join(robot.actuator_names)})", q_a, robot.n_a, stacks=stacks)


def _pose_at(
    robot: ParallelRobot, linearised: LinearisedLoops, x: Array, steps: int, least: float
) -> ForwardPose:
    """Return the pose of loops (T = 1) at x (n,), with `steps` and `least` clearance of its curve."""
    freeze(linearised)
    gap = float(linearised.gap[0])
    return ForwardPose(linearised.frames.q[0], x, gap, steps, least, robot=robot, linearised=linearised)


def start_pose(robot: ParallelRobot, near: ArrayLike | Configuration | None = None) -> ForwardPose:
    """Return the assembled configuration `near` (nq,), the reference by default, as the start of a curve.

    Raises:
        InvalidInput: the configuration is not assembled.
    """
    if isinstance(near, ForwardPose) and near.robot is robot:  # assembled: it needs no check
        return near
    closed = assembled_at(robot, robot.reference.q if near is None else near)
    least = float(clearance(robot, closed)[0])
    return _pose_at(robot, closed, closed.x[0], 0, least)


def check_motors_are_free(robot: ParallelRobot) -> None:
    """Raise InvalidInput unless each motor can move while the others rest."""
    if not motors_are_free(robot):
        raise InvalidInput(
            f"{robot.name}: its {robot.n_a} motors drive {robot.n} degrees of freedom, so none of them can "
            f"move while all others rest; move the platform"
        )


def motors_are_free(robot: ParallelRobot) -> bool:
    """Return whether each motor can move while all others rest: P is square and n_a = n."""
    return robot.n_a == robot.n and robot.n_p == len(robot.loops.names)


def curve_end_error(
    robot: ParallelRobot, end: MotorCurves, linearised: LinearisedLoops, q_a: Array
) -> NotAssembled:
    """Return the error for a curve that ends at `end` (T = 1), before the motors reach q_a (n_a,).

    The curve ends at a Type 2 singularity if its clearance has dropped far below the usual one. The loops at
    the end are `linearised`.
    """
    # share of the usual clearance; a curve that ends with less ends at Type 2
    type_2_end_ratio = 0.05
    at_reference = clearance(robot, linearised_at_reference(robot))
    usual_clearance = max(end.largest[0], at_reference[0])
    residual = float(np.abs(linearised.residual[:, robot.n :]).max(initial=0.0))
    share = float(end.share[0])
    x = end.x[0]
    motors = f"{', '.join(robot.actuator_names)} = {point(q_a)}"
    place = f"on the way to {motors}, after {share:.6g} of it, at {robot.place(x)}"
    if clearance(robot, linearised)[0] > type_2_end_ratio * usual_clearance:
        return NotAssembled(
            f"the loops cannot be followed {place}", name=robot.name, q=end.q[0], residual=residual
        )
    return Type2Singularity(
        f"a Type 2 singularity {place}: with its motors locked the robot can still move there, "
        f"and this assembly mode ends",
        name=robot.name,
        q=end.q[0],
        residual=residual,
        share=share,
        platform=x,
    )


@dataclass(frozen=True, eq=False)
class PoseStack(ReadOnlyArrays):
    """Poses for T sets of motor angles; the rows in `refused` are NaN."""

    q: Array  # (T, nq)
    x: Array  # (T, n) platform coordinates, with whole turns since the start
    residual: Array  # (T,) largest residual of all loop equations [m or rad]
    clearance: Array  # (T,) least singular value of P on the curve (radians, robot lengths)
    refused: Mapping[int, NotAssembled]  # errors by row; a `Type2Singularity` says where it lies


def forward_kinematics_stack(
    robot: ParallelRobot, q_a: ArrayLike, *, near: ArrayLike | Configuration | None = None
) -> PoseStack:
    """Compute the poses for T sets of motor joints (T, n_a), each from one start pose.

    Args:
        near: an assembled configuration (nq,) to start from, the reference by default.

    Raises:
        InvalidInput: q_a or near has the wrong shape or is not finite, the loops are open at near, or no
            motor can move alone. The errors of single rows (Type2Singularity, NotAssembled) are in `refused`
            of the result.
    """
    targets = np.atleast_2d(motor_joints_of(robot, q_a, stacks=True))
    check_motors_are_free(robot)
    start = start_pose(robot, near)
    ends, linearised = follow_curves(robot, start.linearised, start.x, targets)
    refused: dict[int, NotAssembled] = {}
    for k in np.flatnonzero(ends.share < 1.0).tolist():
        end = select(ends, slice(k, k + 1))
        refused[k] = curve_end_error(robot, end, linearised.select(k), targets[k])
    # q, x, residual and clearance; copies, because the errors refer to the arrays of `ends`
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
