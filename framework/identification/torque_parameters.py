"""The forces of a motion as a linear function of inertial and motor parameters.

By virtual work along the platform's twists, with N = dq/dv the joint rates for unit twists (closed loops),

    N' Y theta = N' S tau,

Y the joint torque regressor of the open tree and S the motors' joints: W = G' tau of `platform_wrench`, which
is regular at Type 2 singularities too and holds with redundant motors.

Parameters: of each body that moves the ten (m, m c, I about the origin of its joint) on the axes of its link,
of each motor the rotor inertia on its own side of the gear, viscous and dry friction on the joint's.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.arrays import Array, IntArray
from framework.dynamics.forces import tree_forces
from framework.dynamics.platform_wrench import motor_speeds
from framework.errors import InvalidInput
from framework.kinematics.motion_rates import Motion
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.pinocchio_memory import scratch_of

INERTIAL = ("mass", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
OF_MOTORS = ("rotor_inertia", "damping", "friction")
# entries of the symmetric matrix of second moments that hold a moment of inertia of pinocchio's order
_PLACES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


class TorqueParameters(NamedTuple):
    """The parameters of a robot's bodies and motors: p of them, those of bodies first."""

    bodies: IntArray  # (b,) joints of pinocchio that carry them
    links: tuple[str, ...]  # (b,) the links that they are named by
    names: tuple[str, ...]  # (p,)
    values: Array  # (p,) of the file, SI units
    sizes: Array  # (p,) typical of a body of this robot [kg, kg m, kg m^2] and of a motor


def torque_parameters(robot: ParallelRobot, *, massless: bool = False) -> TorqueParameters:
    """Return the parameters of a robot's torques, with the values of its file.

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
    bodies = [j for j in range(1, model.njoints) if massless or model.inertias[j].mass > 0]
    links = [_link_of(model, j) for j in bodies]
    names = [f"{link}.{name}" for link in links for name in INERTIAL]
    names += [f"{joint}.{name}" for joint in robot.actuator_names for name in OF_MOTORS]
    values = [link_parameters(model, j) for j in bodies]
    columns, gears = robot.actuated, robot.gear_ratio
    of_motors = [robot.rotor_inertia, robot.joint_damping[columns], robot.joint_friction[columns]]
    length, mass = robot.length, robot.mass or 1.0
    sizes = np.tile(mass * length ** np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2]), len(bodies))
    arm = robot.column_scale[columns]  # 1 of a hinge, whose inertia is mass length^2
    inertia = mass * (length / arm) ** 2
    rate = np.sqrt(gravity_of(robot) / length)
    motor_sizes = [inertia / gears**2, inertia * rate, inertia * rate**2]
    return TorqueParameters(
        bodies=np.array(bodies, dtype=np.intp),
        links=tuple(links),
        names=tuple(names),
        values=np.concatenate([*values, np.stack(of_motors, axis=1).ravel()]),
        sizes=np.concatenate([sizes, np.stack(motor_sizes, axis=1).ravel()]),
    )


def gravity_of(robot: ParallelRobot) -> float:
    """Return the size of gravity, 1 m/s^2 where there is none: with the length it is a scale of time."""
    return float(np.linalg.norm(robot.model.gravity.linear)) or 1.0


def _link_of(model: pin.Model, j: int) -> str:
    """Return the name of the link that joint j carries: the first of those fixed to it."""
    body = pin.FrameType.BODY
    names = [str(frame.name) for frame in model.frames if frame.parentJoint == j and frame.type == body]
    return names[0] if names else str(model.names[j])


def link_axes(model: pin.Model, j: int) -> pin.SE3:
    """Return the placement of the link's axes on joint j: the identity, but that balls turn theirs."""
    name = str(model.names[j])
    if model.existFrame(name, pin.FrameType.JOINT):
        return model.frames[model.getFrameId(name, pin.FrameType.JOINT)].placement
    return pin.SE3.Identity()


def link_parameters(model: pin.Model, j: int) -> Array:
    """Return the ten inertial parameters of what joint j carries, about its origin on the link's axes."""
    return np.asarray(link_axes(model, j).actInv(model.inertias[j]).toDynamicParameters())


