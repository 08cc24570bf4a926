"""Functions of time as Chebyshev series, panel by panel.

All functions of time of a plan are sampled on Chebyshev points and represented by their coefficients. A
removable quotient 0/0 between two nodes is then no event. The decay of the coefficients tells whether the
function is resolved: `TimeFunction.tail` is the certificate. A function with kinks, as at the knots of a
spline, gets a panel on either side.

Source: Trefethen, Approximation Theory and Approximation Practice, SIAM 2013, chapters 3, 8 and 21.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.polynomial import chebyshev

from framework.arrays import Array, ArrayLike, ReadOnlyArrays, read_only
from framework.errors import InvalidInput, check_order
from framework.tolerances import SAME_PLACE

MIN_CLENSHAW_POINTS = 400  # from which a step of its recurrence costs less than the cosines it saves
COEFFICIENT_ROUNDING = 1e-15  # of the largest coefficient of a series
NOISE_FACTOR = 3.0  # times the largest coefficient of the last eighth: what may be rounding


@lru_cache(maxsize=64)
def nodes(size: int) -> Array:
    """Return the Chebyshev points of the second kind on [-1, 1], ascending, ends included, shape (size,)."""
    return read_only(-np.cos(np.pi * np.arange(size) / (size - 1)))


@lru_cache(maxsize=64)
def _transform(size: int) -> Array:
    """Return the matrix (size, size) from values at `nodes(size)` to Chebyshev coefficients."""
    k = np.arange(size)
    matrix = np.cos(np.pi * np.outer(k, size - 1 - k) / (size - 1)) * (2.0 / (size - 1))
    matrix[:, [0, -1]] *= 0.5
    matrix[[0, -1], :] *= 0.5
    return read_only(matrix)


def coefficients(values: Array) -> Array:
    """Compute the Chebyshev coefficients of values (..., size, k) sampled at `nodes(size)`, same shape."""
    return _transform(values.shape[-2]) @ values


def tail(series: Array) -> float:
    """Return the size of the last eighth of coefficients (..., size, k) over the largest; 0 for zero."""
    largest = float(np.max(np.abs(series), initial=0.0))
    if not np.isfinite(largest):
        return float("inf")
    last = max(2, series.shape[-2] // 8)
    return float(np.max(np.abs(series[..., -last:, :]))) / largest if largest > 0 else 0.0


def evaluate(x: Array, series: Array) -> Array:
    """Compute the values (T, k) at x (T,) in [-1, 1] of Chebyshev series (size, k).

    At a few points the polynomials are quicker all at once, as T_k(x) = cos(k arccos x), than by
    Clenshaw's recurrence, which takes `size` steps in Python.
    """
    if x.size > MIN_CLENSHAW_POINTS:
        return np.asarray(chebyshev.chebval(x, series).T)
    return np.asarray(np.cos(np.arccos(x)[:, None] * np.arange(series.shape[0])) @ series)


def extrema(series: Array) -> Array:
    """Return the zeros in [-1, 1] of the derivative of one Chebyshev series (size,), ascending."""
    return real_roots(derivative_matrix(len(series)) @ series)


def real_roots(series: Array) -> Array:
    """Return the real roots in [-1, 1] of one Chebyshev series (size,), ascending, by the colleague matrix.

    Those of degree 2, as of p' of a law through one crossing, are closed.

    Roots that rounding has pushed off the real axis or over an end, within SAME_PLACE, are accepted.
    """
    size = np.abs(series)
    degree = int(np.flatnonzero(size > COEFFICIENT_ROUNDING * size.max(initial=0.0)).max(initial=0))
    # |T_k| is at most largest^k where roots are accepted: the constant may outweigh all others
    largest = 1.0 + 2.0 * SAME_PLACE**0.25
    if degree == 0 or size[0] > size[1 : degree + 1] @ largest ** np.arange(1, degree + 1):
        return np.empty(0)
    if degree == 2:  # of c2 (2 x^2 - 1) + c1 x + c0
        middle = -0.25 * series[1] / series[2]
        product = 0.5 * (series[0] / series[2] - 1.0)
        half = np.sqrt(complex(middle**2 - product))
        far = middle + (half if middle * half.real > 0.0 else -half)
        roots = np.array([far, product / far if far else 0.0])
    else:
        matrix, weights = _colleague(degree)
        matrix = matrix.copy()
        matrix[:, 0] -= (series[:degree] / series[degree] * weights)[::-1]
        roots = np.linalg.eigvals(matrix)
    real = np.real(roots[np.abs(np.imag(roots)) <= np.sqrt(SAME_PLACE)])
    return np.sort(np.clip(real[np.abs(real) <= 1 + SAME_PLACE], -1.0, 1.0))


@lru_cache(maxsize=64)
def _colleague(degree: int) -> tuple[Array, Array]:
    """Return the colleague matrix of T_degree, rotated for accuracy, and the other coefficients' weights."""
    weights = np.full(degree, 0.5)
    weights[0] = np.sqrt(0.5) if degree > 1 else 1.0
    return chebyshev.chebcompanion(np.eye(degree + 1)[degree])[::-1, ::-1], weights


