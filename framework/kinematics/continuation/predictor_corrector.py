"""Tests of steps from pose to pose: whether a predicted and corrected step stays on its branch.

In a step the platform follows a path (`tracking`) or a grid (`atlas.sweep`). A step along the tangent is
accepted if its correction is small compared with the step and its end is on the same branch.
Otherwise the step is halved. A branch may end on a singularity, at a turning point: see `arclength`.
"""

from __future__ import annotations

import numpy as np

from framework.kinematics.frames import largest_motion
from framework.kinematics.linearised_loops import LinearisedLoops, count_lost_ranks
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, BoolArray
from framework.tolerances import BRANCH_CORRECTION, BRANCH_STEP_SHARE, BRANCH_TURN, BRANCHES_CROSS

MAX_PREDICTOR_MOVE = 1.0  # [rad, lengths] of a joint in a step; near a singularity tangents lead far away


def accept_steps(
    robot: ParallelRobot,
    correction: Array,
    predicted: Array,
    end_step: Array,
    *,
    keeps_mode: BoolArray,
    ends: LinearisedLoops,
) -> tuple[BoolArray, Array]:
    """Decide which of T steps stay on their branches.

    An accepted step has a small correction and keeps its mode. Its tangent turns little from start to end, or
    else no other branch crosses at the end, to which the step could have jumped.

    Args:
        correction: (T, nv) offsets from the predicted to the closed configurations.
        predicted: (T, nv) steps along the tangents at the starts.
        end_step: (T, nv) steps of the same parameter lengths along the tangents at the ends.
        keeps_mode: (T,) whether both ends are in one mode.
        ends: the loops at the ends of the steps. Branches cross only where the loops nearly lose rank.

    Returns:
        Whether each step is accepted, and the largest entries of the corrections [rad, lengths], (T,) each.
    """
    corrected, advance = largest_motion(robot, correction), largest_motion(robot, predicted)
    turned = largest_motion(robot, end_step - predicted)
    is_accepted = keeps_mode & is_small(corrected, advance)
    (curved,) = (is_accepted & ~is_straight(turned, corrected, advance)).nonzero()
    if len(curved):
        is_accepted[curved] = count_lost_ranks(robot, ends.select(curved), BRANCHES_CROSS) == 0
    return is_accepted, corrected


def is_small(correction: Array, advance: Array) -> BoolArray:
    """Return which `correction` (T,) of a step by `advance` (T,) [rad, lengths] is small enough."""
    allowed = np.maximum(BRANCH_CORRECTION, BRANCH_STEP_SHARE * advance)
    return (correction <= allowed) & (advance <= MAX_PREDICTOR_MOVE)


def is_straight(turned: Array, correction: Array, advance: Array) -> BoolArray:
    """Return along which steps the tangent turns so little that both ends are on one branch, (T,).

    All arguments are largest motions of a joint [rad, lengths].

    Args:
        turned: (T,) difference of the step along the tangent at the end from that at the start.
        correction: (T,) correction of the step.
        advance: (T,) length of the step.
    """
    return turned <= BRANCH_TURN * correction + BRANCH_STEP_SHARE * advance
