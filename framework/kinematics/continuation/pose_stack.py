"""Poses for many sets of motor angles at once, and for a stream of motor angles.

A stack follows the motors from its start in a few equal steps, all rows in one call, and every row has to
pass the tests of a step of `predictor_corrector`. For rows with a refused step turning points ahead are found
in one call as well. A row without a turning point is followed alone, in steps as short as necessary
(`forward_kinematics`), up to its target or to the error that ends it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, ArrayLike, BoolArray, ReadOnlyArrays
from framework.errors import NotAssembled
from framework.kinematics.assembly import Configuration
from framework.kinematics.closures import loop_wrenches
from framework.kinematics.continuation.forward_kinematics import (
    ForwardPose,
    check_motors_are_free,
    close_at_motors,
    forward_kinematics,
    motor_driven_rates,
    motor_joints_of,
    motors_turning_points,
    start_pose,
    type2_singularity,
)
from framework.kinematics.continuation.predictor_corrector import FIRST_STEP_RATIO, measure
from framework.kinematics.frames import difference, frames_at, integrate
from framework.kinematics.linearised_loops import LinearisedLoops, linearised_at
from framework.kinematics.loop_matrices import clearance
from framework.kinematics.modes import keeps_sign, passive_determinants
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.tolerances import BRANCHES_CROSS, BRANCHES_MEET, RANK_LOST

STEP_COUNT = round(1 / FIRST_STEP_RATIO)
MAX_STEP_ITERATIONS = 10  # of Newton's method; a step along the tangent that needs more is refused


@dataclass(frozen=True, eq=False)
class PoseStack(ReadOnlyArrays):
    """Poses for T sets of motor angles; rows of `refused` are NaN. See `ForwardPose`."""

    q: Array  # (T, nq)
    x: Array  # (T, n)
    residual: Array  # (T,) the largest of all loop equations [m or rad]
    clearance: Array  # (T,) least singular value of P met on the way (radians, robot lengths)
    refused: Mapping[int, NotAssembled]  # by row: `Type2Singularity` says where it lies


def forward_kinematics_stack(
    robot: ParallelRobot, q_a: ArrayLike, *, near: ArrayLike | Configuration | None = None
) -> PoseStack:
    """Compute all joints and the platform for T sets of motor joints (T, n_a), each from one start pose.

    Args:
        near: an assembled configuration (nq,), the reference by default.

    Raises:
        InvalidInput: as `forward_kinematics`; its other errors are `refused` of the result, by row.
    """
    expect_robot(robot)
    targets = np.atleast_2d(motor_joints_of(robot, q_a, stacks=True))
    check_motors_are_free(robot)
    start = start_pose(robot, near)
    turn = np.zeros((len(targets), robot.model.nv))
    turn[:, robot.actuated] = targets - robot.actuated_coordinates(start.q[None])
    rows = _follow_rows(robot, start.q, start.x, turn)
    loops = loop_wrenches(robot.rows, frames_at(robot, rows.q))
    residual = np.abs(loops.residual).max(axis=1, initial=0.0)
    stack = {"q": rows.q, "x": rows.x, "residual": residual, "clearance": rows.least}
    refused = _turning_refusals(robot, rows, targets, turn)
    for k in map(int, np.flatnonzero(rows.share < 1.0)):
        if k not in refused:
            try:
                pose = forward_kinematics(robot, targets[k], near=start)
            except NotAssembled as refusal:
                refused[k] = refusal
            else:
                for name, values in stack.items():
                    values[k] = getattr(pose, name)
    for values in stack.values():
        values[list(refused)] = np.nan
    return PoseStack(**stack, refused=MappingProxyType(dict(sorted(refused.items()))))


class _Rows(NamedTuple):
    """Places of T ways of the motors."""

    q: Array  # (T, nq)
    x: Array  # (T, n)
    rate: Array  # (T, nv) joint rates for the whole turn of the motors
    share: Array  # (T,) of the way
    clearance: Array  # (T,) least singular value of P
    least: Array  # (T,) clearance met on the way
    sign: Array  # (T,) of the determinant of P
    size: Array  # (T,) its logarithm


def _turning_refusals(
    robot: ParallelRobot, rows: _Rows, targets: Array, turn: Array
) -> dict[int, NotAssembled]:
    """Return the errors of unfinished rows with a turning point ahead, by row."""
    short = np.flatnonzero(rows.share < 1.0)
    if not len(short) or not len(robot.following):
        return {}
    ahead = motors_turning_points(robot, rows.q[short], rows.share[short], turn[short])
    platform = robot.platform.coordinates(ahead.linearised.frames)
    x = robot.platform.unwrap(platform, rows.x[short])
    residual = np.abs(ahead.linearised.residual[:, robot.n :]).max(axis=1)
    return {
        int(k): type2_singularity(
            robot, ahead.share[i], ahead.q[i], x[i], targets[k], residual=float(residual[i])
        )
        for i, k in enumerate(short)
        if ahead.found[i]
    }


def _follow_rows(robot: ParallelRobot, start: Array, x: Array, turn: Array) -> _Rows:
    """Follow turns (T, nv) of the motors from start (nq,) in `STEP_COUNT` steps, up to a refused one."""
    count = len(turn)
    linearised = linearised_at(robot, np.repeat(start[None], count, axis=0), None)
    rows = _rows_at(robot, linearised, turn, np.repeat(x[None], count, axis=0), np.zeros(count))
    live = np.flatnonzero(rows.clearance > RANK_LOST)
    for k in range(1, STEP_COUNT + 1):
        share = k / STEP_COUNT
        predicted = integrate(robot, rows.q[live], rows.rate[live] / STEP_COUNT)
        _, linearised, closed = close_at_motors(
            robot, start, share * turn[live], predicted, iterations=MAX_STEP_ITERATIONS
        )
        live, predicted = live[closed], predicted[closed]
        linearised = linearised.select(np.flatnonzero(closed))
        before = _Rows(*(part[live] for part in rows))
        after = _rows_at(robot, linearised, turn[live], before.x, np.full(len(live), share))
        accepted = _stays_on_branch(robot, before, after, predicted)
        live = live[accepted]
        for whole, part in zip(rows, after, strict=True):
            whole[live] = part[accepted]
        rows.least[live] = np.minimum(rows.least[live], before.least[accepted])
    return rows


def _rows_at(robot: ParallelRobot, linearised: LinearisedLoops, turn: Array, x: Array, share: Array) -> _Rows:
    """Return the places at linearised loops, platform turns counted on from x (T, n)."""
    frames = linearised.frames
    rate, clear = motor_driven_rates(robot, linearised, turn), clearance(robot, linearised)
    platform = robot.platform.unwrap(robot.platform.coordinates(frames), x)
    determinants = passive_determinants(linearised)
    return _Rows(
        frames.q.copy(), platform, turn if rate is None else rate, share, clear, clear.copy(), *determinants
    )


def _stays_on_branch(robot: ParallelRobot, before: _Rows, after: _Rows, predicted: Array) -> BoolArray:
    """Whether steps (T,) kept to their assembly mode.

    The correction is small, no Type 2 singularity is near, the determinant of P keeps its sign, and the
    tangent is straight or branches that cross are far.
    """
    correction = difference(robot, predicted, after.q)
    step = measure(robot, correction, before.rate / STEP_COUNT, after.rate / STEP_COUNT)
    clear = (after.clearance > BRANCHES_MEET) & (step.straight | (after.clearance > BRANCHES_CROSS))
    same_sign = keeps_sign((before.sign, before.size), (after.sign, after.size))
    return step.small & clear & same_sign


def follow_motors(
    robot: ParallelRobot,
    samples: Iterable[ArrayLike],
    *,
    near: ArrayLike | Configuration | None = None,
    single_turn: bool = False,
) -> Iterator[ForwardPose]:
    """Yield the pose of each sample of the motors' joints, starting from the pose of the sample before.

    The platform's turns are counted on through the whole stream.

    Args:
        samples: motor joints (n_a,), joint side of the gears [rad, m], such as encoders give.
        near: an assembled configuration (nq,) to begin with, the reference by default.
        single_turn: hinges are measured modulo a turn, and each sample is moved to the turn nearest to the
            sample before; else full turns count.

    Raises:
        InvalidInput, Type2Singularity, NotAssembled: of a sample, see `forward_kinematics`. The stream ends
            with it; the pose before was the last one yielded.
    """
    expect_robot(robot)
    turning = ~robot.sliding[robot.actuated]
    pose = start_pose(robot, near)
    for sample in samples:
        q_a = motor_joints_of(robot, sample)
        if single_turn:
            turns = np.round((robot.actuated_coordinates(pose.q[None])[0] - q_a) / (2 * np.pi))
            q_a = np.where(turning, q_a + 2 * np.pi * turns, q_a)
        pose = forward_kinematics(robot, q_a, near=pose)
        yield pose
