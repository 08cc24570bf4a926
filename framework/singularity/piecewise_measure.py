"""The measure g along a path as Chebyshev series, panel by panel, each checked by its tail.

On a panel det G of `bordered_system` is a polynomial up to rounding, so its roots and its extrema are all
found as eigenvalues; none is stepped over.

Where the path touches the locus, crosses it twice within a short stretch, or misses, g has an extremum near
zero. The extremum is polished on panels centred on it. The rounding of g there is measured by the last
coefficients of the panel's series. Against it is decided whether the path touches, crosses twice or misses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from framework.errors import NotAssembled, NotConverged, SingularPath
from framework.kinematics.continuation.branch import Branch
from framework.kinematics.linearised_loops import LinearisedLoops, linearised_at
from framework.numerics.arrays import Array, BoolArray
from framework.numerics.chebyshev import coefficients, extrema, nodes, real_roots, tail
from framework.numerics.ordered_sums import singular_values
from framework.singularity.bordered_system import bordered_solution, determinant
from framework.tolerances import MEASURE_ROUNDING, MEASURE_TAIL, MIN_PANEL_WIDTH, RANK_LOST

TAIL_ROUNDING = 100 * MEASURE_ROUNDING  # a series sums dozens of values
PANEL_NODES = 24
MAX_ETA_NORM = 20.0  # larger with a border that has turned away from the null vectors
CANDIDATE_DEPTH = 1e3  # tails of g that a minimum may be deep and still be looked at
PANEL_HALF_WIDTH = 0.04  # of a panel about an extremum, in s; halved while rounding is not all that is left
MAX_HALVINGS = 5  # of that width
CENTRING_PASSES = 3  # each centres the panel on the extremum found on the last one
FIRST_BRACKET_STEP = 1e-10  # of the walks away from an extremum, in s; doubled
WIDER_BORDER_RATIO = 0.05  # singular values below are candidates for a wider border


class Measured(NamedTuple):
    """A square matrix along a branch, whose loss of rank is measured by g."""

    branch: Branch
    matrix: Callable[[LinearisedLoops], Array]  # (T, n, n) of linearised loops
    power: int = 1  # 2 for P'P, whose singular values are squares

    def evaluate(self, s: Array) -> Array:
        """Evaluate the matrices (T, n, n) at s (T,)."""
        return self.matrix(self.branch.close(s).linearised)

    def guess(self, s: Array) -> LinearisedLoops:
        """Compute the equations at the branch's guesses for s (T,).

        The loops may not close there.
        """
        branch = self.branch
        return linearised_at(branch.robot, branch.guess(s), branch.path(s))

    @property
    def knots(self) -> Array:
        """Path coordinates (k,) between which the matrix is smooth, both ends included."""
        return np.concatenate(([0.0], self.branch.path.knots, [1.0]))


class Unresolved(NotConverged):
    """The measure is not smooth near `s`, however narrow the panel."""

    def __init__(self, name: str, s: float, width: float) -> None:
        """Keep s, and the width of the panel as residual."""
        super().__init__(
            f"{name}: the singularity measure cannot be resolved near s = {s:.6g}", residual=width, s=s
        )
        self.s: float = s


@dataclass(frozen=True)
class Panel:
    """The measure g between two path coordinates as a Chebyshev series."""

    start: float  # s
    end: float
    series: Array  # (size,) Chebyshev coefficients of g
    matrices: Array  # (size, n, n) at the nodes

    def path_coordinates(self, local: Array) -> Array:
        """Return the path coordinates s (T,) of local ones (T,) in [-1, 1]."""
        return self.start + 0.5 * (self.end - self.start) * (local + 1.0)

    @property
    def width(self) -> float:
        """Its width in s."""
        return self.end - self.start

    @cached_property
    def extrema(self) -> Array:
        """The local coordinates in [-1, 1] of the extrema of g."""
        return extrema(self.series)

    def matrix(self, s: float) -> Array:
        """Interpolate the matrix (n, n) at s."""
        local = (2 * s - self.start - self.end) / self.width
        polynomials = chebyshev.chebvander(np.array([local]), PANEL_NODES - 1)[0]  # (PANEL_NODES,)
        weights = polynomials @ coefficients(np.eye(PANEL_NODES))  # of the matrices at the nodes
        return np.tensordot(weights, self.matrices, axes=1)


class Samples(NamedTuple):
    """A cache of the branch's loops, linearised on the nodes of panels."""

    branch: Branch
    panels: dict[tuple[float, float], LinearisedLoops]  # by start and end of the panel

    def loops(self, start: float, end: float) -> LinearisedLoops:
        """Return the linearised loops on the nodes (T = PANEL_NODES) of a panel."""
        if (start, end) not in self.panels:
            self.panels[start, end] = self.branch.close(_panel_nodes(start, end)).linearised
        return self.panels[start, end]


