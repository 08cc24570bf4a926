"""Curves of poses along which the motors turn from one pose to prescribed angles, many targets at once.

All motors turn in proportion, and the loops move the passive joints: P dq_p = -J_a dq_a, with P and J_a the
passive and the actuated columns of the loop equations. Each target has its own curve with its own steps. With
s the share of the turn, a step follows the tangent dq/ds; then Newton's method closes the loops. A step is
accepted if it passes the tests of `predictor_corrector` and det P keeps its sign; otherwise it is halved.
Where P loses rank, assembly modes meet and the curve ends. It ends at a turning point, which is found as a
root, or where branches cross, near which steps become ever shorter.
"""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

import numpy as np

from framework.kinematics.continuation.arclength import CurveEquations, Curves, TurningPoints
from framework.kinematics.continuation.predictor_corrector import (
    BRANCH_GROWTH,
    FIRST_STEP_RATIO,
    MAX_STEP_RATIO,
    MIN_STEP_RATIO,
    accept_steps,
    limit_steps,
)
from framework.kinematics.frames import difference, full_motion, integrate, integrate_columns, largest_motion
from framework.kinematics.inverse_kinematics import NewtonResult, close_each
from framework.kinematics.linearised_loops import (
    LinearisedLoops,
    clearance,
    equation_sizes,
    independent_loops_matrix,
    linearised_at,
)
from framework.kinematics.loop_ranges import relative_orientation
from framework.kinematics.modes import keeps_sign, passive_determinants
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, BoolArray, IntArray, assign, select
from framework.tolerances import BRANCH_CORRECTION, BRANCHES_CROSS, BRANCHES_MEET, RANK_LOST, SAME_PLACE


class MotorCurves(NamedTuple):
    """The state of T motor curves: the last pose on each curve, and extremes so far."""

    q: Array  # (T, nq)
    x: Array  # (T, n) platform coordinates, with whole turns since the start
    rate: Array  # (T, nv) dq/ds
    share: Array  # (T,) share s of the turn; 1 where the motors have arrived
    steps: IntArray  # (T,) number of steps taken
    clearance: Array  # (T,) least singular value of P at q
    least: Array  # (T,) least clearance on the curve
    largest: Array  # (T,) largest clearance on the curve
    bases: Array  # (T, R, m) of the ranges of the loops' rows, to which det P refers
    determinant_sign: Array  # (T,) of det P
    log_determinant: Array  # (T,) log |det P|


def curves_at(robot: ParallelRobot, linearised: LinearisedLoops, x: Array) -> MotorCurves:
    """Return T curves that begin at assembled poses, with whole turns of the platform as in x (T, n).

    Their joint rates are zero, because the turns of the motors are not known here.
    """
    frames = linearised.frames
    count = len(frames.q)
    clearances = clearance(robot, linearised)
    sign, logarithm = passive_determinants(linearised)
    return MotorCurves(
        q=frames.q,
        x=robot.platform.unwrap(robot.platform.coordinates(frames), x),
        rate=np.zeros((count, robot.nv)),
        share=np.zeros(count),
        steps=np.zeros(count, dtype=np.intp),
        clearance=clearances,
        least=clearances,
        largest=clearances,
        bases=linearised.bases,
        determinant_sign=sign,
        log_determinant=logarithm,
    )


def follow_curves(
    robot: ParallelRobot, start: MotorCurves, linearised: LinearisedLoops, targets: Array
) -> MotorCurves:
    """Turn the motors from one pose towards T targets (T, n_a).

    `start` and `linearised` (T = 1) describe this pose. A curve with a `share` below 1 has ended early, at a
    Type 2 singularity or where it cannot be followed.
    """
    turn = full_motion(robot, robot.actuated, targets - robot.actuated_coordinates(start.q))  # (T, nv)
    copies = np.zeros(len(turn), dtype=np.intp)  # index of the common start for each curve
    curves = select(start, copies)  # copies of the arrays of `start`, to be changed in place
    curves.share[:] = 0.0
    curves.steps[:] = 0
    curves.least[:] = curves.clearance
    curves.largest[:] = curves.clearance
    curves = curves._replace(rate=rates_closing_loops(robot, linearised.select(copies), turn))

    # a curve on which no joint moves farther than a corrector may is tried in a single step
    is_short = largest_motion(robot, curves.rate) < BRANCH_CORRECTION
    step = np.where(is_short, 1.0, FIRST_STEP_RATIO)  # (T,) in s
    # A curve is live until it arrives, ends, or its steps become too short. Assembly modes meet at a
    # singularity. If the clearance grows again after a curve has approached one, the step has passed the
    # singularity, and the curve ends before the step.
    approaching, ended = np.zeros((2, len(turn)), dtype=bool)
    live = np.flatnonzero(curves.clearance >= RANK_LOST)
    while len(live):
        current = select(curves, live)
        step[live] = limit_steps(robot, current.rate, step[live])
        closed, ends, correction, on_branch = _take_steps(robot, start.q[0], turn[live], current, step[live])
        rows = live[closed]  # curves whose loops are closed after the step

        # accept the steps that stay on their branch and pass no singularity
        is_nearer = ends.clearance < current.clearance[closed]
        approaching[rows] |= on_branch & is_nearer & (ends.clearance < BRANCHES_MEET)
        past_meeting = on_branch & approaching[rows] & ~is_nearer
        ended[rows[past_meeting]] = True
        accepted = on_branch & ~past_meeting
        assign(curves, rows[accepted], select(ends, accepted))  # changes `curves` in place

        # double the steps with small corrections, except the single step of a short curve; halve refused ones
        grows = rows[accepted & (correction < BRANCH_GROWTH)]
        step[grows] = np.maximum(step[grows], np.minimum(2.0 * step[grows], MAX_STEP_RATIO))
        refused = np.setdiff1d(live[~ended[live]], rows[accepted])
        step[refused] *= 0.5

        # a refused step may be due to a turning point ahead
        ended[_end_at_turning_points(robot, curves, refused, turn)] = True
        live = live[~ended[live] & (curves.share[live] < 1.0) & (step[live] >= MIN_STEP_RATIO)]
    return curves


