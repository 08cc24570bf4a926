"""The matrices whose loss of rank is a singularity, without dimension: P of Type 2, and that of Type 1.

Rows are loop equations, columns joints, in radians and lengths of the robot, so that rank has a scale.
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

CHOLESKY_CLEARANCE = 1e-4  # singular values of P whose squares are above what rounding makes of P'P


def scaled_loops(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the Jacobian (T, m, nv) of the independent loop equations [rad, robot lengths]."""
    return scale_jacobian(robot, linearised.closures, robot.loops.rotation)


def scaled_platform(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the Jacobian (T, n, nv) of the platform's velocity v [rad, robot lengths]."""
    return scale_jacobian(robot, linearised.platform, ~robot.translations)


def independent_loops_matrix(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the Jacobian (T, m, nv) of the independent loops, their rows brought to unit size."""
    return scaled_loops(robot, linearised) / robot.structure.row_sizes[:, None]


def passive_matrix(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute P (T, m, n_p), the loops' derivatives along passive joints, without dimension."""
    return linearised.closures[:, :, robot.following] * robot.passive_scale


def clearance(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the least singular value (T,) of P: 0 at Type 2, infinite without passive joints."""
    values = singular_values(passive_matrix(robot, linearised))
    return values.min(axis=1, initial=np.inf)


def find_near_type2(robot: ParallelRobot, linearised: LinearisedLoops, level: float) -> IntArray:
    """Find the indices, ascending, of the configurations whose `clearance` is below a level.

    Usually there are none. That a Cholesky factor of P'P - c^2 exists proves it, at a tenth of the cost of
    singular values: all of them are above c.
    """
    P = passive_matrix(robot, linearised)
    shifted = P.swapaxes(1, 2) @ P - CHOLESKY_CLEARANCE**2 * np.eye(P.shape[2])
    try:
        np.linalg.cholesky(shifted)
    except np.linalg.LinAlgError:
        return np.flatnonzero(clearance(robot, linearised) < level)
    return np.empty(0, dtype=np.intp)


def equation_sizes(robot: ParallelRobot) -> Array:
    """Compute the characteristic scale (n + m,) of each equation [m or rad], the platform's first."""
    loops = robot.loop_lengths * robot.structure.row_sizes
    return np.concatenate([robot.platform_scale, loops])


def type2_matrix(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the square matrix (T, n_p, n_p) whose singularity is Type 2: P, or P'P with redundant motors.

    With more motors than degrees of freedom P has more rows than columns; it loses rank at isolated
    places at most, which P'P touches without crossing.
    """
    P = passive_matrix(robot, linearised)
    return P if P.shape[1] == P.shape[2] else P.transpose(0, 2, 1) @ P


def type1_matrix(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the dimensionless Jacobian (T, n + m, n + m) that inverse kinematics inverts.

    Rows: platform, loops; columns: actuated, passive joints. It is singular in Type 1 singularities, and
    where the loop equations lose rank.
    """
    rows = [scaled_platform(robot, linearised), independent_loops_matrix(robot, linearised)]
    return np.concatenate(rows, axis=1)[:, :, robot.moving]


def passive_motion(robot: ParallelRobot, eta: Array) -> Array:
    """Compute joint rates (..., nv) of dimensionless passive rates eta (..., n_p)."""
    columns = robot.following
    return full_motion(robot, columns, eta * robot.column_scale[columns])


def count_lost_ranks(robot: ParallelRobot, linearised: LinearisedLoops, level: float = RANK_LOST) -> IntArray:
    """Count the ranks (T,) that the independent loop equations lose at T configurations.

    A rank is lost with a singular value, in radians and robot lengths, below level times the largest, or
    times 1 if that is more.
    """
    values = singular_values(scaled_loops(robot, linearised)[:, :, robot.moving])
    largest = np.maximum(values.max(axis=1, initial=0.0), 1.0)
    return np.sum(values < level * largest[:, None], axis=1)


def instantaneous_motions(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the rates (k, f) of the `moving` joints that the loops of one configuration allow.

    They are an orthonormal basis in radians and robot lengths, converted to joint rates. f is the number of
    degrees of freedom, and more where the loop equations lose rank.
    """
    columns = robot.moving
    allowed = null_directions(scaled_loops(robot, linearised)[0][:, columns])
    return allowed.T * robot.column_scale[columns][:, None]
