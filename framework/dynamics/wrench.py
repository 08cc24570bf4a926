"""t_s and W_p along a whole motion; condition (8) makes their product vanish at a crossing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.dynamics.forces import tree_forces
from framework.dynamics.platform_wrench import motor_speeds
from framework.dynamics.result import InverseDynamics
from framework.kinematics.motion_rates import Motion
from framework.kinematics.parallel_robot import ParallelRobot
from framework.singularity.type2 import sign_along, singularity_measure, twist_norm


class WrenchCurves(NamedTuple):
    """The force of a motion along the twist that its motors hold least, at T instants.

    t_s is continued smoothly away from the singularity; where |g| is least it has unit size and points along
    the motion. `power` is eta . r with eta the joint rates of t_s: at a singularity it is t_s . W_p for legs
    of any mass, away from it for massless legs.
    """

    g: Array  # (T,) the measure of singularity
    twist: Array  # (T, n) t_s
    wrench: Array  # (T, n) W_p = (dq/dv)' r: inertia and weight less wrenches of the world, all bodies
    power: Array  # (T,) [N, or N m for a pure turn]


def wrench_curves(robot: ParallelRobot, motion: Motion) -> WrenchCurves:
    """Compute g, t_s, W_p and t_s . W_p along a motion in time."""
    forces = tree_forces(robot, motion)
    wrench = np.einsum("tvn,tv->tn", motor_speeds(robot, motion.linearised)[1], forces)
    measure = singularity_measure(robot, motion.linearised)
    twist = np.einsum("tnv,tv->tn", motion.linearised.platform, measure.motion)
    nearest = int(np.argmin(np.abs(measure.g)))
    size = twist_norm(robot, twist[nearest]) or 1.0
    size *= sign_along(twist[nearest], motion.linearised.platform[nearest] @ motion.v[nearest])
    return WrenchCurves(measure.g, twist / size, wrench, np.sum(forces * measure.motion, axis=1) / size)


def wrench_along(result: InverseDynamics, t: Array) -> tuple[Array, Array]:
    """Compute g (T,) and t_s . W_p (T,) [N, or N m for a pure turn] at ascending instants t (T,).

    At a crossing t_s . W_p is `SingularityCrossing.wrench`.
    """
    curves = wrench_curves(result.robot, result.motion(t))
    return curves.g, curves.power
