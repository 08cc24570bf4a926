"""B-splines by the recurrence of Cox and de Boor, on knots of any multiplicity.

Between the knots t_k and t_(k+1) only the splines k - degree to k are not zero. All functions here return the
values of these alone. `scipy.interpolate` has B-splines too, but importing it takes as long as finding a law.

Source: de Boor, A Practical Guide to Splines, Springer 2001, chapters IX and X.
"""

from __future__ import annotations

import numpy as np

from framework.numerics.arrays import Array, IntArray


def find_intervals(knots: Array, degree: int, x: Array) -> IntArray:
    """Return indices k (T,) with t_k <= x < t_(k+1) at x (T,), and the last interval at the end."""
    last = int(np.searchsorted(knots, knots[-1])) - 1  # the last interval that is not empty
    return np.clip(np.searchsorted(knots, x, side="right") - 1, degree, last)


def spline_values(knots: Array, degree: int, intervals: IntArray, x: Array, order: int = 0) -> Array:
    """Compute the B-splines that are not zero at x, or a derivative: (T, degree + 1).

    The recurrence raises the degree step by step: a spline of degree p is a sum of two splines of degree
    p - 1, with shares that are linear in x. For a derivative, the last `order` steps use the slopes of these
    shares, times p, instead of the shares.

    Args:
        knots: t, ascending.
        degree: of the splines.
        intervals: (T,) indices k with t_k <= x <= t_(k+1).
        x: (T,) points.
        order: of the derivative.
    """
    values = np.ones((len(x), 1))
    for p in range(1, degree + 1):
        # (T, p) first and last knots of the splines of degree p - 1 that are not zero at x
        start = knots[intervals[:, None] + np.arange(1 - p, 1)]
        end = knots[intervals[:, None] + np.arange(1, p + 1)]
        # a spline of degree p - 1 contributes to the p-th splines of the same index and of the one before
        if p <= degree - order:
            to_same = (x[:, None] - start) / (end - start)
            to_previous = 1.0 - to_same
        else:  # derivatives of both shares
            to_same = p / (end - start)
            to_previous = -to_same
        values = np.pad(values * to_previous, ((0, 0), (0, 1))) + np.pad(values * to_same, ((0, 0), (1, 0)))
    return values
