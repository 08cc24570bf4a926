"""Deflections as one Chebyshev series between two knots of the path."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.laws.optimal_law import Clock
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import TimeFunction


class KnownDeflections(NamedTuple):
    """Deflections as functions of time, represented by series in the parameter of a law."""

    clock: Clock
    series: Array  # (panels, N, n_e) [rad, m]

    def __call__(self, t: Array) -> tuple[Array, Array, Array]:
        """Compute deflections and two time derivatives at t (T,), each (T, n_e)."""
        edges = self.clock.edges
        p = np.clip(self.clock.parameter(t), edges[0], edges[-1])
        in_parameter = TimeFunction(edges, self.series)
        value, slope, bend = (in_parameter(p, order) for order in range(3))  # derivatives by p
        _, rate, acceleration = self.clock.motion(p)
        dp = rate[:, None]
        return value, slope * dp, bend * dp**2 + slope * acceleration[:, None]
