"""A path with one branch of its inverse kinematics, and continuations through singular points.

Newton's method converges to the branch from a guess: Chebyshev series through closed poses. It fails where
the square system of the inverse kinematics is singular although the branch is smooth, as at constraint
singularities. There a continuation replaces Newton's method: a polynomial through closed configurations on
both sides.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.polynomial import chebyshev

from framework.errors import NotAssembled
from framework.kinematics.continuation.path_sheet import SHEET_NODES, BranchPoses
from framework.kinematics.external_wrenches import NO_WRENCHES, ExternalWrenches
from framework.kinematics.frames import difference, difference_rates, integrate, largest_motion
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.linearised_loops import LinearisedLoops, linearised_at, type1_matrix
from framework.kinematics.motion_rates import Motion
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.path import Path
from framework.numerics.arrays import Array, ArrayLike, BoolArray, IntArray, ReadOnlyArrays, freeze, read_only
from framework.numerics.chebyshev import TimeFunction, coefficients, evaluate, nodes, tail
from framework.numerics.ordered_sums import least_singular_values
from framework.tolerances import CONTINUATION_ERROR, CONTINUATION_STEP, SAME_PLACE

CONTINUATION_NODES, CONTINUATION_DEGREE = 48, 24  # nodes of a continuation, degree of its polynomial
# as many nodes as coefficients, plus an eighth of all nodes, whose misfit measures the error of the fit
MIN_SOUND_NODES = CONTINUATION_DEGREE + 1 + CONTINUATION_NODES // 8
# Newton's method is trusted at nodes whose least singular value is above this share of its maximum over all
# nodes.
SOUND_NODE_RATIO = 0.03


@dataclass(frozen=True, eq=False)
class Continuation(ReadOnlyArrays):
    """The branch between two path coordinates as a Chebyshev series."""

    start: float  # s
    end: float
    core: tuple[float, float]  # interval of s in which Newton's method fails
    series: Array  # (degree + 1, nv) Chebyshev coefficients of the offset from the branch's origin
    error: float  # estimated error of the series [rad, lengths]

    def offset(self, s: Array) -> Array:
        """Compute the offset (T, nv) from the branch's origin at s (T,)."""
        return _chebyshev_values(self.series, (self.start, self.end), s)


def _chebyshev_values(series: Array, interval: Iterable[float], s: Array) -> Array:
    """Evaluate a series (degree + 1, nv) on an interval at s (T,), also outside: (T, nv)."""
    start, end = interval
    local = (2 * s - start - end) / (end - start)
    values = evaluate(local.clip(-1.0, 1.0), series)
    (beyond,) = (np.abs(local) > 1.0 + SAME_PLACE).nonzero()
    if len(beyond):
        values[beyond] = chebyshev.chebval(local[beyond], series).T
    return values


