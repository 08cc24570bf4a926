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
from framework.kinematics.inverse_kinematics import System, assembled_at
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
    A, B, C = dimensionless_matrices(robot, system)
    # back to metres and radians: the twist and the rates on the right were in lengths of the robot
    twist = np.where(robot.translations, robot.length, 1.0)
    matrices = (
        A[0] / twist,
        B[0] / robot.column_scale[robot.actuated],
        C[0] / robot.column_scale[robot.elastic],
    )
    return VelocityMatrices(*map(read_only, matrices))


def dimensionless_matrices(robot: ParallelRobot, system: System) -> VelocityMatrices:
    """A (T, m, n), B (T, m, n_a), C (T, m, n_e) of T configurations in radians and lengths of the robot.

    [A, rest] is the transpose of an orthonormal basis of the left null space of the passive columns of
    d[platform ; closures]/dq: the singular values of A are cosines, in 0 .. 1.
    """
    rows, passive = robot.loops, robot.following
    balanced = np.concatenate(
        [scaled(robot, system.platform, ~robot.translations), scaled(robot, system.closures, rows.rotation)],
        axis=1,
    )
    N = np.linalg.qr(balanced[:, :, passive], mode="complete")[0][:, :, len(passive) :].swapaxes(1, 2)
    return VelocityMatrices(
        N[:, :, : robot.n], N @ balanced[:, :, robot.actuated], N @ balanced[:, :, robot.elastic]
    )
