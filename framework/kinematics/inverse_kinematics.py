"""Inverse kinematics: Newton's method on the loops at prescribed platform coordinates; idle turns.

At given x and deflections q_e, F(q) = [platform(q) - x ; closures(q)] = 0 determines all other coordinates.
The Jacobian along these is square, and regular except at Type 1 singularities; Type 2 singularities do not
matter. If the motors are prescribed instead (`close_each` without x), closures(q) = 0 determines the passive
joints, except at Type 2. `assembly` closes the reference, where neither is prescribed. The simulation, an
independent check, closes its start with its own code.

Idle turns are motions that these equations do not determine: a rod between two balls may turn about its own
axis without moving a centre of mass. The turn rests if nothing acts on it. Damping in the balls drives it;
without damping, armature in the balls does. With G the diagonal matrix of damping or armature, Z(q) the
motion of the turn alone, and joint rates v and accelerations a,

    Z' G v = 0        no damping torque along the turn, or no angular momentum of the armature
    Z' G a = -dZ/dt' G v

So the rates of the turn remain a function of the pose, linear in the rates of the platform, which motion laws
need. Only balls with equal values about all three axes count, because their effect does not depend on the
angle of the turn. `dynamics.motion_checks` measures the torque that remains: of armature beside damping,
and of the rod's own inertia.

The angle of an idle turn depends on all earlier poses, Newton iterates included, so its last digits are not a
smooth function of time. Before configurations are interpolated, `remove_idle_spin` turns the ball until its
rotation vector from the start of the branch has no component along the axis. No force depends on this angle.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput, NotAssembled
from framework.kinematics.assembly import MAX_ITERATIONS, MAX_NEWTON_STEP
from framework.kinematics.frames import difference, difference_jacobian, integrate, integrate_columns
from framework.kinematics.linearised_loops import (
    LinearisedLoops,
    linearised_at,
    linearised_at_reference,
)
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import ball_columns
from framework.numerics.arrays import Array, BoolArray, IntArray, read_only
from framework.tolerances import NEWTON_STEP

# Smaller steps are rounding and are not taken: angles near 2 pi are 1e-15 apart. Larger ones are taken
# wherever the guess comes from: near a singular point the torques' error is theirs over the distance to it.
ROUNDING_STEP = 2e-15
SMALL_STACK = 70  # instants that are sooner linearised once more than left out


def require_square(robot: ParallelRobot) -> None:
    """Raise InvalidInput unless x and the loops determine all joints and enough motors exist."""
    require_joints_close(robot)
    require_mobility(robot)


def require_joints_close(robot: ParallelRobot) -> None:
    """Raise InvalidInput if only springs can close a loop."""
    rows = robot.structure.spring_only_rows
    if rows:
        raise InvalidInput(
            f"{robot.name}, {robot.flexibility}: {', '.join(rows)} can only be closed by springs: "
            f"the joints cannot move along them; lock fewer axes there (axes: [...]) or leave those axes "
            f"out of the springs' motion"
        )


def require_mobility(robot: ParallelRobot) -> None:
    """Raise InvalidInput unless the mobility equals n and is at most n_a."""
    loops = len(robot.loops.names)
    joints = len(robot.moving)
    mobility = joints - loops
    if not robot.n == mobility <= robot.n_a:
        raise InvalidInput(
            f"{robot.name}: {robot.n} platform axes, {robot.n_a} actuators, {mobility} degrees of "
            f"freedom ({joints} joints less {loops} independent loop equations); planning needs as many "
            f"platform axes as degrees of freedom, and no fewer actuators"
        )


def close_loops(robot: ParallelRobot, x: Array, guess: Array) -> LinearisedLoops:
    """Close all loops at platform coordinates x (T, n), from `guess` (T, nq) near the solution.

    The elastic coordinates keep their values of the guess.

    Raises:
        NotAssembled: an instant does not close; carries its last iterate and residual.
    """
    q, linearised, closed = close_each(robot, x, guess)
    if closed.all():
        return linearised
    gaps = np.abs(linearised.residual).max(axis=1)  # (T,)
    worst = np.argmax(np.where(closed, 0.0, gaps))  # the first NaN if there is one
    residual = float(gaps[worst])
    raise NotAssembled(
        f"the loops do not close at {robot.place(x[worst])}: "
        f"{residual:.3g} m or rad left after {MAX_ITERATIONS} iterations",
        name=robot.name,
        q=q[worst],
        residual=residual,
    )


class NewtonResult(NamedTuple):
    """The result of Newton's method at T instants."""

    q: Array  # (T, nq) last iterates
    linearised: LinearisedLoops  # at q
    closed: BoolArray  # (T,) whether the last step was below `enough`


class LastSteps(NamedTuple):
    """Instants at which Newton's method has closed the loops."""

    instants: IntArray  # (k,) their indices
    linearised: LinearisedLoops  # where their last steps began, which are below `enough`
    are_taken: bool  # whether these steps were taken; false if all are rounding


