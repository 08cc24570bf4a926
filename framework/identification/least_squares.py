"""Weighted least squares of the torque equations, with the covariance of their own noise.

The noise of a motor is an autoregressive process, n(t) = sum of phi_k n(t - k) + e(t) with white e. Quantised
currents, ripple, filters of the drive and what the model leaves out make it coloured. The residuals of a fit
give phi and the variance of e; equations filtered by 1 - sum of phi_k z^-k have white noise, and are solved
again (feasible generalised least squares; Cochrane and Orcutt 1949). The order has the least Bayesian
information criterion (Schwarz 1978). Errors of the motion reach several motors at once: the inverse Cholesky
factor of the correlation of the white noise between motors makes their equations independent.

Noise of the motion adds its own information E' E to the information A' A of rows A, and pulls parameters
towards zero where its share is large. With A = Q R and the singular values e and right vectors V of E R^-1,
the corrected equations are diag(1 - e^2) V' R parameters = V' (Q' b), without those that are half noise or
more (moments of errors in variables; Fuller, "Measurement Error Models", 1987, section 2.2).

Errors of the torque sensors that are constant through a recording are unknowns too, with normal priors:
a share of each torque (`scale`), an offset, and a delay of all torques. QR of the filtered equations with the
columns of these errors first eliminates the errors: R of the other columns is the root of their information.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput
from framework.identification.torque_rows import TorqueRows
from framework.numerics.arrays import Array, BoolArray
from framework.tolerances import RANK_ROUNDING

SENSOR_ERRORS = {"scale": 0.005, "offset": 0.0, "delay": 0.0}
"""Standard deviations of sensor errors: shares of a torque, shares of its root mean square, seconds."""

MIN_CORRELATED = 100  # instants for each motor from which correlations between motors are estimated


class Estimate(NamedTuple):
    """Estimated parameters: root @ (parameters) = right with independent unit noise."""

    root: Array  # (f, f) upper triangular; root' root is the information
    right: Array  # (f,)
    noise: Array  # (n_a,) root mean square of the residuals [N m, N]
    offset: Array  # (n_a,) of the torques [N m, N]
    order: int  # largest one of the autoregressive processes
    equations: int  # number of equations

    def solve(self, sizes: Array) -> tuple[Array, Array]:
        """Solve for values and standard deviations (f,) of parameters of typical `sizes` (f,).

        Directions that the data do not determine remain zero, and may be off by the sizes.
        """
        U, sigma, V_rows = np.linalg.svd(self.root * sizes, full_matrices=False)
        is_seen = sigma > RANK_ROUNDING * sigma.max(initial=0.0)
        inverse = V_rows[is_seen].T / sigma[is_seen]  # (f, seen)
        values = sizes * (inverse @ (U.T @ self.right)[is_seen])
        unseen = V_rows[~is_seen].T  # (f, unseen) unit vectors
        return values, sizes * np.linalg.norm(np.hstack([inverse, unseen]), axis=1)


def estimate(
    rows: TorqueRows,
    design: Array,
    start: Array,
    *,
    errors: Mapping[str, float] = MappingProxyType(SENSOR_ERRORS),
) -> Estimate:
    """Estimate f parameters with beta = start + design @ parameters from the valid equations.

    Args:
        design: (r, f) derivatives of the base parameters beta.
        start: (r,) base parameters where the parameters are zero.
        errors: standard deviations of the sensors' errors, by names of `SENSOR_ERRORS`; 0 for none.

    Raises:
        InvalidInput: fewer equations than parameters.
    """
    passes = 4  # of weighting by the residuals of the solution before
    count = int(np.count_nonzero(rows.valid))
    if count <= design.shape[1]:
        raise InvalidInput(
            f"{count} equations at instants whose motors move, for {design.shape[1]} parameters; record "
            f"longer, or a faster motion"
        )
    matrix = rows.matrix @ design  # (T, n_a, f)
    noise_matrix = rows.matrix_noise @ design  # (T, n_a, f)
    expected = rows.constant + rows.matrix @ start  # (T, n_a) torque where the parameters are zero
    misfit = rows.torque - expected
    f = matrix.shape[2]
    motors = range(misfit.shape[1])
    noise_filters = [np.ones(1) for _ in motors]
    unmix = np.eye(len(motors))
    weights = np.ones_like(misfit)  # (T, n_a)
    predicted = rows.torque
    for k in range(passes):
        sensors, deviations = _sensor_columns(rows, predicted, errors if k else {})
        s = sensors.shape[2]
        columns = np.concatenate([noise_matrix, sensors, matrix, misfit[..., None]], axis=2)
        columns *= np.sqrt(rows.independent) * weights[..., None]
        white = _whiten(columns, rows.valid, noise_filters, unmix)
        E, A_and_b = np.split(white, [f], axis=1)
        prior = np.hstack([np.diag(1.0 / deviations), np.zeros((s, f + 1))])
        R = np.asarray(np.linalg.qr(np.concatenate([prior, A_and_b]), mode="r"))
        root, right = _remove_noise(R[s:-1, s:-1], R[s:-1, -1], E)

        # the noise is what this solution leaves, with that of the motion
        lengths = np.linalg.norm(R[:, s:-1], axis=0)
        lengths[lengths == 0.0] = 1.0
        solution = np.linalg.lstsq(root / lengths, right, rcond=RANK_ROUNDING)[0] / lengths
        of_sensors = np.linalg.solve(R[:s, :s], R[:s, -1] - R[:s, s:-1] @ solution)
        predicted = expected + matrix @ solution
        residual = rows.torque - predicted - sensors @ of_sensors  # (T, n_a)
        if k < passes - 1:
            weights = _weights(residual, rows)
            series = zip((weights * residual).T, rows.valid.T, strict=True)
            noise_filters = [_noise_filter(*motor) for motor in series]
            if rows.independent == 1.0:  # else motors repeat one another
                unmix = _unmixing(weights * residual, rows.valid, noise_filters)
    offset = of_sensors[s - len(motors) :] if errors.get("offset") else np.zeros(len(motors))
    noise = np.sqrt(np.sum(residual**2 * rows.valid, axis=0) / np.maximum(rows.valid.sum(axis=0), 1))
    order = max(map(len, noise_filters)) - 1
    return Estimate(root, right, noise, offset, order, count)


def _remove_noise(R: Array, right: Array, E: Array) -> tuple[Array, Array]:
    """Correct the equations R z = right (f,) for the information of the noise's rows E (N, f).

    Equations with a share of noise above `most` of their information become zero.
    """
    most = 0.5
    lengths = np.linalg.norm(R, axis=0)
    lengths[lengths == 0.0] = 1.0
    inverse = np.linalg.pinv(R / lengths, rcond=RANK_ROUNDING)
    triangle = np.linalg.qr(E / lengths, mode="r")
    _, e, V_rows = np.linalg.svd(triangle @ inverse)
    share = np.zeros(len(R))
    share[: len(e)] = e**2
    seen = share < most
    return np.where(seen, 1.0 - share, 0.0)[:, None] * (V_rows @ R), np.where(seen, V_rows @ right, 0.0)


def _sensor_columns(rows: TorqueRows, predicted: Array, errors: Mapping[str, float]) -> tuple[Array, Array]:
    """Return the columns (T, n_a, s) of s sensor errors, and their standard deviations (s,).

    `predicted` (T, n_a) are the torques by the parameters so far. Columns of offsets come last.
    """
    n_a = predicted.shape[1]
    each = np.eye(n_a)
    columns = []
    deviations: list[float] = []
    if errors.get("delay"):
        columns.append(-np.gradient(predicted, rows.times, axis=0)[..., None])
        deviations.append(errors["delay"])
    if errors.get("scale"):
        columns.append(predicted[..., None] * each)
        deviations += [errors["scale"]] * n_a
    if errors.get("offset"):
        columns.append(np.broadcast_to(each, (len(predicted), n_a, n_a)))
        deviations += (errors["offset"] * np.sqrt(np.mean(rows.torque**2, axis=0))).tolist()
    return np.concatenate([np.empty((*predicted.shape, 0)), *columns], axis=2), np.array(deviations)


def _weights(residual: Array, rows: TorqueRows) -> Array:
    """Compute weights (T, n_a): 1 where errors of the motion add nothing to the noise, less where they do.

    Residuals (T, n_a) have the variance s^2 + motion noise^2; s is the median of what the motion leaves.
    """
    weights = np.ones_like(residual)
    for j, valid in enumerate(rows.valid.T):
        if valid.any():
            # the median of a squared normal variable is 0.455 of its variance
            noise = np.sqrt(np.median(residual[valid, j] ** 2) / 0.455)
            weights[:, j] = noise / np.maximum(np.hypot(noise, rows.motion_noise[:, j]), np.finfo(float).tiny)
    return weights


def _whiten(columns: Array, valid: BoolArray, noise_filters: Sequence[Array], unmix: Array) -> Array:
    """Filter columns (T, n_a, k) in time and between motors; return the usable rows (N, k)."""
    filtered = [_filter(columns[:, j], valid[:, j], taps) for j, taps in enumerate(noise_filters)]
    white = np.stack([values for values, _ in filtered])  # (n_a, T, k)
    usable = np.stack([mask for _, mask in filtered])  # (n_a, T)
    together = usable.all(axis=0)
    white[:, together] = np.tensordot(unmix, white[:, together], axes=1)
    return white[usable]


def _unmixing(residual: Array, valid: BoolArray, noise_filters: Sequence[Array]) -> Array:
    """Compute the inverse Cholesky factor (n_a, n_a) of the correlation of filtered residuals (T, n_a)."""
    filtered = [_filter(residual[:, [j]], valid[:, j], taps) for j, taps in enumerate(noise_filters)]
    together = np.all([usable for _, usable in filtered], axis=0)
    white = np.stack([values[together, 0] for values, _ in filtered])  # (n_a, N)
    if white.shape[1] < MIN_CORRELATED * len(white):
        return np.eye(len(white))
    lengths = np.linalg.norm(white, axis=1, keepdims=True)
    white /= np.maximum(lengths, np.finfo(float).tiny)
    return np.linalg.inv(np.linalg.cholesky(white @ white.T + RANK_ROUNDING * np.eye(len(white))))


def _filter(columns: Array, valid: BoolArray, noise_filter: Array) -> tuple[Array, BoolArray]:
    """Filter the columns (T, k) of one motor; return a mask (T,) of rows whose whole past is valid too."""
    filtered = np.zeros_like(columns)
    usable = np.ones(len(columns), dtype=bool)
    count = len(columns)
    for lag, weight in enumerate(noise_filter):
        filtered[lag:] += weight * columns[: count - lag]
        usable[lag:] &= valid[: count - lag]
        usable[:lag] = False
    return filtered, usable


def _noise_filter(residual: Array, valid: BoolArray) -> Array:
    """Return the filter (order + 1,) that turns the residuals (T,) of a motor into white unit noise.

    Levinson's recursion solves the Yule-Walker equations of all orders from the autocovariances.
    """
    max_order = 24
    rows_per_order = 20
    masked = np.where(valid, residual, 0.0)
    count = int(np.count_nonzero(valid))
    highest = int(min(max_order, count // rows_per_order))
    covariance = np.array([masked[lag:] @ masked[: len(masked) - lag] for lag in range(highest + 1)]) / max(
        count, 1
    )
    least = np.finfo(float).tiny + (np.finfo(float).eps * np.abs(residual).max(initial=0.0)) ** 2
    variance = max(float(covariance[0]), least)
    coefficients = np.ones(1)  # 1, -phi_1, -phi_2 ...
    best = (count * np.log(variance), coefficients / np.sqrt(variance))
    for order in range(1, highest + 1):
        reflection = -coefficients @ covariance[order:0:-1] / variance
        extended = np.append(coefficients, 0.0)
        coefficients = extended + reflection * extended[::-1]
        variance = max(variance * (1.0 - reflection**2), least)
        criterion = count * np.log(variance) + order * np.log(count)
        if criterion < best[0]:
            best = (criterion, coefficients / np.sqrt(variance))
    return best[1]
