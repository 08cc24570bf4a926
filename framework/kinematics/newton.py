"""Newton's method on the loop equations of many configurations at once, each for itself.

The coordinates that move and the equations are arguments: all joints for a prescribed platform (inverse
kinematics), the passive joints for prescribed motors (forward kinematics). The reference of a robot, where
neither is prescribed, is closed by `assembly`; the start of a simulation, its witness, by its own code.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from framework.arrays import Array, IntArray
from framework.kinematics.assembly import MAX_NEWTON_STEP
from framework.kinematics.frames import integrate_columns
from framework.kinematics.mechanism import Mechanism
from framework.linalg.banded_lu import Factors
from framework.tolerances import NEWTON_STEP

ROUNDING_STEP = 2e-15  # a step of rounding (angles near 2 pi are 1e-15 apart): the loops are closed before it
MAX_ITERATIONS = 25

S = TypeVar("S")
Which = IntArray | slice  # some of the instants


class Linear(NamedTuple):
    """Square equations at T configurations: their values, and their derivatives along `columns`, factored."""

    residual: Array  # (T, k)
    factors: Factors  # k x k


class NewtonResult(NamedTuple, Generic[S]):
    """The result of Newton's method."""

    q: Array  # (T, nq)
    linearised: S  # the equations there
    closed: NDArray[np.bool_]  # (T,) whether the last step was rounding


def newton(
    robot: Mechanism,
    guess: Array,
    columns: IntArray,
    evaluate: Callable[[Array, Which], S],
    linear: Callable[[S], Linear],
    *,
    iterations: int = MAX_ITERATIONS,
    farthest: float = np.inf,
    last_step: float = NEWTON_STEP,
) -> NewtonResult[S]:
    """Solve the equations for q (T, nq) near the guess (T, nq), where only `columns` (k,) move.

    Steps are bounded. An instant without a solution is not `closed` and leaves the others alone.

    Args:
        evaluate: the equations at q (t, nq) for some of the instants.
        linear: their values and derivatives.
        farthest: an instant is given up at a larger step [rad, lengths of the robot].
        last_step: an instant is closed after a step as small as this, but for about its square.
    """
    lengths = robot.column_scale[columns]
    q, largest, size = guess, np.inf, np.full(len(guess), np.inf)
    live: Which = slice(None)
    for _ in range(iterations):
        linearised = evaluate(q[live], live)
        if largest < last_step or not len(size):
            break
        residual, factors = linear(linearised)
        sound = None
        try:
            steps = -factors.solve(residual) / lengths
            size = np.abs(steps).max(axis=1, initial=0.0)
            largest = float(size.max())
            if not largest < np.inf:  # one instant without numbers spoils all that are factored with it
                finite = np.isfinite(residual).all(axis=1)
                sound = np.isfinite(size) if finite.all() else finite
        except np.linalg.LinAlgError:  # one instant is singular
            sound = factors.slogdet[0] != 0
        if sound is not None:
            live, size, largest = np.arange(len(guess))[live][sound], size[sound], np.inf
            continue
        if largest > farthest:
            near = size <= farthest
            live, size, steps = np.arange(len(guess))[live][near], size[near], steps[near]
            largest = float(size.max(initial=0.0))
        if largest < ROUNDING_STEP:
            break
        if largest > MAX_NEWTON_STEP:
            steps /= np.maximum(size / MAX_NEWTON_STEP, 1.0)[:, None]
        stepped = integrate_columns(robot, q[live], columns, steps * lengths)
        if len(size) == len(q):
            q = stepped
        else:
            q = q.copy()
            q[live] = stepped
    else:
        linearised = evaluate(q[live], live)
    closed = np.zeros(len(guess), dtype=bool)
    closed[live] = size < last_step
    if len(size) < len(guess):
        linearised = evaluate(q, slice(None))
    return NewtonResult(q, linearised, closed)
