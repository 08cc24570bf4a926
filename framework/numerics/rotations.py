"""Rotations as vectors: exponential, logarithm and left Jacobian of SO(3), stacked."""

from __future__ import annotations

from math import factorial, perm

import numpy as np
from numpy.polynomial import polynomial

from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import dot


def _series(offset: int, order: int) -> list[float]:
    """Return 12 coefficients of the derivative of this order of sum_j (-y)^j / (2 j + offset)!.

    Entry i is the coefficient of y^i. It comes from the term j = i + order: lower terms vanish.
    """
    return [(-1.0) ** j * perm(j, order) / factorial(2 * j + offset) for j in range(order, order + 12)]


# power series in y = t^2 of the coefficients a and b of the left Jacobian and of their derivatives. The axes
# (12, 2, 2) are power, a or b, order of the derivative; the last coefficients are below 1e-17
_SERIES = np.array([[_series(2, 0), _series(2, 1)], [_series(3, 0), _series(3, 1)]]).transpose(2, 0, 1)
_CROSS = [2, 0, 1], [1, 2, 0]  # where the matrix of the cross product with v has v itself


def whole_turns(angles: Array) -> Array:
    """Return the multiples of a full turn [rad] that are nearest to angles."""
    return 2.0 * np.pi * np.round(angles / (2.0 * np.pi))


def wrap_angles(angles: Array) -> Array:
    """Return angles in [-pi, pi), reduced by full turns."""
    return np.mod(angles + np.pi, 2 * np.pi) - np.pi


def rotation_matrix(vector: Array) -> Array:
    """Compute rotation matrices (T, 3, 3) of rotation vectors v (T, 3) [rad].

    With t = |v| they are 1 + sin(t) / t [v]x + (1 - cos t) / t^2 [v]x [v]x.
    """
    half = 0.5 * np.sqrt(dot(vector, vector))[:, None, None]  # t / 2
    ratio = np.sinc(half / np.pi)  # sin(t / 2) over t / 2
    crossed = np.zeros((len(vector), 3, 3))  # [v]x
    crossed[:, *_CROSS] = vector
    crossed = crossed - crossed.swapaxes(1, 2)
    return np.eye(3) + ratio * np.cos(half) * crossed + 0.5 * ratio**2 * (crossed @ crossed)


def rotation_vector(rotation: Array) -> Array:
    """Compute rotation vectors (T, 3) of rotations R (T, 3, 3); NaN where R is not finite.

    R - R' is the matrix of the cross product with 2 sin(t) axis, and the trace is 1 + 2 cos(t). From 120
    degrees on, where the trace is not positive, R - R' loses digits, and scipy's conversion is used.
    """
    trace = np.trace(rotation, axis1=1, axis2=2)
    # 2 sin(t) axis: the entries (3, 2), (1, 3) and (2, 1) of R - R'
    doubled = (rotation - rotation.swapaxes(1, 2))[:, *_CROSS]
    angle = np.arctan2(0.5 * np.sqrt(dot(doubled, doubled)), 0.5 * (trace - 1.0))
    vectors = 0.5 * doubled / np.sinc(angle / np.pi)[:, None]  # sin(t) axis over sin(t) / t
    wide = np.flatnonzero((trace <= 0.0) & np.isfinite(angle))
    if len(wide):
        from scipy.spatial.transform import Rotation

        vectors[wide] = Rotation.from_matrix(rotation[wide]).as_rotvec()
    return vectors


def left_jacobian_coefficients(square: Array) -> Array:
    """Compute coefficients a, b of the left Jacobian and their derivatives in t^2, (2, 2, T).

    The left Jacobian of SO(3) for a rotation vector v of length t is 1 + a [v]x + b [v]x [v]x with
    a = (1 - cos t) / t^2 and b = (t - sin t) / t^3. Below one radian cancellation spoils these closed forms,
    and power series are used.

    Args:
        square: t^2 (T,) [rad^2].

    Returns:
        The first axis selects a or b, the second the value or the derivative with respect to t^2.
    """
    is_small = square < 1.0
    # the power series in t^2, by Horner's rule: a matrix product would round differently in other stacks
    series: Array = polynomial.polyval(np.where(is_small, square, 0.0), _SERIES)
    if is_small.all():
        return series
    t = np.sqrt(np.where(is_small, 1.0, square))  # 1 stands for small angles, whose results are not used
    sine = np.sin(t)
    versine = 1 - np.cos(t)
    excess = t - sine
    a, a_slope = versine / t**2, (t * sine - 2 * versine) / (2 * t**4)
    b, b_slope = excess / t**3, (t * versine - 3 * excess) / (2 * t**5)
    return np.where(is_small, series, [[a, a_slope], [b, b_slope]])
