"""The error of the platform under inexact torques, without feedback or with feedback of the motors alone.

With the wrench G' tau of the motors and the wrench W(x, dx/dt, d2x/dt2) that the motion requires, the error d
of the platform satisfies, to first order,

    M d" = -(W - G' tau) - dW/d(dx/dt) d' - d(W - G' tau)/dx d,        M = dW/d(d2x/dt2).

The first term is the wrench missing on the path. The last term may be destabilising: weight, or the torques
themselves, then drive the platform away from the path. A robot that stands on its legs falls over without
feedback. These equations are regular at a Type 2 singularity.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from framework.dynamics.platform_wrench import platform_wrench
from framework.dynamics.result import InverseDynamics
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.linearised_loops import ClosedStack
from framework.kinematics.motion_rates import motion_at
from framework.numerics.arrays import Array

GROWTH_INSTANTS = 65  # instants at which the growth rate is integrated over the motion
DIFFERENCE_STEP = 1e-4  # [rad, robot lengths] of the difference quotient of wrenches
# Exponents below which the growth is 1 but for rounding, and above which it overflows.
MIN_EXPONENT, MAX_EXPONENT = 1e-4, 300.0


class MotorControl(NamedTuple):
    """Proportional and derivative feedback of each motor on its own angle."""

    k_p: Array  # (n_a,) [N m/rad], motor side
    k_d: Array  # (n_a,) [N m s/rad]

    @staticmethod
    def of(inertia: Array, frequency: Array | float, damping: float = 1.0) -> MotorControl:
        """Return the gains for a natural frequency and a damping ratio.

        k_p = w^2 I and k_d = 2 damping w I.

        Args:
            inertia: I (n_a,) [kg m^2, kg] that each motor moves.
            frequency: w [rad/s].
            damping: damping ratio; 1 is critical.
        """
        return MotorControl(k_p=frequency**2 * inertia, k_d=2.0 * damping * frequency * inertia)

    def torque(self, angle_error: Array, speed_error: Array) -> Array:
        """Compute the feedback (T, n_a) [N m] for errors (T, n_a) of motor angles and speeds."""
        return self.k_p * angle_error + self.k_d * speed_error


class ErrorDynamics(NamedTuple):
    """Matrices (T, n, n) of the dynamics of the platform's error d at T instants.

    d" = forced (W - G' tau) + damped d' + own d.
    """

    forced: Array  # -M^-1
    damped: Array  # -M^-1 dW/d(dx/dt)
    own: Array  # -M^-1 d(W - G' tau)/dx

    def with_control(self, control: MotorControl, motor_speed: Array) -> ErrorDynamics:
        """Return the dynamics under feedback of the motors.

        Args:
            motor_speed: G (T, n_a, n), the motors' speeds for unit twists of the platform.
        """
        G_transposed = motor_speed.transpose(0, 2, 1)
        stiffness, damping = (G_transposed @ (gain[:, None] * motor_speed) for gain in control)
        return ErrorDynamics(
            self.forced, self.damped + self.forced @ damping, self.own + self.forced @ stiffness
        )


def error_dynamics(result: InverseDynamics, times: Array) -> ErrorDynamics:
    """Compute the dynamics of the platform's error at t (T,) by differences, at constant deflections.

    Raises:
        NotAssembled: the loops do not close beside the path.
    """
    robot = result.robot
    x, dx, ddx = (result.platform(times, order) for order in range(3))
    guess, torque = result.configuration(times), result.torque_without_friction(times)
    s, on_path = result.law(times), close_loops(robot, x, guess)

    def missing_wrench(closed: ClosedStack, dx: Array, ddx: Array) -> Array:
        """Compute W - G' tau (T, n)."""
        external = result.wrenches.evaluate(robot, closed.linearised.frames, s)
        motion = motion_at(robot, closed, dx, ddx).with_wrenches(external)
        return platform_wrench(robot, motion).missing_wrench(torque)

    # W is linear in d2x/dt2 and quadratic in dx/dt: central differences of any size are exact
    inertia = _central_slopes(lambda step: missing_wrench(on_path, dx, ddx + step), np.ones(robot.n))
    by_rate = _central_slopes(
        lambda step: missing_wrench(on_path, dx + step, ddx), robot.platform_scale / result.duration
    )
    by_x = _central_slopes(
        lambda step: missing_wrench(close_loops(robot, x + step, guess), dx, ddx),
        DIFFERENCE_STEP * robot.platform_scale,
    )
    forced = np.asarray(-np.linalg.inv(inertia))
    return ErrorDynamics(forced=forced, damped=forced @ by_rate, own=forced @ by_x)


