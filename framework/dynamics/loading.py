"""Many configurations loaded little by little, motors locked: what carries the load, and what gives way.

The equilibria under a growing share of weight and wrench draw a curve, which is followed by its length: a
step goes along the tangent, and Newton's method leads back to the curve beside it, the share being one of the
unknowns (Keller 1977), so that a curve that is flat or steep in the share is followed alike. A step counts
if the correction is small beside it, if the share grows as the tangents at both ends have it, and if the
tangent stiffness stays positive definite. So the equilibrium reached is the one that the unloaded
configuration leads to without a jump. Where the share turns back (a fold: snap-through) the turning point is
found by a direct root; a bifurcation (buckling), by steps that halve.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from framework.dynamics.forces import spring_torques
from framework.dynamics.stiffness import (
    MAX_STEP,
    CompliantMotions,
    compliant_motions,
    deflects_little,
    require_springs,
)
from framework.dynamics.tangent_stiffness import (
    Balance,
    Load,
    balance,
    check_wrench,
    moving_columns,
    tangent_stiffness,
)
from framework.kinematics.continuation.turning_point import (
    CurveEquations,
    Curves,
    TurningPoints,
    turning_points,
)
from framework.kinematics.frames import integrate_columns
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.modes import mode_signs
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike, BoolArray, ReadOnlyArrays, assign, select
from framework.numerics.ordered_sums import dot, matmul, matvec, solve
from framework.tolerances import EIGENVALUE_ROUNDING, NEWTON_STEP

MAX_CORRECTION_RATIO = 0.25  # of a step, as along other branches: more may be another equilibrium
MAX_SHARE_GAP = 0.1  # of what the steeper tangent gains: two folds of a cubic between two points leave 1 / 6
UNCHECKED_MOTION = 1e-7  # [rad, lengths] a motion with no room for a fold
MAX_STEPS = 1000  # along the curve; most robots take one, and 0.1 rad each lead beyond what springs bear
MAX_ITERATIONS = 8  # of Newton's method a step


class LoadReason(IntEnum):
    """The outcome for one configuration: the load is carried, or why not."""

    CARRIED = 0
    GIVES_WAY = 1  # the stiffness is lost before the whole load is on: it snaps through, or buckles
    TOO_SOFT = 2  # deflections beyond `MAX_DEFLECTION`
    OTHER_MODE = 3  # carried, but by way of Type 2 into another assembly mode
    NOT_CONVERGED = 4


LOAD_WORDS = {
    LoadReason.CARRIED: "carries the load",
    LoadReason.GIVES_WAY: "gives way: snaps through or buckles under the load",
    LoadReason.TOO_SOFT: "deflects by more than linear springs mean",
    LoadReason.OTHER_MODE: "led through Type 2 by the load",
    LoadReason.NOT_CONVERGED: "not converged",
}


@dataclass(frozen=True, eq=False)
class LoadedStack(ReadOnlyArrays):
    """T configurations under the load; one with another reason than `CARRIED` bears a share only."""

    q: Array  # (T, nq)
    reason: NDArray[np.uint8]  # (T,) `LoadReason`
    share: Array  # (T,) of the load that was reached
    free: CompliantMotions  # at q, with the stiffness under load in place of that of the springs


class _Points(NamedTuple):
    """T configurations on the curve, with their tangents."""

    q: Array  # (T, nq)
    share: Array  # (T,) of the load
    rate: Array  # (T, f) of the moving columns with respect to the share, radians and lengths of the robot


class _Prediction(NamedTuple):
    """T steps along the tangents."""

    move: Array  # (T, f) [rad, lengths]
    tangent: Array  # (T, f) of unit length
    share: Array  # (T,) of the load
    lands: BoolArray  # (T,) whether the whole load is reached
    size: Array  # (T,) [rad, lengths] largest entry of the move


class _Corrected(NamedTuple):
    """T steps led back to the curve."""

    points: _Points
    along: Array  # (T,) [rad, lengths] the way along the tangent
    met: BoolArray  # (T,) whether the equilibrium was met
    stable: BoolArray  # (T,) whether its stiffness is positive definite


class _Arrival(NamedTuple):
    """The ends of T steps along the curve."""

    points: _Points
    size: Array  # (T,) [rad, lengths] of the step, before its correction
    good: BoolArray  # (T,) whether the step counts
    lost: BoolArray  # (T,) whether it would, but for a stiffness that is not positive definite
    turned: BoolArray  # (T,) whether the share has turned back, too


def loaded_stack(robot: ParallelRobot, q: Array, *, wrench: ArrayLike | None = None) -> LoadedStack:
    """Follow equilibria under growing weight and wrench from unloaded assembled configurations q (T, nq).

    Args:
        wrench: of the world ON the platform, see `platform_stiffness`.

    Raises:
        InvalidInput: a robot without springs; a wrench without a potential.
    """
    require_springs(robot)
    preload = spring_torques(robot, q, robot.all_stiffness)
    load = Load(check_wrench(robot, wrench), np.zeros(len(q)), preload)
    unloaded = balance(robot, q, load)
    current = _Points(q.copy(), load.share, _tangents(unloaded.H, unloaded.drive, unloaded.null)[0])
    step = np.full(len(q), MAX_STEP)
    reason = np.full(len(q), LoadReason.NOT_CONVERGED, dtype=np.uint8)
    live = np.arange(len(q))
    for _ in range(MAX_STEPS):
        if not len(live):
            break
        start, whole = select(current, live), load.select(live)
        ahead = _step(robot, start, whole, step[live])
        step[live] = np.where(ahead.good, np.minimum(2.0 * ahead.size, MAX_STEP), 0.5 * ahead.size)
        assign(current, live[ahead.good], select(ahead.points, ahead.good))
        reason[live] = _reasons(robot, ahead)
        turned = np.flatnonzero(ahead.turned)
        if len(turned):
            folds = _folds(robot, select(start, turned), whole.select(turned))
            rows = live[turned[folds.found]]
            current.q[rows] = folds.q[folds.found]
            current.share[rows] = folds.share[folds.found]
            reason[rows] = LoadReason.GIVES_WAY
        can_halve = ~(ahead.size <= UNCHECKED_MOTION)  # NaN too
        live = live[(ahead.good | can_halve) & (reason[live] == LoadReason.NOT_CONVERGED)]
    return _loaded_stack(robot, q, current, reason, load)


def _reasons(robot: ParallelRobot, ahead: _Arrival) -> NDArray[np.uint8]:
    """Return the reason (T,) to stop after each step, NOT_CONVERGED to go on."""
    reasons = np.full(len(ahead.size), LoadReason.NOT_CONVERGED, dtype=np.uint8)
    share = ahead.points.share
    reasons[ahead.good & (share == 1.0)] = LoadReason.CARRIED
    reasons[ahead.good & (share <= 1.0) & ~deflects_little(robot, ahead.points.q)] = LoadReason.TOO_SOFT
    reasons[ahead.lost & (ahead.size <= UNCHECKED_MOTION)] = LoadReason.GIVES_WAY
    return reasons


def _loaded_stack(
    robot: ParallelRobot, q: Array, reached: _Points, reason: NDArray[np.uint8], load: Load
) -> LoadedStack:
    """Return the stack reached from q (T, nq), with its stiffness and changes of assembly mode."""
    start, end = (linearised_at(robot, poses, None) for poses in (q, reached.q))
    changes_mode = mode_signs(robot, end)[1] != mode_signs(robot, start)[1]
    reason[changes_mode & (reason == LoadReason.CARRIED)] = LoadReason.OTHER_MODE
    free = compliant_motions(robot, end, reached.q)
    free = free._replace(K=tangent_stiffness(robot, end, reached.q, free.Z, load))
    return LoadedStack(reached.q, reason, reached.share, free)


def _tangents(H: Array, drive: Array, null: Array) -> tuple[Array, BoolArray]:
    """Compute rates (T, f) by the share along the curve; return whether the stiffness is positive definite.

    H dz/dshare = -drive on the null space of the closures, by eigenvalues of H; those at rounding count as
    that small instead of zero.
    """
    values, vectors = np.linalg.eigh(H)  # (T, d), (T, d, d)
    rounding = EIGENVALUE_ROUNDING * np.abs(values).max(axis=1, keepdims=True)
    divisors = np.where(np.abs(values) > rounding, values, rounding)
    rate = matvec(vectors, matvec(vectors.swapaxes(1, 2), drive) / divisors)
    return -matvec(null, rate), values[:, 0] > rounding[:, 0]


def _step(robot: ParallelRobot, start: _Points, load: Load, step: Array) -> _Arrival:
    """Find the equilibria a step (T,) [rad, lengths] further on the curve, or under the whole load.

    The whole load is taken where it is nearer than the step. Where the curve leads beyond the whole load,
    the next step leads back.
    """
    ahead = _predict(start, step)
    end = _correct(robot, start, ahead, load)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = 1.0 / dot(ahead.tangent, start.rate)  # of the share along the tangent, at the start
        end_slope = 1.0 / dot(ahead.tangent, end.points.rate)
        mean_gain = 0.5 * end.along * (slope + end_slope)
        steepest = np.abs(end.along * np.maximum(np.abs(slope), np.abs(end_slope)))
        gap = np.abs(end.points.share - start.share - mean_gain)
        straight = gap <= MAX_SHARE_GAP * steepest
        turned = slope * end_slope < 0.0
    counts = end.met & (straight | (ahead.size <= UNCHECKED_MOTION))
    lost = counts & ~end.stable
    return _Arrival(end.points, ahead.size, counts & end.stable, lost, lost & turned)


def _predict(start: _Points, step: Array) -> _Prediction:
    """Compute steps of size (T,) [rad, lengths] along the tangents, as far as the whole load."""
    remaining = 1.0 - start.share
    whole = np.abs(start.rate * remaining[:, None]).max(axis=1)
    cut = np.minimum(1.0, step / np.maximum(whole, step))
    move = start.rate * (remaining * cut)[:, None]
    length = np.linalg.norm(move, axis=1, keepdims=True)
    lands = cut == 1.0
    share = np.where(lands, 1.0, start.share + cut * remaining)
    return _Prediction(move, move / np.where(length > 0.0, length, 1.0), share, lands, whole * cut)


def _correct(robot: ParallelRobot, start: _Points, ahead: _Prediction, load: Load) -> _Corrected:
    """Lead steps back to the curve by Newton's method.

    A step that lands under the whole load keeps its share; another one keeps the joints' motion along the
    tangent, and takes one more iteration, to rounding, as a tangent at a soft place needs.
    """
    end = _Points(_move(robot, start.q, ahead.move), ahead.share, np.zeros_like(ahead.move))
    along = np.linalg.norm(ahead.move, axis=1)
    correction = np.zeros(len(along))  # largest entries of all Newton steps so far, [rad, lengths]
    was_small, met, stable = np.zeros((3, len(along)), dtype=bool)
    live = np.arange(len(along))
    for _ in range(MAX_ITERATIONS):
        state = balance(robot, end.q[live], load.select(live)._replace(share=end.share[live]))
        move, gain = _newton_step(state, ahead.tangent[live], ahead.lands[live])
        size = np.abs(move).max(axis=1)
        correction[live] += size
        near = correction[live] <= np.maximum(MAX_CORRECTION_RATIO * ahead.size[live], UNCHECKED_MOTION)
        move = np.where(near[:, None], move, 0.0)
        end.q[live] = _move(robot, end.q[live], move)
        end.share[live] += np.where(near, gain, 0.0)
        along[live] += dot(ahead.tangent[live], move)
        is_small = size < NEWTON_STEP
        ended = near & is_small & (ahead.lands[live] | was_small[live])
        was_small[live] = is_small
        met[live[ended]] = True
        end.rate[live[ended]], stable[live[ended]] = _tangents(
            state.H[ended], state.drive[ended], state.null[ended]
        )
        live = live[near & ~ended]
        if not len(live):
            break
    return _Corrected(end, along, met, stable)


def _newton_step(state: Balance, tangent: Array, lands: BoolArray) -> tuple[Array, Array]:
    """Compute Newton's step (T, f) to the curve, and the change (T,) of the share."""
    along = np.where(lands[:, None], 0.0, matvec(state.null.swapaxes(1, 2), tangent))
    bordered = np.block([[state.H, state.drive[:, :, None]], [along[:, None], lands[:, None, None]]])
    right = np.append(-state.slope, np.zeros((len(along), 1)), axis=1)
    with np.errstate(all="ignore"):  # what is singular, or no number, ends there
        step = solve(bordered, right)
        return state.closing + matvec(state.null, step[:, :-1]), step[:, -1]


def _folds(robot: ParallelRobot, start: _Points, load: Load) -> TurningPoints:
    """Find the turning points of the share ahead of points on the curve."""

    def evaluate(q: Array, share: Array) -> CurveEquations:
        """Compute the loops across the null space of the closures, and the energy's slope along."""
        state = balance(robot, q, load._replace(share=share))
        size = np.abs(state.H).max(axis=(1, 2))[:, None]
        null = state.null
        inner = state.H / size[:, None] - np.eye(null.shape[2])
        matrix = np.eye(null.shape[1]) + matmul(null, matmul(inner, null.swapaxes(1, 2)))
        drive, slope = matvec(null, state.drive / size), matvec(null, state.slope / size)
        return CurveEquations(matrix, drive, slope - state.closing, state.linearised)

    columns, still = moving_columns(robot), np.zeros((len(start.q), robot.model.nv))
    return turning_points(Curves(robot, columns, still, evaluate), start.q, start.share)


def _move(robot: ParallelRobot, q: Array, move: Array) -> Array:
    """Return configurations (T, nq) after moves (T, f) [rad, lengths of the robot]."""
    columns = moving_columns(robot)
    return integrate_columns(robot, q, columns, move * robot.column_scale[columns])
