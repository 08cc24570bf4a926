"""Newton's method on the loop equations of many configurations at once, each for itself.

Which coordinates move and which equations they are to meet is data: all joints for a given platform (inverse
kinematics), the passive ones for given motors (forward kinematics). The reference of a robot is closed in
another way, since neither is given there (`assembly`), and so is the start of a simulation, its witness.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from framework.arrays import Array, IntArray
from framework.kinematics.assembly import LONGEST_STEP
from framework.kinematics.closures import column_scale
from framework.kinematics.frames import integrate
from framework.linalg.banded_lu import Factors
from framework.model import ParallelRobot

# A Newton step this small leaves an error of its square: rounding. In radians and robot lengths.
LAST_STEP = 1e-8
EXACT = 2e-15  # a step of rounding (angles near 2 pi are 1e-15 apart): the loops are closed before it
ITERATIONS = 25

S = TypeVar("S")


class Linear(NamedTuple):
    """Square equations at T configurations: their values, and their derivatives along `columns`, factored."""

    residual: Array  # (T, k)
    factors: Factors  # k x k


class Closing(NamedTuple, Generic[S]):
    """Where Newton's method has led."""

    q: Array  # (T, nq)
    system: S  # the equations there
    closed: NDArray[np.bool_]  # (T,) whether the last step was rounding


def newton(
    robot: ParallelRobot,
    guess: Array,
    columns: IntArray,
    evaluate: Callable[[Array, IntArray], S],
    linear: Callable[[S], Linear],
    *,
    iterations: int = ITERATIONS,
    farthest: float = np.inf,
) -> Closing[S]:
    """Configurations q (T, nq) near the guess (T, nq) that meet the equations; only `columns` (k,) move.

    Steps are bounded. What has no solution is told by `closed` and leaves the others alone.

    Args:
        evaluate: the equations at q (t, nq) for some of the instants (t,).
        linear: their values and derivatives.
        farthest: an instant is given up when a step asks for more [rad, lengths of the robot].
    """
    lengths = column_scale(robot)[columns]
    q, live, size = guess.copy(), np.arange(len(guess)), np.full(len(guess), np.inf)
    for _ in range(iterations):
        if not len(live) and len(guess):
            break
        system = evaluate(q[live], live)
        if size.max(initial=0.0) < LAST_STEP:
            break
        residual, factors = linear(system)
        try:
            steps = -factors.solve(residual) / lengths
        except np.linalg.LinAlgError:
            keep = factors.slogdet[0] != 0
            live, size = live[keep], size[keep]
            continue
        size = np.abs(steps).max(axis=1, initial=0.0)
        if not np.isfinite(size).all():  # one instant without numbers spoils all that are factored with it
            finite = np.isfinite(residual).all(axis=1)
            keep = np.isfinite(size) if finite.all() else finite
            live, size = live[keep], np.full(int(keep.sum()), np.inf)
            continue
        largest = size.max(initial=0.0)
        if largest < EXACT:
            break
        if largest > farthest:
            keep = size <= farthest
            live, size, steps = live[keep], size[keep], steps[keep]
        if largest > LONGEST_STEP:
            steps /= np.maximum(size / LONGEST_STEP, 1.0)[:, None]
        moved = np.zeros((len(live), robot.model.nv))
        moved[:, columns] = steps * lengths
        q[live] = integrate(robot, q[live], moved)
    else:
        system = evaluate(q[live], live)
    closed = np.zeros(len(guess), dtype=bool)
    closed[live] = size < LAST_STEP
    if len(live) < len(guess):
        system = evaluate(q, np.arange(len(q)))
    return Closing(q, system, closed)
