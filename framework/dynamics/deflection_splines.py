"""Deflections along a law as B-splines in the parameter of the law.

Splines of a high degree converge almost as fast as one Chebyshev series, and each overlaps only with its
neighbours. So the equations of balance are banded, and cells can be halved where deflections vary quickly.
The parameter p is the time of a polynomial law, and xi(sigma) of an optimal law.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from framework.laws.optimal_law import Clock
from framework.numerics.arrays import Array, BoolArray, IntArray, ReadOnlyArrays, read_only
from framework.numerics.splines import BandedFactor, Splines, banded_rows, find_intervals, spline_values

SPLINE_DEGREE = 13  # high, so that deflections which are smooth need few cells
NODES_PER_SPLINE = 2  # more equations than unknowns: the least squares choose smooth deflections at Type 2


class SplineNodes(NamedTuple):
    """Points at which the equations of balance are evaluated."""

    p: Array  # (T,) of the law's parameter
    cells: IntArray  # (T,) index of the cell
    columns: IntArray  # (T, SPLINE_DEGREE + 1) indices of the splines that are not zero
    bases: Array  # (3, T, SPLINE_DEGREE + 1) these splines and two derivatives by p


@dataclass(frozen=True, eq=False)
class DeflectionSplines(ReadOnlyArrays):
    """B-splines of a law's parameter p, smooth on panels between the knots of the path.

    A function is given by its coefficients (size, ...), one for each spline.
    """

    cells: Array  # (k + 1,) edges of the cells, on each of which a spline is a polynomial
    panels: Array  # (panels + 1,) edges of the panels, which are among those of the cells
    continuity: int  # highest derivative that does not jump between panels; -1 if functions jump

    @staticmethod
    def uniform(panels: Array, count: int, *, continuity: int) -> DeflectionSplines:
        """Divide panels with edges (panels + 1,) into about `count` cells of similar width."""
        shares = np.diff(panels) / (panels[-1] - panels[0])
        counts = np.ceil(count * shares).astype(int)
        starts = [
            np.linspace(start, end, n, endpoint=False)
            for start, end, n in zip(panels[:-1], panels[1:], counts, strict=True)
        ]
        return DeflectionSplines(np.append(np.concatenate(starts), panels[-1]), panels, continuity)

    def halve(self, chosen: BoolArray) -> DeflectionSplines:
        """Return splines with the chosen cells (k,) halved."""
        middles = 0.5 * (self.cells[1:] + self.cells[:-1])
        cells = np.sort(np.append(self.cells, middles[chosen]))
        return DeflectionSplines(cells, self.panels, self.continuity)

    @cached_property
    def knots(self) -> Array:
        """Knots (size + SPLINE_DEGREE + 1,): the cells' edges, repeated at edges of panels.

        At a knot that is repeated m times, derivatives of order SPLINE_DEGREE - m and less are continuous.
        """
        return read_only(self._repeat_edges(SPLINE_DEGREE - self.continuity))

    def _repeat_edges(self, at_joins: int) -> Array:
        """Repeat edges of cells: SPLINE_DEGREE + 1 times at both ends, `at_joins` times between panels.

        Other edges are not repeated. Edges of panels are among those of cells, without rounding.
        """
        repetitions = np.where(np.isin(self.cells, self.panels), at_joins, 1)  # (k + 1,)
        repetitions[[0, -1]] = SPLINE_DEGREE + 1
        return np.repeat(self.cells, repetitions)

    @property
    def size(self) -> int:
        """The number of splines, each of which spans SPLINE_DEGREE + 2 knots."""
        return len(self.knots) - SPLINE_DEGREE - 1

    @cached_property
    def intervals(self) -> IntArray:
        """Indices (k,) of the last knot at the start of each cell."""
        return np.flatnonzero(np.diff(self.knots) > 0.0)

    @cached_property
    def nodes(self) -> SplineNodes:
        """NODES_PER_SPLINE points for each spline, beside the mean of its inner knots (Greville abscissa).

        The points are those of splines that may jump between panels.
        """
        all_centres = Splines(self._repeat_edges(SPLINE_DEGREE + 1), SPLINE_DEGREE).centres
        first_cells = np.searchsorted(self.cells, self.panels)  # of the panels; the number of cells is last
        counts = np.diff(first_cells) + SPLINE_DEGREE  # splines on each panel
        centres = np.split(all_centres, np.cumsum(counts)[:-1])  # one array for each panel
        points = []  # NODES_PER_SPLINE - 1 evenly between two neighbouring centres
        for on_panel in centres:  # (k,) ascending
            position = np.arange(NODES_PER_SPLINE * (len(on_panel) - 1) + 1) / NODES_PER_SPLINE
            points.append(np.interp(position, np.arange(len(on_panel)), on_panel))
        # the cell of each point; a point on an edge of its panel stays in a cell of this panel
        cells = [
            np.clip(np.searchsorted(self.cells, p, side="right") - 1, first, following - 1)
            for p, first, following in zip(points, first_cells[:-1], first_cells[1:], strict=True)
        ]
        p = np.concatenate(points)  # (T,)
        cell_of_point = np.concatenate(cells)  # (T,)
        intervals = self.intervals[cell_of_point]
        return SplineNodes(p, cell_of_point, self.columns(intervals), self.bases(intervals, p))

    def columns(self, intervals: IntArray) -> IntArray:
        """Return indices (T, SPLINE_DEGREE + 1) of the splines that are not zero behind knots.

        `intervals` (T,) are the indices of these knots.
        """
        return intervals[:, None] + np.arange(-SPLINE_DEGREE, 1)

    def bases(self, intervals: IntArray, p: Array) -> Array:
        """Compute the splines that are not zero, and two derivatives by p: (3, T, SPLINE_DEGREE + 1).

        Args:
            intervals: (T,) indices of the knots that precede p.
            p: (T,) points.
        """
        return np.stack([spline_values(self.knots, SPLINE_DEGREE, intervals, p, k) for k in range(3)])

    def combine(self, bases: Array, series: Array) -> Array:
        """Evaluate functions with coefficients (size, ...) at the nodes: (T, ...).

        Args:
            bases: (T, SPLINE_DEGREE + 1) the splines that are not zero, or derivatives.
            series: (size, ...) coefficients.
        """
        return np.einsum("tj,tj...->t...", bases, series[self.nodes.columns])

    def fit(self, values: Array) -> Array:
        """Fit coefficients (size, c) to values (T, c) at the nodes, in the least squares.

        With the values of all splines at the nodes as rows B (T, size), the normal equations are
        B' B coefficients = B' values.
        """
        # of each row only the splines that are not zero are stored; `bases` has derivatives behind the values
        rows = banded_rows(self.nodes.bases[0][:, None], self.nodes.columns, self.size)
        return BandedFactor.factor_squares(rows, added=0.0).solve(rows.T @ values)

    def insert(self, other: DeflectionSplines, series: Array) -> Array:
        """Return the coefficients (size, c) of functions that are given on coarser cells.

        A new knot t in the interval k replaces c_i by a_i c_i + (1 - a_i) c_(i-1) for k - degree < i <= k,
        with a_i = (t - t_i) / (t_(i + degree) - t_i) (Boehm). `series` are the coefficients in `other`.
        """
        knots = other.knots
        for knot in np.setdiff1d(self.cells, other.cells):
            k = int(find_intervals(knots, SPLINE_DEGREE, np.array([knot]))[0])
            i = np.arange(k - SPLINE_DEGREE + 1, k + 1)  # coefficients that change; all others are kept
            share = ((knot - knots[i]) / (knots[i + SPLINE_DEGREE] - knots[i]))[:, None]
            mixed = share * series[i] + (1.0 - share) * series[i - 1]
            series = np.concatenate([series[: i[0]], mixed, series[k:]])
            knots = np.insert(knots, k + 1, knot)
        return series

    def evaluate(self, series: Array, p: Array, order: int = 0) -> Array:
        """Compute functions (T, c) at p (T,), or a derivative by p, from coefficients (size, c)."""
        intervals = find_intervals(self.knots, SPLINE_DEGREE, p)
        values = spline_values(self.knots, SPLINE_DEGREE, intervals, p, order)
        return np.einsum("tj,tjc->tc", values, series[self.columns(intervals)])


class KnownDeflections(NamedTuple):
    """Deflections as functions of time, represented by splines in the parameter of a law."""

    clock: Clock
    splines: DeflectionSplines
    series: Array  # (size, n_e) [rad, m]

    def __call__(self, t: Array) -> tuple[Array, Array, Array]:
        """Compute deflections and two time derivatives at t (T,), each (T, n_e)."""
        p = np.clip(self.clock.parameter(t), self.splines.cells[0], self.splines.cells[-1])
        # the functions and their derivatives by p, then dp/dt and d2p/dt2 (after the value, which is s)
        value, slope, bend = (self.splines.evaluate(self.series, p, order) for order in range(3))
        _, rate, acceleration = self.clock.motion(p)
        dp = rate[:, None]
        return value, slope * dp, bend * dp**2 + slope * acceleration[:, None]

    def evaluate(self, times: Array, order: int) -> Array:
        """Compute deflections (T, n_e), or their first or second time derivative, at times (T,) [s]."""
        return self(times)[order]
