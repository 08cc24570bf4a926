"""Cells of platform coordinates that are proved to be free of singularities, on one branch each.

In a cell about a middle x_m, with joints q_m there and Y the inverse of dF/dq, F = [platform - x ; loops],
the joints are q_m + Y (x - x_m) but for an error e, if by the bounds of `slope_bounds` the map q - Y F takes
the box |q - q_m| < r into itself and contracts it (Krawczyk). Then for every x of the cell the box has one
pose and no Type 1 singularity; and none of Type 2 if a matrix that bounds |1 - Y_P P| there,

    |1 - Y_P P_m| + sum_i |Y_P dP/dq . Y_i| |dx_i| + |Y_P| (|dP/dq| e + change of dP/dq),    Y_P near 1 / P_m,

has a spectral radius below 1. A turn of the platform is measured from the middle by the part of
R R_m' that is not symmetric, the sine of the angle: no more than the change of its coordinates.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray, IntArray
from framework.kinematics.slope_bounds import SlopeBounds
from framework.linalg.interval_newton import gamma, inverses
from framework.linalg.krawczyk import UP

PASSES = 6  # to widen the box of joints until the test holds
WIDEST = 10.0  # [rad, lengths] a box of joints
SMALL = 1e-14  # [rad, lengths] least radius of one


class Cells(NamedTuple):
    """S cells with joints at their middles."""

    z: Array  # (S, n) middles off the pose [robot lengths, rad]
    q: Array  # (S, nq)
    proved: BoolArray  # (S,)
    slope: Array  # (S, k, n) of the joints along the platform's coordinates
    error: Array  # (S, k) beside q + slope dz
    radii: Array  # (S, k) of the box with one pose for each x
    signs: Array  # (S, 2) of det dF/dq and det P at the middle

    def take(self, which: BoolArray | IntArray) -> Cells:
        """Some of them."""
        return Cells(*(part[which] for part in self))  # type: ignore[arg-type]


class Prover(NamedTuple):
    """A robot about a pose of its platform."""

    bounds: SlopeBounds
    x: Array  # (n,)
    scale: Array  # (n,)

    def cells(self, z: Array, q: Array, half: Array, *, ball: bool = False) -> Cells:
        """Test cells of half a width (S,), or balls of that radius, joints q (S, nq) near their middles."""
        bounds, robot = self.bounds, self.bounds.robot
        n, n_a, k = robot.n, robot.n_a, len(robot.moving)
        at = bounds.at(q)
        off = robot.platform.residual(at.frames, self.x + z * self.scale) / self.scale
        values = np.concatenate([off, at.values[:, n:]], axis=1)
        Y = inverses(at.slopes)
        size, along = np.abs(Y), Y[:, :, :n]
        exact = np.abs(np.einsum("sij,sj->si", Y, values))
        exact += np.einsum("sij,sj->si", size, gamma(k) * np.abs(values) + bounds.rounding)
        reach = (np.linalg.norm(along, axis=2) if ball else np.abs(along).sum(axis=2)) * half[:, None]
        rest = np.abs(np.eye(k) - Y @ at.slopes) + gamma(k) * (size @ np.abs(at.slopes) + np.eye(k))
        radii = 1.1 * (exact + reach) + SMALL
        for _ in range(PASSES):
            changes = at.changes(radii)
            error = np.einsum("sij,sj->si", size, changes.values) + np.einsum("sij,sj->si", rest, radii)
            error = UP * (exact + error)
            contracts = _below_one(size @ changes.slopes + rest, radii)
            into = UP * (reach + error) < radii
            proved = into.all(axis=1) & contracts & (size > 0).any(axis=(1, 2))
            if proved.all():
                break
            last = radii
            radii = np.where(proved[:, None], radii, np.minimum(1.1 * (reach + error), WIDEST) + SMALL)
        else:
            radii = last
        P, D = at.slopes[:, n:, n_a:], at.seconds[:, n:, n_a:]
        Y_P, s = inverses(P), k - n_a
        size_P, a_D = np.abs(Y_P), np.abs(D)
        moved = np.einsum("sij,sjkl,sln->sikn", Y_P, D, along, optimize=True)
        moved = np.linalg.norm(moved, axis=3) if ball else np.abs(moved).sum(axis=3)
        a_moved = np.einsum("sij,sjkl,sl->sik", size_P, a_D, np.abs(along).sum(axis=2), optimize=True)
        N = np.abs(np.eye(s) - Y_P @ P) + gamma(s) * (size_P @ np.abs(P) + np.eye(s))
        N += (moved + gamma(s * k) * a_moved) * half[:, None, None]
        beside = np.einsum("sjkl,sl->sjk", a_D + bounds.rounding, error)
        beside += 0.5 * np.einsum("sjkl,sl->sjk", changes.seconds[:, n:, n_a:], radii)
        N = UP * (N + size_P @ (beside + bounds.rounding * (1 + reach.sum(axis=1))[:, None, None]))
        regular = _below_one(N, np.ones((1, s))) & (size_P > 0).any(axis=(1, 2))
        signs = np.stack([np.linalg.slogdet(at.slopes)[0], np.linalg.slogdet(P)[0]], axis=1)
        return Cells(z, q, proved & regular, along, error, radii, signs)


def _below_one(N: Array, weights: Array) -> BoolArray:
    """Whether matrices N (S, k, k) without sign have a spectral radius below 1: N w < w for some w > 0."""
    rows = N.sum(axis=2)
    tried = weights, np.ones_like(rows), rows + 0.1 * rows.max(axis=1, keepdims=True)
    passed = [
        (UP * np.einsum("sij,sj->si", N, np.broadcast_to(w, rows.shape)) < w).all(axis=1) for w in tried
    ]
    return np.asarray(np.any(passed, axis=0))
