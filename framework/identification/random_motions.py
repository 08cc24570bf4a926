"""Random instants of a robot near its reference: poses, rates and accelerations that its loops allow."""

from __future__ import annotations

import numpy as np

from framework.arrays import Array
from framework.errors import NotAssembled
from framework.identification.torque_parameters import gravity_of
from framework.kinematics.assembly import MAX_NEWTON_STEP
from framework.kinematics.inverse_kinematics import close_each, close_loops, require_square
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.loop_matrices import clearance
from framework.kinematics.motion_rates import Motion, motion_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.tolerances import BRANCHES_MEET

STEP = 0.5  # [rad, robot lengths] that the platform moves in a step of a walk, at most
STEPS, MAX_STEPS = 16, 36  # of each walk; more, ever shorter ones, for walks that have not moved yet


def random_motion(robot: ParallelRobot, count: int, random: np.random.Generator) -> Motion:
    """Draw a motion at `count` random instants; inertia forces are of the size of the weight.

    Raises:
        InvalidInput: the platform does not determine the joints.
        NotAssembled: the loops close nowhere near the reference.
    """
    require_square(robot)
    poses = _random_poses(robot, count, random)
    rate = np.sqrt(gravity_of(robot) / robot.length)
    dx, ddx = (
        size * robot.platform_scale * random.standard_normal((count, robot.n)) for size in (rate, rate**2)
    )
    return motion_at(robot, close_loops(robot, poses[1], poses[0]), dx, ddx)


def _random_poses(robot: ParallelRobot, count: int, random: np.random.Generator) -> tuple[Array, Array]:
    """Draw assembled configurations (count, nq) and their platforms (count, n): walks from the reference.

    A step at whose end the loops do not close, or which leads to a singularity of them, is not taken.
    """
    q, x = (np.repeat(start[None], count, axis=0) for start in (robot.reference.q, robot.reference.x))
    moved = np.zeros(count, dtype=bool)
    for k in range(MAX_STEPS):
        step = STEP * robot.platform_scale * random.uniform(-1.0, 1.0, (count, robot.n))
        ahead = x + step * 0.5 ** max(k - STEPS, 0)
        closed = close_each(robot, ahead, q, farthest=MAX_NEWTON_STEP)
        taken = closed.closed.copy()
        if k >= STEPS:
            taken &= ~moved
        regular = linearised_at(robot, closed.q[taken], None)
        taken[taken] = clearance(robot, regular) > BRANCHES_MEET
        q[taken], x[taken] = closed.q[taken], ahead[taken]
        moved |= taken
        if k + 1 >= STEPS and moved.all():
            return q, x
    raise NotAssembled(
        f"{robot.name}: the loops close at no pose beside the reference",
        q=robot.reference.q,
        residual=robot.reference.residual,
    )
