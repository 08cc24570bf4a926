"""The singular locus for pictures: traced curves, or a patch of surface, about a pose of the robot.

For a platform with two translations the locus is drawn as curves over the workspace, with all other
coordinates fixed (see `trace_locus`). For three translations it is a coarse patch of surface about a singular
pose; all points of the patch are on the locus.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from framework.kinematics.inverse_kinematics import close_each
from framework.kinematics.linearised_loops import type2_matrix
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.singularity.traced_locus import REGION_REACH, trace_locus
from framework.singularity.type2 import has_signed_measure
from framework.tolerances import SAME_PLACE

NEWTON_STEPS = 10  # number of steps to a neighbouring point
MAX_JOINT_STEP = 0.5  # [rad, lengths] largest joint motion in a Newton step
PATCH_POINTS = 11  # number of points along an edge of the patch
PATCH_SIZE = 0.12  # [robot lengths] half an edge of the patch
MAX_PATCH_HEIGHT = 0.2  # [robot lengths] distance from the tangent plane; a higher patch is not drawn
DIFFERENCE_STEP = 1e-4  # [robot lengths] for the slope of det P
# Number of secant steps; share of the largest height below which a step does not update the slope.
SECANT_STEPS, MIN_SECANT_STEP = 5, 1e-9


class LocusCurves(NamedTuple):
    """Curves of the locus over a plane of the workspace, in one working mode."""

    curves: list[Array]  # (m, 2) platform coordinates each
    axes: tuple[int, int]  # indices of the two platform coordinates
    about: Array  # (n,) platform coordinates of the centre; all but `axes` are fixed
    reach: float  # [m] half an edge of the square that was searched

    def covers(self, x: Array) -> bool:
        """Return whether the curves are valid for x (T, n).

        The fixed coordinates must agree, and the others must be well inside the square.
        """
        offset = np.abs(x - self.about)
        fixed_offset = np.delete(offset, self.axes, axis=1)
        is_same_slice = fixed_offset.max(initial=0.0) < SAME_PLACE * self.reach
        return bool(is_same_slice and offset[:, self.axes].max() < 0.5 * self.reach)


def locus_curves(robot: ParallelRobot, q: Array, x: Array) -> LocusCurves | None:
    """Trace the locus about a configuration q (nq,), x (n,) in its working mode.

    None unless the platform has exactly two translations and g has a sign, see `has_signed_measure`.
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

    A grid of m = PATCH_POINTS by m points on the tangent plane, normal to the gradient of det P, is moved
    along the normal onto det P = 0. The platform keeps its orientation. None unless the platform has exactly
    three translations and g has a sign, or if the grid does not reach the surface.
    """
    translations = robot.platform.sliding
    if len(translations) != 3 or not has_signed_measure(robot):
        return None
    measure = partial(_shifted_determinants, robot, q, x)
    step = DIFFERENCE_STEP * robot.length
    steps = step * np.eye(3)  # along each axis
    gradient = (measure(steps) - measure(-steps)) / (2 * step)  # (3,) of det P
    slope = float(np.linalg.norm(gradient))  # of det P along the normal
    if not (np.isfinite(slope) and slope > 0):
        return None
    normal = gradient / slope
    span = np.linspace(-PATCH_SIZE, PATCH_SIZE, PATCH_POINTS) * robot.length
    grid = np.stack(np.meshgrid(span, span, indexing="ij"), axis=-1).reshape(-1, 2)
    tangents = np.linalg.svd(normal[None]).Vh[1:]  # (2, 3) unit vectors; the normal comes first
    plane = grid @ tangents  # (m m, 3)
    points = _move_to_zeros(measure, plane, normal, slope, MAX_PATCH_HEIGHT * robot.length)
    if np.isnan(points).any():
        return None
    return (points + x[translations]).reshape(PATCH_POINTS, PATCH_POINTS, 3)


def _shifted_determinants(robot: ParallelRobot, q: Array, x: Array, shifts: Array) -> Array:
    """Compute det P (T,) at shifts (T, 3) [m] of the platform, NaN where the loops do not close.

    The determinant changes its sign where g does, and needs no border.

    Args:
        q: configuration (nq,) from which Newton's method starts.
        x: platform coordinates (n,) that are shifted.
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

    Args:
        measure: computes the measure (T,) at points (T, k).
        slope: first estimate of the measure's slope along the normal.
        farthest: largest distance from `start`.

    Returns:
        The points (T, k), NaN where a zero is farther away than `farthest` or the measure is NaN.
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
        is_long = np.abs(step) > MIN_SECANT_STEP * farthest  # the slope of a short step would be rounding
        slopes[is_long] = (value - last_value)[is_long] / step[is_long]
    is_zero = np.isfinite(value) & (np.abs(height) < farthest)
    return np.where(is_zero[:, None], start + height[:, None] * normal, np.nan)
