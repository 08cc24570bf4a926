"""The motion law of free shape s(t), represented by the squared speed z of a parameter sigma.

    s = phi(sigma),    z(sigma) = (d sigma/dt)^2,    u = z'/2          (prime: d/d sigma)

The first R derivatives of the smoothstep phi vanish at the ends sigma = 0 and 1 that are at rest, so for any
z > 0 the first R time derivatives of s vanish there. At an end in motion phi' is positive. z is a spline or
one polynomial in xi(sigma), see `squared_speed`. The map xi is steep where the law changes fast, for example
near a crossing, which the robot approaches slowly and leaves fast. Torques depend on the law through
(ds/dt)^2 = phi'^2 z and d2s/dt2 = phi' u + phi" z, which are linear in z.

Functions along a law, such as deflections, are Chebyshev series in the parameter p of a `Clock`: time itself
for a polynomial law, xi(sigma) for an optimal law.

The squared speed as the unknown is from Verscheure, Demeulenaere, Swevers, De Schutter and Diehl,
Time-optimal path tracking for robots: a convex optimization approach, IEEE TAC 54 (2009).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.polynomial import chebyshev, polynomial

from framework.errors import InvalidInput, check_order, real_numbers
from framework.laws.law import (
    REST,
    Ends,
    MotionLaw,
    PlannedLaw,
    compose_derivatives,
    least_value,
    normalise_time,
)
from framework.laws.path import HIGHEST_ORDER
from framework.laws.squared_speed import (
    ONE_CELL,
    SPLINE_DEGREE,
    SpeedBasis,
    Stretch,
    evaluate_each,
    evaluate_on_cells,
    slowness_on_panels,
)
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays, read_only
from framework.numerics.chebyshev import TimeFunction, nodes
from framework.tolerances import NEWTON_STEP

HIGHEST_SMOOTHNESS = 6  # above it z grows so much towards the ends that it loses its digits
# number of samples of s' in which reversals are counted; least swing of s' that counts, over its largest
# value
TURN_SAMPLES, MIN_SWING = 4001, 1e-3
DEGREES_PER_PANEL = 3  # a law with one polynomial z of degree d has d / 3 panels in time
DURATION_MISMATCH = 1e-12  # relative error allowed of a duration that is given with its squared speed


@dataclass(frozen=True)
class Smoothstep:
    """phi(sigma) from 0 to 1 on [0, 1], with phi' proportional to sigma^a (1 - sigma)^b.

    phi is the regularised incomplete beta function with the parameters a + 1 and b + 1; b is a if not given.
    `Smoothstep(0)` is the identity, s = sigma.
    """

    a: int
    b: int | None = None

    @property
    def zeros(self) -> tuple[int, int]:
        """The orders (a, b) of the zeros of phi' at both ends."""
        return self.a, self.a if self.b is None else self.b

    def __call__(self, sigma: ArrayLike, order: int = 0) -> Array:
        """Evaluate phi or its derivative of an order, with the shape of sigma.

        Derivatives are polynomials in the distance to the nearer end, which is accurate near both ends. In
        the distance to the goal, a and b are exchanged and derivatives of even order have the opposite sign.
        """
        a, b = self.zeros
        sigma = np.asarray(sigma, dtype=float)
        if order == 0:
            from scipy.special import betainc  # slow to import, and not all plans need it

            return betainc(a + 1, b + 1, sigma)
        by_start = polynomial.polyval(sigma, _slope_powers(a, b, order))
        by_goal = (-1.0) ** (order + 1) * polynomial.polyval(1.0 - sigma, _slope_powers(b, a, order))
        return np.where(sigma > 0.5, by_goal, by_start)

    def inverse(self, s: ArrayLike) -> Array:
        """Solve phi(sigma) = s for sigma, with the shape of s."""
        from scipy.special import betaincinv

        a, b = self.zeros
        return betaincinv(a + 1, b + 1, s)


