"""Where a square matrix loses rank along a path: all places, to rounding, with the contact.

On panels of the path det G of `bordering` is a polynomial up to rounding (Chebyshev interpolation with
a checked tail), so its roots and its minima are all found as eigenvalues; each is then polished on the
robot itself. Where several singular values vanish at once so do all entries of G: that place is where
the sum of their squares is least (Gauss and Newton's method).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from framework.arrays import Array
from framework.errors import NotAssembled, NotConverged, SingularPath
from framework.kinematics.branch import Branch
from framework.kinematics.inverse_kinematics import System
from framework.kinematics.loop_matrices import VANISHED
from framework.motion.chebyshev import coefficients, extrema, nodes, real_roots, tail
from framework.singularity.bordered_system import Border, bordered, determinant
from framework.singularity.root_of_g import STENCIL, root_of_g

PANEL_NODES = 24
RESOLVED = 1e-9  # tail of g on a panel; roots are polished afterwards
NARROWEST = 2e-4  # panel of s that still does not resolve: a border or the branch itself breaks down
LARGEST_ETA = 20.0  # a border that has turned away from the null vectors
ON_THE_LOCUS = 1e-7  # |g| all along a panel: the path does not cross the locus, it follows it
TOUCH = 1e-12  # |g| over its largest value along the path: a minimum this deep touches the locus
ROUNDING = 1e-15  # |g| that is zero however small its largest value, as that of small loops in a long robot
WEAK = 0.05  # singular values below are candidates for a wider border
CLOSE = 1e-3  # singular values that are this small together may vanish together
LONGEST_SEARCH = 5e-3  # in s: from a candidate to the place where several vanish
FLAT = 1e-5  # slope of G [1/s] over its second derivative: below, G touches zero without crossing it
APART = 1e-4  # in s: roots nearer to one another are one contact


class Measured(NamedTuple):
    """A square matrix along a branch; `power` 2 says that its singular values are squares of lengths."""

    branch: Branch
    matrix: Callable[[System], Array]  # (T, n, n) of a system
    power: int = 1

    def at(self, s: Array) -> Array:
        """The matrices (T, n, n) at s (T,)."""
        return self.matrix(self.branch.closed(s).system)


class Contact(NamedTuple):
    """A place where the matrix loses rank.

    `kind` is transversal if every singular value that vanishes does so with a slope (a signed one changes
    its sign), and tangential if one does not.
    """

    s: float
    kind: str


class Unresolved(NotConverged):
    """The measure is not smooth near `s`, however narrow the panel."""

    def __init__(self, name: str, s: float, width: float) -> None:
        super().__init__(
            f"{name}: the singularity measure cannot be resolved near s = {s:.6g}", residual=width
        )
        self.s = s


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
    branch = samples.branch
    edges = np.concatenate(([0.0], branch.path.knots, [1.0]))
    waiting = list(pairwise(edges))[::-1]
    done: list[Panel] = []
    while waiting:
        start, end = waiting.pop()
        panel = _resolve(samples, measured, start, end)
        if panel is not None:
            done.append(panel)
            continue
        middle = 0.5 * (start + end)
        if end - start < NARROWEST:
            raise Unresolved(branch.robot.name, middle, end - start)
        waiting += [(middle, end), (start, middle)]
    return done


def candidates(found: list[Panel]) -> list[tuple[Panel, float, bool]]:
    """Places on the panels that may be contacts, before polishing: minima (True) and roots of g."""
    largest = _largest(found)
    places = []
    for panel in found:
        turning = extrema(panel.series)
        deep = np.abs(chebyshev.chebval(turning, panel.series)) < 1e3 * RESOLVED * largest
        places += [(panel, float(s), True) for s in panel.at(turning[deep])]
        places += [(panel, float(s), False) for s in panel.at(real_roots(panel.series))]
    return places


def contacts(measured: Measured, found: list[Panel]) -> list[Contact]:
    """All places where the matrix loses rank, ascending; `found` are its `panels`."""
    zero = max(TOUCH * _largest(found), ROUNDING)
    touches: list[Contact] = []
    roots: list[Contact] = []
    for panel, start, is_minimum in candidates(found):
        size = max(1, _below(panel.matrix(start), CLOSE**measured.power))
        together = _together(measured, start, size) if size > 1 else None
        if together is not None:
            if all(abs(together.s - other.s) > 1e-6 for other in touches):
                touches.append(together)
            continue
        if is_minimum:
            s, depth = _polish_touch(measured, start, size, determinant)
            is_touch = abs(depth) < zero and _vanishes(measured, s, size)
            if is_touch and all(abs(s - other.s) > 1e-6 for other in touches):
                touches.append(Contact(s, _contact(measured, s, size)))
            continue
        s, depth, _ = root_of_g(measured.at, start, size=size, longest=STENCIL)
        is_root = abs(depth) < zero and abs(s - start) < 1e-3 * (panel.end - panel.start)
        # a touch is also a close pair of roots, and a root on the edge of two panels is found twice
        new = all(abs(s - other.s) > 1e-10 for other in roots)
        if is_root and new and _vanishes(measured, s, size) and _contact(measured, s, size) == "transversal":
            roots.append(Contact(s, "transversal"))
    alone = [root for root in roots if all(abs(root.s - touch.s) > APART for touch in touches)]
    return sorted(touches + alone)


def _largest(found: list[Panel]) -> float:
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
        size, most = size + 1, _below(middle, WEAK)
    return None


def _below(matrix: Array, level: float) -> int:
    """Number of singular values of a matrix below a level, or that share of the largest if it is small."""
    values = np.linalg.svd(matrix, compute_uv=False)
    return int(np.sum(values < level * min(float(values[0]), 1.0)))


def _vanishes(measured: Measured, s: float, size: int) -> bool:
    """Whether the least singular value does; a small det G of several does not tell."""
    return size == 1 or _below(measured.at(np.array([s]))[0], VANISHED**measured.power) > 0


# ------------------------------------------------------------------ several singular values at once


def _together(measured: Measured, start: float, size: int) -> Contact | None:
    """The place near start where all of G is least, if at least two singular values vanish there.

    Gauss and Newton's method on the entries of G, which vanish together; where they do so without a
    slope, the extremum of what they have in common.
    """
    s, step = start, 1.0
    for _ in range(8):
        G, slope, bend = block_slopes(measured.at, s, size, 1e-4)
        step = -float(np.sum(G * slope) / max(float(np.sum(slope * slope)), 1e-300))
        if abs(step) < 1e-11 or not abs(s + step - start) < LONGEST_SEARCH:
            break
        s = float(np.clip(s + step, 0.0, 1.0))
    steepness = np.linalg.svd(slope, compute_uv=False) / max(float(np.abs(bend).max()), 1.0)
    kind = "transversal" if steepness[-1] > FLAT else "tangential"
    if steepness[0] < FLAT or abs(step) > 1e-9:  # all without a slope: it came nearer by halves
        s, kind = _polish_touch(measured, s, size, _common)[0], "tangential"
    vanished = _below(measured.at(np.array([s]))[0], VANISHED**measured.power)
    if abs(s - start) > LONGEST_SEARCH or vanished < 2:  # others may be small and stay so
        return None
    return Contact(s, kind)


def _common(G: Array) -> Array:
    """Share of G (T, size, size) in how much it is at both ends, all but the last one: (T,)."""
    return np.einsum("tij,ij->t", G, G[0] + G[-2])


def block_slopes(
    matrices: Callable[[Array], Array], s: float, size: int, h: float
) -> tuple[Array, Array, Array]:
    """G at s with a border of this size of the matrix there, dG/ds and d2G/ds2, each (size, size)."""
    middle = float(np.clip(s, h, 1.0 - h))  # at an end of the path from the side
    three = matrices(np.array([middle - h, middle, middle + h, s]))
    before, here, after, at_s = bordered(three, Border.of(three[3], size)).G
    second = (before - 2 * here + after) / h**2
    return at_s, (after - before) / (2 * h) + (s - middle) * second, second


# ------------------------------------------------------------------ one singular value, others beside it


def _contact(measured: Measured, s: float, size: int) -> str:
    """transversal if g changes its sign at s (or the path ends there), tangential if it keeps it."""
    h = 1e-6  # far more than the rounding of s, far less than what separates two crossings worth the name
    if not h < s < 1 - h:
        return "transversal"
    matrices = measured.at(np.array([s - h, s, s + h]))
    g = bordered(matrices, Border.of(matrices[1], size)).g
    return "tangential" if g[0] * g[2] > 0 else "transversal"


def _polish_touch(
    measured: Measured, s: float, size: int, scalar: Callable[[Array], Array]
) -> tuple[float, float]:
    """The extremum near s of a scalar (T,) of G (T, size, size), and it there, on panels centred on it."""
    for width in (0.04, 0.04, 0.04):
        start, end = max(0.0, s - width), min(1.0, s + width)
        local = start + 0.5 * (end - start) * (nodes(PANEL_NODES) + 1.0)
        matrices = measured.at(np.append(local, s))
        values = scalar(bordered(matrices, Border.of(matrices[-1], size)).G)
        series = coefficients(values[:-1, None])[:, 0]
        turning = extrema(series)
        if not len(turning):
            return s, float(values[-1])
        centre = 2 * (s - start) / (end - start) - 1
        best = turning[np.argmin(np.abs(turning - centre))]
        depth = float(chebyshev.chebval(best, series))
        s = start + 0.5 * (end - start) * (float(best) + 1)
    return s, depth
