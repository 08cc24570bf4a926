"""The singular locus for pictures: traced curves, or a patch of surface, about a pose of the robot.

A robot whose platform has two translations gets curves over its workspace, all other coordinates fixed (see
`trace_locus`). A robot with three gets a coarse patch of surface about a singular pose, with all points on
the locus.
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

NEWTON_STEPS = 10  # to a neighbouring point
MAX_JOINT_STEP = 0.5  # [rad, lengths] largest joint motion in a Newton step
PATCH_POINTS = 11  # along an edge of the patch
PATCH_SIZE = 0.12  # [robot lengths] half an edge of the patch
MAX_PATCH_HEIGHT = 0.2  # [robot lengths] over the tangent plane; a higher patch is not drawn
DIFFERENCE_STEP = 1e-4  # [robot lengths] for the slope of det P
SECANT_STEPS, MIN_SECANT_STEP = 5, 1e-9  # least step, over the largest height, that updates the slope


class LocusCurves(NamedTuple):
    """Curves of the locus over a plane of the workspace, in one working mode."""

    curves: list[Array]  # (m, 2) platform coordinates each
    axes: tuple[int, int]  # indices of the two platform coordinates
    about: Array  # (n,) platform coordinates of the centre; those not among `axes` are fixed
    reach: float  # [m] half an edge of the square that was searched

    def serves(self, x: Array) -> bool:
        """Return whether the curves are valid for x (T, n).

        The fixed coordinates must be the same, and the others well inside the square.
        """
        offset = np.abs(x - self.about)
        fixed = np.delete(offset, self.axes, axis=1)
        is_same = fixed.max(initial=0.0) < SAME_PLACE * self.reach
        return bool(is_same and offset[:, self.axes].max() < 0.5 * self.reach)


def locus_curves(robot: ParallelRobot, q: Array, x: Array) -> LocusCurves | None:
    """Trace the locus about a configuration q (nq,), x (n,) in its working mode.

    None for a robot without exactly two translations, without passive joints, or with redundant motors (whose
    g has no sign).
    """
    translations = robot.platform.sliding.tolist()
    if len(translations) != 2 or not has_signed_measure(robot):
        return None
    traced = trace_locus(robot, q, one_mode=True)
    curves = [curve.x[:, translations] for curve in traced.curves if curve.kind != "joints_only"]
    first, second = translations
    return LocusCurves(curves, axes=(first, second), about=x.copy(), reach=REGION_REACH * robot.length)


def locus_patch(robot: ParallelRobot, q: Array, x: Array) -> Array | None:
    """Compute a patch (m, m, 3) [m] of the singular surface about a singular pose q (nq,), x (n,).

    A grid of m = PATCH_POINTS on the tangent plane, normal to the gradient of det P, is moved along the
    normal onto det P = 0; the platform keeps its orientation. None for a robot without exactly three
    translations, or if the surface cannot be reached.
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
    points = _move_to_zeros(measure, plane, normal, size, MAX_PATCH_HEIGHT * robot.length)
    if np.isnan(points).any():
        return None
    return (points + x[translations]).reshape(PATCH_POINTS, PATCH_POINTS, 3)


def _shifted_determinants(robot: ParallelRobot, q: Array, x: Array, shifts: Array) -> Array:
    """Compute det P (T,) at shifts (T, 3) of the platform, NaN where the loops do not close.

    The determinant changes its sign where g does, and needs no border.
    """
    targets = np.tile(x, (len(shifts), 1))
    targets[:, robot.platform.sliding] += shifts
    guess = np.tile(q, (len(shifts), 1))
    stack = close_each(robot, targets, guess, iterations=NEWTON_STEPS, farthest=MAX_JOINT_STEP)
    return np.where(stack.closed, np.linalg.det(type2_matrix(robot, stack.linearised)), np.nan)


def _move_to_zeros(
    measure: Callable[[Array], Array], start: Array, normal: Array, slope: float, farthest: float
) -> Array:
    """Move points (T, k) along a normal (k,) to zeros of a measure by the secant method.

    `slope` is the first slope of the measure along the normal. The result is NaN for a point farther away
    than `farthest`, or where the measure is NaN.
    """
    height = np.zeros(len(start))
    value = measure(start)
    slopes = np.full(len(start), slope)
    for _ in range(SECANT_STEPS):
        step = np.clip(-value / slopes, -0.2 * farthest, 0.2 * farthest)
        step[np.isnan(step)] = 0.0
        height += step
        last_value = value
        value = measure(start + height[:, None] * normal)
        is_long = np.abs(step) > MIN_SECANT_STEP * farthest
        slopes[is_long] = (value - last_value)[is_long] / step[is_long]
    is_zero = np.isfinite(value) & (np.abs(height) < farthest)
    return np.where(is_zero[:, None], start + height[:, None] * normal, np.nan)
