"""Time-varying LQR on the manifold of closed loops.

The dynamics are linearised along the plan in platform coordinates, where they are regular at Type 2. There G
loses rank, and for an instant the motors do not control one direction. The Riccati equation takes this into
account: gains before and after the crossing correct the errors in that direction. After Bordalba, Ros and
Porta, A Singularity-Robust LQR Controller for Parallel Robots, IROS 2018.
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
        """Return the controller whose cost is equal for errors `position` and `speed` and a torque `torque`.

        The cost is the integral of e' Q e + u' R u with diagonal weights 1 / position^2, 1 / speed^2 [robot
        lengths, robot lengths/s] and 1 / torque^2 [N m]. `torque` None: the peak of the plan.

        Raises:
            InvalidInput: the robot has springs, or a weight is not positive.
        """
        robot = reference.robot
        if robot.n_e:
            raise InvalidInput(
                f"controller lqr: for rigid robots; {robot.name} has the springs "
                f"{', '.join(robot.elastic_names)}: use feedforward"
            )
        torque = float(np.abs(reference.torque).max()) if torque is None else torque
        for name, value in (("position", position), ("speed", speed), ("torque", torque)):
            if not (np.isfinite(value) and value > 0):
                raise InvalidInput(f"lqr: {name} must be a positive number, got {value!r}")
        scale = robot.platform_scale
        Q = np.diag(np.concatenate([1 / (position * scale) ** 2, 1 / (speed * scale) ** 2]))
        R = np.eye(robot.n_a) / torque**2
        A, B = linearise_error(reference)
        return TimeVaryingLQR(reference, riccati(A, B, Q, R, reference.period))

    def torque(self, k: int, measurement: Measurement) -> Array:
        """Compute motor torques (R, n_a) [N m]."""
        ref = self.reference
        state = estimated_state(ref, k, measurement, aware=True)
        error = np.concatenate([ref.x[k] - state.x, ref.dx[k] - state.dx], axis=1)
        return ref.period_torque[k] + matvec(self.gain[k], error)


def linearise_error(reference: Reference) -> tuple[Array, Array]:
    """Compute A (K, 2n, 2n) and B (K, 2n, n_a) of the linearised error dynamics along the plan.

    With the error e = [x; dx], de/dt = A e + B tau with A = [[0, 1], [d(ddx)/dx, d(ddx)/d(dx)]] and B = [[0],
    [d(ddx)/dtau]].
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
    by_x, by_dx, by_torque = slopes.acceleration_y, slopes.acceleration_dy, slopes.acceleration_torque
    identity = np.broadcast_to(np.eye(n), by_x.shape)
    A = np.block([[np.zeros_like(by_x), identity], [by_x, by_dx]])
    return A, np.concatenate([np.zeros_like(by_torque), by_torque], axis=1)


def riccati(A: Array, B: Array, Q: Array, R: Array, period: float) -> Array:
    """Solve the discrete Riccati equation from the last instant backwards: gains (K, n_a, 2n).

    Torques are constant for a period h: e_(k+1) = F e_k + G tau_k with [F, G; 0, 1] = exp([A, B; 0, 0] h).
    """
    count, size, inputs = B.shape
    from scipy.linalg import expm

    generator = np.zeros((count, size + inputs, size + inputs))
    generator[:, :size] = np.concatenate([A, B], axis=2) * period
    transition = expm(generator)
    F, G = transition[:, :size, :size], transition[:, :size, size:]
    gain = np.empty((count, inputs, size))
    P = Q.copy()  # of the cost to go e' P e
    for k in range(count - 1, -1, -1):
        PG = P @ G[k]
        gain[k] = np.linalg.solve(R + G[k].T @ PG, PG.T @ F[k])
        closed = F[k] - G[k] @ gain[k]
        P = Q + gain[k].T @ R @ gain[k] + closed.T @ P @ closed
    return gain
