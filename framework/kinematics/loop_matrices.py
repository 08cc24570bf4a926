"""The dimensionless matrices that lose rank at singularities: P at Type 2, the Type 1 matrix at Type 1.

Rows are equations, columns are joints, both in radians and lengths of the robot. So the singular values by
which rank is judged do not depend on the unit of length.
"""

from __future__ import annotations

import numpy as np

from framework.kinematics.closures import scale_jacobian
from framework.kinematics.frames import full_motion
from framework.kinematics.linearised_loops import LinearisedLoops
from framework.kinematics.loop_structure import null_directions
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, IntArray
from framework.numerics.ordered_sums import singular_values
from framework.tolerances import RANK_LOST

CHOLESKY_CLEARANCE = 1e-4  # singular value of P whose square is well above the rounding of P'P


def scaled_loops(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the Jacobian (T, m, nv) of the independent loop equations [rad, robot lengths]."""
    return scale_jacobian(robot, linearised.closures, robot.loops.rotation)


def scaled_platform(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the Jacobian (T, n, nv) of the platform's velocity v [rad, robot lengths]."""
    return scale_jacobian(robot, linearised.platform, ~robot.translations)


def independent_loops_matrix(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the Jacobian (T, m, nv) of the independent loops, rows scaled to unit size."""
    return scaled_loops(robot, linearised) / robot.structure.row_sizes[:, None]


def passive_matrix(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute P (T, m, n_p), the dimensionless derivatives of the loops along passive joints."""
    return linearised.closures[:, :, robot.following] * robot.passive_scale


def clearance(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the least singular value (T,) of P: 0 at Type 2, infinite without passive joints."""
    values = singular_values(passive_matrix(robot, linearised))
    return values.min(axis=1, initial=np.inf)


def find_near_type2(robot: ParallelRobot, linearised: LinearisedLoops) -> IntArray:
    """Find the ascending indices of configurations at Type 2, with a `clearance` below RANK_LOST.

    Usually there are none. The Cholesky factorisation of P'P - c^2 I proves this at a tenth of the cost of
    singular values: it succeeds only if all singular values of P are above c.
    """
    P = passive_matrix(robot, linearised)
    shifted = P.swapaxes(1, 2) @ P - CHOLESKY_CLEARANCE**2 * np.eye(P.shape[2])
    try:
        np.linalg.cholesky(shifted)
    except np.linalg.LinAlgError:
        return np.flatnonzero(clearance(robot, linearised) < RANK_LOST)
    return np.empty(0, dtype=np.intp)


def equation_sizes(robot: ParallelRobot) -> Array:
    """Compute the characteristic size (n + m,) of each equation [m or rad], the platform's first."""
    loops = robot.loop_lengths * robot.structure.row_sizes
    return np.concatenate([robot.platform_scale, loops])


def type2_matrix(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the square matrix (T, n_p, n_p) that is singular at Type 2: P, or P'P with redundant motors.

    With redundant motors P has more rows than columns and loses rank only at isolated poses, where det P'P
    vanishes without changing sign.
    """
    P = passive_matrix(robot, linearised)
    return P if P.shape[1] == P.shape[2] else P.swapaxes(1, 2) @ P


def type1_matrix(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the dimensionless Jacobian (T, n + m, n + m) of the inverse kinematics.

    The rows are those of the platform, then of the loops; the columns are the actuated, then the passive
    joints. The matrix is singular at Type 1 singularities and where the loop equations lose rank.
    """
    rows = [scaled_platform(robot, linearised), independent_loops_matrix(robot, linearised)]
    return np.concatenate(rows, axis=1)[:, :, robot.moving]


def passive_motion(robot: ParallelRobot, eta: Array) -> Array:
    """Return joint rates (..., nv) for dimensionless passive rates eta (..., n_p)."""
    columns = robot.following
    return full_motion(robot, columns, eta * robot.column_scale[columns])


def count_lost_ranks(robot: ParallelRobot, linearised: LinearisedLoops, level: float) -> IntArray:
    """Compute by how much (T,) the rank of the independent loop equations drops.

    The rank drops by one for each singular value, in radians and robot lengths, that is below `level` times
    the largest one, or times 1 if this is more.
    """
    values = singular_values(scaled_loops(robot, linearised)[:, :, robot.moving])
    largest = np.maximum(values.max(axis=1, initial=0.0), 1.0)
    return np.sum(values < level * largest[:, None], axis=1)


def instantaneous_motions(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute rates (k, f) of the k `moving` joints in f motions that the loops allow (T = 1).

    The motions are orthonormal in radians and robot lengths; the rates are in rad and m. f is the number of
    degrees of freedom, and larger where the loop equations lose rank.
    """
    columns = robot.moving
    allowed = null_directions(scaled_loops(robot, linearised)[0][:, columns])
    return allowed.T * robot.column_scale[columns][:, None]
