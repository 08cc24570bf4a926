"""A squared speed that takes exactly so long: the integral of z^(-1/2) and how it is met.

z is a Chebyshev series in xi(sigma), see `optimal_law`. Its integral is taken on the panels that resolve
z^(-1/2), however near to zero z comes.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import chebyshev, legendre

from framework.arrays import Array
from framework.motion.chebyshev import COEFFICIENT_ROUNDING, nodes
from framework.motion.cone_program import Affine
from framework.motion.optimal_law import PANEL_NODES, Stretch, slowness_on_panels

MAX_ADJUSTMENT_STEPS = 12  # of the adjustment, from a duration that is nearly right
MAX_BLEND_STEPS = 60  # of Newton's method from the slow side, which converges from there however far it is
BLEND_DURATION_ERROR = 1e-9  # of the duration, what a blend may miss: the adjustment does the rest
FREE_DEGREE = 8.0  # up to which a coefficient is free to change in proportion
DEGREE_WEIGHT_POWER = 4.0  # power of the degree with which a coefficient resists being adjusted


def duration_of(series: Array, stretch: Stretch) -> float:
    """Compute the integral of z^(-1/2) over [0, 1] [s] for coefficients (size,) of a positive z."""
    values, weights = _quadrature(series, stretch)
    return float(weights @ (values @ series) ** -0.5)


def blended(quick: Array, slow: Array, duration: float, stretch: Stretch) -> Array:
    """Compute the series between two positive ones (size,) that takes `duration` [s], more than the quick
    and less than the slow one does.

    Duration is convex along the blend, so Newton's method from the slow end never leaves the interval.
    """
    series, toward = slow, quick - slow
    share = 0.0  # of the quick one
    for _ in range(MAX_BLEND_STEPS):
        values, weights = _quadrature(series, stretch)
        z = values @ series
        missing = float(weights @ z**-0.5) - duration
        if missing <= BLEND_DURATION_ERROR * duration:
            break
        share += missing / float(0.5 * weights @ (z**-1.5 * (values @ toward)))
        series = slow + share * toward
    return np.asarray(series)


def adjusted(
    series: Array, equalities: Affine, duration: float, stretch: Stretch, *, relative: bool = False
) -> Array:
    """Compute the series nearest to `series` (size,), low degrees first, that meets the equalities and takes
    exactly `duration` [s].

    Args:
        relative: near in z over the z of `series`, so that it changes little where it is nearly zero.

    Raises:
        InvalidInput: Newton's method on the duration finds no positive z.
    """
    ease = _relative_ease(series) if relative else _ease(len(series))
    for _ in range(MAX_ADJUSTMENT_STEPS):
        values, weights = _quadrature(series, stretch)
        z = values @ series
        gradient = -0.5 * (weights * z**-1.5) @ values
        rows = np.concatenate([equalities.matrix, gradient[None]])
        size = np.linalg.norm(rows, axis=1)
        size[size == 0] = 1.0  # a condition that holds anyway
        miss = np.append(equalities(series), weights @ z**-0.5 - duration) / size
        rows = rows / size[:, None]
        step = ease @ (rows.T @ np.linalg.lstsq(rows @ ease @ rows.T, miss, rcond=None)[0])
        series = series - step
        if np.abs(step).max() <= COEFFICIENT_ROUNDING * np.abs(series).max():
            break
    return series


def _ease(size: int) -> Array:
    """How easily coefficients change (size, size): the lower their degree, the more."""
    return np.diag((1.0 + np.arange(size)) ** -DEGREE_WEIGHT_POWER)


def _relative_ease(series: Array) -> Array:
    """The same where z should change in proportion to itself: inverse of its mean square, and of degrees."""
    size = len(series)
    values = chebyshev.chebvander(nodes(4 * size), size - 1)
    z = values @ series
    share = values.T * (z.mean() / z) ** 2 @ values / len(z)
    return np.asarray(np.linalg.inv(share + np.diag((np.arange(size) / FREE_DEGREE) ** DEGREE_WEIGHT_POWER)))


def _quadrature(series: Array, stretch: Stretch) -> tuple[Array, Array]:
    """Return Chebyshev polynomials (P, size) and weights (P,) in sigma that integrate z^(-1/2)."""
    edges = slowness_on_panels(series, stretch).edges
    points, weights = legendre.leggauss(PANEL_NODES)
    half = 0.5 * np.diff(edges)[:, None]
    sigma = (edges[:-1, None] + half * (points + 1.0)).ravel()
    values = np.asarray(chebyshev.chebvander(stretch(sigma), len(series) - 1), dtype=float)
    return values, (half * weights).ravel()
