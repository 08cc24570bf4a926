"""Velocities and accelerations of all joints from those of the platform; time derivatives of dF/dq.

At prescribed x and deflections q_e, (dF/dq) v = [twist; 0] and (dF/dq) a = [twist rate; 0] - drift. One
factorisation of the moving columns solves both. Idle turns rest, or move as `idle_turns` says.

An entry of dF/dq is the power of a wrench W (of a loop equation, or a unit wrench of the platform) on the
screw S of a joint, both about the base's origin. So the rates of W and S give the rate of dF/dq.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from framework.errors import NotAssembled
from framework.kinematics.closures import closure_drift, wrench_changes
from framework.kinematics.external_wrenches import AppliedWrench
from framework.kinematics.frame_variations import bracket, tree_columns
from framework.kinematics.frames import FrameMotions, body_twists, frame_motions, frames_at, move_with_bodies
from framework.kinematics.idle_turns import idle_turns
from framework.kinematics.linearised_loops import ClosedStack, LinearisedLoops, linearised_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import matvec


@dataclass(frozen=True, eq=False)
class Motion:
    """Positions, velocities and accelerations of all joints at T instants, and the external wrenches."""

    q: Array  # (T, nq)
    v: Array  # (T, nv)
    a: Array  # (T, nv)
    linearised: LinearisedLoops
    wrenches: tuple[AppliedWrench, ...] = ()  # external ones

    def with_wrenches(self, wrenches: tuple[AppliedWrench, ...]) -> Motion:
        """Return the same motion under external wrenches."""
        return replace(self, wrenches=wrenches) if wrenches else self


def joint_rates(
    robot: ParallelRobot, linearised: LinearisedLoops, platform: Array, elastic: Array | None = None
) -> Array:
    """Compute joint rates (..., T, nv) for platform velocities (..., T, n).

    The rates of the deflections are `elastic` (T, n_e), or zero if None.
    """
    right = np.zeros((*platform.shape[:-1], linearised.residual.shape[1]))
    right[..., : robot.n] = platform
    return solve_rates(robot, linearised, right, elastic)


def solve_rates(
    robot: ParallelRobot, linearised: LinearisedLoops, right: Array, elastic: Array | None = None
) -> Array:
    """Solve J_moving v_moving = right - J_elastic v_elastic for joint rates (..., T, nv), J = dF/dq.

    Args:
        elastic: rates (..., T, n_e) of the springs' joints; zero if None.

    Raises:
        NotAssembled: the platform does not determine the joints at some instant.
    """
    rates = np.zeros((*right.shape[:-1], robot.nv))
    if elastic is not None:
        rates[..., robot.elastic] = elastic
        right = right - matvec(linearised.jacobian[:, :, robot.elastic], elastic)
    rates[..., robot.moving] = moving_rates(robot, linearised, right)
    return rates


def moving_rates(robot: ParallelRobot, linearised: LinearisedLoops, right: Array) -> Array:
    """Solve J_moving v_moving = right (..., T, n + m) for the rates of moving joints, J = dF/dq.

    Raises:
        NotAssembled: the platform does not determine the joints (Type 1).
    """
    try:
        return linearised.factors.solve(right)
    except np.linalg.LinAlgError:
        raise NotAssembled(
            f"{robot.name}: the platform's {', '.join(robot.axis_names)} do not determine the joints: a leg "
            f"is stretched or folded, or the platform frame does not move along these axes",
            q=robot.q_near,
            residual=float(np.abs(linearised.residual).max()),
        ) from None


def motion_at(
    robot: ParallelRobot,
    closed: ClosedStack,
    dx: Array,
    ddx: Array,
    dq_e: Array | None = None,
    ddq_e: Array | None = None,
) -> Motion:
    """Compute the motion of all joints for platform rates dx, ddx (T, n) and deflection rates (T, n_e)."""
    return _motion_of_twist(robot, closed.linearised, robot.platform.twist(closed.x, dx, ddx), dq_e, ddq_e)


def freeze_deflections(robot: ParallelRobot, q: Array, v: Array, a: Array) -> Motion:
    """Compute the motion with the same platform as q (T, nq), v, a (T, nv), deflections constant."""
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
    """Compute the motion of all joints for a twist, v and dv/dt (T, n), and deflection rates (T, n_e).

    Rates solve J v = (twist, 0). Accelerations solve J a = (dv/dt, 0) - J' v, with the drift J' v of platform
    and loops. Idle turns, which these equations do not determine, are added to both.
    """
    velocity, acceleration = twist
    v = joint_rates(robot, linearised, velocity, dq_e)
    turns = idle_turns(robot, linearised)
    if turns is not None:
        v = turns.add_turns(v)
    motions = frame_motions(robot, linearised.frames, v)
    drift = closure_drift(robot.loops, motions)
    right = np.concatenate([acceleration - robot.platform.drift(motions), -drift], axis=1)
    a = solve_rates(robot, linearised, right, ddq_e)
    if turns is not None:
        jacobian_rate, _ = jacobian_rates(robot, linearised, v)
        rows_rate = turns.rows_rate(robot, linearised, jacobian_rate)
        a = turns.add_turns(a, -matvec(rows_rate, v))
    return Motion(linearised.frames.q, v, a, linearised)


def jacobian_rates(
    robot: ParallelRobot, linearised: LinearisedLoops, v: Array, a: Array | None = None
) -> tuple[Array, Array]:
    """Compute the first and second time derivative of dF/dq, (T, n + m, nv) each, for rates v (T, nv).

    dF/dq consists of powers W . S of wrenches and screws. S' = [V, S] and S" = [A, S] + [V, S'], with V the
    twist of the joint's body and A = dV/dt. If the accelerations a (T, nv) are None, they are zero.
    """
    frames = linearised.frames
    twists = body_twists(robot, frames.q, v, np.zeros_like(v) if a is None else a)
    motions = move_with_bodies(robot, frames, twists)
    V, A = twists.take(tree_columns(robot).owner, axis=2)  # (T, nv, 6) each
    dS = bracket(V, frames.screws)
    ddS = bracket(A, frames.screws) + bracket(V, dS)
    dW, ddW = _wrench_rates(robot, motions, np.stack([dS, ddS]))
    S, dS, ddS = (screws.swapaxes(1, 2) for screws in (frames.screws, dS, ddS))
    first = dW @ S + linearised.wrenches @ dS
    second = ddW @ S + 2.0 * dW @ dS + linearised.wrenches @ ddS
    return first * robot.equations.signs, second * robot.equations.signs


def _wrench_rates(robot: ParallelRobot, motions: FrameMotions, screw_rates: Array) -> Array:
    """Compute two time derivatives (2, T, n + m, 6) of `LinearisedLoops.wrenches`.

    The wrench W(c) of a loop has a force that is linear in the axes and origins c of frames, and a moment
    that is quadratic. So W' is the change of W(c) by c'. W" is the change of W(c) by c", plus, for the
    moment, the change of W(c') by c'. `screw_rates` (2, T, nv, 6) are two time derivatives of the joints'
    screws.
    """
    c, dc, ddc = motions.rates
    first, second, at_rates = wrench_changes(robot.loops, np.stack([c, c, dc]), np.stack([dc, ddc, dc]))
    second[..., 3:] += at_rates[..., 3:]
    loop_rates = np.stack([first, second])
    return np.concatenate([robot.platform.wrench_rates(motions, screw_rates), loop_rates], axis=2)
