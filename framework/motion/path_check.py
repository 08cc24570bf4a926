"""The check of a user's own path: whether its derivatives are the derivatives of its values.

Torques are made of x(s), x'(s) and x''(s) as the path gives them; a path whose x' is not the derivative of
its x has torques that belong to no motion, however well they converge. Tested is the integral,

    x(b) - x(a) = int_a^b x'(s) ds,    x'(b) - x'(a) = int_a^b x''(s) ds,

over a few short intervals between the knots, with Gauss's rule: no step of a difference has to be chosen.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from framework.arrays import Array
from framework.errors import InvalidInput
from framework.motion.path import Path, PointPath, expect_path
from framework.tolerances import WRONG_DERIVATIVE

DIFFERENCE_ROUNDING = 1e-10  # of x(b) - x(a), over the largest value: what a user's own formula may lose
DIFFERENCE_INTERVALS = 9
INTERVAL_LENGTH = 1e-3  # in s; shorter between knots that are closer
GOLDEN_RATIO = 0.5 * (5.0**0.5 - 1.0)  # its multiples modulo 1 spread evenly and hit no regular grid


def check_path(path: Path) -> None:
    """Test x' and x'' of a path against x at a few places.

    Raises:
        InvalidInput: no path, knots that do not ascend inside (0, 1), a value that is missing or not finite,
            or path(s, 1) or path(s, 2) that is not the derivative of the order below.
    """
    expect_path(path)
    if isinstance(path, PointPath):
        return  # one of our own
    starts, lengths = _intervals(path)
    for order in (1, 2):
        _check_derivative(path, order, starts, lengths)


def _check_derivative(path: Path, order: int, starts: Array, lengths: Array) -> None:
    """Compare mean rates of a derivative over intervals with difference quotients of the order below."""
    nodes, weights = _gauss()
    inside = starts[:, None] + 0.5 * lengths[:, None] * (nodes + 1.0)
    ends = np.concatenate([starts, starts + lengths])
    first, last = np.split(_values(path, ends, order - 1), 2)
    rates = _values(path, inside.ravel(), order).reshape(*inside.shape, path.n)
    means = 0.5 * np.einsum("k,ikn->in", weights, rates)
    quotients = (last - first) / lengths[:, None]
    size = np.maximum(np.abs(means), np.abs(quotients)).max(axis=0)
    values = np.maximum(np.abs(first), np.abs(last)).max(axis=0)
    allowed = WRONG_DERIVATIVE * size + DIFFERENCE_ROUNDING * values / lengths[:, None]
    excess = np.abs(means - quotients) - allowed
    if np.any(excess > 0):
        i, component = np.unravel_index(int(np.argmax(excess)), excess.shape)
        raise InvalidInput(
            f"path: path(s, {order}) is not the derivative of path(s, {order - 1}): at s = "
            f"{starts[i]:.4g} coordinate {component} has {means[i, component]:.6g} instead of "
            f"{quotients[i, component]:.6g}"
        )


@cache
def _gauss() -> tuple[Array, Array]:
    """Return nodes and weights (5,) on [-1, 1]."""
    return np.polynomial.legendre.leggauss(5)


def _intervals(path: Path) -> tuple[Array, Array]:
    """Return starts and lengths of intervals (DIFFERENCE_INTERVALS,) in [0, 1] that contain no knot."""
    knots = np.asarray(path.knots, dtype=float)
    edges = np.concatenate(([0.0], knots, [1.0]))
    if not np.all(np.diff(edges) > 0):
        raise InvalidInput(f"path: knots must ascend inside (0, 1), got {knots.tolist()}")
    places = np.mod(GOLDEN_RATIO * np.arange(1, DIFFERENCE_INTERVALS + 1), 1.0)
    panel = np.searchsorted(edges, places, side="right") - 1
    lengths = np.minimum(INTERVAL_LENGTH, np.diff(edges)[panel])
    return np.minimum(places, edges[panel + 1] - lengths), lengths


def _values(path: Path, s: Array, order: int) -> Array:
    """Evaluate path(s, order) as an array (T, n) of finite numbers."""
    values = np.asarray(path(s, order), dtype=float)
    if values.shape != (len(s), path.n) or not np.all(np.isfinite(values)):
        raise InvalidInput(
            f"path: path(s, {order}) must give {path.n} finite numbers for each s, shape "
            f"({len(s)}, {path.n}), got shape {values.shape}"
        )
    return values
