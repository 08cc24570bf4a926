"""The branch along a path as a sheet: panels of Chebyshev nodes in s, each closed as one stack.

A panel counts if the loops close at all its nodes, if each step from node to node passes the tests of
`predictor_corrector` and stays in the working mode, and if the series through the nodes has decayed. It
begins at the last pose of the panel before. A panel that does not count is halved.

Why the nodes are on one branch: the series through them is a continuous curve, which misses closed loops by
no more than its truncation error. A jump from one branch to another between two nodes is a kink of this
curve, which leaves coefficients of its own size among the last ones. Branches that are nearer to one another
than the truncation error meet there, and then a leg changes its mode.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from framework.errors import NotAssembled
from framework.kinematics.continuation.predictor_corrector import accept_steps
from framework.kinematics.frames import difference, integrate
from framework.kinematics.inverse_kinematics import close_each, close_in_place
from framework.kinematics.linearised_loops import LinearisedLoops
from framework.kinematics.modes import keeps_working_mode
from framework.kinematics.motion_rates import joint_rates
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.path import Path
from framework.numerics.arrays import Array, BoolArray
from framework.numerics.chebyshev import coefficients, nodes
from framework.tolerances import SAME_PLACE, SHEET_TAIL

# nodes of a panel; an even number, so that none is in the middle, where crossings often are
SHEET_NODES = 32
COARSE_NODES = 9  # first nodes of a panel, from whose polynomial the others are closed
COARSE_STEP = 1e-2  # [rad, lengths] last Newton step at these; it leaves an error of about its square
MAX_STEPS = 5  # of Newton's method; a panel that needs more is halved
MIN_SHEET_PANEL = 1 / 32  # width in s; where this is too wide, the branch is followed step by step


class BranchPoses(NamedTuple):
    """K assembled configurations of a branch, with their tangents."""

    s: Array  # (K,) path coordinates
    linearised: LinearisedLoops  # at these poses
    rate: Array  # (K, nv) dq/ds

    @property
    def q(self) -> Array:
        """Configurations (K, nq)."""
        return self.linearised.frames.q

    @property
    def last(self) -> BranchPoses:
        """The last pose (K = 1)."""
        return BranchPoses(self.s[-1:], self.linearised.select(slice(-1, None)), self.rate[-1:])


def panel_nodes(start: float, end: float, size: int = SHEET_NODES) -> Array:
    """Return the Chebyshev nodes (size,) of a panel from `start` to `end`, all in s."""
    s = start + 0.5 * (end - start) * (nodes(size) + 1.0)
    s[-1] = end  # to the last bit
    return s


def with_tangents(robot: ParallelRobot, path: Path, s: Array, linearised: LinearisedLoops) -> BranchPoses:
    """Compute the tangents dq/ds (K, nv) at K poses, with constant deflections.

    Args:
        s: path coordinates (K,) of the poses. At a knot the slope is that of the piece with the other poses.
        linearised: the loops at the poses.

    Raises:
        NotAssembled: a pose is singular to the last bit and has no tangent.
    """
    rim = SAME_PLACE * (s[-1] - s[0])
    inside = s.clip(s[0] + rim, s[-1] - rim)
    twist, _ = robot.platform.twist(path(s), path(inside, 1))
    return BranchPoses(s, linearised, joint_rates(robot, linearised, twist))


def follow_panels(robot: ParallelRobot, path: Path, pose: LinearisedLoops) -> list[BranchPoses]:
    """Follow the path from a pose (T = 1) at s = 0, or near it, on panels, as far as none must be too narrow.

    Springs keep their deflections.

    Returns:
        Successive panels of SHEET_NODES poses each; the last one ends at s = 1 if the path was followed.
    """
    panels = list[BranchPoses]()
    waiting = list(pairwise([0.0, *path.knots, 1.0]))[::-1]  # starts and ends in s, the first panel on top
    while waiting:
        first, end = waiting.pop()
        closed = _close_panel(robot, path, pose, first, end)
        if closed is not None and _is_one_branch(robot, pose, *closed):
            panels.append(closed[0])
            pose = closed[0].linearised.select(-1)
            continue
        if end - first <= MIN_SHEET_PANEL:
            break
        middle = 0.5 * (first + end)
        waiting += [(middle, end), (first, middle)]
    return panels


def _close_panel(
    robot: ParallelRobot, path: Path, pose: LinearisedLoops, start: float, end: float
) -> tuple[BranchPoses, Array] | None:
    """Close the loops at the nodes of a panel that begins at a pose (T = 1); None if some do not close.

    A Newton step from the pose, whose equations are factored, gives the guesses for the coarse nodes. Their
    polynomial gives those for all nodes.

    Returns:
        The panel; the Newton step (nv,) from the pose to its first node.
    """
    try:
        q = pose.frames.q  # (1, nq)
        coarse_x = path(panel_nodes(start, end, COARSE_NODES))
        pose_of_each = pose.frames.select(np.zeros(COARSE_NODES, dtype=np.intp))
        platform_step = -robot.platform.residual(pose_of_each, coarse_x)  # (COARSE_NODES, n)
        step = joint_rates(robot, pose, platform_step[:, None])[:, 0]  # (COARSE_NODES, nv)
        coarse_q = integrate(robot, q, step)  # (COARSE_NODES, nq)
        coarse = close_in_place(robot, coarse_x, coarse_q, iterations=MAX_STEPS, enough=COARSE_STEP)
        if sum(len(last.instants) for last in coarse) < COARSE_NODES:
            return None
        offsets = _from_coarse_nodes() @ difference(robot, q, coarse_q)  # (SHEET_NODES, nv)
        s = panel_nodes(start, end)
        closing = close_each(robot, path(s), integrate(robot, q, offsets), iterations=MAX_STEPS)
        if not closing.closed.all():
            return None
        return with_tangents(robot, path, s, closing.linearised), step[0]
    except NotAssembled:  # a pose is singular to the last bit
        return None


@lru_cache(maxsize=1)
def _from_coarse_nodes() -> Array:
    """Return the matrix (SHEET_NODES, COARSE_NODES) that interpolates values at the coarse nodes."""
    polynomials = chebyshev.chebvander(nodes(SHEET_NODES), COARSE_NODES - 1)
    return np.asarray(polynomials @ coefficients(np.eye(COARSE_NODES)), dtype=float)


def _is_one_branch(
    robot: ParallelRobot, pose: LinearisedLoops, panel: BranchPoses, first_step: Array
) -> bool:
    """Return whether a panel begins a Newton step from a pose (T = 1), continues its branch, and resolves it.

    Args:
        first_step: (nv,) from the pose to the panel's first node; rounding if the pose is on the path.
    """
    units = robot.column_scale  # (nv,) by which offsets become dimensionless
    offsets = difference(robot, pose.frames.q, panel.q) / units  # (SHEET_NODES, nv)
    series = coefficients(offsets)
    truncation = np.abs(series[-SHEET_NODES // 8 :]).max()
    if np.abs(offsets[0] - first_step / units).max() > SAME_PLACE or truncation > SHEET_TAIL:
        return False
    keeps_branch, _ = judge_steps(robot, panel)
    return bool(keeps_branch.all())


def judge_steps(robot: ParallelRobot, *stacks: BranchPoses) -> tuple[BoolArray, Array]:
    """Judge the T steps between 1 + T successive poses, in one stack or in stacks of one pose each.

    Returns:
        Whether each step stays on its branch (T,); the corrections (T,) [rad, lengths] of its prediction.
    """
    q, rate = (np.concatenate([getattr(stack, name) for stack in stacks]) for name in ("q", "rate"))
    steps = np.diff(np.concatenate([stack.s for stack in stacks]))[:, None]  # (T, 1) in s
    predicted = steps * rate[:-1]

    return accept_steps(
        robot,
        difference(robot, integrate(robot, q[:-1], predicted), q[1:]),
        predicted,
        steps * rate[1:],
        keeps_mode=keeps_working_mode(robot, *(stack.linearised for stack in stacks)),
        ends=stacks[-1].linearised.select(slice(1, None) if len(stacks) == 1 else slice(None)),
    )
