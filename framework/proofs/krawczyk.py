"""Proof that a system of quadrics has exactly one solution near an approximate one: Krawczyk's test.

For H(z) = 0, an approximate solution z, a matrix Y near the inverse of its Jacobian J and radii r: if

    |Y H(z)| + max |I - Y J(Z)| r < r    over the polydisc Z = z + D(r),

H has one solution in Z and no other (Krawczyk 1969; Rump 1983; for holomorphic H on discs as well). Rounding
is bounded as `rounding` says. The coefficients may be discs themselves; then the proof is for every system in
them.

A solution of a real system in a polydisc about a real point is real: its conjugate is in it too, and there is
one alone. A polydisc away from its mirror image holds a solution that is not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray
from framework.proofs.rounding import ROUND_UP, WIDENING_RATIO, gamma
from framework.proofs.study_quadric import ComplexArray

MAX_WIDENINGS = 6  # of the radii until the test holds
MIN_RADIUS, MAX_RADIUS = 1e-300, 1e100  # away from underflow and overflow
RANDOM_CHARTS = 200


class Enclosures(NamedTuple):
    """Polydiscs about S points of P^(N-1), in the chart."""

    proved: BoolArray  # (S,) each holds exactly one solution
    radii: Array  # (S, N), infinite where none are proved


def enclosures(quadrics: ComplexArray, radii: Array, chart: Array, z: ComplexArray) -> Enclosures:
    """Enclose solutions z (S, N) of N - 1 quadrics with coefficients in discs.

    The equations are z' Q z = 0 for Q (N - 1, N, N), and chart . z = 1.

    Args:
        quadrics: the middles of the symmetric matrices.
        radii: (N - 1, N, N) of their entries; zero where they are exact as they stand.
        chart: (N,) real and exact, z in it.
    """
    discs = np.array([_radii(quadrics, radii, chart, point) for point in z]).reshape(z.shape)
    return Enclosures(np.isfinite(discs).all(axis=1), discs)


def _radii(quadrics: ComplexArray, radii: Array, chart: Array, z: ComplexArray) -> Array:
    """Find radii (N,) about a solution z (N,) in which the test holds; infinite if none are found."""
    N, size = len(z), np.abs(z)
    rounding = gamma(2 * N)  # of a quadratic form in complex numbers
    J = np.vstack([2 * quadrics @ z, chart])
    try:
        Y = np.linalg.inv(J)
    except np.linalg.LinAlgError:
        return np.full(N, np.inf)
    Y_size, sizes = np.abs(Y), ROUND_UP * np.abs(quadrics)
    uncertainty = rounding * sizes + radii
    values = np.append(np.einsum("kij,i,j->k", quadrics, z, z), z @ chart - 1.0)
    errors = np.append(
        np.einsum("kij,i,j->k", uncertainty, size, size), rounding * (np.abs(chart) @ size + 1.0)
    )
    off = ROUND_UP**2 * (Y_size @ (np.abs(values) + ROUND_UP * errors))
    slack = np.vstack([2 * ROUND_UP * uncertainty @ size, rounding * np.abs(chart)])
    identity = np.eye(N)
    rest = np.abs(identity - Y @ J) + rounding * (Y_size @ np.abs(J) + identity) + Y_size @ slack
    return _widen(off, rest, Y_size, sizes + radii)


def _widen(off: Array, rest: Array, Y_size: Array, sizes: Array) -> Array:
    """Widen radii (N,) until the test maps the polydisc into itself; infinite if never."""
    r = 2 * off + MIN_RADIUS
    for _ in range(MAX_WIDENINGS):
        spread = np.vstack([2 * ROUND_UP * sizes @ r, np.zeros(len(r))])
        needed = ROUND_UP * (off + ROUND_UP**2 * ((rest + Y_size @ spread) @ r))
        if np.all(needed < r):
            return r
        r = WIDENING_RATIO * needed + MIN_RADIUS
        if not r.max() < MAX_RADIUS:
            break
    return np.full(len(r), np.inf)


def chart_for(z: ComplexArray, seed: int = 0) -> Array:
    """Choose a random real chart (N,) with a plane at infinity far from all points z (S, N)."""
    charts = np.random.default_rng(seed).standard_normal((RANDOM_CHARTS, z.shape[1]))
    charts /= np.linalg.norm(charts, axis=1, keepdims=True)
    heights = np.abs(charts @ z.T) / np.linalg.norm(z, axis=1)
    return charts[np.argmax(heights.min(axis=1, initial=np.inf))]


def are_apart(z: ComplexArray, radii: Array) -> bool:
    """Whether polydiscs about z (S, N) have nothing in common with one another."""
    gap = np.abs(z[:, None] - z[None]) / ROUND_UP - radii[:, None] - radii[None]
    disjoint = (gap > 0).any(axis=2) | np.eye(len(z), dtype=bool)
    return bool(disjoint.all())
