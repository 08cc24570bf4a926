"""The singular locus to be drawn: traced curves, or a patch of surface, about a pose of the robot.

A robot whose platform has two free translations gets curves over its workspace (all its other coordinates
held), see `trace_locus`; one with three a patch of surface about a singular instant, as coarse as a picture
may be, with its points pulled onto the locus itself.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from framework.kinematics.inverse_kinematics import close_each
from framework.kinematics.loop_matrices import type2_matrix
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.singularity.traced_locus import REGION_REACH, trace_locus
from framework.singularity.type2 import has_signed_measure
from framework.tolerances import SAME_PLACE

NEWTON_STEPS = 10  # Newton steps to a neighbouring point
MAX_JOINT_STEP = 0.5  # [rad, lengths] that a step may move a joint by
PATCH_POINTS = 11  # points along an edge of the patch
PATCH_SIZE = 0.12  # half an edge of the patch, in lengths of the robot
MAX_PATCH_HEIGHT = 0.2  # [robot lengths] over its plane: a steeper patch is left out
DIFFERENCE_STEP = 1e-4  # [robot lengths] for the slope of g
SECANT_STEPS, MIN_SECANT_STEP = 5, 1e-9  # of points pulled onto the locus; over the largest height


class LocusCurves(NamedTuple):
    """Curves of the locus over a plane of the workspace, in one working mode."""

    curves: list[Array]  # (m, 2) platform coordinates each
    axes: tuple[int, int]  # which platform coordinates
    about: Array  # (n,) platform coordinates of the centre; those not among `axes` are held
    reach: float  # [m] half an edge of the square that was searched

    def serves(self, x: Array) -> bool:
        """Whether the curves are valid for x (T, n): same fixed coordinates, well inside the square."""
        offset = np.abs(x - self.about)
        fixed = np.delete(offset, self.axes, axis=1)
        is_same = fixed.max(initial=0.0) < SAME_PLACE * self.reach
        return bool(is_same and offset[:, self.axes].max() < 0.5 * self.reach)


def locus_curves(robot: ParallelRobot, q: Array, x: Array) -> LocusCurves | None:
    """Trace the locus about a configuration q (nq,) in its working mode.

    x (n,) is the platform there. None for a robot without exactly two translations, without passive joints,
    or with redundant motors (whose g has no sign).
    """
    straight = robot.platform.sliding.tolist()
    if len(straight) != 2 or not has_signed_measure(robot):
        return None
    traced = trace_locus(robot, q, one_mode=True)
    return LocusCurves(
        curves=[curve.x[:, straight] for curve in traced.curves if curve.kind != "joints_only"],
        axes=(straight[0], straight[1]),
        about=x.copy(),
        reach=REGION_REACH * robot.length,
    )


def locus_patch(robot: ParallelRobot, q: Array, x: Array) -> Array | None:
    """Compute the singular surface (m, m, 3) [m], m = PATCH_POINTS, about a singular pose q (nq,), x (n,).

    A grid on the tangent plane, normal to the gradient of det P, is pulled along the normal onto det P = 0;
    the platform keeps its orientation. None for a robot without exactly three translations, or where the
    surface cannot be followed.
    """
    translations = robot.platform.sliding
    if len(translations) != 3 or not has_signed_measure(robot):
        return None
    measure = partial(_shifted_determinants, robot, q, x)
    step = DIFFERENCE_STEP * robot.length
    slope = (measure(step * np.eye(3)) - measure(-step * np.eye(3))) / (2 * step)  # (3,) along the axes
    size = float(np.linalg.norm(slope))
    if not (np.isfinite(size) and size > 0):
        return None
    normal = slope / size
    span = np.linspace(-PATCH_SIZE, PATCH_SIZE, PATCH_POINTS) * robot.length
    grid = np.stack(np.meshgrid(span, span, indexing="ij"), axis=-1).reshape(-1, 2)
    plane = grid @ np.linalg.svd(normal[None])[2][1:]  # (m m, 3) normal to the first singular vector
    points = _pull_onto(measure, plane, normal, size, MAX_PATCH_HEIGHT * robot.length)
    if np.isnan(points).any():
        return None
    return (points + x[translations]).reshape(PATCH_POINTS, PATCH_POINTS, 3)


def _shifted_determinants(robot: ParallelRobot, q: Array, x: Array, shifts: Array) -> Array:
    """Compute det P (T,) at shifts (T, 3) of the platform.

    NaN where the loops do not close. The determinant changes its sign where g does, and needs no border.
    """
    targets = np.repeat(x[None], len(shifts), axis=0)
    targets[:, robot.platform.sliding] += shifts
    guess = np.repeat(q[None], len(shifts), axis=0)
    stack = close_each(robot, targets, guess, iterations=NEWTON_STEPS, farthest=MAX_JOINT_STEP)
    return np.where(stack.closed, np.linalg.det(type2_matrix(robot, stack.linearised)), np.nan)


def _pull_onto(
    measure: Callable[[Array], Array], start: Array, normal: Array, slope: float, farthest: float
) -> Array:
    """Move points (T, k) along a normal (k,) to zeros of a measure, by the secant method.

    `slope` is the measure's first slope along the normal. NaN for a point that would have to go farther than
    `farthest`, or whose loops do not close.
    """
    height, value = np.zeros(len(start)), measure(start)
    rate = np.full(len(start), slope)  # of the measure along the normal
    for _ in range(SECANT_STEPS):
        step = np.clip(-value / rate, -0.2 * farthest, 0.2 * farthest)
        step = np.where(np.isfinite(step), step, 0.0)
        height = height + step
        new_value = measure(start + height[:, None] * normal)
        is_step = np.abs(step) > MIN_SECANT_STEP * farthest
        rate = np.where(is_step, (new_value - value) / np.where(is_step, step, 1.0), rate)
        value = new_value
    is_found = np.isfinite(value) & (np.abs(height) < farthest)
    return np.where(is_found[:, None], start + height[:, None] * normal, np.nan)
