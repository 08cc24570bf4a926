"""The parameter p in which functions along a law, such as deflections, are Chebyshev series.

Functions along a law are smooth in p. For a polynomial law p is time itself. For an optimal law
s = phi(sigma(t)), p is xi(sigma), in which the squared speed is a Chebyshev series.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from framework.laws.law import MotionLaw
from framework.laws.optimal_law import OptimalLaw
from framework.numerics.arrays import Array


@dataclass(frozen=True, eq=False)
class InTime:
    """A law with time as its parameter p, on panels between `edges` (panels + 1,) [s]."""

    law: MotionLaw
    edges: Array

    def motion(self, p: Array) -> tuple[list[Array], Array, Array]:
        """Compute s, ds/dt, d2s/dt2 at p (T,), and dp/dt = 1, d2p/dt2 = 0."""
        return [np.asarray(self.law(p, order)) for order in range(3)], np.ones(len(p)), np.zeros(len(p))

    def parameter(self, t: Array) -> Array:
        """Return p (T,) at instants t (T,) [s]: the instants themselves."""
        return t


@dataclass(frozen=True, eq=False)
class OnParameter:
    """An optimal law with xi(sigma) as its parameter p; `knots` (k,) of the path are values of s."""

    law: OptimalLaw
    knots: Array

    @cached_property
    def edges(self) -> Array:
        """Panel edges (panels + 1,) in xi: both ends and the knots of the path."""
        return np.concatenate([[-1.0], self.law.stretch(self.law.phi.inverse(self.knots)), [1.0]])

    def motion(self, p: Array) -> tuple[list[Array], Array, Array]:
        """Compute s, ds/dt, d2s/dt2, and dp/dt, d2p/dt2, at p (T,).

        With p = xi(sigma), z = (d sigma/dt)^2, u = z'/2 and primes for d/d sigma, dp/dt = xi' sqrt(z) and
        d2p/dt2 = xi" z + xi' u.
        """
        sigma = self.law.stretch.inverse(p)
        return self.motion_at(p, self.law.squared_speed(sigma), 0.5 * self.law.squared_speed(sigma, 1))

    def motion_at(self, p: Array, z: Array | float, u: Array | float) -> tuple[list[Array], Array, Array]:
        """Compute `motion` at p (T,) from given z and u instead of the law's own."""
        sigma = self.law.stretch.inverse(p)
        speed = np.sqrt(z)  # d sigma/dt
        phi, dphi, ddphi = (self.law.phi(sigma, order) for order in range(3))  # derivatives in sigma
        dxi = self.law.stretch(sigma, 1)
        ddxi = self.law.stretch(sigma, 2)
        return [phi, dphi * speed, ddphi * z + dphi * u], dxi * speed, ddxi * z + dxi * u

    def parameter(self, t: Array) -> Array:
        """Compute xi at instants t (T,) [s]."""
        return self.law.stretch(self.law.parameter(t))


Clock = InTime | OnParameter  # a law with its parameter p, on panels between `edges` (panels + 1,) of p
