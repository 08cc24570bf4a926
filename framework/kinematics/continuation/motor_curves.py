"""Curves of poses along which the motors turn from one pose to prescribed angles, many targets at once.

All motors turn in proportion, and the loops move the passive joints: P dq_p = -J_a dq_a, with P and J_a the
passive and the actuated columns of the loop equations. Each target has its own curve, which `arclength`
follows in steps of its own. Where P loses rank, assembly modes meet and the curve ends. It ends at a turning
point, which is found as a root, or where branches cross, near which steps become ever shorter.
"""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

import numpy as np

from framework.kinematics.continuation.arclength import CurveReason, Curves, CurveSteps
from framework.kinematics.frames import difference, frames_at, full_motion, integrate_columns
from framework.kinematics.inverse_kinematics import NewtonResult, close_each
from framework.kinematics.linearised_loops import (
    LinearisedLoops,
    clearance,
    independent_loops_matrix,
    linearised_at,
)
from framework.kinematics.loop_ranges import relative_orientation
from framework.kinematics.modes import keeps_sign
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, BoolArray, IntArray
from framework.numerics.ordered_sums import singular_values
from framework.tolerances import BRANCHES_CROSS, BRANCHES_MEET, RANK_LOST

# [rad, lengths] largest motions of a joint in a step, near a singularity and elsewhere
SHORT_STEP, LONG_STEP = 0.1, 0.3


class MotorCurves(NamedTuple):
    """The ends of T motor curves, and extremes on the way."""

    q: Array  # (T, nq)
    x: Array  # (T, n) platform coordinates, with whole turns since the start
    share: Array  # (T,) share s of the turn; 1 where the motors have arrived
    steps: IntArray  # (T,) number of steps taken
    least: Array  # (T,) least singular value of P, the clearance, on the curve
    largest: Array  # (T,) largest clearance on the curve


class MotorEquations(NamedTuple):
    """The m loop equations at T points of motor curves, dimensionless."""

    values: Array  # (T, m)
    slopes: Array  # (T, m, n_p + 1) by the passive joints, P, and by the share of the turn
    bases: Array  # (T, R, m) of the ranges of the loops' rows, to which det P refers

    @property
    def P(self) -> Array:
        """Passive columns of the loops, (T, m, n_p)."""
        return self.slopes[:, :, :-1]


