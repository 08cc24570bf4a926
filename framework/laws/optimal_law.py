"""The motion law of free shape s(t), represented by the squared speed z of a parameter sigma.

    s = phi(sigma),    z(sigma) = (d sigma/dt)^2,    u = z'/2          (prime: d/d sigma)

The first R derivatives of the smoothstep phi vanish at sigma = 0 and 1, so for any z > 0 the first R time
derivatives of s vanish at both ends. z is a spline or one polynomial (`speed_basis`) in xi(sigma). The map xi
is steep where the law changes fast, for example near a crossing, which the robot approaches slowly and leaves
fast. Torques depend on the law through (ds/dt)^2 = phi'^2 z and d2s/dt2 = phi' u + phi" z, which are linear
in z.

The squared speed as the unknown is from Verscheure, Demeulenaere, Swevers, De Schutter and Diehl,
Time-optimal path tracking for robots: a convex optimization approach, IEEE TAC 54 (2009).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import Any, ClassVar

import numpy as np
from numpy.polynomial import chebyshev, polynomial

from framework.errors import InvalidInput, check_order
from framework.laws.law import PlannedLaw, least_value, normalise_time
from framework.laws.path import HIGHEST_ORDER
from framework.laws.speed_basis import ONE_CELL, SPLINE_DEGREE, SpeedBasis
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays, read_only
from framework.numerics.chebyshev import TimeFunction, TimeGrid, derivative_matrix, evaluate, nodes
from framework.tolerances import NEWTON_STEP, SLOWNESS_ROUNDING

HIGHEST_SMOOTHNESS = 6  # above it z grows so much towards the ends that it loses its digits
# samples of s' along the path; least swing of s' over its largest value that counts
TURN_SAMPLES, MIN_SWING = 4001, 1e-3
PANEL_NODES = 24  # nodes on a panel of t(sigma)
SLOWNESS_TAIL = 1e-15  # truncation error of a panel's time over the duration
MAX_PANELS = 1024
DEGREES_PER_PANEL = 3  # degrees of z for each panel in time
STRETCH_WIDTH = 0.1  # in sigma, of the arctangent step about a point where z is resolved more finely
STRETCH_HEIGHT = 0.3  # of this step: in its middle points are 1 + height / width times as dense
DURATION_MISMATCH = 1e-12  # relative error allowed of a duration that is given with its squared speed


@dataclass(frozen=True)
class Smoothstep:
    """phi(sigma) from 0 to 1 on [0, 1] with phi' ~ (sigma (1 - sigma))^order.

    phi is the regularised incomplete beta function with both parameters equal to order + 1.
    """

    order: int

    def __call__(self, sigma: ArrayLike, order: int = 0) -> Array:
        """Evaluate phi or a derivative, with the shape of sigma.

        Derivatives are polynomials in the distance to the nearer end, which is accurate near both ends. phi'
        is symmetric about 1/2, so beyond 1/2 derivatives of even order have the opposite sign.
        """
        sigma = np.asarray(sigma, dtype=float)
        if order == 0:
            from scipy.special import betainc  # slow to import, and not all plans need it

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
    """The increasing map xi(sigma) from [0, 1] to [-1, 1], steeper near the points `at`.

    xi is sigma + h sum_k arctan((sigma - at_k) / w), scaled to end at -1 and 1, with w = STRETCH_WIDTH and
    h = STRETCH_HEIGHT. Through such a map a Chebyshev series resolves a function that changes fast near
    known points: Tee and Trefethen 2006, SIAM J. Sci. Comput. 28.
    """

    at: tuple[float, ...] = ()  # values of sigma

    def __call__(self, sigma: ArrayLike, order: int = 0) -> Array:
        """Evaluate xi or its derivative up to order 3, with the shape of sigma."""
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
        """Evaluate the map before scaling, or a derivative up to order 3.

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
        """Solve xi(sigma) = xi for sigma by Newton's method from a table."""
        xi = np.asarray(xi, dtype=float)
        grid = np.linspace(0.0, 1.0, 513)
        sigma = np.interp(xi, self(grid), grid)
        for _ in range(4):  # the table is right to a few digits, and each step doubles their number
            sigma = np.clip(sigma - (self(sigma) - xi) / self(sigma, 1), 0.0, 1.0)
        return sigma


