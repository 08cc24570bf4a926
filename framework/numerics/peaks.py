"""The largest absolute values of functions of time, between samples included."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from framework.numerics.arrays import Array
from framework.numerics.chebyshev import TimeGrid

NODE_RATIO = 4  # number of samples over number of Chebyshev coefficients, on each panel
# distances between the three points of the parabolas about a maximum, over the distance between samples
ZOOM_STEPS = (1.0, 1.0 / 16.0, 1.0 / 256.0)


def peak_sizes(function: Callable[[Array], Array], edges: Array, size: int) -> Array:
    """Compute the largest |value| (k,) of each component of a function of time.

    The result is exact to rounding if the function is smooth. The function is sampled, and its local maxima
    are refined: each maximum moves to the vertex of the parabola through three points about it, again and
    again, with points that are closer together each time (ZOOM_STEPS).

    Args:
        function: returns values (T, k) at t (T,) [s].
        edges: ends of the panels (panels + 1,) [s].
        size: number of coefficients of the function's series on each panel.
    """
    start, end = edges[0], edges[-1]
    t = TimeGrid(edges, NODE_RATIO * size).times  # (T,)
    values = np.abs(function(t))  # (T, k)
    peaks = values.max(axis=0)

    padded = np.pad(values, ((1, 1), (0, 0)), constant_values=-np.inf)
    is_local_maximum = (values >= padded[:-2]) & (values >= padded[2:])
    sample, component = np.nonzero(is_local_maximum)  # (m,) of each of the m local maxima
    middle = t[sample]
    # distance between samples: the longer one of those to both neighbours
    spacing = np.maximum(np.diff(t, prepend=start), np.diff(t, append=end))[sample]

    def sizes_at(instants: Array) -> Array:
        """Return |value| (..., m) of each maximum's component at instants (..., m) [s]."""
        sizes = np.abs(function(instants.ravel())).reshape(*instants.shape, -1)
        return sizes[..., np.arange(len(component)), component]

    for zoom_step in ZOOM_STEPS:
        step = zoom_step * spacing
        points = np.clip([middle - step, middle, middle + step], start, end)  # (3, m)
        sizes = sizes_at(points)
        np.maximum.at(peaks, component, sizes.max(axis=0))
        middle = np.clip(middle + step * _parabola_vertex(*sizes), start, end)
    np.maximum.at(peaks, component, sizes_at(middle))
    return peaks


def _parabola_vertex(left: Array, centre: Array, right: Array) -> Array:
    """Return the abscissae (m,) of the maxima of parabolas through values (m,) at -1, 0 and 1.

    The values are `left` at -1, `centre` at 0 and `right` at 1. Abscissae are clipped to [-1, 1]; a parabola
    without a maximum gives 0.
    """
    curvature = 2.0 * centre - left - right  # minus the second derivative: positive at a maximum
    vertex = np.divide(0.5 * (right - left), curvature, out=np.zeros_like(curvature), where=curvature > 0.0)
    return np.clip(vertex, -1.0, 1.0)
