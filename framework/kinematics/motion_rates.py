"""Velocities and accelerations of all joints from those of the platform, and their exact derivatives.

At prescribed x and deflections q_e, (dF/dq) v = [twist; 0] and (dF/dq) a = [twist rate; 0] - drift. One
factorisation of the moving columns solves both. Idle turns rest, or move as `idle_turns` says. All functions
that solve for rates raise NotAssembled where the platform does not determine the joints (Type 1).

An entry of J = dF/dq is the power of a wrench W (of a loop equation, or a unit wrench of the platform) on the
screw S of a joint, both about the base's origin. So the rates of W and S give the rates of J.

Derivatives of a motion (`coordinate_changes`) are taken along coordinates y of the closed robot: those of the
platform, and positions of joints that the platform does not determine. Let Y = dq/dy be the motions that keep
the loops closed. A change dy changes a motion q(t) by Y dy, and its rates and accelerations by the time
derivatives of Y dy. With primes for time derivatives,

    J Y = E,        J Y' = E' - J' Y,        J Y" = E" - 2 J' Y' - J" Y,

where E has the platform's twists for unit rates (`unit_twists`). Like the motion itself, the derivatives are
regular at Type 2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput, NotAssembled
from framework.kinematics.closures import closure_drift, wrench_changes
from framework.kinematics.couplings import coupling_jacobian_rates
from framework.kinematics.external_wrenches import AppliedWrench
from framework.kinematics.frames import (
    body_twists,
    bracket,
    frame_motions,
    frames_at,
    move_with_bodies,
    tree_columns,
)
from framework.kinematics.inverse_kinematics import driven_turns, idle_turns
from framework.kinematics.linearised_loops import LinearisedLoops, linearised_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.platform import CoordinateRates
from framework.kinematics.tree_model import ball_columns
from framework.numerics.arrays import Array, IntArray
from framework.numerics.ordered_sums import cross, matvec


@dataclass(frozen=True, eq=False)
class Motion:
    """Positions, velocities and accelerations of all joints at T instants, and the external wrenches."""

    q: Array  # (T, nq)
    v: Array  # (T, nv)
    a: Array  # (T, nv)
    linearised: LinearisedLoops  # at q
    wrenches: tuple[AppliedWrench, ...] = ()  # external ones

    def with_wrenches(self, wrenches: tuple[AppliedWrench, ...]) -> Motion:
        """Return the same motion under external wrenches."""
        return replace(self, wrenches=wrenches) if wrenches else self

    def select(self, which: slice) -> Motion:
        """Return the motion at the instants `which`."""
        wrenches = tuple(
            wrench._replace(
                wrench=wrench.wrench[which],
                generalised=wrench.generalised[which],
                origin=wrench.origin[which],
            )
            for wrench in self.wrenches
        )
        linearised = self.linearised.select(which)
        return Motion(self.q[which], self.v[which], self.a[which], linearised, wrenches)


def joint_rates(
    robot: ParallelRobot, linearised: LinearisedLoops, platform: Array, elastic: Array | None = None
) -> Array:
    """Compute joint rates (..., T, nv) at velocities `platform` (..., T, n), idle turns at rest.

    Args:
        platform: velocities v of the platform [m/s, rad/s].
        elastic: rates (..., T, n_e) of the deflections; zero if None.
    """
    # J v = (platform, 0): zero rates of the loop equations keep the loops closed
    right = np.zeros((*platform.shape[:-1], linearised.residual.shape[1]))
    right[..., : robot.n] = platform
    return solve_rates(robot, linearised, right, elastic)


def motor_speeds(robot: ParallelRobot, linearised: LinearisedLoops) -> tuple[Array, Array]:
    """Compute G (T, n_a, n) and dq/dv (T, nv, n): speeds of motors and of all joints for unit twists."""
    count = len(linearised.residual)
    unit_twists = np.broadcast_to(np.eye(robot.n)[:, None], (robot.n, count, robot.n))
    rates = joint_rates(robot, linearised, unit_twists).transpose(1, 2, 0)
    return robot.gear_ratio[:, None] * rates[:, robot.actuated], rates


def solve_rates(
    robot: ParallelRobot, linearised: LinearisedLoops, right: Array, elastic: Array | None = None
) -> Array:
    """Solve J_moving v_moving = right - J_elastic v_elastic for joint rates (..., T, nv), J = dF/dq.

    Args:
        right: (..., T, n + m) rates of the equations.
        elastic: (..., T, n_e) rates of the springs' joints; zero if None.
    """
    rates = np.zeros((*right.shape[:-1], robot.nv))
    if elastic is not None:
        rates[..., robot.elastic] = elastic
        right = right - matvec(linearised.jacobian[:, :, robot.elastic], elastic)
    try:
        rates[..., robot.moving] = linearised.factors.solve(right)
    except np.linalg.LinAlgError:
        raise NotAssembled(
            f"the platform's {', '.join(robot.axis_names)} do not determine the joints: a leg "
            f"is stretched or folded, or the platform frame does not move along these axes",
            name=robot.name,
            q=robot.q_near,
            residual=float(np.abs(linearised.residual).max()),
        ) from None
    return rates


def motion_at(
    robot: ParallelRobot,
    closed: LinearisedLoops,
    dx: Array,
    ddx: Array,
    dq_e: Array | None = None,
    ddq_e: Array | None = None,
) -> Motion:
    """Compute the motion of all joints at the poses `closed` and platform rates dx, ddx (T, n).

    The deflections have the rates dq_e and accelerations ddq_e (T, n_e); zero if None.
    """
    return _motion_of_twist(robot, closed, robot.platform.twist(closed.x, dx, ddx), dq_e, ddq_e)


def freeze_deflections(robot: ParallelRobot, q: Array, v: Array, a: Array) -> Motion:
    """Compute the motion with constant deflections and the platform's motion of q (T, nq), v, a (T, nv)."""
    frames = frames_at(robot, q)
    linearised = linearised_at(robot, q, robot.platform.coordinates(frames))
    return _motion_of_twist(robot, linearised, platform_twists(robot, Motion(q, v, a, linearised)))


