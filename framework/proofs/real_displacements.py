"""All real displacements that meet a system of leg conditions, proved, and in which sense they are all.

The ends of all paths (`homotopy`) are enclosed by the test of Krawczyk: one solution there and no
other, for all coefficients within their rounding. A real solution has a disc about a real point, all others
one away from it. Where paths are lost, others are tried.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from framework.arrays import Array, BoolArray, ReadOnlyArrays
from framework.proofs.homotopy import PathEnds, path_ends, refine
from framework.proofs.krawczyk import Enclosures, are_apart, chart_for, enclosures
from framework.proofs.quadric_family import ComplexArray, QuadricFamily, is_first
from framework.proofs.rounding import ROUND_UP, gamma
from framework.proofs.study_paving import are_all_real
from framework.proofs.study_quadric import Displacements
from framework.tolerances import DISTINCT_SOLUTIONS, LEG_COEFFICIENT_ROUNDING

MAX_ATTEMPTS = 4  # on other ways, while paths are lost

Status = Literal["proved", "numerically complete", "at least", "architecturally singular"]


@dataclass(frozen=True)
class PathCount:
    """The number of paths of a homotopy to one system, by kinds of ends."""

    paths: int
    finite: int  # at single solutions that are apart
    infinite: int
    multiple: int  # at finite solutions that are not single

    @property
    def lost(self) -> int:
        """Paths whose ends are not known."""
        return self.paths - self.finite - self.infinite - self.multiple

    @property
    def sentence(self) -> str:
        """The count in words."""
        ends = {
            "at single solutions": self.finite,
            "at infinity": self.infinite,
            "at multiple ones": self.multiple,
        }
        counts = [f"{count} end {where}" for where, count in ends.items() if count]
        return f"of {self.paths} paths " + ", ".join(
            counts + ([f"{self.lost} are lost"] if self.lost else [])
        )


@dataclass(frozen=True, eq=False)
class RealSolutions(ReadOnlyArrays):
    """The real solutions of a system of leg conditions."""

    z: Array  # (k, N) in the coordinates of the family
    R: Array  # (k, 3, 3) rotations of the displacements
    p: Array  # (k, 3) translations, in the unit of the conditions
    proved: Array  # (k,) 1 where the solution is proved to exist, to be real and to be single
    count: PathCount
    bound: int  # on the number of isolated complex solutions
    status: Status  # in which sense they are all


def real_solutions(
    group: Displacements,
    coefficients: Array,
    rounding: float = LEG_COEFFICIENT_ROUNDING,
    *,
    pave: bool = False,
) -> RealSolutions:
    """Find all real displacements that meet conditions (K, M), known up to rounding.

    Args:
        pave: where fewer than the bound are found, pave all displacements in space, which may take a minute.
    """
    family = group.family
    coefficients = coefficients / np.linalg.norm(coefficients, axis=1, keepdims=True)
    if family.is_dependent(coefficients):
        nowhere, nothing = PathCount(0, 0, 0, 0), np.zeros(0)
        R, p = np.zeros((0, 3, 3)), np.zeros((0, 3))
        return RealSolutions(
            np.zeros((0, family.size)), R, p, nothing, nowhere, family.bound, "architecturally singular"
        )
    rows, slack = group.eliminate_square(coefficients)
    slack = rounding * slack
    attempts = [_prove_path_ends(group, rows, slack, 0)]
    while attempts[-1].status == "at least" and len(attempts) < MAX_ATTEMPTS:
        attempts.append(_prove_path_ends(group, rows, slack, len(attempts)))
    attempts.reverse()  # of equal ones the last
    best = min(
        attempts,
        key=lambda attempt: (attempt.status == "at least", attempt.count.lost, attempt.count.multiple),
    )
    if pave and best.status != "proved" and best.proved.all() and are_all_real(group, rows, slack, best.z):
        return replace(best, status="proved")
    return best


def _prove_path_ends(group: Displacements, coefficients: Array, slack: Array, attempt: int) -> RealSolutions:
    """Find and prove the solutions by one attempt of paths; coefficients (K, M) are known up to slack."""
    family, quadrics = group.family, group.family.quadrics(coefficients)
    ends = path_ends(family, coefficients, seed=attempt)
    z = ends.z[ends.arrived]
    chart = chart_for(z)
    z = refine(quadrics, z, chart.astype(complex))
    real = np.abs(z.imag).max(axis=1) < DISTINCT_SOLUTIONS * np.linalg.norm(z, axis=1)
    z[real] = z[real].real
    radii = np.tensordot(slack, np.abs(family.members), axes=1)
    radii = np.concatenate([radii, np.zeros_like(family.fixed)])
    proof = enclosures(quadrics, radii, chart, z)
    first = is_first(z / np.linalg.norm(z, axis=1, keepdims=True))
    count = _count_paths(family, ends, z, real, first, proof)
    decided = proof.proved & (real | (np.abs(z.imag) > proof.radii).any(axis=1))
    status: Status = "at least"
    if np.sum(decided) == family.bound and are_apart(z, proof.radii):
        status = "proved"
    elif count.finite + count.infinite == count.paths == family.bound:
        status = "numerically complete"
    z, proved = z[real & first], proof.proved[real & first].astype(float)
    return RealSolutions(z.real, *group.embed(z.real), proved, count, family.bound, status)


def _count_paths(
    family: QuadricFamily,
    ends: PathEnds,
    z: ComplexArray,
    real: BoolArray,
    first: BoolArray,
    proof: Enclosures,
) -> PathCount:
    """Count the paths by their ends.

    Args:
        z: (S, N) the ends of the paths that arrived; of these `real` and `first`, which repeats no other.
    """
    proved = proof.proved
    at_infinity = ends.infinite[ends.arrived] & ~proved
    at_infinity[proved] = ~_is_finite(family.members[0], z[proved], proof.radii[proved])
    vague = real & ~proved & ~at_infinity  # a real solution beside another one
    never_arrived = ends.last[ends.infinite & ~ends.arrived]
    return PathCount(
        len(ends.z),
        finite=int(np.sum(first & ~at_infinity & ~vague)),
        infinite=int(np.sum(first & at_infinity) + np.sum(is_first(never_arrived))),
        multiple=int(np.sum(ends.multiple) + np.sum(first & vague)),
    )


def _is_finite(first: Array, z: ComplexArray, radii: Array) -> BoolArray:
    """Whether the quadric that vanishes at infinity (N, N) does so nowhere in polydiscs about z (S, N)."""
    slopes = z @ first
    value = np.abs(np.sum(slopes * z, axis=1))
    size = np.abs(z)
    change = np.sum((2 * np.abs(slopes) + radii @ np.abs(first)) * radii, axis=1)
    rounding = gamma(2 * z.shape[1]) * np.einsum("si,ij,sj->s", size, np.abs(first), size)
    return np.asarray(value > ROUND_UP**2 * (change + 2 * rounding))
