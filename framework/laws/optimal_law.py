"""The motion law of free shape s(t), written as the speed of a path parameter.

    s = phi(sigma),    z(sigma) = (d sigma/dt)^2,    u = z'/2          (prime: d/d sigma)

phi is the smoothstep whose first R derivatives vanish at sigma = 0 and 1, so s is at rest to order R at both
ends whatever z > 0 is. z is a spline or one polynomial (`speed_basis`) in xi(sigma), which is dense where the
law changes most (beside crossings: slow, then a sprint). All that torques need of the law is linear in z:
(ds/dt)^2 = phi'^2 z and d2s/dt2 = phi' u + phi" z.

The square of the speed along the path as the unknown is from Verscheure, Demeulenaere, Swevers, De Schutter
and Diehl, Time-optimal path tracking for robots: a convex optimization approach, IEEE TAC 54 (2009).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.polynomial import chebyshev, polynomial

from framework.errors import InvalidInput, check_order
from framework.laws.law import PlannedLaw
from framework.laws.path import HIGHEST_ORDER
from framework.laws.speed_basis import ONE_CELL, SPLINE_DEGREE, SpeedBasis
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays, read_only
from framework.numerics.chebyshev import TimeFunction, TimeGrid, derivative_matrix, evaluate, extrema, nodes
from framework.tolerances import NEWTON_STEP, SAME_PLACE, SLOWNESS_ROUNDING

HIGHEST_SMOOTHNESS = 6  # beyond, the squared speed grows so much at the ends that its digits are lost
# samples of s' along the path; change of s' over the largest s' that counts as a turn
TURN_SAMPLES, MIN_SWING = 4001, 1e-3
PANEL_NODES = 24  # nodes of a panel of t(sigma)
SLOWNESS_TAIL = 1e-15  # truncation error of a panel's time over the duration
MAX_PANELS = 1024
DEGREES_PER_PANEL = 3  # degrees of z for each panel in time
STRETCH_WIDTH = 0.1  # in sigma, of the stretch about a place where z is resolved more finely
STRETCH_HEIGHT = 0.3  # of the arctangent: points are 1 + height / width times as dense in its middle
DURATION_MISMATCH = 1e-12  # difference of the integral of a given speed from the duration, over the duration


@dataclass(frozen=True)
class Smoothstep:
    """phi(sigma) from 0 to 1 on [0, 1] with phi' ~ (sigma (1 - sigma))^order.

    It is the regularised incomplete beta function with both parameters order + 1.
    """

    order: int

    def __call__(self, sigma: ArrayLike, order: int = 0) -> Array:
        """Evaluate phi or its derivative of an order, with the shape of sigma.

        Powers of the distance to the nearer end are accurate near both ends. phi' is symmetric about 1/2, so
        derivatives of even order change sign there.
        """
        sigma = np.asarray(sigma, dtype=float)
        if order == 0:
            from scipy.special import betainc  # takes time to import, and not all plans need it

            return betainc(self.order + 1, self.order + 1, sigma)
        end_distance = np.minimum(sigma, 1.0 - sigma)
        value = polynomial.polyval(end_distance, _slope_powers(self.order, order))
        return np.where(sigma > 0.5, (-1.0) ** (order + 1) * value, value)

    def inverse(self, s: ArrayLike) -> Array:
        """Solve phi(sigma) = s for sigma."""
        from scipy.special import betaincinv

        return betaincinv(self.order + 1, self.order + 1, s)


@dataclass(frozen=True)
class Stretch:
    """xi(sigma) from -1 to 1 on [0, 1], steeper near the places `at`.

    It is raw(sigma) = sigma + h sum_k arctan((sigma - at_k) / w), scaled to end at -1 and 1, with w =
    STRETCH_WIDTH and h = STRETCH_HEIGHT. Such maps make Chebyshev series resolve functions that change fast
    at given places: Tee and Trefethen 2006, SIAM J. Sci. Comput. 28.
    """

    at: tuple[float, ...] = ()  # places in sigma

    def __call__(self, sigma: ArrayLike, order: int = 0) -> Array:
        """Evaluate xi or its derivative up to order 3, with the shape of sigma."""
        sigma = np.asarray(sigma, dtype=float)
        start, end = self._unscaled_ends
        scaled = 2.0 * (self._evaluate_unscaled(sigma, order) - (0.0 if order else start)) / (end - start)
        return scaled if order else scaled - 1.0

    @cached_property
    def _unscaled_ends(self) -> tuple[float, float]:
        """The map at sigma = 0 and 1 before scaling."""
        start, end = self._evaluate_unscaled(np.array([0.0, 1.0]), 0)
        return float(start), float(end)

    def _evaluate_unscaled(self, sigma: Array, order: int) -> Array:
        """Evaluate the map before scaling, or its derivative up to order 3.

        With d = sigma - at, the derivatives of arctan(d / w) are w / (w^2 + d^2), -2 w d / (w^2 + d^2)^2 and
        w (6 d^2 - 2 w^2) / (w^2 + d^2)^3.
        """
        identity = sigma if order == 0 else np.full(sigma.shape, float(order == 1))
        if not self.at:
            return identity
        w = STRETCH_WIDTH
        d = sigma[..., None] - np.array(self.at)
        denominator = w**2 + d**2
        if order == 0:
            arctangents = np.arctan(d / w)
        elif order == 1:
            arctangents = w / denominator
        elif order == 2:
            arctangents = -2.0 * w * d / denominator**2
        else:
            arctangents = w * (6.0 * d**2 - 2.0 * w**2) / denominator**3
        return identity + STRETCH_HEIGHT * arctangents.sum(axis=-1)

    def inverse(self, xi: ArrayLike) -> Array:
        """Solve xi(sigma) = xi for sigma by Newton's method, started from a table."""
        xi = np.asarray(xi, dtype=float)
        grid = np.linspace(0.0, 1.0, 513)
        sigma = np.interp(xi, self(grid), grid)
        for _ in range(4):  # the table has a few digits right, and each step doubles them
            sigma = np.clip(sigma - (self(sigma) - xi) / self(sigma, 1), 0.0, 1.0)
        return sigma


