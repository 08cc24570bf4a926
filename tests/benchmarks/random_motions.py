"""Random motions of every robot's platform, tracked: on the right branch all along, or refused with a reason.

    python -m tests.benchmarks.random_motions [ROBOT ...] [--motions 5000] [--processes 2]

Straight and curved paths, gone at uneven speeds, from the reference and from places beside it, as far as 0.6
radians and robot lengths: many cross the singular locus, many leave the workspace. `track_path` follows them
with as few steps as it dares. What it says is held against steps of 1/64 of the path without any certificate,
each closed by two steps of Newton's method from where the last one ended (where the two differ, against steps
16 times as short: beside a singularity 64 are too few). At nine places along the path both have to give the
same configuration, turns of all hinges included. Where they still differ, two steps of Newton's method may
not have closed the loops: steps of two lengths, closed to rounding, have to agree with each other before they
say that a motion is on its branch or off; else it is undecided, and printed with the least singular value on
its way. Where a motion is refused, the small steps have to come close to a pose where the platform does not
determine the joints: elsewhere there was no reason to. Refusals are counted by the class of their error.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np

import robots
from framework import ParallelRobot, track_path
from framework.errors import NoAnswer
from framework.kinematics.frames import integrate
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.loop_matrices import type1_matrix
from framework.linalg.ordered_sums import solve

SMALL_STEPS = (64, 1024, 16384)  # the finer ones where the others do not agree
PLACES = np.linspace(0.0, 1.0, 9)
FARTHEST = 0.6  # [rad, robot lengths] that a coordinate goes
SAME = 1e-6  # [rad, robot lengths] between two ways to a pose of one branch
# of the least singular value at the reference: a way that ends within 1e-7 of its length before a Type 1
# singularity is as near as the square root of that
NEAR = 0.02
CLOSINGS = 20  # steps of Newton's method: far from closed beside a Type 1 singularity, each halves the error
CLOSED = 1e-8  # [rad, robot lengths]: a step of Newton's method this small leaves its square
STACK = 250  # motions that are judged in one call


class Motion(NamedTuple):
    """A path x0 + c1 u + c2 u^2 + c3 u^3 gone at an uneven speed: u = s + a sin(2 pi s) / (2 pi)."""

    coefficients: np.ndarray  # (4, n)
    unevenness: float  # a, in (-1, 1)
    knots: np.ndarray = np.zeros(0)

    @property
    def n(self) -> int:
        return self.coefficients.shape[1]

    def __call__(self, s, order: int = 0) -> np.ndarray:
        s = np.asarray(s, dtype=float)
        a, turn = self.unevenness, 2 * np.pi
        u = s + a * np.sin(turn * s) / turn
        du, ddu = 1 + a * np.cos(turn * s), -a * turn * np.sin(turn * s)
        c = self.coefficients
        powers = np.stack([np.ones_like(u), u, u**2, u**3], axis=-1)
        slope = np.stack([0 * u, 1 + 0 * u, 2 * u, 3 * u**2], axis=-1) @ c
        if order == 0:
            return powers @ c
        if order == 1:
            return slope * du[..., None]
        bend = np.stack([0 * u, 0 * u, 2 + 0 * u, 6 * u], axis=-1) @ c
        return bend * du[..., None] ** 2 + slope * ddu[..., None]


class Evidence(NamedTuple):
    """What was found of one robot."""

    name: str
    motions: int
    followed: int
    refused: Counter  # by class of the error
    off_branch: list  # numbers of motions that small steps do not follow
    undecided: list  # (number, least singular value) of motions that two kinds of small steps lead elsewhere
    unexplained: list  # numbers of motions refused where small steps come near no singularity
    seconds: float  # of tracking alone


def random_motions(robot: ParallelRobot, count: int, seed: int = 0) -> Iterator[Motion]:
    """Straight and curved by turns; half of them begin at the reference."""
    rng = np.random.default_rng(seed)
    size = robot.platform_scale
    for k in range(count):
        reach = rng.uniform(0.02, FARTHEST) * size
        start = robot.reference.x + (k // 2 % 2) * 0.5 * reach * rng.uniform(-1, 1, robot.n)
        bends = rng.uniform(-1, 1, (3, robot.n)) * reach * [[1.0], [k % 2], [k % 2]]
        yield Motion(np.vstack([start, bends]), rng.uniform(-0.95, 0.95))


def evidence(name: str, count: int, *, seed: int = 0) -> Evidence:
    """Random motions of one robot."""
    robot = robots.load(name)
    refused, off_branch, undecided, unexplained = Counter(), [], [], []
    followed, seconds = 0, 0.0
    motions = list(random_motions(robot, count, seed))
    for first in range(0, count, STACK):
        stack = range(first, min(first + STACK, count))
        tracked, stopped = {}, {}
        begun = time.process_time()
        for k in stack:
            try:
                tracked[k] = track_path(robot, motions[k]).close(PLACES).q
            except NoAnswer as refusal:
                refused[type(refusal).__name__] += 1
                stopped[k] = refusal
        seconds += time.process_time() - begun
        followed += len(tracked)
        off, unsure = _off_branch(robot, motions, tracked)
        off_branch, undecided = off_branch + off, undecided + unsure
        unexplained += _unexplained(robot, motions, stopped)
    return Evidence(name, count, followed, refused, off_branch, undecided, unexplained, seconds)


def _off_branch(
    robot: ParallelRobot, motions: list[Motion], tracked: dict[int, np.ndarray]
) -> tuple[list, list]:
    """Motions that small steps do not follow, and those undecided with their least singular values."""

    def along(numbers: list[int], steps: int, closings: int) -> tuple[np.ndarray, np.ndarray]:
        """The whole way of some motions, and their configurations at the places."""
        courses = np.stack([_course(robot, motions[k], steps) for k in numbers])
        passed = in_small_steps(robot, courses, closings)
        return passed, passed[:, -steps - 1 :: steps // (len(PLACES) - 1)]

    def same(q: np.ndarray, other: np.ndarray) -> bool:
        return bool(np.abs((q - other) / robot.column_scale).max() < SAME)

    numbers = list(tracked)
    for steps in SMALL_STEPS[:-1]:
        if numbers:
            _, there = along(numbers, steps, 2)
            numbers = [k for k, q in zip(numbers, there, strict=True) if not same(q, tracked[k])]
    off, undecided = [], []
    for k in numbers:
        _, [coarse] = along([k], SMALL_STEPS[-2], CLOSINGS)
        [passed], [fine] = along([k], SMALL_STEPS[-1], CLOSINGS)
        if not same(fine, coarse):
            undecided.append((k, float(_least(robot, passed).min())))
        elif not same(fine, tracked[k]):
            off.append(k)
    return off, undecided


def _unexplained(robot: ParallelRobot, motions: list[Motion], stopped: dict[int, NoAnswer]) -> list[int]:
    """Which motions were refused where small steps come near no singularity."""
    numbers = list(stopped)
    usual = _least(robot, robot.reference.q[None])[0]
    for steps in SMALL_STEPS:
        if numbers:
            courses = np.stack([_course(robot, motions[k], steps, stopped[k]) for k in numbers])
            least = _least(robot, in_small_steps(robot, courses)[:, -1])
            numbers = [k for k, value in zip(numbers, least, strict=True) if not value < NEAR * usual]
    return numbers


def _course(robot: ParallelRobot, motion: Motion, steps: int, end: NoAnswer | None = None) -> np.ndarray:
    """Platform coordinates from the reference to where a motion begins and along it, up to where it ended."""
    reference, begin = robot.reference.x, motion(0.0)
    first = np.linspace(0.0, 1.0, steps // 4 + 1)[:, None]
    last = np.linspace(0.0, 1.0, steps + 1)
    if end is None:
        return np.concatenate([reference + first * (begin - reference), motion(last)])
    last = end.s * np.minimum(last * (steps + 1) / (steps - 7), 1.0)  # eight times on the end, to close there
    if "the way from the reference" in str(end):
        return np.concatenate([reference + 0 * first, reference + last[:, None] * (begin - reference)])
    return np.concatenate([reference + first * (begin - reference), motion(last)])


def in_small_steps(robot: ParallelRobot, courses: np.ndarray, closings: int = 2) -> np.ndarray:
    """Configurations (T, K, nq) at platform coordinates (T, K, n) in small steps from the reference.

    Each is closed by at most so many steps of Newton's method.
    """
    q = np.repeat(robot.reference.q[None], len(courses), axis=0)
    passed = np.empty((*courses.shape[:2], q.shape[1]))
    moved = np.zeros((len(q), robot.model.nv))
    for k in range(courses.shape[1]):
        for _ in range(closings):
            linearised = linearised_at(robot, q, courses[:, k])
            moved[:, robot.moving] = -solve(linearised.jacobian[:, :, robot.moving], linearised.residual)
            q = integrate(robot, q, moved)
            if np.abs(moved / robot.column_scale).max() < CLOSED:
                break
        passed[:, k] = q
    return passed


def _least(robot: ParallelRobot, q: np.ndarray) -> np.ndarray:
    """Least singular values (T,) of the equations along the joints that move, without dimension."""
    return np.linalg.svd(type1_matrix(robot, linearised_at(robot, q, None)), compute_uv=False)[:, -1]


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", default=list(robots.CATALOGUE))
    parser.add_argument("--motions", type=int, default=5_000)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    heads = ("motions", "followed", "off", "undecided", "no cause", "ms each")
    print(f"{'robot':20}" + "".join(f"{head:>10}" for head in heads) + "  refused")
    with ProcessPoolExecutor(options.processes) as pool:
        for found in pool.map(partial(evidence, count=options.motions, seed=options.seed), options.robots):
            refused = ", ".join(f"{count} {kind}" for kind, count in found.refused.items()) or "none"
            print(
                f"{found.name:20}{found.motions:10}{found.followed:10}{len(found.off_branch):10}"
                f"{len(found.undecided):10}{len(found.unexplained):10}"
                f"{1e3 * found.seconds / found.motions:10.1f}  {refused}",
                *(f"    off the branch: {found.off_branch[:9]}",) * bool(found.off_branch),
                *(f"    undecided: {found.undecided[:9]}",) * bool(found.undecided),
                *(f"    without a cause: {found.unexplained[:9]}",) * bool(found.unexplained),
                sep="\n",
                flush=True,
            )


if __name__ == "__main__":
    main()
