"""The forces of a motion as a linear function of inertial and motor parameters.

By virtual work along the platform's twists, with N = dq/dv the joint rates for unit twists (closed loops),

    N' Y theta = N' S tau,

Y the joint torque regressor of the open tree and S the motors' joints: W = G' tau of `platform_wrench`, which
is regular at Type 2 singularities too and holds with redundant motors.

Parameters of each moving body are the ten (m, m c, I about the origin of its joint) on the axes of its link;
those of each motor the rotor inertia on the motor side, viscous and dry friction on the joint side of the
gear.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.dynamics.body_parameters import INERTIAL, link_of, link_parameters, tree_regressor
from framework.dynamics.forces import tree_forces
from framework.dynamics.platform_wrench import motor_speeds
from framework.errors import InvalidInput
from framework.kinematics.motion_rates import Motion
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, IntArray

LENGTH_POWERS = np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2])  # of the parameters of a body
OF_MOTORS = ("rotor_inertia", "damping", "friction")


class TorqueParameters(NamedTuple):
    """The p parameters of a robot's bodies, ten each, then of its motors, three each."""

    bodies: IntArray  # (b,) joints of pinocchio that carry the bodies
    links: tuple[str, ...]  # (b,) names of the bodies
    names: tuple[str, ...]  # (p,)
    values: Array  # (p,) of the file, SI units
    sizes: Array  # (p,) typical sizes for a body [kg, kg m, kg m^2] and a motor of this robot


def torque_parameters(robot: ParallelRobot, *, massless: bool = False) -> TorqueParameters:
    """Collect the parameters of a robot's torques, with the values of its file.

    Args:
        massless: whether bodies without mass in the file are parameters too.

    Raises:
        InvalidInput: the robot has springs that are virtual joints.
    """
    if robot.n_e:
        raise InvalidInput(
            f"{robot.name}, {robot.flexibility}: parameters are of the rigid robot; load it with "
            f"flexibility='rigid'"
        )
    model = robot.model
    columns = robot.actuated
    bodies = [j for j in range(1, model.njoints) if massless or model.inertias[j].mass > 0]
    links = tuple(link_of(model, j) for j in bodies)
    names = (
        *(f"{link}.{name}" for link in links for name in INERTIAL),
        *(f"{joint}.{name}" for joint in robot.actuator_names for name in OF_MOTORS),
    )
    by_motor = np.stack(
        [robot.rotor_inertia, robot.joint_damping[columns], robot.joint_friction[columns]], axis=1
    )
    body_sizes = np.tile((robot.mass or 1.0) * robot.length**LENGTH_POWERS, len(bodies))
    return TorqueParameters(
        bodies=np.array(bodies, dtype=np.intp),
        links=links,
        names=names,
        values=np.concatenate([*(link_parameters(model, j) for j in bodies), by_motor.ravel()]),
        sizes=np.concatenate([body_sizes, _motor_sizes(robot).ravel()]),
    )


def _motor_sizes(robot: ParallelRobot) -> Array:
    """Compute typical sizes (n_a, 3) of rotor inertia, viscous and dry friction.

    A hinge has the inertia I = mass length^2, a slide the mass. With w = sqrt(g / length) viscous friction
    has the size I w, dry friction I w^2.
    """
    scale = robot.column_scale[robot.actuated]  # 1 for a hinge, the robot's length for a slide
    inertia = (robot.mass or 1.0) * (robot.length / scale) ** 2
    rate = np.sqrt(gravity_scale(robot) / robot.length)
    return np.stack([inertia / robot.gear_ratio**2, inertia * rate, inertia * rate**2], axis=1)


def gravity_scale(robot: ParallelRobot) -> float:
    """Return the size of gravity [m/s^2]; 1 without gravity.

    With the robot's length this is a scale of time.
    """
    return float(np.linalg.norm(robot.model.gravity.linear)) or 1.0


class ParameterRegressor(NamedTuple):
    """Y of N' Y theta + constant = N' S tau at T instants, on platform axes."""

    matrix: Array  # (T, n, p)
    constant: Array  # (T, n) springs, armature and damping of joints without a motor
    motors: Array  # (T, n, n_a) N' S on the motor side: G' of `platform_wrench`


def parameter_regressor(
    robot: ParallelRobot, motion: Motion, parameters: TorqueParameters, *, signs: Array | None = None
) -> ParameterRegressor:
    """Compute the regressor of the closed robot at T instants of a motion.

    On its joint a motor has the torque n^2 I a + damping v + friction sign(v), with the gear ratio n. The
    known part is N' r of `tree_forces` less what the regressor explains: r contains bodies and damping, but
    neither rotors nor dry friction.

    Args:
        signs: (T, n_a) of the motors' speeds, as filtered; by default those of the motion.
    """
    G, N = motor_speeds(robot, motion.linearised)  # speeds of motors (T, n_a, n) and joints (T, nv, n)
    columns = robot.actuated
    of_bodies = N.swapaxes(1, 2) @ tree_regressor(robot, motion, parameters.bodies)  # (T, n, 10 b)
    v = motion.v[:, columns]
    a = motion.a[:, columns]
    signs = np.sign(v) if signs is None else signs
    joint_torques = np.stack([robot.gear_ratio**2 * a, v, signs], axis=2)  # (T, n_a, 3) of unit parameters
    of_motors = N[:, columns].transpose(0, 2, 1)[..., None] * joint_torques[:, None]  # (T, n, n_a, 3)
    matrix = np.concatenate([of_bodies, of_motors.reshape(*of_motors.shape[:2], -1)], axis=2)

    in_tree_forces = parameters.values.copy()  # without rotors and dry friction
    motor_values = in_tree_forces[of_bodies.shape[2] :].reshape(-1, len(OF_MOTORS))  # a view
    motor_values[:, [OF_MOTORS.index("rotor_inertia"), OF_MOTORS.index("friction")]] = 0.0
    constant = np.matvec(N.swapaxes(1, 2), tree_forces(robot, motion)) - matrix @ in_tree_forces
    return ParameterRegressor(matrix, constant, G.transpose(0, 2, 1))
