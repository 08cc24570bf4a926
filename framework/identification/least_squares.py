"""Least squares of the torque equations, with the covariance of all noise.

The noise of a motor is an autoregressive process, n(t) = sum of phi_k n(t - k) + e(t) with white e. Quantised
currents, ripple, filters of the drive and what the model leaves out make it coloured. The residuals of a fit
give phi and the variance of e; equations filtered by 1 - sum of phi_k z^-k have white noise, and are solved
again (feasible generalised least squares; Cochrane and Orcutt 1949). The order has the least Bayesian
information criterion (Schwarz 1978). The inverse Cholesky factor of the correlation of the white noise
between motors makes their equations independent.

Errors of the motion are unknowns too. The coefficients of its splines have errors z, with the information
that the angles give. They reach all torques of several knots, by the torques' derivatives with respect to
accelerations (those of rates and positions are smaller, by the time between knots). The equations are
evaluated at the corrected motion, and z is eliminated (Gauss-Newton steps of a nonlinear model with errors in
variables; Fuller, "Measurement Error Models", 1987, section 3.2). The covariance counts second derivatives by
unknowns and z at the solution. The mean of z would take noise of the motors too, so that their noise is what
z leaves that is drawn from its distribution.

Errors of the torque sensors that are constant through a recording are unknowns with normal priors: a share of
each torque (`scale`), an offset, and a delay of all torques. QR of the equations with the columns of these
errors first eliminates the errors: R of the other columns is the root of their information.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from framework.errors import InvalidInput
from framework.identification.torque_rows import TorqueRows
from framework.numerics.arrays import Array, BoolArray
from framework.numerics.splines import banded_rows
from framework.tolerances import RANK_ROUNDING

SENSOR_ERRORS = {"scale": 0.005, "offset": 0.0, "delay": 0.0}
"""Standard deviations of sensor errors: shares of a torque, shares of its root mean square, seconds."""

MIN_CORRELATED = 100  # instants for each motor from which correlations between motors are estimated


class Estimate(NamedTuple):
    """Estimates of k unknowns that are independent unit normals before the data."""

    values: Array  # (k,)
    spread: Array  # (k, k) S, where S S' is their covariance by data and prior
    noise: Array  # (n_a,) root mean square of the residuals at the recorded motion [N m, N]
    offset: Array  # (n_a,) of the torques [N m, N]
    order: int  # largest one of the autoregressive processes
    equations: int  # number of equations


def posterior_root(rows: Array) -> Array:
    """Compute a root S (k, k) of the covariance S S' of unknowns.

    The unknowns have a unit prior and rows (N, k) with unit noise, U s V'. Together these have the
    information rows' rows + 1. Its inverse is S S' with S = V / sqrt(1 + s^2).
    """
    k = rows.shape[1]
    # the triangle (k, k) of a QR decomposition has the same s and V
    _, s, V_rows = np.linalg.svd(np.linalg.qr(np.concatenate([rows, np.zeros((k, k))]), mode="r"))
    return V_rows.T / np.sqrt(1.0 + s**2)


def estimate(
    rows: TorqueRows,
    design: Array,
    start: Array,
    errors: Mapping[str, float] = MappingProxyType(SENSOR_ERRORS),
) -> Estimate:
    """Estimate k unknowns with beta = start + design @ unknowns from the valid equations.

    The data say root @ unknowns = right with unit noise, for which least squares with the prior is solved.

    Args:
        design: (r, k) derivatives of the base parameters beta.
        start: (r,) base parameters where the unknowns are zero.
        errors: standard deviations of the sensors' errors, by names of `SENSOR_ERRORS`; 0 for none.

    Raises:
        InvalidInput: fewer equations than unknowns.
    """
    max_passes = 20  # each with the noise that the solution before leaves
    converged = 0.1  # length of a step of all unknowns, in standard deviations
    same_noise = 0.02  # relative change of its size
    count = int(np.count_nonzero(rows.valid))
    k = design.shape[1]
    if count <= k:
        raise InvalidInput(
            f"{count} equations at instants whose motors move, for {k} parameters; record longer, or a "
            f"faster motion"
        )
    T, n_a = rows.torque.shape
    motion = _MotionErrors.of(rows)
    augmented = np.column_stack([start, design])  # (r, 1 + k)
    factors = np.eye(1 + k)[0]  # beta = augmented @ factors: 1, then the unknowns
    matrix = rows.matrix @ augmented  # (T, n_a, 1 + k)
    response = rows.response.swapaxes(2, 3) @ augmented  # (T, n_a, signals, 1 + k)
    predicted = rows.torque
    corrections = np.zeros(motion.angles.shape[1])  # errors z of the motion
    # at first noise as large as the torques, so that errors of sensors and motion explain nothing
    noise_filters = [np.ones(1) / size for size in np.sqrt(np.mean(rows.torque**2, axis=0))]
    unmix = np.eye(n_a)
    size = np.zeros(n_a)  # of the noise
    for _ in range(max_passes):
        # the equations at the corrected motion, its errors eliminated
        corrected = matrix + motion.change(response, corrections)  # (T, n_a, 1 + k)
        sensors, deviations = _sensor_columns(rows, predicted, errors)
        misfit = rows.torque - rows.constant - matrix @ factors
        columns = np.concatenate(
            [sensors, corrected[..., 1:], misfit[..., None]], axis=2
        )  # (T, n_a, s + k + 1)
        slopes = motion.torques(response @ factors)  # (T n_a, z)
        whitening = np.sqrt(rows.independent) * _whitening(rows.valid, noise_filters, unmix)
        reduced = motion.eliminate(whitening @ slopes, whitening @ columns.reshape(T * n_a, -1))
        # the triangle R of sensors' errors, whose mean is 0, then unknowns and the right side; without the
        # prior about the unknowns, data that show little would lead them far off
        s = len(deviations)
        prior = np.hstack([np.diag(1.0 / deviations), np.zeros((s, k + 1))])
        R = np.asarray(np.linalg.qr(np.concatenate([prior, reduced.rows]), mode="r"))
        root = R[s:-1, s:-1]  # (k, k) of the unknowns' information
        spread = posterior_root(root)
        values = spread @ (spread.T @ (root.T @ (R[s:-1, -1] + root @ factors[1:])))
        step = values - factors[1:]  # (k,)
        sensor_errors = np.linalg.solve(R[:s, :s], R[:s, -1] - R[:s, s:-1] @ step)  # (s,)

        # the noise is what this solution leaves
        factors = np.append(1.0, values)
        predicted = rows.constant + matrix @ factors
        corrections = reduced.corrections @ np.r_[-sensor_errors, -step, 1.0]
        residual = misfit - sensors @ sensor_errors - corrected[..., 1:] @ step  # (T, n_a)
        noise = residual - (slopes @ (corrections + reduced.draw)).reshape(T, n_a)
        noise_filters = [_noise_filter(*motor) for motor in zip(noise.T, rows.valid.T, strict=True)]
        if rows.independent == 1.0:  # else motors repeat one another
            unmix = _unmixing(noise, rows.valid, noise_filters)
        size_before, size = size, np.sqrt(np.sum(noise**2 * rows.valid, axis=0))
        is_same = np.abs(size - size_before) <= same_noise * size_before
        if is_same.all() and np.linalg.norm(np.linalg.solve(spread, step)) < converged:
            break

    # The second derivatives by unknowns and z, which these steps leave out, lower the information: where
    # accelerations are little above their noise, the corrected motion shows some of the noise as motion.
    by_torque = (whitening.T @ (whitening @ (residual.ravel() - slopes @ corrections))).reshape(T, n_a)
    mixed = motion.mixed_derivatives(response[..., 1:], by_torque)  # (z, k)
    by_sensors = np.linalg.solve(R[:s, :s], R[:s, s:-1])  # (s, k)
    by_unknowns = reduced.corrections[:, s:-1] - reduced.corrections[:, :s] @ by_sensors  # (z, k)
    cross = by_unknowns.T @ mixed
    change = cross + cross.T - mixed.T @ reduced.solve(mixed)  # (k, k) of the information
    ratios, Q = np.linalg.eigh(np.eye(k) + spread.T @ change @ spread)
    spread = spread @ Q
    # of those directions none has more than the deviation 1 of the prior
    spread = spread / np.sqrt(np.maximum(ratios, np.sum(spread**2, axis=0)))
    return Estimate(
        values=values,
        spread=spread,
        noise=np.sqrt(np.sum(residual**2 * rows.valid, axis=0) / np.maximum(rows.valid.sum(axis=0), 1)),
        offset=sensor_errors[s - n_a :] if errors.get("offset") else np.zeros(n_a),
        order=max(map(len, noise_filters)) - 1,
        equations=count,
    )


class _Reduced(NamedTuple):
    """Equations without errors z: |rows x| is the misfit of columns x, least over z."""

    rows: Array  # (N + T k, c)
    corrections: Array  # (m k, c) the z of the least, for each column
    draw: Array  # (m k,) another z minus that of the least, drawn from its distribution
    solve: Any  # multiplies columns (m k, c) by the covariance of z


class _MotionErrors(NamedTuple):
    """Errors z (m k,) of splines, coefficient by coefficient, each of all k signals."""

    angles: Any  # (samples k, m k) sparse, signals over their noise by z
    accelerations: Any  # (T k, m k) sparse, by z

    @staticmethod
    def of(rows: TorqueRows) -> _MotionErrors:
        """Take the errors of the signals of `rows`."""
        from scipy.sparse import diags_array, eye_array, kron

        values, accelerations, noise = rows.errors
        return _MotionErrors(
            kron(values, eye_array(len(noise)), format="csr"),
            kron(accelerations, diags_array(noise), format="csr"),
        )

    def change(self, response: Array, z: Array) -> Array:
        """Compute the change (T, n_a, c) of equations with a response (T, n_a, k, c) to accelerations."""
        accelerations = (self.accelerations @ z).reshape(len(response), -1)  # (T, k)
        return np.einsum("tjkc,tk->tjc", response, accelerations)

    def torques(self, slopes: Array) -> Any:
        """Return derivatives (T n_a, m k) of the torques, by those of the accelerations (T, n_a, k)."""
        T, _, k = slopes.shape
        return banded_rows(slopes, np.arange(T * k).reshape(T, k), T * k) @ self.accelerations

    def mixed_derivatives(self, response: Array, torque: Array) -> Array:
        """Compute second derivatives (m k, u) of torque . equations by z and u unknowns."""
        slopes = np.einsum("ta,tasu->tsu", torque, response)  # (T, k, u) by accelerations
        return np.asarray(self.accelerations.T @ slopes.reshape(-1, response.shape[-1]))

    def eliminate(self, torques: Any, columns: Array) -> _Reduced:
        """Eliminate z from the equations columns x = torques z and 0 = angles z with unit white noise.

        With the information M = torques' torques + angles' angles, the least is at
        z = M^-1 torques' columns x, and M^-1 (torques' e + angles' e') has the covariance M^-1 if the noise
        e, e' is white.
        """
        from scipy.sparse.linalg import splu

        random = np.random.default_rng(0)
        e, e_angles = (random.standard_normal(matrix.shape[0]) for matrix in (torques, self.angles))
        factor = splu((torques.T @ torques + self.angles.T @ self.angles).tocsc())
        z = factor.solve(torques.T @ columns)  # (m k, c)
        draw = factor.solve(torques.T @ e + self.angles.T @ e_angles)
        return _Reduced(np.concatenate([columns - torques @ z, self.angles @ z]), z, draw, factor.solve)


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


def _whitening(valid: BoolArray, noise_filters: Sequence[Array], unmix: Array) -> Any:
    """Return the sparse matrix (N, T n_a) that filters motors in time and among one another.

    Its rows are those of instants whose whole past is valid (T, n_a).
    """
    from scipy.sparse import diags_array, eye_array, kron

    T, n_a = valid.shape
    lags = max(map(len, noise_filters))
    usable = valid.copy()  # (T, n_a)
    for lag in range(1, lags):
        usable[lag:] &= valid[:-lag]
        usable[:lag] = False
    taps_by_lag = np.array([np.pad(taps, (0, lags - len(taps))) for taps in noise_filters]).T  # (lags, n_a)
    filters = sum(kron(eye_array(T, k=-lag), diags_array(taps)) for lag, taps in enumerate(taps_by_lag))
    together = usable.all(axis=1).astype(float)  # (T,)
    mix = kron(diags_array(together), unmix) + kron(diags_array(1.0 - together), eye_array(n_a))
    return (mix @ filters).tocsr()[np.flatnonzero(usable)]


def _unmixing(noise: Array, valid: BoolArray, noise_filters: Sequence[Array]) -> Array:
    """Compute the inverse Cholesky factor (n_a, n_a) of the correlation of filtered noise (T, n_a)."""
    together = valid & valid.all(axis=1, keepdims=True)
    n_a = len(noise_filters)
    white = (_whitening(together, noise_filters, np.eye(n_a)) @ noise.ravel()).reshape(-1, n_a).T  # (n_a, N)
    if white.shape[1] < MIN_CORRELATED * n_a:
        return np.eye(n_a)
    lengths = np.linalg.norm(white, axis=1, keepdims=True)
    white /= np.maximum(lengths, np.finfo(float).tiny)
    return np.linalg.inv(np.linalg.cholesky(white @ white.T + RANK_ROUNDING * np.eye(n_a)))


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
