"""The way of a platform under torques that are not quite right, without feedback.

With G' tau the wrench of the motors and W(x, dx/dt, d2x/dt2) the one that the platform asks for, a platform
that is off its path by d follows, to first order,

    M d" = -(W - G' tau) - dW/d(dx/dt) d' - d(W - G' tau)/dx d,        M = dW/d(d2x/dt2).

The first term is what the torques lack on the path. Where the last repels, weight or the torques themselves
carry the platform off, the faster the farther it is: a robot that stands on its legs falls over unless
somebody looks. Nothing is divided by what vanishes at a Type 2 singularity.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.dynamics.platform_wrench import platform_wrench
from framework.dynamics.result import InverseDynamics
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.linearised_loops import ClosedStack
from framework.kinematics.motion_rates import motion_at

GROWTH_INSTANTS = 65  # at which the rate of growth is computed and integrated over the motion
DIFFERENCE_STEP = 1e-4  # [rad, robot lengths] for a difference of wrenches
# Exponents of growth below which the growth is 1 but for rounding, and above which it overflows.
MIN_EXPONENT, MAX_EXPONENT = 1e-4, 300.0


class ErrorDynamics(NamedTuple):
    """What accelerates a platform that is off its path, at T instants: matrices (T, n, n)."""

    forced: Array  # by a wrench that the torques lack, -M^-1
    damped: Array  # by the rate of what it is off
    own: Array  # by what it is off


def error_dynamics(result: InverseDynamics, times: Array) -> ErrorDynamics:
    """Compute how a platform off its path accelerates at t (T,); springs are taken for rigid where they are.

    Raises:
        NotAssembled: the loops do not close beside the path.
    """
    robot = result.robot
    x, dx, ddx = (result.platform(times, order) for order in range(3))
    near, torque = result.configuration(times), result.torque_without_friction(times)
    s, on_path = result.law(times), close_loops(robot, x, near)

    def lacking(closed: ClosedStack, dx: Array, ddx: Array) -> Array:
        """Compute W - G' tau (T, n)."""
        world = result.wrenches.evaluate(robot, closed.linearised.frames, s)
        return platform_wrench(robot, motion_at(robot, closed, dx, ddx).with_wrenches(world)).lacking(torque)

    def slope(at: Callable[[Array], Array], steps: Array) -> Array:
        """Compute the derivatives (T, n, n) along each coordinate by central differences."""
        moves = np.diag(steps)
        return np.stack([(at(move) - at(-move)) / (2.0 * h) for move, h in zip(moves, steps, strict=True)], 2)

    steps = DIFFERENCE_STEP * robot.platform_scale
    rates, units = np.full(robot.n, 1.0 / result.duration) * robot.platform_scale, np.ones(robot.n)
    inertia = slope(lambda move: lacking(on_path, dx, ddx + move), units)
    forced = np.asarray(-np.linalg.inv(inertia))
    return ErrorDynamics(
        forced,
        forced @ slope(lambda move: lacking(on_path, dx + move, ddx), rates),
        forced @ slope(lambda move: lacking(close_loops(robot, x + move, near), dx, ddx), steps),
    )


def repelling_rates(result: InverseDynamics, times: Array) -> Array:
    """Compute the largest rate (T,) [1/s] at which an error of the platform grows; 0 where none does.

    Raises:
        NotAssembled: the loops do not close beside the path.
    """
    squares = np.linalg.eigvals(error_dynamics(result, times).own)
    return np.sqrt(squares.astype(complex)).real.max(axis=1)


def open_loop_error(dynamics: ErrorDynamics, times: Array, lacking: Array) -> Array:
    """Compute how far (T, n) a platform is off its path [m, rad] where the torques lack a wrench (T, n).

    By the trapezoidal rule, from rest on the path.

    Args:
        dynamics: at the instants `times` (T,) [s], equidistant.
        lacking: W - G' tau there [N, N m].
    """
    count, n = lacking.shape
    half = 0.5 * float(times[1] - times[0])
    forces, matrix = np.zeros((count, 2 * n)), np.zeros((count, 2 * n, 2 * n))
    forces[:, n:] = half * np.einsum("tij,tj->ti", dynamics.forced, lacking)
    matrix[:, :n, n:], matrix[:, n:, :n], matrix[:, n:, n:] = np.eye(n), dynamics.own, dynamics.damped
    explicit, implicit = np.eye(2 * n) + half * matrix, np.linalg.inv(np.eye(2 * n) - half * matrix)
    state = np.zeros((count, 2 * n))  # what it is off, and its rate
    for k in range(1, count):
        state[k] = implicit[k] @ (explicit[k - 1] @ state[k - 1] + forces[k - 1] + forces[k])
    return state[:, :n]


def open_loop_growth(result: InverseDynamics) -> float:
    """Compute how much farther than a free mass a constant push takes the platform by the end of a motion.

    2 (cosh L - 1) / L^2 with L the integral of the repelling rate over the motion; 1 where nothing repels.

    Raises:
        NotAssembled: the loops do not close beside the path.
    """
    times = np.linspace(0.0, result.duration, GROWTH_INSTANTS)
    rate = repelling_rates(result, times)
    exponent = float(np.trapezoid(rate, times))
    if exponent <= MIN_EXPONENT:
        return 1.0
    return float(2.0 * (np.cosh(min(exponent, MAX_EXPONENT)) - 1.0) / exponent**2)