@dataclass(frozen=True, eq=False)
class TimeFunction(ReadOnlyArrays):
    """A vector function of time: `coefficients` (panels, size, k) between `edges` (panels + 1,) [s]."""

    edges: Array
    coefficients: Array

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Return the value, or a time derivative, at t: a scalar gives (k,), (T,) gives (T, k).

        Raises:
            InvalidInput: t lies outside the interval, or is not finite.
        """
        check_order(order)
        times = np.asarray(t, dtype=float)
        start, end = self.edges[0], self.edges[-1]
        slack = SAME_PLACE * (end - start)
        if not np.all((times >= start - slack) & (times <= end + slack)):
            raise InvalidInput(f"time {t!r} is outside [{start:g}, {end:g}] s")
        flat = times.ravel()
        if len(self.edges) == 2:
            values = self._evaluate_panel(0, flat, order)
        else:
            panel = np.searchsorted(self.edges[1:-1], flat, side="right")
            values = np.empty((flat.size, self.coefficients.shape[2]))
            for p in np.unique(panel) if values.size else ():
                inside = panel == p
                values[inside] = self._evaluate_panel(p, flat[inside], order)
        return values.reshape(*times.shape, self.coefficients.shape[2])

    def _evaluate_panel(self, p: int, t: Array, order: int) -> Array:
        """Compute values (T, k) of a derivative at t (T,) on one panel."""
        half = 0.5 * (self.edges[p + 1] - self.edges[p])
        local = (t - self.edges[p]) / half - 1.0
        series = self.coefficients[p]
        for _ in range(order):
            series = derivative_matrix(len(series)) @ series / half
        return evaluate(np.minimum(np.maximum(local, -1.0), 1.0), series)

    @property
    def tail(self) -> float:
        """Relative size of the last coefficients: the certificate of resolution."""
        return tail(self.coefficients)


def evaluate_together(functions: Sequence[TimeFunction], t: Array) -> list[Array]:
    """Return the values (T, k) at t (T,) of each of some functions that share their panels and size."""
    series = np.concatenate([function.coefficients for function in functions], axis=2)
    ends = np.cumsum([function.coefficients.shape[2] for function in functions[:-1]])
    return np.split(TimeFunction(functions[0].edges, series)(t), ends, axis=1)


@dataclass(frozen=True, eq=False)
class TimeGrid(ReadOnlyArrays):
    """Chebyshev nodes of `size` points on each panel between `edges` (panels + 1,) [s]."""

    edges: Array
    size: int

    @cached_property
    def times(self) -> Array:
        """All nodes, panel after panel (an inner edge appears twice), shape (panels * size,)."""
        return read_only(_nodes_between(self.edges, self.size))

    def fit(self, values: Array) -> TimeFunction:
        """Return the function through values (panels * size, k) at `times`."""
        return TimeFunction(self.edges, coefficients(self._stack_panels(values)))

    def _stack_panels(self, values: Array) -> Array:
        """Return values (panels * size, k) as (panels, size, k)."""
        return values.reshape(len(self.edges) - 1, self.size, -1)

    @property
    def resolvable(self) -> int:
        """Coefficients of a series that its values at the nodes resolve: all but the last eighth."""
        return self.size - max(2, self.size // 8)

    def fit_truncated(self, values: Array) -> TimeFunction:
        """Fit the function through values (panels * size, k), coefficients that are rounding set to zero.

        Differentiating twice amplifies a coefficient by up to size^4, so rounding would grow if it were
        fed back. The last eighth of a resolved series is rounding and shows its size.
        """
        series = coefficients(self._stack_panels(values))
        floor = NOISE_FACTOR * np.abs(series[:, self.resolvable :]).max(axis=1, keepdims=True)
        series[np.abs(series) <= floor] = 0.0
        series[:, self.resolvable :] = 0.0
        return TimeFunction(self.edges, series)

    def values(self, function: TimeFunction) -> tuple[Array, Array, Array]:
        """Compute a function and its first and second derivative at the nodes, each (panels * size, k).

        The function is one of this grid's. From its coefficients, rounding stays that of each coefficient,
        however small, where `differentiate` amplifies that of the largest value.
        """
        half = 0.5 * np.diff(self.edges)[:, None, None]
        series = function.coefficients
        first, second, third = (
            (basis @ series / half**order).reshape(series.shape[0] * self.size, series.shape[2])
            for order, basis in enumerate(basis_values(self.size))
        )
        return first, second, third

    def differentiate(self, values: Array) -> tuple[Array, Array]:
        """Compute two time derivatives at the nodes of values (panels * size, k), each of the same shape."""
        first, second = _differentiation(self.size)
        half = 0.5 * np.diff(self.edges)[:, None, None]
        stacked = self._stack_panels(values)
        slopes, curvatures = first @ stacked / half, second @ stacked / half**2
        return slopes.reshape(values.shape), curvatures.reshape(values.shape)

    @staticmethod
    def clear_of(instants: Array, edges: Array, size: int) -> TimeGrid:
        """Return the grid of at least `size` nodes a panel that stays farthest from `instants` [s].

        A node on the very instant of a crossing would divide 0 by 0; a few nodes more always help.
        """
        best, best_gap = size, -1.0
        for candidate in range(size, size + 6) if len(instants) else ():
            times = _nodes_between(edges, candidate)
            gap = float(np.abs(times - instants[:, None]).min()) * candidate
            if gap > best_gap * 1.001:
                best, best_gap = candidate, gap
        return TimeGrid(edges, best)


def _nodes_between(edges: Array, size: int) -> Array:
    """Return Chebyshev nodes, `size` on each panel between edges (panels + 1,), in one array."""
    half = 0.5 * (edges[1:] - edges[:-1])[:, None]
    times = edges[:-1, None] + half * (nodes(size) + 1.0)
    times[:, -1] = edges[1:]
    return np.asarray(times.ravel())


@lru_cache(maxsize=64)
def derivative_matrix(size: int, order: int = 1) -> Array:
    """Return the matrix (size, size) from coefficients to those of the derivative of this order."""
    matrix = np.eye(size)
    count = max(size - order, 0)
    matrix[:count] = chebyshev.chebder(matrix, order, axis=0)[:count]
    matrix[count:] = 0.0
    return read_only(matrix)


@lru_cache(maxsize=16)
def _differentiation(size: int) -> tuple[Array, Array]:
    """Return matrices (size, size) that differentiate values at `nodes(size)` once and twice."""
    _, first, second = basis_values(size)
    return first @ _transform(size), second @ _transform(size)


@lru_cache(maxsize=32)
def basis_values(size: int) -> tuple[Array, Array, Array]:
    """Return Chebyshev polynomials and their first two derivatives at `nodes(size)`, each (size, size)."""
    derivative = derivative_matrix(size)
    values = np.asarray(chebyshev.chebvander(nodes(size), size - 1), dtype=float)
    first, second = values @ derivative, values @ (derivative @ derivative)
    values.setflags(write=False)  # in its own order: products with a copy differ in the last bit
    return values, read_only(first), read_only(second)
