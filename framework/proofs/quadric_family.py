"""Linear families of systems of quadrics in projective space.

A system is K equations z' (sum_j c_ij G_j) z = 0 with coefficients c (K, M), and F fixed ones z' S z = 0, of
a point z of projective space P^(N-1), N = K + F + 1. For all coefficients but those of a set without volume
it has the same number of isolated solutions, and no system of the family has more (Morgan and Sommese 1989;
base points apart, where no equation of the family tells one member from another). `homotopy` finds them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from framework.arrays import Array, BoolArray
from framework.linalg.ordered_sums import singular_values
from framework.tolerances import DISTINCT_SOLUTIONS, RANK_ROUNDING

ComplexArray = NDArray[np.complex128]

RANDOM_SEED = 22
NEWTON_STEPS = 50  # from a random point onto the fixed quadrics


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
        """Return the matrices (K + F, N, N) of a system with coefficients (K, M)."""
        matrices = np.tensordot(coefficients, self.members, axes=1)
        return np.concatenate([matrices, self.fixed]).astype(complex)

    def quadrics_slack(self, slack: Array) -> Array:
        """Bound the change (K + F, N, N) of `quadrics` for coefficients known up to slack (K, M)."""
        uncertain = np.tensordot(slack, np.abs(self.members), axes=1)
        return np.concatenate([uncertain, np.zeros_like(self.fixed)])

    def values(self, z: ComplexArray) -> ComplexArray:
        """Evaluate the members at points z (S, N), (S, M)."""
        return np.einsum("mij,ti,tj->tm", self.members, z, z)

    def random_point(self, rng: np.random.Generator) -> ComplexArray:
        """Return a point (N,) on all fixed quadrics."""
        z = rng.standard_normal(self.size) + 1j * rng.standard_normal(self.size)
        for _ in range(NEWTON_STEPS if len(self.fixed) else 0):
            slopes = 2 * self.fixed @ z
            z = z - np.linalg.pinv(slopes) @ (slopes @ z / 2)
        return z / np.linalg.norm(z)

    def random_coefficients(self, rng: np.random.Generator) -> ComplexArray:
        """Return random complex coefficients (K, M), each row of unit size."""
        shape = (self.equations, len(self.members))
        c = rng.standard_normal(shape) + 1j * rng.standard_normal(shape)
        return c / np.linalg.norm(c, axis=1, keepdims=True)

    def is_dependent(self, coefficients: Array) -> bool:
        """Whether the functions of (K, M) depend on one another everywhere, so that no solution is single.

        They are quotients by the first member: displacements are finite where that is not zero.
        """
        rng, first, K = np.random.default_rng(RANDOM_SEED), self.members[0], self.equations
        for _ in range(2):  # random points: one would do, with probability one
            z = self.random_point(rng)
            quadrics = self.quadrics(coefficients)
            quotients = np.einsum("kij,i,j->k", quadrics[:K], z, z) / (z @ first @ z)
            quadrics[:K] -= quotients[:, None, None] * first
            values = singular_values(quadrics @ z)
            if values[-1] > RANK_ROUNDING * values[0]:
                return False
        return True


def is_first(z: ComplexArray) -> BoolArray:
    """Whether each unit point z (S, N) of projective space differs from all earlier ones, (S,)."""
    cosine = np.minimum(np.abs(z.conj() @ z.T), 1.0)
    coincide = np.sqrt(1.0 - cosine**2) < DISTINCT_SOLUTIONS
    return np.asarray(~np.tril(coincide, -1).any(axis=1))
