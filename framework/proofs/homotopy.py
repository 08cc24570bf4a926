"""All solutions of a system of quadrics by coefficient-parameter homotopy, and how the solution paths end.

Monodromy finds the solutions of a start system with random complex coefficients: the coefficients run round
closed loops, along which one solution leads to all others (Duff et al., IMA J. Numerical Analysis 39, 2019).
A line of coefficients, made complex by random factors, connects the start system to any other system of the
family. With probability one no two solution paths meet on the line, and none diverges before its end. Paths
are tracked in stacks.

A path that does not arrive is tracked again by the endgame, in segments: each reduces the remaining share s
of the line to `ENDGAME_SEGMENT_RATIO` s. The size of a displacement (`displacement_sizes`) behaves as s^-w
with a rational exponent w (Puiseux; Morgan, Sommese and Wampler 1992). If w is positive and the same over
successive segments, the path goes to infinity; if w = 0, it ends at a multiple solution. All other paths are
lost.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from framework.numerics.arrays import Array, BoolArray, assign
from framework.numerics.ordered_sums import solve_or_fit
from framework.proofs.study_quadric import (
    ComplexArray,
    QuadricFamily,
    append_row,
    complex_normal,
    first_occurrences,
    matrix_products,
)
from framework.tolerances import ENDGAME_MIN_EXPONENT, NEWTON_STEP

MIN_INFINITE_SIZE = 1e3  # [robot lengths] least size of a path that goes to infinity; no leg is that long
MAX_EXPONENT_SPREAD = 0.1  # difference of exponents that count as equal, relative to the largest
FIRST_STEP, MIN_STEP = 0.05, 1e-9  # as shares of the line of coefficients
CORRECTOR_STEPS = 3  # Newton steps
STEPS_BEFORE_GROWTH = 4  # successive good steps before the step is doubled
MAX_SIZE = 1e7  # of z in its chart; a path with a larger z counts as lost
MONODROMY_ROUNDS = 60
REFINEMENT_STEPS = 4  # Newton steps
ENDGAME_SEGMENT_RATIO = 0.25
ENDGAME_SEGMENTS = 18  # the last one ends at 1e-11 of the line: coefficients are known no better
AGREEING_EXPONENTS = 3  # exponents of successive segments that must agree to decide how a path ends
MAX_FINITE_SIZE = 1e5  # a larger displacement at the end of a path may be at infinity: the endgame decides
START_SEED, PATH_SEED = 20, 21


class StartSystem(NamedTuple):
    """A random system of a family, and its solutions."""

    coefficients: ComplexArray  # (K, M)
    z: ComplexArray  # (bound, N), or fewer if monodromy missed some


@cache
def solve_start_system(family: QuadricFamily) -> StartSystem:
    """Find the solutions of a random system of a family by monodromy.

    The first of two systems is chosen such that a random point solves it. Solutions are tracked to the second
    system and back, each time with new complex factors of the equations, which makes a new closed loop of
    coefficients.
    """
    rng = np.random.default_rng(START_SEED)
    z = family.random_point(rng)
    members = family.values(z[None])[0]  # (M,) at z
    # z solves a system whose coefficients are orthogonal to the members at z
    coefficients = family.random_coefficients(rng)
    coefficients -= np.outer(coefficients @ members, members.conj()) / np.vdot(members, members)
    coefficients /= np.linalg.norm(coefficients, axis=1, keepdims=True)
    systems = [coefficients, family.random_coefficients(rng)]
    solutions = [z[None] / np.linalg.norm(z), np.zeros((0, family.size), dtype=complex)]  # of each system
    for _ in range(MONODROMY_ROUNDS):
        for start, end in ((0, 1), (1, 0)):  # to the second system, and back
            rotated = [_rotate_phases(family, system, rng) for system in systems]
            tracked = track_paths(family, rotated[start], rotated[end], solutions[start], rng)
            candidates = np.concatenate([solutions[end], tracked.z[tracked.arrived]])
            solutions[end] = candidates[first_occurrences(candidates)]
        if len(solutions[0]) >= family.bound:
            break
    return StartSystem(systems[0], solutions[0])


def _rotate_phases(
    family: QuadricFamily, coefficients: ComplexArray, rng: np.random.Generator
) -> ComplexArray:
    """Multiply each equation (row) by a random complex number of modulus 1.

    The solutions stay the same, but paths from the system change.
    """
    return np.exp(2j * np.pi * rng.random((family.equations, 1))) * coefficients


class TrackedPaths(NamedTuple):
    """The ends of S tracked paths."""

    z: ComplexArray  # (S, N) unit points
    arrived: BoolArray  # (S,)


def track_paths(
    family: QuadricFamily, start: ComplexArray, end: ComplexArray, z: ComplexArray, rng: np.random.Generator
) -> TrackedPaths:
    """Track solutions z (S, N) from coefficients `start` to `end` (K, M), by predictor and corrector.

    Each path has its own t from 0 to 1 and its own step. A step is accepted if its correction is small, and
    doubled after several good ones; a rejected step is halved. A path is lost if its step becomes too short
    or z too large for the chart.
    """
    chart = complex_normal(rng, family.size)
    quadrics = family.quadrics(start)
    homotopy = _LinearHomotopy(quadrics, family.quadrics(end) - quadrics, chart)
    z = z / (z @ chart)[:, None]
    t = np.zeros(len(z))
    step = np.full(len(z), FIRST_STEP)
    good_steps = np.zeros(len(z), dtype=int)
    live = np.arange(len(z))  # paths that are neither at t = 1 nor lost
    while len(live):
        h = np.minimum(step[live], 1.0 - t[live])
        ahead, correction = homotopy.advance(z[live], t[live], h)
        is_good = correction < NEWTON_STEP
        z[live[is_good]] = ahead[is_good]
        t[live[is_good]] += h[is_good]
        good_steps[live] = np.where(is_good, good_steps[live] + 1, 0)
        grows = good_steps[live] >= STEPS_BEFORE_GROWTH
        step[live] = h * np.where(is_good, 1.0, 0.5) * np.where(grows, 2.0, 1.0)
        good_steps[live[grows]] = 0
        is_lost = (step[live] < MIN_STEP) | ~(np.linalg.norm(z[live], axis=1) < MAX_SIZE)
        live = live[~is_lost & (t[live] < 1.0)]
    return TrackedPaths(z / np.linalg.norm(z, axis=1, keepdims=True), t >= 1.0)


def refine_solutions(quadrics: ComplexArray, z: ComplexArray, chart: ComplexArray) -> ComplexArray:
    """Refine solutions z (S, N) by Newton steps in the chart (N,) . z = 1."""
    z = z / (z @ chart)[:, None]
    system = _LinearHomotopy(quadrics, np.zeros_like(quadrics), chart)  # the same system at all t
    for _ in range(REFINEMENT_STEPS):
        z = z + system.newton_step(z, np.zeros(len(z)))
    return z


class PathEnds(NamedTuple):
    """The ends of all S paths to one system."""

    z: ComplexArray  # (S, N) solution, if the path has arrived
    arrived: BoolArray  # (S,)
    infinite: BoolArray  # (S,) the path grows like a path to infinity
    multiple: BoolArray  # (S,) the path did not arrive, and ends at a finite multiple solution
    last: ComplexArray  # (S, N) last point that the endgame tracked; it distinguishes paths with equal ends


def find_path_ends(family: QuadricFamily, coefficients: Array, seed: int) -> PathEnds:
    """Find the ends of all S paths from the start system to a target system.

    The endgame tracks again all paths that do not arrive or that end far away, and decides how they end.

    Args:
        coefficients: (K, M) of the K quadrics of the target system, in M monomials.
        seed: of the random phases of the start system, on which the paths depend.
    """
    rng = np.random.default_rng([PATH_SEED, seed])
    start_system = solve_start_system(family)
    target = (coefficients / np.linalg.norm(coefficients, axis=1, keepdims=True)).astype(complex)
    start = _rotate_phases(family, start_system.coefficients, rng)
    z, arrived = track_paths(family, start, target, start_system.z, rng)
    infinite, multiple = np.zeros((2, len(z)), dtype=bool)
    ends = PathEnds(z=z, arrived=arrived, infinite=infinite, multiple=multiple, last=z.copy())

    doubtful = np.flatnonzero(~arrived | (displacement_sizes(family, z) > MAX_FINITE_SIZE))
    endgame = _endgame(family, start, target, start_system.z[doubtful], rng)
    # a path that arrived far away keeps its solution; the endgame only decides whether it goes to infinity
    has_arrived = arrived[doubtful]
    endgame.z[has_arrived] = z[doubtful[has_arrived]]
    endgame.arrived[has_arrived] = True
    endgame.multiple[has_arrived] = False
    assign(ends, doubtful, endgame)
    return ends


def displacement_sizes(family: QuadricFamily, z: ComplexArray) -> Array:
    """Compute the sizes (S,) of displacements z (S, N), infinite at infinity.

    The size is the norm of all members of the family at z, divided by the modulus of the first member.
    """
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
    """Classify the ends of paths from z (S, N) by their growth over shrinking segments.

    After segment k the share s = `ENDGAME_SEGMENT_RATIO`^k of the line remains. If the size behaves as s^-w,
    a segment has the exponent w = -(change of log size) / log(ratio). The exponents of successive segments
    distinguish infinity (the same w > 0) from a finite end (w = 0), to which the path is then tracked.
    """
    arrived, infinite, multiple = np.zeros((3, len(z)), dtype=bool)
    ends = PathEnds(z=z.copy(), arrived=arrived, infinite=infinite, multiple=multiple, last=z.copy())
    live = np.ones(len(z), dtype=bool)  # neither classified nor lost
    log_sizes = [np.log(displacement_sizes(family, z))]
    segment_start = start
    for segment in range(1, ENDGAME_SEGMENTS + 1):
        if not live.any():
            break
        segment_end = target + ENDGAME_SEGMENT_RATIO**segment * (start - target)
        tracked = track_paths(family, segment_start, segment_end, ends.last[live], rng)
        ends.last[live] = tracked.z
        live[live] = tracked.arrived
        log_sizes.append(np.log(displacement_sizes(family, ends.last)))
        segment_start = segment_end
        if segment < AGREEING_EXPONENTS:
            continue

        changes = np.diff(log_sizes[-AGREEING_EXPONENTS - 1 :], axis=0)  # (A, S) over the last A segments
        w = changes / -np.log(ENDGAME_SEGMENT_RATIO)
        is_infinite = live & _goes_to_infinity(w, log_sizes[-1])
        ends.infinite[is_infinite] = True
        is_finite = live & (np.abs(w).max(axis=0) < ENDGAME_MIN_EXPONENT)
        tracked = track_paths(family, segment_end, target, ends.last[is_finite], rng)
        ends.z[is_finite], ends.arrived[is_finite] = tracked
        ends.multiple[is_finite] = ~tracked.arrived
        live &= ~(is_infinite | is_finite)
    return ends


def _goes_to_infinity(w: Array, log_size: Array) -> BoolArray:
    """Return whether the exponents w (A, S) of A segments agree and sizes are large, (S,)."""
    agree = np.ptp(w, axis=0) < MAX_EXPONENT_SPREAD * w.max(axis=0)
    is_large = log_size > np.log(MIN_INFINITE_SIZE)
    return (w.min(axis=0) > ENDGAME_MIN_EXPONENT) & agree & is_large


class _LinearHomotopy(NamedTuple):
    """Quadrics z' (start + t change) z = 0, t from 0 to 1, in the chart."""

    start: ComplexArray  # (N - 1, N, N)
    change: ComplexArray  # (N - 1, N, N)
    chart: ComplexArray  # (N,) chart . z = 1

    def half_jacobian(self, z: ComplexArray, t: Array) -> ComplexArray:
        """Compute half the Jacobian (S, N, N) at z (S, N), t (S,); the chart row is last."""
        rows = matrix_products(self.start, z) + matrix_products(self.change, z) * t[:, None, None]
        return append_row(rows, 0.5 * self.chart)

    def rate(self, z: ComplexArray, t: Array) -> ComplexArray:
        """Compute dz/dt (S, N) along the paths.

        The derivative of the quadrics gives 2 z' (start + t change) dz/dt = -z' change z; the chart gives
        chart . dz/dt = 0.
        """
        right = np.zeros_like(z)
        right[:, :-1] = -0.5 * np.einsum("ski,si->sk", matrix_products(self.change, z), z)
        return solve_or_fit(self.half_jacobian(z, t), right[:, :, None])[:, :, 0]

    def newton_step(self, z: ComplexArray, t: Array) -> ComplexArray:
        """Compute the Newton step (S, N), of least norm where the Jacobian is singular."""
        half_jacobian = self.half_jacobian(z, t)
        half_values = 0.5 * np.einsum("ski,si->sk", half_jacobian, z)
        half_values[:, -1] = 0.5 * (z @ self.chart - 1.0)
        return solve_or_fit(half_jacobian, -half_values[:, :, None])[:, :, 0]

    def advance(self, z: ComplexArray, t: Array, h: Array) -> tuple[ComplexArray, Array]:
        """Advance z (S, N) from t to t + h, each (S,); return z and relative corrections (S,).

        The predictor is the classical Runge-Kutta method of order 4, the corrector Newton's method. The
        correction returned is that of the last Newton step, relative to |z|.
        """
        H = h[:, None]  # (S, 1) multiplies vectors
        k1 = self.rate(z, t)
        k2 = self.rate(z + 0.5 * H * k1, t + 0.5 * h)
        k3 = self.rate(z + 0.5 * H * k2, t + 0.5 * h)
        k4 = self.rate(z + H * k3, t + h)
        ahead = z + H / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        for _ in range(CORRECTOR_STEPS):
            correction = self.newton_step(ahead, t + h)
            ahead = ahead + correction
        return ahead, np.linalg.norm(correction, axis=1) / np.linalg.norm(ahead, axis=1)