@lru_cache(maxsize=64)
def _slope_powers(a: int, b: int, order: int) -> Array:
    """Return the coefficients (k,) of the powers of sigma in a derivative of phi of order >= 1.

    phi' is sigma^a (1 - sigma)^b divided by its integral on [0, 1].
    """
    bump = polynomial.polymul(polynomial.polypow([0.0, 1.0], a), polynomial.polypow([1.0, -1.0], b))
    integral = polynomial.polyint(bump)
    slope = bump / polynomial.polyval(1.0, integral)
    return np.asarray(polynomial.polyder(slope, order - 1))


@dataclass(frozen=True, eq=False)
class OptimalLaw(ReadOnlyArrays, PlannedLaw):
    """The law s = phi(sigma(t)), with z = (d sigma/dt)^2 a spline or Chebyshev series in xi(sigma).

    `coefficients` (n,) [1/s^2] multiply the functions of a `SpeedBasis` on `cells` (k + 1,) of xi. xi(sigma)
    is steeper near the values `dense_at` of sigma (see `Stretch`). The first `smoothness` derivatives of s
    vanish at both ends, except at those that are `moving` (start, goal). `duration` [s] is the integral of
    dt/d sigma = z^(-1/2) over [0, 1], computed unless given.

    Raises:
        InvalidInput: cells and coefficients do not fit each other; z is not positive everywhere, or so nearly
            zero that time is not resolved; or a given duration differs from the integral.
    """

    coefficients: Array
    smoothness: int
    duration: float = 0.0  # [s]; if given, right up to rounding
    dense_at: tuple[float, ...] = ()
    cells: tuple[float, ...] = ONE_CELL
    moving: tuple[bool, bool] = (False, False)

    kind: ClassVar[str] = "optimal"

    def __post_init__(self) -> None:
        """Check cells, z and the duration; compute the duration unless given."""
        super().__post_init__()
        for name in ("dense_at", "cells"):
            object.__setattr__(self, name, tuple(map(float, getattr(self, name))))
        cells = self.cells
        count = len(self.coefficients)
        if len(cells) < 2 or (cells[0], cells[-1]) != ONE_CELL or not np.all(np.diff(cells) > 0):
            raise InvalidInput("law: cells must ascend from -1 to 1")
        spline_count = len(cells) - 1 + SPLINE_DEGREE
        # on a single cell z is one series, with any number of coefficients
        if not count or (len(cells) > 2 and count != spline_count):
            raise InvalidInput(f"law: {len(cells) - 1} cells need {spline_count} coefficients, got {count}")
        if not np.all(np.isfinite(self.coefficients)) or least_value(self.series) <= 0:
            raise InvalidInput("law: the squared speed of an optimal law must be positive on all of [0, 1]")
        _time_in_panel, instants = self._time
        integral = float(instants[-1])
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
        """The map from sigma to s."""
        a, b = (0 if is_moving else self.smoothness for is_moving in self.moving)
        return Smoothstep(a, b)

    @cached_property
    def stretch(self) -> Stretch:
        """The map from sigma to xi."""
        return Stretch(self.dense_at)

    @cached_property
    def _time(self) -> tuple[TimeFunction, Array]:
        """Time [s] since the start of each panel of sigma, and instants (panels + 1,) [s] of the edges.

        The instant t(sigma) is the integral of dt/d sigma: the instant at which the panel of sigma starts,
        plus the time since then. With a known duration both parts are scaled so that the last instant is
        exactly `duration`.
        """
        slowness = slowness_on_panels(self.basis.cells, self.series, self.stretch)
        half_widths = 0.5 * np.diff(slowness.edges)[:, None, None]
        # time in each panel, (panels, PANEL_NODES + 1, 1): the integral of the slowness, 0 at the start
        series = chebyshev.chebint(slowness.coefficients, lbnd=-1, axis=1) * half_widths
        panel_durations = series.sum(axis=1)[:, 0]  # values at the end, where all T_k are 1
        instants = np.concatenate(([0.0], np.cumsum(panel_durations)))
        if abs(instants[-1] - self.duration) <= DURATION_MISMATCH * self.duration:
            correction = self.duration / instants[-1]
            series = series * correction
            instants = instants * correction
        return TimeFunction(slowness.edges, series), read_only(instants)

    def squared_speed(self, sigma: ArrayLike, order: int = 0) -> Array:
        """Evaluate z(xi(sigma)) [1/s^2] or its derivative by sigma, with the shape of sigma."""
        xi, *xi_derivatives = (self.stretch(sigma, k) for k in range(order + 1))  # by sigma
        z_by_xi = [evaluate_on_cells(self.basis.cells, self.series, xi, k) for k in range(order + 1)]
        return compose_derivatives(z_by_xi, xi_derivatives)[order]

    def time(self, sigma: ArrayLike) -> Array:
        """Compute the instants t [s] of parameters sigma, with the shape of sigma.

        At sigma = 1 this is exactly the duration.
        """
        time_in_panel, instants = self._time
        flat = np.atleast_1d(np.asarray(sigma, dtype=float))
        panel = np.searchsorted(time_in_panel.edges[1:-1], flat, side="right")  # (T,) index
        t = np.where(flat < 1.0, instants[panel] + time_in_panel(flat)[:, 0], self.duration)
        return t.reshape(np.shape(sigma))

    def parameter(self, t: ArrayLike) -> Array:
        """Solve t(sigma) = t for sigma at instants t [s], with the shape of t.

        Raises:
            InvalidInput: t lies outside [0, duration], or is not finite.
        """
        normalise_time(t, self.duration)  # refuses t outside [0, duration]
        times = np.clip(real_numbers("t", t), 0.0, self.duration)
        return _invert_time(self, times.tobytes()).reshape(times.shape)

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Evaluate s(t) or its derivative [1/s^order] up to order 4, with the shape of t.

        Raises:
            InvalidInput: t lies outside [0, duration], or the order is above 4.
        """
        check_order(order, HIGHEST_ORDER)
        return self.derivatives(t, order + 1)[order]

    def derivatives(self, t: ArrayLike, count: int) -> list[Array]:
        """Compute s = phi(sigma(t)) and its derivatives of orders below `count`, each shaped like t.

        With primes for d/d sigma and u = z'/2, the time derivatives of sigma are sqrt(z), u(sigma(t)), and
        those of u.
        """
        sigma = self.parameter(t)
        phi_by_sigma = [self.phi(sigma, order) for order in range(count)]
        sigma_rates: list[Array] = []
        u_by_sigma: list[Array] = []
        for order in range(count - 1):
            z = self.squared_speed(sigma, order)  # its derivative by sigma
            if order == 0:
                sigma_rates.append(np.sqrt(z))
                continue
            u_by_sigma.append(0.5 * z)
            sigma_rates.append(compose_derivatives(u_by_sigma, sigma_rates[: order - 1])[order - 1])
        return compose_derivatives(phi_by_sigma, sigma_rates)

    @property
    def edges(self) -> Array:
        """Panel edges (k,) [s]; some twenty points resolve s(t) on each panel.

        They are the edges of the splines' cells, or Chebyshev points in xi for a single polynomial.
        """
        xi = self.basis.cells
        if not self.basis.is_spline:
            xi = nodes(max(self.degree // DEGREES_PER_PANEL, 1) + 1)
        inner = self.time(self.stretch.inverse(xi[1:-1]))
        return np.concatenate(([0.0], inner, [self.duration]))

    def least_speed_ratio(self, smoothness: int, ends: Ends = REST) -> float:
        """Return the least squared speed z divided by its mean over xi in [-1, 1].

        The result is positive, so s' > 0 between the ends. s' = phi' sqrt(z) has its zeros at the ends from
        phi', and z has none. So nothing has to be divided out, and the arguments are not used.
        """
        # (k,) integral over each cell's local coordinate in [-1, 1]: the value at 1, where all T_k are 1, of
        # the series that is 0 at -1
        local_integrals = chebyshev.chebint(self.series, lbnd=-1, axis=1).sum(axis=1)
        integral = 0.5 * np.diff(self.cells) @ local_integrals  # over xi, whose range has the length 2
        return least_value(self.series) / float(0.5 * integral)

    @cached_property
    def turns(self) -> int:
        """Number of changes of s' between rising and falling, see `count_reversals`."""
        sigma = self.stretch.inverse(np.linspace(-1.0, 1.0, TURN_SAMPLES))  # at equal distances in xi
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
            **({"moving": list(self.moving)} if any(self.moving) else {}),
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
    for _ in range(12):  # more steps than Newton's method needs from this guess
        residual = time - evaluate_each(x, series)
        slowness = law.squared_speed(start + half_width * (x + 1.0)) ** -0.5  # dt/d sigma
        step = residual / (half_width * slowness)
        x = np.clip(x + step, -1.0, 1.0)
        if np.abs(step).max(initial=0.0) < NEWTON_STEP:
            break
    return read_only(start + half_width * (x + 1.0))


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


