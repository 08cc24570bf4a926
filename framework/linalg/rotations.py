"""Rotations as vectors: exponential, logarithm and left Jacobian of SO(3), stacked."""

from __future__ import annotations

import numpy as np

from framework.arrays import Array
from framework.linalg.ordered_sums import dot


def rotation_matrix(vector: Array) -> Array:
    """Compute rotation matrices (T, 3, 3) of rotation vectors (T, 3) [rad]."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(vector).as_matrix())


def rotation_vector(rotation: Array) -> Array:
    """Compute rotation vectors (T, 3) of rotations (T, 3, 3), each by itself; NaN where one is not finite."""
    trace = rotation[:, 0, 0] + rotation[:, 1, 1] + rotation[:, 2, 2]
    # turned by less than 120 degrees: what is not symmetric says it all
    doubled = (rotation - rotation.swapaxes(1, 2))[:, [2, 0, 1], [1, 2, 0]]  # 2 sin(t) times the axis
    angle = np.arctan2(0.5 * np.sqrt(dot(doubled, doubled)), 0.5 * (trace - 1.0))
    vectors = np.asarray(0.5 * doubled / np.sinc(angle / np.pi)[:, None])
    wide = np.flatnonzero((trace <= 0.0) & np.isfinite(angle))
    if len(wide):
        from scipy.spatial.transform import Rotation

        vectors[wide] = Rotation.from_matrix(rotation[wide]).as_rotvec()
    return vectors


def left_jacobian_series(square: Array, half_rate: Array) -> tuple[Array, Array, Array, Array]:
    """Compute a = (1 - cos t) / t^2, b = (t - sin t) / t^3 and their time derivatives, each (T, 1).

    `square` is t^2, `half_rate` half its time derivative. Below one radian by their series, which the
    closed forms lose to cancellation.
    """
    small = square < 1.0
    t = np.sqrt(np.where(small, 1.0, square))
    a_series, b_series, da_series, db_series = (np.zeros_like(square) for _ in range(4))
    term_a, term_b = 0.5, 1.0 / 6.0
    for k in range(12):  # the last term is below 1e-17 for t < 1
        power = square**k
        a_series += term_a * power
        b_series += term_b * power
        term_a /= -(2 * k + 3) * (2 * k + 4)
        term_b /= -(2 * k + 4) * (2 * k + 5)
        da_series += term_a * (k + 1) * power  # derivative with respect to t^2
        db_series += term_b * (k + 1) * power
    a = np.where(small, a_series, (1 - np.cos(t)) / t**2)
    b = np.where(small, b_series, (t - np.sin(t)) / t**3)
    da = np.where(small, da_series, (t * np.sin(t) - 2 * (1 - np.cos(t))) / (2 * t**4))
    db = np.where(small, db_series, (t * (1 - np.cos(t)) - 3 * (t - np.sin(t))) / (2 * t**5))
    rate = (2 * half_rate)[:, None]
    return a[:, None], da[:, None] * rate, b[:, None], db[:, None] * rate
