"""Convex polytopes of few dimensions that sums and bounds of linear maps make: zonotopes and slabs.

Both are symmetric about a centre, and both come as half-spaces and as vertices, found by enumeration: for a
robot's handful of motors that is exact and quick, and needs no hull. Facets of a zonotope are normal to n - 1
of its generators (P. McMullen, On zonotopes, Trans. Amer. Math. Soc. 159, 1971).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from framework.numerics.arrays import Array, BoolArray, ReadOnlyArrays
from framework.numerics.ordered_sums import singular_values
from framework.numerics.subspaces import split_row_space
from framework.tolerances import RANK_ROUNDING, SAME_PLACE


@dataclass(frozen=True, eq=False)
class Polytope(ReadOnlyArrays):
    """The points y (n,) with normals y <= offsets.

    A flat polytope has pairs of opposite half-spaces. One without bound along `free` directions has the
    vertices of its section orthogonal to them.
    """

    normals: Array  # (h, n) of unit size
    offsets: Array  # (h,)
    vertices: Array  # (k, n)
    free: Array  # (f, n) orthonormal directions without bound

    def contains(self, points: Array) -> BoolArray:
        """Whether points (..., n) are inside, but for rounding."""
        size = np.abs(self.offsets).max(initial=0.0)
        return np.all(points @ self.normals.T <= self.offsets + SAME_PLACE * size, axis=-1)

    def reach(self, direction: Array) -> tuple[float, float]:
        """Compute the least and the largest t with t direction (n,) inside.

        Both are NaN if no t is. Each half-space says slope t <= offset, slope = normal . direction: an upper
        end where the slope is positive, a lower end where it is negative. Without a slope it holds for all t,
        or for none.
        """
        slope = self.normals @ direction
        is_steep = np.abs(slope) > RANK_ROUNDING * np.linalg.norm(direction)
        size = np.abs(self.offsets).max(initial=0.0)
        if np.any(self.offsets[~is_steep] < -SAME_PLACE * size):
            return np.nan, np.nan
        ends = self.offsets[is_steep] / slope[is_steep]
        slope = slope[is_steep]
        low = float(ends[slope < 0].max(initial=-np.inf))
        high = float(ends[slope > 0].min(initial=np.inf))
        if low <= high:
            return low, high
        touches = low - high <= SAME_PLACE * max(abs(low), abs(high))  # but for rounding
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
    """Compute the sums of centre (n,) and generators (m, n), each times a factor in [-1, 1].

    Its half-space along a unit normal N has the offset N . centre + sum of |N . generator|. Normals across
    the generators make a flat zonotope flat.
    """
    span, across = split_row_space(generators, RANK_ROUNDING)
    facet_normals = [normal[None] @ span for normal in _facet_normals(generators @ span.T)]
    normals = np.concatenate([across, *facet_normals])
    normals = _remove_repeated(np.concatenate([normals, -normals]))
    width = np.abs(normals @ generators.T).sum(axis=1)
    is_across = np.abs(normals @ span.T).max(axis=1, initial=0.0) < RANK_ROUNDING
    width[is_across] = 0.0  # but for rounding
    offsets = normals @ centre + width
    points = _remove_repeated(centre + _sign_combinations(len(generators)) @ generators)
    return Polytope(normals, offsets, _select_vertices(points, normals, offsets), np.empty((0, len(centre))))


def slabs(rows: Array, limits: Array) -> Polytope:
    """Return the points y (n,) with |rows y| <= limits, rows (m, n) and positive limits (m,).

    With r independent rows, r of them at their limits, of either sign, meet in 2^r corners. Those that keep
    the other limits are the vertices.
    """
    sizes = np.linalg.norm(rows, axis=1)
    acting = sizes > 0
    units = rows[acting] / sizes[acting][:, None]
    span, free = split_row_space(rows, RANK_ROUNDING)
    rank, largest = len(span), singular_values(rows).max(initial=0.0)
    in_span = rows @ span.T  # (m, r)
    signs = _sign_combinations(rank)  # (2^r, r)
    subsets = combinations(range(len(rows)), rank) if rank else ()
    points = [np.zeros((0, rows.shape[1]))]
    for subset in map(list, subsets):
        if singular_values(in_span[subset])[-1] > RANK_ROUNDING * largest:
            corners = np.linalg.solve(in_span[subset], (signs * limits[subset]).T)  # (r, 2^r)
            points.append(corners.T @ span)
    vertices = np.concatenate(points)
    vertices = vertices[np.all(np.abs(vertices @ rows.T) <= limits * (1 + SAME_PLACE), axis=1)]
    return Polytope(
        normals=np.concatenate([units, -units]),
        offsets=np.tile(limits[acting] / sizes[acting], 2),
        vertices=_remove_repeated(vertices),
        free=free,
    )


def _sign_combinations(count: int) -> Array:
    """Return all combinations (2^count, count) of the signs -1 and 1."""
    return np.array(list(product((-1.0, 1.0), repeat=count)))


def _facet_normals(generators: Array) -> list[Array]:
    """Return the unit normals (n,) of every n - 1 independent generators (m, n)."""
    n = generators.shape[1]
    normals = []
    if n == 1:
        return [np.ones(1)]
    for subset in combinations(range(len(generators)), n - 1) if n else ():
        _, values, right = np.linalg.svd(generators[list(subset)])
        if values[-1] > RANK_ROUNDING * values[0]:
            normals.append(right[n - 1])
    return normals


def _remove_repeated(points: Array) -> Array:
    """Return the points (k, n) without repetitions, equal but for rounding."""
    size = np.abs(points).max(initial=0.0)
    if not size:
        return points[:1]
    _, first = np.unique(np.round(points / size, 9) + 0.0, axis=0, return_index=True)
    return points[np.sort(first)]


def _select_vertices(points: Array, normals: Array, offsets: Array) -> Array:
    """Return the vertices among points (k, n), at which the touching half-spaces leave no freedom."""
    size = np.abs(offsets).max(initial=0.0)
    touches = points @ normals.T >= offsets - SAME_PLACE * size  # (k, h)
    ranks = [np.linalg.matrix_rank(normals[row], tol=RANK_ROUNDING) for row in touches]
    return points[np.array(ranks) == points.shape[1]]
