"""A path with one branch of the inverse kinematics along it, and continuations where that is singular.

Newton's method converges to the branch from the cubic between two knots, or from a series through closed
configurations. It fails where the square system of the inverse kinematics is singular although the branch is
smooth, as in constraint singularities. There the branch is a continuation: a polynomial through closed
configurations on either side.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from framework.errors import NotAssembled
from framework.kinematics.external_wrenches import NO_WRENCHES, ExternalWrenches
from framework.kinematics.frames import difference, integrate, largest_motion
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.linearised_loops import ClosedStack, linearised_at
from framework.kinematics.loop_matrices import type1_matrix
from framework.kinematics.motion_rates import Motion
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.path import Path
from framework.numerics.arrays import Array, ArrayLike, IntArray, ReadOnlyArrays
from framework.numerics.chebyshev import TimeFunction, TimeGrid, nodes, tail
from framework.numerics.ordered_sums import singular_values
from framework.tolerances import BRANCH_CORRECTION, CONTINUATION_ERROR, CONTINUATION_STEP

HALF_WIDTHS = (0.16, 0.08, 0.04, 0.02, 0.01, 0.005)  # of a continuation, in s; the first that resolves
CONTINUATION_NODES, CONTINUATION_DEGREE = 48, 24  # nodes of a continuation, degree of its polynomial
# as many as coefficients, and an eighth of the nodes more, which show a misfit
MIN_SOUND_NODES = CONTINUATION_DEGREE + 1 + CONTINUATION_NODES // 8
# Newton's method is trusted at nodes where the least singular value is above this share of its largest:
# first far from the singular place, then, from the polynomial found there, close to it.
SOUND_NODE_RATIOS = (0.2, 0.03)


@dataclass(frozen=True, eq=False)
class Continuation(ReadOnlyArrays):
    """The branch between `start` and `end` as Chebyshev series; Newton's method fails in the `core`."""

    start: float
    end: float
    core: tuple[float, float]
    series: Array  # (DEGREE + 1, nv) of the offset from the branch's origin

    def offset(self, s: Array) -> Array:
        """Compute the offset (T, nv) from the branch's origin."""
        return _chebyshev_values(self.series, self.start, self.end, s)


def _chebyshev_values(series: Array, start: float, end: float, s: Array) -> Array:
    """Compute a series (degree + 1, nv) on [start, end] at s (T,), inside or beyond, (T, nv)."""
    local = (2 * s - start - end) / (end - start)
    return np.asarray(chebyshev.chebval(local, series), dtype=float).T


