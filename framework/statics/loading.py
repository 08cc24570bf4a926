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

from framework.arrays import Array, ArrayLike, BoolArray, IntArray, ReadOnlyArrays
from framework.dynamics.tangent_stiffness import (
    Balance,
    Load,
    balance,
    given_wrench,
    moving_columns,
    spring_forces,
    tangent_stiffness,
)
from framework.kinematics.continuation.turning_point import (
    CurveEquations,
    TurningPoints,
    turning_points,
)
from framework.kinematics.frames import difference, frames_at, integrate
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.modes import mode_signs
from framework.kinematics.parallel_robot import ParallelRobot
from framework.linalg.ordered_sums import dot, matmul, matvec, solve
from framework.statics.stiffness import (
    MAX_STEP,
    CompliantMotions,
    compliant_motions,
    require_springs,
)
from framework.tolerances import EIGENVALUE_ROUNDING, MAX_DEFLECTION, NEWTON_STEP

MAX_CORRECTION_RATIO = 0.25  # of a step, as along other branches: more may be another equilibrium
MAX_SHARE_GAP = 0.1  # of what the steeper tangent gains: two folds of a cubic between two points leave 1 / 6
UNCHECKED_MOTION = 1e-7  # [rad, lengths] a motion with no room for a fold
MAX_STEPS = 1000  # along the curve; most robots take one, and 0.1 rad each lead beyond what springs bear
MAX_ITERATIONS = 8  # of Newton's method a step


class LoadReason(IntEnum):
    """Whether a configuration carries the load, or why it does not."""

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
    """T configurations under the load; those with a reason have not borne all of it."""

    q: Array  # (T, nq)
    reason: NDArray[np.uint8]  # (T,) `LoadReason`
    share: Array  # (T,) of the load that was reached
    free: CompliantMotions  # at q, with the stiffness under load in place of that of the springs


class _Points(NamedTuple):
    """T configurations on the curve, and how it goes on."""

    q: Array  # (T, nq)
    share: Array  # (T,) of the load
    rate: Array  # (T, f) of the moving columns with respect to the share, radians and lengths of the robot

    def at(self, which: IntArray | BoolArray) -> _Points:
        """Return some of them."""
        return _Points(self.q[which], self.share[which], self.rate[which])


class _Arrival(NamedTuple):
    """Where T steps along the curve lead."""

    points: _Points
    size: Array  # (T,) [rad, lengths] of the step, before its correction
    good: BoolArray  # (T,) whether it counts
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
    count = len(q)
    load = Load(given_wrench(robot, wrench), np.zeros(count), spring_forces(robot, q))
    unloaded = balance(robot, q, load)
    current = _Points(q.copy(), load.share, _tangents(unloaded.H, unloaded.drive, unloaded.null)[0])
    step, reason = np.full(count, MAX_STEP), np.full(count, LoadReason.NOT_CONVERGED, dtype=np.uint8)
    live = np.arange(count)
    for _ in range(MAX_STEPS):
        if not len(live):
            break
        start, whole_load = current.at(live), load.at(live)
        ahead = _stepped(robot, start, whole_load, step[live])
        good, reached = ahead.good, ahead.points
        step[live] = np.where(good, np.minimum(2.0 * ahead.size, MAX_STEP), 0.5 * ahead.size)
        for values, new in zip(current, reached, strict=True):
            values[live[good]] = new[good]
        soft = good & (reached.share <= 1.0) & ~_is_small(robot, reached.q)
        short = ~good & (ahead.size <= UNCHECKED_MOTION)
        reason[live[good & (reached.share == 1.0)]] = LoadReason.CARRIED
        reason[live[soft]] = LoadReason.TOO_SOFT
        reason[live[short & ahead.lost]] = LoadReason.GIVES_WAY
        turned = np.flatnonzero(ahead.turned)
        if len(turned):
            folds = _folds(robot, start.at(turned), whole_load.at(turned))
            snaps = live[turned[folds.found]]
            current.q[snaps], current.share[snaps] = folds.q[folds.found], folds.share[folds.found]
            reason[snaps] = LoadReason.GIVES_WAY
        live = live[~short & (reason[live] == LoadReason.NOT_CONVERGED)]
    x = robot.platform.coordinates(frames_at(robot, current.q))
    linearised = linearised_at(robot, current.q, x)
    at_rest = linearised_at(robot, q, robot.platform.coordinates(frames_at(robot, q)))
    crossed = mode_signs(robot, linearised)[1] != mode_signs(robot, at_rest)[1]
    reason[crossed & (reason == LoadReason.CARRIED)] = LoadReason.OTHER_MODE
    free = compliant_motions(robot, linearised, current.q)
    free = free._replace(K=tangent_stiffness(robot, linearised, current.q, free.Z, load))
    return LoadedStack(current.q, reason, current.share, free)


def _tangents(H: Array, drive: Array, null: Array) -> tuple[Array, BoolArray]:
    """Compute rates (T, f) with respect to the share; return whether the stiffness is positive definite."""
    values, vectors = np.linalg.eigh(H)
    rounding = EIGENVALUE_ROUNDING * np.abs(values).max(axis=1, keepdims=True)
    along = matvec(vectors.swapaxes(1, 2), drive) / np.where(np.abs(values) > rounding, values, rounding)
    return -matvec(null, matvec(vectors, along)), values[:, 0] > rounding[:, 0]