@dataclass(frozen=True, eq=False)
class InTime:
    """A law with time as its parameter p, on panels between `edges` (panels + 1,) [s]."""

    law: MotionLaw
    edges: Array

    def motion(self, p: Array) -> tuple[list[Array], Array, Array]:
        """Compute [s, ds/dt, d2s/dt2] at p = t (T,), then dp/dt = 1 and d2p/dt2 = 0, (T,) each."""
        return [np.asarray(self.law(p, order)) for order in range(3)], np.ones(len(p)), np.zeros(len(p))

    def parameter(self, t: Array) -> Array:
        """Return p (T,) at instants t (T,) [s]: the instants themselves."""
        return t


@dataclass(frozen=True, eq=False)
class OnParameter:
    """An optimal law with xi(sigma) as its parameter p.

    The panels end at the `knots` (k,) of the path, which are values of s.
    """

    law: OptimalLaw
    knots: Array

    @cached_property
    def edges(self) -> Array:
        """Panel edges (panels + 1,) in xi: both ends and the knots of the path."""
        return np.concatenate([[-1.0], self.law.stretch(self.law.phi.inverse(self.knots)), [1.0]])

    def motion(self, p: Array) -> tuple[list[Array], Array, Array]:
        """Compute [s, ds/dt, d2s/dt2], then dp/dt and d2p/dt2, (T,) each, at p (T,).

        With p = xi(sigma), z = (d sigma/dt)^2, u = z'/2 and primes for d/d sigma, dp/dt = xi' sqrt(z) and
        d2p/dt2 = xi" z + xi' u.
        """
        sigma = self.law.stretch.inverse(p)
        z = self.law.squared_speed(sigma)
        u = 0.5 * self.law.squared_speed(sigma, 1)
        return self.motion_at(p, z, u)

    def motion_at(self, p: Array, z: Array | float, u: Array | float) -> tuple[list[Array], Array, Array]:
        """Compute [s, ds/dt, d2s/dt2], dp/dt and d2p/dt2 at p = xi (T,) with other z and u than the law's.

        z = (d sigma/dt)^2 and u = d2 sigma/dt2 [1/s^2] are values (T,) or one value for all p.
        """
        sigma = self.law.stretch.inverse(p)
        speed = np.sqrt(z)  # d sigma/dt
        phi, dphi, ddphi = (self.law.phi(sigma, order) for order in range(3))  # derivatives in sigma
        dxi = self.law.stretch(sigma, 1)
        ddxi = self.law.stretch(sigma, 2)
        s_motion = [phi, dphi * speed, ddphi * z + dphi * u]  # s and its time derivatives
        return s_motion, dxi * speed, ddxi * z + dxi * u

    def parameter(self, t: Array) -> Array:
        """Compute xi at instants t (T,) [s]."""
        return self.law.stretch(self.law.parameter(t))


Clock = InTime | OnParameter  # a law with its parameter p, on panels between `edges` (panels + 1,) of p
