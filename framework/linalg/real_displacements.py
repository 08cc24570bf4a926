"""All real displacements that meet a system of leg conditions, proved, and in which sense they are all.

The ends of all paths (`linalg.path_ends`) are enclosed by the test of Krawczyk: one solution there and no
other, for all coefficients within their rounding. A real solution has a disc about a real point, all others
one away from it. Where paths are lost, others are tried.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from framework.arrays import Array, BoolArray, ReadOnlyArrays
from framework.linalg.displacements import Displacements
from framework.linalg.krawczyk import are_apart, chart_for, enclosures
from framework.linalg.path_ends import path_ends
from framework.linalg.quadrics import ComplexArray, is_first, refined
from framework.linalg.real_paving import are_all_real

ROUNDING = 1e-14  # of coefficients, relative to the largest of their condition
REAL = 1e-6  # imaginary part of a solution that may be real, its size 1: proved or not afterwards
ATTEMPTS = 4  # on other ways, while paths are lost

Status = Literal["proved", "numerically complete", "at least", "architecturally singular"]


@dataclass(frozen=True)
class PathCount:
    """How the paths of a homotopy to one system end."""

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
        said = [f"{count} end {where}" for where, count in ends.items() if count]
        return f"of {self.paths} paths " + ", ".join(said + ([f"{self.lost} are lost"] if self.lost else []))


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
    group: Displacements, coefficients: Array, rounding: float = ROUNDING, *, pave: bool = False
) -> RealSolutions:
    """All real displacements that meet conditions (K, M), known up to rounding.

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
    rows, slack = group.eliminated(coefficients)
    slack = rounding * slack
    found = [_of_paths(group, rows, slack, 0)]
    while found[-1].status == "at least" and len(found) < ATTEMPTS:
        found.append(_of_paths(group, rows, slack, len(found)))
    best = min(
        reversed(found), key=lambda one: (one.status == "at least", one.count.lost, one.count.multiple)
    )
    if pave and best.status != "proved" and best.proved.all() and are_all_real(group, rows, slack, best.z):
        return replace(best, status="proved")
    return best


def _of_paths(group: Displacements, coefficients: Array, slack: Array, attempt: int) -> RealSolutions:
    """What the ends of all paths on the ways of one attempt prove; coefficients (K, M) are off by slack."""
    family, quadrics = group.family, group.family.quadrics(coefficients)
    ends = path_ends(family, coefficients, seed=attempt)
    z = ends.z[ends.arrived]
    chart = chart_for(z)
    z = refined(quadrics, z, chart.astype(complex))
    real = np.abs(z.imag).max(axis=1) < REAL * np.linalg.norm(z, axis=1)
    z[real] = z[real].real
    radii = np.tensordot(slack, np.abs(family.members), axes=1)
    radii = np.concatenate([radii, np.zeros_like(family.fixed)])
    proof = enclosures(quadrics, radii, chart, z)
    first = is_first(z / np.linalg.norm(z, axis=1, keepdims=True))
    far = ends.infinite[ends.arrived] & ~proof.proved
    far[proof.proved] = ~_is_finite(family.members[0], z[proof.proved], proof.radii[proof.proved])
    vague = real & ~proof.proved & ~far  # a real solution beside another one
    left = ends.left[ends.infinite & ~ends.arrived]
    count = PathCount(
        len(ends.z),
        finite=int(np.sum(first & ~far & ~vague)),
        infinite=int(np.sum(first & far) + np.sum(is_first(left))),
        multiple=int(np.sum(ends.multiple) + np.sum(first & vague)),
    )
    decided = proof.proved & (real | (np.abs(z.imag) > proof.radii).any(axis=1))
    status: Status = "at least"
    if np.sum(decided) == family.bound and are_apart(z, proof.radii):
        status = "proved"
    elif count.finite + count.infinite == count.paths == family.bound:
        status = "numerically complete"
    chosen = real & first
    R, p = group.in_space(z[chosen].real)
    return RealSolutions(
        z[chosen].real, R, p, proof.proved[chosen].astype(float), count, family.bound, status
    )


def _is_finite(first: Array, z: ComplexArray, radii: Array) -> BoolArray:
    """Whether the quadric that vanishes at infinity (N, N) does so nowhere in polydiscs about z (S, N)."""
    slopes = z @ first
    value, spread = np.abs(np.sum(slopes * z, axis=1)), 2 * np.abs(slopes) + radii @ np.abs(first)
    return np.asarray(
        value * (1 - 1e-10) > 1.01 * np.sum(spread * radii, axis=1) + 1e-14 * np.sum(np.abs(z) ** 2, axis=1)
    )
