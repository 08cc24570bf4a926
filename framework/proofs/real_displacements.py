"""All real displacements that meet a system of leg conditions, proved, and in which sense they are all.

The ends of all paths (`homotopy`) are enclosed by the test of Krawczyk: one solution there and no
other, for all coefficients within their rounding. A real solution has a disc about a real point, all others
one away from it. Where paths are lost, others are tried.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from framework.numerics.arrays import Array, BoolArray, ReadOnlyArrays
from framework.proofs.homotopy import PathEnds, find_path_ends, refine_solutions
from framework.proofs.krawczyk import Enclosures, are_apart, choose_chart, enclose_solutions
from framework.proofs.rounding import ROUND_UP, gamma
from framework.proofs.study_quadric import ComplexArray, Displacements, QuadricFamily, first_occurrences
from framework.tolerances import DISTINCT_SOLUTIONS, LEG_COEFFICIENT_ROUNDING

MAX_ATTEMPTS = 4  # on other ways, while paths are lost

Status = Literal["proved", "numerically complete", "at least", "architecturally singular"]


@dataclass(frozen=True)
class PathCount:
    """The number of paths of a homotopy, by kinds of ends."""

    paths: int
    finite: int  # at single solutions that are apart
    infinite: int
    multiple: int  # at finite solutions that are not single

    @property
    def lost(self) -> int:
        """Number of paths whose ends are not known."""
        return self.paths - self.finite - self.infinite - self.multiple

    @property
    def sentence(self) -> str:
        """The numbers of paths, in words."""
        ends = {
            "end at single solutions": self.finite,
            "end at infinity": self.infinite,
            "end at multiple ones": self.multiple,
            "are lost": self.lost,
        }
        return f"of {self.paths} paths " + ", ".join(f"{count} {end}" for end, count in ends.items() if count)


@dataclass(frozen=True, eq=False)
class RealSolutions(ReadOnlyArrays):
    """The k real solutions of a system of leg conditions."""

    R: Array  # (k, 3, 3) rotations of the displacements
    p: Array  # (k, 3) translations, in the unit of the conditions
    proved: BoolArray  # (k,) to exist, to be real and to be single
    count: PathCount
    status: Status  # in which sense they are all


def find_real_solutions(
    group: Displacements,
    coefficients: Array,
    rounding: float = LEG_COEFFICIENT_ROUNDING,
) -> RealSolutions:
    """Find all real displacements that meet conditions (K, M).

    Coefficients are known up to `rounding`, relative to the largest of their condition.
    """
    family = group.family
    coefficients = coefficients / np.linalg.norm(coefficients, axis=1, keepdims=True)
    if family.is_dependent(coefficients):
        R, p = group.to_displacements(np.zeros((0, family.size)))
        return RealSolutions(R, p, np.zeros(0, dtype=bool), PathCount(0, 0, 0, 0), "architecturally singular")
    rows, sizes = group.eliminate_square(coefficients)
    slack = rounding * sizes
    attempts = list[RealSolutions]()
    for seed in range(MAX_ATTEMPTS):
        attempts.append(_prove_path_ends(group, rows, slack, seed))
        if attempts[-1].status != "at least":
            break
    return min(reversed(attempts), key=_count_doubts)  # of equal ones the last


def _count_doubts(attempt: RealSolutions) -> tuple[bool, int, int]:
    """Return the sort key of an attempt: unproved status, lost paths, multiple solutions."""
    return attempt.status == "at least", attempt.count.lost, attempt.count.multiple


def _prove_path_ends(group: Displacements, coefficients: Array, slack: Array, seed: int) -> RealSolutions:
    """Follow all paths once, and prove the solutions at their ends.

    A solution is decided if the disc about it is proved to hold one, and it is real or its disc holds no real
    number.

    Args:
        coefficients: (K, M), known up to `slack` (K, M).
        seed: of the ways that paths take.
    """
    family = group.family
    quadrics = family.quadrics(coefficients)
    ends = find_path_ends(family, coefficients, seed)
    chart = choose_chart(ends.z[ends.arrived])
    z = refine_solutions(quadrics, ends.z[ends.arrived], chart.astype(complex))  # (S, N)
    norms = np.linalg.norm(z, axis=1, keepdims=True)
    is_real = np.abs(z.imag).max(axis=1) < DISTINCT_SOLUTIONS * norms[:, 0]
    z[is_real] = z[is_real].real
    is_new = first_occurrences(z / norms)
    proof = enclose_solutions(quadrics, family.quadrics_slack(slack), chart, z)
    count = _count_paths(family, ends, z, is_real, is_new, proof)

    is_not_real = (np.abs(z.imag) > proof.radii).any(axis=1)
    decided = np.count_nonzero(proof.proved & (is_real | is_not_real))
    status: Status = "at least"
    if decided == family.bound and are_apart(z, proof.radii):
        status = "proved"
    elif count.finite + count.infinite == count.paths == family.bound:
        status = "numerically complete"
    is_kept = is_real & is_new
    return RealSolutions(*group.to_displacements(z[is_kept].real), proof.proved[is_kept], count, status)


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
        z: (S, N) the ends of the paths that arrived.
        real, first: masks (S,) of real ends, and of ends that repeat no earlier one.
    """
    proved = proof.proved
    at_infinity = ends.infinite[ends.arrived] & ~proved
    at_infinity[proved] = ~_have_no_infinite_point(family.members[0], z[proved], proof.radii[proved])
    vague = real & ~proved & ~at_infinity  # a real solution beside another one
    never_arrived = ends.last[ends.infinite & ~ends.arrived]
    return PathCount(
        len(ends.z),
        finite=int(np.sum(first & ~at_infinity & ~vague)),
        infinite=int(np.sum(first & at_infinity) + np.sum(first_occurrences(never_arrived))),
        multiple=int(np.sum(ends.multiple) + np.sum(first & vague)),
    )


def _have_no_infinite_point(quadric: Array, z: ComplexArray, radii: Array) -> BoolArray:
    """Return whether polydiscs about z (S, N) provably hold no point at infinity.

    At infinity z^T A z = 0, with the `quadric` A (N, N). A polydisc holds no zero if |z^T A z| at the middle
    is greater than the bound 2 |A z| . r + r^T |A| r of its change, and than rounding.
    """
    slopes = z @ quadric
    value = np.abs(np.sum(slopes * z, axis=1))
    magnitude = np.abs(z)
    max_change = np.sum((2 * np.abs(slopes) + radii @ np.abs(quadric)) * radii, axis=1)
    rounding = gamma(2 * z.shape[1]) * np.einsum("si,ij,sj->s", magnitude, np.abs(quadric), magnitude)
    return value > ROUND_UP**2 * (max_change + 2 * rounding)
