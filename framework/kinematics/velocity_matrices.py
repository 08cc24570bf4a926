"""A, B, C of any parallel robot: A v = B dq_a + C dq_e.

The passive rates are eliminated numerically, for every robot in the same way. Let the columns of N span the
left null space of the passive columns of d[platform ; closures]/dq. Then N' [v ; 0] = N' (actuated columns)
dq_a + N' (elastic columns) dq_e. Source: Briot and Arakelian 2010, text below Eq. (4); A' lambda = W_p is
their Eq. (4).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.kinematics.closures import scale_jacobian
from framework.kinematics.linearised_loops import LinearisedLoops, assembled_at
from framework.kinematics.motion_rates import Motion, jacobian_rates
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike, read_only


class VelocityMatrices(NamedTuple):
    """Matrices of A v = B dq_a + C dq_e, v on the platform's axes, q_a on the joint side."""

    A: Array  # (m, n)
    B: Array  # (m, n_a)
    C: Array  # (m, n_e)


def velocity_matrices(robot: ParallelRobot, q: ArrayLike) -> VelocityMatrices:
    """Compute A (m, n), B (m, n_a), C (m, n_e) at an assembled configuration q (nq,).

    The rows come from an orthonormal basis of a null space, so they are determined up to a rotation. A is
    singular at Type 2, B at Type 1 singularities.

    Raises:
        InvalidInput: q has the wrong length, is not finite, or leaves the loops open.
    """
    scaled = dimensionless_matrices(robot, assembled_at(robot, q).linearised)
    A, B, C = (read_only(matrix[0]) for matrix in _with_dimension(robot, scaled))
    return VelocityMatrices(A, B, C)


def matrices_and_rates(robot: ParallelRobot, motion: Motion) -> tuple[VelocityMatrices, VelocityMatrices]:
    """Compute A (T, m, n), B (T, m, n_a), C (T, m, n_e) along a motion, and their time derivatives.

    Let L be N' of the header, M the Jacobian of platform and loops, and M_p its passive columns. L M_p = 0 at
    all times, so dL/dt M_p = -L dM_p/dt. The solution of least norm is dL/dt = -L dM_p/dt M_p^+. Another
    choice of rows adds R A, R B, R C to the rates, with one matrix R (m, m).
    """
    jacobian_rate, _ = jacobian_rates(robot, motion.linearised, motion.v)
    return matrices_and_changes(robot, motion.linearised, jacobian_rate)


def matrices_and_changes(
    robot: ParallelRobot, linearised: LinearisedLoops, changes: Array
) -> tuple[VelocityMatrices, VelocityMatrices]:
    """Compute A, B, C and their derivatives for derivatives `changes` (T, n + m, nv) of dF/dq.

    The equations are those of `matrices_and_rates`.
    """
    M = _dimensionless_jacobian(robot, linearised.jacobian)
    dM = _dimensionless_jacobian(robot, changes)
    N, passive = _left_null_space(robot, M), robot.following
    dN = -N @ dM[:, :, passive] @ np.linalg.pinv(M[:, :, passive])
    dA, dB, dC = _combine(robot, dN, M)  # d(N M) = dN M + N dM, whereas A is a part of N alone
    by_jacobian = _combine(robot, N, dM)
    rates = VelocityMatrices(dA, dB + by_jacobian.B, dC + by_jacobian.C)
    return _with_dimension(robot, _combine(robot, N, M)), _with_dimension(robot, rates)


def dimensionless_matrices(robot: ParallelRobot, linearised: LinearisedLoops) -> VelocityMatrices:
    """Compute A (T, m, n), B (T, m, n_a), C (T, m, n_e) in radians and lengths of the robot.

    A is a block of columns of a matrix with orthonormal rows, so its singular values are between 0 and 1.
    """
    M = _dimensionless_jacobian(robot, linearised.jacobian)
    return _combine(robot, _left_null_space(robot, M), M)


def _combine(robot: ParallelRobot, N: Array, M: Array) -> VelocityMatrices:
    """Return A, B, C of N [v; 0] = N M dq.

    N is (T, m, n + m), M is (T, n + m, nv).
    """
    return VelocityMatrices(N[:, :, : robot.n], N @ M[:, :, robot.actuated], N @ M[:, :, robot.elastic])


def _dimensionless_jacobian(robot: ParallelRobot, jacobian: Array) -> Array:
    """Return dF/dq (T, n + m, nv) in radians and lengths of the robot."""
    return scale_jacobian(robot, jacobian, np.concatenate([~robot.translations, robot.loops.rotation]))


def _left_null_space(robot: ParallelRobot, M: Array) -> Array:
    """Compute orthonormal rows (T, m, n + m) that the passive columns of M (T, n + m, nv) annihilate."""
    passive = robot.following
    Q = np.linalg.qr(M[:, :, passive], mode="complete")[0]  # (T, n + m, n + m)
    return Q[:, :, len(passive) :].swapaxes(1, 2)  # its last columns are orthogonal to the passive ones


def _with_dimension(robot: ParallelRobot, matrices: VelocityMatrices) -> VelocityMatrices:
    """Convert A, B, C from lengths of the robot to metres."""
    return VelocityMatrices(
        A=matrices.A / robot.platform_scale,
        B=matrices.B / robot.column_scale[robot.actuated],
        C=matrices.C / robot.column_scale[robot.elastic],
    )
