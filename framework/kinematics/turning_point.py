"""Where the motors' way ends: the turning point of a branch at a Type 2 singularity, by a direct root.

While the motors turn by a share of their way, the loops F(y, share) = 0 draw a curve in the passive joints y
and the share. It is smooth where P = dF/dy loses rank as long as the motors drive what escapes: only the
share turns back there. So the curve is followed by t = c . y, c along its tangent at the start, and

    [P  b] [dy/dt     ]   [0]
    [c' 0] [dshare/dt ] = [1],    b = dF/dshare,

whose last number is the bordered measure of singularity with b as its border (Govaerts 2000, chapter 3): the
slope of the share, positive up to the turning point and zero there. Its root is found by secants in t, each
with a Newton step back to the curve; to first order in t the slope is a line, so a few are enough.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray
from framework.kinematics.closures import scaled
from framework.kinematics.frames import between, integrate
from framework.kinematics.inverse_kinematics import System, system_at
from framework.kinematics.newton import LAST_STEP
from framework.kinematics.parallel_robot import ParallelRobot
from framework.linalg.ordered_sums import solve

FIRST_SECANT = 1e-3  # [rad, lengths] along the curve, for the first slope of the slope
LONGEST = 2.0  # [rad, lengths] by all passive joints together: what lies farther is for a nearer start
ITERATIONS = 12
# A curve that is nearly a parabola of t from end to end has no other turning point between: its chord is the
# mean of both tangents, to this part of its length, and the share gains half its first slope times t, to this
# part of the gain.
BENT, SKEW = 0.1, 0.25


class TurningPoints(NamedTuple):
    """The turning points of T ways; where none is `found` the other values mean nothing."""

    found: BoolArray  # (T,)
    share: Array  # (T,) of the way
    q: Array  # (T, nq)
    system: System  # the equations there


class _Tangent(NamedTuple):
    """Newton's step back to the curve and the curve's tangent, at T places."""

    back: Array  # (T, n_p + 1) passive joints [rad, lengths], share; across c
    along: Array  # (T, n_p + 1) by t


def turning_points(robot: ParallelRobot, start: Array, q: Array, share: Array, turn: Array) -> TurningPoints:
    """The turning points ahead of assembled configurations q (T, nq), each after a `share` (T,) of its way.

    Only such are found as are proved to end the way: between there and q the curve is nearly a parabola.

    Args:
        start: the configuration (nq,) at which the ways begin.
        turn: (T, nv) by how much the motors are to turn on the whole way; zero in all other columns.
    """
    columns, scale, count = robot.following, robot.column_scale, len(q)
    border = np.zeros((count, len(columns)))

    def moved(step: Array) -> Array:
        """Joint motions (T, nv) of steps along the curve (T, n_p + 1)."""
        motion = step[:, -1:] * turn
        motion[:, columns] = step[:, :-1] * scale[columns]
        return motion

    def tangent(q: Array) -> _Tangent:
        system = system_at(robot, q, None)
        P, b, residual = _bordered(robot, system, turn)
        if not border.any():
            border[:] = solve(P, -b)
            border[:] /= np.linalg.norm(border, axis=1, keepdims=True)
        whole = np.zeros((count, len(columns) + 1, len(columns) + 1))
        whole[:, :-1, :-1], whole[:, :-1, -1], whole[:, -1, :-1] = P, b, border
        right = np.zeros((2, count, len(columns) + 1))
        right[0, :, :-1], right[1, :, -1] = -residual, 1.0
        return _Tangent(solve(whole, right[0]), solve(whole, right[1]))

    with np.errstate(all="ignore"):  # what has no turning point ahead runs away, and is not found
        here = first = tangent(q)
        at, reached, t = q, np.zeros(count), np.zeros(count)
        step, closed = np.full(count, FIRST_SECANT), np.zeros(count, dtype=bool)
        for _ in range(ITERATIONS):
            lost = ~(np.abs(t + step) < LONGEST)
            whole_step = np.where((closed | lost)[:, None], 0.0, here.back + step[:, None] * here.along)
            at, reached = integrate(robot, at, moved(whole_step)), reached + whole_step[:, -1]
            t = t + np.where(closed | lost, 0.0, step)
            closed |= ~lost & (np.abs(whole_step).max(axis=1) < LAST_STEP)
            if (closed | lost).all():
                break
            before, here = here.along[:, -1], tangent(at)
            step = -step * here.along[:, -1] / (here.along[:, -1] - before)
        gain = 0.5 * t * first.along[:, -1]
        chord, way = between(robot, q, at), t[:, None] * moved(first.along)
        mean = 0.5 * (way + t[:, None] * moved(here.along))
        bent, length = (np.abs(motion / scale).max(axis=1) for motion in (chord - mean, way))
        found = closed & (t > 0) & (np.abs(reached - gain) <= SKEW * gain) & (bent <= BENT * length)
        found &= share + reached < 1.0
    end = np.where(found, share + reached, share)
    at = np.where(found[:, None], at, q)
    exact = np.zeros_like(turn)  # what the rounding of the steps has left of the motors' angles
    off = end[:, None] * turn - between(robot, start, at)
    exact[:, robot.actuated] = off[:, robot.actuated]
    at = integrate(robot, at, exact)
    return TurningPoints(found, end, at, system_at(robot, at, None))


def _bordered(robot: ParallelRobot, system: System, turn: Array) -> tuple[Array, Array, Array]:
    """P (T, m, n_p), b (T, m) and the loop equations (T, m), without dimension."""
    sizes = np.where(robot.loops.rotation, 1.0, robot.length) * robot.row_sizes
    loops = scaled(robot, system.closures, robot.loops.rotation) / robot.row_sizes[:, None]
    b = np.einsum("tmv,tv->tm", loops, turn / robot.column_scale)
    return loops[:, :, robot.following], b, system.residual[:, robot.n :] / sizes
