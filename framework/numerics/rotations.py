"""Rotations as vectors: exponential, logarithm and left Jacobian of SO(3), stacked."""

from __future__ import annotations

from math import factorial, perm

import numpy as np

from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import dot

# Coefficients of sum (-1)^j square^j / (2 j + first)!, differentiated 0 times and once; first is 2 for a, 3
# for b of the left Jacobian. The last one is below 1e-17.
_SERIES = np.array(
    [
        [
            [(-1.0) ** j * perm(j, order) / factorial(2 * j + first) for j in range(order, order + 12)]
            for order in range(2)
        ]
        for first in (2, 3)
    ]
)


def whole_turns(angles: Array) -> Array:
    """Return the whole turns [rad] nearest to angles."""
    return 2.0 * np.pi * np.round(angles / (2.0 * np.pi))


def wrap_angles(angles: Array) -> Array:
    """Return angles less whole turns, in [-pi, pi)."""
    return np.mod(angles + np.pi, 2 * np.pi) - np.pi


def rotation_matrix(vector: Array) -> Array:
    """Compute rotation matrices (T, 3, 3) of rotation vectors (T, 3) [rad]."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vector).as_matrix()


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


def left_jacobian_coefficients(square: Array) -> Array:
    """Compute the left Jacobian's coefficients a, b with a derivative along t^2, (2, 2, T).

    a = (1 - cos t) / t^2 and b = (t - sin t) / t^3; `square` (T,) is t^2. Below one radian the closed forms
    lose digits to cancellation, and the series of a and b are taken.
    """
    small = square < 1.0
    if small.all():
        return _left_jacobian_series(square)
    t = np.sqrt(np.where(small, 1.0, square))
    series = _left_jacobian_series(np.where(small, square, 0.0))
    sine, cosine = np.sin(t), np.cos(t)
    lost_a, lost_b = 1 - cosine, t - sine
    closed = [
        [lost_a / t**2, (t * sine - 2 * lost_a) / (2 * t**4)],
        [lost_b / t**3, (t * lost_a - 3 * lost_b) / (2 * t**5)],
    ]
    return np.where(small, series, closed)


def _left_jacobian_series(square: Array) -> Array:
    """Compute `left_jacobian_coefficients` (2, 2, T) by series."""
    series = np.zeros((*_SERIES.shape[:2], len(square)))
    for k in range(_SERIES.shape[2] - 1, -1, -1):  # a matrix product would round by the length of the stack
        series = series * square + _SERIES[:, :, k, None]
    return series
