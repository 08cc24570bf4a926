"""Reach the poses of a grid from poses that are reached already, never jumping to another mode.

A pose is tried from a neighbour, along the tangent and by Newton's method, and belongs to the neighbour's
branch only if what corrects the tangent is small and no Type 1 singularity lies between (the rules of
`continuation.follow`, here for a stack of steps). Strides halve: the coarse poses first, those between them
from there, so that each pose is computed once and the stacks are long.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from framework.arrays import Array, BoolArray, IntArray
from framework.kinematics.continuation.predictor_corrector import is_small, is_straight
from framework.kinematics.frames import difference, integrate
from framework.kinematics.inverse_kinematics import close_each
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.loop_matrices import lost_equations
from framework.kinematics.modes import keeps_sign, keeps_working_mode
from framework.kinematics.motion_rates import joint_rates
from framework.kinematics.parallel_robot import ParallelRobot
from framework.tolerances import BRANCHES_CROSS

NEWTON_STEPS = 10  # Newton steps to a neighbour; a step along the tangent that needs more is no good one
MAX_JOINT_STEP = 0.5  # [rad, lengths] that such a step may move a joint by

STEP_PARTS = 4  # of a step that is too long to be trusted, with the last stride
DIRECTIONS = ((1, 0), (-1, 0), (0, 1), (0, -1))


class PoseReason(IntEnum):
    """The reason why a pose has no value. Of several neighbours the one that came nearest counts."""

    REACHED = 0
    NO_NEIGHBOUR = 1  # no neighbour of it is reached
    OPEN = 2  # the loops do not close there, from no neighbour
    OTHER_MODE = 3  # they close only beyond a Type 1 singularity, or too near one for a step to be trusted


REASON_WORDS = {
    PoseReason.REACHED: "reached",
    PoseReason.NO_NEIGHBOUR: "not joined to the reference",
    PoseReason.OPEN: "out of reach",
    PoseReason.OTHER_MODE: "another working mode, or too near its end",
}


class StepEnds(NamedTuple):
    """The ends of steps from T poses."""

    q: Array  # (T, nq)
    reason: NDArray[np.uint8]  # (T,) `PoseReason`


def fill_grid(robot: ParallelRobot, x: Array, q: Array, reason: NDArray[np.uint8], strides: IntArray) -> None:
    """Assemble the poses of a grid from their neighbours, in place.

    A pose whose reason is NO_NEIGHBOUR is tried from each neighbour that is reached, until one leads to it;
    poses with any other reason keep it.

    Args:
        x: (I, J, n) platform coordinates.
        q: (I, J, nq) configurations; NaN at poses that are not reached.
        reason: (I, J) `PoseReason` of each pose.
        strides: between neighbours, falling: coarse poses first, those between them from there. Poses are
            counted from the first one. With the last stride a step that cannot be trusted is tried in parts.
    """
    missing = reason == PoseReason.NO_NEIGHBOUR
    for stride in strides:
        coarse = np.s_[::stride, ::stride]
        parts = STEP_PARTS if stride == strides[-1] else 1
        _fill(robot, x[coarse], q[coarse], reason[coarse], missing[coarse], parts)


def _fill(
    robot: ParallelRobot, x: Array, q: Array, reason: NDArray[np.uint8], unfilled: BoolArray, parts: int
) -> None:
    """Fill one lattice of a grid (views of the whole), wave by wave; see `fill_grid`."""
    untried = np.ones((len(DIRECTIONS), *reason.shape), dtype=bool)
    while True:
        filled = np.isfinite(q[..., 0])
        is_target = np.zeros(reason.shape, dtype=bool)
        sources = np.zeros((*reason.shape, 2), dtype=np.intp)
        for k, (down, right) in enumerate(DIRECTIONS):
            reachable = _shift(filled, down, right) & unfilled & ~filled & untried[k] & ~is_target
            untried[k] &= ~reachable
            is_target |= reachable
            sources[reachable] = np.argwhere(reachable) - (down, right)
        if not is_target.any():
            return
        target, (i, j) = np.nonzero(is_target), sources[is_target].T
        step = step_poses(robot, q[i, j], x[i, j], x[target], parts)
        reached = step.reason == PoseReason.REACHED
        q[target] = np.where(reached[:, None], step.q, np.nan)
        reason[target] = np.where(reached, PoseReason.REACHED, np.maximum(reason[target], step.reason))


def _shift(mask: BoolArray, down: int, right: int) -> BoolArray:
    """Whether the neighbour at -(down, right) is known."""
    rows, columns = mask.shape
    return np.pad(mask, 1)[1 - down :, 1 - right :][:rows, :columns]


def step_poses(robot: ParallelRobot, q: Array, start: Array, end: Array, parts: int = 1) -> StepEnds:
    """Assemble configurations at platform coordinates `end` (T, n), from q (T, nq) at `start` (T, n).

    A step that is refused is tried in `parts`.
    """
    step = _step_once(robot, q, start, end)
    again = step.reason == PoseReason.OTHER_MODE
    if parts == 1 or not again.any():
        return step
    part_q, reason = q[again], np.zeros(np.count_nonzero(again), dtype=np.uint8)
    offset = end[again] - start[again]
    for k in range(parts):
        good = reason == PoseReason.REACHED
        if not good.any():
            break
        part_start = start[again][good] + offset[good] * (k / parts)
        part = _step_once(robot, part_q[good], part_start, part_start + offset[good] / parts)
        part_q[good], reason[good] = part.q, part.reason
    step.q[again], step.reason[again] = part_q, reason
    return step


def _step_once(robot: ParallelRobot, q: Array, start: Array, end: Array) -> StepEnds:
    """Assemble configurations at `end` (T, n), from q (T, nq) at `start` (T, n), in one step each."""
    linearised = linearised_at(robot, q, start)
    twist = robot.platform.twist(start, end - start)[0]
    move = joint_rates(robot, linearised, twist, np.zeros((len(q), robot.n_e)))
    predicted = integrate(robot, q, move)
    corrected, end_linearised, closed = close_each(
        robot, end, predicted, iterations=NEWTON_STEPS, farthest=MAX_JOINT_STEP
    )
    with np.errstate(invalid="ignore"):
        correction = np.abs(difference(robot, predicted, corrected) / robot.column_scale).max(axis=1)
        advance = np.abs(move / robot.column_scale).max(axis=1)
        # no Type 1 singularity lies between
        sure = keeps_sign(linearised.factors.slogdet, end_linearised.factors.slogdet)
        same = np.array(
            [
                k
                for k in np.flatnonzero(closed & is_small(correction, advance)).tolist()
                if sure[k] or keeps_working_mode(robot, linearised.select(k), end_linearised.select(k))[0]
            ],
            dtype=np.intp,
        )
        # where branches cross, the tangent turns by more than the correction of one branch tells
        twist = robot.platform.twist(end, twist)[0]
        turn = joint_rates(robot, end_linearised.select(same), twist[same], np.zeros((len(same), robot.n_e)))
        turn = np.abs((turn - move[same]) / robot.column_scale).max(axis=1)
        bent = ~is_straight(turn, correction[same], advance[same])
        bent[bent] = lost_equations(robot, end_linearised.select(same[bent]), BRANCHES_CROSS) > 0
    reason = np.where(closed, PoseReason.OTHER_MODE, PoseReason.OPEN).astype(np.uint8)
    reason[same[~bent]] = PoseReason.REACHED
    return StepEnds(corrected, reason)
