"""The pose nearest to a platform target that may be out of reach.

Only poses that are joined to the reference are considered. A search (`PoseSearch`) ends in a local minimum of
the distance, and there may be several. So poses are sampled once per robot, on random walks from the
reference, and searches start from the samples nearest to the target.
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

WALKS, WALK_STEPS = 64, 60  # random walks; steps of each
MAX_WALK_STEP = 0.1  # [robot lengths, rad]
STARTS = 3  # searches at most
START_DISTANCE = 0.2  # [robot lengths, rad] least distance between starts


def nearest_pose(robot: ParallelRobot, x: ArrayLike) -> NearestPose:
    """Find the pose nearest to platform coordinates x (n,) within the joints' ranges.

    The pose is joined to the reference by steps within the ranges, on which every leg keeps its working mode.
    The steps may cross Type 2 singularities. The pose is the best result of a few local searches, without a
    proof that no other pose is nearer. The first call for a robot samples poses, which takes about a second.

    Raises:
        InvalidInput: not n finite numbers; the platform does not determine the joints.
    """
    expect_robot(robot)
    target = finite_numbers(f"x ({', '.join(robot.axis_names)})", x, robot.n)
    search = PoseSearch(robot)
    sampled_q, sampled_x = _sample_poses(robot)
    ends: list[NearestPose] = []
    for k in _choose_starts((sampled_x - target) / robot.platform_scale):
        ends.append(search.find(sampled_q[k], sampled_x[k], target, earlier=ends))
        if not ends[-1].stops:  # the target is reached
            break
    return min(ends, key=lambda pose: pose.distance)


def _choose_starts(offsets: Array) -> list[int]:
    """Return indices of samples near the target, START_DISTANCE apart, nearest first.

    Args:
        offsets: (S, n) of the samples from the target [robot lengths, rad].
    """
    starts: list[int] = []
    distances = np.linalg.norm(offsets, axis=1)
    while len(starts) < STARTS and np.isfinite(distances).any():
        start = int(np.argmin(distances))
        starts.append(start)
        is_close = np.linalg.norm(offsets - offsets[start], axis=1) < START_DISTANCE
        distances[is_close] = np.inf
    return starts


@lru_cache(maxsize=8)
def _sample_poses(robot: ParallelRobot) -> tuple[Array, Array]:
    """Sample poses q (S, nq) at x (S, n), joined to the reference within ranges.

    Each random walk keeps its direction until a step is refused, at Type 1 or the end of a range. Then it
    continues in a new random direction.
    """
    random = np.random.default_rng(0)
    q = np.repeat(robot.reference.q[None], WALKS, axis=0)
    x = np.repeat(robot.reference.x[None], WALKS, axis=0)
    samples_q = [robot.reference.q[None]]
    samples_x = [robot.reference.x[None]]
    direction = np.zeros_like(x)
    accepted = np.zeros(WALKS, dtype=bool)  # the last step of each walk
    for _ in range(WALK_STEPS):
        new_direction = random.standard_normal(x.shape)
        new_direction /= np.linalg.norm(new_direction, axis=1, keepdims=True)
        direction[~accepted] = new_direction[~accepted]
        length = MAX_WALK_STEP * random.random((WALKS, 1))
        target = x + direction * length * robot.platform_scale
        step = step_poses(robot, q, x, target)
        beyond = np.any(shares_beyond_limits(robot.limits, step.q) > 0.0, axis=1)
        accepted = (step.reason == PoseReason.REACHED) & ~beyond
        q[accepted] = step.q[accepted]
        x[accepted] = target[accepted]
        samples_q.append(q[accepted])
        samples_x.append(x[accepted])
    return np.concatenate(samples_q), np.concatenate(samples_x)