@lru_cache(maxsize=64)
def _slope_powers(smoothness: int, order: int) -> Array:
    """Return the power series in sigma of a derivative of phi, order >= 1.

    phi' is b(sigma) over the integral of b on [0, 1], where b = (sigma (1 - sigma))^smoothness.
    """
    bump = polynomial.polypow([0.0, 1.0, -1.0], smoothness)
    integral = polynomial.polyint(bump)
    slope = bump / polynomial.polyval(1.0, integral)
    return np.asarray(polynomial.polyder(slope, order - 1))


@dataclass(frozen=True, eq=False)
class OptimalLaw(ReadOnlyArrays, PlannedLaw):
    """The law s = phi(sigma(t)), with z = (d sigma/dt)^2 a spline or Chebyshev series in xi(sigma).

    `coefficients` (n,) [1/s^2] multiply the functions of a `SpeedBasis` on `cells` (k + 1,) of xi. xi(sigma)
    is steeper near the values `dense_at` of sigma (see `Stretch`). The first `smoothness` derivatives of s
    vanish at both ends. `duration` [s] is the integral of dt/d sigma = z^(-1/2) over [0, 1], computed unless
    given.

    Raises:
        InvalidInput: cells and coefficients do not fit each other; z is not positive everywhere, or so nearly
            zero that time is not resolved; or a given duration differs from the integral.
    """

    coefficients: Array
    smoothness: int
    duration: float = 0.0  # [s]; if given, right up to rounding
    dense_at: tuple[float, ...] = ()
    cells: tuple[float, ...] = ONE_CELL

    kind: ClassVar[str] = "optimal"

    def __post_init__(self) -> None:
        """Check that cells fit, z is positive, and the duration is that of z."""
        super().__post_init__()
        for name in ("dense_at", "cells"):
            object.__setattr__(self, name, tuple(map(float, getattr(self, name))))
        _check_cells(self)
        if not np.all(np.isfinite(self.coefficients)) or least_value(self.series) <= 0:
            raise InvalidInput("law: the squared speed of an optimal law must be positive on all of [0, 1]")
        integral = float(self._time[1][-1])
        object.__setattr__(self, "duration", self.duration or integral)
        if not abs(integral - self.duration) <= DURATION_MISMATCH * self.duration:
            raise InvalidInput(f"law: its speed takes {integral!r} s, not {self.duration!r} s")

    @cached_property
    def basis(self) -> SpeedBasis:
        """The functions of xi whose combination is z."""
        return SpeedBasis(np.array(self.cells), len(self.coefficients))

    @cached_property
    def series(self) -> Array:
        """Chebyshev series (k, degree + 1) [1/s^2] of z on the cells."""
        return read_only(self.basis.series(self.coefficients))

    @property
    def degree(self) -> int:
        """The degree of z on a cell."""
        return self.basis.degree

    @cached_property
    def phi(self) -> Smoothstep:
        return Smoothstep(self.smoothness)

    @cached_property
    def stretch(self) -> Stretch:
        return Stretch(self.dense_at)

    @cached_property
    def _time(self) -> tuple[TimeFunction, Array]:
        """Time [s] since the start of each panel of sigma, and instants (panels + 1,) [s] of the edges.

        The instant t(sigma) is the integral of dt/d sigma: the instant at which the panel of sigma starts
        plus the time since then. Both parts are scaled so that the last instant is exactly `duration`.
        """
        slowness = slowness_on_panels(self.basis.cells, self.series, self.stretch)
        half_widths = 0.5 * np.diff(slowness.edges)[:, None, None]
        series = chebyshev.chebint(slowness.coefficients, lbnd=-1, axis=1) * half_widths  # 0 at the start
        panel_durations = series.sum(axis=1)[:, 0]  # values at the end, where all T_k are 1
        instants = np.concatenate(([0.0], np.cumsum(panel_durations)))
        if abs(instants[-1] - self.duration) <= DURATION_MISMATCH * self.duration:
            correction = self.duration / instants[-1]
            series = series * correction
            instants = instants * correction
        return TimeFunction(slowness.edges, series), read_only(instants)

    def squared_speed(self, sigma: ArrayLike, order: int = 0) -> Array:
        """Evaluate z [1/s^2] or its derivative in sigma up to order 3.

        By the chain rule, with derivatives z_k of z in xi and primes for d/d sigma: z' = z_1 xi',
        z" = z_2 xi'^2 + z_1 xi" and z'" = z_3 xi'^3 + 3 z_2 xi' xi" + z_1 xi'".
        """
        z = partial(evaluate_on_cells, self.basis.cells, self.series, self.stretch(sigma))
        if order == 0:
            return z(0)
        dxi = self.stretch(sigma, 1)
        if order == 1:
            return z(1) * dxi
        ddxi = self.stretch(sigma, 2)
        if order == 2:
            return z(2) * dxi**2 + z(1) * ddxi
        return z(3) * dxi**3 + 3 * z(2) * dxi * ddxi + z(1) * self.stretch(sigma, 3)

    def time(self, sigma: ArrayLike) -> Array:
        """Compute the instants t [s] of parameters sigma, with the shape of sigma.

        At sigma = 1 this is exactly the duration.
        """
        time_in_panel, instants = self._time
        flat = np.atleast_1d(np.asarray(sigma, dtype=float))
        panel = np.searchsorted(time_in_panel.edges[1:-1], flat, side="right")
        t = np.where(flat < 1.0, instants[panel] + time_in_panel(flat)[:, 0], self.duration)
        return t.reshape(np.shape(sigma))

    def parameter(self, t: ArrayLike) -> Array:
        """Solve t(sigma) = t for sigma at instants t [s], with the shape of t.

        Raises:
            InvalidInput: t lies outside [0, duration], or is not finite.
        """
        normalise_time(t, self.duration)  # refuses t outside [0, duration]
        times = np.clip(np.asarray(t, dtype=float), 0.0, self.duration)
        return _invert_time(self, times.tobytes()).reshape(times.shape)

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
        """Evaluate s(sigma) or its time derivative [1/s^order] up to order 4.

        With primes for d/d sigma, u = z'/2 and d/dt = sqrt(z) d/d sigma:
        ds/dt = phi' sqrt(z), d2s/dt2 = phi' u + phi" z, d3s/dt3 = sqrt(z) J with
        J = phi' u' + 3 phi" u + phi'" z, and d4s/dt4 = u J + z J'.
        """
        phi = [self.phi(sigma, k) for k in range(order + 1)]
        if order == 0:
            return phi[0]
        z = self.squared_speed(sigma)
        if order == 1:
            return phi[1] * np.sqrt(z)
        u = [0.5 * self.squared_speed(sigma, k) for k in range(1, order)]  # u, u', u"
        if order == 2:
            return phi[1] * u[0] + phi[2] * z
        J = phi[1] * u[1] + 3 * phi[2] * u[0] + phi[3] * z
        if order == 3:
            return np.sqrt(z) * J
        dJ = phi[1] * u[2] + 4 * phi[2] * u[1] + 5 * phi[3] * u[0] + phi[4] * z
        return u[0] * J + z * dJ

    @property
    def edges(self) -> Array:
        """Panel edges (k,) [s]; some twenty points resolve s(t) on each panel."""
        xi = self.basis.cells
        if not self.basis.is_spline:
            xi = nodes(max(self.degree // DEGREES_PER_PANEL, 1) + 1)
        inner = self.time(self.stretch.inverse(xi[1:-1]))
        return np.concatenate(([0.0], inner, [self.duration]))

    def advance(self, smoothness: int) -> float:
        """Return the least z divided by its mean over xi.

        The result is positive, so s' > 0 between the ends.
        """
        # integrals over the local coordinate of each cell, from -1 to 1, where all T_k are 1
        local_integrals = chebyshev.chebint(self.series, lbnd=-1, axis=1).sum(axis=1)
        integral = 0.5 * np.diff(self.cells) @ local_integrals
        return least_value(self.series) / float(0.5 * integral)  # xi has the range 2

    @cached_property
    def turns(self) -> int:
        """Number of changes of s' between rising and falling, see `count_reversals`."""
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

    The instants are passed as bytes, because the cache needs hashable arguments. On each panel Newton's
    method solves for the local coordinate x in [-1, 1], with sigma = start + half_width (x + 1).
    """
    t = np.frombuffer(instants)
    time_in_panel, edge_instants = law._time
    panel = np.searchsorted(edge_instants[1:-1], t, side="right")  # of each instant
    start = time_in_panel.edges[panel]
    half_width = 0.5 * np.diff(time_in_panel.edges)[panel]
    time = t - edge_instants[panel]  # since the start of the panel
    series = time_in_panel.coefficients[panel, :, 0]  # (T, PANEL_NODES + 1) Chebyshev series of time in x
    panel_duration = np.diff(edge_instants)[panel]
    x = np.clip(2.0 * time / panel_duration - 1.0, -1.0, 1.0)  # first guess: constant speed on the panel
    for _ in range(12):
        residual = time - _evaluate_each(x, series)
        slowness = law.squared_speed(start + half_width * (x + 1.0)) ** -0.5  # dt/d sigma
        step = residual / (half_width * slowness)
        x = np.clip(x + step, -1.0, 1.0)
        if np.abs(step).max(initial=0.0) < NEWTON_STEP:
            break
    return read_only(start + half_width * (x + 1.0))


def _check_cells(law: OptimalLaw) -> None:
    """Raise InvalidInput unless cells and coefficients of a law fit each other."""
    cells = law.cells
    count = len(law.coefficients)
    if len(cells) < 2 or (cells[0], cells[-1]) != ONE_CELL or not np.all(np.diff(cells) > 0):
        raise InvalidInput("law: cells must ascend from -1 to 1")
    spline_count = len(cells) - 1 + SPLINE_DEGREE
    if not count or (len(cells) > 2 and count != spline_count):
        raise InvalidInput(f"law: {len(cells) - 1} cells need {spline_count} coefficients, got {count}")


def evaluate_on_cells(cells: Array, series: Array, xi: ArrayLike, order: int = 0) -> Array:
    """Evaluate Chebyshev series (k, size) on cells (k + 1,) at xi (...), or a derivative.

    A point on an inner edge belongs to the cell on its right.
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
    return _evaluate_each(local, derivative[cell]).reshape(xi.shape)


def _evaluate_each(x: Array, series: Array) -> Array:
    """Evaluate T Chebyshev series (T, size), each at its own x (T,)."""
    polynomials = np.cos(np.arccos(x)[:, None] * np.arange(series.shape[1]))  # T_k(x) = cos(k arccos x)
    return np.einsum("tk,tk->t", polynomials, series)


def slowness_on_panels(cells: Array, z_series: Array, stretch: Stretch) -> TimeFunction:
    """Fit dt/d sigma = z(xi(sigma))^(-1/2) [s] on panels of sigma, halved until accurate.

    z is given by Chebyshev series `z_series` (k, size) on `cells` (k + 1,) of xi. A panel is accurate if the
    truncation error of its time is below a share of the duration, or below the rounding error. An error eps
    of z changes z^(-1/2) by eps z^(-3/2) / 2, so rounding errors grow where z is nearly zero.

    Raises:
        InvalidInput: z is not positive, or so near zero that rounding hides the duration.
    """
    z_rounding = np.finfo(float).eps * np.abs(z_series).sum(axis=1).max()
    edges = stretch.inverse(cells if len(cells) > 2 else nodes(5))  # one polynomial starts with 4 panels
    edges[[0, -1]] = 0.0, 1.0
    while len(edges) <= MAX_PANELS:
        grid = TimeGrid(edges, PANEL_NODES)
        widths = np.diff(edges)
        z = evaluate_on_cells(cells, z_series, stretch(grid.times))
        if not z.min() > 0:
            break
        slowness = grid.fit(z[:, None] ** -0.5)
        series = slowness.coefficients[:, :, 0]  # (panels, PANEL_NODES)
        duration = series[:, 0] @ widths  # the first coefficient estimates the mean on each panel
        last_coefficients = np.abs(series[:, -2:]).max(axis=1)  # estimate the truncated part
        truncation = last_coefficients * widths  # (panels,) errors of time [s]
        least_z = z.reshape(-1, PANEL_NODES).min(axis=1)
        rounding = 0.5 * z_rounding * least_z**-1.5 * widths  # (panels,) [s]
        is_coarse = truncation > np.maximum(SLOWNESS_TAIL * duration, rounding)
        if not is_coarse.any():
            if rounding.sum() > SLOWNESS_ROUNDING * duration:
                break
            return slowness
        middles = 0.5 * (edges[:-1] + edges[1:])[is_coarse]
        edges = np.sort(np.concatenate([edges, middles]))
    raise InvalidInput("law: the speed of an optimal law comes too near to zero to be resolved")


def count_reversals(speed: Array) -> int:
    """Count how often samples of a speed (T,) change between rising and falling.

    A change counts once the samples have moved back from the last extreme value by MIN_SWING times the
    largest sample.
    """
    reversals = 0
    sign = 1.0  # 1 while the samples rise, -1 while they fall
    extreme = speed[0]  # largest value since the samples began to rise, or least since they began to fall
    for value in speed:
        if (value - extreme) * sign > 0:
            extreme = value
        elif abs(value - extreme) > MIN_SWING * speed.max():
            reversals += 1
            sign = -sign
            extreme = value
    return reversals
