"""The nearest pose found to a platform that may be out of reach, among poses joined to the reference.

One search ends where no neighbour is nearer (`PoseSearch`), and there may be several such places. So poses
are sampled once for a robot, on walks from the reference that turn at Type 1 and at the ends of ranges, and
searches start from the nearest of these.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from framework.atlas.sweep import PoseReason, step_poses
from framework.errors import finite_numbers
from framework.kinematics.continuation.pose_search import NearestPose, PoseSearch
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.kinematics.tree_model import shares_beyond_limits
from framework.numerics.arrays import Array, ArrayLike

WALKS, WALK_STEPS = 64, 60
MAX_WALK_STEP = 0.1  # [robot lengths, rad]
STARTS = 3  # of searches
START_DISTANCE = 0.2  # [robot lengths, rad] between starts


def nearest_pose(robot: ParallelRobot, x: ArrayLike) -> NearestPose:
    """Find a pose nearest to platform coordinates x (n,) within the joints' ranges.

    It is joined to the reference by steps within the ranges, on each of which every leg keeps its working
    mode. Type 2 singularities may lie between. It is the nearest of a few local searches, without a proof
    that none is nearer. The first call for a robot takes about a second, to sample the poses.

    Raises:
        InvalidInput: not n finite numbers; the platform does not determine the joints.
    """
    expect_robot(robot)
    target = finite_numbers(f"x ({', '.join(robot.axis_names)})", x, robot.n)
    search = PoseSearch(robot)
    q, sampled_x = _sample_poses(robot)
    starts = _choose_starts((sampled_x - target) / robot.platform_scale)
    ends: list[NearestPose] = []
    for k in starts:
        ends.append(search.find(q[k], sampled_x[k], target, earlier=ends))
        if not ends[-1].stops:
            break
    return min(ends, key=lambda pose: pose.distance)


def _choose_starts(offsets: Array) -> list[int]:
    """Return indices of the starts nearest to the target, some distance apart.

    Args:
        offsets: (S, n) of the starts from the target.
    """
    starts: list[int] = []
    distances = np.linalg.norm(offsets, axis=1)
    while len(starts) < STARTS and np.isfinite(distances).any():
        starts.append(int(np.argmin(distances)))
        apart = np.linalg.norm(offsets - offsets[starts[-1]], axis=1)
        distances[apart < START_DISTANCE] = np.inf
    return starts


@lru_cache(maxsize=8)
def _sample_poses(robot: ParallelRobot) -> tuple[Array, Array]:
    """Sample poses q (S, nq) at x (S, n), joined to the reference within ranges."""
    random = np.random.default_rng(0)
    q, x = (np.repeat(part[None], WALKS, axis=0) for part in (robot.reference.q, robot.reference.x))
    walked, direction, is_stopped = [(q[:1], x[:1])], np.zeros_like(x), np.ones((WALKS, 1), dtype=bool)
    for _ in range(WALK_STEPS):
        turned = random.standard_normal(x.shape)
        turned /= np.linalg.norm(turned, axis=1, keepdims=True)
        direction = np.where(is_stopped, turned, direction)
        length = MAX_WALK_STEP * random.random((WALKS, 1))
        target = x + direction * length * robot.platform_scale
        step = step_poses(robot, q, x, target)
        beyond = np.any(shares_beyond_limits(robot.limits, step.q) > 0.0, axis=1)
        is_stopped = ((step.reason != PoseReason.REACHED) | beyond)[:, None]
        q, x = np.where(is_stopped, q, step.q), np.where(is_stopped, x, target)
        walked.append((q[~is_stopped[:, 0]], x[~is_stopped[:, 0]]))
    sampled_q, sampled_x = (np.concatenate(part) for part in zip(*walked, strict=True))
    return sampled_q, sampled_x
