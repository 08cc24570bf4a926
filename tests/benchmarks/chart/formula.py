"""The 5R's torques by its own formula in floats, the whole table at once: written for this robot alone.

Vectors of the plane are complex numbers; rods are rigid, links have no mass. The equations are those of
`closed_form`, which has them in fifty digits. A method of the chart, and the cheapest a solve can be.
"""

import numpy as np

from framework.numerics import Array
from tests.benchmarks.chart import closed_form

_BASES = tuple(map(float, closed_form.BASES))
_LENGTH, _PAYLOAD = float(closed_form.LENGTH), float(closed_form.PAYLOAD)
_GEAR, _ROTOR = float(closed_form.GEAR_RATIO), float(closed_form.ROTOR_INERTIA)
_START, _END = (complex(*map(float, point)) for point in (closed_form.START, closed_form.END))


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (np.conj(a) * b).imag


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (np.conj(a) * b).real


def torques(s: Array, ds: Array, dds: Array) -> Array:
    """Motor torques (T, 2) [N m] on scene C at s and its rates (T,)."""
    way = _END - _START
    x, dx, ddx = _START + s * way, ds * way, dds * way
    legs, spun = [], []
    for base, elbow in zip(_BASES, closed_form.ELBOWS, strict=True):
        reach = x - base
        b = (0.5 + 1j * elbow * np.sqrt(_LENGTH**2 / _dot(reach, reach) - 0.25)) * reach
        p = reach - b
        aside = _dot(p, 1j * b)
        rate = _dot(p, dx) / aside
        dp = dx - rate * 1j * b
        spun.append((_dot(p, ddx + rate**2 * b) + _dot(dp, dp)) / aside)
        legs.append((b, p))
    (b_1, p_1), (b_2, p_2) = legs
    force, below = -_PAYLOAD * ddx, _cross(p_1, p_2)
    joint = [-_cross(force, p_2) / below * _cross(b_1, p_1), -_cross(p_1, force) / below * _cross(b_2, p_2)]
    return np.column_stack([_ROTOR * _GEAR * a + g / _GEAR for a, g in zip(spun, joint, strict=True)])
