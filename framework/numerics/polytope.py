"""Convex polytopes of few dimensions: zonotopes (images of boxes) and slabs (bounds of linear maps).

Both are symmetric about a centre, and both are given by half-spaces and by vertices. These are found by
enumeration, which is exact and fast for the few motors of a robot and needs no convex hull. The normal of a
facet of a zonotope is orthogonal to n - 1 of its generators (P. McMullen, On zonotopes, Trans. Amer. Math.
Soc. 159, 1971).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from framework.numerics.arrays import Array, BoolArray, ReadOnlyArrays
from framework.numerics.ordered_sums import least_singular_values, singular_values, split_row_space
from framework.tolerances import RANK_ROUNDING, SAME_PLACE


@dataclass(frozen=True, eq=False)
class Polytope(ReadOnlyArrays):
    """The points y (n,) with normals y <= offsets.

    A flat polytope has pairs of opposite half-spaces. The vertices of an unbounded polytope are those of its
    section orthogonal to the `free` directions.
    """

    normals: Array  # (h, n) of unit size
    offsets: Array  # (h,)
    vertices: Array  # (k, n)
    free: Array  # (f, n) orthonormal directions in which it is unbounded

    @property
    def rounding(self) -> float:
        """Distance at which a point counts as lying on a half-space's boundary."""
        return float(SAME_PLACE * np.abs(self.offsets).max(initial=0.0))

    def contains(self, points: Array) -> BoolArray:
        """Return which points (..., n) are inside, up to rounding."""
        return np.all(points @ self.normals.T <= self.offsets + self.rounding, axis=-1)

    def reach(self, direction: Array) -> tuple[float, float]:
        """Compute the least and the largest t at which the point t direction (n,) is inside.

        Both are NaN if the line of these points misses the polytope. A value is infinite where the polytope
        is unbounded. On the line a half-space is slope t <= offset, with slope = normal . direction. It
        bounds t from above if the slope is positive, and from below if it is negative. If the slope is zero,
        the half-space contains the whole line or none of it.
        """
        slope = self.normals @ direction  # (h,)
        least_slope = RANK_ROUNDING * np.linalg.norm(direction)  # a smaller slope is rounding of zero
        is_upper = slope > least_slope
        is_lower = slope < -least_slope
        is_parallel = ~(is_upper | is_lower)
        if np.any(self.offsets[is_parallel] < -self.rounding):  # not even t = 0 is inside
            return np.nan, np.nan
        low = float((self.offsets[is_lower] / slope[is_lower]).max(initial=-np.inf))
        high = float((self.offsets[is_upper] / slope[is_upper]).min(initial=np.inf))
        if low <= high:
            return low, high
        # rounding alone may put `low` above `high` where the line touches the polytope at one point
        touches = low - high <= SAME_PLACE * max(abs(low), abs(high))
        return (high, high) if touches else (np.nan, np.nan)

    def axis_ranges(self) -> Array:
        """Compute the range (n, 2) of each coordinate when all others are zero, see `reach`."""
        return np.array([self.reach(axis) for axis in np.eye(self.normals.shape[1])])

    def bounds(self) -> Array:
        """Compute the range (n, 2) of each coordinate over all values of the others."""
        if not len(self.vertices):
            return np.tile([-np.inf, np.inf], (self.normals.shape[1], 1))
        ranges = np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)], axis=1)
        unbounded = np.abs(self.free).max(axis=0, initial=0.0) > RANK_ROUNDING
        ranges[unbounded] = [-np.inf, np.inf]
        return ranges


