"""Exact derivatives of the motion of all joints along coordinates of the closed robot.

The coordinates y are those of the platform and positions of joints that the platform does not determine. Let
Y = dq/dy be the motions that keep the loops closed. A change dy changes a motion q(t) by Y dy, and its rates
and accelerations by the time derivatives of Y dy. With J = dF/dq along the motion, and primes for time
derivatives,

    J Y = E,        J Y' = E' - J' Y,        J Y" = E" - 2 J' Y' - J" Y,

where E has the platform's twists for unit rates (`unit_twists`). Like the motion itself, the derivatives are
regular at Type 2.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput
from framework.kinematics.idle_turns import driven_turns
from framework.kinematics.motion_rates import Motion, jacobian_rates, solve_rates
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.platform import CoordinateRates
from framework.kinematics.tree_model import ball_columns
from framework.numerics.arrays import Array, IntArray
from framework.numerics.ordered_sums import cross


class MotionChanges(NamedTuple):
    """Changes of a motion by unit steps of k coordinates, (T, k, nv) each.

    A unit step of a position changes q, v and a by the fields of these names. A unit step of a rate changes v
    by `q` and a by `a_by_rates`. A unit step of an acceleration changes a by `q`.
    """

    q: Array
    v: Array
    a: Array
    a_by_rates: Array

    @property
    def accelerations(self) -> Array:
        """Changes (3, T, k, nv) of a by unit steps of positions, rates and accelerations."""
        return np.stack([self.a, self.a_by_rates, self.q])


def coordinate_changes(
    robot: ParallelRobot, motion: Motion, columns: IntArray, x: CoordinateRates | None = None
) -> MotionChanges:
    """Compute the changes of a motion by unit steps of k coordinates.

    First come the coordinates of the platform, unless x is None, then the joints `columns`. Let dq and dv be
    the changes by a step of a position. A step of a rate changes a by 2 dv - [v, dq]. The Lie bracket [v, dq]
    of the motions is zero except for balls, whose rates are not derivatives of coordinates. The part of
    changes along `columns` is removed, because the rates and accelerations of these joints are coordinates
    with steps of their own.

    Args:
        columns: joints that are coordinates.
        x: platform coordinates x and their rates dx, ddx, (T, n) each.

    Raises:
        NotAssembled: the platform does not determine the joints at some instant.
    """
    n = 0 if x is None else robot.n
    size = n + len(columns)
    J = motion.linearised.jacobian  # (T, n + m, nv)
    right = np.zeros((3, len(J), size, J.shape[1]))  # E of all coordinates and two time derivatives
    if x is not None:
        right[:, :, :n, :n] = robot.platform.unit_twists(x)
    right[0, :, n:] = -J[:, :, columns].swapaxes(1, 2)
    dq = _solve_moving(robot, motion, right[0])
    dq[:, range(n, size), columns] = 1.0

    def rest_columns(change: Array) -> Array:
        """Return changes (T, k, nv) of rates with `columns` brought to rest by closed motions."""
        return change - change[..., columns] @ dq[:, n:]

    rates = jacobian_rates(robot, motion.linearised, motion.v, motion.a)
    dJ, ddJ = (matrix.swapaxes(1, 2) for matrix in rates)
    bracket = _bracket_on_balls(robot, motion.v, dq)  # [v, dq]
    dv = rest_columns(_solve_moving(robot, motion, right[1] - dq @ dJ) + bracket)
    rate = dv - bracket  # Y'
    da = _solve_moving(robot, motion, right[2] - 2.0 * rate @ dJ - dq @ ddJ)
    da += _bracket_on_balls(robot, motion.a, dq) + _bracket_on_balls(robot, motion.v, rate)
    return MotionChanges(dq, dv, rest_columns(da), 2.0 * dv - rest_columns(bracket))


def _solve_moving(robot: ParallelRobot, motion: Motion, right: Array) -> Array:
    """Solve J rates = right (T, k, n + m) for rates (T, k, nv) of the moving joints."""
    return solve_rates(robot, motion.linearised, right.swapaxes(0, 1)).swapaxes(0, 1)


def _bracket_on_balls(robot: ParallelRobot, rates: Array, motions: Array) -> Array:
    """Compute the bracket (T, k, nv) of rates (T, nv) and motions (T, k, nv), zero except for balls."""
    bracket, balls = np.zeros_like(motions), ball_columns(robot.model)
    if len(balls):
        bracket[..., balls] = cross(rates[:, None, balls], motions[..., balls])
    return bracket


def require_turns_at_rest(robot: ParallelRobot) -> None:
    """Raise InvalidInput if damping or armature of balls drives an idle turn."""
    turns = driven_turns(robot)
    if len(turns):
        names = ", ".join(robot.coordinates.name_of(column) for column in turns)
        raise InvalidInput(
            f"{robot.name}: the damping or the armature of balls drives the idle turns {names}; "
            f"they are taken for turns at rest here: leave damping and armature of these balls out"
        )
