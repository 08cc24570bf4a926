"""Extrema of g near zero: the path touches the locus, crosses it twice within a short stretch, or misses.

An extremum is polished on panels centred on it, and what rounding leaves of g there is measured by the same
panel: the last coefficients of its series. Whether the path touches, crosses twice or misses is decided
against that, and how far it can be decided is said in s.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from framework.arrays import Array
from framework.motion.chebyshev import coefficients, extrema, nodes
from framework.singularity.bordered_system import determinant, solve_near
from framework.singularity.piecewise_measure import PANEL_NODES
from framework.tolerances import MEASURE_ROUNDING

PANEL_HALF_WIDTH = 0.04  # of a panel about an extremum, in s; halved while rounding is not all that is left
MAX_HALVINGS = 5  # of that width
CENTRING_PASSES = 3  # each centres the panel on the extremum found on the last one
FIRST_BRACKET_STEP = 1e-10  # of the walks away from an extremum, in s; doubled


class Extremum(NamedTuple):
    """An extremum of g at s, with a series of g about s."""

    s: float
    g: float
    rounding: float  # to which g is known here
    start: float
    end: float
    series: Array  # (PANEL_NODES,) Chebyshev coefficients of g on [start, end]

    @property
    def is_touch(self) -> bool:
        """Whether g is zero here as far as can be known."""
        return abs(self.g) <= self.rounding

    def evaluate(self, s: Array) -> Array:
        """Compute g (T,) at s (T,) in [start, end]."""
        return np.asarray(chebyshev.chebval(2 * (s - self.start) / (self.end - self.start) - 1, self.series))

    def bracket(self, level: float) -> tuple[float, float]:
        """Return the nearest s on either side with |g| above a level, or the panel's ends."""
        lower, upper = (self._bracket(side, lambda g: np.abs(g) > level) for side in (-1, 1))
        return (
            self.start if lower is None else lower[1],
            self.end if upper is None else upper[1],
        )

    @property
    def changes_sign(self) -> bool:
        """Whether g has different signs on the two sides, where |g| is more than rounding."""
        lower, upper = self.evaluate(np.array(self.bracket(self.rounding)))
        return bool(lower * upper < 0)

    def roots(self) -> list[float]:
        """Find the roots beside an extremum that is no touch: two, one or none.

        At most one lies on each side; it is bracketed and bisected, to rounding of g.
        """
        roots = []
        for side in (-1, 1):
            bracket = self._bracket(side, lambda g: g * self.g < 0)
            if bracket is not None:
                inner, outer = bracket
                while (middle := 0.5 * (inner + outer)) not in (inner, outer):
                    same = self.evaluate(np.array([middle]))[0] * self.g > 0
                    inner, outer = (middle, outer) if same else (inner, middle)
                roots.append(middle)
        return roots

    def _bracket(self, side: int, test: Callable[[Array], NDArray[np.bool_]]) -> tuple[float, float] | None:
        """Find the first step to one side after which g passes the test: inner and outer end."""
        limit = self.end if side > 0 else self.start
        count = int(np.ceil(np.log2(max(abs(limit - self.s) / FIRST_BRACKET_STEP, 1.0)))) + 1
        distances = np.concatenate(([0.0], FIRST_BRACKET_STEP * 2.0 ** np.arange(count)))
        s = self.s + side * np.minimum(distances, abs(limit - self.s))
        k = np.flatnonzero(test(self.evaluate(s[1:])))
        return (float(s[k[0]]), float(s[k[0] + 1])) if len(k) else None


def extremum_near(
    matrices: Callable[[Array], Array],
    knots: Array,
    s: float,
    size: int,
    scalar: Callable[[Array], Array] = determinant,
) -> Extremum:
    """Find the extremum nearest to s of a scalar (T,) of G (T, size, size).

    On a panel without an extremum s itself is returned.

    Args:
        matrices: the matrices (T, n, n) at s (T,), smooth between the `knots`, of which 0 and 1 are two.
    """
    k = int(np.clip(np.searchsorted(knots, s, side="right"), 1, len(knots) - 1))
    width, narrowings, passes = PANEL_HALF_WIDTH, 0, 0
    while True:
        # not over a knot, where g is not smooth
        start, end = max(knots[k - 1], s - width), min(knots[k], s + width)
        local = start + 0.5 * (end - start) * (nodes(PANEL_NODES) + 1.0)
        stack = matrices(np.append(local, s))
        values = scalar(solve_near(stack, -1, size).G)
        series = coefficients(values[:-1, None])[:, 0]
        # a resolved series ends in rounding; one that is not ends in what it lacks
        rounding = max(float(np.abs(series[-PANEL_NODES // 3 :]).sum()), MEASURE_ROUNDING)
        turning = extrema(series)
        if not len(turning):
            return Extremum(s, float(values[-1]), rounding, start, end, series)
        centre = 2 * (s - start) / (end - start) - 1
        best = float(turning[np.argmin(np.abs(turning - centre))])
        s = start + 0.5 * (end - start) * (best + 1)
        passes += 1
        if passes < CENTRING_PASSES:
            continue
        if rounding > 10 * MEASURE_ROUNDING and narrowings < MAX_HALVINGS:
            width, narrowings = 0.5 * width, narrowings + 1
            continue
        return Extremum(s, float(chebyshev.chebval(best, series)), rounding, start, end, series)
