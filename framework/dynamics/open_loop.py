"""The error of the platform under inexact torques, without feedback or with feedback of the motors alone.

With the wrench G' tau of the motors and the wrench W(x, dx/dt, d2x/dt2) that the motion requires, the error d
of the platform satisfies, to first order,

    M d" = -(W - G' tau) - dW/d(dx/dt) d' - d(W - G' tau)/dx d,        M = dW/d(d2x/dt2).

The first term is the wrench missing on the path. The last term may be destabilising: weight, or the torques
themselves, then drive the platform away from the path. A robot that stands on its legs falls over without
feedback. These equations are regular at a Type 2 singularity.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.dynamics.forces import driven_force_changes, tree_forces
from framework.dynamics.result import InverseDynamics
from framework.kinematics.motion_rates import coordinate_changes
from framework.numerics.arrays import Array

GROWTH_INSTANTS = 65  # instants at which the growth rate is integrated over the motion


class MotorControl(NamedTuple):
    """Proportional and derivative feedback of each motor on its own angle."""

    k_p: Array  # (n_a,) [N m/rad], motor side
    k_d: Array  # (n_a,) [N m s/rad]

    @staticmethod
    def of(inertia: Array, frequency: Array | float) -> MotorControl:
        """Return the gains for a natural frequency w [rad/s] with critical damping.

        k_p = w^2 I and k_d = 2 w I, with the inertia I (n_a,) [kg m^2, kg] that each motor moves.
        """
        return MotorControl(k_p=frequency**2 * inertia, k_d=2.0 * frequency * inertia)

    def torque(self, angle_error: Array, speed_error: Array) -> Array:
        """Compute the feedback (T, n_a) [N m] for errors (T, n_a) of motor angles and speeds."""
        return self.k_p * angle_error + self.k_d * speed_error


class ErrorDynamics(NamedTuple):
    """Matrices (T, n, n) of the dynamics of the platform's error d at T instants.

    d" = per_wrench (W - G' tau) + per_rate d' + per_error d.
    """

    per_wrench: Array  # -M^-1
    per_rate: Array  # -M^-1 dW/d(dx/dt)
    per_error: Array  # -M^-1 d(W - G' tau)/dx

    def with_control(self, control: MotorControl, motor_speed: Array) -> ErrorDynamics:
        """Return the dynamics under feedback of the motors.

        The feedback adds the stiffness G' k_p G and the damping G' k_d G on the platform.

        Args:
            motor_speed: G (T, n_a, n), the motors' speeds for unit twists of the platform.
        """
        G_transposed = motor_speed.transpose(0, 2, 1)
        stiffness, damping = (G_transposed @ (gain[:, None] * motor_speed) for gain in control)
        return self._replace(
            per_rate=self.per_rate + self.per_wrench @ damping,
            per_error=self.per_error + self.per_wrench @ stiffness,
        )


def error_dynamics(result: InverseDynamics, times: Array) -> ErrorDynamics:
    """Compute the dynamics of the platform's error at `times` (T,) [s], at constant deflections.

    T = dq/dx are the joint rates for unit rates of the coordinates, and E maps rates of x to the twist. The
    virtual work along x gives, with the forces r of the open tree and constant loop forces lambda,

        E' d(W - G' tau) = T' d(r + torques of the rotors - J' lambda).

    Raises:
        NotAssembled: the platform does not determine the joints at some instant (Type 1).
    """
    robot = result.robot
    x, dx, ddx = (result.platform(times, order) for order in range(3))
    motion = result.motion(times)
    joint_torque = robot.gear_ratio * result.torques(times)
    joint_torque -= (robot.rotors * motion.a)[:, robot.actuated]
    changes = coordinate_changes(robot, motion, robot.structure.idle, (x, dx, ddx))
    r = tree_forces(robot, motion)
    force_change = driven_force_changes(robot, motion, r, joint_torque, changes)  # (3, T, k, nv)

    # of the k coordinates the first n are those of the platform, the others idle joints
    force_change = force_change[:, :, : robot.n]
    motions = changes.q[:, : robot.n]  # (T, n, nv) T'
    # derivatives of E' (W - G' tau) by x, dx/dt and d2x/dt2, (T, n, n) each
    by_x, by_rate, inertia = motions @ force_change.swapaxes(2, 3)
    E_transposed = robot.platform.rate_matrix(x).swapaxes(1, 2)
    inverse = np.linalg.inv(inertia)
    return ErrorDynamics(
        per_wrench=-inverse @ E_transposed, per_rate=-inverse @ by_rate, per_error=-inverse @ by_x
    )


def repelling_rates(result: InverseDynamics, times: Array) -> Array:
    """Compute the largest growth rate (T,) [1/s] of an error of the platform; 0 if no error grows.

    The terms in d' of the header's equation, due to the speed of the motion and to viscous damping, are
    neglected. The rates r of the solutions e^(rt) of d" = per_error d are the square roots of the eigenvalues
    of `per_error`.

    Raises:
        NotAssembled: as `error_dynamics`.
    """
    squares = np.linalg.eigvals(error_dynamics(result, times).per_error)
    return np.sqrt(squares.astype(complex)).real.max(axis=1)


def open_loop_error(dynamics: ErrorDynamics, times: Array, missing_wrench: Array) -> Array:
    """Compute the platform's error (T, n) [m, rad] for a missing wrench W - G' tau (T, n).

    The state y = (d, d') satisfies y' = A y + f with f = (0, `per_wrench` times the wrench), and starts at
    rest on the path. It is integrated by the trapezoidal rule with steps h,

        (1 - h/2 A_k) y_k = (1 + h/2 A_(k-1)) y_(k-1) + h/2 (f_(k-1) + f_k).

    Args:
        dynamics: matrices at the instants `times`.
        times: (T,) [s], equidistant.
        missing_wrench: W - G' tau at these instants [N, N m].
    """
    count, n = missing_wrench.shape
    y, f = np.zeros((2, count, 2 * n))
    f[:, n:] = np.einsum("tij,tj->ti", dynamics.per_wrench, missing_wrench)
    A = np.zeros((count, 2 * n, 2 * n))  # [0 1; per_error per_rate]
    A[:, :n, n:] = np.eye(n)
    A[:, n:, :n] = dynamics.per_error
    A[:, n:, n:] = dynamics.per_rate

    half_step = 0.5 * (times[1] - times[0])
    explicit = np.eye(2 * n) + half_step * A  # (T, 2 n, 2 n) factors of y_(k-1)
    implicit_inverse = np.linalg.inv(np.eye(2 * n) - half_step * A)
    for k in range(1, count):
        forcing = half_step * (f[k - 1] + f[k])
        y[k] = implicit_inverse[k] @ (explicit[k - 1] @ y[k - 1] + forcing)
    return y[:, :n]


def fall_exponent(result: InverseDynamics) -> float:
    """Compute the duration of a motion in time constants of the fall.

    It is the integral of the largest growth rate over the motion.

    Raises:
        NotAssembled: as `error_dynamics`.
    """
    times = np.linspace(0.0, result.duration, GROWTH_INSTANTS)
    return float(np.trapezoid(repelling_rates(result, times), times))


def open_loop_growth(exponent: float) -> float:
    """Compute the final error under a constant force, relative to that of a free mass.

    The error d" = r^2 d + f grows as d = f (cosh rt - 1) / r^2, and that of a free mass as d = f t^2 / 2.
    With the exponent L = rt of `fall_exponent` their ratio is 2 (cosh L - 1) / L^2 = (sinh(L/2) / (L/2))^2.
    It is 1 if no error grows, and infinite where it overflows.
    """
    half = 0.5 * exponent
    if half <= 0.0:
        return 1.0
    with np.errstate(over="ignore"):
        return float((np.sinh(half) / half) ** 2)
