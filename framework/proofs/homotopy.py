"""All real displacements that solve a system of leg conditions, by coefficient-parameter homotopy.

Monodromy finds all complex solutions of a start system with random coefficients: the coefficients run round
closed loops, along which one solution leads to all others (Duff et al., IMA J. Numerical Analysis 39, 2019).
A line of coefficients, made complex by random factors, connects the start system to any other system of the
group. With probability one no two solution paths meet on the line, and none diverges before its end. Paths
are tracked in stacks.

A path that does not arrive is tracked again by the endgame, which tells by its growth whether it goes to
infinity or ends at a multiple solution (Morgan, Sommese and Wampler 1992). All other paths are lost.

Krawczyk's test encloses the ends of all paths that arrive: each enclosure holds exactly one solution, for all
coefficients within their rounding. The solution is real if the middle of the enclosure is real, and not real
if the enclosure contains no real point. While paths are lost, the system is solved again along other paths.

Letters as in `study_quadric`: a system has K equations with coefficients (K, M) of M members, and N
homogeneous coordinates z. S counts paths. A chart fixes the scale of z by chart . z = 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal, NamedTuple

import numpy as np

from framework.numerics.arrays import Array, BoolArray, ReadOnlyArrays
from framework.numerics.ordered_sums import solve_or_fit
from framework.proofs.krawczyk import are_apart, choose_chart, enclose_solutions
from framework.proofs.rounding import ROUND_UP, gamma
from framework.proofs.study_quadric import (
    ComplexArray,
    Displacements,
    append_row,
    complex_normal,
    first_occurrences,
    matrix_products,
)
from framework.tolerances import (
    DISTINCT_SOLUTIONS,
    ENDGAME_MIN_EXPONENT,
    LEG_COEFFICIENT_ROUNDING,
    NEWTON_STEP,
)

NEWTON_STEPS = 3  # that correct a predicted point, and that refine a solution
MONODROMY_ROUNDS = 60
MIN_INFINITE_SIZE = 1e3  # [robot lengths] least size of a path that goes to infinity; no leg is that long
ENDGAME_SEGMENT_RATIO = 0.25

Status = Literal["proved", "numerically complete", "at least", "architecturally singular"]


@dataclass(frozen=True)
class PathCount:
    """The number of paths of a homotopy by their kinds of ends."""

    paths: int
    finite: int  # at single solutions that are apart
    infinite: int  # at infinity, or growing like such paths
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
    count: PathCount  # how the paths end
    status: Status  # in which sense these are all real solutions


def find_real_solutions(
    group: Displacements, coefficients: Array, rounding: float = LEG_COEFFICIENT_ROUNDING
) -> RealSolutions:
    """Find all real displacements that solve conditions with coefficients (K, M).

    Of at most `max_attempts` attempts along different paths, the result is the one with the fewest doubts.

    Args:
        rounding: error of the coefficients, relative to the largest coefficient of each condition.
    """
    max_attempts = 4  # each along other paths, while some are lost
    coefficients = coefficients / np.linalg.norm(coefficients, axis=1, keepdims=True)
    if group.is_dependent(coefficients):  # no solution is isolated
        R, p = group.to_displacements(np.zeros((0, group.size)))
        count = PathCount(paths=0, finite=0, infinite=0, multiple=0)
        return RealSolutions(R, p, np.zeros(0, dtype=bool), count, "architecturally singular")

    rows, slack = group.eliminate_square(coefficients, rounding)  # equivalent, with bounds on their errors
    attempts = list[RealSolutions]()
    for seed in range(1, max_attempts + 1):
        attempts.append(_prove_path_ends(group, rows, slack, seed))
        if attempts[-1].status != "at least":
            break

    # fewest doubts: a status without proof, lost paths, multiple solutions; the last of equal attempts
    return min(
        reversed(attempts),
        key=lambda attempt: (attempt.status == "at least", attempt.count.lost, attempt.count.multiple),
    )


def _prove_path_ends(group: Displacements, coefficients: Array, slack: Array, seed: int) -> RealSolutions:
    """Track all paths to one system once, and prove the solutions at their ends.

    A solution is decided if its enclosure is proved to hold exactly one solution, and either the solution is
    real or the enclosure contains no real point. Paths are counted by their ends, those with the same end
    once. A proved end is at infinity unless its enclosure provably holds no point at infinity. An end without
    a proof is infinite if the endgame says so, and multiple if it is real.

    Args:
        coefficients: (K, M) of the system.
        slack: (K, M) bounds on the errors of the coefficients.
        seed: of the random numbers that choose the paths.
    """
    quadrics = group.quadrics(coefficients)
    ends = find_path_ends(group, coefficients, seed)
    chart = choose_chart(ends.z[ends.arrived])
    z = refine_solutions(quadrics, ends.z[ends.arrived], chart.astype(complex))  # (S, N) of S arrived paths

    # The middle of an enclosure must be real for its solution to be proved real, so imaginary parts within
    # rounding are removed.
    norms = np.linalg.norm(z, axis=1)
    is_real = np.abs(z.imag).max(axis=1) < DISTINCT_SOLUTIONS * norms
    z[is_real] = z[is_real].real
    is_new = first_occurrences(z / norms[:, None])  # two paths may have ended at one solution
    proof = enclose_solutions(quadrics, group.quadrics_slack(slack), chart, z)

    # (S,) each, of the paths that arrived
    proved = proof.proved
    is_infinite = ends.infinite[ends.arrived] & ~proved
    first_member = group.members[0]  # zero at infinity alone
    is_infinite[proved] = ~_have_no_infinite_point(first_member, z[proved], proof.radii[proved])
    is_multiple = is_real & ~proved & ~is_infinite  # without proof another solution may be close
    never_arrived = first_occurrences(ends.z[ends.infinite & ~ends.arrived])
    count = PathCount(
        paths=len(ends.z),
        finite=int(np.sum(is_new & ~is_infinite & ~is_multiple)),
        infinite=int(np.sum(is_new & is_infinite) + np.sum(never_arrived)),
        multiple=int(np.sum(is_new & is_multiple) + np.sum(ends.multiple)),
    )

    is_not_real = (np.abs(z.imag) > proof.radii).any(axis=1)
    decided = np.count_nonzero(proved & (is_real | is_not_real))
    # all paths end at single solutions or at infinity, as many as solutions are possible (`bound`)
    is_complete = count.paths == group.bound and count.finite + count.infinite == group.bound
    status: Status = "numerically complete" if is_complete else "at least"
    if decided == group.bound and are_apart(z, proof.radii):
        status = "proved"
    chosen = is_real & is_new
    return RealSolutions(*group.to_displacements(z[chosen].real), proved[chosen], count, status)


def _have_no_infinite_point(quadric: Array, z: ComplexArray, radii: Array) -> BoolArray:
    """Return whether polydiscs of `radii` about z (S, N) provably hold no point at infinity, (S,).

    At infinity z' A z = 0, with the real `quadric` A (N, N). Within radii r (S, N) the value z' A z changes
    by at most 2 |A z| . r + r' |A| r. If its modulus at the middle is greater than this change and the
    rounding, the polydisc holds no point at infinity.
    """
    slopes = z @ quadric  # A z
    value = np.abs(np.sum(slopes * z, axis=1))
    A_size = np.abs(quadric)
    z_size = np.abs(z)
    max_change = np.sum((2 * np.abs(slopes) + radii @ A_size) * radii, axis=1)
    rounding = gamma(2 * z.shape[1]) * np.einsum("si,ij,sj->s", z_size, A_size, z_size)
    return value > ROUND_UP**2 * (max_change + 2 * rounding)  # that of the value, and that of the change


# ------------------------------------------------------------------ solution paths


@cache
def solve_start_system(group: Displacements) -> tuple[ComplexArray, ComplexArray]:
    """Find a random system (K, M) and its solutions (bound, N) by monodromy.

    The system is chosen such that a random point solves it. All solutions known so far are tracked to another
    random system and back, each time along a new closed loop of coefficients, until there are `group.bound`.
    After MONODROMY_ROUNDS loops the search ends with fewer.
    """
    rng = np.random.default_rng(0)
    z = group.random_point(rng)  # (N,)
    members = group.values(z[None])[0]  # (M,) at z
    # z solves a system whose coefficients are orthogonal to the members at z
    system = group.random_coefficients(rng)
    system -= np.outer(system @ members, members.conj()) / np.vdot(members, members)
    system /= np.linalg.norm(system, axis=1, keepdims=True)

    solutions = z[None]  # (known solutions, N)
    for _ in range(MONODROMY_ROUNDS):
        other = group.random_coefficients(rng)
        away, arrived = track_paths(group, system, other, solutions, rng)
        # back to the same system by another way, on which the solutions may change places
        back, returned = track_paths(group, other, _rotate_phases(system, rng), away[arrived], rng)
        candidates = np.concatenate([solutions, back[returned]])
        solutions = candidates[first_occurrences(candidates)]
        if len(solutions) >= group.bound:
            break
    return system, solutions


def _rotate_phases(coefficients: ComplexArray, rng: np.random.Generator) -> ComplexArray:
    """Multiply each equation, a row of coefficients (K, M), by a random complex number of modulus 1.

    The solutions stay the same, but paths from the system change.
    """
    return np.exp(2j * np.pi * rng.random((len(coefficients), 1))) * coefficients


def track_paths(
    group: Displacements, start: ComplexArray, end: ComplexArray, z: ComplexArray, rng: np.random.Generator
) -> tuple[ComplexArray, BoolArray]:
    """Track solutions z (S, N) from coefficients `start` to `end` (K, M), by predictor and corrector.

    The chart is random: `rng` draws it. Each path has its own t from 0 to 1 and its own step. A step is good,
    and taken, if the last Newton correction is small. After `steps_before_growth` good steps in a row the
    step is doubled, after a step that is not good it is halved. A path is lost if its step is below
    `min_step`.

    Returns:
        The last points (S, N) of the S paths, of unit norm; whether each has reached the end (S,).
    """
    steps_before_growth = 4  # successive good steps before the step is doubled
    first_step = 0.05  # share of the line of coefficients
    min_step = 1e-9  # share of the line of coefficients
    chart = complex_normal(rng, group.size)
    quadrics = group.quadrics(start)
    homotopy = _LinearHomotopy(quadrics, group.quadrics(end) - quadrics, chart)
    z = z / (z @ chart)[:, None]
    t = np.zeros(len(z))  # (S,) of each path, like the next two
    step = np.full(len(z), first_step)
    good_steps = np.zeros(len(z), dtype=int)  # successive ones
    live = np.arange(len(z))  # paths that are neither at t = 1 nor lost
    while len(live):
        # step, and keep the good steps
        h = np.minimum(step[live], 1.0 - t[live])  # not beyond t = 1
        ahead, correction = homotopy.advance(z[live], t[live], h)
        is_good = correction < NEWTON_STEP
        z[live[is_good]] = ahead[is_good]
        t[live[is_good]] += h[is_good]

        # adapt the step of each path
        good_steps[live] = np.where(is_good, good_steps[live] + 1, 0)
        grows = good_steps[live] >= steps_before_growth
        good_steps[live[grows]] = 0  # count again
        step[live] = h * np.where(grows, 2.0, np.where(is_good, 1.0, 0.5))

        live = live[(step[live] >= min_step) & (t[live] < 1.0)]
    return z / np.linalg.norm(z, axis=1, keepdims=True), t >= 1.0


def refine_solutions(quadrics: ComplexArray, z: ComplexArray, chart: ComplexArray) -> ComplexArray:
    """Refine solutions z (S, N) of quadrics (N - 1, N, N) in the chart (N,) by Newton steps."""
    z = z / (z @ chart)[:, None]
    system = _LinearHomotopy(quadrics, np.zeros_like(quadrics), chart)  # the same system at all t
    for _ in range(NEWTON_STEPS):
        z = z + system.newton_step(z, np.zeros(len(z)))
    return z


class PathEnds(NamedTuple):
    """The ends of all S paths to one system."""

    z: ComplexArray  # (S, N) solution, if the path has arrived; else the last point that was tracked
    arrived: BoolArray  # (S,)
    infinite: BoolArray  # (S,) the path grows like a path to infinity
    multiple: BoolArray  # (S,) the path did not arrive, and ends at a finite multiple solution


def find_path_ends(group: Displacements, coefficients: Array, seed: int) -> PathEnds:
    """Find the ends of all S paths from the start system to a target system.

    The endgame decides the ends of paths that do not arrive or that end far away.

    Args:
        coefficients: (K, M) of the target system.
        seed: of the random phases of the start system, on which the paths depend.
    """
    rng = np.random.default_rng(seed)
    start_coefficients, start_z = solve_start_system(group)
    start = _rotate_phases(start_coefficients, rng)
    target = (coefficients / np.linalg.norm(coefficients, axis=1, keepdims=True)).astype(complex)
    z, arrived = track_paths(group, start, target, start_z, rng)  # (S, N), (S,)

    is_doubtful = ~arrived | (displacement_sizes(group, z) > MIN_INFINITE_SIZE)
    # the endgame completes these arrays
    infinite, multiple = np.zeros((2, len(z)), dtype=bool)
    ends = PathEnds(z=z, arrived=arrived, infinite=infinite, multiple=multiple)
    last = np.where(is_doubtful[:, None], start_z, z)  # doubtful paths start again
    _run_endgame(group, (start, target), ends, last, is_doubtful, rng)
    # a path that never arrives has no solution: its last point stands for one
    ends.z[~ends.arrived] = last[~ends.arrived]
    return ends


def displacement_sizes(group: Displacements, z: ComplexArray) -> Array:
    """Compute the dimensionless sizes (S,) of displacements z (S, N); inf at infinity.

    The size is the norm of all members of the group at z, divided by the modulus of the first member, which
    is zero only at infinity.
    """
    values = group.values(z)
    with np.errstate(divide="ignore"):
        return np.linalg.norm(values, axis=1) / np.abs(values[:, 0])


def _run_endgame(
    group: Displacements,
    line: tuple[ComplexArray, ComplexArray],
    ends: PathEnds,
    last: ComplexArray,
    live: BoolArray,
    rng: np.random.Generator,
) -> None:
    """Classify paths by their growth over shrinking segments, in place.

    After segment k the share s = `ENDGAME_SEGMENT_RATIO`^k of the line remains. The size behaves as s^-w with
    a rational w (Puiseux), and a segment has the exponent w = -(change of log size) / log(ratio). The
    exponents of successive segments distinguish infinity (the same w > 0) from a finite end (w = 0). A path
    with a finite end is tracked to it, unless it has arrived before. Paths that are lost or stay undecided
    keep their flags in `ends`.

    Args:
        line: coefficients (K, M) of the start system and of the target system.
        ends: of all S paths; completed where the endgame finds an end.
        last: (S, N) points of the paths, at the start of the line if live; the last points on return.
        live: (S,) paths to classify; becomes False where a path is classified or lost.
        rng: draws the charts in which paths are tracked.
    """
    segments = 18  # the last ends at 1e-11 of the line: coefficients are known no better
    agreeing = 3  # exponents of successive segments that must agree to decide how a path ends
    start, target = line
    segment_start = start
    log_sizes = [np.log(displacement_sizes(group, last))]
    for segment in range(1, segments + 1):
        if not live.any():
            break
        # track all paths to the end of the next segment; those that do not arrive there are lost
        segment_end = target + ENDGAME_SEGMENT_RATIO**segment * (start - target)
        last[live], arrived = track_paths(group, segment_start, segment_end, last[live], rng)
        live[live] = arrived
        log_sizes.append(np.log(displacement_sizes(group, last)))
        segment_start = segment_end
        if segment < agreeing:
            continue

        # classify: changes (A, S) of log size over the last A = `agreeing` segments, and exponents w (A, S)
        changes = np.diff(log_sizes[-agreeing - 1 :], axis=0)
        exponents = changes / -np.log(ENDGAME_SEGMENT_RATIO)
        # whether the exponents w (A, S) of A segments are positive, agree, and sizes are large, (S,)
        agree = np.ptp(exponents, axis=0) < ENDGAME_MIN_EXPONENT
        is_large = log_sizes[-1] > np.log(MIN_INFINITE_SIZE)
        is_infinite = live & ((exponents.min(axis=0) > ENDGAME_MIN_EXPONENT) & agree & is_large)
        is_finite = live & (np.abs(exponents).max(axis=0) < ENDGAME_MIN_EXPONENT)
        live &= ~(is_infinite | is_finite)  # the undecided go on
        ends.infinite[is_infinite] = True

        # track paths with a finite end to it; at a multiple solution they do not arrive
        unfinished = is_finite & ~ends.arrived
        ends.z[unfinished], arrived = track_paths(group, segment_end, target, last[unfinished], rng)
        ends.arrived[unfinished] = arrived
        ends.multiple[unfinished] = ~arrived


class _LinearHomotopy(NamedTuple):
    """Equations of all S paths z(t): z' (start + t change) z = 0 and chart . z = 1."""

    start: ComplexArray  # (N - 1, N, N) quadrics at t = 0
    change: ComplexArray  # (N - 1, N, N) from t = 0 to t = 1
    chart: ComplexArray  # (N,)

    def half_jacobian(self, z: ComplexArray, t: Array) -> ComplexArray:
        """Compute half the Jacobian (S, N, N) at z (S, N), t (S,).

        A quadric z' Q z has the gradient 2 Q z, so half of it is the product Q z. Half of the chart's
        gradient is the last row.
        """
        rows = matrix_products(self.start, z) + matrix_products(self.change, z) * t[:, None, None]
        return append_row(rows, 0.5 * self.chart)

    def rate(self, z: ComplexArray, t: Array) -> ComplexArray:
        """Compute dz/dt (S, N) along the paths.

        The derivative of the quadrics gives 2 z' (start + t change) dz/dt = -z' change z; the chart gives
        chart . dz/dt = 0.
        """
        right = np.zeros_like(z)
        right[:, :-1] = -0.5 * np.matvec(matrix_products(self.change, z), z)
        return solve_or_fit(self.half_jacobian(z, t), right[:, :, None])[:, :, 0]  # the factor 2 cancels

    def newton_step(self, z: ComplexArray, t: Array) -> ComplexArray:
        """Compute the Newton step (S, N) at z (S, N), t (S,).

        The step has the least norm where the Jacobian is singular. Values and Jacobian are both halved, which
        leaves the step unchanged. A quadric has the value z' Q z, the product of its row Q z of the halved
        Jacobian with z. The last row is that of the chart, with the value chart . z - 1.
        """
        half_jacobian = self.half_jacobian(z, t)
        half_values = 0.5 * np.matvec(half_jacobian, z)  # (S, N)
        half_values[:, -1] = 0.5 * (z @ self.chart - 1.0)
        return solve_or_fit(half_jacobian, -half_values[:, :, None])[:, :, 0]

    def advance(self, z: ComplexArray, t: Array, h: Array) -> tuple[ComplexArray, Array]:
        """Advance z (S, N) from t to t + h, each (S,); return z and relative corrections (S,).

        The predictor is the classical Runge-Kutta method of order 4, the corrector Newton's method. The
        correction returned is the size of the last Newton step, relative to |z|.
        """
        step = h[:, None]  # (S, 1), the same steps, to multiply vectors (S, N)
        # rates (S, N) at the start, twice in the middle, and at the end of the step
        k1 = self.rate(z, t)
        k2 = self.rate(z + 0.5 * step * k1, t + 0.5 * h)
        k3 = self.rate(z + 0.5 * step * k2, t + 0.5 * h)
        k4 = self.rate(z + step * k3, t + h)
        ahead = z + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

        for _ in range(NEWTON_STEPS):
            correction = self.newton_step(ahead, t + h)
            ahead = ahead + correction
        return ahead, np.linalg.norm(correction, axis=1) / np.linalg.norm(ahead, axis=1)