def _stepped(robot: ParallelRobot, start: _Points, load: Load, step: Array) -> _Arrival:
    """Find equilibria a step (T,) [rad, lengths] further on, or under the whole load if that is nearer.

    A step that ends before holds the joints' motion along the tangent while it is corrected, and one that
    ends there the share. Where the curve leads beyond the whole load, the next step leads back. Where it is
    to go on it is met to rounding, as a tangent at a soft place needs.
    """
    remaining = 1.0 - start.share
    whole = np.abs(start.rate * remaining[:, None]).max(axis=1)
    cut = np.minimum(1.0, step / np.maximum(whole, step))
    predicted = start.rate * (remaining * cut)[:, None]
    lands, size, length = cut == 1.0, whole * cut, np.linalg.norm(predicted, axis=1)
    tangent = predicted / np.where(length > 0.0, length, 1.0)[:, None]
    share = np.where(lands, 1.0, start.share + cut * remaining)
    q, rate, along = _moved(robot, start.q, predicted), np.zeros_like(predicted), length.copy()
    correction, (near, done, stable) = np.zeros(len(q)), np.zeros((3, len(q)), dtype=bool)
    live = np.arange(len(q))
    for _ in range(MAX_ITERATIONS):
        state = balance(robot, q[live], load.at(live)._replace(share=share[live]))
        move, gain = _correction(state, tangent[live], lands[live])
        last = np.abs(move).max(axis=1)
        correction[live] += last
        on = correction[live] <= np.maximum(MAX_CORRECTION_RATIO * size[live], UNCHECKED_MOTION)
        move, gain = np.where(on[:, None], move, 0.0), np.where(on, gain, 0.0)
        q[live], share[live] = _moved(robot, q[live], move), share[live] + gain
        along[live] += dot(tangent[live], move)
        ended = on & (last < NEWTON_STEP) & (lands[live] | near[live])
        near[live] = last < NEWTON_STEP
        settled = live[ended]
        done[settled] = True
        rate[settled], stable[settled] = _tangents(state.H[ended], state.drive[ended], state.null[ended])
        live = live[on & ~ended]
        if not len(live):
            break
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = 1.0 / np.array([dot(tangent, start.rate), dot(tangent, rate)])  # of the share
        gap = np.abs(share - start.share - 0.5 * along * slopes.sum(axis=0))
        straight = gap <= MAX_SHARE_GAP * np.abs(along * slopes).max(axis=0)
        turned = slopes.prod(axis=0) < 0.0
    done &= straight | (size <= UNCHECKED_MOTION)
    lost = done & ~stable
    return _Arrival(_Points(q, share, rate), size, done & stable, lost, lost & turned)


def _correction(state: Balance, tangent: Array, lands: BoolArray) -> tuple[Array, Array]:
    """Compute Newton's step (T, f) to the curve, and by how much (T,) the share changes with it."""
    d = state.H.shape[1]
    bordered, right = np.zeros((len(state.H), d + 1, d + 1)), np.zeros((len(state.H), d + 1))
    bordered[:, :d, :d], bordered[:, :d, d], right[:, :d] = state.H, state.drive, -state.slope
    bordered[:, d, :d] = np.where(lands[:, None], 0.0, matvec(state.null.swapaxes(1, 2), tangent))
    bordered[:, d, d] = lands
    with np.errstate(all="ignore"):  # what is singular, or no number, ends there
        step = solve(bordered, right)
        return state.closing + matvec(state.null, step[:, :d]), step[:, d]


def _folds(robot: ParallelRobot, start: _Points, load: Load) -> TurningPoints:
    """Find where the share turns back, ahead of points on the curve."""

    def evaluate(q: Array, share: Array) -> CurveEquations:
        """Compute loops along what opens them, and the slope of the energy along what does not."""
        state = balance(robot, q, load._replace(share=share))
        size = np.abs(state.H).max(axis=(1, 2))[:, None]
        null, turned = state.null, state.null.swapaxes(1, 2)
        matrix = np.eye(null.shape[1]) + matmul(
            null, matmul(state.H / size[:, None] - np.eye(null.shape[2]), turned)
        )
        drive, slope = matvec(null, state.drive / size), matvec(null, state.slope / size)
        return CurveEquations(matrix, drive, slope - state.closing, state.linearised)

    columns, still = moving_columns(robot), np.zeros((len(start.q), robot.model.nv))
    return turning_points(robot, start.q, start.share, columns, still, evaluate)


def _moved(robot: ParallelRobot, q: Array, move: Array) -> Array:
    """Return configurations (T, nq) after moves (T, f) [rad, lengths of the robot]."""
    columns = moving_columns(robot)
    tangent = np.zeros((len(q), robot.model.nv))
    tangent[:, columns] = move * robot.column_scale[columns]
    return integrate(robot, q, tangent)


def _is_small(robot: ParallelRobot, q: Array) -> BoolArray:
    """Whether deflections (T,) are within the range of linear springs."""
    turned = difference(robot, robot.neutral, q) / robot.column_scale
    return np.asarray(np.abs(turned[:, robot.elastic]).max(axis=1, initial=0.0) <= MAX_DEFLECTION)
