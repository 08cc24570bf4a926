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
    at, component = np.nonzero(highest)
    middle = t[at]
    step = np.maximum(np.diff(t, prepend=edges[0])[at], np.diff(t, append=edges[-1])[at])
    for _ in range(ZOOMS):
        points = np.clip(middle + step * np.array([[-1.0], [0.0], [1.0]]), edges[0], edges[-1])
        sizes = np.abs(function(points.ravel())).reshape(3, len(at), -1)[:, np.arange(len(at)), component]
        np.maximum.at(largest, component, sizes.max(axis=0))
        before, centre, after = sizes
        bend = 2.0 * centre - before - after
        shift = np.divide(0.5 * (after - before), bend, out=np.zeros_like(bend), where=bend > 0.0)
        middle = np.clip(points[1] + step * np.clip(shift, -1.0, 1.0), edges[0], edges[-1])
        step = step * ZOOM_RATIO
    np.maximum.at(largest, component, np.abs(function(middle))[np.arange(len(at)), component])
    return largest
