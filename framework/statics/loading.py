"""Many configurations loaded little by little, motors locked: what carries the load, and what gives way.

The share of weight and wrench grows from 0 to 1 and the equilibrium is followed: each step of the share is
taken by Newton's method and counts only if the tangent stiffness is positive definite all along and if what
follows the first Newton step is small beside it; else half of it is tried. So the equilibrium reached is the
one that the unloaded configuration leads to without a jump. Where not even a millionth of the load more is
borne like that, the stiffness is lost, at a fold (snap-through) or a bifurcation (buckling), and the reason
says so.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from framework.arrays import Array, ArrayLike, BoolArray, ReadOnlyArrays
from framework.dynamics.elasticity import LARGEST
from framework.dynamics.tangent_stiffness import (
    Load,
    balance,
    given_wrench,
    moving_columns,
    spring_forces,
    tangent_stiffness,
)
from framework.kinematics.frames import difference, frames_at, integrate
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.modes import mode_signs
from framework.kinematics.parallel_robot import ParallelRobot
from framework.linalg.ordered_sums import matvec
from framework.statics.stiffness import (
    MAX_STEP,
    CompliantMotions,
    compliant_motions,
    require_springs,
)
from framework.tolerances import EIGENVALUE_ROUNDING, NEWTON_STEP

MAX_CORRECTION_RATIO = 0.1  # of steps after the first, over that one: more may be another equilibrium
UNCHECKED_CORRECTION = 1e-7  # [rad, lengths] a motion with no room for a fold
MIN_LOAD_STEP = 2.0**-20  # of the load: what does not bear as little more has lost its stiffness
MAX_ITERATIONS = 8  # of Newton's method a step of the load


class LoadReason(IntEnum):
    """Whether a configuration carries the load, or why it does not."""

    CARRIED = 0
    GIVES_WAY = 1  # the stiffness is lost before the whole load is on: it snaps through, or buckles
    TOO_SOFT = 2  # deflections beyond `elasticity.LARGEST`
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
    current, step = q.copy(), np.ones(count)
    reason = np.full(count, LoadReason.CARRIED, dtype=np.uint8)
    live = np.arange(count)
    while len(live):  # a step halves at most 20 times between two that count
        share = np.minimum(load.share[live] + step[live], 1.0)
        ahead, good, finite = _stepped(robot, current[live], load.at(live)._replace(share=share))
        current[live[good]], load.share[live[good]] = ahead[good], share[good]
        step[live] *= np.where(good, 2.0, 0.5)
        soft = live[good][~_is_small(robot, ahead[good])]
        ended = ~good & (step[live] < MIN_LOAD_STEP)
        reason[live[ended]] = np.where(finite[ended], LoadReason.GIVES_WAY, LoadReason.NOT_CONVERGED)
        reason[soft] = LoadReason.TOO_SOFT
        live = live[(load.share[live] < 1.0) & (reason[live] == LoadReason.CARRIED)]
    x = robot.platform.coordinates(frames_at(robot, current))
    linearised = linearised_at(robot, current, x)
    at_rest = linearised_at(robot, q, robot.platform.coordinates(frames_at(robot, q)))
    crossed = mode_signs(robot, linearised)[1] != mode_signs(robot, at_rest)[1]
    reason[crossed & (reason == LoadReason.CARRIED)] = LoadReason.OTHER_MODE
    free = compliant_motions(robot, linearised, current)
    free = free._replace(K=tangent_stiffness(robot, linearised, current, free.Z, load))
    return LoadedStack(current, reason, load.share, free)


def _stepped(robot: ParallelRobot, q: Array, load: Load) -> tuple[Array, BoolArray, BoolArray]:
    """Find equilibria (T, nq) under a slightly larger load; return which are accepted, and which finite."""
    columns, q = moving_columns(robot), q.copy()
    lengths = robot.column_scale[columns]
    first, after = np.zeros(len(q)), np.zeros(len(q))
    good, finite = np.zeros(len(q), dtype=bool), np.ones(len(q), dtype=bool)
    live = np.arange(len(q))
    for k in range(MAX_ITERATIONS):
        state = balance(robot, q[live], load.at(live))
        sound = np.asarray(np.isfinite(state.H).all(axis=(1, 2)) & np.isfinite(state.slope).all(axis=1))
        finite[live] = sound
        values, vectors = np.linalg.eigh(np.where(sound[:, None, None], state.H, 0.0))
        on = values[:, 0] > EIGENVALUE_ROUNDING * values[:, -1]  # what is no number has become zero
        values = np.where(on[:, None], values, 1.0)
        move = state.closing - matvec(
            state.null, matvec(vectors, matvec(vectors.swapaxes(1, 2), state.slope) / values)
        )
        size = np.abs(move).max(axis=1)
        (first if k == 0 else after)[live] += size
        on &= first[live] <= MAX_STEP
        on &= after[live] <= np.maximum(MAX_CORRECTION_RATIO * first[live], UNCHECKED_CORRECTION)
        good[live] = on & (size < NEWTON_STEP)
        on &= size >= NEWTON_STEP
        live, move = live[on], move[on]
        if not len(live):
            break
        tangent = np.zeros((len(live), robot.model.nv))
        tangent[:, columns] = move * lengths
        q[live] = integrate(robot, q[live], tangent)
    return q, good, finite


def _is_small(robot: ParallelRobot, q: Array) -> BoolArray:
    """Whether deflections (T,) are within the range of linear springs."""
    turned = difference(robot, robot.neutral, q) / robot.column_scale
    return np.asarray(np.abs(turned[:, robot.elastic]).max(axis=1, initial=0.0) <= LARGEST)
