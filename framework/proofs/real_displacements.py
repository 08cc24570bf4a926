"""All real displacements that solve a system of leg conditions, each proved, and how many there are.

Krawczyk's test encloses the ends of all paths of `homotopy`: each enclosure holds exactly one solution, for
all coefficients within their rounding. The solution is real if the middle of the enclosure is real, and not
real if the enclosure contains no real point. While paths are lost, the system is solved again along other
paths.
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

MAX_ATTEMPTS = 4  # each along other paths, while some are lost

Status = Literal["proved", "numerically complete", "at least", "architecturally singular"]


@dataclass(frozen=True)
class PathCount:
    """The number of paths of a homotopy by their kinds of ends."""

    paths: int
    finite: int  # at single solutions that are apart
    infinite: int
    multiple: int  # at finite multiple solutions

    @property
    def lost(self) -> int:
        """Number of paths with unknown ends."""
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
    status: Status  # in which sense these are all real solutions


def find_real_solutions(
    group: Displacements,
    coefficients: Array,
    rounding: float = LEG_COEFFICIENT_ROUNDING,
) -> RealSolutions:
    """Find all real displacements that solve conditions with coefficients (K, M).

    Args:
        group: the displacements among which the solutions are, with M functions.
        rounding: error of the coefficients, relative to the largest coefficient of each condition.
    """
    family = group.family
    coefficients = coefficients / np.linalg.norm(coefficients, axis=1, keepdims=True)
    if family.is_dependent(coefficients):
        R, p = group.to_displacements(np.zeros((0, family.size)))
        count = PathCount(paths=0, finite=0, infinite=0, multiple=0)
        return RealSolutions(R, p, np.zeros(0, dtype=bool), count, "architecturally singular")
    rows, sizes = group.eliminate_square(coefficients)
    slack = rounding * sizes
    attempts = list[RealSolutions]()
    for seed in range(MAX_ATTEMPTS):
        attempts.append(_prove_path_ends(group, rows, slack, seed))
        if attempts[-1].status != "at least":
            break
    return min(reversed(attempts), key=_count_doubts)  # the last of equal attempts


def _count_doubts(attempt: RealSolutions) -> tuple[bool, int, int]:
    """Return a sort key: whether the status is unproved, lost paths, multiple solutions."""
    return attempt.status == "at least", attempt.count.lost, attempt.count.multiple


def _prove_path_ends(group: Displacements, coefficients: Array, slack: Array, seed: int) -> RealSolutions:
    """Track all paths once, and prove the solutions at their ends.

    A solution is decided if its enclosure is proved to hold exactly one solution, and either the solution is
    real or the enclosure contains no real point.

    Args:
        coefficients: (K, M).
        slack: (K, M) bounds on the errors of the coefficients.
        seed: chooses the paths.
    """
    family = group.family
    quadrics = family.quadrics(coefficients)
    ends = find_path_ends(family, coefficients, seed)
    chart = choose_chart(ends.z[ends.arrived])
    z = refine_solutions(quadrics, ends.z[ends.arrived], chart.astype(complex))  # (S, N)
    norms = np.linalg.norm(z, axis=1)
    is_real = np.abs(z.imag).max(axis=1) < DISTINCT_SOLUTIONS * norms
    z[is_real] = z[is_real].real
    is_new = first_occurrences(z / norms[:, None])
    proof = enclose_solutions(quadrics, family.quadrics_slack(slack), chart, z)
    count = _count_paths(family, ends, z, is_real, is_new, proof)

    is_not_real = (np.abs(z.imag) > proof.radii).any(axis=1)
    decided = np.count_nonzero(proof.proved & (is_real | is_not_real))
    status: Status = "at least"
    if decided == family.bound and are_apart(z, proof.radii):
        status = "proved"
    elif count.finite + count.infinite == count.paths == family.bound:
        status = "numerically complete"
    chosen = is_real & is_new
    return RealSolutions(*group.to_displacements(z[chosen].real), proof.proved[chosen], count, status)


def _count_paths(
    family: QuadricFamily,
    ends: PathEnds,
    z: ComplexArray,
    is_real: BoolArray,
    is_new: BoolArray,
    proof: Enclosures,
) -> PathCount:
    """Count the paths by their ends; paths with the same end count once.

    A proved end is at infinity unless its enclosure provably holds no point at infinity.

    Args:
        z: (S, N) the ends of the paths that arrived.
        is_real: (S,) whether an end is real.
        is_new: (S,) whether an end differs from all earlier ones.
        proof: the enclosures of the ends z.
    """
    proved = proof.proved
    is_infinite = ends.infinite[ends.arrived] & ~proved
    is_infinite[proved] = ~_have_no_infinite_point(family.members[0], z[proved], proof.radii[proved])
    is_multiple = is_real & ~proved & ~is_infinite  # without proof another solution may be close
    never_arrived = ends.last[ends.infinite & ~ends.arrived]
    return PathCount(
        paths=len(ends.z),
        finite=int(np.sum(is_new & ~is_infinite & ~is_multiple)),
        infinite=int(np.sum(is_new & is_infinite) + np.sum(first_occurrences(never_arrived))),
        multiple=int(np.sum(ends.multiple) + np.sum(is_new & is_multiple)),
    )


def _have_no_infinite_point(quadric: Array, z: ComplexArray, radii: Array) -> BoolArray:
    """Return whether polydiscs about z (S, N) provably hold no point at infinity, (S,).

    At infinity z' A z = 0, with the `quadric` A (N, N). Within radii r (S, N) the value z' A z changes by at
    most 2 |A z| . r + r' |A| r. If its modulus at the middle is greater than this change and the rounding,
    the polydisc holds no point at infinity.
    """
    slopes = z @ quadric
    value = np.abs(np.sum(slopes * z, axis=1))
    A_size = np.abs(quadric)
    z_size = np.abs(z)
    max_change = np.sum((2 * np.abs(slopes) + radii @ A_size) * radii, axis=1)
    rounding = gamma(2 * z.shape[1]) * np.einsum("si,ij,sj->s", z_size, A_size, z_size)
    return value > ROUND_UP**2 * (max_change + 2 * rounding)
