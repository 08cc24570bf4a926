"""Functions of time as Chebyshev series, panel by panel.

All functions of time of a plan are sampled at Chebyshev points and represented by their coefficients. A
removable singularity 0/0 between two nodes does no harm, since it is never evaluated. The decay of the
coefficients shows whether the function is resolved; `TimeFunction.tail` is this certificate. Where a function
has a kink, as at the knots of a spline, one panel ends and the next begins.

Source: Trefethen, Approximation Theory and Approximation Practice, SIAM 2013, chapters 3, 8 and 21.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.polynomial import chebyshev, legendre

from framework.errors import InvalidInput, check_order, real_numbers
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays, read_only
from framework.tolerances import SAME_PLACE

MIN_CLENSHAW_POINTS = 400  # number of points from which Clenshaw's recurrence is faster than cosines
MIN_PRODUCT_SERIES = 16  # number of series from which a product of matrices is faster for any points
# of a panel that is halved until its series is resolved; an even number, so that no node is in the middle
PANEL_NODES = 24
COEFFICIENT_ROUNDING = 1e-15  # share of the largest coefficient of a series


@lru_cache(maxsize=64)
def nodes(size: int) -> Array:
    """Return the Chebyshev points (size,) of the second kind on [-1, 1], ascending, ends included."""
    return read_only(-np.cos(np.pi * np.arange(size) / (size - 1)))


@lru_cache(maxsize=64)
def gauss_legendre(count: int) -> tuple[Array, Array]:
    """Return Gauss-Legendre points (count,) on [-1, 1] and their weights, whose sum is 2."""
    points, weights = legendre.leggauss(count)
    return read_only(points), read_only(weights)


@lru_cache(maxsize=64)
def _transform_matrix(size: int) -> Array:
    """Return the matrix (size, size) from values at `nodes(size)` to Chebyshev coefficients.

    This is the discrete cosine transform of type I: the coefficient a_k is 2 w_k / (size - 1) times the sum
    over j of w_j cos(pi k j / (size - 1)) f(x_j). The nodes x_j are in descending order, and w is 1/2 for the
    first and the last index, else 1.
    """
    k = np.arange(size)
    angles = np.pi * np.outer(k, size - 1 - k) / (size - 1)  # coefficients by nodes
    matrix = np.cos(angles) * (2.0 / (size - 1))
    matrix[:, [0, -1]] *= 0.5
    matrix[[0, -1], :] *= 0.5
    return read_only(matrix)


def coefficients(values: Array) -> Array:
    """Compute the Chebyshev coefficients of values (..., size, k) sampled at `nodes(size)`, same shape."""
    return _transform_matrix(values.shape[-2]) @ values


def tail(series: Array) -> float:
    """Return the tail of coefficients (..., size, k): their relative size at the end.

    The tail is the largest absolute value among the last eighth, divided by the largest of all. It is 0 for a
    series of zeros, and infinite for a series that is not finite.
    """
    magnitudes = np.abs(series)
    largest = float(magnitudes.max(initial=0.0))
    if not np.isfinite(largest):
        return np.inf
    count = max(2, series.shape[-2] // 8)  # at least 2: every other coefficient of an even function is 0
    return float(magnitudes[..., -count:, :].max()) / largest if largest > 0 else 0.0


def evaluate(x: Array, series: Array) -> Array:
    """Compute the values (T, k) at x (T,) in [-1, 1] of Chebyshev series (size, k).

    At few points, or for many series, a product with all T_k(x) = cos(k arccos x) is faster than Clenshaw's
    recurrence, which takes `size` steps in Python. At many points the recurrence needs less memory, too.
    """
    if x.size > MIN_CLENSHAW_POINTS and series[0].size < MIN_PRODUCT_SERIES:
        return np.asarray(chebyshev.chebval(x, series).T)
    polynomials = np.cos(np.arccos(x)[:, None] * np.arange(len(series)))  # T_k(x), (T, size)
    return polynomials @ series


def extrema(series: Array) -> Array:
    """Return the zeros in [-1, 1] of the derivative of one Chebyshev series (size,), ascending."""
    return real_roots(derivative_matrix(len(series)) @ series)


def real_roots(series: Array) -> Array:
    """Return the real roots in [-1, 1] of one Chebyshev series (size,), ascending.

    The roots are the eigenvalues of the colleague matrix, or in closed form for degree 2, the degree of p' of
    a law through one crossing. Roots that rounding moves off the real axis or beyond an end are accepted. The
    tolerance is SAME_PLACE beyond an end. It is SAME_PLACE^(1/2) off the axis, because rounding splits a
    double root by its square root.

    The colleague matrix is that of T_degree with one column changed: weighted ratios of the lower
    coefficients to the last one are subtracted. Rows and columns are in reverse order, which reduces rounding
    errors, as in numpy's `chebroots`.
    """
    sizes = np.abs(series)
    is_rounding = sizes <= COEFFICIENT_ROUNDING * sizes.max(initial=0.0)
    (above,) = (~is_rounding).nonzero()
    degree = int(above[-1]) if len(above) else 0
    if degree == 0:
        return np.empty(0)
    # |T_k| is at most base^k in the ellipse with foci -1 and 1 whose semi-axes sum up to base. With this base
    # it contains all points at which roots are accepted. There is none if |c_0| exceeds all other terms.
    base = 1.0 + 2.0 * SAME_PLACE**0.25
    if sizes[0] > sizes[1 : degree + 1] @ base ** np.arange(1, degree + 1):
        return np.empty(0)
    if degree == 2:  # c_0 + c_1 x + c_2 (2 x^2 - 1) = 0
        middle = -0.25 * series[1] / series[2]  # half of the sum of the roots
        product = 0.5 * (series[0] / series[2] - 1.0)
        half_difference = np.sqrt(complex(middle**2 - product))
        # the larger root without cancellation, the other one from the product of both
        larger = middle + (half_difference if middle * half_difference.real > 0.0 else -half_difference)
        roots = np.array([larger, product / larger if larger else 0.0])
    else:
        weights = np.full(degree, 0.5)  # of the recurrence x T_k = (T_(k-1) + T_(k+1)) / 2
        weights[0] = np.sqrt(0.5) if degree > 1 else 1.0  # T_0 is scaled, which makes the matrix symmetric
        matrix = _colleague_matrix(degree).copy()
        matrix[:, 0] -= (series[:degree] / series[degree] * weights)[::-1]
        roots = np.linalg.eigvals(matrix)
    real = roots[np.abs(roots.imag) <= np.sqrt(SAME_PLACE)].real
    return np.sort(real[np.abs(real) <= 1 + SAME_PLACE].clip(-1.0, 1.0))


@lru_cache(maxsize=64)
def _colleague_matrix(degree: int) -> Array:
    """Return the colleague matrix of T_degree, rows and columns in reverse order."""
    return chebyshev.chebcompanion(np.eye(degree + 1)[degree])[::-1, ::-1]


@dataclass(frozen=True, eq=False)
class TimeFunction(ReadOnlyArrays):
    """A vector function of time: `coefficients` (panels, size, k) between `edges` (panels + 1,) [s]."""

    edges: Array
    coefficients: Array

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Return values (k,) at one time t, (T, k) at t (T,), or their time derivatives of an `order`.

        Raises:
            InvalidInput: t lies outside the interval, or is not finite.
        """
        check_order(order)
        times = real_numbers("t", t)
        start, end = self.edges[0], self.edges[-1]
        slack = SAME_PLACE * (end - start)
        if not ((times >= start - slack) & (times <= end + slack)).all():
            raise InvalidInput(f"time {t!r} is outside [{start:g}, {end:g}] s")
        flat = times.ravel()
        panel = self.edges[1:-1].searchsorted(flat, side="right")  # (T,) index of each time's panel
        values = np.empty((flat.size, self.coefficients.shape[2]))
        for p in set(panel.tolist()):
            inside = panel == p
            half_width = 0.5 * (self.edges[p + 1] - self.edges[p])
            local = (flat[inside] - self.edges[p]) / half_width - 1.0  # in [-1, 1]
            series = derivative_matrix(self.coefficients.shape[1], order) @ self.coefficients[p]
            values[inside] = evaluate(local.clip(-1.0, 1.0), series) / half_width**order
        return values.reshape(*times.shape, self.coefficients.shape[2])

    @property
    def tail(self) -> float:
        """Relative size of the last coefficients: the certificate that the function is resolved."""
        return tail(self.coefficients)

    @property
    def grid(self) -> TimeGrid:
        """The nodes at which values determine the coefficients."""
        return TimeGrid(self.edges, self.coefficients.shape[1])


