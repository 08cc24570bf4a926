"""All real displacements that meet a system of leg conditions, proved, and in which sense they are all.

The ends of all paths (`homotopy`) are enclosed by the test of Krawczyk: one solution there and no
other, for all coefficients within their rounding. A real solution has a disc about a real point, all others
one away from it. Where paths are lost, others are tried.

That conditions in space have no other real solutions is proved by paving all dual quaternions z = (x, y)
(`completeness`): one of x is 1 and the others lie in [-1, 1], which are all turns in four charts. The
condition with |p|^2 bounds p, and |y| = |p| |x| / 2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from framework.numerics.arrays import Array, BoolArray, ReadOnlyArrays
from framework.proofs.branch_and_bound import Boxes
from framework.proofs.completeness import KnownSolutions, has_no_others
from framework.proofs.homotopy import PathEnds, find_path_ends, refine_solutions
from framework.proofs.interval_newton import LinearEnclosure
from framework.proofs.krawczyk import Enclosures, are_apart, choose_chart, enclose_solutions
from framework.proofs.rounding import REACH_MARGIN, ROUND_UP, gamma
from framework.proofs.study_quadric import ComplexArray, Displacements, QuadricFamily, first_occurrences
from framework.tolerances import DISTINCT_SOLUTIONS, LEG_COEFFICIENT_ROUNDING

MAX_ATTEMPTS = 4  # on other ways, while paths are lost
MAX_BOXES = 3_000_000  # in each chart, some 40 s
CHART_OVERLAP = 1.3  # |x| of known solutions that are looked at in a chart, 1 being its edge

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

    z: Array  # (k, N) in the coordinates of the family
    R: Array  # (k, 3, 3) rotations of the displacements
    p: Array  # (k, 3) translations, in the unit of the conditions
    proved: Array  # (k,) 1 where the solution is proved to exist, to be real and to be single
    count: PathCount
    bound: int  # on the number of isolated complex solutions
    status: Status  # in which sense they are all


def find_real_solutions(
    group: Displacements,
    coefficients: Array,
    rounding: float = LEG_COEFFICIENT_ROUNDING,
    *,
    pave: bool = False,
) -> RealSolutions:
    """Find all real displacements that meet conditions (K, M).

    Coefficients are known up to `rounding`, relative to the largest of their condition.

    Args:
        pave: where fewer than the bound are found, pave all displacements in space, which may take a minute.
    """
    family = group.family
    coefficients = coefficients / np.linalg.norm(coefficients, axis=1, keepdims=True)
    if family.is_dependent(coefficients):
        nothing = np.zeros((0, family.size))
        R, p = group.to_displacements(nothing)
        no_paths = PathCount(0, 0, 0, 0)
        return RealSolutions(nothing, R, p, nothing[:, 0], no_paths, family.bound, "architecturally singular")
    rows, sizes = group.eliminate_square(coefficients)
    slack = rounding * sizes
    attempts = list[RealSolutions]()
    for seed in range(MAX_ATTEMPTS):
        attempts.append(_prove_path_ends(group, rows, slack, seed))
        if attempts[-1].status != "at least":
            break
    best = min(reversed(attempts), key=_count_doubts)  # of equal ones the last
    if (
        pave
        and best.status != "proved"
        and best.proved.all()
        and has_no_other_real_solutions(group, rows, slack, best.z)
    ):
        return replace(best, status="proved")
    return best


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
    quadrics = group.family.quadrics(coefficients)
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
    real_z = z[is_real & is_new].real
    proved = proof.proved[is_real & is_new].astype(float)
    return RealSolutions(real_z, *group.to_displacements(real_z), proved, count, family.bound, status)


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


# ------------------------------------------------------------------ no others


def has_no_other_real_solutions(group: Displacements, coefficients: Array, slack: Array, z: Array) -> bool:
    """Return whether conditions (K, M) provably have no real solutions but z (k, 8).

    The first condition has |p|^2 once and the others have none (`Displacements.eliminate_square`).
    """
    reach = bound_translation(group, coefficients, slack)
    if group.family.size != 8 or reach is None:
        return False
    return all(DualQuaternionChart(group, coefficients, slack, k).has_no_others(z, reach) for k in range(4))


def bound_translation(group: Displacements, coefficients: Array, slack: Array) -> float | None:
    """Bound |p| over all solutions by the first condition; None without |p|^2.

    |p|^2 <= b |p| + c with the coefficients b of p and R'p, and c of 1 and R, whose entries are at most 1: so
    |p| <= b / 2 + (b^2 / 4 + c)^(1/2).
    """
    first, size = np.zeros((2, 17))  # of 1, |p|^2, p, R'p, R
    first[group.chosen] = coefficients[0]
    size[group.chosen] = np.abs(coefficients[0]) + slack[0]
    if first[1] != 1.0:
        return None
    b = float(np.linalg.norm(size[2:5]) + np.linalg.norm(size[5:8]))
    c = float(size[0] + size[8:].sum())
    return REACH_MARGIN * (b / 2 + float(np.sqrt(b * b / 4 + c)))


class DualQuaternionChart:
    """The conditions where one coordinate of z is 1, in the other seven."""

    def __init__(self, group: Displacements, coefficients: Array, slack: Array, unit_coordinate: int) -> None:
        """Build the quadrics Q (E, 8, 8), and bounds on their errors.

        `curvature` (E, 49) is |Q| of the free coordinates and `uncertainty` (E, 64) bounds errors of Q, as
        rows.
        """
        self.unit_coordinate = unit_coordinate
        self.free = np.delete(np.arange(8), unit_coordinate)
        self.Q = group.family.quadrics(coefficients).real
        size = np.abs(self.Q)
        errors = group.family.quadrics_slack(slack) + gamma(16) * size
        self.curvature = size[:, self.free][:, :, self.free].reshape(len(size), -1)
        self.uncertainty = errors.reshape(len(size), -1)

    def __call__(self, middle: Array, radii: Array) -> LinearEnclosure:
        """Enclose the conditions z' Q z = 0 in boxes (B, 7) of the free coordinates.

        About the middle z_m they are z_m' Q z_m + 2 z_m' Q d within |d|' |Q| |d|, and the errors of Q make at
        most |z|' errors |z| of them.
        """
        z, largest = np.ones((2, len(middle), 8))
        z[:, self.free] = middle
        largest[:, self.free] = np.abs(middle) + radii
        gradients = (self.Q.reshape(-1, 8) @ z.T).T.reshape(len(middle), -1, 8)  # (B, E, 8) Q z
        second_order = _pair_products(radii) @ self.curvature.T  # (B, E)
        errors = second_order + _pair_products(largest) @ self.uncertainty.T
        return LinearEnclosure(np.matvec(gradients, z), 2 * gradients[:, :, self.free], errors)

    def has_no_others(self, z: Array, reach: float) -> bool:
        """Return whether the chart provably holds no solutions but z (k, 8).

        Solutions with |p| <= reach. The region is |x_i| <= 1 for the three other coordinates of x, and |y_i|
        <= reach: |y| = |p| |x| / 2 with |x| <= 2.
        """
        unit = z[:, [self.unit_coordinate]]  # (k, 1)
        is_near = np.abs(z[:, :4]).max(axis=1) <= CHART_OVERLAP * np.abs(unit[:, 0])
        points = (z[is_near] / unit[is_near])[:, self.free]  # (near, 7)
        solutions = KnownSolutions.of(self, points, np.full(7, np.inf))
        region = Boxes(np.zeros((1, 7)), np.where(self.free < 4, 1.0, reach)[None])
        return has_no_others(self, region, solutions, MAX_BOXES)


def _pair_products(vectors: Array) -> Array:
    """Compute products of all pairs of entries of vectors (B, k), as rows (B, k^2)."""
    return (vectors[:, :, None] * vectors[:, None]).reshape(len(vectors), -1)
