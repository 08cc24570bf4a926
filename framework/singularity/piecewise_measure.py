"""The measure g along a path as Chebyshev series, panel by panel, each checked by its tail.

On a panel, det G of `bordered_system` is a polynomial up to rounding. Its roots and extrema are eigenvalues
of a companion matrix, so all of them are found and none is stepped over.

Where the path touches the locus, crosses it twice within a short stretch, or just misses it, g has an
extremum near zero. The extremum is refined on panels centred on it. The last coefficients of such a panel's
series measure the rounding of g, which decides between touching, crossing twice and missing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from framework.errors import NotAssembled, NotConverged, SingularPath
from framework.kinematics.continuation.branch import Branch
from framework.kinematics.continuation.path_sheet import SHEET_NODES, panel_nodes
from framework.kinematics.linearised_loops import LinearisedLoops, linearised_at
from framework.numerics.arrays import Array, BoolArray
from framework.numerics.chebyshev import coefficients, derivative_matrix, evaluate, extrema, real_roots, tail
from framework.numerics.ordered_sums import least_singular_values, singular_values
from framework.singularity.bordered_system import (
    Border,
    append_border,
    determinant,
    solve_bordered,
)
from framework.tolerances import MEASURE_ROUNDING, MEASURE_TAIL, MIN_PANEL_WIDTH, RANK_LOST, SAME_PLACE

TAIL_ROUNDING = 100 * MEASURE_ROUNDING  # a coefficient is a sum of dozens of values
VANISHING_TOGETHER = 1e-3  # singular values below this may vanish together: the border has a column for each


@dataclass(frozen=True, eq=False)
class MeasuredMatrix:
    """A square matrix along a branch, whose loss of rank g measures."""

    branch: Branch
    matrix: Callable[[LinearisedLoops], Array]  # computes the matrices (T, n, n) of linearised loops
    power: int = 1  # 2 for P'P, whose singular values are the squares of those of P
    # loops at the nodes of panels, by start and end: a cache that several matrices of one branch may share
    panel_loops: dict[tuple[float, float], LinearisedLoops] = field(default_factory=dict)

    def loops(self, start: float, end: float) -> LinearisedLoops:
        """Return the linearised loops at the nodes (T = SHEET_NODES) of a panel from start to end, in s."""
        if (start, end) not in self.panel_loops:
            self.panel_loops[start, end] = self.branch.close(panel_nodes(start, end))
        return self.panel_loops[start, end]

    def evaluate(self, s: Array) -> Array:
        """Evaluate the matrices (T, n, n) at s (T,)."""
        return self.matrix(self.branch.close(s))

    def count_lost_ranks(self, s: float) -> int:
        """Count the singular values that vanish at s."""
        values = singular_values(self.evaluate(np.array([s]))[0])  # (n,), descending
        return int((values < RANK_LOST**self.power * min(values[0], 1.0)).sum())

    def border_width(self, values: Array) -> int:
        """Return the number of small singular values (n,), descending, of a matrix, at least 1."""
        return max(1, int((values < VANISHING_TOGETHER**self.power * min(values[0], 1.0)).sum()))

    def linearise_guesses(self, s: Array) -> LinearisedLoops:
        """Linearise the loops at the branch's guesses for s (T,), where the loops need not be closed."""
        branch = self.branch
        return linearised_at(branch.robot, branch.guess(s), branch.path(s))

    @property
    def knots(self) -> Array:
        """Path coordinates (k,) between which the matrix is smooth, both ends included."""
        return np.array([0.0, *self.branch.path.knots, 1.0])


class Unresolved(NotConverged):
    """The measure is not smooth near `s`, however narrow the panel."""

    def __init__(self, name: str, s: float, width: float) -> None:
        """Store s, and the width of the panel as residual; `name` is that of the robot."""
        super().__init__(
            f"the singularity measure cannot be resolved near s = {s:.6g}", name=name, residual=width, s=s
        )
        self.s: float = s


@dataclass(frozen=True)
class Panel:
    """The measure g between two path coordinates as a Chebyshev series.

    Local coordinates lead from -1 at the start to 1 at the end.
    """

    start: float  # s
    end: float  # s
    series: Array  # (SHEET_NODES,) Chebyshev coefficients of g
    matrices: Array  # (SHEET_NODES, n, n) at the nodes
    border: Border  # of g

    def path_coordinates(self, local: Array) -> Array:
        """Convert local coordinates (T,) in [-1, 1] to path coordinates s (T,)."""
        return self.start + 0.5 * (self.end - self.start) * (local + 1.0)

    @property
    def width(self) -> float:
        """Width in s."""
        return self.end - self.start

    @cached_property
    def extrema(self) -> Array:
        """The local coordinates in [-1, 1] of the extrema of g."""
        return extrema(self.series)

    def slope(self, s: float) -> float:
        """Compute dg/ds at s."""
        local = (2 * s - self.start - self.end) / self.width  # in [-1, 1]
        slopes = derivative_matrix(SHEET_NODES) @ self.series  # over the local coordinate
        return float(chebyshev.chebval(local, slopes)) * 2 / self.width

    def matrix(self, s: float) -> Array:
        """Interpolate the matrix (n, n) at s."""
        local = (2 * s - self.start - self.end) / self.width  # in [-1, 1]
        series = coefficients(self.matrices.reshape(SHEET_NODES, -1))  # (SHEET_NODES, n n)
        return evaluate(np.array([local]).clip(-1.0, 1.0), series).reshape(self.matrices.shape[1:])