def close_each(
    robot: ParallelRobot,
    x: Array | None,
    guess: Array,
    *,
    iterations: int = MAX_ITERATIONS,
    farthest: float = np.inf,
    enough: float = NEWTON_STEP,
) -> NewtonResult:
    """Close the loops near guesses (T, nq) as `close_in_place`, and linearise them at the last iterates."""
    q = guess.copy()
    closed = np.zeros(len(q), dtype=bool)
    linearised = None
    for last in close_in_place(robot, x, q, iterations=iterations, farthest=farthest, enough=enough):
        closed[last.instants] = True
        if not last.are_taken and len(last.instants) == len(q):
            linearised = last.linearised
    return NewtonResult(q, linearised or linearised_at(robot, q, x), closed)


def close_in_place(
    robot: ParallelRobot,
    x: Array | None,
    q: Array,
    *,
    iterations: int = MAX_ITERATIONS,
    farthest: float = np.inf,
    enough: float = NEWTON_STEP,
) -> Iterator[LastSteps]:
    """Close the loops near q (T, nq) by Newton's method, in place; yield the instants that close.

    At platform coordinates x (T, n) all joints move; if x is None only the passive joints do. Springs keep
    their deflections. Steps are scaled down to `MAX_NEWTON_STEP`. An instant where the equations are
    singular, or where a step is too large, is dropped and not yielded, and the others go on, each up to its
    own last step.

    Args:
        x: (T, n) platform coordinates, or None.
        q: (T, nq) configurations.
        iterations: largest number of Newton steps.
        farthest: largest step that is accepted [rad, lengths of the robot].
        enough: a step below it is the last one [rad, lengths of the robot].
    """
    columns = robot.following if x is None else robot.moving  # of the joints that move
    units = robot.column_scale[columns]  # [m] of slides, 1 of turns: steps become dimensionless
    inputs = q if x is None else np.concatenate([q, x], axis=1)
    # indices of the instants that still take steps, at first those with finite inputs
    (live,) = np.nonzero(np.isfinite(inputs).all(axis=1))
    for iteration in range(iterations):
        if not len(live):
            return
        linearised = linearised_at(robot, q[live], None if x is None else x[live])
        steps, regular = _newton_steps(robot, linearised, at_motors=x is None)
        if not regular.all():  # a singular instant spoils the steps of all others: repeat without it
            live = live[regular]
            continue

        # drop the instants whose steps are too large
        steps = steps / units
        step_size = np.abs(steps).max(axis=1, initial=0.0)  # largest entry of each step [rad, lengths]
        longest = step_size.max(initial=0.0)
        if longest > farthest:
            is_near = step_size <= farthest
            live, step_size, steps = live[is_near], step_size[is_near], steps[is_near]
            linearised = linearised.select(np.flatnonzero(is_near))
            longest = step_size.max(initial=0.0)
        if longest < ROUNDING_STEP:
            yield LastSteps(live, linearised, are_taken=False)
            return

        # scale long steps down, then take all of them
        steps /= np.maximum(step_size / MAX_NEWTON_STEP, 1.0)[:, None]
        q[live] = integrate_columns(robot, q[live], columns, steps * units)
        if longest < enough:
            yield LastSteps(live, linearised, are_taken=True)
            return
        is_last = step_size < enough
        # most instants of a large stack leave when they close, and the others go on alone
        if iteration == iterations - 1 or np.count_nonzero(is_last) > 0.5 * max(len(live), SMALL_STACK):
            yield LastSteps(live[is_last], linearised.select(np.flatnonzero(is_last)), are_taken=True)
            live = live[~is_last]


def _newton_steps(
    robot: ParallelRobot, linearised: LinearisedLoops, *, at_motors: bool
) -> tuple[Array, BoolArray]:
    """Compute Newton's steps (T, k) of the k joints that move.

    The steps are valid only if all instants are regular.

    Args:
        at_motors: whether the motors are prescribed, so that only passive joints move.

    Returns:
        The steps [rad, m]; whether each instant is regular, (T,).
    """
    if at_motors:  # the loops along the passive joints
        residual, factors = linearised.residual[:, robot.n :], linearised.passive_factors
    else:  # platform and loops along all moving joints
        residual, factors = linearised.residual, linearised.factors
    try:
        steps = -factors.solve(residual)
    except np.linalg.LinAlgError:
        signs, _ = factors.slogdet  # 0 where the matrix is singular
        return residual, signs != 0  # the residual stands for steps that do not exist
    return steps, np.asarray(np.isfinite(steps).all(axis=1))