def _central_slopes(function: Callable[[Array], Array], sizes: Array) -> Array:
    """Compute the Jacobian (T, n, n) of a function by central differences.

    Args:
        function: takes a step (n,) of the coordinates and returns values (T, n).
        sizes: sizes (n,) of the steps along each coordinate.
    """
    steps = zip(np.diag(sizes), sizes, strict=True)
    return np.stack([(function(step) - function(-step)) / (2.0 * size) for step, size in steps], axis=2)


def repelling_rates(result: InverseDynamics, times: Array) -> Array:
    """Compute the largest growth rate (T,) [1/s] of an error of the platform; 0 if no error grows.

    The rates r of the solutions e^(rt) of d" = own d are the square roots of the eigenvalues of `own`.

    Raises:
        NotAssembled: the loops do not close beside the path.
    """
    squares = np.linalg.eigvals(error_dynamics(result, times).own)
    return np.sqrt(squares.astype(complex)).real.max(axis=1)


def open_loop_error(dynamics: ErrorDynamics, times: Array, missing_wrench: Array) -> Array:
    """Compute the platform's error (T, n) [m, rad] for a missing wrench W - G' tau (T, n).

    The state y = (d, d') satisfies y' = A y + f with f = (0, `forced` times the wrench), and starts at rest
    on the path. It is integrated by the trapezoidal rule with steps h,

        (1 - h/2 A_k) y_k = (1 + h/2 A_(k-1)) y_(k-1) + h/2 (f_(k-1) + f_k).

    Args:
        dynamics: at the instants `times` (T,) [s], equidistant.
        missing_wrench: W - G' tau at these instants [N, N m].
    """
    count, n = missing_wrench.shape
    y, f = np.zeros((2, count, 2 * n))
    f[:, n:] = np.einsum("tij,tj->ti", dynamics.forced, missing_wrench)
    A = np.zeros((count, 2 * n, 2 * n))
    A[:, :n, n:] = np.eye(n)
    A[:, n:, :n] = dynamics.own
    A[:, n:, n:] = dynamics.damped
    half_step = 0.5 * (times[1] - times[0])
    explicit = np.eye(2 * n) + half_step * A
    implicit = np.linalg.inv(np.eye(2 * n) - half_step * A)
    for k in range(1, count):
        y[k] = implicit[k] @ (explicit[k - 1] @ y[k - 1] + half_step * (f[k - 1] + f[k]))
    return y[:, :n]


def fall_exponent(result: InverseDynamics) -> float:
    """Compute the duration of a motion in time constants of the fall.

    It is the integral of the largest growth rate over the motion.

    Raises:
        NotAssembled: the loops do not close beside the path.
    """
    times = np.linspace(0.0, result.duration, GROWTH_INSTANTS)
    return float(np.trapezoid(repelling_rates(result, times), times))


def open_loop_growth(exponent: float) -> float:
    """Compute the final error under a constant force, relative to that of a free mass.

    The error d" = r^2 d + f grows as d = f (cosh rt - 1) / r^2, and that of a free mass as d = f t^2 / 2.
    With the exponent L = rt of `fall_exponent` their ratio is 2 (cosh L - 1) / L^2. It is 1 if no error
    grows.
    """
    if exponent <= MIN_EXPONENT:
        return 1.0
    return float(2.0 * (np.cosh(min(exponent, MAX_EXPONENT)) - 1.0) / exponent**2)
