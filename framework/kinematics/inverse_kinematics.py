"""Inverse kinematics: Newton's method on the loops at prescribed platform coordinates.

With x and the deflections q_e given, F(q) = [platform(q) - x ; closures(q)] = 0 fixes all other
coordinates. Its Jacobian along them is square and regular everywhere but in Type 1 singularities; in
particular Type 2 singularities do not trouble it.

None of these equations fixes the spin of a rod between two balls. Planning holds the rate of such a spin at
zero about axes that move with the rod. The resulting angle depends on the poses before, steps of Newton's
method included, so it is no smooth function of time to the last digits. Where configurations are interpolated
(`remove_idle_spin`), the rotation vector of the ball from the start of the branch has no component along the
axis. No force depends on the difference, as no centre of mass moves.
"""

from __future__ import annotations

import numpy as np

from framework.arrays import Array, IntArray
from framework.errors import InvalidInput, NotAssembled
from framework.kinematics.frames import (
    difference,
    difference_rates,
    integrate,
)
from framework.kinematics.idle_turns import turn_motions
from framework.kinematics.linearised_loops import ClosedStack, LinearisedLoops, linearised_at
from framework.kinematics.newton import MAX_ITERATIONS, Linear, NewtonResult, Which, newton
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import is_ball
from framework.tolerances import NEWTON_STEP

SPIN_ROUNDING = 1e-15  # [rad] of the component
MAX_SPIN_STEPS, MAX_SPIN_STEP = 20, 1.0  # Newton steps towards it, [rad] that one may turn


def require_square(robot: ParallelRobot) -> None:
    """Raise InvalidInput unless x and the loops determine all joints, with enough motors."""
    springs_alone = robot.structure.springs_alone
    if springs_alone:
        raise InvalidInput(
            f"{robot.name}, {robot.flexibility}: {', '.join(springs_alone)} can only be closed by springs: "
            f"the joints cannot move along them; lock fewer axes there (axes: [...]) or leave those axes "
            f"out of the springs' motion"
        )
    require_mobility(robot)


def require_mobility(robot: ParallelRobot) -> None:
    """Raise InvalidInput unless the robot has as many platform axes as freedoms, and no fewer motors."""
    loops = len(robot.loops.names)
    joints = len(robot.moving)
    mobility = joints - loops
    if not robot.n == mobility <= robot.n_a:
        raise InvalidInput(
            f"{robot.name}: {robot.n} platform axes, {robot.n_a} actuators, {mobility} degrees of "
            f"freedom ({joints} joints less {loops} independent loop equations); planning needs as many "
            f"platform axes as degrees of freedom, and no fewer actuators"
        )


def close_loops(
    robot: ParallelRobot, x: Array, guess: Array, *, last_step: float = NEWTON_STEP
) -> ClosedStack:
    """Close all loops at platform coordinates x (T, n), from guess (T, nq) near the solution.

    The elastic coordinates keep the values of the guess. `last_step` as in `newton`.

    Raises:
        NotAssembled: some instant does not close; carries its last iterate and residual.
    """
    q, linearised, closed = close_each(robot, x, guess, last_step=last_step)
    if closed.all():
        return ClosedStack(q, x, linearised)
    left = np.where(closed, 0.0, np.nan_to_num(np.abs(linearised.residual), nan=np.inf).max(axis=1))
    worst = int(np.argmax(left))
    residual = float(np.abs(linearised.residual[worst]).max())
    raise NotAssembled(
        f"{robot.name}: the loops do not close at {robot.place(x[worst])}: "
        f"{residual:.3g} m or rad left after {MAX_ITERATIONS} iterations",
        q=q[worst],
        residual=residual,
    )


def close_each(
    robot: ParallelRobot,
    x: Array,
    guess: Array,
    *,
    iterations: int = MAX_ITERATIONS,
    farthest: float = np.inf,
    last_step: float = NEWTON_STEP,
) -> NewtonResult[LinearisedLoops]:
    """Close the loops at each instant of x (T, n), or not; options of `newton`."""

    def evaluate(q: Array, which: Which) -> LinearisedLoops:
        return linearised_at(robot, q, x[which])

    def linear(linearised: LinearisedLoops) -> Linear:
        return Linear(linearised.residual, linearised.factors)

    return newton(
        robot,
        guess,
        robot.moving,
        evaluate,
        linear,
        iterations=iterations,
        farthest=farthest,
        last_step=last_step,
    )


def idle_balls(robot: ParallelRobot) -> IntArray:
    """Return entries of the velocity vector that are idle and belong to balls."""
    if not len(robot.structure.idle):  # reading joints, each a copy, takes as long as closing the loops
        return robot.structure.idle
    first = np.array([joint.idx_v for joint in robot.model.joints[1:] if is_ball(joint)], dtype=np.intp)
    columns = first[:, None] + np.arange(3)
    return np.intersect1d(robot.structure.idle, columns).astype(np.intp)


def remove_idle_spin(robot: ParallelRobot, origin: Array, q: Array, x: Array) -> Array:
    """Turn the idle balls of q (T, nq) at x (T, n) to zero spin from `origin` (nq,).

    Raises:
        NotAssembled: a configuration is on a singularity of the inverse kinematics.
    """
    idle = idle_balls(robot)
    for _ in range(MAX_SPIN_STEPS if len(idle) and len(q) else 0):
        spin = difference(robot, origin, q)[:, idle]
        if np.abs(spin).max() <= SPIN_ROUNDING:
            break
        turns = turn_motions(robot, linearised_at(robot, q, x))[:, :, np.isin(robot.structure.idle, idle)]
        rates = np.stack(
            [difference_rates(robot, origin, q, turns[:, :, k])[:, idle] for k in range(len(idle))], axis=2
        )
        angles = np.linalg.solve(rates, -spin[:, :, None])
        angles /= np.maximum(np.abs(angles).max(axis=1, keepdims=True) / MAX_SPIN_STEP, 1.0)
        q = close_loops(robot, x, integrate(robot, q, (turns @ angles)[:, :, 0])).q
    return q
