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
    equation_sizes,
    independent_loops_matrix,
    linearised_at,
)
from framework.kinematics.loop_ranges import relative_orientation
from framework.kinematics.modes import keeps_sign
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, BoolArray, IntArray, select
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
    clearance: Array  # (T,) least singular value of P at q
    least: Array  # (T,) least clearance on the curve
    largest: Array  # (T,) largest clearance on the curve


class MotorEquations(NamedTuple):
    """The m loop equations at T points of motor curves, dimensionless."""

    values: Array  # (T, m)
    slopes: Array  # (T, m, n_p + 1) by the passive joints, P, and by the share of the turn
    bases: Array  # (T, R, m) of the ranges of the loops' rows, to which det P refers


def curves_at(robot: ParallelRobot, linearised: LinearisedLoops, x: Array) -> MotorCurves:
    """Return T curves that begin at assembled poses, with whole turns of the platform as in x (T, n)."""
    frames = linearised.frames
    clearances = clearance(robot, linearised)
    return MotorCurves(
        q=frames.q,
        x=robot.platform.unwrap(robot.platform.coordinates(frames), x),
        share=np.zeros(len(frames.q)),
        steps=np.zeros(len(frames.q), dtype=np.intp),
        clearance=clearances,
        least=clearances,
        largest=clearances,
    )


def follow_curves(
    robot: ParallelRobot, start: MotorCurves, linearised: LinearisedLoops, targets: Array
) -> tuple[MotorCurves, LinearisedLoops]:
    """Turn the motors from one pose towards T targets (T, n_a); return the ends and the loops there.

    `start` and `linearised` (T = 1) describe this pose. A curve with a `share` below 1 has ended early, at a
    Type 2 singularity or where it cannot be followed.
    """
    turn = full_motion(robot, robot.actuated, targets - robot.actuated_coordinates(start.q))  # (T, nv)
    copies = np.zeros(len(turn), dtype=np.intp)  # index of the common start for each curve
    starts = select(start, copies)
    curves = starts._replace(
        share=np.zeros(len(turn)),
        steps=copies.copy(),
        least=starts.clearance.copy(),
        largest=starts.clearance.copy(),
    )
    if start.clearance[0] < RANK_LOST:
        return curves, linearised.select(copies)

    def evaluate(q: Array, _: Array, rows: IntArray) -> MotorEquations:
        """Compute the equations at q (R, nq); they depend on the share (R,) only by q."""
        return _motor_equations(robot, linearised_at(robot, q), turn[rows])

    first = _motor_equations(robot, linearised.select(copies), turn)
    progress = _Progress.begin(robot, curves, first)
    curves_of_motors = Curves(robot, robot.following, turn, evaluate)
    q, share, reason = curves_of_motors.follow(
        curves.q, curves.share, first, longest=progress.longest, accept=progress.accept
    )
    # rounding of many steps leaves the motors slightly off their prescribed turn
    motor_offset = (share[:, None] * turn - difference(robot, start.q, q))[:, robot.actuated]
    q = integrate_columns(robot, q, robot.actuated, motor_offset)
    linearised = linearised_at(robot, q)
    curves = curves._replace(q=q, share=share)
    (turned,) = (reason == CurveReason.TURNED).nonzero()
    if len(turned):  # at singularities that were solved for
        last = curves_at(robot, linearised.select(turned), curves.x[turned])
        curves.x[turned] = last.x
        curves.steps[turned] += 1
        curves.clearance[turned] = last.clearance
        curves.least[turned] = np.minimum(curves.least[turned], last.clearance)
    return curves, linearised


def _motor_equations(robot: ParallelRobot, linearised: LinearisedLoops, turn: Array) -> MotorEquations:
    """Return the equations of R curves at linearised loops (T = R), for turns (R, nv) of the motors."""
    loops = independent_loops_matrix(robot, linearised)  # (R, m, nv)
    by_share = np.matvec(loops, turn / robot.column_scale)
    return MotorEquations(
        values=linearised.residual[:, robot.n :] / equation_sizes(robot)[robot.n :],
        slopes=np.concatenate([loops[:, :, robot.following], by_share[:, :, None]], axis=2),
        bases=linearised.bases,
    )


class _Progress(NamedTuple):
    """The state of T curves at their last points; `accept` changes the arrays in place."""

    robot: ParallelRobot
    curves: MotorCurves
    bases: Array  # (T, R, m) of the ranges of the loops' rows
    determinants: Array  # (2, T) sign and logarithm of det P in these bases
    approaching: BoolArray  # (T,) whether the curve has come near a singularity
    longest: Array  # (T,) [rad, lengths] largest motion of a joint in the next step

    @staticmethod
    def begin(robot: ParallelRobot, curves: MotorCurves, first: MotorEquations) -> _Progress:
        """Return the state at the starts of T curves."""
        determinants = np.array(np.linalg.slogdet(first.slopes[:, :, :-1]))
        longest = np.full(len(curves.q), LONG_STEP)
        return _Progress(
            robot, curves, first.bases.copy(), determinants, np.zeros(len(longest), dtype=bool), longest
        )

    def accept(self, ends: CurveSteps[MotorEquations]) -> tuple[BoolArray, BoolArray]:
        """Return which steps end on their branch, (R,), and store the state of their curves; all go on.

        On the branch det P keeps its sign. A step may be long, and its tangent turn, only where P is far from
        losing rank, so that no other branch crosses; it may also be long while the clearance is steady.
        Assembly modes meet at a singularity. If the clearance grows again after a curve has approached one,
        the step has passed the singularity.
        """
        robot, curves, rows = self.robot, self.curves, ends.rows
        P, bases = ends.equations.slopes[:, :, :-1], ends.equations.bases
        clearances = singular_values(P).min(axis=1, initial=np.inf)
        start_clearances = curves.clearance[rows]
        signs, logarithms = np.linalg.slogdet(P)
        turned_signs = signs * relative_orientation(self.bases[rows], bases)
        keeps = keeps_sign(self.determinants[:, rows], (turned_signs, logarithms))
        keeps &= (clearances >= RANK_LOST) | (ends.points.share < 1.0)
        is_apart = clearances > BRANCHES_CROSS
        is_steady = 2.0 * np.minimum(clearances, start_clearances) > np.maximum(clearances, start_clearances)
        keeps &= is_apart | ends.is_straight & (is_steady | (ends.size <= SHORT_STEP))
        is_nearer = clearances < start_clearances
        self.approaching[rows] |= keeps & is_nearer & (clearances < BRANCHES_MEET)
        keeps &= is_nearer | ~self.approaching[rows]

        rows, clearances = rows[keeps], clearances[keeps]
        x = robot.platform.coordinates(frames_at(robot, ends.points.q[keeps]))
        curves.x[rows] = robot.platform.unwrap(x, curves.x[rows])
        curves.steps[rows] += 1
        curves.clearance[rows] = clearances
        curves.least[rows] = np.minimum(curves.least[rows], clearances)
        curves.largest[rows] = np.maximum(curves.largest[rows], clearances)
        self.bases[rows] = bases[keeps]
        self.determinants[:, rows] = signs[keeps], logarithms[keeps]
        self.longest[rows] = np.where((is_apart | is_steady)[keeps], LONG_STEP, SHORT_STEP)
        return keeps, np.ones(len(keeps), dtype=bool)


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
