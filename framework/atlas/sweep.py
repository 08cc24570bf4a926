"""Reach the poses of a grid from poses that are reached already, in the same working mode.

A pose is predicted from a neighbour along the tangent and corrected by Newton's method. It is accepted, on
the neighbour's branch, only if the correction is small and no Type 1 singularity lies between (the rules of
`continuation.follow`, here for a stack of steps). Strides halve: coarse poses first, then those between them.
So each pose is computed once, and stacks are long.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from framework.kinematics.continuation.predictor_corrector import is_small, is_straight
from framework.kinematics.frames import difference, integrate
from framework.kinematics.inverse_kinematics import close_each
from framework.kinematics.linearised_loops import LinearisedLoops, linearised_at
from framework.kinematics.loop_matrices import count_lost_ranks
from framework.kinematics.modes import keeps_sign, keeps_working_mode
from framework.kinematics.motion_rates import joint_rates
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, BoolArray, IntArray
from framework.tolerances import BRANCHES_CROSS

NEWTON_STEPS = 10  # to correct a prediction; one that needs more is refused
MAX_JOINT_STEP = 0.5  # [rad, lengths] that a Newton step may move a joint by

STEP_PARTS = 4  # of a step that is too long to be trusted, with the last stride
DIRECTIONS = ((1, 0), (-1, 0), (0, 1), (0, -1))


ReasonArray = NDArray[np.uint8]  # of `PoseReason`


class PoseReason(IntEnum):
    """Reasons why a pose has no value; a larger one replaces a smaller."""

    REACHED = 0
    NO_NEIGHBOUR = 1  # no neighbour is reached
    OPEN = 2  # the loops close from no neighbour
    OTHER_MODE = 3  # they close beyond a Type 1 singularity, or too near one for a step to be trusted


REASON_WORDS = {
    PoseReason.REACHED: "reached",
    PoseReason.NO_NEIGHBOUR: "not joined to the reference",
    PoseReason.OPEN: "out of reach",
    PoseReason.OTHER_MODE: "another working mode, or too near its end",
}


class StepEnds(NamedTuple):
    """The ends of steps from T poses."""

    q: Array  # (T, nq)
    reason: ReasonArray  # (T,) `PoseReason`


def fill_grid(robot: ParallelRobot, x: Array, q: Array, reason: ReasonArray, strides: IntArray) -> None:
    """Assemble the poses of a grid from their neighbours, in place.

    A pose whose reason is NO_NEIGHBOUR is tried from each reached neighbour until one succeeds. Poses with
    another reason are not tried.

    Args:
        x: (I, J, n) platform coordinates.
        q: (I, J, nq) configurations; NaN at poses that are not reached.
        reason: (I, J) `PoseReason` of each pose.
        strides: between neighbours, falling: coarse poses first, counted from the first pose, then those
            between them. With the last stride a step that cannot be trusted is tried in parts.
    """
    missing = reason == PoseReason.NO_NEIGHBOUR
    for stride in strides:
        lattice = np.s_[::stride, ::stride]
        parts = STEP_PARTS if stride == strides[-1] else 1
        _fill_lattice(robot, x[lattice], q[lattice], reason[lattice], missing[lattice], parts)


def _fill_lattice(
    robot: ParallelRobot, x: Array, q: Array, reason: ReasonArray, wanted: BoolArray, parts: int
) -> None:
    """Fill one lattice of a grid (views of the whole), wave by wave.

    In each wave every wanted pose that is not filled is tried from one filled neighbour, from which it has
    not been tried yet, in a number of equal parts. Of several reasons for failure the larger one stays.
    """
    untried = np.ones((len(DIRECTIONS), *reason.shape), dtype=bool)
    while True:
        filled = np.isfinite(q[..., 0])
        is_target = np.zeros(reason.shape, dtype=bool)
        sources = np.zeros((*reason.shape, 2), dtype=np.intp)
        for k, (down, right) in enumerate(DIRECTIONS):
            chosen = _neighbour_mask(filled, down, right) & wanted & ~filled & untried[k] & ~is_target
            untried[k] &= ~chosen
            is_target |= chosen
            sources[chosen] = np.argwhere(chosen) - (down, right)
        if not is_target.any():
            return
        target, (i, j) = np.nonzero(is_target), sources[is_target].T
        step = step_poses(robot, q[i, j], x[i, j], x[target], parts)
        reached = step.reason == PoseReason.REACHED
        q[target] = np.where(reached[:, None], step.q, np.nan)
        reason[target] = np.where(reached, PoseReason.REACHED, np.maximum(reason[target], step.reason))


def _neighbour_mask(mask: BoolArray, down: int, right: int) -> BoolArray:
    """Return the mask (I, J) of poses whose neighbour at -(down, right) is in `mask`."""
    rows, columns = mask.shape
    return np.pad(mask, 1)[1 - down :, 1 - right :][:rows, :columns]


def step_poses(robot: ParallelRobot, q: Array, start: Array, end: Array, parts: int = 1) -> StepEnds:
    """Continue configurations q (T, nq) at `start` (T, n) to platform `end` (T, n).

    A step that closes the loops but is not trusted is tried again in `parts` equal steps.
    """
    step = _step_once(robot, q, start, end)
    refused = step.reason == PoseReason.OTHER_MODE
    if parts == 1 or not refused.any():
        return step
    part_q, reason = q[refused], np.zeros(np.count_nonzero(refused), dtype=np.uint8)
    offset = end[refused] - start[refused]
    for k in range(parts):
        reached = reason == PoseReason.REACHED  # after k parts
        if not reached.any():
            break
        part_start = start[refused][reached] + offset[reached] * (k / parts)
        part = _step_once(robot, part_q[reached], part_start, part_start + offset[reached] / parts)
        part_q[reached], reason[reached] = part.q, part.reason
    step.q[refused], step.reason[refused] = part_q, reason
    return step


def _step_once(robot: ParallelRobot, q: Array, start: Array, end: Array) -> StepEnds:
    """Continue configurations q (T, nq) from `start` to `end` (T, n) in one step.

    A step is accepted if its correction is small beside the prediction, and if it ends in the same working
    mode and on the same branch.
    """
    linearised = linearised_at(robot, q, start)
    start_twist, end_twist = (robot.platform.twist(x, end - start)[0] for x in (start, end))
    move = joint_rates(robot, linearised, start_twist, np.zeros((len(q), robot.n_e)))
    predicted = integrate(robot, q, move)
    corrected, end_linearised, closed = close_each(
        robot, end, predicted, iterations=NEWTON_STEPS, farthest=MAX_JOINT_STEP
    )
    reason = np.where(closed, PoseReason.OTHER_MODE, PoseReason.OPEN).astype(np.uint8)
    with np.errstate(invalid="ignore"):
        correction = np.abs(difference(robot, predicted, corrected) / robot.column_scale).max(axis=1)
        advance = np.abs(move / robot.column_scale).max(axis=1)
        is_near = closed & is_small(correction, advance)
        same_mode = np.flatnonzero(_keep_working_mode(robot, linearised, end_linearised, is_near))
        is_same_branch = _keep_branch(
            robot,
            end_linearised.select(same_mode),
            end_twist[same_mode],
            move[same_mode],
            correction[same_mode],
            advance[same_mode],
        )
    reason[same_mode[is_same_branch]] = PoseReason.REACHED
    return StepEnds(corrected, reason)


def _keep_working_mode(
    robot: ParallelRobot, start: LinearisedLoops, end: LinearisedLoops, candidates: BoolArray
) -> BoolArray:
    """Return the candidates (T,) of steps with one working mode at start and end.

    A determinant of one sign tells; else the modes themselves are compared.
    """
    has_same_sign = keeps_sign(start.factors.slogdet, end.factors.slogdet)
    is_kept = candidates.copy()
    for k in np.flatnonzero(candidates & ~has_same_sign).tolist():
        is_kept[k] = keeps_working_mode(robot, start.select(k), end.select(k))[0]
    return is_kept


def _keep_branch(
    robot: ParallelRobot, end: LinearisedLoops, twist: Array, move: Array, correction: Array, advance: Array
) -> BoolArray:
    """Return which of k steps end on the branch of their start, (k,).

    The tangent turns no more than the correction (k,) explains, beside the advance (k,), or no branches
    cross at the end. `move` (k, nv) is along the start's tangent, `twist` (k, n) that of the step at its end.
    """
    end_move = joint_rates(robot, end, twist, np.zeros((len(move), robot.n_e)))
    change = np.abs((end_move - move) / robot.column_scale).max(axis=1)
    is_same = is_straight(change, correction, advance)
    bent = np.flatnonzero(~is_same)
    is_same[bent] = count_lost_ranks(robot, end.select(bent), BRANCHES_CROSS) == 0
    return is_same
