"""Where the paths of a homotopy end: at single solutions, at multiple ones, or at infinity.

As many paths as the bound lead to all isolated solutions of a system (`linalg.quadrics`), with probability
one. A path that does not arrive is followed again on a way that shrinks by the same factor a segment, s ->
`RATIO` s. Its size |(functions)| / |first function|, that of a displacement R, p, behaves as s^-w with a
rational w (Puiseux; Morgan, Sommese and Wampler 1992): with the same w > 0 over successive segments the path
leaves for infinity, with w = 0 it ends at a solution that is not single. What is neither is lost.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray
from framework.linalg.quadrics import SEED, ComplexArray, QuadricFamily

RATIO = 0.25
SEGMENTS = 18  # the last is 1e-11 of the way: coefficients are not better known
AGREEING = 3  # exponents, of successive segments
ALIKE = 0.1  # relative difference of exponents that are one
LEAST = 0.1  # of an exponent w > 0: a tenth for ten paths that meet
FINITE = 0.05  # of an exponent that is 0
GROWN = 1e3  # size at infinity, over that of a displacement by one length
BEYOND = 1e5  # size at which an end may be at infinity and is followed once more


class PathEnds(NamedTuple):
    """The ends of all paths to one system."""

    z: ComplexArray  # (S, N) where paths have arrived
    arrived: BoolArray  # (S,)
    infinite: BoolArray  # (S,) that grow like those which leave for infinity
    multiple: BoolArray  # (S,) that did not arrive, and end at a finite solution that is not single
    left: ComplexArray  # (S, N) where they did so: before the end, different paths are apart


def path_ends(family: QuadricFamily, coefficients: Array, seed: int = 0) -> PathEnds:
    """The ends of all paths of a family to real coefficients (K, M), on ways that the seed chooses."""
    rng = np.random.default_rng([SEED + 1, seed])
    first, solutions = family.start
    target = (coefficients / np.linalg.norm(coefficients, axis=1, keepdims=True)).astype(complex)
    turned = np.exp(2j * np.pi * rng.random((family.equations, 1))) * first
    z, arrived = family.track(turned, target, solutions, rng)
    k = np.flatnonzero(~arrived | (sizes(family, z) > BEYOND))
    again, rest = _followed(family, turned, target, solutions[k], rng), ~arrived[k]
    infinite, multiple, left = np.zeros_like(arrived), np.zeros_like(arrived), z.copy()
    infinite[k], multiple[k], left[k] = again.infinite, again.multiple & rest, again.left
    z[k[rest]], arrived[k[rest]] = again.z[rest], again.arrived[rest]
    return PathEnds(z, arrived, infinite, multiple, left)


def sizes(family: QuadricFamily, z: ComplexArray) -> Array:
    """The size (S,) of z (S, N) as a displacement, infinite at infinity."""
    values = np.einsum("mij,ti,tj->tm", family.members, z, z)
    with np.errstate(divide="ignore"):
        return np.asarray(np.linalg.norm(values, axis=1) / np.abs(values[:, 0]))


def _followed(
    family: QuadricFamily,
    start: ComplexArray,
    target: ComplexArray,
    z: ComplexArray,
    rng: np.random.Generator,
) -> PathEnds:
    """The ends of paths from z (S, N), on a way that shrinks."""
    left, end = z.copy(), z.copy()
    far, near, arrived, live = (np.full(len(z), value) for value in (False, False, False, True))
    grown, here = [np.log(sizes(family, z))], start
    for segment in range(1, SEGMENTS + 1):
        there, k = target + RATIO**segment * (start - target), np.flatnonzero(live)
        if not len(k):
            break
        left[k], good = family.track(here, there, left[k], rng)
        grown.append(np.log(sizes(family, left)))
        here, live[k[~good]] = there, False
        if len(grown) <= AGREEING:
            continue
        w = np.diff(np.array(grown[-AGREEING - 1 :]), axis=0) / -np.log(RATIO)
        low, high = w.min(axis=0), w.max(axis=0)
        far |= live & (low > LEAST) & (high - low < ALIKE * high) & (grown[-1] > np.log(GROWN))
        still = live & (np.abs(w).max(axis=0) < FINITE)
        end[still], arrived[still] = family.track(there, target, left[still], rng)
        near |= still & ~arrived
        live &= ~(far | still)
    return PathEnds(end, arrived, far, near, left)
