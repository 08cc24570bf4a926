"""Least squares of the torque equations, with the covariance of all noise.

The noise of a motor is an autoregressive process, n(t) = sum of phi_k n(t - k) + e(t) with white e. Quantised
currents, ripple, filters of the drive and what the model leaves out make it coloured. The residuals of a fit
give phi and the variance of e; equations filtered by 1 - sum of phi_k z^-k have white noise, and are solved
again (feasible generalised least squares; Cochrane and Orcutt 1949). The order has the least Bayesian
information criterion (Schwarz 1978). The inverse Cholesky factor of the correlation of the white noise
between motors makes their equations independent. Filters weigh down where the noise is; what is left there
may then grow, and be taken for more noise. So a filter is renewed only by residuals that are not larger.

Errors of the motion are unknowns too. The coefficients of its splines have errors z, with the information
that the angles give. They reach all torques of several knots, by the torques' derivatives with respect to
accelerations (those of rates and positions are smaller, by the time between knots). The equations are
evaluated at the corrected motion, and z is eliminated (Gauss-Newton steps of a nonlinear model with errors in
variables; Fuller, "Measurement Error Models", 1987, section 3.2). The mean of z would take noise of the
motors too, so that their noise is what z leaves that is drawn from its distribution.

The corrected motion shows some noise as motion. So the score, the derivative of the misfit by the unknowns,
has the covariance K of its Gauss-Newton information, but falls by less for a step of the unknowns: by
H = K - D'C D in the mean, where D are the second derivatives by z and unknowns, and C is the covariance of z.
(Others have the mean zero: the corrected motion is uncorrelated with what it leaves.) For one unknown b,
torques b a + e, accelerations a + u, and v = e - b u, these are (Fuller, section 1.3)

    K = sum of (a^2 + var(e) var(u) / var(v)) / var(v),    H = sum of a^2 / var(v).

A score H (truth - b) + noise of the covariance K has the information H K^-1 H (Godambe 1960), by which it is
weighed against the prior. With K = R'R and 1 - B = R'^-1 H R^-1 this is the information of equations whose
root is (1 - B) R in place of R. Where H would be negative the data show nothing, and it is 0.

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
    from scipy.sparse.linalg import splu  # slow to import

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
    by_samples, by_acceleration = rows.errors  # (N, z), (T signals, z)
    signals = rows.response.shape[3]
    groups = np.arange(T * signals).reshape(T, signals)
    augmented = np.column_stack([start, design])  # (r, 1 + k)
    factors = np.eye(1 + k)[0]  # beta = augmented @ factors: 1, then the unknowns
    matrix = rows.matrix @ augmented  # (T, n_a, 1 + k)
    response = rows.response.swapaxes(2, 3) @ augmented  # (T, n_a, signals, 1 + k)
    predicted = rows.torque
    # at first noise as large as the torques, so that errors of sensors and motion explain nothing
    noise_filters = [np.ones(1) / size for size in np.sqrt(np.mean(rows.torque**2, axis=0))]
    unmix = np.eye(n_a)
    size = np.zeros(n_a)  # of the noise
    least_size = np.full(n_a, np.inf)
    for k_pass in range(max_passes):
        slopes = banded_rows(response @ factors, groups, T * signals) @ by_acceleration  # (T n_a, z)
        misfit = rows.torque - rows.constant - matrix @ factors
        if k_pass == 1:
            noise_filters = [np.ones(1) / size for size in _noise_beside_errors(rows, slopes, misfit)]
            unmix = np.eye(n_a)
        whitening = np.sqrt(rows.independent) * _whitening(rows.valid, noise_filters, unmix)
        W = whitening @ slopes  # (equations, z)
        information = splu((W.T @ W + by_samples.T @ by_samples).tocsc())  # of z

        # at these unknowns the least z, and errors of sensors, whose mean is 0
        sensors, deviations = _sensor_columns(rows, predicted, errors)
        s = len(deviations)
        constant = np.concatenate([sensors, misfit[..., None]], axis=2).reshape(T * n_a, -1)
        reduced, by_column = _eliminate(information, W, by_samples, whitening @ constant)
        prior = np.hstack([np.diag(1.0 / deviations), np.zeros((s, 1))])
        triangle = np.asarray(np.linalg.qr(np.concatenate([prior, reduced]), mode="r"))  # (s + 1, s + 1)
        least = np.append(-np.linalg.solve(triangle[:s, :s], triangle[:s, s]), 1.0)
        accelerations = (by_acceleration @ (by_column @ least)).reshape(T, signals)
        corrected = matrix + np.einsum("tjkc,tk->tjc", response, accelerations)  # (T, n_a, 1 + k)

        # the triangle R of sensors' errors, unknowns at the corrected motion, and the right side
        columns = whitening @ corrected[..., 1:].reshape(T * n_a, k)
        reduced_unknowns, by_unknown = _eliminate(information, W, by_samples, columns)
        wide = np.insert(np.concatenate([prior, reduced]), [s] * k, 0.0, axis=1)
        wide[s:, s : s + k] = reduced_unknowns  # (s + equations + N, s + k + 1)
        R = np.asarray(np.linalg.qr(wide, mode="r"))
        R_s = R[:s, :s]
        U, sizes, V_rows = np.linalg.svd(R[s:-1, s:-1])  # (k, k) of the unknowns' K

        # D by what is left, and the root of the information H K^-1 H
        by_torque = (whitening.T @ (reduced[: W.shape[0]] @ least)).reshape(T, n_a)
        by_signal = np.einsum("ta,tasu->tsu", by_torque, response[..., 1:])  # (T, signals, k)
        D = by_acceleration.T @ by_signal.reshape(T * signals, k)  # (z, k)
        by_sensors = np.linalg.solve(R_s.T, by_column[:, :s].T @ D)  # (s, k): z takes their errors too
        lost = D.T @ information.solve(D) + by_sensors.T @ by_sensors  # (k, k)
        lost *= k_pass > 0  # what the file leaves is no noise
        scaled = (
            V_rows / np.maximum(sizes, RANK_ROUNDING * sizes.max(initial=0.0) + np.finfo(float).tiny)[:, None]
        )
        slopes_left, Q = np.linalg.eigh(np.eye(k) - scaled @ lost @ scaled.T)  # of 1 - B
        root = (Q * np.maximum(slopes_left, 0.0)) @ Q.T @ (sizes[:, None] * V_rows)

        # without the prior about the unknowns, data that show little would lead them far off
        spread = posterior_root(root)
        solution = spread @ (spread.T @ (root.T @ (U.T @ R[s:-1, -1] + root @ factors[1:])))
        step = solution - factors[1:]  # (k,)
        sensor_errors = np.linalg.solve(R_s, R[:s, -1] - R[:s, s:-1] @ step)  # (s,)

        # the noise is what this solution leaves, at a z that is drawn: white noise in place of the torques
        # and samples draws z minus its mean
        factors[1:] += step
        predicted = rows.constant + matrix @ factors
        z = by_column @ np.append(-sensor_errors, 1.0) - by_unknown @ step
        residual = misfit - sensors @ sensor_errors - corrected[..., 1:] @ step  # (T, n_a)
        random = np.random.default_rng(0)
        noises = [part.T @ random.standard_normal(part.shape[0]) for part in (W, by_samples)]
        draw = information.solve(noises[0] + noises[1])
        noise = residual - (slopes @ (z + draw)).reshape(T, n_a)
        size_before, size = size, np.sqrt(np.sum(noise**2 * rows.valid, axis=0))
        is_smaller = size <= (1.0 + same_noise) * least_size  # (n_a,)
        least_size = np.minimum(size, least_size)
        # what a filter takes for noise, the next solution may leave: noise that grows is the model's error
        for motor in np.flatnonzero(is_smaller):
            noise_filters[motor] = _noise_filter(noise[:, motor], rows.valid[:, motor])
        if rows.independent == 1.0 and is_smaller.all():  # else motors repeat one another
            unmix = _unmixing(noise, rows.valid, noise_filters)
        is_same = np.abs(size - size_before) <= same_noise * size_before
        if is_same.all() and np.linalg.norm(np.linalg.solve(spread, step)) < converged:
            break

    return Estimate(
        values=factors[1:],
        spread=spread,
        noise=np.sqrt(np.sum(residual**2 * rows.valid, axis=0) / np.maximum(rows.valid.sum(axis=0), 1)),
        offset=sensor_errors[s - n_a :] if errors.get("offset") else np.zeros(n_a),
        order=max(map(len, noise_filters)) - 1,
        equations=count,
    )


def _eliminate(information: Any, W: Any, by_samples: Any, white: Array) -> tuple[Array, Array]:
    """Eliminate z from columns (equations, c): return what is left (equations + N, c), and z (z, c).

    Of |white x - W z|^2 + |by_samples z|^2 the least is at z = information^-1 W' white x.
    """
    by_column = information.solve(W.T @ white)
    return np.concatenate([white - W @ by_column, by_samples @ by_column]), by_column


def _noise_beside_errors(rows: TorqueRows, slopes: Any, misfit: Array) -> Array:
    """Compute sizes (n_a,) of the noise in a misfit (T, n_a) that no errors z of the motion explain.

    They are those of least squares for z, by the torques' `slopes` (T n_a, z), with noise of a small share of
    the torques. Random signs n (N,) of the equations show how many z leaves, n'(n - W C W'n) in the mean.
    """
    share = 1e-3  # less than any sensor's
    from scipy.sparse import diags_array  # slow to import
    from scipy.sparse.linalg import splu

    n_a = misfit.shape[1]
    used = np.flatnonzero(rows.valid)  # (N,)
    motor = used % n_a
    unit = share * np.sqrt(np.mean(rows.torque**2, axis=0)) + np.finfo(float).tiny  # (n_a,)
    W = diags_array(1.0 / unit[motor]) @ slopes.tocsr()[used]
    by_samples = rows.errors.samples
    information = splu((W.T @ W + by_samples.T @ by_samples).tocsc())
    signs = np.random.default_rng(0).choice([-1.0, 1.0], len(used))
    white = np.column_stack([misfit.ravel()[used] / unit[motor], signs])  # (N, 2)
    left, of_signs = _eliminate(information, W, by_samples, white)[0][: len(used)].T
    count = np.maximum(np.bincount(motor, signs * of_signs, n_a), 1.0)
    return np.asarray(unit * np.sqrt(np.bincount(motor, left**2, n_a) / count) + np.finfo(float).tiny)


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