def resolve_panels(measured: MeasuredMatrix) -> list[Panel]:
    """Resolve g on ascending panels of [0, 1], which are halved until each is resolved.

    The first panels are those of the branch, and beyond them those between the knots of the path.

    Raises:
        Unresolved: g is not resolved on a panel of the least width.
        SingularPath: the matrix is singular all along a panel.
    """
    ends = [0.0, *(float(panel.s[-1]) for panel in measured.branch.panels)]
    edges = [*ends, *(float(knot) for knot in measured.knots if knot > ends[-1])]
    waiting = list(pairwise(edges))[::-1]  # a stack of starts and ends, the first panel on top
    resolved = list[Panel]()
    while waiting:
        start, end = waiting.pop()
        panel = _resolve_panel(measured, start, end)
        if panel is not None:
            resolved.append(panel)
            continue
        middle = 0.5 * (start + end)
        if end - start < MIN_PANEL_WIDTH:
            raise Unresolved(measured.branch.robot.name, middle, end - start)
        waiting += [(middle, end), (start, middle)]
    return resolved


class Candidate(NamedTuple):
    """A point of a panel that may be a contact: a minimum of |g| or a root, not yet refined."""

    panel: Panel
    s: float
    is_minimum: bool


def find_candidates(resolved: list[Panel]) -> list[Candidate]:
    """Find the minima of |g| and the roots of g that may be contacts on the `resolved` panels.

    Minima count if |g| there is small compared with the largest |g| of the path.
    """
    candidate_depth = 1e3  # largest |g| of a candidate, in tails of the series
    # |g| on a panel is at most the sum of |coefficients|, as Chebyshev |T_k| <= 1
    largest = max(float(np.abs(panel.series).sum()) for panel in resolved)
    level = candidate_depth * MEASURE_TAIL * largest
    candidates = list[Candidate]()
    for panel in resolved:
        # |g| is at least the constant coefficient less all others: no candidate if this is large
        constant, *others = np.abs(panel.series)
        if constant - sum(others) > level:
            continue
        is_near_zero = np.abs(chebyshev.chebval(panel.extrema, panel.series)) < level
        minima = panel.path_coordinates(panel.extrema[is_near_zero])
        roots = panel.path_coordinates(real_roots(panel.series))
        candidates += [Candidate(panel, float(s), is_minimum=True) for s in minima]
        candidates += [Candidate(panel, float(s), is_minimum=False) for s in roots]
    return candidates


def _resolve_panel(measured: MeasuredMatrix, start: float, end: float) -> Panel | None:
    """Resolve g on the panel from `start` to `end`, in s, by a Chebyshev series.

    Borders are tried from one column up to the number of small singular values, and further while a border
    hides a root. None if no border suffices, or if the loops do not close on the panel.

    Raises:
        SingularPath: the matrix is singular all along the panel.
    """
    try:
        matrices = measured.matrix(measured.loops(start, end))
    except NotAssembled:
        return None
    middle = SHEET_NODES // 2  # this node's border is used on the whole panel
    size, border = 1, Border.of(matrices[middle])
    widest = measured.border_width(border.values)
    while size <= widest:
        solution = solve_bordered(matrices, border)
        g = solution.g
        largest = np.abs(g).max()
        # det G of a wide border is also small where all singular values of G are small but not zero
        if largest < RANK_LOST and least_singular_values(solution.G).max() < RANK_LOST:
            raise SingularPath(
                f"the path runs along a singularity from s = {start:.6g} to {end:.6g}",
                name=measured.branch.robot.name,
            )
        series = coefficients(g[:, None])
        # if g itself is small, a tail of mere rounding is large relative to g, although g is resolved
        if tail(series) <= max(MEASURE_TAIL, TAIL_ROUNDING / largest):
            # det G is det M over the determinant of the bordered matrix. Where both vanish close together, as
            # where M falls into blocks, g passes smoothly: a root of det M may be missing from g.
            signs, logarithms = np.linalg.slogdet(append_border(matrices, border))  # (SHEET_NODES,) each
            if signs.all():
                determinants = signs * np.exp(logarithms - logarithms.max())  # over the largest
                if not len(real_roots(coefficients(determinants[:, None])[:, 0])):
                    return Panel(start, end, series[:, 0], matrices, border)
            widest = max(widest, size + 1)
        size += 1
        border = Border.of(matrices[middle], size)
    return None


# ------------------------------------------------------------------ extrema near zero


