"""Tests of steps from pose to pose: whether a predicted and corrected step stays on its branch.

In a step the platform follows a path (`tracking`), or the motors turn (`motor_curves`). A step along the
tangent is accepted if its correction is small compared with the step and its end is on the same branch.
Otherwise the step is halved. A branch may end on a singularity, at a turning point: see `arclength`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.kinematics.frames import largest_motion
from framework.kinematics.mechanism import Mechanism
from framework.numerics.arrays import LEAST_DIVISOR, Array, BoolArray
from framework.tolerances import BRANCH_CORRECTION, BRANCH_STEP_SHARE, BRANCH_TURN

MIN_STEP_RATIO = 1e-7  # share of the curve; if a step shorter than this is refused, the branch has ended
MAX_PREDICTOR_MOVE = 1.0  # [rad, lengths] of a joint in a step; near a singularity tangents lead far away
FIRST_STEP_RATIO = 1 / 8  # share of the curve
BRANCH_GROWTH = 0.2 * BRANCH_CORRECTION  # [rad, lengths] after a smaller correction the step is doubled
MAX_STEP_RATIO = 2 * FIRST_STEP_RATIO  # share of the curve in the largest step


class StepMeasure(NamedTuple):
    """Measures of T steps that tell whether each stayed on its branch."""

    correction: Array  # (T,) [rad, lengths] by which the predictor was corrected
    small: BoolArray  # (T,) whether the correction is small, absolutely or compared with the step
    straight: BoolArray  # (T,) whether the tangent has turned no more than a single branch allows


def measure_steps(robot: Mechanism, correction: Array, predicted: Array, end_step: Array) -> StepMeasure:
    """Measure whether T steps stayed on their branches.

    Args:
        correction: (T, nv) offsets from the predicted to the closed configurations.
        predicted: (T, nv) steps along the tangents at the starts.
        end_step: (T, nv) steps of the same parameter lengths along the tangents at the ends.
    """
    corrected, advance = largest_motion(robot, correction), largest_motion(robot, predicted)
    turned = largest_motion(robot, end_step - predicted)
    return StepMeasure(
        correction=corrected,
        small=is_small(corrected, advance),
        straight=is_straight(turned, corrected, advance),
    )


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


def limit_steps(robot: Mechanism, rate: Array, step: Array) -> Array:
    """Cut each parameter `step` (T,) to `MAX_PREDICTOR_MOVE` of a joint at the `rate` (T, nv)."""
    speed = largest_motion(robot, rate)
    longest = 0.99 * MAX_PREDICTOR_MOVE / np.maximum(speed, LEAST_DIVISOR)  # 0.99 leaves room for rounding
    return np.where(step * speed > MAX_PREDICTOR_MOVE, longest, step)
