"""The steps of a calibration: parameters and poses at once, with a prior, weights and an estimated noise."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from framework.arrays import Array
from framework.errors import NotConverged
from framework.identification.calibration_equations import Measurements, ParameterEquations, eliminate_poses
from framework.kinematics.frames import integrate_columns
from framework.kinematics.parallel_robot import ParallelRobot
from framework.tolerances import RANK_ROUNDING

HUBER = 2.0  # of the usual residual of an instant: larger ones have less weight
MAX_STEPS, FIRST_DAMPING, MAX_DAMPING = 60, 1e-3, 1e9  # damping is a share of the prior's weight
CONVERGED = 1e-6  # of the prior: the largest change of a parameter in the last step
DEVIATIONS = 3.0  # at which Student's distribution and the normal one are compared
LEAST_NOISE = 1e-3  # of residuals over the assumed noise: rounding


class GaussNewton:
    """Damped Gauss-Newton steps for parameters and poses.

    values, deviations: (p,) of the parameters about the file's, and their standard deviations.
    weights: (T,) roots of Huber's weights of the instants.
    noise: residual over the assumed noise; freedom: degrees of freedom of this estimate.
    """

    def __init__(self, model: ParallelRobot, measured: Measurements, q: Array, prior: Array) -> None:
        self.model, self.measured, self.q, self.prior = model, measured, q, prior
        self.values, self.weights = np.zeros(len(prior)), np.ones(len(q))
        self.noise, self.freedom, self.count = 1.0, 0.0, 0
        self.deviations = prior

    def run(self, name: str, progress: Callable[[int], None]) -> None:
        """Take steps until the parameters rest."""
        damping, equations = FIRST_DAMPING, eliminate_poses(self.model, self.measured, self.q)
        self._weigh(equations)
        cost = self._cost(equations, self.values)
        for self.count in range(1, MAX_STEPS + 1):
            progress(self.count)
            change = self._change(equations, damping)
            joints = equations.step + equations.follow @ change
            parameters = np.tile(change, (len(joints), 1))
            columns = np.concatenate([self.model.joints, self.model.elastic])
            q = integrate_columns(self.model, self.q, columns, np.concatenate([joints, parameters], axis=1))
            stepped = eliminate_poses(self.model, self.measured, q)
            stepped_cost = self._cost(stepped, self.values + change)
            if not stepped_cost <= cost * (1.0 + RANK_ROUNDING) + RANK_ROUNDING:
                damping *= 10.0
                if damping > MAX_DAMPING:
                    break
                continue
            self.q, self.values, equations = q, self.values + change, stepped
            damping = max(0.1 * damping, 1e-12)
            self._weigh(equations)
            cost = self._cost(equations, self.values)
            if np.abs(change / self.prior).max() < CONVERGED:
                self._finish(equations)
                return
        raise NotConverged(
            f"{name}: calibration does not settle after {self.count} steps; the file is too far off for "
            f"these data, or they are of another robot",
            residual=float(cost),
        )

    def _system(self, equations: ParameterEquations) -> tuple[Array, Array]:
        """Return rows on scaled parameters, of unit noise, and their right sides; the prior left out."""
        weights = self.weights[:, None] / self.noise
        matrix = np.concatenate(
            [rows_of(weights[..., None] * equations.matrix), rows_of(equations.loop_slopes)]
        )
        right = np.concatenate([(weights * equations.right).ravel(), equations.open_loops.ravel()])
        return matrix * self.prior, right

    def _change(self, equations: ParameterEquations, damping: float) -> Array:
        matrix, right = self._system(equations)
        damped = np.sqrt(damping) * np.eye(len(self.prior))
        rows = np.concatenate([matrix, np.eye(len(self.prior)), damped])
        targets = np.concatenate([right, self.values / self.prior, np.zeros(len(self.prior))])
        q, r = np.linalg.qr(rows)
        return -self.prior * np.linalg.solve(r, q.T @ targets)

    def _cost(self, equations: ParameterEquations, values: Array) -> float:
        right = self._system(equations)[1]
        return float(right @ right + np.sum((values / self.prior) ** 2))

    def _weigh(self, equations: ParameterEquations) -> None:
        """Set the noise of the usual instant, and Huber's weights of outlying instants."""
        ranks = equations.right.shape[1] - self.measured.driven
        size = np.sqrt(np.sum(equations.right**2, axis=1) / max(ranks, 1))
        self._set_noise(equations, float(np.median(size)))
        self.weights = np.sqrt(np.minimum(1.0, HUBER * self.noise / np.maximum(size, RANK_ROUNDING)))

    def _finish(self, equations: ParameterEquations) -> None:
        """Set the noise of all instants, and the deviations."""
        from scipy.special import ndtr, stdtrit  # takes time to import

        right = self.weights[:, None] * equations.right
        count = equations.right.size - self.measured.driven * len(self.q)
        self._set_noise(equations, float(np.sqrt(np.sum(right**2) / max(count, 1))))
        matrix, _ = self._system(equations)
        upper = np.linalg.qr(np.concatenate([matrix, np.eye(len(self.prior))]), mode="r")
        self.deviations = self.prior * np.linalg.norm(np.linalg.inv(upper), axis=1)
        if self.freedom >= 1.0:
            self.deviations *= stdtrit(self.freedom, ndtr(DEVIATIONS)) / DEVIATIONS

    def _set_noise(self, equations: ParameterEquations, residual: float) -> None:
        """Estimate the noise of equations from their residuals at the fit, over the assumed noise.

        A fit of N equations of noise s with a prior has residuals s sqrt(N - r), r = sum of w^2 / (w^2 + s^2)
        the number of parameters that it determines, w the singular values of the rows: the left side of
        s^2 (N - r) = N residual^2 grows with s.
        """
        count = equations.right.size - self.measured.driven * len(self.q)
        powers = self._powers(equations)

        def freedom(noise: float) -> float:
            return count - float(np.sum(powers / (powers + noise**2)))

        self.noise, self.freedom = 1.0, freedom(LEAST_NOISE)
        if self.freedom < 1.0:
            return
        from scipy.optimize import brentq  # takes time to import

        def excess(noise: float) -> float:
            return float(noise**2 * freedom(noise) - count * residual**2)

        high = max(residual * np.sqrt(count), 1.0)
        self.noise = LEAST_NOISE
        if excess(LEAST_NOISE) < 0.0:
            self.noise = float(brentq(excess, LEAST_NOISE, high, xtol=RANK_ROUNDING * LEAST_NOISE))
        self.freedom = freedom(self.noise)

    def _powers(self, equations: ParameterEquations) -> Array:
        """Return squared singular values (p,) of the data's scaled rows on motions that the loops allow."""
        size = len(self.prior)
        loops = np.concatenate([rows_of(equations.loop_slopes) * self.prior, np.zeros((size, size))])
        _, values, axes = np.linalg.svd(np.linalg.qr(loops, mode="r"))
        rows = rows_of(self.weights[:, None, None] * equations.matrix) * self.prior
        rows = rows @ axes.T / np.sqrt(1.0 + values**2)
        return np.linalg.eigvalsh(rows.T @ rows).clip(0.0)


def rows_of(stack: Array) -> Array:
    """Return the rows (T m, p) of a stack (T, m, p) below one another."""
    return stack.reshape(-1, stack.shape[2])
