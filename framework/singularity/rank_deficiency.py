"""The places where a square matrix loses rank along a path: all of them, to rounding, with the contact.

Roots and extrema of g on the `panels` of the path are candidates; each is polished on the robot itself.
Where several singular values vanish at once so do all entries of G: that place is where the sum of their
squares is least (Gauss and Newton's method).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from framework.arrays import Array
from framework.singularity.bordered_system import Border, solve_bordered
from framework.singularity.extrema_of_g import Extremum, extremum_near
from framework.singularity.piecewise_measure import (
    Measured,
    Panel,
    candidates,
    count_below,
    largest_on,
    turning_places,
)
from framework.singularity.root_of_g import STENCIL_HALF_WIDTH, Root, root_of_g
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
    """A place beside a singularity, an end of the path perhaps: the measure is least there and not zero."""

    s: float
    g: float  # the smallest singular value with the sign of the determinant
    width: float  # in s, on the narrower side: from the place to where |det G| has doubled
    size: int  # of G: more than 1 where several singular values are small


def contacts(measured: Measured, resolved: list[Panel]) -> list[Contact]:
    """Find all places where the matrix loses rank, ascending; `resolved` are its `panels`."""
    residual = max(ROOT_RESIDUAL * largest_on(resolved), MEASURE_ROUNDING)
    several: list[Contact] = []
    single: list[Contact] = []
    stretches: list[tuple[float, float]] = []  # stretches around extrema whose roots are known
    for panel, start, is_minimum in sorted(candidates(resolved), key=lambda candidate: not candidate[2]):
        size = _size(measured, panel.matrix(start))
        together = _together(measured, start, size) if size > 1 else None
        if together is not None:
            if _is_apart(together.s, several, DISTINCT_EXTREMA):
                several.append(together)
            continue
        if is_minimum:
            turning = extremum_near(measured.at, measured.knots, start, size)
            if all(abs(turning.s - sum(stretch) / 2) > DISTINCT_EXTREMA for stretch in stretches):
                around, stretch = _around(measured, turning, size)
                single += [contact for contact in around if _is_apart(contact.s, single, SAME_PLACE)]
                stretches += [stretch] if around else []
            continue
        root = root_of_g(measured.at, start, size=size, longest=STENCIL_HALF_WIDTH)
        s = root.place
        is_root = abs(root.depth) < residual and abs(s - start) < MAX_ROOT_SHIFT * (panel.end - panel.start)
        # the roots beside an extremum are known, and a root on the edge of two panels is found twice
        new = not any(low <= s <= high for low, high in stretches)
        new = new and _is_apart(s, single, SAME_PLACE)
        if is_root and new and _vanishes(measured, s, size) and _changes_sign(measured, root, size):
            single.append(Contact(s, "transversal"))
    alone = [contact for contact in single if _is_apart(contact.s, several, MULTIPLE_ROOT_RADIUS)]
    return sorted(several + alone, key=lambda contact: contact.s)


def near_misses(measured: Measured, resolved: list[Panel], known: list[Contact]) -> list[NearMiss]:
    """Find where the matrix comes near to losing rank and does not, ascending; `known` are its `contacts`."""
    smallest = [np.linalg.svd(panel.matrices, compute_uv=False)[:, -1] for panel in resolved]
    near = NEAR_MISS**measured.power * max((values.max() for values in smallest), default=0.0)
    misses: list[NearMiss] = []
    for k, s in ((0, 0.0), (-1, 1.0)):  # the first node of the first panel, the last of the last
        if smallest[k][k] < near:
            misses += _near_end(measured, resolved[k], known, s)
    for panel, start in turning_places(resolved):
        if np.linalg.svd(panel.matrix(start), compute_uv=False)[-1] >= near:
            continue
        size = _size(measured, panel.matrix(start))
        turning = extremum_near(measured.at, measured.knots, start, size)
        within = abs(turning.s - start) < panel.end - panel.start
        if turning.is_touch or not within or not _is_apart(turning.s, misses, DISTINCT_EXTREMA):
            continue
        before, behind = turning.beyond(2 * abs(turning.g))
        if turning.roots() or any(before <= contact.s <= behind for contact in known):
            continue
        matrix = measured.at(np.array([turning.s]))
        g = float(solve_bordered(matrix, Border.of(matrix[0])).g[0])
        misses.append(NearMiss(turning.s, g, min(turning.s - before, behind - turning.s), size))
    return sorted(misses, key=lambda miss: miss.s)


def _near_end(measured: Measured, panel: Panel, known: list[Contact], s: float) -> list[NearMiss]:
    """Return the end s of the path, on its panel, as a near miss if the measure falls outwards there."""
    outwards, matrix = 2.0 * s - 1.0, panel.matrices[0 if s == 0.0 else -1]
    value, slope = (
        chebyshev.chebval(outwards, part) for part in (panel.series, chebyshev.chebder(panel.series))
    )
    if value * slope * outwards >= 0.0:
        return []
    width = float(0.5 * (panel.end - panel.start) * abs(value / slope))
    if any(abs(contact.s - s) <= width for contact in known):
        return []
    g = float(solve_bordered(matrix[None], Border.of(matrix)).g[0])
    return [NearMiss(s, g, width, _size(measured, matrix))]


def _is_apart(s: float, places: Sequence[Contact | NearMiss], distance: float) -> bool:
    """Whether s is farther than a distance from all places."""
    return all(abs(s - place.s) > distance for place in places)


def _size(measured: Measured, matrix: Array) -> int:
    """Return the width of the border that a matrix needs."""
    return max(1, count_below(matrix, VANISHING_TOGETHER**measured.power))


def _around(measured: Measured, turning: Extremum, size: int) -> tuple[list[Contact], tuple[float, float]]:
    """Find the contacts at or beside an extremum, and the stretch of s in which there is no other one."""
    s = turning.s
    if turning.is_touch:
        if not _vanishes(measured, s, size):
            return [], (s, s)
        before, behind = turning.beyond(turning.rounding)
        reach = max(behind - s, s - before, 0.5 * DISTINCT_EXTREMA)
        kind = "transversal" if turning.changes_sign else "tangential"
        contact = Contact(s, kind, behind - before if kind == "tangential" else None)
        return [contact], (s - 2 * reach, s + 2 * reach)
    roots = [root for root in _polished(measured, turning, size) if _vanishes(measured, root, size)]
    reach = max((abs(root - s) for root in roots), default=0.0)
    # to a quarter of their distance: a root beyond it has an extremum of its own between
    return [Contact(root, "transversal") for root in roots], (s - 1.5 * reach, s + 1.5 * reach)


def _polished(measured: Measured, turning: Extremum, size: int) -> list[float]:
    """Polish the roots beside an extremum with the border of the matrix at each, if it leads to them."""
    places = []
    for root in turning.roots():
        near = abs(root - turning.s) / 4
        better = root_of_g(measured.at, root, size=size, longest=near)
        places.append(better.place if better.converged and abs(better.place - root) < near else root)
    return places


def _vanishes(measured: Measured, s: float, size: int) -> bool:
    """Whether the least singular value does; a small det G of several does not tell."""
    return size == 1 or count_below(measured.at(np.array([s]))[0], RANK_LOST**measured.power) > 0


def _changes_sign(measured: Measured, root: Root, size: int) -> bool:
    """Whether g changes its sign at a root, or the path ends there."""
    h = DISTINCT_EXTREMA  # far more than the rounding of s; the roots beside a nearer extremum are known
    s = root.place
    steep = abs(root.slope) > abs(root.bend) * h + MEASURE_ROUNDING / h  # twice what bends it back
    if not h < s < 1 - h or (root.converged and steep):
        return True
    matrices = measured.at(np.array([s - h, s, s + h]))
    g = solve_bordered(matrices, Border.of(matrices[1], size)).g
    return bool(g[0] * g[2] <= 0)


# ------------------------------------------------------------------ several singular values at once


def _together(measured: Measured, start: float, size: int) -> Contact | None:
    """Find the place near start where all of G is least, if at least two singular values vanish there.

    Gauss and Newton's method on the entries of G, which vanish together; where they do so without a
    slope, the extremum of what they have in common.
    """
    s, step = start, 1.0
    for _ in range(8):
        G, slope, bend = block_slopes(measured.at, s, size)
        step = -float(np.sum(G * slope) / max(float(np.sum(slope * slope)), np.finfo(float).tiny))
        if abs(step) < CONVERGED_STEP or not abs(s + step - start) < SEARCH_RADIUS:
            break
        s = float(np.clip(s + step, 0.0, 1.0))
    steepness = np.linalg.svd(slope, compute_uv=False) / max(float(np.abs(bend).max()), 1.0)
    kind = "transversal" if steepness[-1] > TANGENTIAL_SLOPE else "tangential"
    # where none has a slope the search comes nearer by halves
    if steepness[0] < TANGENTIAL_SLOPE or abs(step) > NEWTON_STEP:
        s, kind = extremum_near(measured.at, measured.knots, s, size, _common).s, "tangential"
    vanished = count_below(measured.at(np.array([s]))[0], RANK_LOST**measured.power)
    if abs(s - start) > SEARCH_RADIUS or vanished < 2:  # others may be small and stay so
        return None
    return Contact(s, kind)


def _common(G: Array) -> Array:
    """Project G (T, size, size) on the sum of its first value and its last but one, (T,)."""
    return np.einsum("tij,ij->t", G, G[0] + G[-2])


def block_slopes(matrices: Callable[[Array], Array], s: float, size: int) -> tuple[Array, Array, Array]:
    """Compute G at s with a border of this size of the matrix there, dG/ds and d2G/ds2, each (size, size)."""
    h = STENCIL_HALF_WIDTH
    middle = float(np.clip(s, h, 1.0 - h))  # at an end of the path from the side
    three = matrices(np.array([middle - h, middle, middle + h, s]))
    before, centre, after, at_s = solve_bordered(three, Border.of(three[3], size)).G
    second = (before - 2 * centre + after) / h**2
    return at_s, (after - before) / (2 * h) + (s - middle) * second, second