@dataclass(frozen=True, eq=False)
class TimeGrid(ReadOnlyArrays):
    """Chebyshev nodes of `size` points on each panel between `edges` (panels + 1,) [s]."""

    edges: Array
    size: int

    @cached_property
    def times(self) -> Array:
        """All nodes (panels * size,), panel after panel; an inner edge appears twice."""
        starts, ends = self.edges[:-1], self.edges[1:]
        times = starts[:, None] + 0.5 * (ends - starts)[:, None] * (nodes(self.size) + 1.0)  # (panels, size)
        times[:, -1] = ends  # exactly, without rounding
        return read_only(times.ravel())

    def fit(self, values: Array) -> TimeFunction:
        """Fit the function through values (panels * size, k) at `times`."""
        return TimeFunction(self.edges, coefficients(values.reshape(len(self.edges) - 1, self.size, -1)))

    def fit_truncated(
        self,
        values: Array,
        *,
        # a coefficient below this factor times the largest of the last eighth is rounding
        noise_factor: float = 3.0,
    ) -> TimeFunction:
        """Fit the function through values (panels * size, k); set coefficients of rounding size to zero.

        The last eighth of the coefficients of a resolved function are rounding errors, and indicate their
        size. Two differentiations amplify a coefficient by up to size^4. Without truncation rounding errors
        would grow in an iteration on second derivatives.
        """
        resolvable = self.size - max(2, self.size // 8)
        series = coefficients(values.reshape(len(self.edges) - 1, self.size, -1))
        rounding = noise_factor * np.abs(series[:, resolvable:]).max(axis=1, keepdims=True)
        series[np.abs(series) <= rounding] = 0.0
        series[:, resolvable:] = 0.0
        return TimeFunction(self.edges, series)

    def values(self, function: TimeFunction) -> tuple[Array, Array, Array]:
        """Evaluate a function and its first two time derivatives at the nodes, (panels * size, k) each.

        The function must have the panels and the size of this grid. Differentiation amplifies the rounding
        error of each coefficient, which is small if the coefficient is small.
        """
        basis, first, second = _basis_values(self.size)  # polynomials and derivatives, (size, size) each
        series = function.coefficients
        half_widths = 0.5 * np.diff(self.edges)[:, None, None]
        return (
            np.concatenate(basis @ series),
            np.concatenate(first @ series / half_widths),
            np.concatenate(second @ series / half_widths**2),
        )

    @staticmethod
    def clear_of(instants: Array, edges: Array, size: int) -> TimeGrid:
        """Return the grid whose nodes are farthest from `instants` (k,) [s].

        A node at the instant of a crossing would divide 0 by 0. Candidates have `size` to `size` + 5 nodes on
        each panel. Distances from the instants are compared relative to the mean distance between nodes.

        Args:
            edges: ends of the panels (panels + 1,) [s].
            size: least number of nodes on each panel.
        """
        if not len(instants):  # any nodes will do
            return TimeGrid(edges, size)
        panel = edges[1:-1].searchsorted(instants)  # (k,)
        half_widths = 0.5 * (edges[panel + 1] - edges[panel])
        x = ((instants - edges[panel]) / half_widths - 1.0).clip(-1.0, 1.0)  # on the panel
        counts = np.arange(size, size + 6)  # of nodes -cos(pi j / (count - 1)), j = 0 .. count - 1
        j = np.arccos(-x)[:, None] * (counts - 1) / np.pi  # (k, 6) of each instant, not whole
        nodes_beside = -np.cos(np.pi * np.array([np.floor(j), np.ceil(j)]) / (counts - 1))  # (2, k, 6)
        distances = (np.abs(nodes_beside - x[:, None]) * half_widths[:, None]).min(axis=(0, 1)) * counts
        # the first of those that are best but for rounding
        return TimeGrid(edges, int(counts[(distances * 1.001 >= distances.max()).argmax()]))


@lru_cache(maxsize=64)
def derivative_matrix(size: int, order: int = 1) -> Array:
    """Return the matrix (size, size) that differentiates a series of coefficients `order` times."""
    matrix = np.zeros((size, size))
    count = max(size - order, 0)  # number of coefficients of the derivative
    matrix[:count] = chebyshev.chebder(np.eye(size), order, axis=0)[:count]
    return read_only(matrix)


@lru_cache(maxsize=32)
def _basis_values(size: int) -> tuple[Array, Array, Array]:
    """Return Chebyshev polynomials and their first two derivatives at `nodes(size)`, each (size, size)."""
    derivative = derivative_matrix(size)
    values = np.asarray(chebyshev.chebvander(nodes(size), size - 1), dtype=float)
    first = values @ derivative
    second = values @ (derivative @ derivative)
    values.setflags(write=False)  # no copy: in another memory order its products differ in the last bit
    return values, read_only(first), read_only(second)


# ------------------------------------------------------------------ largest values


def peak_sizes(function: Callable[[Array], Array], grid: TimeGrid) -> Array:
    """Compute the largest |value| (k,) of each component of a function of time.

    The result is exact to rounding if the function is smooth. The function is sampled, and its local maxima
    are refined: each maximum moves to the vertex of the parabola through three points about it, again and
    again, with points that are closer together each time (`zoom_steps`).

    Args:
        function: returns values (T, k) at t (T,) [s].
        grid: nodes at which the function's series is resolved.
    """
    node_ratio = 4  # number of samples over number of Chebyshev coefficients, on each panel
    # distances between the three points of the parabolas about a maximum, over the distance between samples
    zoom_steps = (1.0, 1.0 / 16.0, 1.0 / 256.0)
    start, end = grid.edges[0], grid.edges[-1]
    t = TimeGrid(grid.edges, node_ratio * grid.size).times  # (T,)
    values = np.abs(function(t))  # (T, k)
    peaks = values.max(axis=0)

    padded = np.full((len(t) + 2, values.shape[1]), -np.inf)
    padded[1:-1] = values
    is_local_maximum = (values >= padded[:-2]) & (values >= padded[2:])
    sample, component = np.nonzero(is_local_maximum)  # (m,) of each of the m local maxima
    middle = t[sample]
    # distance between samples: the longer one of those to both neighbours
    gaps = np.diff(np.concatenate([[start], t, [end]]))
    spacing = np.maximum(gaps[1:], gaps[:-1])[sample]

    def sizes_at(instants: Array) -> Array:
        """Return |value| (..., m) of each maximum's component at instants (..., m) [s]."""
        sizes = np.abs(function(instants.ravel())).reshape(*instants.shape, -1)
        return sizes[..., np.arange(len(component)), component]

    for zoom_step in zoom_steps:
        step = zoom_step * spacing
        points = np.array([middle - step, middle, middle + step]).clip(start, end)  # (3, m)
        left, centre, right = sizes_at(points)  # (m,) each
        np.maximum.at(peaks, component, np.maximum(np.maximum(left, centre), right))
        # the vertex of the parabola through these sizes at -1, 0, 1; the middle if it has no maximum
        curvature = 2.0 * centre - left - right  # minus the second derivative: positive at a maximum
        vertex = np.divide(0.5 * (right - left), curvature, out=np.zeros(left.shape), where=curvature > 0.0)
        middle = (middle + step * vertex.clip(-1.0, 1.0)).clip(start, end)
    np.maximum.at(peaks, component, sizes_at(middle))
    return peaks
