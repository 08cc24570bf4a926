"""The squared speed z of an optimal law: its basis, the stretched parameter xi, and its exact duration.

    z(sigma) = (d sigma/dt)^2,        duration T = integral of z^(-1/2) over sigma in [0, 1]

z is a combination of quintic B-splines on cells of xi(sigma). On a single cell the basis consists of
Chebyshev polynomials instead. They give a law that is smooth everywhere, which deflections require. B-splines
are never negative, and each overlaps only with five neighbours on either side. So z is positive if its
coefficients are, and rows linear in z are sparse.

The integral of z^(-1/2) is taken on panels of sigma that resolve z^(-1/2) even where z is nearly zero.

Source: de Boor, A Practical Guide to Splines, Springer 2001, chapters IX and X.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import factorial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from framework.errors import InvalidInput
from framework.laws.path import HIGHEST_ORDER
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays, read_only
from framework.numerics.chebyshev import (
    COEFFICIENT_ROUNDING,
    PANEL_NODES,
    TimeFunction,
    TimeGrid,
    coefficients,
    derivative_matrix,
    evaluate,
    gauss_legendre,
    nodes,
)
from framework.numerics.sparse_rows import SparseRows
from framework.numerics.splines import Splines
from framework.tolerances import SLOWNESS_ROUNDING

if TYPE_CHECKING:
    from framework.numerics.cone_program import Affine

SPLINE_DEGREE = HIGHEST_ORDER + 1  # as many derivatives of z are continuous as the torque contains
ONE_CELL = (-1.0, 1.0)  # the edges of a single cell, all of xi
STRETCH_WIDTH = 0.1  # in sigma, of the arctangent step about a point where z is resolved more finely
STRETCH_HEIGHT = 0.3  # of this step: in its middle points are 1 + height / width times as dense


@dataclass(frozen=True)
class Stretch:
    """The increasing map xi(sigma) from [0, 1] to [-1, 1], steeper near the points `dense_at`.

    With the points p_k of `dense_at`, xi is sigma + h sum_k arctan((sigma - p_k) / w), scaled to end at -1
    and 1, where w = STRETCH_WIDTH and h = STRETCH_HEIGHT. Through such a map a Chebyshev series resolves a
    function that changes fast near known points: Tee and Trefethen 2006, SIAM J. Sci. Comput. 28.
    """

    dense_at: tuple[float, ...] = ()  # values of sigma

    def __call__(self, sigma: ArrayLike, order: int = 0) -> Array:
        """Evaluate xi or its derivative of an order, with the shape of sigma."""
        sigma = np.asarray(sigma, dtype=float)
        start, end = self._unscaled_ends
        unscaled = self._evaluate_unscaled(sigma, order)
        if order:
            return 2.0 * unscaled / (end - start)
        return 2.0 * (unscaled - start) / (end - start) - 1.0

    @cached_property
    def _unscaled_ends(self) -> Array:
        """Values (2,) of the map before scaling at sigma = 0 and 1."""
        return read_only(self._evaluate_unscaled(np.array([0.0, 1.0]), 0))

    def _evaluate_unscaled(self, sigma: Array, order: int) -> Array:
        """Evaluate the map before scaling, or its derivative of an order.

        With d = sigma - p_k, the derivative of arctan(d / w) is w / (w^2 + d^2), the imaginary part of
        1 / (d - i w); that of order m is the one of (-1)^(m - 1) (m - 1)! / (d - i w)^m.
        """
        # the first term, sigma, or its derivative: 1, then 0
        identity = sigma if order == 0 else np.full(sigma.shape, float(order == 1))
        if not self.dense_at:
            return identity
        w = STRETCH_WIDTH
        d = sigma[..., None] - np.array(self.dense_at)
        if order == 0:
            arctangents = np.arctan(d / w)
        elif order == 1:
            arctangents = w / (w**2 + d**2)
        else:
            arctangents = (-1.0) ** (order - 1) * factorial(order - 1) * ((d - 1j * w) ** -order).imag
        return identity + STRETCH_HEIGHT * arctangents.sum(axis=-1)

    def inverse(self, xi: ArrayLike) -> Array:
        """Solve xi(sigma) = xi for sigma by Newton's method from a table, with the shape of xi.

        Args:
            xi: values in [-1, 1].
        """
        xi = np.asarray(xi, dtype=float)
        grid = np.linspace(0.0, 1.0, 513)
        sigma = np.interp(xi, self(grid), grid)  # first guess from the table (xi(grid), grid)
        for _ in range(4):  # the table is right to a few digits, and each step doubles their number
            sigma = np.clip(sigma - (self(sigma) - xi) / self(sigma, 1), 0.0, 1.0)
        return sigma


@dataclass(frozen=True, eq=False)
class SpeedBasis(ReadOnlyArrays):
    """A basis of `size` functions on `cells` (k + 1,) of xi in [-1, 1]."""

    cells: Array
    size: int

    @staticmethod
    def from_cells(cells: Array) -> SpeedBasis:
        """Return the quintic B-splines on cells (k + 1,), k > 1."""
        return SpeedBasis(cells, len(cells) - 1 + SPLINE_DEGREE)

    @property
    def is_spline(self) -> bool:
        """Whether the functions are B-splines."""
        return len(self.cells) > 2

    @property
    def degree(self) -> int:
        """The degree of the functions on a cell."""
        return SPLINE_DEGREE if self.is_spline else self.size - 1

    @cached_property
    def splines(self) -> Splines:
        """The B-splines of xi."""
        return Splines.on_cells(self.cells, SPLINE_DEGREE)

    @cached_property
    def centres(self) -> Array:
        """Centres (size,) in xi of the B-splines."""
        return read_only(self.splines.centres)

    def matrix(self, xi: Array, order: int = 0) -> SparseRows:
        """Compute the matrix (T, size) of all functions, or a derivative of an `order`, at xi (T,)."""
        if self.is_spline:
            return self.splines.matrix(xi, order)
        values = np.asarray(chebyshev.chebvander(xi, self.size - 1), dtype=float)
        values = values @ derivative_matrix(self.size, order) if order else values
        columns = np.broadcast_to(np.arange(self.size), values.shape)
        return SparseRows.place_columns(columns, values, self.size)

    def series(self, y: Array) -> Array:
        """Return Chebyshev series (k, degree + 1) on the cells, for coefficients y (size,)."""
        if not self.is_spline:
            return y[None]
        half_widths = 0.5 * np.diff(self.cells)[:, None]
        xi = self.cells[:-1, None] + half_widths * (nodes(SPLINE_DEGREE + 1) + 1.0)  # (k, degree + 1)
        values = np.reshape(self.matrix(xi.ravel()) @ y, xi.shape)
        return coefficients(values[..., None])[..., 0]  # `coefficients` expects a trailing axis of components


def evaluate_on_cells(cells: Array, series: Array, xi: ArrayLike, order: int = 0) -> Array:
    """Evaluate a piecewise function at xi (...), or its derivative by xi of an order, with the shape of xi.

    A point on an inner edge belongs to the cell on its right.

    Args:
        cells: edges (k + 1,) of the cells.
        series: Chebyshev coefficients (k, size) of the function on each cell.
    """
    xi = np.asarray(xi, dtype=float)
    flat = xi.ravel()  # (T,)
    cell = np.searchsorted(cells[1:-1], flat, side="right")  # (T,) index of the cell of each point
    half_widths = 0.5 * np.diff(cells)
    local = np.clip((flat - cells[cell]) / half_widths[cell] - 1.0, -1.0, 1.0)  # in [-1, 1] on the cell
    local_derivative = series @ derivative_matrix(series.shape[1], order).T
    derivative = local_derivative / half_widths[:, None] ** order  # (k, size) in xi
    if len(cells) == 2:  # a single series is evaluated faster at all points together
        return evaluate(local, derivative[0]).reshape(xi.shape)
    return evaluate_each(local, derivative[cell]).reshape(xi.shape)


def evaluate_each(x: Array, series: Array) -> Array:
    """Evaluate T Chebyshev series (T, size), each at its own x (T,)."""
    polynomials = np.cos(np.arccos(x)[:, None] * np.arange(series.shape[1]))  # T_k(x) = cos(k arccos x)
    return np.einsum("tk,tk->t", polynomials, series)


def slowness_on_panels(
    cells: Array,
    z_series: Array,
    stretch: Stretch,
    edges: Array | None = None,
) -> TimeFunction:
    """Fit dt/d sigma = z(xi(sigma))^(-1/2) [s] on panels of sigma, halved until accurate.

    A panel is accurate if the truncation error of its time is rounding beside the duration, or below its own
    rounding error. An error eps of z changes z^(-1/2) by eps z^(-3/2) / 2, so rounding errors grow where z is
    nearly zero.

    Args:
        cells: edges (k + 1,) of cells in xi.
        z_series: Chebyshev coefficients (k, size) of z on each cell.
        stretch: the map from sigma to xi.
        edges: (p + 1,) of the first panels, from 0 to 1, such as those of a similar z; by default the
            cells, or four panels for a single series.

    Raises:
        InvalidInput: z is not positive, or so near zero that rounding hides the duration.
    """
    max_panels = 1024
    z_rounding = np.finfo(float).eps * np.abs(z_series).sum(axis=1).max()  # error of z [1/s^2]
    if edges is None:
        edges = stretch.inverse(cells if len(cells) > 2 else nodes(5))  # one polynomial starts with 4 panels
        edges[[0, -1]] = 0.0, 1.0  # free of rounding
    while len(edges) <= max_panels:
        grid = TimeGrid(edges, PANEL_NODES)
        widths = np.diff(edges)
        z = evaluate_on_cells(cells, z_series, stretch(grid.times))
        if not z.min() > 0:  # refused below
            break

        slowness = grid.fit(z[:, None] ** -0.5)
        series = slowness.coefficients[:, :, 0]  # (panels, PANEL_NODES)
        duration = series[:, 0] @ widths  # the first coefficient estimates the mean on each panel
        last_coefficients = np.abs(series[:, -2:]).max(axis=1)  # estimate the truncated part
        truncation = last_coefficients * widths  # (panels,) errors of time [s]
        least_z = z.reshape(-1, PANEL_NODES).min(axis=1)
        rounding = 0.5 * z_rounding * least_z**-1.5 * widths  # (panels,) [s]

        is_coarse = truncation > np.maximum(COEFFICIENT_ROUNDING * duration, rounding)
        if not is_coarse.any():
            if rounding.sum() > SLOWNESS_ROUNDING * duration:  # refused below
                break
            return slowness
        middles = 0.5 * (edges[:-1] + edges[1:])[is_coarse]  # halve the coarse panels
        edges = np.sort(np.concatenate([edges, middles]))
    raise InvalidInput("law: the speed of an optimal law comes too near to zero to be resolved")


class Instants(NamedTuple):
    """The instants times (m,) [s] at which a law is to pass sigma (m,), ascending in (0, 1].

    The instant of sigma = 1 is the duration.
    """

    sigma: Array
    times: Array

    @staticmethod
    def of(sigma: Sequence[float], times: Sequence[float], duration: float | None) -> Instants:
        """Return the instants of sigma (k,) inside the path, and the duration if it is required."""
        end = [] if duration is None else [(1.0, duration)]
        pairs = np.reshape([*zip(sigma, times, strict=True), *end], (-1, 2))
        return Instants(pairs[:, 0], pairs[:, 1])


NO_INSTANTS = Instants.of((), (), None)
AT_END = np.ones(1)  # sigma of the instant that is the duration


class SpeedSpace(NamedTuple):
    """The squared speeds z(xi(sigma)) that a basis represents, by their coefficients y (size,) [1/s^2]."""

    basis: SpeedBasis
    stretch: Stretch

    def duration(self, y: Array) -> float:
        """Compute the duration [s] of a positive z with coefficients y (size,)."""
        return float(self._linearise_instants(y, AT_END)[0][0])

    def adjust(
        self,
        y: Array,
        equalities: Affine,
        instants: Instants = NO_INSTANTS,
        *,
        relative: bool = False,
    ) -> Array:
        """Compute the coefficients (size,) near y that meet equalities and required instants.

        Newton's method solves the equations. Of all steps that solve the linearised equations it takes F v
        with the least |v|, see `_weight_factor`.

        Args:
            equalities: affine functions (c,) of the coefficients that must vanish.
            instants: the m required instants, of which the last may be the duration.
            relative: whether changes of z are measured relative to the z of `y`, so that z changes little
                where it is nearly zero. Changes of splines are always relative.

        Raises:
            InvalidInput: a Newton step on the instants leads to a z that is not positive.
        """
        max_steps = 12  # of Newton's method, which starts near the solution
        F = self._weight_factor(y, relative)
        matrix = SparseRows.of(equalities.matrix).toarray()
        edges = None  # of the panels of the last step
        for _ in range(max_steps):
            # the equations with slopes (c + m, size) and values (c + m,); the last are t(sigma) - times = 0
            slopes = matrix
            values = equalities(y)
            if len(instants.times):
                times, time_slopes, edges = self._linearise_instants(y, instants.sigma, edges)
                slopes = np.vstack([slopes, time_slopes])
                values = np.append(values, times - instants.times)
            norms = np.linalg.norm(slopes, axis=1)
            norms[norms == 0] = 1.0  # an equality that depends on no coefficient
            A = slopes / norms[:, None]  # (c, size) rows of unit length
            # least squares, as equalities may depend on each other
            step = F @ np.linalg.lstsq(A @ F, values / norms, rcond=None)[0]
            y = y - step
            if np.abs(step).max() <= COEFFICIENT_ROUNDING * np.abs(y).max():
                break
        return y

    def _weight_factor(self, y: Array, relative: bool) -> Array:
        """Return F (n, n) with which a change F v of the coefficients y (n,) costs |v|^2.

        Splines have F F' = diag(y) K diag(y), so that coefficients change in proportion to their size, and
        with K = exp(-(distance / width)^2) + independence I hardly otherwise than their neighbours. For a
        single polynomial F is diagonal and falls with the degree. If changes of a polynomial are `relative`
        to z, |v|^2 is the mean of (change of z / z)^2, times the squared mean of z, plus a term that grows
        with the degree.
        """
        n = len(y)
        if self.basis.is_spline:
            # of a coefficient over the mean; smaller ones may change as if they were as large
            min_relative_size = 1e-3
            width = 0.2  # in xi, within which coefficients change together
            independence = 1e-4  # variance of changes of single coefficients over that of these
            size = np.maximum(np.abs(y), min_relative_size * np.abs(y).mean())  # (n,)
            distance = (self.basis.centres[:, None] - self.basis.centres) / width
            K = np.exp(-(distance**2)) + independence * np.eye(n)
            return size[:, None] * np.linalg.cholesky(K)
        free_degree = 8.0  # Chebyshev coefficients up to this degree change at little cost
        weight_power = 2.0  # by which the size of a change falls with the degree
        degree = np.arange(n)
        if not relative:
            return np.diag((1.0 + degree) ** -weight_power)
        values = chebyshev.chebvander(nodes(4 * n), n - 1)  # (4 n, n) T_k, four samples for each coefficient
        z = values @ y
        change = values * (z.mean() / z / np.sqrt(len(z)))[:, None]  # (4 n, n)
        rows = np.vstack([change, np.diag((degree / free_degree) ** weight_power)])
        return np.linalg.inv(np.linalg.qr(rows, mode="r"))

    def _linearise_instants(
        self, y: Array, at: Array, edges: Array | None = None
    ) -> tuple[Array, Array, Array]:
        """Compute the instants t (m,) [s] of a positive z with coefficients y (size,), and dt/dy (m, size).

        dt/dy is -1/2 times the integral of z^(-3/2) dz/dy. The P Gauss-Legendre points of both integrals are
        on the panels that resolve z^(-1/2), which are cut where an integral ends.

        Args:
            at: sigma (m,), ascending, at which the integrals end.
            edges: (p + 1,) in sigma of the panels that resolve a similar z.

        Returns:
            t (m,) [s]; dt/dy (m, size); the edges (p + 1,) of the panels that resolve this z.
        """
        edges = slowness_on_panels(self.basis.cells, self.basis.series(y), self.stretch, edges).edges
        points, weights = gauss_legendre(PANEL_NODES)
        cut = np.union1d(edges, at)
        half_widths = 0.5 * np.diff(cut)[:, None]
        sigma = (cut[:-1, None] + half_widths * (points + 1.0)).ravel()
        basis_values = self.basis.matrix(self.stretch(sigma))  # (P, size)
        sigma_weights = (half_widths * weights).ravel() * (sigma <= at[:, None])  # (m, P)
        z = basis_values @ y
        slopes = [-0.5 * ((before * z**-1.5) @ basis_values) for before in sigma_weights]
        return sigma_weights @ z**-0.5, np.array(slopes), edges
