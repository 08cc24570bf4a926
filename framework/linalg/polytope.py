"""Convex polytopes of few dimensions that sums and bounds of linear maps make: zonotopes and slabs.

Both are symmetric about a centre, and both come as half-spaces and as vertices, found by enumeration: for a
robot's handful of motors that is exact and quick, and needs no hull. Facets of a zonotope are normal to n - 1
of its generators (P. McMullen, On zonotopes, Trans. Amer. Math. Soc. 159, 1971).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from framework.arrays import Array, BoolArray, ReadOnlyArrays
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
        return np.asarray(np.all(points @ self.normals.T <= self.offsets + SAME_PLACE * size, axis=-1))

    def reach(self, direction: Array) -> tuple[float, float]:
        """Compute the least and the largest t for which t direction (n,) is inside; (nan, nan) if none is."""
        slope = self.normals @ direction
        steep = np.abs(slope) > RANK_ROUNDING * np.linalg.norm(direction)
        size = np.abs(self.offsets).max(initial=0.0)
        if np.any(self.offsets[~steep] < -SAME_PLACE * size):
            return np.nan, np.nan
        ends = self.offsets[steep] / slope[steep]
        low = float(ends[slope[steep] < 0].max(initial=-np.inf))
        high = float(ends[slope[steep] > 0].min(initial=np.inf))
        if low > high:
            return (np.nan, np.nan) if low - high > SAME_PLACE * max(abs(low), abs(high)) else (high, high)
        return low, high

    def alone(self) -> Array:
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
    """Compute the sums centre (n,) + t_1 g_1 + ... + t_m g_m of generators (m, n), every |t_k| <= 1."""
    n = len(centre)
    _, values, right = np.linalg.svd(generators)
    rank = int(np.sum(values > RANK_ROUNDING * values.max(initial=0.0)))
    span, across = right[:rank], right[rank:]
    inside = generators @ span.T  # (m, rank)
    directions = [across]
    for chosen in combinations(range(len(generators)), max(rank - 1, 0)) if rank else ():
        normal = _normal(inside[list(chosen)], rank)
        if normal is not None:
            directions.append(normal[None] @ span)
    normals = np.concatenate([np.reshape(part, (-1, n)) for part in directions])
    normals = _distinct(np.concatenate([normals, -normals]))
    width = np.abs(normals @ generators.T).sum(axis=1)
    across_the_flat = np.abs(normals @ span.T).max(axis=1, initial=0.0) < RANK_ROUNDING
    width[across_the_flat] = 0.0  # but for rounding
    offsets = normals @ centre + width
    signs = np.array(list(product((-1.0, 1.0), repeat=len(generators))))
    points = _distinct(centre + signs @ generators)
    return Polytope(normals, offsets, _extreme(points, normals, offsets), np.empty((0, n)))


def slabs(rows: Array, limits: Array) -> Polytope:
    """Return the points y (n,) with |rows y| <= limits, rows (m, n) and positive limits (m,)."""
    n = rows.shape[1]
    sizes = np.linalg.norm(rows, axis=1)
    kept = sizes > 0
    normals = np.concatenate([rows[kept], -rows[kept]]) / np.tile(sizes[kept], 2)[:, None]
    offsets = np.tile(limits[kept] / sizes[kept], 2)
    _, values, right = np.linalg.svd(rows)
    rank = int(np.sum(values > RANK_ROUNDING * values.max(initial=0.0)))
    free, span = right[rank:], right[:rank]
    inside = rows @ span.T
    points = [np.zeros((0, n))]
    for chosen in combinations(range(len(rows)), rank) if rank else ():
        square = inside[list(chosen)]
        if np.linalg.svd(square, compute_uv=False)[-1] > RANK_ROUNDING * values[0]:
            corners = np.array(list(product((-1.0, 1.0), repeat=rank))) * limits[list(chosen)]
            points.append(np.linalg.solve(square, corners.T).T @ span)
    corners = np.concatenate(points)
    corners = corners[np.all(np.abs(corners @ rows.T) <= limits * (1 + SAME_PLACE), axis=1)]
    return Polytope(normals, offsets, _distinct(corners), free)


def _normal(rows: Array, n: int) -> Array | None:
    """Compute the unit vector (n,) orthogonal to rows (n - 1, n); None if there are several."""
    if not len(rows):
        return np.ones(1)
    _, values, right = np.linalg.svd(rows)
    return None if values[-1] <= RANK_ROUNDING * values[0] or values[0] == 0.0 else right[n - 1]


def _distinct(points: Array) -> Array:
    """Return points (k, n) without those that repeat others but for rounding."""
    size = np.abs(points).max(initial=0.0)
    if not size:
        return points[:1]
    _, first = np.unique(np.round(points / size, 9) + 0.0, axis=0, return_index=True)
    return points[np.sort(first)]


def _extreme(points: Array, normals: Array, offsets: Array) -> Array:
    """Return the vertices among points (k, n), at which the touching half-spaces leave no freedom."""
    size = np.abs(offsets).max(initial=0.0)
    touching = points @ normals.T >= offsets - SAME_PLACE * size
    n = points.shape[1]
    return points[[np.linalg.matrix_rank(normals[touched], tol=RANK_ROUNDING) == n for touched in touching]]