def _panel_nodes(start: float, end: float) -> Array:
    """Return the Chebyshev nodes (PANEL_NODES,) between two path coordinates."""
    return start + 0.5 * (end - start) * (nodes(PANEL_NODES) + 1.0)


def resolve_panels(samples: Samples, measured: Measured) -> list[Panel]:
    """Resolve g on panels of [0, 1], halved where g does not resolve.

    Raises:
        Unresolved: some panel does not resolve.
        SingularPath: the matrix is singular all along a panel.
    """
    waiting = list(pairwise(measured.knots))[::-1]
    done: list[Panel] = []
    while waiting:
        start, end = waiting.pop()
        panel = _resolve_panel(samples, measured, start, end)
        if panel is not None:
            done.append(panel)
            continue
        middle = 0.5 * (start + end)
        if end - start < MIN_PANEL_WIDTH:
            raise Unresolved(samples.branch.robot.name, middle, end - start)
        waiting += [(middle, end), (start, middle)]
    return done


class Candidate(NamedTuple):
    """A place on a panel that may be a contact: a minimum of |g| or a root, not polished."""

    panel: Panel
    s: float
    is_minimum: bool


def find_candidates(resolved: list[Panel]) -> list[Candidate]:
    """Find the minima of |g| and the roots of g that may be contacts."""
    deepest = CANDIDATE_DEPTH * MEASURE_TAIL * bound_measure(resolved)
    all_candidates: list[Candidate] = []
    for panel in resolved:
        constant, *others = np.abs(panel.series)
        if constant - sum(others) > deepest:  # g is nowhere near zero
            continue
        is_deep = np.abs(chebyshev.chebval(panel.extrema, panel.series)) < deepest
        minima = panel.path_coordinates(panel.extrema[is_deep])
        roots = panel.path_coordinates(real_roots(panel.series))
        all_candidates += [Candidate(panel, float(s), True) for s in minima]
        all_candidates += [Candidate(panel, float(s), False) for s in roots]
    return all_candidates


def bound_measure(resolved: list[Panel]) -> float:
    """Return an upper bound of |g| on the panels: the largest sum of |coefficients|."""
    return max(float(np.abs(panel.series).sum()) for panel in resolved)


def _resolve_panel(samples: Samples, measured: Measured, start: float, end: float) -> Panel | None:
    """Resolve g on a panel by a Chebyshev series, by ever wider borders.

    None if no border suffices.
    """
    try:
        matrices = measured.matrix(samples.loops(start, end))
    except NotAssembled:
        return None
    middle = PANEL_NODES // 2  # whose border serves for the whole panel
    widest = count_small_values(matrices[middle], WIDER_BORDER_RATIO)
    for size in range(1, max(widest, 1) + 1):
        solution = bordered_solution(matrices, middle, size)
        g = solution.g
        largest = float(np.abs(g).max())
        if largest < RANK_LOST and singular_values(solution.G)[:, -1].max() < RANK_LOST:
            raise SingularPath(
                f"{samples.branch.robot.name}: the path runs along a singularity from s = {start:.6g} to "
                f"{end:.6g}"
            )
        series = coefficients(g[:, None])
        is_unfit = np.linalg.norm(solution.eta, axis=1).max() > MAX_ETA_NORM  # the border
        # the tail that rounding makes of a g that is small itself counts as resolved
        if not is_unfit and tail(series) <= max(MEASURE_TAIL, TAIL_ROUNDING / largest):
            return Panel(start, end, series[:, 0], matrices)
    return None


