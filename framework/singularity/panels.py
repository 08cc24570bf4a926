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
from framework.kinematics.branch import Branch
from framework.kinematics.inverse_kinematics import System
from framework.motion.chebyshev import coefficients, extrema, nodes, real_roots, tail
from framework.singularity.bordered_system import Border, bordered

PANEL_NODES = 24
RESOLVED = 1e-9  # tail of g on a panel; roots are polished afterwards
NARROWEST = 2e-4  # panel of s that still does not resolve: a border or the branch itself breaks down
LARGEST_ETA = 20.0  # a border that has turned away from the null vectors
ON_THE_LOCUS = 1e-7  # |g| all along a panel: the path does not cross the locus, it follows it
WEAK = 0.05  # singular values below are candidates for a wider border


class Measured(NamedTuple):
    """A square matrix along a branch; `power` 2 says that its singular values are squares of lengths."""

    branch: Branch
    matrix: Callable[[System], Array]  # (T, n, n) of a system
    power: int = 1

    def at(self, s: Array) -> Array:
        """The matrices (T, n, n) at s (T,)."""
        return self.matrix(self.branch.closed(s).system)

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

    def at(self, local: Array) -> Array:
        """Path coordinates of local ones in [-1, 1]."""
        return self.start + 0.5 * (self.end - self.start) * (np.asarray(local) + 1.0)

    @cached_property
    def turning(self) -> Array:
        """Where in [-1, 1] g turns."""
        return extrema(self.series)

    def matrix(self, s: float) -> Array:
        """The matrix (n, n) at s, interpolated."""
        local = (2 * s - self.start - self.end) / (self.end - self.start)
        weights = chebyshev.chebvander(np.array([local]), PANEL_NODES - 1) @ coefficients(np.eye(PANEL_NODES))
        return np.einsum("k,kij->ij", weights[0], self.matrices)


class Samples(NamedTuple):
    """The path closed on the nodes of panels, each panel once."""

    branch: Branch
    panels: dict[tuple[float, float], System]

    def on(self, start: float, end: float) -> System:
        """The system on the nodes of a panel."""
        if (start, end) not in self.panels:
            s = start + 0.5 * (end - start) * (nodes(PANEL_NODES) + 1.0)
            self.panels[start, end] = self.branch.closed(s).system
        return self.panels[start, end]


def panels(samples: Samples, measured: Measured) -> list[Panel]:
    """g on panels of [0, 1], each resolved; split where it is not.

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
        if end - start < NARROWEST:
            raise Unresolved(samples.branch.robot.name, middle, end - start)
        waiting += [(middle, end), (start, middle)]
    return done


def candidates(found: list[Panel]) -> list[tuple[Panel, float, bool]]:
    """Places on the panels that may be contacts, before polishing: minima (True) and roots of g."""
    deepest = 1e3 * RESOLVED * largest_on(found)
    places = []
    for panel in found:
        constant, *others = np.abs(panel.series)
        if constant - sum(others) > deepest:  # g is nowhere near zero
            continue
        turning = panel.turning
        deep = np.abs(chebyshev.chebval(turning, panel.series)) < deepest
        places += [(panel, float(s), True) for s in panel.at(turning[deep])]
        places += [(panel, float(s), False) for s in panel.at(real_roots(panel.series))]
    return places


def turning_places(found: list[Panel]) -> list[tuple[Panel, float]]:
    """All places on the panels where g turns."""
    return [(panel, float(s)) for panel in found for s in panel.at(panel.turning)]


def largest_on(found: list[Panel]) -> float:
    """The largest |g| on the panels, or somewhat more."""
    return max(float(np.abs(panel.series).sum()) for panel in found)


def _resolve(samples: Samples, measured: Measured, start: float, end: float) -> Panel | None:
    """g on one panel, or None when its tail is too large or the border unfit."""
    try:
        matrices = measured.matrix(samples.on(start, end))
    except NotAssembled:
        return None
    middle = matrices[PANEL_NODES // 2]
    size, most = 1, 1
    while size <= most:
        eta, G = solution = bordered(matrices, Border.of(middle, size))
        largest = float(np.abs(solution.g).max())
        if largest < ON_THE_LOCUS and np.linalg.norm(G, ord=-2, axis=(1, 2)).max() < ON_THE_LOCUS:
            raise SingularPath(
                f"{samples.branch.robot.name}: the path runs along a singularity from s = {start:.6g} to "
                f"{end:.6g}"
            )
        series = coefficients(solution.g[:, None])
        turned = np.linalg.norm(eta, axis=1).max() > LARGEST_ETA
        if not turned and tail(series) <= max(RESOLVED, 1e-13 / largest):
            return Panel(start, end, series[:, 0], matrices)
        size, most = size + 1, count_below(middle, WEAK)
    return None


def count_below(matrix: Array, level: float) -> int:
    """Number of singular values of a matrix below a level, or that share of the largest if it is small."""
    values = np.linalg.svd(matrix, compute_uv=False)
    return int(np.sum(values < level * min(float(values[0]), 1.0)))
