"""The matrices whose loss of rank is a singularity, without dimension: P of Type 2, and that of Type 1.

Rows are loop equations, columns joints, in radians and lengths of the robot, so that rank has a scale.
"""

from __future__ import annotations

import numpy as np

from framework.arrays import Array, IntArray
from framework.kinematics.closures import scaled
from framework.kinematics.inverse_kinematics import System
from framework.kinematics.parallel_robot import ParallelRobot

SURELY_CLEAR = 1e-4  # singular values of P whose squares are above what rounding makes of P'P
VANISHED = 1e-7  # of a unit motion (radians, robot lengths): less does not count as moving


def loop_matrix(robot: ParallelRobot, system: System) -> Array:
    """All columns (T, m, nv) of the independent loop equations, without dimension."""
    return scaled(robot, system.closures, robot.loops.rotation) / robot.row_sizes[:, None]


def passive_matrix(robot: ParallelRobot, system: System) -> Array:
    """P (T, m, n_p): passive columns of the independent loop equations, without dimension."""
    return system.equations.passive.dense(system.entries) * robot.passive_scale


def clearance(robot: ParallelRobot, system: System) -> Array:
    """Least singular values (T,) of P: how far Type 2 is, which has 0; infinite without passive joints."""
    values = np.linalg.svd(passive_matrix(robot, system), compute_uv=False)
    return np.asarray(values.min(axis=1, initial=np.inf))


def near_type_2(robot: ParallelRobot, system: System, level: float) -> IntArray:
    """The instants whose `clearance` is below a level, ascending.

    Mostly there are none, and that is proved without singular values, at a tenth of their cost: they are all
    above c where P'P - c^2 has a Cholesky factor.
    """
    P = passive_matrix(robot, system)
    try:
        np.linalg.cholesky(P.swapaxes(1, 2) @ P - SURELY_CLEAR**2 * np.eye(P.shape[2]))
    except np.linalg.LinAlgError:
        return np.flatnonzero(clearance(robot, system) < level)
    return np.empty(0, dtype=np.intp)


def equation_sizes(robot: ParallelRobot) -> Array:
    """What the platform's and the loop equations (n + m,) are divided by to be without dimension."""
    loops = np.where(robot.loops.rotation, 1.0, robot.length) * robot.row_sizes
    return np.concatenate([np.where(robot.translations, robot.length, 1.0), loops])


def measured_matrix(robot: ParallelRobot, system: System) -> Array:
    """The square matrix (T, n_p, n_p) whose singularity is Type 2: P, or P'P with redundant motors.

    With more motors than degrees of freedom P has more rows than columns; it loses rank at isolated
    places at most, which P'P touches without crossing.
    """
    P = passive_matrix(robot, system)
    return P if P.shape[1] == P.shape[2] else P.transpose(0, 2, 1) @ P


def mobile_matrix(robot: ParallelRobot, system: System) -> Array:
    """The matrix (T, n + m, n + m) of the inverse kinematics, without dimension.

    Columns: actuated, then passive. Singular in Type 1 singularities, and where the loop equations lose rank.
    """
    both = [scaled(robot, system.platform, ~robot.translations), loop_matrix(robot, system)]
    return np.concatenate(both, axis=1)[:, :, robot.moving]


def passive_motion(robot: ParallelRobot, eta: Array) -> Array:
    """Joint rates (..., nv) of dimensionless passive rates eta (..., n_p)."""
    motion = np.zeros((*eta.shape[:-1], robot.model.nv))
    columns = robot.following
    motion[..., columns] = eta * robot.column_scale[columns]
    return motion


def lost_equations(robot: ParallelRobot, system: System, level: float = VANISHED) -> int:
    """How many of the independent loop equations of one configuration (T = 1) hold nothing there.

    Counted by singular values below `level`, in radians and robot lengths.
    """
    loops = scaled(robot, system.closures, robot.loops.rotation)[0][:, robot.moving]
    values = np.linalg.svd(loops, compute_uv=False)
    return int(np.sum(values < level * max(float(values.max(initial=0.0)), 1.0)))


def instantaneous_motions(robot: ParallelRobot, system: System) -> Array:
    """Joint rates (k, f) of the `moving` columns that the loops of one configuration allow, springs at rest.

    An orthonormal basis, in radians and robot lengths, turned back to joint rates. f is the number of
    degrees of freedom, and more where the loop equations lose rank.
    """
    columns = robot.moving
    loops = scaled(robot, system.closures, robot.loops.rotation)[0][:, columns]
    values, right = np.linalg.svd(loops)[1:]
    rank = int(np.sum(values > VANISHED * max(float(values[0]), 1.0)))
    return right[rank:].T * robot.column_scale[columns][:, None]
