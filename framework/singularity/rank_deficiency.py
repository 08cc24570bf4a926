"""The places where a square matrix loses rank along a path: all of them, to rounding, with the contact.

Roots and extrema of g on the panels of the path are candidates; each is polished on the robot itself.
Where several singular values vanish at once so do all entries of G: that place is where the sum of their
squares is least (Gauss and Newton's method).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import singular_values
from framework.singularity.bordered_system import STENCIL_HALF_WIDTH, Root, bordered_solution, root_of_g
from framework.singularity.piecewise_measure import (
    Extremum,
    Measured,
    Panel,
    bound_measure,
    count_small_values,
    extremum_near,
    find_candidates,
)
from framework.tolerances import (
    DISTINCT_EXTREMA,
    MEASURE_ROUNDING,
    MULTIPLE_ROOT_RADIUS,
    NEAR_MISS,
    NEWTON_STEP,
    RANK_LOST,
    SAME_PLACE,
    TANGENTIAL_SLOPE,
)

VANISHING_TOGETHER = 1e-3  # singular values that may vanish at one place: G is as wide as there are below
ROOT_RESIDUAL = 1e-12  # of the largest |g|: a root that flat counts though Newton's method did not converge
SEARCH_RADIUS = 5e-3  # in s: from a candidate to the place where several singular values vanish
MAX_ROOT_SHIFT = 1e-3  # of a panel: a root found farther from its candidate is another one
MAX_COMMON_STEPS = 8  # of the method of Gauss and Newton
CONVERGED_STEP = 1e-11  # in s, of the method of Gauss and Newton


class Contact(NamedTuple):
    """A place where the matrix loses rank.

    `kind` is transversal if every singular value that vanishes does so with a slope (a signed one changes
    its sign), and tangential if one does not. Two roots nearer together than `resolution`, in s, look like
    this tangential contact; None where that was not measured, and for transversal ones.
    """

    s: float
    kind: str
    resolution: float | None = None


class NearMiss(NamedTuple):
    """A least |g| on the path that is not zero, beside a singularity or at an end of the path."""

    s: float
    g: float  # the smallest singular value with the sign of the determinant
    width: float  # in s, on the narrower side: from the place to where |det G| has doubled
    size: int  # of G: more than 1 where several singular values are small


def find_contacts(measured: Measured, resolved: list[Panel]) -> list[Contact]:
    """Find all places where the matrix loses rank, ascending in s.

    `resolved` are the panels of g. Minima of |g| are polished before roots: a minimum near zero decides on
    the roots beside it, which then need not be found again. Where several singular values vanish at once g is
    no measure, and the entries of G are.
    """
    multiple: list[Contact] = []  # several singular values vanish at once
    single: list[Contact] = []
    stretches: list[RootStretch] = []  # about extrema whose roots are known
    residual = max(ROOT_RESIDUAL * bound_measure(resolved), MEASURE_ROUNDING)
    for candidate in sorted(find_candidates(resolved), key=lambda candidate: not candidate.is_minimum):
        size = _border_width(measured, candidate.panel.matrix(candidate.s))
        common = _find_common_contact(measured, candidate.s, size) if size > 1 else None
        if common is not None:
            if _is_apart(common.s, multiple, DISTINCT_EXTREMA):
                multiple.append(common)
        elif candidate.is_minimum:
            extremum = extremum_near(measured.evaluate, measured.knots, candidate.s, size)
            if _is_apart(extremum.s, stretches, DISTINCT_EXTREMA):
                beside, reach = _contacts_beside(measured, extremum, size)
                single += [contact for contact in beside if _is_apart(contact.s, single, SAME_PLACE)]
                stretches += [RootStretch(extremum.s, reach)] if beside else []
        else:
            root = root_of_g(measured.evaluate, candidate.s, size=size, longest=STENCIL_HALF_WIDTH)
            # a root on the edge of two panels is found twice
            is_new = _is_apart(root.place, single, SAME_PLACE)
            is_new = is_new and not any(stretch.contains(root.place) for stretch in stretches)
            is_root = abs(root.place - candidate.s) < MAX_ROOT_SHIFT * candidate.panel.width
            is_root = is_root and abs(root.residual) < residual
            if is_new and is_root and _is_crossing(measured, root, size):
                single.append(Contact(root.place, "transversal"))
    multiple += [contact for contact in single if _is_apart(contact.s, multiple, MULTIPLE_ROOT_RADIUS)]
    return sorted(multiple, key=lambda contact: contact.s)


def find_near_misses(measured: Measured, resolved: list[Panel], known: list[Contact]) -> list[NearMiss]:
    """Find the near misses along the path, ascending in s; `known` are the contacts."""
    smallest = [singular_values(panel.matrices)[:, -1] for panel in resolved]
    level = NEAR_MISS**measured.power * max((values.max() for values in smallest), default=0.0)
    misses: list[NearMiss] = []
    if smallest[0][0] < level:
        misses += _miss_at_end(measured, resolved[0], known, 0.0)
    if smallest[-1][-1] < level:
        misses += _miss_at_end(measured, resolved[-1], known, 1.0)
    for panel in resolved:
        for start in map(float, panel.path_coordinates(panel.extrema)):
            matrix = panel.matrix(start)
            if singular_values(matrix)[-1] < level:
                size = _border_width(measured, matrix)
                extremum = extremum_near(measured.evaluate, measured.knots, start, size)
                is_near = abs(extremum.s - start) < panel.width
                if is_near and _is_apart(extremum.s, misses, DISTINCT_EXTREMA):
                    misses += _miss_at_extremum(measured, extremum, known, size)
    return sorted(misses, key=lambda miss: miss.s)


def _miss_at_extremum(
    measured: Measured, extremum: Extremum, known: list[Contact], size: int
) -> list[NearMiss]:
    """Return an extremum of g as a near miss, in a list.

    The list is empty if g vanishes there, or if a contact is within reach.
    """
    lower, upper = extremum.bracket(2 * abs(extremum.g))
    if extremum.is_touch or extremum.roots() or any(lower <= contact.s <= upper for contact in known):
        return []
    matrix = measured.evaluate(np.array([extremum.s]))
    g = float(bordered_solution(matrix, 0).g[0])
    return [NearMiss(extremum.s, g, min(extremum.s - lower, upper - extremum.s), size)]


def _miss_at_end(measured: Measured, panel: Panel, known: list[Contact], s: float) -> list[NearMiss]:
    """Return the end s, 0 or 1, of the path as a near miss, in a list.

    The list is empty unless |g| falls towards the outside of the path.
    """
    outwards = 2.0 * s - 1.0  # -1 or 1: the end on the panel, and the direction out of the path
    matrix = panel.matrices[0 if s == 0.0 else -1]
    value = chebyshev.chebval(outwards, panel.series)
    slope = chebyshev.chebval(outwards, chebyshev.chebder(panel.series))
    if value * slope * outwards >= 0.0:
        return []
    width = float(0.5 * panel.width * abs(value / slope))
    if any(abs(contact.s - s) <= width for contact in known):
        return []
    g = float(bordered_solution(matrix[None], 0).g[0])
    return [NearMiss(s, g, width, _border_width(measured, matrix))]


def _is_apart(s: float, points: Sequence[Contact | NearMiss | RootStretch], distance: float) -> bool:
    """Whether s is farther than a distance, in s, from all points."""
    return all(abs(s - point.s) > distance for point in points)


def _border_width(measured: Measured, matrix: Array) -> int:
    """Count the small singular values of a matrix (n, n), at least 1.

    That is the width of the border that it needs.
    """
    return max(1, count_small_values(matrix, VANISHING_TOGETHER**measured.power))


class RootStretch(NamedTuple):
    """A stretch of the path about an extremum of g, without another extremum."""

    s: float  # of the extremum
    reach: float  # in s, to either side

    def contains(self, s: float) -> bool:
        """Whether s lies in the stretch."""
        return abs(s - self.s) <= self.reach


def _contacts_beside(measured: Measured, extremum: Extremum, size: int) -> tuple[list[Contact], float]:
    """Find the contacts at or beside an extremum of g.

    The reach of their `RootStretch` is returned too.
    """
    s = extremum.s
    if extremum.is_touch:
        if not _loses_rank(measured, s, size):
            return [], 0.0
        lower, upper = extremum.bracket(extremum.rounding)
        kind = "transversal" if extremum.changes_sign else "tangential"
        contact = Contact(s, kind, upper - lower if kind == "tangential" else None)
        return [contact], 2 * max(upper - s, s - lower, 0.5 * DISTINCT_EXTREMA)
    roots = [root for root in _polish_roots(measured, extremum, size) if _loses_rank(measured, root, size)]
    # between these roots and one beyond half their distance more, g has another extremum
    reach = 1.5 * max((abs(root - s) for root in roots), default=0.0)
    return [Contact(root, "transversal") for root in roots], reach


def _polish_roots(measured: Measured, extremum: Extremum, size: int) -> list[float]:
    """Polish the roots of g beside an extremum by Newton's method.

    Each has its own border. A root from which Newton's method leads elsewhere stays as it is.
    """
    roots = []
    for root in extremum.roots():
        radius = abs(root - extremum.s) / 4
        polished = root_of_g(measured.evaluate, root, size=size, longest=radius)
        is_same = polished.converged and abs(polished.place - root) < radius
        roots.append(polished.place if is_same else root)
    return roots


def _loses_rank(measured: Measured, s: float, size: int) -> bool:
    """Whether the least singular value vanishes at s.

    With several small ones a small det G is no proof of it.
    """
    return size == 1 or count_small_values(measured.evaluate(np.array([s]))[0], RANK_LOST**measured.power) > 0


def _is_crossing(measured: Measured, root: Root, size: int) -> bool:
    """Whether g vanishes at a root and changes its sign.

    At an end of the path no change of sign is needed.
    """
    if not _loses_rank(measured, root.place, size):
        return False
    s = root.place
    h = DISTINCT_EXTREMA  # far more than the rounding of s; the roots beside a nearer extremum are known
    # g(s + h) = slope h + bend h^2 / 2 has the sign of the slope, with a margin
    is_steep = abs(root.slope) > abs(root.bend) * h + MEASURE_ROUNDING / h
    if not h < s < 1 - h or (root.converged and is_steep):
        return True
    matrices = measured.evaluate(np.array([s - h, s, s + h]))
    g = bordered_solution(matrices, 1, size).g
    return bool(g[0] * g[2] <= 0)


# ------------------------------------------------------------------ several singular values at once


def _find_common_contact(measured: Measured, start: float, size: int) -> Contact | None:
    """Find a contact where two or more singular values vanish.

    It lies near `start`; None without one. Gauss-Newton minimises |G|, whose entries all vanish there. If
    they vanish without a slope, the contact is the extremum of their `_common_part`.
    """
    s, step = start, 1.0
    for _ in range(MAX_COMMON_STEPS):
        G, slope, bend = block_slopes(measured.evaluate, s, size)  # (size, size) each
        curvature = max(float(np.sum(slope * slope)), np.finfo(float).tiny)
        step = -float(np.sum(G * slope) / curvature)
        if abs(step) < CONVERGED_STEP or not abs(s + step - start) < SEARCH_RADIUS:
            break
        s = float(np.clip(s + step, 0.0, 1.0))
    slopes = singular_values(slope) / max(float(np.abs(bend).max()), 1.0)
    kind = "transversal" if slopes[-1] > TANGENTIAL_SLOPE else "tangential"
    # without any slope Gauss-Newton converges only linearly
    if slopes[0] < TANGENTIAL_SLOPE or abs(step) > NEWTON_STEP:
        s = extremum_near(measured.evaluate, measured.knots, s, size, _common_part).s
        kind = "tangential"
    vanished = count_small_values(measured.evaluate(np.array([s]))[0], RANK_LOST**measured.power)
    if abs(s - start) > SEARCH_RADIUS or vanished < 2:  # the others may be small and not vanish
        return None
    return Contact(s, kind)


def _common_part(G: Array) -> Array:
    """Project blocks G (T, size, size) on the sum of both ends, (T,).

    All but the last block are at ascending s; the last one is that of the border, at the contact.
    """
    direction = G[0] + G[-2]
    return np.sum(G * direction, axis=(1, 2))


class BlockSlopes(NamedTuple):
    """The block G of bordered matrices at one s with derivatives by s, each (size, size)."""

    G: Array
    slope: Array
    bend: Array  # second derivative


def block_slopes(matrices: Callable[[Array], Array], s: float, size: int) -> BlockSlopes:
    """Compute G and its two derivatives at s by central differences.

    The border is that of the matrix at s. Within half a stencil of an end of the path the stencil stays
    inside, and the slope is extrapolated to s.
    """
    h = STENCIL_HALF_WIDTH
    middle = float(np.clip(s, h, 1.0 - h))
    stack = matrices(np.array([middle - h, middle, middle + h, s]))
    lower, centre, upper, G = bordered_solution(stack, 3, size).G
    bend = (lower - 2 * centre + upper) / h**2
    slope = (upper - lower) / (2 * h) + (s - middle) * bend
    return BlockSlopes(G, slope, bend)
