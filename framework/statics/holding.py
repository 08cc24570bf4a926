"""Torques with which the motors hold a robot at rest, against its weight and a wrench of the world."""

from __future__ import annotations

import numpy as np

from framework.arrays import Array
from framework.dynamics.forces import balanced_forces, static_forces
from framework.kinematics.linearised_loops import LinearisedLoops
from framework.kinematics.parallel_robot import ParallelRobot


def holding_torques(
    robot: ParallelRobot, linearised: LinearisedLoops, q: Array, wrench: Array | None = None
) -> Array:
    """Compute motor torques (T, n_a) at rest [N m, N], motor side.

    By virtual work, dry friction not counted: torque . dq_a + wrench . dx = power of weight and springs, the
    springs of links deflected as at q. The torques grow without bound towards Type 2.

    Args:
        linearised: the loops at q (T, nq).
        wrench: (n,) of the world ON the platform along its twist, zero by default.
    """
    forces = static_forces(robot, q)
    if wrench is not None:
        forces = forces - np.einsum("tnv,n->tv", linearised.platform, wrench)
    return np.asarray(balanced_forces(robot, linearised, forces).joint_torque / robot.gear_ratio)


def largest_share_of_limits(robot: ParallelRobot, torques: Array) -> Array:
    """Return the largest of torques (T, n_a) over its limit, (T,); a motor without one counts for nothing."""
    limits = [actuator.torque_limit for actuator in robot.description.actuators]
    limit = np.array([np.inf if one is None else one for one in limits])
    return np.asarray((np.abs(torques) / limit).max(axis=1))