@dataclass(frozen=True, eq=False)
class Branch(ReadOnlyArrays):
    """A path with the branch of its inverse kinematics, springs at rest, and the external wrenches.

    Guesses for the offset from `origin` are the series through the closed nodes of the panels. Where the
    branch was followed in single steps, they are cubics between these. From the guesses Newton's method
    converges to the branch: the poses of `close` are on the branch to rounding.
    """

    robot: ParallelRobot
    path: Path
    origin: Array  # (nq,) configuration at s = 0
    s: Array  # (K,) path coordinates of the poses that were followed
    series: TimeFunction  # (nv) offset from origin over s
    panels: tuple[BranchPoses, ...]  # closed at Chebyshev nodes, ascending from s = 0
    continuations: tuple[Continuation, ...] = ()  # where two overlap, the later one applies
    wrenches: ExternalWrenches = NO_WRENCHES

    @staticmethod
    def through(
        robot: ParallelRobot, path: Path, panels: Sequence[BranchPoses], steps: Sequence[BranchPoses]
    ) -> Branch:
        """Return the branch through the poses of `panels` from s = 0 on, then of `steps`, K = 1 each."""
        origin = read_only((*panels, *steps)[0].q[0])
        freeze(tuple(panels))
        series = [coefficients(difference(robot, origin, panel.q)) for panel in panels]
        # Chebyshev coefficients of the cubic with values u_0, u_1 and slopes v_0, v_1 at -1 and 1:
        # u = c_0 + c_1 t + c_2 (2 t^2 - 1) + c_3 (4 t^3 - 3 t)
        hermite = np.array([[8, 8, 2, -2], [-9, 9, -1, -1], [0, 0, -2, 2], [1, -1, 1, 1]]) / 16.0
        for start, end in pairwise(steps):
            half_width = 0.5 * float(end.s[0] - start.s[0])  # slopes are over the local coordinate
            u_0, u_1 = (difference(robot, origin, pose.q)[0] for pose in (start, end))  # (nv,) each
            v_0, v_1 = (
                half_width * difference_rates(robot, origin, pose.q, pose.rate)[0] for pose in (start, end)
            )
            cubic = np.zeros((SHEET_NODES, robot.nv))
            cubic[:4] = hermite @ np.array([u_0, u_1, v_0, v_1])
            series.append(cubic)
        s = np.concatenate([np.zeros(1), *(panel.s[1:] for panel in panels), *(pose.s for pose in steps[1:])])
        edges = np.array([0.0, *(panel.s[-1] for panel in panels), *(pose.s[0] for pose in steps[1:])])
        return Branch(robot, path, origin, s, TimeFunction(edges, np.stack(series)), tuple(panels))

    @cached_property
    def knots(self) -> Array:
        """Path coordinates (k,) between which path and wrenches are smooth."""
        if not self.wrenches.entries:
            return np.asarray(self.path.knots)
        return np.unique(np.concatenate([self.path.knots, self.wrenches.knots]))

    def with_wrenches(self, wrenches: ExternalWrenches) -> Branch:
        """Return the same branch under external wrenches.

        Raises:
            InvalidInput: the robot has no frame of the name of a wrench.
        """
        wrenches.check_frames(self.robot)
        return replace(self, wrenches=wrenches) if wrenches.entries else self

    def load_motion(self, motion: Motion, s: Array) -> Motion:
        """Return a motion of the robot at s (T,) under the external wrenches."""
        return motion.with_wrenches(self.wrenches.evaluate(self.robot, motion.linearised.frames, s))

    def guess(self, s: Array) -> Array:
        """Compute guesses (T, nq) at s (T,), from which Newton's method converges to the branch."""
        edges = self.series.edges
        panel = edges[1:-1].searchsorted(s, side="right")  # (T,) of each s; beyond the ends the nearest one
        u = np.empty((len(s), self.robot.nv))
        for p in set(panel.tolist()):
            inside = panel == p
            u[inside] = _chebyshev_values(self.series.coefficients[p], edges[p : p + 2], s[inside])
        for continuation in self.continuations:
            covered = (s >= continuation.start) & (s <= continuation.end)
            u[covered] = continuation.offset(s[covered])
        return integrate(self.robot, self.origin, u)

    def close(self, s: ArrayLike) -> LinearisedLoops:
        """Compute assembled configurations on the branch at s (T,).

        In the core of a continuation Newton's method fails; the guesses, accurate to rounding, are returned.

        Raises:
            NotAssembled: Newton's method does not converge to the branch, for instance near a singularity of
                the inverse kinematics without a continuation.
        """
        s = np.atleast_1d(np.asarray(s, dtype=float))
        x, guess = self.path(s), self.guess(s)
        in_core = self.is_continued(s)
        if not in_core.any():
            return close_loops(self.robot, x, guess)
        q = guess.copy()
        if not in_core.all():
            q[~in_core] = close_loops(self.robot, x[~in_core], guess[~in_core]).q
        return linearised_at(self.robot, q, x)

    def is_continued(self, s: Array) -> BoolArray:
        """Return whether each s (T,) lies in the core of a continuation, (T,)."""
        inside = np.zeros(len(s), dtype=bool)
        for continuation in self.continuations:
            inside |= (s >= continuation.core[0]) & (s <= continuation.core[1])
        return inside


