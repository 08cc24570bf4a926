"""Time-varying LQR on the manifold of closed loops.

The dynamics are linearised along the plan in platform coordinates, where they are regular at Type 2: there
G loses rank, for an instant one direction is out of the motors' hands, and the Riccati equation knows it
before and after. After Bordalba, Ros and Porta, A Singularity-Robust LQR Controller for Parallel
Robots, IROS 2018.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.arrays import Array
from framework.control.estimation import Measurement, estimated_state
from framework.control.reference import Reference
from framework.dynamics.forward_derivatives import forward_derivatives
from framework.errors import InvalidInput
from framework.linalg.ordered_sums import matvec


@dataclass(frozen=True, eq=False)
class TimeVaryingLQR:
    """tau = tau_plan + gain [x error; dx error]."""

    reference: Reference
    gain: Array  # (K, n_a, 2n)

    @staticmethod
    def tune(
        reference: Reference, *, position: float = 1e-3, speed: float = 2e-2, torque: float | None = None
    ) -> TimeVaryingLQR:
        """Return the controller for which errors of `position` and `speed` are worth a `torque` [N m].

        In lengths of the robot, and lengths per second; `torque` is the peak of the plan when None.

        Raises:
            InvalidInput: the robot has springs, or a weight is not positive.
        """
        robot = reference.robot
        if robot.n_e:
            raise InvalidInput(
                f"controller lqr: for rigid robots; {robot.name} has the springs "
                f"{', '.join(robot.elastic_names)}: use feedforward"
            )
        worth = float(np.abs(reference.torque).max()) if torque is None else torque
        for name, value in (("position", position), ("speed", speed), ("torque", worth)):
            if not (np.isfinite(value) and value > 0):
                raise InvalidInput(f"lqr: {name} must be a positive number, got {value!r}")
        size = robot.platform_scale
        Q = np.diag(np.concatenate([1 / (position * size) ** 2, 1 / (speed * size) ** 2]))
        R = np.eye(robot.n_a) / worth**2
        A, B = linearise_error(reference)
        return TimeVaryingLQR(reference, riccati(A, B, Q, R, reference.period))

    def torque(self, k: int, measurement: Measurement) -> Array:
        """Compute motor torques (R, n_a) [N m]."""
        ref = self.reference
        state = estimated_state(ref, k, measurement, aware=True)
        error = np.concatenate([ref.x[k] - state.x, ref.dx[k] - state.dx], axis=1)
        return ref.held[k] + matvec(self.gain[k], error)


def linearise_error(reference: Reference) -> tuple[Array, Array]:
    """Linearise the error e = [x; dx] along the plan.

    de/dt = A e + B tau with A (K, 2n, 2n) and B (K, 2n, n_a).
    """
    robot, motion, n = reference.robot, reference.motion, reference.robot.n
    slopes = forward_derivatives(
        robot,
        motion.q,
        motion.v,
        reference.torque,
        wrenches=reference.planned_wrenches,
        turning=[entry.frame for entry in reference.wrenches.entries if entry.turns],
    )
    by_x, by_dx = slopes.acceleration_y, slopes.acceleration_dy
    rates = np.broadcast_to(np.eye(n), by_x.shape)
    A = np.block([[np.zeros_like(by_x), rates], [by_x, by_dx]])
    return A, np.concatenate([np.zeros_like(slopes.acceleration_torque), slopes.acceleration_torque], axis=1)


def riccati(A: Array, B: Array, Q: Array, R: Array, period: float) -> Array:
    """Solve the discrete Riccati equation from the end back: gains (K, n_a, 2n), held for a period."""
    count, size, inputs = B.shape
    from scipy.linalg import expm

    system = np.zeros((count, size + inputs, size + inputs))
    system[:, :size] = np.concatenate([A, B], axis=2) * period
    discrete = expm(system)
    F, G = discrete[:, :size, :size], discrete[:, :size, size:]
    gain = np.empty((count, inputs, size))
    P = Q.copy()
    for k in range(count - 1, -1, -1):
        PG = P @ G[k]
        gain[k] = np.linalg.solve(R + G[k].T @ PG, PG.T @ F[k])
        closed = F[k] - G[k] @ gain[k]
        P = Q + gain[k].T @ R @ gain[k] + closed.T @ P @ closed
    return gain
