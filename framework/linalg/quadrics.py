"""All solutions of a system of quadrics from a linear family, by coefficient-parameter homotopy.

A system is K equations z' (sum_j c_ij G_j) z = 0 with coefficients c (K, M), and F fixed ones z' S z = 0, of
a point z of projective space P^(N-1), N = K + F + 1. For all coefficients but those of a set without volume
it has the same number of isolated solutions, and no system of the family has more (Morgan and Sommese 1989;
base points apart, where no equation of the family tells one member from another).

The solutions of one system with random complex coefficients are found by monodromy: the coefficients go round
a closed way, and from one solution all others are reached (Duff et al., IMA J. Numerical Analysis 39, 2019).
From it straight ways of coefficients, complex by random factors, lead to any other system; on them solutions
neither meet nor leave before the end, but with probability zero (`linalg.path_ends`). Paths are followed in
step, in stacks.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from framework.arrays import Array, BoolArray

ComplexArray = NDArray[np.complex128]

FIRST_STEP, SHORTEST_STEP = 0.05, 1e-9  # of the way
CORRECTOR = 3  # Newton steps
TRACKED = 1e-8  # last Newton step of a point on a path, z of size 1
GROW = 4  # steps that go well before the next is longer
ALIKE = 1e-6  # distance of two solutions that are one, z of size 1
ROUNDS = 60  # of monodromy, at most
LARGEST = 1e7  # z in its chart: beyond, a path has left for infinity
DEPENDENT = 1e-11  # singular value, over the largest: a hundred times the rounding of coefficients
SEED = 20


@dataclass(frozen=True, eq=False)
class QuadricFamily:
    """Systems of quadrics: M members of the family and F fixed equations, as symmetric matrices."""

    name: str
    members: Array  # (M, N, N)
    fixed: Array  # (F, N, N)
    bound: int  # of isolated solutions of any system

    @property
    def size(self) -> int:
        """N, the homogeneous coordinates of z."""
        return int(self.members.shape[1])

    @property
    def equations(self) -> int:
        """K, how many members of the family make a system."""
        return self.size - 1 - len(self.fixed)

    def quadrics(self, coefficients: ComplexArray | Array) -> ComplexArray:
        """The matrices (K + F, N, N) of a system with coefficients (K, M)."""
        own = np.tensordot(coefficients, self.members, axes=1)
        return np.concatenate([own, self.fixed]).astype(complex)

    def is_dependent(self, coefficients: Array) -> bool:
        """Whether the functions of (K, M) depend on one another everywhere, so that no solution is single.

        They are quotients by the first member: displacements are finite where that is not zero.
        """
        rng = np.random.default_rng(SEED + 2)
        for _ in range(2):  # random points: one would do, with probability one
            z = self.random_point(rng)
            quadrics, first = self.quadrics(coefficients), self.members[0]
            quadrics[: self.equations] -= (
                np.einsum("kij,i,j->k", quadrics[: self.equations], z, z) / (z @ first @ z)
            )[:, None, None] * first
            values = np.linalg.svd(quadrics @ z, compute_uv=False)
            if values[-1] > DEPENDENT * values[0]:
                return False
        return True

    @cached_property
    def start(self) -> tuple[ComplexArray, ComplexArray]:
        """Coefficients (K, M) of a random system and its solutions (bound, N), as many as monodromy found."""
        rng = np.random.default_rng(SEED)
        z = self.random_point(rng)
        values = np.einsum("mij,i,j->m", self.members, z, z)
        nodes = [self._through(rng, values), self._through(rng, None)]
        known = [z[None] / np.linalg.norm(z), np.zeros((0, self.size), dtype=complex)]
        for _ in range(ROUNDS):
            for here, there in ((0, 1), (1, 0)):
                turned = [np.exp(2j * np.pi * rng.random((self.equations, 1))) * node for node in nodes]
                arrived, good = self.track(turned[here], turned[there], known[here], rng)
                both = np.concatenate([known[there], arrived[good]])
                known[there] = both[is_first(both)]
            if len(known[0]) >= self.bound:
                break
        return nodes[0], known[0]

    def track(
        self, one: ComplexArray, two: ComplexArray, z: ComplexArray, rng: np.random.Generator
    ) -> tuple[ComplexArray, BoolArray]:
        """Solutions z (S, N) led from coefficients one to two (K, M); which of them arrived (S,)."""
        chart = rng.standard_normal(self.size) + 1j * rng.standard_normal(self.size)
        way = _Way(self.quadrics(one), self.quadrics(two) - self.quadrics(one), chart)
        z = z / (z @ chart)[:, None]
        at, step, well = np.zeros(len(z)), np.full(len(z), FIRST_STEP), np.zeros(len(z), dtype=int)
        live = np.ones(len(z), dtype=bool)
        while live.any():
            k = np.flatnonzero(live)
            t, h, here = at[k], np.minimum(step[k], 1.0 - at[k]), z[k]
            k1 = way.rate(here, t)
            k2 = way.rate(here + 0.5 * h[:, None] * k1, t + 0.5 * h)
            k3 = way.rate(here + 0.5 * h[:, None] * k2, t + 0.5 * h)
            k4 = way.rate(here + h[:, None] * k3, t + h)
            there = here + h[:, None] / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            size = np.full(len(k), np.inf)
            for _ in range(CORRECTOR):
                change = way.newton(there, t + h)
                there = there + change
                size = np.linalg.norm(change, axis=1) / np.linalg.norm(there, axis=1)
            good = size < TRACKED
            z[k[good]], at[k[good]] = there[good], t[good] + h[good]
            well[k] = np.where(good, well[k] + 1, 0)
            longer = well[k] >= GROW
            step[k] = np.where(good, np.where(longer, 2.0, 1.0), 0.5) * h
            well[k[longer]] = 0
            lost = (step[k] < SHORTEST_STEP) | ~(np.linalg.norm(z[k], axis=1) < LARGEST)
            live[k[lost | (at[k] >= 1.0)]] = False
        return z / np.linalg.norm(z, axis=1, keepdims=True), at >= 1.0

    def random_point(self, rng: np.random.Generator) -> ComplexArray:
        """A point on all fixed quadrics."""
        z = rng.standard_normal(self.size) + 1j * rng.standard_normal(self.size)
        for _ in range(50 if len(self.fixed) else 0):
            slopes = 2 * self.fixed @ z
            z = z - np.linalg.pinv(slopes) @ (slopes @ z / 2)
        return z / np.linalg.norm(z)

    def _through(self, rng: np.random.Generator, values: ComplexArray | None) -> ComplexArray:
        """Random coefficients (K, M), of a system solved where the members have `values` (M,)."""
        shape = (self.equations, len(self.members))
        found = rng.standard_normal(shape) + 1j * rng.standard_normal(shape)
        if values is not None:
            found -= np.outer(found @ values, values.conj()) / np.vdot(values, values)
        return found / np.linalg.norm(found, axis=1, keepdims=True)


def refined(quadrics: ComplexArray, z: ComplexArray, chart: ComplexArray) -> ComplexArray:
    """Solutions z (S, N) after Newton steps in the chart (N,) . z = 1."""
    z = z / (z @ chart)[:, None]
    here = _Way(quadrics, 0 * quadrics, chart)
    for _ in range(4):
        z = z + here.newton(z, np.zeros(len(z)))
    return z


class _Way(NamedTuple):
    """A straight way of systems, in a chart."""

    start: ComplexArray  # (N - 1, N, N) quadrics at t = 0
    change: ComplexArray  # (N - 1, N, N) from there to t = 1
    chart: ComplexArray  # (N,) chart . z = 1

    def slopes(self, z: ComplexArray, t: Array) -> ComplexArray:
        """Half the Jacobian (S, N, N), the chart last, at z (S, N) and t (S,)."""
        S, N = z.shape
        own = self.start.reshape(-1, N) @ z.T + (self.change.reshape(-1, N) @ z.T) * t
        rows = own.T.reshape(S, N - 1, N)
        return np.concatenate([rows, np.broadcast_to(0.5 * self.chart, (S, 1, N))], axis=1)

    def rate(self, z: ComplexArray, t: Array) -> ComplexArray:
        """dz/dt (S, N) along the way."""
        S, N = z.shape
        moved = np.einsum("ski,si->sk", (self.change.reshape(-1, N) @ z.T).T.reshape(S, N - 1, N), z)
        return _solved(self.slopes(z, t), np.concatenate([-0.5 * moved, np.zeros((S, 1))], axis=1))

    def newton(self, z: ComplexArray, t: Array) -> ComplexArray:
        """The Newton step (S, N)."""
        slopes = self.slopes(z, t)
        values = 0.5 * np.einsum("ski,si->sk", slopes, z)
        values[:, -1] = 0.5 * (z @ self.chart - 1.0)
        return _solved(slopes, -values)


def _solved(matrices: ComplexArray, right: ComplexArray) -> ComplexArray:
    try:
        return np.asarray(np.linalg.solve(matrices, right[:, :, None])[:, :, 0])
    except np.linalg.LinAlgError:  # one of them singular to the last bit: its path is shortened
        return np.array([np.linalg.lstsq(m, r, rcond=None)[0] for m, r in zip(matrices, right, strict=True)])


def is_first(z: ComplexArray) -> BoolArray:
    """Which points (S,) of projective space among z (S, N), of size 1, are not there before."""
    cosine = np.abs(z.conj() @ z.T)
    same = np.tril(np.sqrt(np.maximum(1 - np.minimum(cosine, 1) ** 2, 0)) < ALIKE, -1)
    return np.asarray(~same.any(axis=1))
