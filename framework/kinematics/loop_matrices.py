"""The matrices whose loss of rank is a singularity, without dimension: P of Type 2, and that of Type 1.

Rows are loop equations, columns joints, in radians and lengths of the robot, so that rank has a scale.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from framework.arrays import Array
from framework.kinematics.assembly import loop_rows, passive_columns
from framework.kinematics.closures import column_scale, scaled
from framework.kinematics.inverse_kinematics import System, moving_columns, reference_system
from framework.model import ParallelRobot

UNLIKE = 0.02  # a loop equation below this share of a unit motion, or above its inverse, is brought to it
VANISHED = 1e-7  # of a unit motion (radians, robot lengths): less does not count as moving


def passive_matrix(robot: ParallelRobot, system: System) -> Array:
    """P (T, m, n_p): passive columns of the independent loop equations, without dimension."""
    loops = scaled(robot, system.closures, loop_rows(robot)) / _row_sizes(robot)[:, None]
    return loops[:, :, passive_columns(robot)]


@lru_cache(maxsize=128)
def _row_sizes(robot: ParallelRobot) -> Array:
    """What makes the largest entry of each loop equation (m,) 1 at the reference, for rows far from that.

    An equation may be written in any unit, or as any multiple of itself: none of that is a singularity.
    """
    loops = scaled(robot, reference_system(robot).closures, loop_rows(robot))[0]
    sizes = np.abs(loops[:, moving_columns(robot)]).max(axis=1, initial=0.0)
    return np.where((sizes < UNLIKE) | (sizes > 1 / UNLIKE), np.maximum(sizes, 1e-300), 1.0)


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
    loops = scaled(robot, system.closures, loop_rows(robot)) / _row_sizes(robot)[:, None]
    both = [scaled(robot, system.platform, None), loops]
    return np.concatenate(both, axis=1)[:, :, moving_columns(robot)]


def passive_motion(robot: ParallelRobot, eta: Array) -> Array:
    """Joint rates (..., nv) of dimensionless passive rates eta (..., n_p)."""
    motion = np.zeros((*eta.shape[:-1], robot.model.nv))
    columns = passive_columns(robot)
    motion[..., columns] = eta * column_scale(robot)[columns]
    return motion


def lost_equations(robot: ParallelRobot, system: System, level: float = VANISHED) -> int:
    """How many of the independent loop equations of one configuration (T = 1) hold nothing there.

    Counted by singular values below `level`, in radians and robot lengths.
    """
    loops = scaled(robot, system.closures, loop_rows(robot))[0][:, moving_columns(robot)]
    values = np.linalg.svd(loops, compute_uv=False)
    return int(np.sum(values < level * max(float(values.max(initial=0.0)), 1.0)))


def instantaneous_motions(robot: ParallelRobot, system: System) -> Array:
    """Joint rates (k, f) of the `moving_columns` that the loops of one configuration allow, springs at rest.

    An orthonormal basis, in radians and robot lengths, turned back to joint rates. f is the number of
    degrees of freedom, and more where the loop equations lose rank.
    """
    columns = moving_columns(robot)
    loops = scaled(robot, system.closures, loop_rows(robot))[0][:, columns]
    values, right = np.linalg.svd(loops)[1:]
    rank = int(np.sum(values > VANISHED * max(float(values[0]), 1.0)))
    return right[rank:].T * column_scale(robot)[columns][:, None]
