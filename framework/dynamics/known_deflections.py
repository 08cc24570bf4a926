"""Deflections as one Chebyshev series from knot to knot of the path."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from framework.laws.clock import Clock
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import derivative_matrix


class KnownDeflections(NamedTuple):
    """Deflections as functions of time, given by series in the parameter of a law."""

    clock: Clock
    series: Array  # (panels, N, n_e) [rad, m]

    def __call__(self, t: Array) -> tuple[Array, Array, Array]:
        """Compute deflections and two time derivatives at t (T,), each (T, n_e)."""
        edges, size = self.clock.edges, self.series.shape[1]
        p = np.clip(self.clock.parameter(t), edges[0], edges[-1])
        panel = np.clip(np.searchsorted(edges, p, side="right") - 1, 0, len(self.series) - 1)
        scale = 2.0 / np.diff(edges)[panel]  # dx/dp of the panel's variable x in [-1, 1]
        polynomials = chebyshev.chebvander(np.clip((p - edges[panel]) * scale - 1.0, -1.0, 1.0), size - 1)
        _, rate, acceleration = self.clock.motion(p)
        value, slope, bend = (  # derivatives by x
            np.einsum("tn,tne->te", polynomials, (derivative @ self.series)[panel])
            for derivative in (np.eye(size), derivative_matrix(size), derivative_matrix(size, 2))
        )
        dx, ddx = (scale * rate)[:, None], (scale * acceleration)[:, None]
        return value, slope * dx, bend * dx**2 + slope * ddx
