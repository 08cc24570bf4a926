"""The turning point in which a branch ends at a singularity, by a direct root.

While the motors turn, or the platform follows its path, the loop equations F(y, s) = 0 define a curve in the
joints y that follow and the share s of the way. It is smooth where M = dF/dy loses rank if the way drives the
escaping motion: only s turns back. So the curve is followed by t = c . y, c along its tangent at the start,
and

    [M  b] [dy/dt]   [0]
    [c' 0] [ds/dt] = [1],    b = dF/ds,

whose last number is the bordered measure of singularity with b as its border (Govaerts 2000, chapter 3): the
slope of s, positive up to the turning point and zero there. Its root is found by secants in t, each with a
Newton step back to the curve; to first order in t the slope is a line, so a few are enough.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.kinematics.frames import difference, integrate, largest_motion
from framework.kinematics.linearised_loops import LinearisedLoops
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, BoolArray, IntArray
from framework.numerics.ordered_sums import solve
from framework.tolerances import NEWTON_STEP

MAX_BEND, MAX_SKEW = 0.1, 0.25  # deviations from a parabola, of the chord and of the parameter's gain
FIRST_SECANT_LENGTH = 1e-3  # [rad, lengths] along the curve, for the first slope of the slope
MAX_ARC_LENGTH = 2.0  # [rad, lengths] by all joints together: a farther end is for a nearer start
MAX_SECANTS = 12


class CurveEquations(NamedTuple):
    """F and its derivatives at T places, without dimension (radians, lengths of the robot)."""

    matrix: Array  # (T, k, k) M
    drive: Array  # (T, k) b
    residual: Array  # (T, k)
    linearised: LinearisedLoops  # the same with dimensions


class TurningPoints(NamedTuple):
    """The turning points of T ways; the other values of a way without one mean nothing."""

    found: BoolArray  # (T,)
    share: Array  # (T,) of the way
    q: Array  # (T, nq)
    linearised: LinearisedLoops  # the equations there


@dataclass(frozen=True, eq=False)
class Curves:
    """The curves F(y, s) = 0 of T ways, with the tangents c at their starts."""

    robot: ParallelRobot
    columns: IntArray  # (k,) of the joints that follow
    turn: Array  # (T, nv) of the other joints on the whole way
    evaluate: Callable[[Array, Array], CurveEquations]

    def joint_motions(self, step: Array) -> Array:
        """Compute joint motions (T, nv) of steps (T, k + 1) in y and s."""
        motion = step[:, -1:] * self.turn
        motion[:, self.columns] = step[:, :-1] * self.robot.column_scale[self.columns]
        return motion

    def follow_to_turn(self, q: Array, share: Array) -> _CurveEnd:
        """Follow the curves from q (T, nq) after shares (T,) by secants to where the slope of s is zero.

        t is the length along c that each curve has gone. A curve that is at its end, or that has gone too
        far, rests while the others go on.
        """
        equations = self.evaluate(q, share)
        border = solve(equations.matrix, -equations.drive)  # dy/ds at the start
        border = border / np.linalg.norm(border, axis=1, keepdims=True)  # c
        correction, tangent = _steps(equations, border)
        first_tangent = tangent
        t, step = np.zeros(len(q)), np.full(len(q), FIRST_SECANT_LENGTH)
        closed = np.zeros(len(q), dtype=bool)
        for _ in range(MAX_SECANTS):
            move = correction + step[:, None] * tangent  # (T, k + 1) back to the curve, and along
            lost = ~((np.abs(t + step) < MAX_ARC_LENGTH) & np.isfinite(move).all(axis=1))
            rests = closed | lost
            move = np.where(rests[:, None], 0.0, move)
            q = integrate(self.robot, q, self.joint_motions(move))
            share = share + move[:, -1]
            t = t + np.where(rests, 0.0, step)
            closed |= ~lost & (np.abs(move).max(axis=1) < NEWTON_STEP)
            slope = tangent[:, -1]  # ds/dt before the move
            equations = self.evaluate(q, share)
            correction, tangent = _steps(equations, border)
            if (closed | lost).all():
                break
            step = -step * tangent[:, -1] / (tangent[:, -1] - slope)  # the secant's zero of ds/dt
        return _CurveEnd(closed & (t > 0), q, share, t, first_tangent, tangent, equations.linearised)


class _CurveEnd(NamedTuple):
    """The ends of T curves."""

    closed: BoolArray  # (T,) whether it was found ahead of the start
    q: Array  # (T, nq)
    share: Array  # (T,)
    t: Array  # (T,) length along the curve [rad, lengths]
    first: Array  # (T, k + 1) tangent at the start
    last: Array  # (T, k + 1) tangent at the end
    linearised: LinearisedLoops


def _steps(equations: CurveEquations, border: Array) -> tuple[Array, Array]:
    """Compute Newton's step back to the curve, across c, and the tangent by t, each (T, k + 1)."""
    count, size = border.shape
    bordered = np.zeros((count, size + 1, size + 1))
    bordered[:, :-1, :-1] = equations.matrix
    bordered[:, :-1, -1] = equations.drive
    bordered[:, -1, :-1] = border
    newton, along = np.zeros((2, count, size + 1))
    newton[:, :-1] = -equations.residual
    along[:, -1] = 1.0
    return solve(bordered, newton), solve(bordered, along)


def turning_points(curves: Curves, q: Array, share: Array) -> TurningPoints:
    """Find the turning points ahead of configurations q (T, nq), each after a `share` (T,) of its way.

    A turning point is found only if the curve from q to it is nearly a parabola, which turns there alone.
    """
    robot = curves.robot
    with np.errstate(all="ignore"):  # a curve without a turning point ahead diverges, and is not found
        end = curves.follow_to_turn(q, share)
        first = end.t[:, None] * curves.joint_motions(end.first)  # (T, nv) what the tangents predict
        last = end.t[:, None] * curves.joint_motions(end.last)
        # a parabola goes half of each, and its share gains half of what the first tangent says
        bend = difference(robot, q, end.q) - 0.5 * (first + last)
        bend_size, length = largest_motion(robot, bend), largest_motion(robot, first)
        gain = 0.5 * end.t * end.first[:, -1]
        found = end.closed & (end.share < 1.0) & (bend_size <= MAX_BEND * length)
        found &= np.abs(end.share - share - gain) <= MAX_SKEW * gain
    return TurningPoints(found, end.share, end.q, end.linearised)
