"""The largest absolute values of functions of time, also between samples."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from framework.numerics.arrays import Array
from framework.numerics.chebyshev import nodes

NODE_RATIO = 4  # samples over the coefficients of the functions, on each panel
CANDIDATE_RATIO = 0.99  # of the largest sample, from which on a local maximum of samples is looked at
ZOOMS = 3  # of parabolas through three points about a maximum, each on a shorter interval
ZOOM_RATIO = 1.0 / 16.0  # of the interval to the one before


def peak_sizes(function: Callable[[Array], Array], edges: Array, size: int) -> Array:
    """Compute the largest |value| of each component (k,), to rounding where the function is smooth.

    The largest local maxima among samples are refined: each is moved to the vertex of the parabola through
    three points about it, `ZOOMS` times with a shorter step.

    Args:
        function: values (T, k) at t (T,).
        edges: (panels + 1,) [s] between which it is a series of `size` coefficients.
    """
    half_widths = 0.5 * np.diff(edges)[:, None]
    t = (edges[:-1, None] + half_widths * (nodes(NODE_RATIO * size) + 1.0)).ravel()
    t = np.clip(t, edges[0], edges[-1])  # (T,)
    values = np.abs(function(t))  # (T, k)
    peaks = values.max(axis=0)
    padded = np.pad(values, ((1, 1), (0, 0)), constant_values=-np.inf)
    is_local_maximum = (values >= padded[:-2]) & (values >= padded[2:])
    # m local maxima: the sample and the component of each
    sample, component = np.nonzero(is_local_maximum & (values >= CANDIDATE_RATIO * peaks))
    middle = t[sample]
    step = np.maximum(np.diff(t, prepend=edges[0])[sample], np.diff(t, append=edges[-1])[sample])

    def sizes_at(instants: Array) -> Array:
        """Return |value| (..., m) of each maximum's component at instants (..., m) [s]."""
        sizes = np.abs(function(instants.ravel())).reshape(*instants.shape, -1)
        return sizes[..., np.arange(len(component)), component]

    for _ in range(ZOOMS):
        points = np.clip(middle + step * np.array([[-1.0], [0.0], [1.0]]), edges[0], edges[-1])
        sizes = sizes_at(points)  # (3, m)
        np.maximum.at(peaks, component, sizes.max(axis=0))
        middle = np.clip(points[1] + step * _parabola_maximum(*sizes), edges[0], edges[-1])
        step = step * ZOOM_RATIO
    np.maximum.at(peaks, component, sizes_at(middle))
    return peaks


def _parabola_maximum(left: Array, centre: Array, right: Array) -> Array:
    """Return the maximum in [-1, 1] of parabolas through values (m,) at -1, 0 and 1; 0 without one."""
    curvature = 2.0 * centre - left - right  # minus the second derivative: positive at a maximum
    vertex = np.divide(0.5 * (right - left), curvature, out=np.zeros_like(curvature), where=curvature > 0.0)
    return np.clip(vertex, -1.0, 1.0)
