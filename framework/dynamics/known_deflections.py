"""Deflections that are known as one Chebyshev series from knot to knot of the path."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from framework.laws.clock import Clock
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import derivative_matrix


class KnownDeflections(NamedTuple):
    """Deflections as functions of time, by their series along the parameter of a law."""

    clock: Clock
    series: Array  # (panels, N, n_e) [rad, m]

    def __call__(self, t: Array) -> tuple[Array, Array, Array]:
        """Compute deflections and two time derivatives at t (T,), each (T, n_e)."""
        edges, size = self.clock.edges, self.series.shape[1]
        p = np.clip(self.clock.parameter(t), edges[0], edges[-1])
        panel = np.clip(np.searchsorted(edges, p, side="right") - 1, 0, len(self.series) - 1)
        per = 2.0 / np.diff(edges)[panel]
        values = chebyshev.chebvander(np.clip((p - edges[panel]) * per - 1.0, -1.0, 1.0), size - 1)
        _, rate, acceleration = self.clock.motion(p)
        value, slope, bend = (
            np.einsum("tn,tne->te", values, (derivative @ self.series)[panel])
            for derivative in (np.eye(size), derivative_matrix(size), derivative_matrix(size, 2))
        )
        r, a = (per * rate)[:, None], (per * acceleration)[:, None]
        return value, slope * r, bend * r**2 + slope * a
