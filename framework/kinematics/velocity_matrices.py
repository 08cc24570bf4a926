"""The matrices of A v = B dq_a + C dq_e for any parallel robot, and their derivatives with those of the pose.

v is the platform's velocity, q_a the motors' joints and q_e the deflections of the springs. The passive rates
are eliminated numerically, for every robot in the same way. Let M = dF/dq be the Jacobian of platform and
loops, F = [platform - x ; closures], and let the rows of L span the left null space of its passive columns.
Then L [v ; 0] = L (actuated columns) dq_a + L (elastic columns) dq_e. Source: Briot and Arakelian 2010, text
below Eq. (4); A' lambda = W_p is their Eq. (4).

Derivatives of the pose: if the motors rest while a deflection changes the closures by dc, the passive joints
close them, P dq_p = -dc, and the platform moves. If the platform rests, all joints follow the deflection.
Springs may be any joints added to those of a robot. The geometric parameters of a robot are the springs of
`framework.identification.geometry.parametrise_geometry(robot).model`, so `kinematic_derivatives` of this
model also gives derivatives along geometric parameters.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.errors import SingularPose
from framework.kinematics.assembly import Configuration
from framework.kinematics.closures import scale_jacobian
from framework.kinematics.continuation.forward_kinematics import check_motors_are_free
from framework.kinematics.continuation.motor_curves import rates_closing_loops
from framework.kinematics.inverse_kinematics import require_mobility
from framework.kinematics.linearised_loops import LinearisedLoops, assembled_at, find_near_type2
from framework.kinematics.motion_rates import Motion, jacobian_rates, joint_rates
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike, IntArray, ReadOnlyArrays, read_only


class VelocityMatrices(NamedTuple):
    """Matrices of A v = B dq_a + C dq_e, with q_a on the joint side of the gears.

    m is the number of rows of L; at T configurations each matrix has T as its first dimension.
    """

    A: Array  # (m, n)
    B: Array  # (m, n_a)
    C: Array  # (m, n_e)


def velocity_matrices(robot: ParallelRobot, q: ArrayLike) -> VelocityMatrices:
    """Compute A (m, n), B (m, n_a), C (m, n_e) at an assembled configuration q (nq,).

    The rows of L are an orthonormal basis of a null space, so A, B and C are determined up to a rotation of
    their rows. A is singular at Type 2, B at Type 1 singularities.

    Raises:
        InvalidInput: q has the wrong length, is not finite, or leaves the loops open.
    """
    scaled = dimensionless_matrices(robot, assembled_at(robot, q))
    A, B, C = (read_only(matrix[0]) for matrix in _with_dimension(robot, scaled))
    return VelocityMatrices(A, B, C)


def matrices_and_rates(robot: ParallelRobot, motion: Motion) -> tuple[VelocityMatrices, VelocityMatrices]:
    """Compute A (T, m, n), B (T, m, n_a), C (T, m, n_e) along a motion, and their time derivatives.

    Another choice of L adds R A, R B, R C to the derivatives, with one matrix R (m, m).
    """
    jacobian_rate, _ = jacobian_rates(robot, motion.linearised, motion.v)
    return matrices_and_derivatives(robot, motion.linearised, jacobian_rate)


def matrices_and_derivatives(
    robot: ParallelRobot, linearised: LinearisedLoops, jacobian_derivative: Array
) -> tuple[VelocityMatrices, VelocityMatrices]:
    """Compute A, B, C and their derivatives along any parameter.

    M is dF/dq, and L annihilates its passive columns M_p: L M_p = 0. The derivative of L is the solution of
    least norm of dL M_p = -L dM_p, which is dL = -L dM_p M_p^+.

    Args:
        jacobian_derivative: (T, n + m, nv) derivative of dF/dq along the parameter.
    """
    M = _dimensionless_jacobian(robot, linearised.jacobian)
    dM = _dimensionless_jacobian(robot, jacobian_derivative)
    L, passive = _left_null_space(robot, M), robot.following
    dL = -L @ dM[:, :, passive] @ np.linalg.pinv(M[:, :, passive])

    # A consists of columns of L; B and C consist of columns of L M, with d(L M) = dL M + L dM
    dA, B_by_dL, C_by_dL = _eliminate_passive_rates(robot, dL, M)
    _, B_by_dM, C_by_dM = _eliminate_passive_rates(robot, L, dM)
    matrices = _eliminate_passive_rates(robot, L, M)
    derivatives = VelocityMatrices(dA, B_by_dL + B_by_dM, C_by_dL + C_by_dM)
    return _with_dimension(robot, matrices), _with_dimension(robot, derivatives)


def dimensionless_matrices(robot: ParallelRobot, linearised: LinearisedLoops) -> VelocityMatrices:
    """Compute A (T, m, n), B (T, m, n_a), C (T, m, n_e) in radians and lengths of the robot.

    A is a block of columns of a matrix with orthonormal rows, so its singular values are between 0 and 1.
    """
    M = _dimensionless_jacobian(robot, linearised.jacobian)
    return _eliminate_passive_rates(robot, _left_null_space(robot, M), M)


def _eliminate_passive_rates(robot: ParallelRobot, L: Array, M: Array) -> VelocityMatrices:
    """Return A, B, C of L [v; 0] = L M dq for L (T, m, n + m).

    L annihilates the passive columns of M, so the passive rates drop out.
    """
    return VelocityMatrices(L[:, :, : robot.n], L @ M[:, :, robot.actuated], L @ M[:, :, robot.elastic])


def _dimensionless_jacobian(robot: ParallelRobot, jacobian: Array) -> Array:
    """Convert a `jacobian` dF/dq, or a derivative of one, (T, n + m, nv) to radians and robot lengths."""
    return scale_jacobian(robot, jacobian, np.concatenate([robot.platform_scale, robot.loop_lengths]))


def _left_null_space(robot: ParallelRobot, M: Array) -> Array:
    """Compute L (T, m, n + m): orthonormal rows that annihilate the passive columns of M."""
    passive = robot.following
    Q, _ = np.linalg.qr(M[:, :, passive], mode="complete")  # Q (T, n + m, n + m)
    return Q[:, :, len(passive) :].swapaxes(1, 2)  # these columns of Q are orthogonal to the passive ones


def _with_dimension(robot: ParallelRobot, matrices: VelocityMatrices) -> VelocityMatrices:
    """Convert the matrices A, B, C from lengths of the robot to metres."""
    return VelocityMatrices(
        A=matrices.A / robot.platform_scale,
        B=matrices.B / robot.column_scale[robot.actuated],
        C=matrices.C / robot.column_scale[robot.elastic],
    )


@dataclass(frozen=True, eq=False)
class PoseSlopes(ReadOnlyArrays):
    """Derivatives of joints q, platform x and `velocity_matrices` A, B, C at a pose along k joints."""

    q: Array  # (nv, k) tangent vectors
    x: Array  # (n, k) of the platform's coordinates [m, rad]
    A: Array  # (k, m, n)
    B: Array  # (k, m, n_a)
    C: Array  # (k, m, n_e)


@dataclass(frozen=True, eq=False)
class KinematicDerivatives(ReadOnlyArrays):
    """Derivatives at one pose, with idle joints at rest.

    Attributes:
        motors: derivatives along the motors' joints, joint side of the gears, at constant deflections.
        springs: derivatives along the deflections q_e, motors at rest.
        q_a: (n_a, n_e) derivatives of the motors' joints along the deflections, platform at rest.
    """

    motors: PoseSlopes
    springs: PoseSlopes
    q_a: Array


def kinematic_derivatives(robot: ParallelRobot, q: ArrayLike | Configuration) -> KinematicDerivatives:
    """Compute the derivatives of a pose q (nq,) along motors and springs.

    Loop equations that only springs can close stay open, for instance those of a planar robot for motions out
    of its plane.

    Raises:
        InvalidInput: q is not assembled; no motor can move alone; or numbers of axes and freedoms differ.
        SingularPose: the motors do not determine the pose (Type 2).
        NotAssembled: the platform does not determine the joints (Type 1).
    """
    linearised = assembled_at(robot, q)
    require_mobility(robot)
    check_motors_are_free(robot)
    if len(find_near_type2(robot, linearised)):
        raise SingularPose(
            f"at {robot.place(linearised.x[0])} the motors do not hold "
            f"the robot (Type 2), and the pose has no derivative along them",
            name=robot.name,
            platform=linearised.x[0],
        )

    # (n_e, 1, nv) of all joints with the platform at rest, at a unit rate of each deflection
    at_rest, unit_rates = np.zeros((robot.n_e, 1, robot.n)), np.eye(robot.n_e)[:, None]
    joints = joint_rates(robot, linearised, at_rest, unit_rates)
    return KinematicDerivatives(
        motors=_pose_derivatives(robot, linearised, robot.actuated),
        springs=_pose_derivatives(robot, linearised, robot.elastic),
        q_a=joints[:, 0, robot.actuated].T,
    )


def _pose_derivatives(robot: ParallelRobot, pose: LinearisedLoops, columns: IntArray) -> PoseSlopes:
    """Compute the derivatives of one pose and its A, B, C along the joints `columns` (k,), loops closed.

    The passive joints close the loops; motors and springs that are not among the columns rest.
    """
    copies = pose.select(np.zeros(len(columns), dtype=np.intp))  # T = k, one for each joint
    steps = rates_closing_loops(robot, copies, np.eye(robot.nv)[columns])  # (k, nv)
    jacobian_slopes, _ = jacobian_rates(robot, copies, steps)
    _, (slopes_A, slopes_B, slopes_C) = matrices_and_derivatives(robot, copies, jacobian_slopes)
    twists = pose.platform[0] @ steps.T  # (n, k)
    dx = np.linalg.solve(robot.platform.rate_matrix(pose.x)[0], twists)  # of twist = E dx
    return PoseSlopes(steps.T, dx, slopes_A, slopes_B, slopes_C)