def follow_curves(
    robot: ParallelRobot, linearised: LinearisedLoops, x: Array, targets: Array
) -> tuple[MotorCurves, LinearisedLoops]:
    """Turn the motors from one pose towards T targets (T, n_a); return the ends and the loops there.

    A curve with a `share` below 1 has ended early, at a Type 2 singularity or where it cannot be followed. On
    its branch det P keeps its sign. A step may be long, and its tangent turn, only where P is far from losing
    rank, so that no other branch crosses; it may also be long while the clearance is steady. Assembly modes
    meet at a singularity. If the clearance grows again after a curve has approached one, the step has passed
    the singularity.

    Args:
        linearised: the loops at the pose, T = 1.
        x: (n,) the platform's coordinates there, from which whole turns are counted.
    """
    start = linearised.frames.q  # (1, nq)
    turn = full_motion(robot, robot.actuated, targets - robot.actuated_coordinates(start))  # (T, nv)
    linearised = linearised.select(np.zeros(len(turn), dtype=np.intp))  # the common start of each curve
    first = _motor_equations(robot, linearised, turn)

    # of each curve at its last point, changed by the steps that are accepted
    clearances = clearance(robot, linearised)  # (T,)
    determinants = np.array(np.linalg.slogdet(first.P))  # (2, T) sign and logarithm of det P in `bases`
    bases = first.bases.copy()
    is_approaching = np.zeros(len(turn), dtype=bool)  # whether the curve has come near a singularity
    longest = np.full(len(turn), LONG_STEP)  # [rad, lengths] largest motion of a joint in the next step
    curves = MotorCurves(
        q=linearised.frames.q,
        x=np.tile(x, (len(turn), 1)),
        share=np.zeros(len(turn)),
        steps=np.zeros(len(turn), dtype=np.intp),
        least=clearances.copy(),
        largest=clearances.copy(),
    )
    if (clearances < RANK_LOST).any():  # all begin at one pose
        return curves, linearised

    def evaluate(q: Array, _: Array, rows: IntArray) -> MotorEquations:
        """Compute the equations at q (R, nq); they depend on the share (R,) only by q."""
        return _motor_equations(robot, linearised_at(robot, q), turn[rows])

    def accept(ends: CurveSteps[MotorEquations]) -> tuple[BoolArray, BoolArray]:
        """Return which of R steps end on their branch, and store the state of their curves; all go on."""
        rows, P, end_bases = ends.rows, ends.equations.P, ends.equations.bases
        end_clearances = singular_values(P).min(axis=1, initial=np.inf)
        sign, logarithm = np.linalg.slogdet(P)
        aligned_sign = sign * relative_orientation(bases[rows], end_bases)
        keeps = keeps_sign(determinants[:, rows], (aligned_sign, logarithm))
        keeps &= (end_clearances >= RANK_LOST) | (ends.points.share < 1.0)
        is_apart = end_clearances > BRANCHES_CROSS
        smaller, larger = np.sort([clearances[rows], end_clearances], axis=0)
        is_steady = 2.0 * smaller > larger
        keeps &= is_apart | ends.is_straight & (is_steady | (ends.size <= SHORT_STEP))
        is_nearer = end_clearances < clearances[rows]
        is_approaching[rows] |= keeps & is_nearer & (end_clearances < BRANCHES_MEET)
        keeps &= is_nearer | ~is_approaching[rows]

        rows = rows[keeps]
        end_x = robot.platform.coordinates(frames_at(robot, ends.points.q[keeps]))
        curves.x[rows] = robot.platform.unwrap(end_x, curves.x[rows])
        curves.steps[rows] += 1
        clearances[rows] = end_clearances[keeps]
        curves.least[rows] = np.minimum(curves.least[rows], clearances[rows])
        curves.largest[rows] = np.maximum(curves.largest[rows], clearances[rows])
        bases[rows], determinants[:, rows] = end_bases[keeps], (sign[keeps], logarithm[keeps])
        longest[rows] = np.where((is_apart | is_steady)[keeps], LONG_STEP, SHORT_STEP)
        return keeps, np.ones(len(keeps), dtype=bool)

    (q, share), reason = Curves(robot, robot.following, turn, evaluate).follow(
        curves.q, curves.share, first, longest=longest, accept=accept
    )
    # rounding of many steps leaves the motors slightly off their prescribed turn
    motor_offset = (share[:, None] * turn - difference(robot, start, q))[:, robot.actuated]
    q = integrate_columns(robot, q, robot.actuated, motor_offset)
    linearised = linearised_at(robot, q)
    (turned,) = (reason == CurveReason.TURNED).nonzero()
    if len(turned):  # at singularities that were solved for
        singular = linearised.select(turned)
        end_x = robot.platform.coordinates(singular.frames)
        curves.x[turned] = robot.platform.unwrap(end_x, curves.x[turned])
        curves.steps[turned] += 1
        curves.least[turned] = np.minimum(curves.least[turned], clearance(robot, singular))
    return curves._replace(q=q, share=share), linearised


def _motor_equations(robot: ParallelRobot, linearised: LinearisedLoops, turn: Array) -> MotorEquations:
    """Return the equations of R curves at linearised loops (T = R), for turns (R, nv) of the motors."""
    loops = independent_loops_matrix(robot, linearised)  # (R, m, nv)
    by_share = np.matvec(loops, turn / robot.column_scale)
    return MotorEquations(
        values=linearised.residual[:, robot.n :] / robot.equation_sizes[robot.n :],
        slopes=np.concatenate([loops[:, :, robot.following], by_share[:, :, None]], axis=2),
        bases=linearised.bases,
    )


def close_at_motors(robot: ParallelRobot, start: Array, turn: Array, guess: Array) -> NewtonResult:
    """Close the loops near `guess` (T, nq), with the motors turned by `turn` (T, nv) from start (nq,)."""
    # rounding of many steps leaves the motors slightly off their prescribed turn
    motor_offset = (turn - difference(robot, start, guess))[:, robot.actuated]
    guess = integrate_columns(robot, guess, robot.actuated, motor_offset)
    if not robot.n_p:  # every joint has a motor
        return NewtonResult(guess, linearised_at(robot, guess), closed=np.full(len(guess), True))
    return close_each(robot, x=None, guess=guess)  # the passive joints alone move


def rates_closing_loops(robot: ParallelRobot, linearised: LinearisedLoops, rates: Array) -> Array:
    """Return `rates` (T, nv) of all other joints with the passive rates that keep the loops closed.

    If P is singular to the last bit, no such rates exist, and the passive joints stay at rest.
    """
    closing = rates.copy()
    if robot.n_p:
        gap_rates = np.matvec(linearised.closures, rates)  # (T, m) with the passive joints at rest
        with suppress(np.linalg.LinAlgError):
            closing[:, robot.following] = -linearised.passive_factors.solve(gap_rates)
    return closing