@lru_cache(maxsize=64)
def _slope_powers(smoothness: int, order: int) -> Array:
    """Return the coefficients of a derivative of phi, by powers of sigma.

    Its order is at least 1. phi' is b(sigma) over the integral of b, where b = (sigma (1 -
    sigma))^smoothness.
    """
    bump = polynomial.polypow([0.0, 1.0, -1.0], smoothness)
    integral = polynomial.polyint(bump)
    slope = bump / polynomial.polyval(1.0, integral)
    return np.asarray(polynomial.polyder(slope, order - 1), dtype=float)


@dataclass(frozen=True, eq=False)
class OptimalLaw(ReadOnlyArrays, PlannedLaw):
    """The law s = phi(sigma(t)) with z = (d sigma/dt)^2 a spline, or one Chebyshev series, in xi(sigma).

    `coefficients` (n,) [1/s^2] of z multiply the functions of `SpeedBasis` on `cells` (k + 1,) of xi.
    `dense_at` are the places in sigma where xi(sigma) is steeper (see `Stretch`). The first `smoothness`
    derivatives of s vanish at both ends. `duration` [s] is the integral of dt/d sigma = z^(-1/2) over [0, 1],
    computed unless given.

    Raises:
        InvalidInput: cells and coefficients do not fit, or the squared speed is not positive everywhere, or
            so nearly zero that time is not resolved.
    """

    coefficients: Array
    smoothness: int
    duration: float = 0.0  # [s]; if given, right up to rounding
    dense_at: tuple[float, ...] = ()
    cells: tuple[float, ...] = ONE_CELL

    kind: ClassVar[str] = "optimal"

    def __post_init__(self) -> None:
        """Check cells, z > 0, and the duration: the integral of 1 / sqrt(z) over sigma [s]."""
        super().__post_init__()
        object.__setattr__(self, "dense_at", tuple(map(float, self.dense_at)))
        object.__setattr__(self, "cells", tuple(map(float, self.cells)))
        _check_cells(self)
        if not np.all(np.isfinite(self.coefficients)) or least_value(self.series) <= 0:
            raise InvalidInput("law: the squared speed of an optimal law must be positive on all of [0, 1]")
        integral = float(self._time[1][-1])
        object.__setattr__(self, "duration", self.duration or integral)
        if not abs(integral - self.duration) <= DURATION_MISMATCH * self.duration:
            raise InvalidInput(f"law: its speed takes {integral!r} s, not {self.duration!r} s")

    @cached_property
    def basis(self) -> SpeedBasis:
        """The functions of xi in which the squared speed is written."""
        return SpeedBasis(np.array(self.cells), len(self.coefficients))

    @cached_property
    def series(self) -> Array:
        """Chebyshev series (k, degree + 1) [1/s^2] of the squared speed on the cells."""
        return read_only(self.basis.series(self.coefficients))

    @property
    def degree(self) -> int:
        """The degree of the squared speed on a cell."""
        return self.basis.degree

    @cached_property
    def phi(self) -> Smoothstep:
        return Smoothstep(self.smoothness)

    @cached_property
    def stretch(self) -> Stretch:
        return Stretch(self.dense_at)

    @cached_property
    def _time(self) -> tuple[TimeFunction, Array]:
        """Time as a function of sigma on panels, and the instants of their edges [s].

        The function counts from the start of its panel; instants are (panels + 1,). t(sigma) is their sum:
        the integral of dt/d sigma. It is scaled to end at `duration` to the last bit.
        """
        slowness = slowness_on_panels(np.array(self.cells), self.series, self.stretch)
        half_widths = 0.5 * np.diff(slowness.edges)[:, None, None]
        series = chebyshev.chebint(slowness.coefficients, lbnd=-1, axis=1) * half_widths
        instants = np.concatenate(([0.0], np.cumsum(series.sum(axis=1)[:, 0])))
        if abs(instants[-1] - self.duration) <= DURATION_MISMATCH * self.duration:
            correction = self.duration / instants[-1]
            series = series * correction
            instants = instants * correction
        return TimeFunction(slowness.edges, series), read_only(instants)

    def squared_speed(self, sigma: ArrayLike, order: int = 0) -> Array:
        """Evaluate z = (d sigma/dt)^2 [1/s^2] or its derivative in sigma up to order 3.

        With primes for d/d sigma and z_k for derivatives of z in xi, the chain rule gives z' = z_1 xi',
        z" = z_2 xi'^2 + z_1 xi" and z'" = z_3 xi'^3 + 3 z_2 xi' xi" + z_1 xi'".
        """
        xi = self.stretch(sigma)
        cells = np.array(self.cells)
        if order == 0:
            return evaluate_on_cells(cells, self.series, xi)
        z = {k: evaluate_on_cells(cells, self.series, xi, k) for k in range(1, order + 1)}
        dxi = {k: self.stretch(sigma, k) for k in range(1, order + 1)}
        if order == 1:
            return z[1] * dxi[1]
        if order == 2:
            return z[2] * dxi[1] ** 2 + z[1] * dxi[2]
        return z[3] * dxi[1] ** 3 + 3 * z[2] * dxi[1] * dxi[2] + z[1] * dxi[3]

    def time(self, sigma: ArrayLike) -> Array:
        """Compute the instant t [s] of parameters sigma, with the shape of sigma.

        It is the instant of the panel's start plus the time since then; at sigma = 1 the duration itself.
        """
        time_in_panel, instants = self._time
        flat = np.atleast_1d(np.asarray(sigma, dtype=float))
        panel = np.searchsorted(time_in_panel.edges[1:-1], flat, side="right")  # of each sigma
        t = np.where(flat < 1.0, instants[panel] + time_in_panel(flat)[:, 0], self.duration)
        return t.reshape(np.shape(sigma))

    def parameter(self, t: ArrayLike) -> Array:
        """Compute sigma at the instants t [s].

        Newton's method inverts t(sigma) to rounding in its panel.

        Raises:
            InvalidInput: t lies outside [0, duration], or is not finite.
        """
        times = np.asarray(t, dtype=float)
        if not np.all(np.abs(2.0 * times / self.duration - 1.0) <= 1.0 + SAME_PLACE):
            raise InvalidInput(f"time {t!r} is outside [0, {self.duration:g}] s")
        flat = np.clip(np.atleast_1d(times).ravel(), 0.0, self.duration)
        return _invert_time(self, flat.tobytes()).reshape(times.shape)

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Evaluate s(t) or its derivative [1/s^order] up to order 4, with the shape of t.

        Raises:
            InvalidInput: t lies outside [0, duration], or the order is above 4.
        """
        check_order(order, HIGHEST_ORDER)
        return self.evaluate_at(self.parameter(t), order)

    def derivatives(self, t: ArrayLike, count: int) -> list[Array]:
        sigma = self.parameter(t)
        return [self.evaluate_at(sigma, order) for order in range(count)]

    def evaluate_at(self, sigma: ArrayLike, order: int = 0) -> Array:
        """Evaluate s or its time derivative [1/s^order], up to order 4, where the parameter is sigma.

        With primes for d/d sigma, d/dt = sqrt(z) d/d sigma and u = z'/2:
        ds/dt = phi' sqrt(z), d2s/dt2 = phi' u + phi" z, d3s/dt3 = sqrt(z) J with
        J = phi' u' + 3 phi" u + phi'" z, and d4s/dt4 = u J + z J'.
        """
        phi = [self.phi(sigma, k) for k in range(order + 1)]
        if order == 0:
            return phi[0]
        z = self.squared_speed(sigma)
        if order == 1:
            return phi[1] * np.sqrt(z)
        u = [0.5 * self.squared_speed(sigma, k) for k in range(1, order)]
        if order == 2:
            return phi[1] * u[0] + phi[2] * z
        J = phi[1] * u[1] + 3 * phi[2] * u[0] + phi[3] * z
        if order == 3:
            return np.sqrt(z) * J
        dJ = phi[1] * u[2] + 4 * phi[2] * u[1] + 5 * phi[3] * u[0] + phi[4] * z
        return u[0] * J + z * dJ

    @property
    def edges(self) -> Array:
        """Instants (k,) [s] between which s(t) is resolved by some twenty points."""
        xi = np.array(self.cells)
        if not self.basis.is_spline:
            xi = nodes(max(self.degree // DEGREES_PER_PANEL, 1) + 1)
        inner = self.time(self.stretch.inverse(xi[1:-1]))
        return np.concatenate(([0.0], inner, [self.duration]))

    def advance(self, smoothness: int) -> float:
        """Return the least z over its mean in xi.

        It is positive, so that s' > 0 between the ends.
        """
        # the integral of a cell over xi is that over its local coordinate in [-1, 1] times half its width
        local_integrals = chebyshev.chebint(self.series, lbnd=-1, axis=1).sum(axis=1)
        integral = 0.5 * np.diff(self.cells) @ local_integrals
        mean = float(0.5 * integral)  # [-1, 1] has the length 2
        return least_value(self.series) / mean

    @cached_property
    def turns(self) -> int:
        """Number of changes of s' between rising and falling.

        Swings below 1e-3 of the largest s' do not count.
        """
        sigma = self.stretch.inverse(np.linspace(-1.0, 1.0, TURN_SAMPLES))
        return count_reversals(self.phi(sigma, 1) * np.sqrt(self.squared_speed(sigma)))

    def to_dict(self) -> dict[str, Any]:
        """Return the entry `law` of plan.json."""
        return {
            "kind": self.kind,
            "smoothness": self.smoothness,
            "degree": self.degree,
            "squared_speed": self.coefficients.tolist(),
            "cells": list(self.cells),
            "dense_at": list(self.dense_at),
            "turns": self.turns,
            "domain": [0.0, self.duration],
        }


@lru_cache(maxsize=16)  # s and its derivatives are evaluated one after the other at the same instants
def _invert_time(law: OptimalLaw, instants: bytes) -> Array:
    """Solve t(sigma) = t for sigma (T,) at instants t (T,) [s].

    The instants are given as bytes, for the cache. Newton's method for x in [-1, 1], the place in the panel:
    sigma = start + width (x + 1) / 2.
    """
    t = np.frombuffer(instants)
    time_in_panel, panel_starts = law._time
    panel = np.searchsorted(panel_starts[1:-1], t, side="right")
    start = time_in_panel.edges[panel]
    width = np.diff(time_in_panel.edges)[panel]
    time = t - panel_starts[panel]  # since the start of the panel
    series = time_in_panel.coefficients[panel, :, 0]  # (T, PANEL_NODES + 1)
    x = np.clip(2.0 * time / np.diff(panel_starts)[panel] - 1.0, -1.0, 1.0)
    for _ in range(12):
        residual = time - _evaluate_each(x, series)
        slowness = law.squared_speed(start + 0.5 * width * (x + 1.0)) ** -0.5  # dt/d sigma
        step = residual / (0.5 * width * slowness)
        x = np.clip(x + step, -1.0, 1.0)
        if np.abs(step).max(initial=0.0) < NEWTON_STEP:
            break
    return read_only(start + 0.5 * width * (x + 1.0))


def _check_cells(law: OptimalLaw) -> None:
    """Raise InvalidInput unless cells and coefficients of a law fit each other."""
    cells = np.array(law.cells)
    count = len(law.coefficients)
    if len(cells) < 2 or (cells[0], cells[-1]) != ONE_CELL or not np.all(np.diff(cells) > 0):
        raise InvalidInput("law: cells must ascend from -1 to 1")
    if not count or (len(cells) > 2 and count != len(cells) - 1 + SPLINE_DEGREE):
        raise InvalidInput(
            f"law: {len(cells) - 1} cells need {len(cells) - 1 + SPLINE_DEGREE} coefficients, got {count}"
        )


def evaluate_on_cells(cells: Array, series: Array, xi: ArrayLike, order: int = 0) -> Array:
    """Evaluate a function, or its derivative in xi, given by Chebyshev series (k, size) on cells (k + 1,).

    Points (...) of xi belong to the cell on their right, the last one to the last cell.
    """
    xi = np.asarray(xi, dtype=float)
    flat = xi.ravel()  # (T,)
    cell = np.searchsorted(cells[1:-1], flat, side="right")
    half_widths = 0.5 * np.diff(cells)
    local = np.clip((flat - cells[cell]) / half_widths[cell] - 1.0, -1.0, 1.0)  # in [-1, 1] on its cell
    derivative = series @ derivative_matrix(series.shape[1], order).T / half_widths[:, None] ** order
    if len(cells) == 2:
        return evaluate(local, derivative[0]).reshape(xi.shape)
    return _evaluate_each(local, derivative[cell]).reshape(xi.shape)


def _evaluate_each(x: Array, series: Array) -> Array:
    """Evaluate T Chebyshev series (T, size), each at its own x (T,): T_k(x) = cos(k arccos x)."""
    polynomials = np.cos(np.arccos(x)[:, None] * np.arange(series.shape[1]))
    return np.einsum("tk,tk->t", polynomials, series)


def slowness_on_panels(cells: Array, z_series: Array, stretch: Stretch) -> TimeFunction:
    """Resolve dt/d sigma = z(xi(sigma))^(-1/2) [s] on panels that are halved until each is accurate.

    z is given by Chebyshev series (k, size) on cells of xi. A panel is accurate if the truncation error of
    its time is below a share of the duration, or below the error that rounding eps of z makes: eps z^(-3/2)
    / 2, which grows where z is near zero.

    Raises:
        InvalidInput: z is not positive, or so near zero that time cannot be resolved.
    """
    z_rounding = float(np.finfo(float).eps * np.abs(z_series).sum(axis=1).max())
    edges = stretch.inverse(cells if len(cells) > 2 else nodes(5))  # of one polynomial: begin with 4 panels
    edges[[0, -1]] = 0.0, 1.0
    while len(edges) <= MAX_PANELS:
        grid = TimeGrid(edges, PANEL_NODES)
        widths = np.diff(edges)
        z = evaluate_on_cells(cells, z_series, stretch(grid.times))
        if not z.min() > 0:
            break
        slowness = grid.fit(z[:, None] ** -0.5)
        series = slowness.coefficients[:, :, 0]  # (panels, PANEL_NODES)
        duration = series[:, 0] @ widths  # by the mean of each panel
        truncation = np.abs(series[:, -2:]).max(axis=1) * widths  # errors of the time of each panel
        rounding = 0.5 * z_rounding * z.reshape(-1, PANEL_NODES).min(axis=1) ** -1.5 * widths
        is_coarse = truncation > np.maximum(SLOWNESS_TAIL * duration, rounding)
        if not is_coarse.any():
            if rounding.sum() > SLOWNESS_ROUNDING * duration:
                break
            return slowness
        middles = 0.5 * (edges[:-1] + edges[1:])[is_coarse]
        edges = np.sort(np.concatenate([edges, middles]))
    raise InvalidInput("law: the speed of an optimal law comes too near to zero to be resolved")


def least_value(series: Array) -> float:
    """Compute the least value on [-1, 1] of all Chebyshev series (k, size).

    Extrema are computed only for series whose lower bound, c_0 minus the sum of the other |c_k|, is below the
    least value at the ends.
    """
    ends = np.minimum(series.sum(axis=1), series @ (-1.0) ** np.arange(series.shape[1]))
    lower_bounds = 2.0 * series[:, 0] - np.abs(series).sum(axis=1)
    candidates = np.flatnonzero(lower_bounds < ends.min())
    inner = [evaluate(extrema(series[k]), series[k]).min(initial=np.inf) for k in candidates]
    return float(min([ends.min(), *inner]))


def count_reversals(speed: Array) -> int:
    """Count the changes of samples (T,) between rising and falling.

    Swings below 1e-3 of the largest sample do not count.
    """
    reversals = 0
    sign = 1.0  # of the current swing: 1 if rising
    extreme = speed[0]  # largest value of a rising swing, least of a falling one
    for value in speed:
        if (value - extreme) * sign > 0:
            extreme = value
        elif abs(value - extreme) > MIN_SWING * speed.max():
            reversals += 1
            sign = -sign
            extreme = value
    return reversals
