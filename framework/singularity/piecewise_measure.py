"""The measure g along a path as Chebyshev series, panel by panel, each checked by its tail.

On a panel det G of `bordered_system` is a polynomial up to rounding, so its roots and its extrema are all
found as eigenvalues; none is stepped over.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from framework.arrays import Array
from framework.errors import NotAssembled, NotConverged, SingularPath
from framework.kinematics.continuation.branch import Branch
from framework.kinematics.linearised_loops import LinearisedLoops
from framework.motion.chebyshev import coefficients, extrema, nodes, real_roots, tail
from framework.singularity.bordered_system import solve_near
from framework.tolerances import MEASURE_ROUNDING, MEASURE_TAIL, MIN_PANEL_WIDTH, RANK_LOST

TAIL_ROUNDING = 100 * MEASURE_ROUNDING  # a series sums dozens of values
PANEL_NODES = 24
MAX_ETA_NORM = 20.0  # larger with a border that has turned away from the null vectors
CANDIDATE_DEPTH = 1e3  # tails of g that a minimum may be deep and still be looked at
WIDER_BORDER_RATIO = 0.05  # singular values below are candidates for a wider border


class Measured(NamedTuple):
    """A square matrix along a branch; `power` 2 says that its singular values are squares of lengths."""

    branch: Branch
    matrix: Callable[[LinearisedLoops], Array]  # (T, n, n) of linearised loops
    power: int = 1

    def evaluate(self, s: Array) -> Array:
        """Evaluate the matrices (T, n, n) at s (T,)."""
        return self.matrix(self.branch.closed(s).linearised)

    @property
    def knots(self) -> Array:
        """Places (k,) between which the matrix is smooth, both ends included."""
        return np.concatenate(([0.0], self.branch.path.knots, [1.0]))


class Unresolved(NotConverged):
    """The measure is not smooth near `s`, however narrow the panel."""

    def __init__(self, name: str, s: float, width: float) -> None:
        super().__init__(
            f"{name}: the singularity measure cannot be resolved near s = {s:.6g}", residual=width, s=s
        )
        self.s: float = s


@dataclass(frozen=True)
class Panel:
    """g between start and end."""

    start: float
    end: float
    series: Array  # (size,) Chebyshev coefficients of g
    matrices: Array  # (size, n, n) at the nodes

    def path_coordinates(self, local: Array) -> Array:
        """Return the path coordinates s (T,) of local ones (T,) in [-1, 1]."""
        return self.start + 0.5 * (self.end - self.start) * (local + 1.0)

    @cached_property
    def extrema(self) -> Array:
        """The local coordinates in [-1, 1] of the extrema of g."""
        return extrema(self.series)

    def matrix(self, s: float) -> Array:
        """Interpolate the matrix (n, n) at s."""
        local = (2 * s - self.start - self.end) / (self.end - self.start)
        weights = chebyshev.chebvander(np.array([local]), PANEL_NODES - 1) @ coefficients(np.eye(PANEL_NODES))
        return np.einsum("k,kij->ij", weights[0], self.matrices)


class Samples(NamedTuple):
    """The path closed on the nodes of panels, each panel once."""

    branch: Branch
    panels: dict[tuple[float, float], LinearisedLoops]

    def loops(self, start: float, end: float) -> LinearisedLoops:
        """Return the linearised loops on the nodes of a panel."""
        if (start, end) not in self.panels:
            s = start + 0.5 * (end - start) * (nodes(PANEL_NODES) + 1.0)
            self.panels[start, end] = self.branch.closed(s).linearised
        return self.panels[start, end]


def panels(samples: Samples, measured: Measured) -> list[Panel]:
    """Resolve g on panels of [0, 1], halved where g does not resolve.

    Raises:
        Unresolved: some panel does not resolve.
        SingularPath: the matrix is singular all along a panel.
    """
    waiting = list(pairwise(measured.knots))[::-1]
    done: list[Panel] = []
    while waiting:
        start, end = waiting.pop()
        panel = _resolve(samples, measured, start, end)
        if panel is not None:
            done.append(panel)
            continue
        middle = 0.5 * (start + end)
        if end - start < MIN_PANEL_WIDTH:
            raise Unresolved(samples.branch.robot.name, middle, end - start)
        waiting += [(middle, end), (start, middle)]
    return done


def candidates(resolved: list[Panel]) -> list[tuple[Panel, float, bool]]:
    """Return places on the panels that may be contacts, before polishing: minima (True) and roots of g."""
    deepest = CANDIDATE_DEPTH * MEASURE_TAIL * largest_on(resolved)
    places = []
    for panel in resolved:
        constant, *others = np.abs(panel.series)
        if constant - sum(others) > deepest:  # g is nowhere near zero
            continue
        deep = np.abs(chebyshev.chebval(panel.extrema, panel.series)) < deepest
        places += [(panel, float(s), True) for s in panel.path_coordinates(panel.extrema[deep])]
        places += [(panel, float(s), False) for s in panel.path_coordinates(real_roots(panel.series))]
    return places


def largest_on(resolved: list[Panel]) -> float:
    """Return the largest |g| on the panels, or somewhat more."""
    return max(float(np.abs(panel.series).sum()) for panel in resolved)


def _resolve(samples: Samples, measured: Measured, start: float, end: float) -> Panel | None:
    """Resolve g on one panel; None when the tail is too large or the border unfit."""
    try:
        matrices = measured.matrix(samples.loops(start, end))
    except NotAssembled:
        return None
    middle = matrices[PANEL_NODES // 2]
    size, largest_size = 1, 1
    while size <= largest_size:
        eta, G = solution = solve_near(matrices, PANEL_NODES // 2, size)
        largest = float(np.abs(solution.g).max())
        if largest < RANK_LOST and np.linalg.norm(G, ord=-2, axis=(1, 2)).max() < RANK_LOST:
            raise SingularPath(
                f"{samples.branch.robot.name}: the path runs along a singularity from s = {start:.6g} to "
                f"{end:.6g}"
            )
        series = coefficients(solution.g[:, None])
        turned = np.linalg.norm(eta, axis=1).max() > MAX_ETA_NORM
        if not turned and tail(series) <= max(MEASURE_TAIL, TAIL_ROUNDING / largest):
            return Panel(start, end, series[:, 0], matrices)
        size, largest_size = size + 1, count_below(middle, WIDER_BORDER_RATIO)
    return None


def count_below(matrix: Array, level: float) -> int:
    """Count the singular values of a matrix below level times the largest, or times 1 if less."""
    values = np.linalg.svd(matrix, compute_uv=False)
    return int(np.sum(values < level * min(float(values[0]), 1.0)))
