"""The measurements of R runs at one sampling instant, and the platform's state estimated from them.

With encoders on the motors alone, the platform's coordinates follow from the motor angles by the inverse
of G = d(motor angles)/dx, and G is singular at Type 2 like A: close to it the naive conclusion is noise
divided by nearly zero. The aware one takes from the plan what the motors cannot tell.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from framework.arrays import Array
from framework.control.reference import Reference
from framework.kinematics.frames import integrate
from framework.linalg.ordered_sums import matvec, solve

FADING_RATIO = 0.1  # singular values below this share of the largest count as near the singularity


class RobotState(NamedTuple):
    """Configuration and platform of R runs, measured or concluded."""

    q: Array  # (R, nq)
    v: Array  # (R, nv)
    x: Array  # (R, n) [m, rad]
    dx: Array  # (R, n)


class Measurement(NamedTuple):
    """The readings of the encoders; `state` is None with encoders on the motors alone."""

    motor_angle: Array  # (R, n_a) [rad], motor side
    motor_speed: Array  # (R, n_a)
    state: RobotState | None


class Controller(Protocol):
    """A control law for one reference, without a state of its own."""

    @property
    def reference(self) -> Reference: ...

    def torque(self, k: int, measurement: Measurement) -> Array:
        """Compute motor torques (R, n_a) [N m], motor side, at sampling instant k."""
        ...


def estimated_state(reference: Reference, k: int, measurement: Measurement, *, aware: bool) -> RobotState:
    """Estimate the state at sampling instant k: as measured, or by one Newton step from the plan."""
    if measurement.state is not None:
        return measurement.state
    robot, N = reference.robot, reference.N[k]
    G = robot.gear_ratio[:, None] * N[robot.actuated]  # (n_a, n)
    angle = measurement.motor_angle - reference.motor_angle[k]
    speed = measurement.motor_speed - reference.motor_speed[k]
    errors = np.stack([angle, speed])
    step, rate = (
        consistent_solution(G[None], errors)
        if aware
        else matvec(solve(G[None], np.eye(len(G))[None]), errors)
    )
    return RobotState(
        q=integrate(robot, reference.motion.q[k], matvec(N, step)),
        v=reference.motion.v[k] + matvec(N, rate),
        x=reference.x[k] + step,
        dx=reference.dx[k] + rate,
    )


def consistent_solution(matrices: Array, right: Array) -> Array:
    """Compute least-squares solutions (R, k) of systems (R, m, k) with right-hand sides (R, m).

    Directions fade out as their singular value does: where it is below `FADING_RATIO` of the largest, its
    inverse sinks to zero with it. NaN where a matrix is not finite.
    """
    finite = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))[:, None]
    u, sigma, v = np.linalg.svd(np.where(finite[:, None], matrices, 0.0), full_matrices=False)
    threshold = FADING_RATIO * sigma[:, :1]
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.where(sigma > threshold, 1.0 / np.maximum(sigma, threshold), sigma / threshold**2)
    solutions = matvec(v.transpose(0, 2, 1), inverse * matvec(u.transpose(0, 2, 1), right))
    return np.where(finite, solutions, np.nan)
