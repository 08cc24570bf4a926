"""The measurements of R runs at one sampling instant, and the platform's state estimated from them.

With encoders only on the motors, the platform's coordinates follow from the motor angles by the inverse of
G = d(motor angles)/dx. G is singular at Type 2, like A: near it the naive estimate is noise divided by nearly
zero. In the directions that the motors do not determine the aware estimate is the plan.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from framework.control.reference import Reference
from framework.kinematics.frames import integrate
from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import matvec, solve

FADING_RATIO = 0.1  # singular values below this share of the largest count as near the singularity


class RobotState(NamedTuple):
    """Configuration and platform of R runs, measured or estimated."""

    q: Array  # (R, nq)
    v: Array  # (R, nv)
    x: Array  # (R, n) [m, rad]
    dx: Array  # (R, n)


class Measurement(NamedTuple):
    """The readings of the encoders; `state` is None with encoders only on the motors."""

    motor_angle: Array  # (R, n_a) [rad], motor side
    motor_speed: Array  # (R, n_a)
    state: RobotState | None


class Controller(Protocol):
    """A controller for one reference, without internal state."""

    @property
    def reference(self) -> Reference:
        """The planned motion that the controller follows."""

    def torque(self, k: int, measurement: Measurement) -> Array:
        """Compute motor torques (R, n_a) [N m], motor side, at sampling instant k."""
        ...


def estimate_state(reference: Reference, k: int, measurement: Measurement, *, aware: bool) -> RobotState:
    """Return the measured state at instant k, or its estimate from the motors.

    The estimate is one Newton step from the plan. G dx = (measured - planned motor angles) gives the step of
    the platform, N dx that of the joints; rates alike.
    """
    if measurement.state is not None:
        return measurement.state
    robot = reference.robot
    N = reference.N[k]
    G = robot.gear_ratio[:, None] * N[robot.actuated]  # (n_a, n)
    angle_error = measurement.motor_angle - reference.motor_angle[k]
    speed_error = measurement.motor_speed - reference.motor_speed[k]
    errors = np.stack([angle_error, speed_error])
    if aware:
        x_step, dx_step = solve_damped(G[None], errors)
    else:
        inverse = solve(G[None], np.eye(len(G))[None])
        x_step, dx_step = matvec(inverse, errors)
    return RobotState(
        q=integrate(robot, reference.motion.q[k], matvec(N, x_step)),
        v=reference.motion.v[k] + matvec(N, dx_step),
        x=reference.x[k] + x_step,
        dx=reference.dx[k] + dx_step,
    )


def solve_damped(matrices: Array, right: Array) -> Array:
    """Solve matrices (R, m, k) for right-hand sides (R, m) by damped least squares.

    Instead of 1 / sigma a singular value below t = FADING_RATIO times the largest has the factor sigma / t^2:
    it is continuous at t and falls to zero with sigma. NaN where a matrix is not finite.
    """
    finite = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))[:, None]
    U, sigma, V_rows = np.linalg.svd(np.where(finite[:, None], matrices, 0.0), full_matrices=False)
    threshold = FADING_RATIO * sigma[:, :1]
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.where(sigma > threshold, 1.0 / np.maximum(sigma, threshold), sigma / threshold**2)
    solutions = matvec(V_rows.transpose(0, 2, 1), inverse * matvec(U.transpose(0, 2, 1), right))
    return np.where(finite, solutions, np.nan)