def platform_twists(robot: ParallelRobot, motion: Motion) -> tuple[Array, Array]:
    """Compute the platform's velocity v and its time derivative, each (T, n)."""
    jacobian = motion.linearised.platform
    drift = robot.platform.drift(frame_motions(robot, motion.linearised.frames, motion.v))
    return matvec(jacobian, motion.v), matvec(jacobian, motion.a) + drift


def _motion_of_twist(
    robot: ParallelRobot,
    linearised: LinearisedLoops,
    twist: tuple[Array, Array],
    dq_e: Array | None = None,
    ddq_e: Array | None = None,
) -> Motion:
    """Compute the motion of all joints at a velocity of the platform.

    With J = dF/dq, joint rates v solve J v = (velocity, 0). Accelerations a solve
    J a = (velocity', 0) - J' v, with the drift J' v of platform and loops. Idle turns, which these equations
    do not determine, are added to both.

    Args:
        twist: the platform's velocity and its time derivative, (T, n) each.
        dq_e, ddq_e: rates and accelerations (T, n_e) of the deflections; zero if None.
    """
    velocity, acceleration = twist
    v = joint_rates(robot, linearised, velocity, dq_e)
    turns = idle_turns(robot, linearised)
    if turns is not None:
        v = turns.add_turns(v)

    motions = frame_motions(robot, linearised.frames, v)
    drift = linearised.combine(closure_drift(robot.spanning_loops, motions, linearised.frames.q, v))
    right = np.concatenate([acceleration - robot.platform.drift(motions), -drift], axis=1)
    a = solve_rates(robot, linearised, right, ddq_e)
    if turns is not None:
        jacobian_rate, _ = jacobian_rates(robot, linearised, v)
        rows_rate = turns.rows_rate(robot, linearised, jacobian_rate)
        # Z' G v = 0 at all times, so Z' G a = -(Z' G)' v; Z are the turns, G their damping or armature
        a = turns.add_turns(a, -matvec(rows_rate, v))
    return Motion(linearised.frames.q, v, a, linearised)


def jacobian_rates(
    robot: ParallelRobot, linearised: LinearisedLoops, v: Array, a: Array | None = None
) -> tuple[Array, Array]:
    """Compute the first and second time derivative of dF/dq, (T, n + m, nv) each, for rates v (T, nv).

    dF/dq consists of powers W . S of wrenches and screws. S' = [V, S] and S" = [A, S] + [V, S'], with V the
    twist of the joint's body and A = dV/dt. If the accelerations a (T, nv) are None, they are zero.

    The wrench W(c) of a loop has a force that is linear in the axes and origins c of frames, and a moment
    that is quadratic. So W' is the change of W(c) by c'. W" is the change of W(c) by c", plus, for the
    moment, the change of W(c') by c'.
    """
    frames = linearised.frames
    twists = body_twists(robot, frames.q, v, np.zeros_like(v) if a is None else a)
    motions = move_with_bodies(robot, frames, twists)
    V, A = twists.take(tree_columns(robot).owner, axis=2)  # (T, nv, 6) each, of the body behind each joint

    dS = bracket(V, frames.screws)
    ddS = bracket(A, frames.screws) + bracket(V, dS)

    # changes of W(c) by c', of W(c) by c", and of W(c') by c', in one stack
    rates = motions.rates  # (3, T, F, 4, 3): c, c', c"
    loop_rates = wrench_changes(robot.spanning_loops, rates[[0, 0, 1]], rates[[1, 2, 1]])
    loop_rates[1, ..., 3:] += loop_rates[2, ..., 3:]
    platform_rates = robot.platform.wrench_rates(motions, np.array([dS, ddS]))  # (2, T, n, 6)
    dW, ddW = np.concatenate([platform_rates, loop_rates[:2]], axis=2)  # (T, n + m, 6) each

    # S, S' and S" with one screw a column
    S_0, S_1, S_2 = (screws.swapaxes(1, 2) for screws in (frames.screws, dS, ddS))
    first = dW @ S_0 + linearised.wrenches @ S_1
    second = ddW @ S_0 + 2.0 * dW @ S_1 + linearised.wrenches @ S_2
    # signs (n + m, nv): 1 or -1 if the joint of a column moves one of the equation's two bodies, else 0
    signs = robot.equations.signs
    first, second = first * signs, second * signs
    if robot.spanning_loops.has_couplings:
        accelerations = np.zeros_like(v) if a is None else a
        of_couplings = coupling_jacobian_rates(robot.spanning_loops, frames.q, v, accelerations)
        first[:, robot.n :] += of_couplings[0]
        second[:, robot.n :] += of_couplings[1]
    return linearised.combine_rows(first), linearised.combine_rows(second)


