"""Proof that a system of quadrics has exactly one solution near an approximate one: Krawczyk's test.

For H(z) = 0, an approximate solution z, a matrix Y near the inverse of its Jacobian J and radii r: if

    |Y H(z)| + max |I - Y J(Z)| r < r    over the polydisc Z = z + D(r),

H has one solution in Z and no other (Krawczyk 1969; Rump 1983; for holomorphic H on discs as well). All
quantities are bounded from above: what is computed has rounding of at most gamma times the sum of the moduli
of its terms, gamma a generous multiple of their number, and sums of numbers without sign are rounded up. The
coefficients may be discs themselves; then the proof is for every system in them.

A solution of a real system in a polydisc about a real point is real: its conjugate is in it too, and there is
one alone. A polydisc away from its mirror image holds a solution that is not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray
from framework.linalg.quadrics import ComplexArray

UNIT = 2.0**-53
UP = 1.0 + 1e-10  # more than rounding takes from a sum of some hundred numbers without sign
PASSES = 6  # to widen the radii until the test holds
LEAST, WIDEST = 1e-300, 1e100  # radii, away from underflow and overflow


class Enclosures(NamedTuple):
    """Polydiscs about S points of P^(N-1), in the chart."""

    proved: BoolArray  # (S,) each holds exactly one solution
    radii: Array  # (S, N)


def enclosures(quadrics: ComplexArray, radii: Array, chart: Array, z: ComplexArray) -> Enclosures:
    """Enclosures of solutions z (S, N) of z' Q z = 0, chart . z = 1, for all Q (N - 1, N, N) in discs.

    Args:
        quadrics: the middles of the symmetric matrices.
        radii: (N - 1, N, N) of their entries; zero where they are exact as they stand.
        chart: (N,) real and exact, z in it.
    """
    N = z.shape[1]
    gamma = 8 * (2 * N + 4) * UNIT  # of a quadratic form in complex numbers, eight times over
    size, sizes = np.abs(z), np.abs(quadrics) * UP
    proved = np.zeros(len(z), dtype=bool)
    found = np.full(z.shape, np.inf)
    for k in range(len(z)):
        J = np.vstack([2 * quadrics @ z[k], chart])
        try:
            Y = np.linalg.inv(J)
        except np.linalg.LinAlgError:
            continue
        values = np.append(np.einsum("kij,i,j->k", quadrics, z[k], z[k]), z[k] @ chart - 1.0)
        terms = np.append(
            np.einsum("kij,i,j->k", gamma * sizes + radii, size[k], size[k]),
            gamma * (np.abs(chart) @ size[k] + 1.0),
        )
        off = UP * (np.abs(Y) @ (UP * (np.abs(values) + UP * terms)))
        slack = np.vstack([2 * UP * (gamma * sizes + radii) @ size[k], gamma * np.abs(chart)])
        rest = np.abs(np.eye(N) - Y @ J) + gamma * (np.abs(Y) @ np.abs(J) + np.eye(N)) + np.abs(Y) @ slack
        r = 2 * off + LEAST
        for _ in range(PASSES):
            spread = np.vstack([2 * UP * (sizes + radii) @ r, np.zeros(N)])
            needed = UP * (off + UP * ((UP * (rest + np.abs(Y) @ spread)) @ r))
            if np.all(needed < r):
                proved[k], found[k] = True, r
                break
            r = 1.5 * needed + LEAST
            if not r.max() < WIDEST:
                break
    return Enclosures(proved, found)


def chart_for(z: ComplexArray, seed: int = 0) -> Array:
    """A real chart (N,), of some at random, from whose plane at infinity all points z (S, N) are far."""
    charts = np.random.default_rng(seed).standard_normal((200, z.shape[1]))
    charts /= np.linalg.norm(charts, axis=1, keepdims=True)
    heights = np.abs(charts @ z.T) / np.linalg.norm(z, axis=1)
    return np.asarray(charts[np.argmax(heights.min(axis=1, initial=np.inf))])


def are_apart(z: ComplexArray, radii: Array) -> bool:
    """Whether polydiscs about z (S, N) have nothing in common with one another."""
    gap = np.abs(z[:, None] - z[None]) * (1 - 1e-10) - radii[:, None] - radii[None]
    disjoint = np.asarray((gap > 0).any(axis=2)) | np.eye(len(z), dtype=bool)
    return bool(disjoint.all())
