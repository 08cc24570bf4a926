"""The singular locus for pictures: traced curves, or a patch of surface, about a pose of the robot.

For a platform with two translations the locus is drawn as curves over the workspace, with all other
coordinates fixed (see `trace_locus`). For three translations it is a coarse patch of surface about a singular
pose. All points of curves and patch are on the locus.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.errors import NotAssembled
from framework.kinematics.assembly import MAX_ITERATIONS, MAX_NEWTON_STEP
from framework.kinematics.inverse_kinematics import close_each
from framework.kinematics.linearised_loops import LinearisedLoops, linearised_at
from framework.kinematics.motion_rates import motor_speeds
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.singularity.traced_locus import REGION_REACH, trace_locus
from framework.singularity.type2 import has_signed_measure, measure_gradient
from framework.tolerances import NEWTON_STEP, SAME_PLACE


class LocusCurves(NamedTuple):
    """Curves of the locus over a plane of the workspace, in one working mode."""

    curves: list[Array]  # platform coordinates (m, 2) of the m points of each curve
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

    None unless the platform has exactly two translations and g has a sign: some joints are passive, and no
    motors are redundant.
    """
    translations = robot.platform.sliding.tolist()
    if len(translations) != 2 or not has_signed_measure(robot):
        return None
    traced = trace_locus(robot, q, one_mode=True, with_cusps=False)
    curves = [curve.x[:, translations] for curve in traced.curves if curve.kind != "joints_only"]
    first, second = translations
    return LocusCurves(curves, axes=(first, second), about=x.copy(), reach=REGION_REACH * robot.length)


def locus_patch(robot: ParallelRobot, q: Array, x: Array) -> Array | None:
    """Compute a patch (m, m, 3) [m] of the singular surface about a singular pose q (nq,), x (n,).

    A grid of m = `edge_points` by m points on the tangent plane, normal to the gradient of g, is moved along
    the normal onto g = 0 by Newton's method. The platform keeps its orientation. None unless the platform has
    exactly three translations and g has a sign; or if the grid does not reach the surface.
    """
    edge_points = 11  # along an edge of the patch
    half_edge = 0.12  # [robot lengths] half an edge of the patch
    translations = robot.platform.sliding
    if len(translations) != 3 or not has_signed_measure(robot):
        return None
    try:
        _, gradients = _measure_in_space(robot, linearised_at(robot, q[None]))
    except NotAssembled:  # also a Type 1 singularity, where the platform's motion determines no gradient
        return None
    # a grid on the tangent plane
    span = np.linspace(-half_edge, half_edge, edge_points) * robot.length  # [m]
    grid = np.stack(np.meshgrid(span, span, indexing="ij"), axis=-1).reshape(-1, 2)  # (m m, 2)
    unit_vectors = np.linalg.svd(gradients).Vh  # (3, 3) rows: the normal of the surface, then two tangents
    shifts = _move_onto_locus(robot, q, x, grid @ unit_vectors[1:], normal=unit_vectors[0])
    if shifts is None:
        return None
    return (x[translations] + shifts).reshape(edge_points, edge_points, 3)


def _move_onto_locus(robot: ParallelRobot, q: Array, x: Array, shifts: Array, normal: Array) -> Array | None:
    """Move points (T, 3) [m] along a normal (3,) onto the locus.

    None if the loops do not close somewhere, or the locus is farther away than `max_patch_height`.

    Args:
        q, x: configuration (nq,) and platform coordinates (n,) of a pose.
        shifts: the points (T, 3) [m], relative to the platform in this pose, as is the result.
    """
    # [robot lengths] distance from the tangent plane; a higher patch is not drawn
    max_patch_height = 0.2
    farthest = max_patch_height * robot.length
    height = np.zeros(len(shifts))  # [m] along the normal
    guess = np.tile(q, (len(shifts), 1))
    for _ in range(MAX_ITERATIONS):
        targets = np.tile(x, (len(shifts), 1))
        targets[:, robot.platform.sliding] += shifts + height[:, None] * normal
        stack = close_each(robot, targets, guess, farthest=MAX_NEWTON_STEP)
        if not stack.closed.all():
            return None
        g, gradients = _measure_in_space(robot, stack.linearised)
        step = g / (gradients @ normal)  # [m] Newton's step along the normal
        height -= step
        if not np.abs(height).max() < farthest:
            return None
        if np.abs(step).max() < NEWTON_STEP * robot.length:
            return shifts + height[:, None] * normal
    return None


def _measure_in_space(robot: ParallelRobot, linearised: LinearisedLoops) -> tuple[Array, Array]:
    """Compute g (T,), each with the border of its own P, and its gradients (T, 3) [1/m] in space.

    The gradient has the derivatives of g along the platform's three translations, other coordinates at rest.

    Raises:
        NotAssembled: the platform does not determine the joints.
    """
    measure = measure_gradient(robot, linearised)
    _, motions = motor_speeds(robot, linearised)  # (T, nv, n) of all joints for unit velocities
    return measure.G[:, 0, 0], np.vecmat(measure.G_by_q[:, 0, 0], motions)[:, robot.platform.sliding]
