"""What spins idly between two balls, brought to an angle that depends on the pose alone.

Planning holds the rate of such a spin at zero about axes that move along. The angle that this comes to
depends on the way there, steps of Newton's method included, and so is no smooth function of time to the last
digits. Where configurations are to be interpolated, each has the angle whose rotation vector from the start
of the branch has no component along the axis: no force feels the difference, as no centre of mass moves.
"""

from __future__ import annotations

import numpy as np

from framework.arrays import Array, IntArray
from framework.kinematics.frames import difference, difference_rates, integrate
from framework.kinematics.inverse_kinematics import close_loops, system_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import is_ball

LEFT = 1e-15  # [rad] of the component
STEPS, LONGEST = 20, 1.0  # Newton steps towards it, [rad] that one may turn


def idle_balls(robot: ParallelRobot) -> IntArray:
    """Entries of the velocity vector that are idle and belong to balls."""
    own = [range(joint.idx_v, joint.idx_v + 3) for joint in robot.model.joints[1:] if is_ball(joint)]
    return np.intersect1d(robot.idle, [column for columns in own for column in columns]).astype(np.intp)


def without_spin(robot: ParallelRobot, origin: Array, q: Array, x: Array) -> Array:
    """Configurations (T, nq) at x (T, n) as those given, whose offset from `origin` (nq,) has no idle spin.

    Raises:
        NotAssembled: one of them is on a singularity of the inverse kinematics.
    """
    idle = idle_balls(robot)
    for _ in range(STEPS if len(idle) and len(q) else 0):
        spin = difference(robot, origin, q)[:, idle]
        if np.abs(spin).max() <= LEFT:
            break
        jacobian = system_at(robot, q, x).jacobian
        freely = np.zeros((len(q), robot.model.nv, len(idle)))  # motions (T, nv, k) of the idle spins
        freely[:, idle] = np.eye(len(idle))
        freely[:, robot.moving] = -np.linalg.solve(jacobian[:, :, robot.moving], jacobian[:, :, idle])
        rates = np.stack(
            [difference_rates(robot, origin, q, freely[:, :, k])[:, idle] for k in range(len(idle))], axis=2
        )
        back = np.linalg.solve(rates, -spin[:, :, None])
        back /= np.maximum(np.abs(back).max(axis=1, keepdims=True) / LONGEST, 1.0)
        q = close_loops(robot, x, integrate(robot, q, (freely @ back)[:, :, 0])).q
    return q
