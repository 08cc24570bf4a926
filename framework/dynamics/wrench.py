"""t_s . W_p along a whole motion: the quantity that condition (8) sends through zero at the crossing."""

from __future__ import annotations

import numpy as np

from framework.arrays import Array
from framework.dynamics.forces import tree_forces
from framework.dynamics.result import InverseDynamics
from framework.kinematics.inverse_kinematics import close_loops, motion_at
from framework.singularity.classification import singularity_measure, unit_twist


def wrench_along(result: InverseDynamics, t: Array) -> tuple[Array, Array]:
    """g (T,) and t_s . W_p (T,) [N, or N m for a pure turn] at ascending instants t (T,).

    t_s is continued smoothly away from the singularity and has unit size where |g| is least; there
    t_s . W_p is what `SingularityCrossing.wrench` is, up to sign.
    """
    robot = result.robot
    closed = close_loops(robot, result.platform(t), result.configuration(t))
    rates = (result.deflection(t, 1), result.deflection(t, 2))
    motion = motion_at(robot, closed, result.platform(t, 1), result.platform(t, 2), *rates)
    measure = singularity_measure(robot, closed.system)
    nearest = int(np.argmin(np.abs(measure.g)))
    twist = closed.system.platform[nearest] @ measure.motion[nearest]
    size = unit_twist(robot, twist) or 1.0
    return measure.g, np.sum(tree_forces(robot, motion) * measure.motion, axis=1) / size
