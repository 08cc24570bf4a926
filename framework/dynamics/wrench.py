"""t_s, W_p and the measure g along a motion; by condition (8), t_s . W_p vanishes at crossings."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.dynamics.forces import tree_forces
from framework.dynamics.platform_wrench import motor_speeds
from framework.dynamics.result import InverseDynamics
from framework.kinematics.motion_rates import Motion
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.singularity.points_on_path import SearchedPath
from framework.singularity.type2 import sign_along, singularity_measure, twist_norm


class WrenchCurves(NamedTuple):
    """The force that a motion requires along t_s, the twist that the motors control least, at T instants.

    t_s is continued smoothly away from the singularity. Where |g| is least, t_s has unit size and points
    along the motion. `power` is eta . r, with the joint rates eta of t_s and the forces r of the open tree.
    It equals t_s . W_p at a singularity and, if the legs have no mass, at all poses.
    """

    g: Array  # (T,) measure, zero at Type 2
    twist: Array  # (T, n) t_s
    wrench: Array  # (T, n) W_p = (dq/dv)' r: inertia and weight of all bodies less external wrenches
    power: Array  # (T,) [N, or N m for a pure turn]


def wrench_curves(robot: ParallelRobot, motion: Motion) -> WrenchCurves:
    """Compute g, t_s, W_p and t_s . W_p along a motion in time."""
    forces = tree_forces(robot, motion)
    _G, joint_rates = motor_speeds(robot, motion.linearised)  # (T, nv, n) dq/dv
    wrench = np.einsum("tvn,tv->tn", joint_rates, forces)  # W_p = (dq/dv)' r
    measure = singularity_measure(robot, motion.linearised)
    twist = np.einsum("tnv,tv->tn", motion.linearised.platform, measure.motion)
    # scale t_s to unit size, along the motion, where |g| is least
    nearest = int(np.argmin(np.abs(measure.g)))
    signed_norm = twist_norm(robot, twist[nearest]) or 1.0
    signed_norm *= sign_along(twist[nearest], motion.linearised.platform[nearest] @ motion.v[nearest])
    power = np.sum(forces * measure.motion, axis=1) / signed_norm
    return WrenchCurves(measure.g, twist / signed_norm, wrench, power)


def wrench_along(result: InverseDynamics, t: Array) -> tuple[Array, Array]:
    """Compute g (T,) and t_s . W_p (T,) [N or N m] at ascending instants t (T,).

    At a crossing t_s . W_p is `SingularityCrossing.wrench`.
    """
    curves = wrench_curves(result.robot, result.motion(t))
    return curves.g, curves.power


def measure_at_rest(searched: SearchedPath, s: Array) -> Array:
    """Compute g (T,) at ascending path coordinates s (T,), with springs at rest."""
    branch = searched.branch
    return singularity_measure(branch.robot, branch.close(s).linearised).g