@dataclass(frozen=True, eq=False)
class Branch(ReadOnlyArrays):
    """A path with the branch of its inverse kinematics, springs at rest, and the world's wrenches.

    Between the knots `s` (K,) a guess, by the cubic in the offset `u` from `origin` or by the series of
    `through`, is near enough for Newton's method to converge to the branch: `close` returns it to rounding.
    """

    robot: ParallelRobot
    path: Path
    origin: Array  # (nq,)
    s: Array  # (K,)
    u: Array  # (K, nv) offset from origin
    du: Array  # (K, nv) derivative with respect to s
    continuations: tuple[Continuation, ...] = ()  # where two overlap the later one holds
    wrenches: ExternalWrenches = NO_WRENCHES
    series: TimeFunction | None = None  # of u in s: better guesses, see `through`

    @property
    def knots(self) -> Array:
        """The path coordinates (k,) between which path and wrenches are smooth."""
        if not self.wrenches.entries:
            return self.path.knots
        return np.unique(np.concatenate([self.path.knots, self.wrenches.knots]))

    def with_wrenches(self, wrenches: ExternalWrenches) -> Branch:
        """Return the same branch under wrenches of the world.

        Raises:
            InvalidInput: the robot has no such frame.
        """
        wrenches.check_frames(self.robot)
        return replace(self, wrenches=wrenches) if wrenches.entries else self

    def through(self, edges: Array, q: Array) -> Branch:
        """Return the same branch with a Chebyshev series through configurations q as its guess.

        A series whose error at a knot is more than a correction does not resolve all joints and is not used.

        Args:
            edges: (panels + 1,) of s, from 0 to 1.
            q: (panels * size, nq) on the nodes between them, see `TimeGrid`.
        """
        grid = TimeGrid(edges, len(q) // (len(edges) - 1))
        series = grid.fit(difference(self.robot, self.origin, q))
        error = np.abs((series(self.s) - self.u) / self.robot.column_scale).max()
        return replace(self, series=series) if error < BRANCH_CORRECTION else self

    def load_motion(self, motion: Motion, s: Array) -> Motion:
        """Return a motion of the robot at s (T,) under the wrenches of the world."""
        return motion.with_wrenches(self.wrenches.evaluate(self.robot, motion.linearised.frames, s))

    def guess(self, s: Array) -> Array:
        """Compute configurations (T, nq) near the branch at s (T,), from which Newton's method converges."""
        u = self._cubic_offsets(s) if self.series is None else self._series_offsets(self.series, s)
        for continuation in self.continuations:
            covered = (s >= continuation.start) & (s <= continuation.end)
            u[covered] = continuation.offset(s[covered])
        return integrate(self.robot, self.origin, u)

    @staticmethod
    def _series_offsets(series: TimeFunction, s: Array) -> Array:
        """Compute offsets (T, nv) from the origin at s (T,) by the series, extrapolated beyond [0, 1]."""
        u = series(np.clip(s, 0.0, 1.0))
        for panel, is_outside in ((0, s < 0.0), (-1, s > 1.0)):
            if is_outside.any():
                start, end = series.edges[:-1][panel], series.edges[1:][panel]
                u[is_outside] = _chebyshev_values(series.coefficients[panel], start, end, s[is_outside])
        return u

    def _cubic_offsets(self, s: Array) -> Array:
        """Compute offsets (T, nv) from the origin at s (T,) by cubic Hermite interpolation of the knots."""
        # k: the last knot not beyond each s
        k = np.searchsorted(self.s[1:-1], s, side="right")
        step = (self.s[k + 1] - self.s[k])[:, None]
        t = (s - self.s[k])[:, None] / step  # (T, 1) from 0 to 1 between the knots
        start = (1 + 2 * t) * (1 - t) ** 2 * self.u[k] + t * (1 - t) ** 2 * step * self.du[k]
        end = t**2 * (3 - 2 * t) * self.u[k + 1] + t**2 * (t - 1) * step * self.du[k + 1]
        return start + end

    def close(self, s: ArrayLike) -> ClosedStack:
        """Return assembled configurations on the branch at s (T,).

        Raises:
            NotAssembled: Newton's method does not converge to the branch, as near a singularity of the
                inverse kinematics without a continuation.
        """
        s = np.atleast_1d(np.asarray(s, dtype=float))
        x, guess = self.path(s), self.guess(s)
        in_core = self.is_continued(s)
        if not in_core.any():
            return close_loops(self.robot, x, guess)
        q = guess.copy()
        if not in_core.all():
            q[~in_core] = close_loops(self.robot, x[~in_core], guess[~in_core]).q
        return ClosedStack(q, x, linearised_at(self.robot, q, x))

    def is_continued(self, s: Array) -> NDArray[np.bool_]:
        """Whether the branch at s (T,) lies in the core of a continuation."""
        inside = np.zeros(len(s), dtype=bool)
        for continuation in self.continuations:
            inside |= (s >= continuation.core[0]) & (s <= continuation.core[1])
        return inside


def with_continuation(branch: Branch, s: float) -> Branch | None:
    """Return the branch with a continuation near s; None where not smooth.

    Continuations are tried from wide to narrow, within the smooth piece of the path about s. The polynomial
    of a wider one, though it is not good enough, is the guess for a narrower one.
    """
    piece = np.searchsorted(branch.path.knots, s, side="right")
    lowest, highest = np.concatenate(([0.0], branch.path.knots, [1.0]))[piece : piece + 2].tolist()
    guessed = branch
    for half_width in HALF_WIDTHS:
        start, end = max(s - half_width, lowest), min(s + half_width, highest)
        continuation, error = _fit_continuation(guessed, s, start, end)
        if continuation is None:
            continue
        continued = replace(branch, continuations=(*branch.continuations, continuation))
        if error < CONTINUATION_ERROR:
            return continued
        guessed = continued
    return None


def _fit_continuation(
    branch: Branch, s: float, start: float, end: float
) -> tuple[Continuation | None, float]:
    """Fit a continuation about s between start and end; return its error too [rad, lengths].

    The series is fitted to closed configurations at sound nodes: first those far from the singularity, then
    also those nearer, with its values as guesses. The error is the largest of misfit, residual and truncation
    error. Without enough sound nodes there is no continuation.
    """
    robot, lengths = branch.robot, branch.robot.column_scale
    parameters = start + 0.5 * (end - start) * (nodes(CONTINUATION_NODES) + 1.0)
    basis = chebyshev.chebvander(nodes(CONTINUATION_NODES), CONTINUATION_DEGREE)
    x, guess = branch.path(parameters), branch.guess(parameters)
    continuation, error = None, np.inf
    for share in SOUND_NODE_RATIOS:
        sound, u = _trusted_offsets(branch, guess, x, share)
        if len(sound) < MIN_SOUND_NODES:
            break
        series = np.asarray(np.linalg.lstsq(basis[sound], u, rcond=None)[0], dtype=float)
        continuation = Continuation(start, end, _core_interval(parameters, sound, s), series)
        guess = integrate(robot, branch.origin, basis @ series)
        misfit = float(np.abs((basis[sound] @ series - u) / lengths).max())
        residual = float(np.abs(linearised_at(robot, guess, x).residual).max()) / robot.length
        truncation = float(np.abs(series / lengths).max()) * tail(series / lengths)
        error = max(misfit, residual, truncation)
    return continuation, error


def _trusted_offsets(branch: Branch, guess: Array, x: Array, share: float) -> tuple[IntArray, Array]:
    """Find the nodes (k,) at which Newton's method is trusted, with offsets (k, nv) from the origin.

    There the least singular value of the Type 1 matrix is above a share of the largest one of all nodes, and
    the whole correction of the guess is small against this value.

    Args:
        guess: configurations (nodes, nq), corrected here.
        x: (nodes, n) of the platform.
    """
    robot = branch.robot
    matrices = type1_matrix(robot, linearised_at(robot, guess, x))
    least = singular_values(matrices)[:, -1]  # (nodes,)
    sound = np.flatnonzero(least > share * least.max())
    try:
        closed = close_loops(robot, x[sound], guess[sound])
    except NotAssembled:
        return sound[:0], guess[:0]
    u = difference(robot, branch.origin, closed.q)
    steps = largest_motion(robot, u - difference(robot, branch.origin, guess[sound]))
    trusted = steps < CONTINUATION_STEP * least[sound]
    return sound[trusted], u[trusted]


def _core_interval(parameters: Array, sound: IntArray, s: float) -> tuple[float, float]:
    """Return the least interval between nodes `sound` (k,) that contains s and all other nodes."""
    to_cover = np.append(np.delete(parameters, sound), s)
    sound_nodes = parameters[sound]  # ascending
    below = sound_nodes[sound_nodes < to_cover.min()]
    above = sound_nodes[sound_nodes > to_cover.max()]
    start = below[-1] if len(below) else parameters[0]
    end = above[0] if len(above) else parameters[-1]
    return float(start), float(end)