class Extremum(NamedTuple):
    """An extremum of g at s, with a series of g on a panel about s."""

    s: float
    g: float
    rounding: float  # of g
    start: float  # s at which the panel begins
    end: float  # s at which the panel ends
    series: Array  # (SHEET_NODES,) Chebyshev coefficients of g on [start, end]

    @property
    def is_touch(self) -> bool:
        """Whether g is zero within its rounding."""
        return abs(self.g) <= self.rounding

    def evaluate(self, s: Array) -> Array:
        """Compute g (T,) at s (T,) in [start, end]."""
        return np.asarray(chebyshev.chebval(2 * (s - self.start) / (self.end - self.start) - 1, self.series))

    def bracket(self, level: float) -> tuple[float, float]:
        """Return the nearest s below and above the extremum where |g| exceeds `level`.

        On a side without such an s, the end of the panel is returned.
        """
        (_, lower), (_, upper) = (
            self._find_first_step(end, lambda g: np.abs(g) > level) or (self.s, end)
            for end in (self.start, self.end)
        )
        return lower, upper

    @property
    def changes_sign(self) -> bool:
        """Whether g has different signs on both sides, where |g| exceeds its rounding."""
        beside = self.bracket(self.rounding)  # the nearest such s on each side
        g_below, g_above = self.evaluate(np.array(beside))
        return bool(g_below * g_above < 0)

    def roots(self) -> list[float]:
        """Find the roots beside an extremum at which g is not zero: two, one or none.

        At most one root lies on each side. It is bracketed, then bisected down to rounding.
        """
        roots = []
        for end in (self.start, self.end):
            bracket = self._find_first_step(end, lambda g: g * self.g < 0)  # to the opposite sign
            if bracket is None:
                continue
            inner, outer = bracket
            # bisect until no number lies between the two
            while (middle := 0.5 * (inner + outer)) not in (inner, outer):
                if self.evaluate(np.array([middle]))[0] * self.g > 0:  # the sign of the extremum
                    inner = middle
                else:
                    outer = middle
            roots.append(middle)
        return roots

    def _find_first_step(self, end: float, test: Callable[[Array], BoolArray]) -> list[float] | None:
        """Step from the extremum towards an end of the panel until g passes a test; return both ends in s.

        The first step is SAME_PLACE long. Each step doubles the distance from the extremum; the last one ends
        at the end of the panel. None if g passes the test after no step.

        Args:
            test: returns for values g (T,) which of them pass, (T,).
        """
        to_end = abs(end - self.s)  # in s
        doublings = np.ceil(np.log2(max(to_end / SAME_PLACE, 1.0)))  # of a distance, to the end at last
        distances = np.minimum(SAME_PLACE * 2.0 ** np.arange(doublings + 1), to_end)
        s = self.s + np.sign(end - self.s) * np.insert(distances, 0, 0.0)  # the extremum first
        passing = np.flatnonzero(test(self.evaluate(s[1:])))
        if not len(passing):
            return None
        return s[passing[0] : passing[0] + 2].tolist()  # of the first step after which g passes


def extremum_near(
    matrices: Callable[[Array], Array],
    knots: Array,
    s: float,
    size: int,
    scalar: Callable[[Array], Array] = determinant,
) -> Extremum:
    """Find the extremum nearest to s of g, or of another scalar function of the blocks G.

    Each panel is centred on the extremum that the previous panel has nearest to its middle. Panels are halved
    until the series ends in rounding. If a panel has no extremum, its middle is returned. So s is the
    estimate of the extremum, improved from panel to panel.

    Args:
        matrices: computes the matrices (T, n, n) at path coordinates (T,).
        knots: path coordinates (k,) from 0 to 1 between which the matrices are smooth.
        s: where the search begins.
        size: number of columns of the border.
        scalar: computes the scalar (T,) of blocks G (T, size, size): those at the nodes of the panel, then
            the block at s.
    """
    # in s, of a panel about an extremum; halved while the series has a truncation error
    first_half_width = 0.04
    max_panels = 8
    k = np.searchsorted(knots[1:-1], s, side="right")
    lowest, highest = knots[k : k + 2]  # between these knots g is smooth
    half_width = first_half_width
    for _ in range(max_panels):
        start = max(lowest, s - half_width)
        end = min(highest, s + half_width)
        stack = matrices(np.append(panel_nodes(start, end), s))
        values = scalar(solve_bordered(stack, Border.of(stack[-1], size)).G)  # at the nodes, then at s
        series = coefficients(values[:-1, None])[:, 0]
        # the last third of the coefficients is rounding if g is resolved, else it is the truncation error
        rounding = max(np.abs(series[-SHEET_NODES // 3 :]).sum(), MEASURE_ROUNDING)
        local_extrema = extrema(series)  # in [-1, 1]
        if not len(local_extrema):
            return Extremum(s, float(values[-1]), rounding, start, end, series)
        local = 2 * (s - start) / (end - start) - 1  # of s, which is not in the middle beside a knot
        nearest = local_extrema[np.argmin(np.abs(local_extrema - local))]
        s = float(start + 0.5 * (end - start) * (nearest + 1))
        if rounding <= 10 * MEASURE_ROUNDING:  # no truncation error is left, with a margin
            break
        half_width *= 0.5
    return Extremum(s, float(chebyshev.chebval(nearest, series)), rounding, start, end, series)