def with_continuation(branch: Branch, s: float) -> Branch | None:
    """Return the branch with a continuation about s; None if the branch is not smooth at s.

    Continuations are tried from wide to narrow, within the smooth piece of the path that contains s. One that
    is not accurate enough still gives the guesses for the next, narrower one. The result has only the last
    one besides the continuations of `branch`.
    """
    # in s, of a continuation; the first accurate one is used
    half_widths = (0.16, 0.08, 0.04, 0.02, 0.01, 0.005)
    piece = np.searchsorted(branch.path.knots, s, side="right")  # index of the smooth piece
    lowest, highest = [0.0, *branch.path.knots, 1.0][piece : piece + 2]
    guesses = branch  # the branch with the continuation that was fitted last
    for half_width in half_widths:
        start, end = np.clip([s - half_width, s + half_width], lowest, highest).tolist()
        continuation = _fit_continuation(guesses, s, start, end)
        if continuation is None:
            continue
        guesses = replace(branch, continuations=(*branch.continuations, continuation))
        if continuation.error < CONTINUATION_ERROR:
            return guesses
    return None


def _fit_continuation(branch: Branch, s: float, start: float, end: float) -> Continuation | None:
    """Fit a continuation about s between start and end, in s; None if too few nodes are sound.

    A node is sound if Newton's method is trusted there, by `_trusted_offsets`. The series is fitted to the
    closed configurations at the sound nodes. The error is the largest of misfit, residual and truncation
    error.
    """
    robot = branch.robot
    units = robot.column_scale  # (nv,) by which offsets become dimensionless: [m] of slides, 1 of turns
    s_nodes = start + 0.5 * (end - start) * (nodes(CONTINUATION_NODES) + 1.0)  # (nodes,)
    basis = chebyshev.chebvander(nodes(CONTINUATION_NODES), CONTINUATION_DEGREE)  # (nodes, degree + 1)
    sound, offsets = _trusted_offsets(branch, s_nodes)  # (k,) indices, (k, nv)
    if len(sound) < MIN_SOUND_NODES:
        return None
    # (degree + 1, nv) by least squares
    series = np.asarray(np.linalg.lstsq(basis[sound], offsets, rcond=None)[0], dtype=float)

    misfit = np.abs((basis[sound] @ series - offsets) / units).max()
    q = integrate(robot, branch.origin, basis @ series)
    residual = np.abs(linearised_at(robot, q, branch.path(s_nodes)).residual).max() / robot.length
    # `tail` is relative to the largest coefficient
    truncation = np.abs(series / units).max() * tail(series / units)
    error = float(max(misfit, residual, truncation))
    # the core leads from the last sound node below s and all unsound nodes to the first one above; without a
    # sound node on one side, to the last node there
    to_cover, s_sound = np.append(np.delete(s_nodes, sound), s), s_nodes[sound]
    core_start = float(s_sound[s_sound < to_cover.min()].max(initial=s_nodes[0]))
    core_end = float(s_sound[s_sound > to_cover.max()].min(initial=s_nodes[-1]))
    return Continuation(start, end, (core_start, core_end), series, error)


def _trusted_offsets(branch: Branch, s_nodes: Array) -> tuple[IntArray, Array]:
    """Find the nodes (k,) where Newton's method is trusted; return their offsets, too.

    At such a node the least singular value of the Type 1 matrix is above a share `SOUND_NODE_RATIO` of its
    maximum over all nodes, and the correction of the guess is small compared with this singular value.

    Args:
        s_nodes: path coordinates (nodes,) of all nodes.

    Returns:
        The nodes, and the offsets (k, nv) of their closed configurations from the branch's origin.
    """
    robot = branch.robot
    x, guess = branch.path(s_nodes), branch.guess(s_nodes)
    matrices = type1_matrix(robot, linearised_at(robot, guess, x))
    least = least_singular_values(matrices)  # (nodes,)
    sound = np.flatnonzero(least > SOUND_NODE_RATIO * least.max())
    try:
        closed = close_loops(robot, x[sound], guess[sound])
    except NotAssembled:
        return sound[:0], guess[:0]  # no node is trusted
    offsets = difference(robot, branch.origin, closed.q)
    corrections = largest_motion(robot, offsets - difference(robot, branch.origin, guess[sound]))
    trusted = corrections < CONTINUATION_STEP * least[sound]
    return sound[trusted], offsets[trusted]