def zonotope(centre: Array, generators: Array) -> Polytope:
    """Return the zonotope of centre (n,) plus generators (m, n), each times a factor in [-1, 1].

    The facets have the normals that `_facet_normals` finds within the span of the generators. The half-space
    along a unit normal N has the offset N . centre + sum of |N . generator|. If the generators do not span
    all n dimensions, normals orthogonal to them make the zonotope flat.
    """
    span, across = split_row_space(generators, RANK_ROUNDING)  # (r, n), (n - r, n)
    # (1, n) each, found in the r coordinates of the span
    facet_normals = [normal[None] @ span for normal in _facet_normals(generators @ span.T)]
    half_of_normals = np.concatenate([across, *facet_normals])  # one of each opposite pair
    normals = _remove_repeated(np.concatenate([half_of_normals, -half_of_normals]))

    widths = np.abs(normals @ generators.T).sum(axis=1)
    is_across = np.abs(normals @ span.T).max(axis=1, initial=0.0) < RANK_ROUNDING
    widths[is_across] = 0.0  # exactly, without rounding
    offsets = normals @ centre + widths

    # the vertices are among the images of the corners of the box
    points = _remove_repeated(centre + sign_combinations(len(generators)) @ generators)
    # vertices are the points at which the normals of touching half-spaces have rank n
    rounding = SAME_PLACE * np.abs(offsets).max(initial=0.0)
    touches = points @ normals.T >= offsets - rounding  # (k, h) whether a point is on a boundary
    ranks = [np.linalg.matrix_rank(normals[row], tol=RANK_ROUNDING) for row in touches]
    vertices = points[np.array(ranks) == points.shape[1]]
    return Polytope(normals, offsets, vertices, free=np.empty((0, len(centre))))


def slabs(rows: Array, limits: Array) -> Polytope:
    """Return the polytope of points y (n,) with |rows y| <= limits.

    If the rows have rank r, any r independent rows at their limits, of either sign, meet in 2^r corners. The
    vertices are the corners that satisfy the other limits.

    Args:
        rows: (m, n).
        limits: (m,), positive.
    """
    span, free = split_row_space(rows, RANK_ROUNDING)
    rank = len(span)
    rounding = RANK_ROUNDING * singular_values(rows).max(initial=0.0)
    in_span = rows @ span.T  # (m, r) rows in coordinates of the row space
    signs = sign_combinations(rank)  # (2^r, r)
    corners = [np.zeros((0, rows.shape[1]))]  # the only ones without a rank
    for subset in combinations(range(len(rows)), rank) if rank else ():
        chosen = list(subset)
        if least_singular_values(in_span[chosen]) > rounding:  # the rows are independent
            coordinates = np.linalg.solve(in_span[chosen], (signs * limits[chosen]).T)  # (r, 2^r)
            corners.append(coordinates.T @ span)
    points = np.concatenate(corners)
    is_vertex = np.all(np.abs(points @ rows.T) <= limits * (1 + SAME_PLACE), axis=1)

    lengths = np.linalg.norm(rows, axis=1)
    is_bound = lengths > 0  # a row of zeros bounds nothing
    units = rows[is_bound] / lengths[is_bound][:, None]
    return Polytope(
        normals=np.concatenate([units, -units]),
        offsets=np.tile(limits[is_bound] / lengths[is_bound], 2),
        vertices=_remove_repeated(points[is_vertex]),
        free=free,
    )


def sign_combinations(count: int) -> Array:
    """Return all combinations (2^count, count) of the signs -1 and 1."""
    return np.array(list(product((-1.0, 1.0), repeat=count)))


def _facet_normals(generators: Array) -> list[Array]:
    """Return the unit normal (n,) of each set of n - 1 independent generators out of (m, n).

    Each set has two opposite normals, of which one is returned.
    """
    n = generators.shape[1]
    if n < 2:  # on a line the normal is the line itself; a point has none
        return [np.ones(1)] * n
    normals = []
    for subset in combinations(range(len(generators)), n - 1):
        _, values, V_rows = np.linalg.svd(generators[list(subset)])
        if values.min() > RANK_ROUNDING * values.max():
            normals.append(V_rows[-1])  # the null space of the set
    return normals


def _remove_repeated(points: Array) -> Array:
    """Remove points (k, n) that repeat others up to rounding; keep the order."""
    largest = np.abs(points).max(initial=0.0)  # coordinate
    if not largest:
        return points[:1]
    # points that agree to nine digits of the largest coordinate are equal; + 0.0 turns -0.0 into 0.0
    rounded = np.round(points / largest, 9) + 0.0
    _, first_occurrences = np.unique(rounded, axis=0, return_index=True)
    return points[np.sort(first_occurrences)]
