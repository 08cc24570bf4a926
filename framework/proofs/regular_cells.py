"""Cells of platform coordinates that are proved to be free of singularities, on one branch each.

In a cell about a middle x_m, with joints q_m there and Y the inverse of dF/dq, F = [platform - x ; loops],
the joints are q_m + Y (x - x_m) but for an error e, if by the bounds of `derivative_bounds` the map q - Y F
takes the box |q - q_m| < r into itself and contracts it (Krawczyk). Then for every x of the cell the box has
one pose and no Type 1 singularity; and none of Type 2 if a matrix that bounds |1 - Y_P P| there,

    |1 - Y_P P_m| + sum_i |Y_P dP/dq . Y_i| |dx_i| + |Y_P| (|dP/dq| e + change of dP/dq),    Y_P near 1 / P_m,

has a spectral radius below 1. A turn of the platform is measured from the middle by the part of
R R_m' that is not symmetric, the sine of the angle: no more than the change of its coordinates.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray
from framework.proofs.derivative_bounds import DerivativeBounds, Derivatives, Remainders
from framework.proofs.rounding import ROUND_UP, WIDENING_RATIO, gamma, identity_defect, inverses, times

MAX_WIDENINGS = 6  # of the box of joints, until the test holds
MAX_RADIUS = 10.0  # [rad, lengths] of a box of joints
MIN_RADIUS = 1e-14  # [rad, lengths]
PERRON_SHIFT = 0.1  # of the largest row sum, added to row sums as weights


class Cells(NamedTuple):
    """S cells with joints at their middles."""

    z: Array  # (S, n) middles off the pose [robot lengths, rad]
    q: Array  # (S, nq)
    proved: BoolArray  # (S,)
    slope: Array  # (S, k, n) of the joints along the platform's coordinates
    radii: Array  # (S, k) of the box with one pose for each x
    signs: Array  # (S, 2) of det dF/dq and det P at the middle


class CellTest(NamedTuple):
    """The test of cells about a pose of a robot."""

    bounds: DerivativeBounds
    x: Array  # (n,)
    scale: Array  # (n,)

    def __call__(self, z: Array, q: Array, half: Array, *, ball: bool = False) -> Cells:
        """Test cells of half a width (S,), or balls of that radius, joints q (S, nq) near their middles."""
        bounds, n, n_a = self.bounds, self.bounds.robot.n, self.bounds.robot.n_a
        derivatives = bounds.evaluate(q)
        off = bounds.robot.platform.residual(derivatives.frames, self.x + z * self.scale) / self.scale
        values = np.concatenate([off, derivatives.values[:, n:]], axis=1)
        inverse = inverses(derivatives.slopes)
        along = inverse[:, :, :n]
        box = _joint_boxes(derivatives, values, inverse, _extent(along, half, ball))
        regular = _passive_block_is_regular(derivatives, along, half, box, ball)
        signs = np.stack(
            [np.linalg.slogdet(P)[0] for P in (derivatives.slopes, derivatives.slopes[:, n:, n_a:])], axis=1
        )
        return Cells(z, q, box.proved & regular, along, box.radii, signs)


class _JointBoxes(NamedTuple):
    """Boxes of joints with one pose for each x of a cell."""

    proved: BoolArray  # (S,)
    error: Array  # (S, k)
    radii: Array  # (S, k)
    remainders: Remainders


def _extent(along: Array, half: Array, ball: bool) -> Array:
    """Bound along dz (S, ...) over cells or balls, the last axis that of z (n)."""
    size = np.linalg.norm(along, axis=-1) if ball else np.abs(along).sum(axis=-1)
    return size * half.reshape(-1, *[1] * (size.ndim - 1))


def _joint_boxes(derivatives: Derivatives, values: Array, inverse: Array, reach: Array) -> _JointBoxes:
    """Widen boxes of joints until Krawczyk's test holds; x moves the joints by reach (S, k) at most."""
    k, size = inverse.shape[1], np.abs(inverse)
    exact = np.abs(times(inverse, values)) + times(
        size, gamma(k) * np.abs(values) + derivatives.bounds.rounding
    )
    rest = identity_defect(inverse, derivatives.slopes)
    invertible = (size > 0).any(axis=(1, 2))
    radii = WIDENING_RATIO * (exact + reach) + MIN_RADIUS
    for widening in range(MAX_WIDENINGS):
        remainders = derivatives.remainders(radii)
        error = ROUND_UP * (exact + times(size, remainders.values) + times(rest, radii))
        contracts = _spectral_radius_below_one(size @ remainders.slopes + rest, radii)
        into_itself = (ROUND_UP * (reach + error) < radii).all(axis=1)
        proved = into_itself & contracts & invertible
        if proved.all() or widening == MAX_WIDENINGS - 1:
            break
        wider = np.minimum(WIDENING_RATIO * (reach + error), MAX_RADIUS) + MIN_RADIUS
        radii = np.where(proved[:, None], radii, wider)
    return _JointBoxes(proved, error, radii, remainders)


def _passive_block_is_regular(
    derivatives: Derivatives, along: Array, half: Array, box: _JointBoxes, ball: bool
) -> BoolArray:
    """Whether P = dF/dq of loops and passive joints is regular all over the cells (S,): no Type 2."""
    n, n_a, rounding = derivatives.bounds.robot.n, derivatives.bounds.robot.n_a, derivatives.bounds.rounding
    P, dP = derivatives.slopes[:, n:, n_a:], derivatives.hessians[:, n:, n_a:]
    Y, s, k = inverses(P), P.shape[1], along.shape[1]
    Y_size, dP_size = np.abs(Y), np.abs(dP)
    changes = np.einsum("sij,sjkl,sln->sikn", Y, dP, along, optimize=True)
    step = _extent(along, half, ball=False)
    rounded = np.einsum("sij,sjkl,sl->sik", Y_size, dP_size, step, optimize=True)
    N = identity_defect(Y, P) + _extent(changes, half, ball) + gamma(s * k) * rounded
    beside = np.einsum("sjkl,sl->sjk", dP_size + rounding, box.error)
    beside += 0.5 * np.einsum("sjkl,sl->sjk", box.remainders.hessians[:, n:, n_a:], box.radii)
    beside += rounding * (1 + step.sum(axis=1))[:, None, None]
    N = ROUND_UP * (N + Y_size @ beside)
    return _spectral_radius_below_one(N, np.ones((1, s))) & (Y_size > 0).any(axis=(1, 2))


def _spectral_radius_below_one(N: Array, weights: Array) -> BoolArray:
    """Whether matrices N >= 0 (S, k, k) have a spectral radius below 1, by N w < w."""
    rows = N.sum(axis=2)
    shifted = rows + PERRON_SHIFT * rows.max(axis=1, keepdims=True)  # near the eigenvector of Perron
    below = np.zeros(len(N), dtype=bool)
    for w in (weights, np.ones_like(rows), shifted):
        below |= (ROUND_UP * times(N, np.broadcast_to(w, rows.shape)) < w).all(axis=1)
    return below