def pseudo_inertia(parameters: Array) -> Array:
    """Return the pseudo-inertia (..., 4, 4), the second moments of mass, of ten parameters (..., 10).

    [[int r r' dm, m c], [(m c)', m]] of Wensing, Kim and Slotine, IEEE Robotics and Automation Letters 3(1),
    2018: positive semidefinite for a body that can exist.
    """
    matrix = np.zeros((*parameters.shape[:-1], 4, 4))
    inertia = np.zeros((*parameters.shape[:-1], 3, 3))
    for k, (i, j) in enumerate(_PLACES):
        inertia[..., i, j] = inertia[..., j, i] = parameters[..., 4 + k]
    half_trace = 0.5 * np.trace(inertia, axis1=-2, axis2=-1)
    matrix[..., :3, :3] = half_trace[..., None, None] * np.eye(3) - inertia
    matrix[..., :3, 3] = matrix[..., 3, :3] = parameters[..., 1:4]
    matrix[..., 3, 3] = parameters[..., 0]
    return matrix


def of_pseudo_inertia(matrix: Array) -> Array:
    """Return the ten parameters (..., 10) of a pseudo-inertia (..., 4, 4)."""
    moments = matrix[..., :3, :3]
    trace = np.trace(moments, axis1=-2, axis2=-1)
    inertia = trace[..., None, None] * np.eye(3) - moments
    first = [matrix[..., 3, 3], *np.moveaxis(matrix[..., :3, 3], -1, 0)]
    return np.stack([*first, *(inertia[..., i, j] for i, j in _PLACES)], axis=-1)


def moved_parameters(placement: pin.SE3) -> Array:
    """Return the matrix (10, 10) that expresses ten parameters of one frame in another, at `placement`."""
    move = np.asarray(placement.homogeneous)
    return np.asarray(of_pseudo_inertia(move @ pseudo_inertia(np.eye(10)) @ move.T).T)


class ParameterRegressor(NamedTuple):
    """Y of N' Y theta + known = N' S tau at T instants, rows on the platform's axes."""

    matrix: Array  # (T, n, p)
    known: Array  # (T, n) springs, armature and damping of joints without a motor
    motors: Array  # (T, n, n_a) N' S on the motor side: G' of `platform_wrench`


def parameter_regressor(
    robot: ParallelRobot, motion: Motion, parameters: TorqueParameters
) -> ParameterRegressor:
    """Compute the regressor of the closed robot at T instants of a motion, along its parameters."""
    G, rates = motor_speeds(robot, motion.linearised)  # (T, n_a, n), (T, nv, n)
    model, data, columns = robot.model, scratch_of(robot).data, robot.actuated
    turned = [moved_parameters(link_axes(model, int(j))) for j in parameters.bodies]
    used = (10 * (parameters.bodies[:, None] - 1) + np.arange(10)).ravel()
    bodies = np.empty((len(motion.q), robot.n, len(used)))
    for k, (q, v, a) in enumerate(zip(motion.q, motion.v, motion.a, strict=True)):
        bodies[k] = rates[k].T @ pin.computeJointTorqueRegressor(model, data, q, v, a)[:, used]
    for i, matrix in enumerate(turned):
        bodies[..., 10 * i : 10 * i + 10] = bodies[..., 10 * i : 10 * i + 10] @ matrix
    v, a = motion.v[:, columns], motion.a[:, columns]
    along = rates[:, columns].transpose(0, 2, 1)  # (T, n, n_a)
    motors = np.stack([robot.gear_ratio**2 * a, v, np.sign(v)], axis=2)[:, None] * along[..., None]
    matrix = np.concatenate([bodies, motors.reshape(*motors.shape[:2], -1)], axis=2)
    values = parameters.values.copy()
    values[len(used) :].reshape(-1, len(OF_MOTORS))[:, [0, 2]] = 0.0  # tree_forces has neither of them
    known = np.einsum("tvn,tv->tn", rates, tree_forces(robot, motion)) - matrix @ values
    return ParameterRegressor(matrix, known, G.transpose(0, 2, 1))
