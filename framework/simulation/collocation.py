"""Tables of collocation methods: nodes and integration matrices, computed, not copied.

Radau IIA of s stages: nodes are the zeros of P_s(2c - 1) - P_{s-1}(2c - 1), the last one the end of the
step. Order 2s - 1 at the end of a step, s along it; free motions that a step does not resolve decay
(L-stable), and a coordinate without inertia is solved for, not integrated.
Source: Hairer and Wanner, Solving Ordinary Differential Equations II, Springer 1996, sections IV.5 and VI.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre

from framework.arrays import Array, ReadOnlyArrays


@dataclass(frozen=True, eq=False)
class Collocation(ReadOnlyArrays):
    """A table: `nodes` c (s,) in (0, 1], `once` A (s, s) and `twice` A A, and Legendre series of values."""

    nodes: Array
    once: Array  # integrals from 0 to each node of the polynomial through values at the nodes
    twice: Array
    series: Array  # (s, s) values at the nodes to Legendre coefficients on [0, 1]
    series_with_start: Array  # (s + 1, s + 1) the same with the value at 0 in front
    series_of_integral: Array  # (s + 1, s) values at the nodes to coefficients of their integral from 0

    @property
    def stages(self) -> int:
        return len(self.nodes)

    def basis(self, at: Array, degree: int | None = None) -> Array:
        """Legendre polynomials at points (T,) in [0, 1], (T, degree + 1); up to degree s by default."""
        return np.asarray(legendre.legvander(2 * at - 1, self.stages if degree is None else degree))


@lru_cache(maxsize=32)
def radau(stages: int) -> Collocation:
    """Radau IIA with that many stages."""
    from scipy.special import roots_jacobi

    inner = roots_jacobi(stages - 1, 1.0, 0.0)[0] if stages > 1 else np.empty(0)
    nodes = np.append((inner + 1) / 2, 1.0)
    series = np.linalg.inv(legendre.legvander(2 * nodes - 1, stages - 1))
    of_integral = legendre.legint(np.eye(stages), lbnd=-1, scl=0.5, axis=0) @ series
    once = legendre.legvander(2 * nodes - 1, stages) @ of_integral
    with_start = np.linalg.inv(legendre.legvander(2 * np.append(0.0, nodes) - 1, stages))
    return Collocation(nodes, once, once @ once, series, with_start, of_integral)
