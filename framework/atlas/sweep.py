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
from framework.kinematics.closures import scaled
from framework.kinematics.continuation.predictor_corrector import is_small
from framework.kinematics.frames import difference, integrate
from framework.kinematics.inverse_kinematics import close_each
from framework.kinematics.linearised_loops import LinearisedLoops, linearised_at
from framework.kinematics.modes import keeps_working_mode
from framework.kinematics.motion_rates import joint_rates
from framework.kinematics.parallel_robot import ParallelRobot
from framework.tolerances import BRANCH_TURN, BRANCHES_CROSS, DETERMINANT_LOST

NEWTON_STEPS = 10  # Newton steps to a neighbour; a step along the tangent that needs more is no good one
MAX_JOINT_STEP = 0.5  # [rad, lengths] that such a step may move a joint by
ReasonArray = NDArray[np.uint8]
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
        targets = np.zeros(reason.shape, dtype=bool)
        sources = np.zeros((*reason.shape, 2), dtype=np.intp)
        for k, (down, right) in enumerate(DIRECTIONS):
            reachable = _shifted(filled, down, right) & unfilled & ~filled & untried[k] & ~targets
            untried[k] &= ~reachable
            targets |= reachable
            sources[reachable] = np.argwhere(reachable) - (down, right)
        if not targets.any():
            return
        to, (i, j) = np.nonzero(targets), sources[targets].T
        step = stepped(robot, q[i, j], x[i, j], x[to], parts)
        reached = step.reason == PoseReason.REACHED
        q[to] = np.where(reached[:, None], step.q, np.nan)
        reason[to] = np.where(reached, PoseReason.REACHED, np.maximum(reason[to], step.reason))


def _shifted(mask: BoolArray, down: int, right: int) -> BoolArray:
    """Whether the neighbour at -(down, right) is known."""
    shifted = np.zeros_like(mask)
    inner = tuple(slice(max(k, 0), min(k, 0) or None) for k in (down, right))
    outer = tuple(slice(max(-k, 0), min(-k, 0) or None) for k in (down, right))
    shifted[inner] = mask[outer]
    return shifted


def stepped(robot: ParallelRobot, q: Array, start: Array, end: Array, parts: int = 1) -> StepEnds:
    """Assemble configurations at platform coordinates `end` (T, n), from q (T, nq) at `start` (T, n).

    What is refused in one step is tried in `parts`.
    """
    step = _one_step(robot, q, start, end)
    again = step.reason == PoseReason.OTHER_MODE
    if parts == 1 or not again.any():
        return step
    here, reason = q[again], np.zeros(np.count_nonzero(again), dtype=np.uint8)
    way = end[again] - start[again]
    for k in range(parts):
        good = reason == PoseReason.REACHED
        if not good.any():
            break
        at = start[again][good] + way[good] * (k / parts)
        part = _one_step(robot, here[good], at, at + way[good] / parts)
        here[good], reason[good] = part.q, part.reason
    step.q[again], step.reason[again] = here, reason
    return step


def _one_step(robot: ParallelRobot, q: Array, start: Array, end: Array) -> StepEnds:
    lengths, still = robot.column_scale, np.zeros((len(q), robot.n_e))
    before = linearised_at(robot, q, start)
    twist, _ = robot.platform.twist(start, end - start)
    move = joint_rates(robot, before, twist, still)
    ahead = integrate(robot, q, move)
    there, after, closed = close_each(robot, end, ahead, iterations=NEWTON_STEPS, farthest=MAX_JOINT_STEP)
    with np.errstate(invalid="ignore"):
        correction = np.abs(_between(robot, ahead, there) / lengths).max(axis=1)
        advance = np.abs(move / lengths).max(axis=1)
        near = closed & is_small(correction, advance)
        kept = near.copy()
        kept[near] = _same_branch(robot, before, after, end, twist, move, correction, advance, near)
    reason = np.where(closed, np.where(kept, PoseReason.REACHED, PoseReason.OTHER_MODE), PoseReason.OPEN)
    return StepEnds(there, reason.astype(np.uint8))


def _same_branch(
    robot: ParallelRobot,
    before: LinearisedLoops,
    after: LinearisedLoops,
    end: Array,
    twist: Array,
    move: Array,
    correction: Array,
    advance: Array,
    which: BoolArray,
) -> BoolArray:
    """Whether steps end on the branch of their start, for `which` (T,) of them."""
    places = np.flatnonzero(which)
    (sign_one, size_one), (sign_two, size_two) = before.factors.slogdet, after.factors.slogdet
    sure = (sign_one == sign_two) & (size_two - size_one > np.log(DETERMINANT_LOST))
    kept = [
        bool(sure[k]) or keeps_working_mode(robot, before.at(int(k)), after.at(int(k)))[0] for k in places
    ]
    same = np.array(kept, dtype=np.bool_)
    places = places[same]
    # where branches cross, the tangent turns by more than the correction of one branch tells
    twist, _ = robot.platform.twist(end, twist)
    some = after.at(places)
    turned = joint_rates(robot, some, twist[places], np.zeros((len(places), robot.n_e))) - move[places]
    turned = np.abs(turned / robot.column_scale).max(axis=1)
    bent = turned > BRANCH_TURN * correction[places] + 0.25 * advance[places]
    if bent.any():
        loops = scaled(robot, after.at(places[bent]).closures, robot.loops.rotation)[:, :, robot.moving]
        values = np.linalg.svd(loops, compute_uv=False)
        crossing = values[:, -1] < BRANCHES_CROSS * np.maximum(values[:, 0], 1.0)
        same[np.flatnonzero(same)[bent]] = ~crossing
    return same


def _between(robot: ParallelRobot, one: Array, two: Array) -> Array:
    """Return tangent vectors (T, nv) from configurations to others, each (T, nq)."""
    if robot.model.nq == robot.model.nv:
        return two - one
    return np.concatenate([difference(robot, a, b[None]) for a, b in zip(one, two, strict=True)])