def count_small_values(matrix: Array, level: float) -> int:
    """Count the singular values of a matrix below a level.

    The level is a share of the largest, or of 1 if that is less.
    """
    values = singular_values(matrix)
    return int(np.sum(values < level * min(float(values[0]), 1.0)))


# ------------------------------------------------------------------ extrema near zero


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
        """Return the nearest s below and above with |g| over a level, else the panel's ends."""
        lower, upper = (self._find_first_step(side, lambda g: np.abs(g) > level) for side in (-1, 1))
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
            bracket = self._find_first_step(side, lambda g: g * self.g < 0)
            if bracket is not None:
                inner, outer = bracket
                while (middle := 0.5 * (inner + outer)) not in (inner, outer):
                    if self.evaluate(np.array([middle]))[0] * self.g > 0:  # as at the extremum
                        inner = middle
                    else:
                        outer = middle
                roots.append(middle)
        return roots

    def _find_first_step(self, side: int, test: Callable[[Array], BoolArray]) -> tuple[float, float] | None:
        """Walk from the extremum to one side until g passes a test.

        Steps are doubled; the side is -1 or 1.

        Returns:
            s at both ends of the last step; None if g passes nowhere on the panel.
        """
        room = abs((self.end if side > 0 else self.start) - self.s)
        count = int(np.ceil(np.log2(max(room / FIRST_BRACKET_STEP, 1.0)))) + 1
        distances = np.concatenate(([0.0], FIRST_BRACKET_STEP * 2.0 ** np.arange(count)))
        s = self.s + side * np.minimum(distances, room)
        passing = np.flatnonzero(test(self.evaluate(s[1:])))
        return (float(s[passing[0]]), float(s[passing[0] + 1])) if len(passing) else None


def extremum_near(
    matrices: Callable[[Array], Array],
    knots: Array,
    s: float,
    size: int,
    scalar: Callable[[Array], Array] = determinant,
) -> Extremum:
    """Find the extremum nearest to s of a scalar function (T,) of blocks G (T, size, size).

    A panel about s gives the extremum of its series, on which the next panel is centred; then panels are
    halved until their series ends in rounding. On a panel without an extremum s itself is returned.

    Args:
        matrices: the matrices (T, n, n) at s (T,), smooth between the `knots`, of which 0 and 1 are two.
    """
    k = np.searchsorted(knots[1:-1], s, side="right")
    lowest, highest = knots[k], knots[k + 1]  # g is not smooth beyond
    half_width = PANEL_HALF_WIDTH
    for k_pass in range(1, CENTRING_PASSES + MAX_HALVINGS + 1):
        start, end = max(lowest, s - half_width), min(highest, s + half_width)
        stack = matrices(np.append(_panel_nodes(start, end), s))  # s last, whose border serves for all
        values = scalar(bordered_solution(stack, -1, size).G)
        series = coefficients(values[:-1, None])[:, 0]
        # a resolved series ends in rounding, another one in its truncation error
        rounding = max(float(np.abs(series[-PANEL_NODES // 3 :]).sum()), MEASURE_ROUNDING)
        local_extrema = extrema(series)  # in [-1, 1]
        if not len(local_extrema):
            return Extremum(s, float(values[-1]), rounding, start, end, series)
        local = 2 * (s - start) / (end - start) - 1
        nearest = float(local_extrema[np.argmin(np.abs(local_extrema - local))])
        s = start + 0.5 * (end - start) * (nearest + 1)
        if k_pass >= CENTRING_PASSES:
            if rounding <= 10 * MEASURE_ROUNDING:
                break
            half_width *= 0.5
    return Extremum(s, float(chebyshev.chebval(nearest, series)), rounding, start, end, series)