def remove_idle_spin(robot: ParallelRobot, origin: Array, q: Array, x: Array) -> Array:
    """Turn the k idle balls of configurations q (T, nq) at x (T, n) until their spin is zero.

    The spin is the idle component of the rotation vector from `origin` (nq,) to q. Newton's method on the
    angles of the turns makes it zero; the loops are closed again after each step.

    Raises:
        NotAssembled: a configuration is on a singularity of the inverse kinematics.
    """
    if not (len(q) and len(robot.structure.idle)):
        return q
    is_ball = np.isin(robot.structure.idle, ball_columns(robot.model))  # whether each idle joint is of a ball
    if not is_ball.any():
        return q
    idle = robot.structure.idle[is_ball]  # (k,)
    for _ in range(MAX_ITERATIONS):
        spin = difference(robot, origin, q)[:, idle]  # (T, k)
        if np.abs(spin).max() <= ROUNDING_STEP:
            break
        turns = turn_motions(robot, linearised_at(robot, q, x))[:, :, is_ball]  # (T, nv, k)
        slope = difference_jacobian(robot, origin, q)[:, idle] @ turns  # (T, k, k) of spin along the turns
        angles = np.linalg.solve(slope, -spin[:, :, None])  # (T, k, 1)
        largest_angle = np.abs(angles).max(axis=1, keepdims=True)
        angles /= np.maximum(largest_angle / MAX_NEWTON_STEP, 1.0)
        turned = integrate(robot, q, (turns @ angles)[:, :, 0])
        q = close_loops(robot, x, turned).q
    return q


@dataclass(frozen=True, eq=False)
class IdleTurns:
    """The k idle turns at T instants."""

    motions: Array  # Z (T, nv, k): the motion of each turn alone
    rows: Array  # Z' G (T, k, nv); for a turn at rest the unit row of its joint
    weights: Array  # (k, nv) diagonal of G for each turn; zero for a turn at rest

    def add_turns(self, rates: Array, right: Array | float = 0.0) -> Array:
        """Add turns Z y to `rates` (..., T, nv) so that Z' G (rates + Z y) = `right`.

        Args:
            right: (T, k); zero for rates, -(Z' G)' v for accelerations.
        """
        residual = right - np.matvec(self.rows, rates)  # (..., T, k)
        y = np.linalg.solve(self.rows @ self.motions, residual[..., None])[..., 0]  # (..., T, k)
        return rates + np.matvec(self.motions, y)

    def rows_rate(self, robot: ParallelRobot, linearised: LinearisedLoops, jacobian_rate: Array) -> Array:
        """Compute the time derivative (T, k, nv) of `rows`.

        From J Z = 0 follows J dZ/dt = -dJ/dt Z. The idle joints themselves turn at the constant rate 1.

        Args:
            jacobian_rate: dJ/dt (T, n + m, nv) of J = dF/dq.
        """
        rates = _closing_motions(robot, linearised, jacobian_rate @ self.motions)  # dZ/dt
        return rates.swapaxes(1, 2) * self.weights


def idle_turns(robot: ParallelRobot, linearised: LinearisedLoops) -> IdleTurns | None:
    """Return the idle turns at T instants; None if all idle joints rest."""
    weights = _driving_weights(robot)  # (k, nv) diagonal of G for each turn; zero for a turn at rest
    if not weights.any():
        return None
    motions = turn_motions(robot, linearised)
    rows = motions.swapaxes(1, 2) * weights  # Z' G (T, k, nv)
    for k in np.flatnonzero(~weights.any(axis=1)):
        rows[:, k, robot.structure.idle[k]] = 1.0  # the turn rests
    return IdleTurns(motions, rows, weights)


def driven_turns(robot: ParallelRobot) -> IntArray:
    """Return the idle columns whose turns damping or armature of balls drives."""
    return robot.structure.idle[_driving_weights(robot).any(axis=1)]


@lru_cache(maxsize=16)
def _driving_weights(robot: ParallelRobot) -> Array:
    """Return the diagonal of G, damping or armature of balls, for each idle turn, (k, nv).

    It holds the damping of all balls if the turn moves a damped ball. Otherwise it holds their armature if
    the turn moves a ball with armature, and zeros if not. Which balls a turn moves is decided at the
    reference.
    """
    weights = np.zeros((len(robot.structure.idle), robot.nv))
    balls = ball_columns(robot.model)  # (b, 3)
    for values in (robot.model.armature, robot.joint_damping):  # damping replaces armature
        isotropic = np.zeros(robot.nv)  # the values of balls that have the same about all axes
        same_balls = balls[np.ptp(values[balls], axis=1) == 0.0]
        isotropic[same_balls] = values[same_balls]
        if len(weights) and isotropic.any():
            reference_motions = turn_motions(robot, linearised_at_reference(robot))[0]  # (nv, k)
            weights[(isotropic[:, None] * reference_motions).any(axis=0)] = isotropic
    return read_only(weights)


def turn_motions(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute Z (T, nv, k): joint rates with closed loops at a unit rate of each idle joint."""
    idle = robot.structure.idle
    motions = _closing_motions(robot, linearised, linearised.jacobian[:, :, idle])
    motions[:, idle] = np.eye(len(idle))
    return motions


def _closing_motions(robot: ParallelRobot, linearised: LinearisedLoops, gaps: Array) -> Array:
    """Compute motions (T, nv, k) of the moving joints that undo changes `gaps` (T, n + m, k) of F."""
    # the factors solve for right sides (..., T, n + m)
    closing = -linearised.factors.solve(np.moveaxis(gaps, 2, 0))  # (k, T, moving)
    motions = np.zeros((len(gaps), robot.nv, len(closing)))
    motions[:, robot.moving] = np.moveaxis(closing, 0, 2)
    return motions
