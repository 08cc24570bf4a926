"""A, B, C of any parallel robot: A v = B dq_a + C dq_e.

The passive rates are eliminated without a formula for any robot: with N spanning the left null space of
the passive columns of d[platform ; closures]/dq, N' [v ; 0] = N' (actuated columns) dq_a + N' (elastic
columns) dq_e. Source: Briot and Arakelian 2010, text below Eq. (4); A' lambda = W_p is their Eq. (4).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array, ArrayLike, read_only
from framework.kinematics.closures import scaled
from framework.kinematics.inverse_kinematics import assembled_at
from framework.kinematics.parallel_robot import ParallelRobot


class VelocityMatrices(NamedTuple):
    """A v = B dq_a + C dq_e, v the platform's twist on its axes (base frame), q_a on the joint side."""

    A: Array  # (m, n)
    B: Array  # (m, n_a)
    C: Array  # (m, n_e)


def velocity_matrices(robot: ParallelRobot, q: ArrayLike) -> VelocityMatrices:
    """A (m, n), B (m, n_a), C (m, n_e) at an assembled configuration q (nq,).

    The rows are an orthonormal choice, fixed up to a rotation among them; A is singular in Type 2, B
    in Type 1 singularities.

    Raises:
        InvalidInput: q has the wrong length, is not finite, or leaves the loops open.
    """
    system = assembled_at(robot, q).system
    rows, passive = robot.loops, robot.following
    balanced = np.concatenate(
        [scaled(robot, system.platform, ~robot.translations), scaled(robot, system.closures, rows.rotation)],
        axis=1,
    )[0]
    # left null space N of the passive columns, in balanced units; then back to metres and radians
    N = np.linalg.qr(balanced[:, passive], mode="complete")[0][:, len(passive) :]
    turning = np.concatenate([~robot.translations, rows.rotation])
    N = N * np.where(turning, 1.0, 1.0 / robot.length)[:, None]
    jacobian = system.jacobian[0]
    matrices = N[: robot.n].T, N.T @ jacobian[:, robot.actuated], N.T @ jacobian[:, robot.elastic]
    return VelocityMatrices(*map(read_only, matrices))
