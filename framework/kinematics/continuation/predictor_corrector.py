"""Steps from pose to pose that stay on their branch, and the turning point at which a branch ends.

In a step the platform follows a path (`tracking`), or the motors turn (`motor_curves`). A step along the
tangent is accepted if its correction is small compared with the step and its end is on the same branch.
Otherwise the step is halved.

A branch may end on a singularity. While the motors turn, or the platform follows its path, the loop equations
F(y, s) = 0 define a curve in the joints y that follow and the share s of the prescribed motion. If the
prescribed motion excites the uncontrolled motion, the curve remains smooth where M = dF/dy loses rank: only s
turns back. So the curve is parametrised by t = c . y instead of s, with the unit vector c along dy/ds at the
start, and

    [M  b] [dy/dt]   [0]
    [c' 0] [ds/dt] = [1],    b = dF/ds.

The slope ds/dt is the bordered measure of singularity with b as its border (Govaerts 2000, chapter 3). It is
positive before the turning point and zero at it. The secant method in t finds this root; each iterate also
takes a Newton step back to the curve. Near the root ds/dt is nearly linear in t, so a few secants suffice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.kinematics.assembly import MAX_ITERATIONS
from framework.kinematics.frames import difference, integrate, largest_motion
from framework.kinematics.linearised_loops import LinearisedLoops
from framework.kinematics.mechanism import Mechanism
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import LEAST_DIVISOR, Array, BoolArray, IntArray
from framework.numerics.ordered_sums import solve
from framework.tolerances import BRANCH_CORRECTION, BRANCH_STEP_SHARE, BRANCH_TURN, NEWTON_STEP

MIN_STEP_RATIO = 1e-7  # share of the curve; if a step shorter than this is refused, the branch has ended
MAX_PREDICTOR_MOVE = 1.0  # [rad, lengths] of a joint in a step; near a singularity tangents lead far away
FIRST_STEP_RATIO = 1 / 8  # share of the curve
BRANCH_GROWTH = 0.2 * BRANCH_CORRECTION  # [rad, lengths] after a smaller correction the step is doubled
MAX_STEP_RATIO = 2 * FIRST_STEP_RATIO  # share of the curve in the largest step
# [rad, lengths] norm over all joints; no farther turning point counts
MAX_ARC_LENGTH = 2 * MAX_PREDICTOR_MOVE


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


class CurveEquations(NamedTuple):
    """F (k equations) and its derivatives at T points, dimensionless (radians, lengths of the robot)."""

    matrix: Array  # (T, k, k) M = dF/dy
    by_share: Array  # (T, k) b = dF/ds
    residual: Array  # (T, k) F
    linearised: LinearisedLoops  # the same equations with dimensions


class CurveEnds(NamedTuple):
    """The turning points of T curves; the values of a curve are meaningless unless `found`."""

    found: BoolArray  # (T,) whether the curve has a turning point ahead
    share: Array  # (T,) s, the share of the prescribed motion
    q: Array  # (T, nq)
    linearised: LinearisedLoops  # at q
    length: Array  # (T,) t along the curve [rad, lengths]
    first_tangent: Array  # (T, k + 1) d(y, s)/dt at the start
    last_tangent: Array  # (T, k + 1) d(y, s)/dt at the end


@dataclass(frozen=True, eq=False)
class Curves:
    """T curves F(y, s) = 0 of joints y while other joints or the platform follow a prescribed motion."""

    robot: ParallelRobot
    columns: IntArray  # (k,) columns of the joints y that follow
    turn: Array  # (T, nv) prescribed motion of the other joints from s = 0 to 1
    evaluate: Callable[[Array, Array], CurveEquations]  # evaluates F at q (T, nq) and s (T,)

    def find_turning_points(self, q: Array, share: Array) -> CurveEnds:
        """Find the turning points of T curves ahead of configurations q (T, nq) at s = `share` (T,).

        A turning point counts as found only if the curve from q to the point is nearly a parabola in t. On a
        parabola the chord is t times the mean of both end tangents, and s gains t/2 times its slope at the
        start.
        """
        max_chord_deviation = 0.1  # from a parabola, over the chord
        max_gain_deviation = 0.25  # from a parabola, over the gain in s
        with np.errstate(all="ignore"):  # a curve without a turning point ahead diverges
            end = self._follow_to_turn(q, share)
            start_motion = end.length[:, None] * self._joint_motions(end.first_tangent)  # (T, nv)
            end_motion = end.length[:, None] * self._joint_motions(end.last_tangent)
            chord = difference(self.robot, q, end.q)
            deviation = largest_motion(self.robot, chord - 0.5 * (start_motion + end_motion))

            first_slope = end.first_tangent[:, -1]  # ds/dt at the start
            expected_gain = 0.5 * end.length * first_slope
            gain_error = np.abs(end.share - share - expected_gain)

            found = end.found & (end.share < 1.0)
            found &= deviation <= max_chord_deviation * largest_motion(self.robot, start_motion)
            found &= gain_error <= max_gain_deviation * expected_gain
        return end._replace(found=found)

    def _joint_motions(self, step: Array) -> Array:
        """Return joint motions (T, nv) [rad, m] for `step` (T, k + 1) in y and s."""
        motion = step[:, -1:] * self.turn
        motion[:, self.columns] = step[:, :-1] * self.robot.column_scale[self.columns]
        return motion

    def _follow_to_turn(self, q: Array, share: Array) -> CurveEnds:
        """Follow T curves from q (T, nq) at s = `share` (T,) to ds/dt = 0 by the secant method.

        A curve that has converged or become too long rests while the others go on. t (T,) is the length
        along the curves so far, dt (T,) the next secant step, both in radians and robot lengths.
        """
        first_secant_length = 1e-3  # [rad, lengths] along the curve, for the first secant of ds/dt
        equations = self.evaluate(q, share)
        c = solve(equations.matrix, -equations.by_share)  # dy/ds at the start
        c /= np.linalg.norm(c, axis=1, keepdims=True)
        correction, tangent = _newton_step_and_tangent(equations, c)
        first_tangent = tangent
        t = np.zeros(len(q))
        dt = np.full(len(q), first_secant_length)
        converged = np.zeros(len(q), dtype=bool)
        for _ in range(MAX_ITERATIONS):
            step = correction + dt[:, None] * tangent  # (T, k + 1) back to the curve and along it
            # negated, so that a t that is not a number diverges
            diverges = ~((np.abs(t + dt) < MAX_ARC_LENGTH) & np.isfinite(step).all(axis=1))
            rests = converged | diverges
            step[rests] = 0.0
            q = integrate(self.robot, q, self._joint_motions(step))
            share = share + step[:, -1]
            t = t + np.where(rests, 0.0, dt)
            converged |= ~diverges & (np.abs(step).max(axis=1) < NEWTON_STEP)

            last_slope = tangent[:, -1]  # ds/dt
            equations = self.evaluate(q, share)
            correction, tangent = _newton_step_and_tangent(equations, c)
            if (converged | diverges).all():
                break
            dt = -dt * tangent[:, -1] / (tangent[:, -1] - last_slope)  # to the secant's zero of ds/dt
        return CurveEnds(converged & (t > 0), share, q, equations.linearised, t, first_tangent, tangent)


def _newton_step_and_tangent(equations: CurveEquations, c: Array) -> tuple[Array, Array]:
    """Compute Newton's step back to the curve and the tangent d(y, s)/dt, each (T, k + 1).

    The matrix is [M b; c' 0] of the header, with M, b and F of `equations` and c (T, k); the right sides are
    [-F; 0] and [0; 1]. So Newton's step does not change t = c . y.
    """
    count, size = c.shape
    bordered = np.zeros((count, size + 1, size + 1))
    bordered[:, :-1, :-1] = equations.matrix
    bordered[:, :-1, -1] = equations.by_share
    bordered[:, -1, :-1] = c
    newton_right, tangent_right = np.zeros((2, count, size + 1))
    newton_right[:, :-1] = -equations.residual
    tangent_right[:, -1] = 1.0
    return solve(bordered, newton_right), solve(bordered, tangent_right)
