"""All points of a path at which a square matrix loses rank, to rounding, with the kind of contact.

Candidates are the roots and extrema of g on the panels of the path. Each is refined with matrices of the
robot itself. Where several singular values vanish at once, all entries of G vanish: the Gauss-Newton method
finds the point at which the sum of their squares is least.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from framework.kinematics.assembly import MAX_ITERATIONS
from framework.kinematics.linearised_loops import LinearisedLoops
from framework.numerics.arrays import LEAST_DIVISOR, Array
from framework.numerics.ordered_sums import least_singular_values, singular_values
from framework.singularity.bordered_system import (
    DIFFERENCE_STEP,
    Border,
    root_of_g,
    solve_bordered,
)
from framework.singularity.piecewise_measure import (
    Candidate,
    Extremum,
    MeasuredMatrix,
    Panel,
    extremum_near,
    find_candidates,
)
from framework.tolerances import (
    DISTINCT_EXTREMA,
    MULTIPLE_ROOT_RADIUS,
    NEAR_MISS,
    NEWTON_STEP,
    SAME_PLACE,
    TANGENTIAL_SLOPE,
)

ROOT_ROUNDING = 2e-14  # in s: a shorter Newton step to a root of g is rounding


class Contact(NamedTuple):
    """A point of the path at which the matrix loses rank.

    `kind` is transversal if every vanishing singular value has a nonzero slope along the path, so that its
    signed value changes sign. Otherwise it is tangential. Two roots closer together than `resolution`, in s,
    cannot be told from this tangential contact. `resolution` is None for transversal contacts, and where it
    was not measured. A simple root of g also has its slope and its pose.
    """

    s: float
    kind: str
    resolution: float | None = None
    slope: float | None = None  # dg/ds, where g has the sign of the determinant
    pose: LinearisedLoops | None = None  # the closed loops at s, T = 1


class NearMiss(NamedTuple):
    """A nonzero local minimum of |g| on the path, which may be an end of the path."""

    s: float
    g: float  # the smallest singular value with the sign of the determinant
    width: float  # in s, from the minimum to the nearer point where |det G| has doubled
    size: int  # number of columns of the border: more than 1 if several singular values are small


def find_contacts(measured: MeasuredMatrix, resolved: list[Panel]) -> list[Contact]:
    """Find all points at which the matrix loses rank, ascending in s.

    Minima of |g| are refined before roots. The roots beside a minimum near zero are found with the minimum,
    so they need not be refined again. Simple roots are refined with their panel's slope. Where several
    singular values vanish at once, g has a multiple root, and the contact is located by the entries of the
    block G instead. `resolved` are the panels of g along the whole path.
    """
    multiple = list[Contact]()  # where several singular values vanish at once
    single = list[Contact]()  # where one singular value vanishes
    known_about = dict[float, float]()  # by s of an extremum: how far about it, in s, all roots are known
    minima_first = sorted(find_candidates(resolved), key=lambda candidate: not candidate.is_minimum)
    for candidate in minima_first:
        root = None if candidate.is_minimum else _simple_root(measured, candidate)
        size = 1
        if root is None:
            size = measured.border_width(singular_values(candidate.panel.matrix(candidate.s)))
        # where several singular values are small, they may vanish together
        common = _find_common_contact(measured, candidate.s, size) if size > 1 else None
        if common is not None:
            if _is_apart(common.s, multiple, DISTINCT_EXTREMA):
                multiple.append(common)
            continue
        if candidate.is_minimum:
            extremum = extremum_near(measured.evaluate, measured.knots, candidate.s, size)
            if all(abs(extremum.s - s) > DISTINCT_EXTREMA for s in known_about):
                contacts, reach = _contacts_beside(measured, extremum, size)
                single += [contact for contact in contacts if _is_apart(contact.s, single, SAME_PLACE)]
                if contacts:
                    known_about[extremum.s] = reach
            continue
        if root is None:  # by differences; Newton's method may leave the root
            s, converged = root_of_g(measured.evaluate, candidate.s, size=size, longest=DIFFERENCE_STEP)
            if not converged:
                continue
            root = Contact(s, "transversal")
        is_known = any(abs(root.s - s) <= reach for s, reach in known_about.items())
        # a root at the edge of two panels is found twice
        is_new = not is_known and _is_apart(root.s, single, SAME_PLACE)
        if is_new and _loses_rank(measured, root.s, size):
            single.append(root)
    # single roots beside a common contact are the same point, found less accurately
    multiple += [contact for contact in single if _is_apart(contact.s, multiple, MULTIPLE_ROOT_RADIUS)]
    return sorted(multiple, key=lambda contact: contact.s)


def _simple_root(measured: MeasuredMatrix, candidate: Candidate) -> Contact | None:
    """Refine a simple root of a panel's g at its own poses; None if it is not one.

    Newton's method takes dg/ds from the panel's series. Let u, v be the singular vectors of the matrix at the
    root. With their border, g is (b . u) (c . v) times the g of the panel's border b, c.
    """
    max_poses = 4
    longest_step = 1e-5  # in s; the panel's own root is off by its truncation error
    # least |dg/ds| for which rounding of g, 1e-15, moves the root by less than SAME_PLACE
    least_slope = 1e-6
    panel, s = candidate.panel, candidate.s
    if panel.border.b.shape[1] > 1:
        return None
    for _ in range(max_poses):
        pose = measured.branch.close(np.array([s]))
        matrix = measured.matrix(pose)  # (1, n, n)
        border = Border.of(matrix[0])
        if measured.border_width(border.values) > 1:
            return None
        factor = float(np.vdot(panel.border.b, border.b) * np.vdot(panel.border.c, border.c))
        slope = factor * panel.slope(s)
        if abs(slope) < least_slope:
            return None
        # M c + b g = 0: the border's own c is the null vector of the bordered matrix
        g = -float(border.b[:, 0] @ matrix[0] @ border.c[:, 0])
        step = -g / slope
        s += step
        if abs(step) > longest_step or not 0.0 < s < 1.0:
            return None
        if abs(step) < ROOT_ROUNDING:
            # the sign of a singular matrix is rounding, and so is that of the factor
            return Contact(s, "transversal", slope=math.copysign(1.0, factor) * slope, pose=pose)
    return None


def find_near_misses(measured: MeasuredMatrix, resolved: list[Panel], known: list[Contact]) -> list[NearMiss]:
    """Find the near misses along the path, ascending in s.

    `resolved` are the panels of g along the whole path, `known` its contacts.
    """
    share = NEAR_MISS**measured.power  # with power 2 singular values are squares
    # |g| is at least the least singular value, as 1 / g = -c' M^-1 b, and at most the sum of |coefficients|
    level = share * max(
        (np.abs(p.series).sum() if p.border.b.shape[1] == 1 else least_singular_values(p.matrices).max())
        for p in resolved
    )
    candidates = [
        _miss_at_end(measured, resolved[0], known, level, 0.0),
        _miss_at_end(measured, resolved[-1], known, level, 1.0),
    ]
    for panel in resolved:
        starts = panel.path_coordinates(panel.extrema).tolist()
        candidates += [_miss_at_extremum(measured, panel.matrix(s), known, level, s) for s in starts]

    misses = list[NearMiss]()
    for miss in candidates:
        if miss is not None and _is_apart(miss.s, misses, DISTINCT_EXTREMA):
            misses.append(miss)
    if misses:
        level = share * max(least_singular_values(panel.matrices).max() for panel in resolved)
    return sorted((miss for miss in misses if abs(miss.g) < level), key=lambda miss: miss.s)


def _miss_at_extremum(
    measured: MeasuredMatrix, matrix: Array, known: list[Contact], level: float, start: float
) -> NearMiss | None:
    """Return the extremum of g nearest to s = `start` as a near miss, else None.

    An extremum is no near miss if g is zero there, or if a `known` contact lies between the points where |g|
    has doubled; nor if the least singular value of the `matrix` (n, n) at the start is above `level`.
    """
    if least_singular_values(matrix) >= level:
        return None
    size = measured.border_width(singular_values(matrix))
    extremum = extremum_near(measured.evaluate, measured.knots, start, size)
    lower, upper = extremum.bracket(2 * abs(extremum.g))
    has_contact = any(lower <= contact.s <= upper for contact in known)
    if extremum.is_touch or extremum.roots() or has_contact:
        return None
    g = _signed_least_value(measured.evaluate(np.array([extremum.s])))
    return NearMiss(extremum.s, g, width=min(extremum.s - lower, upper - extremum.s), size=size)


def _miss_at_end(
    measured: MeasuredMatrix, panel: Panel, known: list[Contact], level: float, s: float
) -> NearMiss | None:
    """Return the path's end s, 0 or 1, as a near miss if |g| decreases outwards, else None.

    The end is no near miss if a `known` contact is closer than the distance over which g changes by its own
    value; nor if the least singular value at the end of its `panel` is above `level`.
    """
    outwards = 2.0 * s - 1.0  # -1 or 1: local coordinate of the end, and the direction out of the path
    degrees = np.arange(len(panel.series))
    at_end = panel.series * outwards**degrees  # T_k(1) = 1 and T_k(-1) = (-1)^k
    value = at_end.sum()
    slope = outwards * (at_end @ degrees**2)  # T_k'(1) = k^2
    if value * slope * outwards >= 0.0:  # |g| grows outwards
        return None
    # distance in s over which g changes by its own value, if it is linear; local coordinates span 2
    width = float(0.5 * panel.width * abs(value / slope))
    matrix = panel.matrices[0 if s == 0.0 else -1]
    values = singular_values(matrix)
    if values[-1] >= level or not _is_apart(s, known, width):
        return None
    return NearMiss(s, _signed_least_value(matrix[None]), width, measured.border_width(values))


def _signed_least_value(matrix: Array) -> float:
    """Compute the least singular value of a matrix (1, n, n) with the sign of its determinant."""
    return float(solve_bordered(matrix, Border.of(matrix[0])).g[0])


def _is_apart(s: float, points: Sequence[Contact | NearMiss], distance: float) -> bool:
    """Return whether s is farther than a distance, in s, from all points."""
    return all(abs(s - point.s) > distance for point in points)


def _contacts_beside(measured: MeasuredMatrix, extremum: Extremum, size: int) -> tuple[list[Contact], float]:
    """Find the contacts at or beside an extremum of g with a border of `size` columns.

    If g is zero at the extremum within rounding, this is the contact. Otherwise the contacts are the roots of
    g beside the extremum, at most two.

    Returns:
        The contacts; the distance from the extremum, in s, up to which they are all roots of g.
    """
    s = extremum.s
    if extremum.is_touch:  # g is zero at the extremum within its rounding
        if not _loses_rank(measured, s, size):
            return [], 0.0
        lower, upper = extremum.bracket(extremum.rounding)  # between these, g is zero within rounding
        contact = Contact(s, "tangential", resolution=upper - lower)
        if extremum.changes_sign:
            contact = Contact(s, "transversal")
        # with a margin of 2 for roots of wider panels, which are less accurate
        return [contact], 2 * max(upper - s, s - lower, 0.5 * DISTINCT_EXTREMA)
    roots = [root for root in extremum.roots() if _loses_rank(measured, root, size)]
    # g has another extremum before any root farther out than 1.5 times the farther of these roots
    reach = 1.5 * max((abs(root - s) for root in roots), default=0.0)
    return [Contact(root, "transversal") for root in roots], reach


def _loses_rank(measured: MeasuredMatrix, s: float, size: int) -> bool:
    """Return whether the least singular value vanishes at a root s of det G.

    If several singular values are small (`size` > 1), det G is small even where none of them vanishes.
    """
    return size == 1 or measured.count_lost_ranks(s) > 0


# ------------------------------------------------------------------ several singular values at once


def _find_common_contact(measured: MeasuredMatrix, start: float, size: int) -> Contact | None:
    """Find a contact near s = `start` where two or more singular values vanish; None without one.

    The Gauss-Newton method minimises the norm of the block G of `bordered_system`, whose entries all vanish
    at the contact.

    Args:
        size: number of columns of the border, which is the number of small singular values.
    """
    radius = 5e-3  # in s, from a candidate to the point at which several singular values vanish
    s = start
    for _ in range(MAX_ITERATIONS):
        G, slope, second_derivative = block_slopes(measured.evaluate, s, size)  # (size, size) each
        step = -np.sum(G * slope) / max(np.sum(slope * slope), LEAST_DIVISOR)  # in s
        if not abs(s + step - start) < radius:
            break
        s = float(np.clip(s + step, 0.0, 1.0))
        if abs(step) < NEWTON_STEP:
            break

    # slopes of the singular values, relative to the curvature of G if this is large
    largest_slope, *_, least_slope = singular_values(slope) / max(np.abs(second_derivative).max(), 1.0)
    kind = "transversal" if least_slope > TANGENTIAL_SLOPE else "tangential"
    # Where G has no slope, Gauss-Newton converges only linearly. But every linear function of G has an
    # extremum there. That of the inner product with the panel's end blocks G[0] and G[-2] is sharp, because
    # it weights each entry by its size at both ends; G[-1] is that of the current estimate.
    if largest_slope < TANGENTIAL_SLOPE or abs(step) > NEWTON_STEP:
        s = extremum_near(
            measured.evaluate, measured.knots, s, size, lambda G: np.sum(G * (G[0] + G[-2]), axis=(1, 2))
        ).s
        kind = "tangential"
    # small singular values need not vanish
    is_contact = abs(s - start) <= radius and measured.count_lost_ranks(s) >= 2
    return Contact(s, kind) if is_contact else None


def block_slopes(matrices: Callable[[Array], Array], s: float, size: int) -> tuple[Array, Array, Array]:
    """Compute G and two derivatives (size, size) by central differences at s, with the border at s.

    Close to an end of the path the stencil stays inside the path, and the slope is extrapolated to s.

    Args:
        matrices: computes the matrices (T, n, n) at path coordinates (T,).
        size: number of columns of the border.
    """
    h = DIFFERENCE_STEP
    middle = float(np.clip(s, h, 1.0 - h))
    stack = matrices(np.array([middle - h, middle, middle + h, s]))
    lower, centre, upper, G = solve_bordered(stack, Border.of(stack[-1], size)).G
    second_derivative = (lower - 2 * centre + upper) / h**2
    slope = (upper - lower) / (2 * h) + (s - middle) * second_derivative
    return G, slope, second_derivative
