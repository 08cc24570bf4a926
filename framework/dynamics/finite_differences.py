"""Raw sampling: the torque formula evaluated instant by instant, without a certificate.

Rates of motors and springs are finite differences in time, and the torque formula divides by a determinant,
however small. Near a Type 2 singularity at which the law violates t_s . W_p = 0, the torques have spikes
whose height depends on the distance of the nearest sample, as in Fig. 3(b) of Briot and Arakelian 2010. These
torques serve figures and comparisons only; use `inverse_dynamics` otherwise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.dynamics.elasticity import motion_with_deflections
from framework.dynamics.forces import joint_forces
from framework.dynamics.inverse_dynamics import checked_geometry
from framework.errors import InvalidInput
from framework.kinematics.continuation.tracking import Branch, track_path
from framework.kinematics.motion_rates import Motion
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import MotionLaw, is_number
from framework.laws.path import Path
from framework.numerics.arrays import Array


class FiniteDifferenceTorques(NamedTuple):
    """Samples of a motion without a certificate."""

    time: Array  # (T,) [s]
    torque: Array  # (T, n_a) [N m], motor side
    motor_angle: Array  # (T, n_a) [rad], motor side
    deflection: Array  # (T, n_e) [m, rad]
    motion: Motion  # with closed loops


def finite_difference_torques(
    robot: ParallelRobot,
    path: Path,
    law: MotionLaw,
    *,
    samples: int = 1501,
    geometry: str | None = None,
    passes: int = 4,
    branch: Branch | None = None,
) -> FiniteDifferenceTorques:
    """Compute torques at equidistant instants, with rates of motors and springs by finite differences.

    Args:
        path: path of the platform, s in [0, 1].
        law: motion law s(t) with an attribute `duration` [s].
        samples: number of instants.
        geometry: "rigid" (forces of the undeformed robot) or "deformed", the default for elastic robots.
        passes: number of times that deflections are computed from forces, with deformed geometry.
        branch: the result of `track_path`, if already computed.

    Raises:
        InvalidInput: fewer than 5 samples, an unknown geometry, or a path that does not fit the robot.
        NotAssembled: the loops do not close at some sample.
    """
    if not (is_number(samples) and int(samples) == samples >= 5):
        raise InvalidInput(f"samples: raw sampling needs a whole number of at least 5, got {samples!r}")
    geometry = checked_geometry(robot, geometry)
    branch = track_path(robot, path) if branch is None else branch
    times = np.linspace(0.0, law.duration, samples)
    q_e = np.zeros((samples, robot.n_e))
    motion = motion_with_deflections(branch, times, law, (q_e, q_e, q_e))  # springs at rest
    forces = joint_forces(robot, motion)

    # with rigid geometry a single pass shifts the motor angles, and the forces stay those of the rigid robot
    pass_count = passes if geometry == "deformed" else min(robot.n_e, 1)
    for k in range(pass_count):
        if k > 0:
            forces = joint_forces(robot, motion)
        q_e = -forces.spring_force / robot.stiffness
        motion = motion_with_deflections(branch, times, law, (q_e, *_differentiate_twice(q_e, times)))

    angle = robot.gear_ratio * robot.actuated_coordinates(motion.q)
    _, acceleration = _differentiate_twice(angle, times)
    torque = robot.rotor_inertia * acceleration + forces.joint_torque / robot.gear_ratio
    return FiniteDifferenceTorques(times, torque, angle, q_e, motion)


def _differentiate_twice(values: Array, times: Array) -> tuple[Array, Array]:
    """Compute two time derivatives of values (T, k) by differences of second order."""
    slopes = np.gradient(values, times, axis=0, edge_order=2)
    return slopes, np.gradient(slopes, times, axis=0, edge_order=2)