def _take_steps(
    robot: ParallelRobot, start: Array, turn: Array, current: MotorCurves, step: Array
) -> tuple[IntArray, MotorCurves, Array, BoolArray]:
    """Take steps of length `step` (T,) in s along the tangents; decide which ends are on their branches.

    Args:
        start: configuration (nq,) at s = 0.
        turn: (T, nv) turns of the motors from s = 0 to 1 [rad, m].
        current: the T curves before the steps.

    Returns:
        The indices (S,) of the steps whose loops close, and of these steps: the curves after them, the
        corrections of the predictor (S,) [rad, lengths], and whether their ends are on the branch (S,).
    """
    # predict along the tangents, then close the loops
    share = current.share + step
    share = np.where(share > 1.0 - SAME_PLACE, 1.0, share)  # the last step ends at 1 to the last bit
    all_lengths = (share - current.share)[:, None]  # (T, 1) in s
    predicted = integrate(robot, current.q, all_lengths * current.rate)
    closing = close_at_motors(robot, start, share[:, None] * turn, predicted)

    # from here on the S steps whose loops close
    rows = np.flatnonzero(closing.closed)
    linearised = closing.linearised.select(rows)
    starts = select(current, rows)
    length = all_lengths[rows]
    ends = curves_at(robot, linearised, starts.x)
    ends = ends._replace(
        rate=rates_closing_loops(robot, linearised, turn[rows]),
        share=share[rows],
        steps=starts.steps + 1,
        least=np.minimum(starts.least, ends.clearance),
        largest=np.maximum(starts.largest, ends.clearance),
    )

    end_sign = ends.determinant_sign * relative_orientation(starts.bases, ends.bases)
    on_branch, correction = accept_steps(
        robot,
        difference(robot, predicted[rows], ends.q),
        length * starts.rate,
        length * ends.rate,
        keeps_mode=keeps_sign(
            (starts.determinant_sign, starts.log_determinant), (end_sign, ends.log_determinant)
        ),
        are_apart=lambda curved: ends.clearance[curved] > BRANCHES_CROSS,  # where P is far from losing rank
    )
    return rows, ends, correction, on_branch


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


def _end_at_turning_points(
    robot: ParallelRobot, curves: MotorCurves, rows: IntArray, turn: Array
) -> IntArray:
    """Move the curves `rows` to the next Type 2 singularity ahead, where one exists.

    Args:
        curves: all curves; those that end are changed in place.
        rows: indices (R,) of the curves to examine.
        turn: turns (curves, nv) of the motors from s = 0 to 1.

    Returns:
        The indices of the curves that end.
    """
    if not len(rows) or not robot.n_p:  # nothing to examine; without passive joints there is no Type 2
        return rows[:0]
    ahead = _find_turning_points(robot, curves.q[rows], curves.share[rows], turn[rows])
    found = np.flatnonzero(ahead.found)
    ending = rows[found]
    last = select(curves, ending)
    ends = curves_at(robot, linearised_at(robot, ahead.q[found]), last.x)
    ends = ends._replace(
        share=ahead.share[found], steps=last.steps + 1, largest=np.maximum(last.largest, ends.clearance)
    )
    assign(curves, ending, ends)
    return ending


def _find_turning_points(robot: ParallelRobot, q: Array, share: Array, turn: Array) -> TurningPoints:
    """Find the next Type 2 singularity ahead on each of T curves, from q (T, nq) at `share` s.

    On a curve the m loop equations determine the passive joints at each share s of the motors' `turn`
    (T, nv). At a Type 2 singularity s has an extremum: the curve turns back.
    """
    passive = robot.following
    loop_sizes = equation_sizes(robot)[robot.n :]  # (m,)

    def evaluate(q_on_curve: Array, _: Array, rows: IntArray) -> CurveEquations:
        """Compute the loop equations (R, m) and their slopes at q (R, nq) of the curves `rows` (R,).

        The second argument, the share s, is not used: the equations depend on s only by q.
        """
        linearised = linearised_at(robot, q_on_curve)
        loops = independent_loops_matrix(robot, linearised)  # (R, m, nv)
        by_share = np.matvec(loops, turn[rows] / robot.column_scale)
        slopes = np.concatenate([loops[:, :, passive], by_share[:, :, None]], axis=2)
        return CurveEquations(linearised.residual[:, robot.n :] / loop_sizes, slopes)

    return Curves(robot, passive, turn, evaluate).find_turning_points(q, share, np.arange(len(q)))
