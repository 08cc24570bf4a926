"""In which parameter what follows from a law is smooth, and how fast that parameter runs.

With a polynomial in time that is time itself; with an optimal law s = phi(sigma(t)) it is xi(sigma), in which
the squared speed is a Chebyshev series.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from framework.arrays import Array
from framework.motion.law import MotionLaw
from framework.motion.optimal_law import OptimalLaw


class Clock(Protocol):
    """A law with its parameter p, on panels between `edges` (panels + 1,) of p."""

    @property
    def law(self) -> MotionLaw: ...

    @property
    def edges(self) -> Array: ...

    def motion(self, p: Array) -> tuple[list[Array], Array, Array]:
        """s and two time derivatives, dp/dt and its own, at p (T,), each (T,)."""
        ...

    def at(self, t: Array) -> Array:
        """p at instants t (T,) [s]."""
        ...


@dataclass(frozen=True, eq=False)
class InTime:
    """A law whose parameter is time."""

    law: MotionLaw
    edges: Array

    def motion(self, p: Array) -> tuple[list[Array], Array, Array]:
        """s and two time derivatives at instants p (T,), and how time runs."""
        return [np.asarray(self.law(p, order)) for order in range(3)], np.ones(len(p)), np.zeros(len(p))

    def at(self, t: Array) -> Array:
        """The instants themselves."""
        return t


@dataclass(frozen=True, eq=False)
class OnParameter:
    """An optimal law whose parameter is xi(sigma); `knots` of the path (k,), as values of s."""

    law: OptimalLaw
    knots: Array

    @cached_property
    def edges(self) -> Array:
        """xi of the knots, and both ends."""
        inner = self.law.stretch(self.law.phi.inverse(self.knots)) if len(self.knots) else np.empty(0)
        return np.concatenate([[-1.0], inner, [1.0]])

    def motion(self, p: Array) -> tuple[list[Array], Array, Array]:
        """s and two time derivatives at p (T,), and dp/dt = xi' sqrt(z), d2p/dt2 = xi" z + xi' u."""
        law = self.law
        sigma = law.stretch.inverse(p)
        s = [law.at_parameter(sigma, order) for order in range(3)]
        z, u = law.squared_speed(sigma), 0.5 * law.squared_speed(sigma, 1)
        first, second = law.stretch(sigma, 1), law.stretch(sigma, 2)
        return s, np.asarray(first * np.sqrt(z)), np.asarray(second * z + first * u)

    def at(self, t: Array) -> Array:
        """xi at instants t (T,) [s]."""
        return self.law.stretch(self.law.parameter(t))
