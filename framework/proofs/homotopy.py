"""All solutions of a system of quadrics, by coefficient-parameter homotopy; where the paths end.

The solutions of one system with random complex coefficients are found by monodromy: the coefficients go round
a closed way, and from one solution all others are reached (Duff et al., IMA J. Numerical Analysis 39, 2019).
From it straight ways of coefficients, complex by random factors, lead to any other system of the family; on
them solutions neither meet nor leave before the end, but with probability zero. Paths are followed in stacks.

A path that does not arrive is followed again on a way that shrinks by the same factor a segment, s ->
`ENDGAME_SEGMENT_RATIO` s. Its size |(functions)| / |first function|, that of a displacement R, p, behaves as
s^-w with a rational w (Puiseux; Morgan, Sommese and Wampler 1992): with the same w > 0 over successive
segments the path leaves for infinity, with w = 0 it ends at a solution that is not single. What is neither is
lost.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray
from framework.linalg.ordered_sums import solve_or_fit
from framework.proofs.study_quadric import ComplexArray, QuadricFamily, is_first
from framework.tolerances import ENDGAME_MIN_EXPONENT, NEWTON_STEP

MIN_INFINITE_SIZE = 1e3  # [robot lengths] of a path on its way to infinity; no leg is that long
MAX_EXPONENT_SPREAD = 0.1  # of the largest of them: exponents of successive segments that agree
FIRST_STEP, MIN_STEP = 0.05, 1e-9  # of the way
CORRECTOR_STEPS = 3  # Newton steps
STEPS_BEFORE_GROWTH = 4  # that go well before the next is longer
MAX_SIZE = 1e7  # of z in its chart: beyond, a path is no longer followed in it
MONODROMY_ROUNDS = 60
REFINEMENT_STEPS = 4  # Newton steps
ENDGAME_SEGMENT_RATIO = 0.25
ENDGAME_SEGMENTS = 18  # the last is 1e-11 of the way: coefficients are not better known
AGREEING_EXPONENTS = 3  # of successive segments
FOLLOWED_AGAIN_SIZE = 1e5  # of an end, as a displacement: it may be at infinity
START_SEED, PATH_SEED = 20, 21


class StartSystem(NamedTuple):
    """A random system and its solutions."""

    coefficients: ComplexArray  # (K, M)
    z: ComplexArray  # (bound, N), as many as monodromy found


@cache
def start_system(family: QuadricFamily) -> StartSystem:
    """Find the solutions of a random system of a family."""
    rng = np.random.default_rng(START_SEED)
    z = family.random_point(rng)
    values = family.values(z[None])[0]
    through = family.random_coefficients(rng)
    through -= np.outer(through @ values, values.conj()) / np.vdot(values, values)  # z solves it
    through /= np.linalg.norm(through, axis=1, keepdims=True)
    nodes = [through, family.random_coefficients(rng)]
    known = [z[None] / np.linalg.norm(z), np.zeros((0, family.size), dtype=complex)]
    for _ in range(MONODROMY_ROUNDS):
        for near, far in ((0, 1), (1, 0)):
            turned = [np.exp(2j * np.pi * rng.random((family.equations, 1))) * node for node in nodes]
            ends, arrived = track_paths(family, turned[near], turned[far], known[near], rng)
            both = np.concatenate([known[far], ends[arrived]])
            known[far] = both[is_first(both)]
        if len(known[0]) >= family.bound:
            break
    return StartSystem(nodes[0], known[0])


def track_paths(
    family: QuadricFamily, start: ComplexArray, end: ComplexArray, z: ComplexArray, rng: np.random.Generator
) -> tuple[ComplexArray, BoolArray]:
    """Lead solutions z (S, N) from coefficients to others (K, M); return ends, and which arrived."""
    chart = rng.standard_normal(family.size) + 1j * rng.standard_normal(family.size)
    homotopy = _LinearHomotopy(family.quadrics(start), family.quadrics(end) - family.quadrics(start), chart)
    z = z / (z @ chart)[:, None]
    t, step, good_steps = np.zeros(len(z)), np.full(len(z), FIRST_STEP), np.zeros(len(z), dtype=int)
    live = np.arange(len(z))
    while len(live):
        h = np.minimum(step[live], 1.0 - t[live])
        ahead, correction = homotopy.advance(z[live], t[live], h)
        good = correction < NEWTON_STEP
        z[live[good]] = ahead[good]
        t[live[good]] += h[good]
        good_steps[live] = np.where(good, good_steps[live] + 1, 0)
        longer = good_steps[live] >= STEPS_BEFORE_GROWTH
        step[live] = np.where(good, np.where(longer, 2.0, 1.0), 0.5) * h
        good_steps[live[longer]] = 0
        lost = (step[live] < MIN_STEP) | ~(np.linalg.norm(z[live], axis=1) < MAX_SIZE)
        live = live[~lost & (t[live] < 1.0)]
    return z / np.linalg.norm(z, axis=1, keepdims=True), t >= 1.0


def refine(quadrics: ComplexArray, z: ComplexArray, chart: ComplexArray) -> ComplexArray:
    """Refine solutions z (S, N) by Newton steps in the chart (N,) . z = 1."""
    z = z / (z @ chart)[:, None]
    system = _LinearHomotopy(quadrics, 0 * quadrics, chart)
    for _ in range(REFINEMENT_STEPS):
        z = z + system.newton(z, np.zeros(len(z)))
    return z


class PathEnds(NamedTuple):
    """The ends of all paths to one system."""

    z: ComplexArray  # (S, N) where paths have arrived
    arrived: BoolArray  # (S,)
    infinite: BoolArray  # (S,) that grow like those which leave for infinity
    multiple: BoolArray  # (S,) that did not arrive, and end at a finite solution that is not single
    last: ComplexArray  # (S, N) where paths were last followed to: before the end, different ones are apart


def path_ends(family: QuadricFamily, coefficients: Array, seed: int = 0) -> PathEnds:
    """Find the ends of all paths of a family to real coefficients (K, M), on ways that the seed chooses."""
    rng = np.random.default_rng([PATH_SEED, seed])
    start = start_system(family)
    target = (coefficients / np.linalg.norm(coefficients, axis=1, keepdims=True)).astype(complex)
    turned = np.exp(2j * np.pi * rng.random((family.equations, 1))) * start.coefficients
    z, arrived = track_paths(family, turned, target, start.z, rng)
    again = np.flatnonzero(~arrived | (sizes(family, z) > FOLLOWED_AGAIN_SIZE))
    ends, missing = _endgame(family, turned, target, start.z[again], rng), ~arrived[again]
    infinite, multiple, last = np.zeros_like(arrived), np.zeros_like(arrived), z.copy()
    infinite[again], multiple[again], last[again] = ends.infinite, ends.multiple & missing, ends.last
    z[again[missing]], arrived[again[missing]] = ends.z[missing], ends.arrived[missing]
    return PathEnds(z, arrived, infinite, multiple, last)


def sizes(family: QuadricFamily, z: ComplexArray) -> Array:
    """Compute the size (S,) of z (S, N) as a displacement, infinite at infinity."""
    values = family.values(z)
    with np.errstate(divide="ignore"):
        return np.linalg.norm(values, axis=1) / np.abs(values[:, 0])


def _endgame(
    family: QuadricFamily,
    start: ComplexArray,
    target: ComplexArray,
    z: ComplexArray,
    rng: np.random.Generator,
) -> PathEnds:
    """Follow paths from z (S, N) on a way of shrinking segments until the exponents tell the ends."""
    last, end = z.copy(), z.copy()
    infinite, multiple, arrived = np.zeros((3, len(z)), dtype=bool)
    live = np.ones(len(z), dtype=bool)
    logarithms, near = [np.log(sizes(family, z))], start
    for segment in range(1, ENDGAME_SEGMENTS + 1):
        k = np.flatnonzero(live)
        if not len(k):
            break
        far = target + ENDGAME_SEGMENT_RATIO**segment * (start - target)
        last[k], live[k] = track_paths(family, near, far, last[k], rng)
        logarithms.append(np.log(sizes(family, last)))
        near = far
        if len(logarithms) <= AGREEING_EXPONENTS:
            continue
        w = np.diff(np.array(logarithms[-AGREEING_EXPONENTS - 1 :]), axis=0) / -np.log(ENDGAME_SEGMENT_RATIO)
        infinite |= live & _leave_for_infinity(w, logarithms[-1])
        finite = live & (np.abs(w).max(axis=0) < ENDGAME_MIN_EXPONENT)
        end[finite], arrived[finite] = track_paths(family, far, target, last[finite], rng)
        multiple |= finite & ~arrived
        live &= ~(infinite | finite)
    return PathEnds(end, arrived, infinite, multiple, last)


def _leave_for_infinity(w: Array, logarithm: Array) -> BoolArray:
    """Whether exponents w (A, S) of successive segments agree and sizes are large, (S,)."""
    least, largest = w.min(axis=0), w.max(axis=0)
    agree = largest - least < MAX_EXPONENT_SPREAD * largest
    return (least > ENDGAME_MIN_EXPONENT) & agree & (logarithm > np.log(MIN_INFINITE_SIZE))


class _LinearHomotopy(NamedTuple):
    """A straight way of systems, in a chart."""

    start: ComplexArray  # (N - 1, N, N) quadrics at t = 0
    change: ComplexArray  # (N - 1, N, N) from there to t = 1
    chart: ComplexArray  # (N,) chart . z = 1

    def slopes(self, z: ComplexArray, t: Array) -> ComplexArray:
        """Compute half the Jacobian (S, N, N), the chart last, at z (S, N) and t (S,)."""
        S, N = z.shape
        values = self.start.reshape(-1, N) @ z.T + (self.change.reshape(-1, N) @ z.T) * t
        rows = values.T.reshape(S, N - 1, N)
        return np.concatenate([rows, np.broadcast_to(0.5 * self.chart, (S, 1, N))], axis=1)

    def rate(self, z: ComplexArray, t: Array) -> ComplexArray:
        """Compute dz/dt (S, N) along the way."""
        S, N = z.shape
        changes = np.einsum("ski,si->sk", (self.change.reshape(-1, N) @ z.T).T.reshape(S, N - 1, N), z)
        right = np.concatenate([-0.5 * changes, np.zeros((S, 1))], axis=1)
        return solve_or_fit(self.slopes(z, t), right[:, :, None])[:, :, 0]

    def newton(self, z: ComplexArray, t: Array) -> ComplexArray:
        """Compute the Newton step (S, N)."""
        slopes = self.slopes(z, t)
        values = 0.5 * np.einsum("ski,si->sk", slopes, z)
        values[:, -1] = 0.5 * (z @ self.chart - 1.0)
        # one of them singular to the last bit: its path is shortened
        return solve_or_fit(slopes, -values[:, :, None])[:, :, 0]

    def advance(self, z: ComplexArray, t: Array, h: Array) -> tuple[ComplexArray, Array]:
        """Predict z (S, N) at t + h (Runge-Kutta) and correct; return also the last correction."""
        k1 = self.rate(z, t)
        k2 = self.rate(z + 0.5 * h[:, None] * k1, t + 0.5 * h)
        k3 = self.rate(z + 0.5 * h[:, None] * k2, t + 0.5 * h)
        k4 = self.rate(z + h[:, None] * k3, t + h)
        ahead = z + h[:, None] / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        for _ in range(CORRECTOR_STEPS):
            change = self.newton(ahead, t + h)
            ahead = ahead + change
        return ahead, np.linalg.norm(change, axis=1) / np.linalg.norm(ahead, axis=1)
