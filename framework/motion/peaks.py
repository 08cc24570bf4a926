"""The largest sizes that functions of time reach, between the samples too."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from framework.arrays import Array
from framework.motion.chebyshev import nodes

NODE_RATIO = 4  # samples over the coefficients of the functions, on each panel
CANDIDATE_RATIO = 0.99  # of the largest sample, from which on a local maximum of samples is looked at
ZOOMS = 3  # of parabolas through three points about a maximum, each on a shorter interval
ZOOM_RATIO = 1.0 / 16.0  # of the interval to the one before


def peak_sizes(function: Callable[[Array], Array], edges: Array, size: int) -> Array:
    """Compute the largest |value| of each component (k,), to rounding where the function is smooth.

    Args:
        function: values (T, k) at t (T,).
        edges: (panels + 1,) [s] between which it is a series of `size` coefficients.
    """
    half = 0.5 * np.diff(edges)[:, None]
    t = np.clip((edges[:-1, None] + half * (nodes(NODE_RATIO * size) + 1.0)).ravel(), edges[0], edges[-1])
    values = np.abs(function(t))
    largest = values.max(axis=0)
    padded = np.pad(values, ((1, 1), (0, 0)), constant_values=-np.inf)
    highest = (values >= padded[:-2]) & (values >= padded[2:]) & (values >= CANDIDATE_RATIO * largest)
    rows, component = np.nonzero(highest)
    middle = t[rows]
    step = np.maximum(np.diff(t, prepend=edges[0])[rows], np.diff(t, append=edges[-1])[rows])

    def update_largest(instants: Array) -> Array:
        """Return the sizes of the components at instants (..., m), the largest of each taken up."""
        values = np.abs(function(instants.ravel())).reshape(*instants.shape, -1)
        sizes = values[..., np.arange(len(component)), component]
        np.maximum.at(largest, component, sizes.reshape(-1, len(component)).max(axis=0))
        return sizes

    for _ in range(ZOOMS):
        points = np.clip(middle + step * np.array([[-1.0], [0.0], [1.0]]), edges[0], edges[-1])
        shift = _vertex(*update_largest(points))
        middle = np.clip(points[1] + step * shift, edges[0], edges[-1])
        step = step * ZOOM_RATIO
    update_largest(middle)
    return largest


def _vertex(left: Array, centre: Array, right: Array) -> Array:
    """Return the vertex, in [-1, 1], of parabolas through values (m,) at -1, 0 and 1; 0 without a maximum."""
    bend = 2.0 * centre - left - right
    vertex = np.divide(0.5 * (right - left), bend, out=np.zeros_like(bend), where=bend > 0.0)
    return np.clip(vertex, -1.0, 1.0)
