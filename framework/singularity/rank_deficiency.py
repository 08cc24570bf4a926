"""Where a square matrix loses rank along a path: all places, to rounding, with the contact.

Roots and extrema of g on the `panels` of the path are candidates; each is polished on the robot itself.
Where several singular values vanish at once so do all entries of G: that place is where the sum of their
squares is least (Gauss and Newton's method).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.kinematics.loop_matrices import VANISHED
from framework.singularity.bordered_system import Border, bordered
from framework.singularity.extrema_of_g import ROUNDING, Extremum, extremum_near
from framework.singularity.panels import Measured, Panel, candidates, count_below, largest_on, turning_places
from framework.singularity.root_of_g import STENCIL, root_of_g

TOUCH = 1e-12  # what is left of |g| over its largest value along the path: a root found by Newton's method
CLOSE = 1e-3  # singular values that are this small together may vanish together
LONGEST_SEARCH = 5e-3  # in s: from a candidate to the place where several vanish
FLAT = 1e-5  # slope of G [1/s] over its second derivative: below, G touches zero without crossing it
APART = 1e-4  # in s: roots nearer than this to a place where several vanish belong to it
SAME = 1e-6  # in s: extrema nearer to one another are one
NEAR = 1e-2  # smallest singular value over its largest on the path: below, its minimum is a near miss


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
    """A place beside a singularity: the measure is least there and not zero."""

    s: float
    g: float  # the smallest singular value with the sign of the determinant
    width: float  # in s, on the narrower side: from the place to where |det G| has doubled
    size: int  # of G: more than 1 where several singular values are small


def contacts(measured: Measured, found: list[Panel]) -> list[Contact]:
    """All places where the matrix loses rank, ascending; `found` are its `panels`."""
    left = max(TOUCH * largest_on(found), ROUNDING)
    several: list[Contact] = []
    single: list[Contact] = []
    told: list[tuple[float, float]] = []  # stretches around extrema whose roots are known
    for panel, start, is_minimum in sorted(candidates(found), key=lambda candidate: not candidate[2]):
        size = _size(measured, panel.matrix(start))
        together = _together(measured, start, size) if size > 1 else None
        if together is not None:
            if all(abs(together.s - other.s) > SAME for other in several):
                several.append(together)
            continue
        if is_minimum:
            turning = extremum_near(measured.at, measured.knots, start, size)
            if all(abs(turning.s - sum(stretch) / 2) > SAME for stretch in told):
                around, stretch = _around(measured, turning, size)
                single += [one for one in around if all(abs(one.s - other.s) > 1e-10 for other in single)]
                told += [stretch] if around else []
            continue
        s, depth, _ = root_of_g(measured.at, start, size=size, longest=STENCIL)
        is_root = abs(depth) < left and abs(s - start) < 1e-3 * (panel.end - panel.start)
        # the roots beside an extremum are known, and a root on the edge of two panels is found twice
        new = not any(low <= s <= high for low, high in told)
        new = new and all(abs(s - other.s) > 1e-10 for other in single)
        if is_root and new and _vanishes(measured, s, size) and _changes_sign(measured, s, size):
            single.append(Contact(s, "transversal"))
    alone = [one for one in single if all(abs(one.s - other.s) > APART for other in several)]
    return sorted(several + alone, key=lambda contact: contact.s)


def near_misses(measured: Measured, found: list[Panel], known: list[Contact]) -> list[NearMiss]:
    """Where the matrix comes near to losing rank and does not, ascending; `known` are its `contacts`."""
    values = [np.linalg.svd(panel.matrices, compute_uv=False)[:, -1].max() for panel in found]
    near = NEAR**measured.power * max(values, default=0.0)
    misses: list[NearMiss] = []
    for panel, start in turning_places(found):
        if np.linalg.svd(panel.matrix(start), compute_uv=False)[-1] >= near:
            continue
        size = _size(measured, panel.matrix(start))
        turning = extremum_near(measured.at, measured.knots, start, size)
        within = abs(turning.s - start) < panel.end - panel.start
        if turning.is_touch or not within or any(abs(turning.s - other.s) < SAME for other in misses):
            continue
        before, behind = turning.beyond(2 * abs(turning.g))
        if turning.roots() or any(before <= contact.s <= behind for contact in known):
            continue
        matrix = measured.at(np.array([turning.s]))
        g = float(bordered(matrix, Border.of(matrix[0])).g[0])
        misses.append(NearMiss(turning.s, g, min(turning.s - before, behind - turning.s), size))
    return sorted(misses, key=lambda miss: miss.s)


def _size(measured: Measured, matrix: Array) -> int:
    """How wide a border this matrix needs."""
    return max(1, count_below(matrix, CLOSE**measured.power))


def _around(measured: Measured, turning: Extremum, size: int) -> tuple[list[Contact], tuple[float, float]]:
    """The contacts at or beside an extremum, and the stretch of s in which there is no other one."""
    s = turning.s
    if turning.is_touch:
        if not _vanishes(measured, s, size):
            return [], (s, s)
        before, behind = turning.beyond(turning.rounding)
        reach = max(behind - s, s - before, 0.5 * SAME)
        kind = "transversal" if turning.changes_sign else "tangential"
        contact = Contact(s, kind, behind - before if kind == "tangential" else None)
        return [contact], (s - 2 * reach, s + 2 * reach)
    roots = [root for root in _polished(measured, turning, size) if _vanishes(measured, root, size)]
    reach = max((abs(root - s) for root in roots), default=0.0)
    # to a quarter of their distance: a root beyond it has an extremum of its own between
    return [Contact(root, "transversal") for root in roots], (s - 1.5 * reach, s + 1.5 * reach)


def _polished(measured: Measured, turning: Extremum, size: int) -> list[float]:
    """The roots beside an extremum with the border of the matrix at each, if that leads to the same root."""
    places = []
    for root in turning.roots():
        near = abs(root - turning.s) / 4
        better = root_of_g(measured.at, root, size=size, longest=near)
        places.append(better.place if better.converged and abs(better.place - root) < near else root)
    return places


def _vanishes(measured: Measured, s: float, size: int) -> bool:
    """Whether the least singular value does; a small det G of several does not tell."""
    return size == 1 or count_below(measured.at(np.array([s]))[0], VANISHED**measured.power) > 0


def _changes_sign(measured: Measured, s: float, size: int) -> bool:
    """Whether g changes its sign at s, or the path ends there."""
    h = 1e-6  # far more than the rounding of s; an extremum nearer than that has told its roots
    if not h < s < 1 - h:
        return True
    matrices = measured.at(np.array([s - h, s, s + h]))
    g = bordered(matrices, Border.of(matrices[1], size)).g
    return bool(g[0] * g[2] <= 0)


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
        s, kind = extremum_near(measured.at, measured.knots, s, size, _common).s, "tangential"
    vanished = count_below(measured.at(np.array([s]))[0], VANISHED**measured.power)
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
