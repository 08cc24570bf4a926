"""Rotations as vectors: exponential, logarithm and left Jacobian of SO(3), stacked."""

from __future__ import annotations

from math import factorial, perm

import numpy as np

from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import dot

# The left Jacobian's a = sum of (-1)^j square^j / (2 j + 2)! and b = sum of (-1)^j square^j / (2 j + 3)!,
# each with its derivative by `square`: coefficients (2, 2, 12) of a and b, by order of the derivative, by
# power. The last one is below 1e-17.
_SERIES = np.array(
    [
        [
            [(-1.0) ** j * perm(j, order) / factorial(2 * j + offset) for j in range(order, order + 12)]
            for order in range(2)
        ]
        for offset in (2, 3)
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
    """Compute rotation vectors (T, 3) of rotations R (T, 3, 3); NaN where one is not finite.

    R - R' is the matrix of the cross product with 2 sin(t) axis, and the trace is 1 + 2 cos(t). For turns of
    120 degrees and more the former loses digits, and scipy's conversion is taken.
    """
    trace = rotation[:, 0, 0] + rotation[:, 1, 1] + rotation[:, 2, 2]
    doubled = (rotation - rotation.swapaxes(1, 2))[:, [2, 0, 1], [1, 2, 0]]  # 2 sin(t) axis
    angle = np.arctan2(0.5 * np.sqrt(dot(doubled, doubled)), 0.5 * (trace - 1.0))
    vectors = 0.5 * doubled / np.sinc(angle / np.pi)[:, None]
    wide = np.flatnonzero((trace <= 0.0) & np.isfinite(angle))
    if len(wide):
        from scipy.spatial.transform import Rotation

        vectors[wide] = Rotation.from_matrix(rotation[wide]).as_rotvec()
    return vectors


def left_jacobian_coefficients(square: Array) -> Array:
    """Compute the left Jacobian's coefficients a, b with a derivative along t^2, (2, 2, T).

    a = (1 - cos t) / t^2 and b = (t - sin t) / t^3; `square` (T,) is t^2. The first axis is that of a and b,
    the second the order of the derivative. Below one radian the closed forms lose digits to cancellation, and
    the series of a and b are taken.
    """
    small = square < 1.0
    if small.all():
        return _left_jacobian_series(square)
    t = np.sqrt(np.where(small, 1.0, square))
    series = _left_jacobian_series(np.where(small, square, 0.0))
    sine = np.sin(t)
    cosine = np.cos(t)
    versine = 1 - cosine
    excess = t - sine
    closed = [
        [versine / t**2, (t * sine - 2 * versine) / (2 * t**4)],
        [excess / t**3, (t * versine - 3 * excess) / (2 * t**5)],
    ]
    return np.where(small, series, closed)


def _left_jacobian_series(square: Array) -> Array:
    """Compute `left_jacobian_coefficients` (2, 2, T) by series."""
    series = np.zeros((*_SERIES.shape[:2], len(square)))
    for k in range(_SERIES.shape[2] - 1, -1, -1):  # a matrix product would round by the length of the stack
        series = series * square + _SERIES[:, :, k, None]
    return series
