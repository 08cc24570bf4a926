"""Velocities and accelerations of all joints for those of the platform, and the rate of dF/dq.

For prescribed x and deflections q_e, (dF/dq) v = [twist; 0] and (dF/dq) a = [twist rate; 0] - drift. Both are
solved along the columns that follow, with one factorisation; idle turns rest or follow `idle_turns`.

An entry of dF/dq is the power of a wrench W (of a loop equation, or a unit wrench of the platform) on the
screw S of a joint, both about the base's origin. The wrenches turn with their frames, and all is
analytic in frames and screws: a complex step of these gives the rate of dF/dq.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from framework.errors import NotAssembled
from framework.kinematics.closures import closure_drift, loop_wrenches
from framework.kinematics.external_wrenches import AppliedWrench
from framework.kinematics.frame_variations import complex_step_derivative, step_frames
from framework.kinematics.frames import frame_motions, frames_at
from framework.kinematics.idle_turns import idle_turns
from framework.kinematics.linearised_loops import (
    ClosedStack,
    LinearisedLoops,
    equation_wrenches,
    linearised_at,
)
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import matvec


@dataclass(frozen=True, eq=False)
class Motion:
    """Positions, velocities and accelerations of all coordinates at T instants, and the world's wrenches."""

    q: Array  # (T, nq)
    v: Array  # (T, nv)
    a: Array  # (T, nv)
    linearised: LinearisedLoops
    wrenches: tuple[AppliedWrench, ...] = ()  # of the world

    def with_wrenches(self, wrenches: tuple[AppliedWrench, ...]) -> Motion:
        """Return the same motion under wrenches of the world."""
        return replace(self, wrenches=wrenches) if wrenches else self


def joint_rates(robot: ParallelRobot, linearised: LinearisedLoops, platform: Array, elastic: Array) -> Array:
    """Compute the joint rates (..., T, nv) for platform velocities (..., T, n).

    Deflections have rates `elastic` (T, n_e).
    """
    right = np.zeros((*platform.shape[:-1], linearised.residual.shape[1]))
    right[..., : platform.shape[-1]] = platform
    return _solve_rates(robot, linearised, right, elastic)


def _solve_rates(robot: ParallelRobot, linearised: LinearisedLoops, right: Array, elastic: Array) -> Array:
    """Solve J_moving v_moving = right - J_elastic v_elastic for joint rates (..., T, nv), J = dF/dq."""
    rates = np.zeros((*right.shape[:-1], robot.model.nv))
    if robot.n_e:
        rates[..., robot.elastic] = elastic
        right = right - matvec(linearised.jacobian[:, :, robot.elastic], elastic)
    rates[..., robot.moving] = moving_rates(robot, linearised, right)
    return rates


def moving_rates(robot: ParallelRobot, linearised: LinearisedLoops, right: Array) -> Array:
    """Solve J_moving v_moving = right (..., T, n + m) for the rates of the moving joints, J = dF/dq.

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
    still = np.zeros((len(dx), robot.n_e))
    elastic = (still if dq_e is None else dq_e, still if ddq_e is None else ddq_e)
    twists = robot.platform.twist(closed.x, dx, ddx)
    return _motion_of_twist(robot, closed.q, closed.linearised, twists, elastic)


def freeze_deflections(robot: ParallelRobot, q: Array, v: Array, a: Array) -> Motion:
    """Compute the motion of the same platform at constant deflections.

    The motion given has q (T, nq), v and a (T, nv).
    """
    frames = frames_at(robot, q)
    linearised = linearised_at(robot, q, robot.platform.coordinates(frames))
    twists = platform_twists(robot, Motion(q, v, a, linearised))
    still = np.zeros((len(q), robot.n_e))
    return _motion_of_twist(robot, q, linearised, twists, (still, still))


def platform_twists(robot: ParallelRobot, motion: Motion) -> tuple[Array, Array]:
    """Compute the platform's velocity v and its time derivative, each (T, n)."""
    frames, jacobian = motion.linearised.frames, motion.linearised.platform
    drift = robot.platform.drift(frame_motions(robot, frames, motion.q, motion.v))
    return matvec(jacobian, motion.v), matvec(jacobian, motion.a) + drift


def _motion_of_twist(
    robot: ParallelRobot,
    q: Array,
    linearised: LinearisedLoops,
    twist: tuple[Array, Array],
    elastic: tuple[Array, Array],
) -> Motion:
    """Compute the motion of all joints for rates and accelerations of platform and deflections.

    `twist` are v and dv/dt (T, n), `elastic` the deflections' rates and accelerations (T, n_e).
    """
    v = joint_rates(robot, linearised, twist[0], elastic[0])
    turns = idle_turns(robot, linearised)
    if turns is not None:
        v = turns.add_turns(v)
    motions = frame_motions(robot, linearised.frames, q, v)
    drift = closure_drift(linearised.equations.loops, motions)
    platform_drift = robot.platform.drift(motions)
    right = np.concatenate([twist[1] - platform_drift, -drift], axis=1)
    motion = Motion(q, v, _solve_rates(robot, linearised, right, elastic[1]), linearised)
    if turns is None:
        return motion
    rows_rate = turns.rows_rate(robot, linearised, jacobian_change(robot, linearised, v))
    return replace(motion, a=turns.add_turns(motion.a, -matvec(rows_rate, v)))


def jacobian_change(robot: ParallelRobot, linearised: LinearisedLoops, motions: Array) -> Array:
    """Compute the derivative (T, n + m, nv) of dF/dq along joint motions (T, nv).

    Along joint rates it is the time derivative.
    """
    ahead = step_frames(robot, linearised.frames, motions)
    wrenches = equation_wrenches(robot, ahead, loop_wrenches(robot.rows, ahead))
    return complex_step_derivative(robot.equations.jacobian(wrenches, ahead.screws))
