"""The turning point in which a branch ends at a singularity, by a direct root.

While the motors turn, or the platform goes along its path, the loop equations F(y, s) = 0 draw a curve in the
joints y that follow and the share s of the way. It is smooth where M = dF/dy loses rank as long as the way
drives what escapes there: only s turns back. So the curve is followed by t = c . y, c along its tangent at
the start, and

    [M  b] [dy/dt]   [0]
    [c' 0] [ds/dt] = [1],    b = dF/ds,

whose last number is the bordered measure of singularity with b as its border (Govaerts 2000, chapter 3): the
slope of s, positive up to the turning point and zero there. Its root is found by secants in t, each with a
Newton step back to the curve; to first order in t the slope is a line, so a few are enough.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray, IntArray
from framework.kinematics.frames import difference, integrate
from framework.kinematics.linearised_loops import LinearisedLoops
from framework.kinematics.parallel_robot import ParallelRobot
from framework.linalg.ordered_sums import solve
from framework.tolerances import NEWTON_STEP

MAX_BEND, MAX_SKEW = 0.1, 0.25  # of the chord and of the parameter's gain: what a parabola may miss
FIRST_SECANT_LENGTH = 1e-3  # [rad, lengths] along the curve, for the first slope of the slope
MAX_ARC_LENGTH = 2.0  # [rad, lengths] by all joints together: what lies farther is for a nearer start
MAX_SECANTS = 12


class CurveEquations(NamedTuple):
    """F and its derivatives at T places, without dimension (radians, lengths of the robot)."""

    matrix: Array  # (T, k, k) M
    drive: Array  # (T, k) b
    residual: Array  # (T, k)
    linearised: LinearisedLoops  # what they are made of


class TurningPoints(NamedTuple):
    """The turning points of T ways; where none is `found` the other values mean nothing."""

    found: BoolArray  # (T,)
    share: Array  # (T,) of the way
    q: Array  # (T, nq)
    linearised: LinearisedLoops  # the equations there


def turning_points(
    robot: ParallelRobot,
    q: Array,
    share: Array,
    columns: IntArray,
    turn: Array,
    evaluate: Callable[[Array, Array], CurveEquations],
) -> TurningPoints:
    """Find the turning points ahead of configurations q (T, nq), each after a `share` (T,) of its way.

    Only such are found as are proved to end the way: between there and q the curve is nearly a parabola.

    Args:
        columns: the joints (k,) that follow.
        turn: (T, nv) by how much the others move on the whole way.
        evaluate: F at configurations (T, nq) and shares (T,), outside [0, 1] as well while it is searched.
    """
    scale, count = robot.column_scale, len(q)
    border = np.zeros((count, len(columns)))

    def moved(step: Array) -> Array:
        """Compute joint motions (T, nv) of steps along the curve (T, k + 1)."""
        motion = step[:, -1:] * turn
        motion[:, columns] = step[:, :-1] * scale[columns]
        return motion

    def steps_at(q: Array, share: Array) -> tuple[Array, Array, LinearisedLoops]:
        """Compute Newton's step back to the curve, across c, and the tangent by t, each (T, k + 1)."""
        F = evaluate(q, share)
        if not border.any():
            border[:] = solve(F.matrix, -F.drive)
            border[:] /= np.linalg.norm(border, axis=1, keepdims=True)
        whole = np.zeros((count, len(columns) + 1, len(columns) + 1))
        whole[:, :-1, :-1], whole[:, :-1, -1], whole[:, -1, :-1] = F.matrix, F.drive, border
        right = np.zeros((2, count, len(columns) + 1))
        right[0, :, :-1], right[1, :, -1] = -F.residual, 1.0
        return solve(whole, right[0]), solve(whole, right[1]), F.linearised

    with np.errstate(all="ignore"):  # what has no turning point ahead runs away, and is not found
        back, first, _ = steps_at(q, share)
        along, at, reached, t = first, q, share, np.zeros(count)
        step, closed = np.full(count, FIRST_SECANT_LENGTH), np.zeros(count, dtype=bool)
        for _ in range(MAX_SECANTS):
            move = back + step[:, None] * along
            lost = ~((np.abs(t + step) < MAX_ARC_LENGTH) & np.isfinite(move).all(axis=1))
            move = np.where((closed | lost)[:, None], 0.0, move)
            at, reached = integrate(robot, at, moved(move)), reached + move[:, -1]
            t = t + np.where(closed | lost, 0.0, step)
            closed |= ~lost & (np.abs(move).max(axis=1) < NEWTON_STEP)
            before = along[:, -1]
            back, along, linearised = steps_at(at, reached)
            if (closed | lost).all():
                break
            step = -step * along[:, -1] / (along[:, -1] - before)
        gain = 0.5 * t * first[:, -1]
        travelled = t[:, None] * moved(first)
        bent = difference(robot, q, at) - 0.5 * (travelled + t[:, None] * moved(along))
        bent, length = (np.abs(motion / scale).max(axis=1) for motion in (bent, travelled))
        found = closed & (t > 0) & (reached < 1.0) & (bent <= MAX_BEND * length)
        found &= np.abs(reached - share - gain) <= MAX_SKEW * gain
    return TurningPoints(found, reached, at, linearised)