class MotionChanges(NamedTuple):
    """Changes of a motion q, v, a by unit steps of k coordinates.

    A unit step of a rate changes v by the field `q`.
    """

    q: Array  # (T, k, nv) change of q by a unit step of a position
    v: Array  # (T, k, nv) change of v by the same step
    accelerations: Array  # (3, T, k, nv) of a by unit steps of positions, rates and accelerations


def coordinate_changes(
    robot: ParallelRobot, motion: Motion, columns: IntArray, x: CoordinateRates | None = None
) -> MotionChanges:
    """Compute the changes of a motion by unit steps of k coordinates, as in the header.

    First come the coordinates of the platform, unless x is None, then the joints `columns`. Let dq and dv be
    the changes by a step of a position. A step of a rate changes a by 2 dv - [v, dq]. The Lie bracket [v, dq]
    of the motions is zero except for balls, whose rates are not derivatives of coordinates. The part of
    changes along `columns` is removed, because the rates and accelerations of these joints are coordinates
    with steps of their own.

    Args:
        columns: joints that are coordinates, as indices into the velocity vector.
        x: platform coordinates x and their rates dx, ddx, (T, n) each.
    """
    n = 0 if x is None else robot.n
    k = n + len(columns)
    J = motion.linearised.jacobian  # (T, n + m, nv)

    # J Y = E; Y, E and their derivatives are stored with the coordinates as rows
    right = np.zeros((3, len(J), k, J.shape[1]))  # E of all coordinates and two time derivatives
    if x is not None:
        right[:, :, :n, :n] = robot.platform.unit_twists(x)
    right[0, :, n:] = -J[:, :, columns].swapaxes(1, 2)  # a unit rate of such a joint opens the loops
    dq = _solve_moving(robot, motion, right[0])  # Y (T, k, nv)
    dq[:, range(n, k), columns] = 1.0  # each of the joints `columns` moves at its own unit rate

    def rest_columns(change: Array) -> Array:
        """Add closed motions to a `change` (T, k, nv) of rates so that `columns` are at rest."""
        return change - change[..., columns] @ dq[:, n:]

    rates = jacobian_rates(robot, motion.linearised, motion.v, motion.a)
    dJ, ddJ = (matrix.swapaxes(1, 2) for matrix in rates)  # (T, nv, n + m): transposed, as Y is

    # J Y' = E' - J' Y, and J Y" = E" - 2 J' Y' - J" Y
    lie_bracket = _bracket_on_balls(robot, motion.v, dq)  # [v, dq]
    dv = rest_columns(_solve_moving(robot, motion, right[1] - dq @ dJ) + lie_bracket)
    dY = dv - lie_bracket  # Y'
    da = _solve_moving(robot, motion, right[2] - 2.0 * dY @ dJ - dq @ ddJ)
    da += _bracket_on_balls(robot, motion.a, dq) + _bracket_on_balls(robot, motion.v, dY)
    return MotionChanges(dq, dv, np.array([rest_columns(da), 2.0 * dv - rest_columns(lie_bracket), dq]))


def _solve_moving(robot: ParallelRobot, motion: Motion, right: Array) -> Array:
    """Solve J rates = right (T, k, n + m) for rates (T, k, nv) of the moving joints."""
    rates = solve_rates(robot, motion.linearised, right.swapaxes(0, 1))  # (k, T, nv)
    return rates.swapaxes(0, 1)


def _bracket_on_balls(robot: ParallelRobot, rates: Array, motions: Array) -> Array:
    """Compute the Lie bracket (T, k, nv) of rates (T, nv) and motions (T, k, nv); zero except for balls."""
    lie_bracket = np.zeros_like(motions)
    balls = ball_columns(robot.model)  # (b, 3)
    if len(balls):
        lie_bracket[..., balls] = cross(rates[:, None, balls], motions[..., balls])
    return lie_bracket


def require_turns_at_rest(robot: ParallelRobot) -> None:
    """Raise InvalidInput if damping or armature of balls drives an idle turn."""
    turns = driven_turns(robot)
    if len(turns):
        names = ", ".join(robot.coordinates.name_of(column) for column in turns)
        raise InvalidInput(
            f"{robot.name}: the damping or the armature of balls drives the idle turns {names}; "
            f"they are taken for turns at rest here: leave damping and armature of these balls out"
        )
