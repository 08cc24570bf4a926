"""Physically possible parameters of bodies and motors that fit the data and are near the file's values.

The misfit to the data is a quadratic form in all parameters. A prior keeps parameters that the data do not
determine at the file's values. The pseudo-inertia of every body must be positive semidefinite (Wensing, Kim
and Slotine, IEEE Robotics and Automation Letters 3(1), 2018), and rotor inertia, damping and friction must
not be negative. This is a semidefinite program. Links fixed to one another form one body; the prior divides
its parameters among the links.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple
from xml.etree.ElementTree import Element, fromstring, tostring

import numpy as np
import pinocchio as pin

from framework.dynamics.body_parameters import parameter_transform, pseudo_inertia
from framework.errors import NotConverged
from framework.identification.base_parameters import LENGTH_POWERS, OF_MOTORS, TorqueParameters
from framework.identification.geometry import elements_by_name
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import link_axes
from framework.model.description import JointDynamics, RobotDescription
from framework.model.documents import attribute, child_element, read_origin, remove_children
from framework.model.urdf_edits import inertial_element
from framework.numerics.arrays import Array
from framework.numerics.cone_program import Affine, LinearMatrix, Unsolved, semidefinite_least_squares

MOMENTS = ("ixx", "ixy", "iyy", "ixz", "iyz", "izz")  # in the order of pinocchio
NO_ROTOR = 1e-9  # prior deviation of a rotor that is zero in the file, over the typical inertia of a motor
ROUNDED_BODY = 1e-9  # negative eigenvalues of a pseudo-inertia that count as rounding, over its size


class LinkParameters(NamedTuple):
    """The u parameters of links and motors: ten of each link on its axes, then three of each motor."""

    links: tuple[str, ...]  # those with mass in the file
    values: Array  # (u,) in the robot file
    spread: Array  # (u,) sizes of the parameters, in which the prior deviation is measured
    to_parameters: Array  # (p, u) matrix to the parameters of bodies and motors, `TorqueParameters`

    @property
    def link_slices(self) -> list[slice]:
        """The entries of each link among the u parameters."""
        return [slice(10 * i, 10 * i + 10) for i in range(len(self.links))]

    @property
    def motor_slice(self) -> slice:
        """The entries of all motors among the u parameters."""
        return slice(10 * len(self.links), None)


def collect_link_parameters(robot: ParallelRobot, parameters: TorqueParameters) -> LinkParameters:
    """Collect the parameters of all links with mass and of the motors.

    The parameters of a body are the sum of those of its links, each transformed to the axes of the body.
    """
    urdf = fromstring(robot.description.urdf_text)
    links = elements_by_name(urdf, "link").items()
    in_file = {name: read_inertial_parameters(link) for name, link in links}
    heavy = {name: values for name, values in in_file.items() if values[0] > 0.0}  # by their mass
    frames: list[pin.Frame] = []
    columns: list[Array] = []  # (p, 10) of `to_parameters`, for each link
    for i, joint in enumerate(parameters.bodies.tolist()):
        for frame in robot.model.frames:
            if frame.parentJoint == joint and frame.type == pin.FrameType.BODY and frame.name in heavy:
                frames.append(frame)
                columns.append(_link_columns(robot, parameters, i, frame))
    motors = slice(10 * len(parameters.bodies), None)
    motor_columns = np.eye(len(parameters.names))[:, motors]
    link_values = [heavy[frame.name] for frame in frames]
    return LinkParameters(
        links=tuple(frame.name for frame in frames),
        values=np.concatenate([*link_values, parameters.values[motors]]),
        spread=np.concatenate([*map(_link_sizes, link_values), _motor_sizes(parameters, motors)]),
        to_parameters=np.concatenate([*columns, motor_columns], axis=1),
    )


def _link_columns(robot: ParallelRobot, parameters: TorqueParameters, i: int, link: pin.Frame) -> Array:
    """Return the columns (p, 10) of `to_parameters` for a link of body i."""
    columns = np.zeros((len(parameters.names), 10))
    pose_on_body = link_axes(robot.model, link.parentJoint).inverse() * link.placement
    columns[10 * i : 10 * i + 10] = parameter_transform(pose_on_body)
    return columns


def _motor_sizes(parameters: TorqueParameters, motors: slice) -> Array:
    """Return prior sizes (3 n_a,) of the motors' parameters, at the indices `motors` of all p.

    The size of a rotor is the file's inertia; a rotor that is zero in the file stays almost zero.
    """
    sizes = parameters.sizes[motors].copy()
    rotors = slice(OF_MOTORS.index("rotor_inertia"), None, len(OF_MOTORS))  # every third
    sizes[rotors] = np.maximum(parameters.values[motors][rotors], NO_ROTOR * sizes[rotors])
    return sizes


def _link_sizes(link: Array) -> Array:
    """Compute sizes (10,) of a link's parameters (10,): mass times powers of its radius.

    The powers are `LENGTH_POWERS`. The radius is the radius of gyration about the origin. It is 0 for a point
    mass at the origin, whose moments therefore remain zero.
    """
    mass = link[0]
    trace = np.trace(pseudo_inertia(link)[:3, :3])
    radius = np.sqrt(max(trace, 0.0) / mass)
    return mass * radius**LENGTH_POWERS


def read_inertial_parameters(link: Element) -> Array:
    """Read the ten parameters (10,) of a link about its origin; zeros without <inertial>."""
    inertial = link.find("inertial")
    if inertial is None:
        return np.zeros(10)
    where = f"link {link.get('name')!r}: <inertial>"
    mass = attribute(child_element(inertial, where, "mass"), where, "value")
    inertia = child_element(inertial, where, "inertia")
    entries = [float(attribute(inertia, where, key)) for key in MOMENTS]
    pose = read_origin(inertial, where)
    return parameter_transform(pin.SE3(pose)) @ np.array([float(mass), 0.0, 0.0, 0.0, *entries])


def fit_possible_parameters(
    robot: ParallelRobot, links: LinkParameters, information: Array, residual: Array, prior: float
) -> Array:
    """Compute the most probable physically possible parameters (u,) of links and motors.

    They minimise |A T (theta - theta_file) - r|^2 + |(theta - theta_file) / deviation|^2, with
    T = `to_parameters`. Let theta = best + change y, where `best` is the unconstrained minimum and `change`
    turns the quadratic form into |y|^2. Then the shortest y with possible parameters is the solution.

    Args:
        information, residual: A' A (p, p) and A' r (p,) of rows A with unit noise.
        prior: standard deviation of the file's values, over the sizes of each link's parameters.

    Raises:
        NotConverged: the solver does not converge.
    """
    best, change = _minimise_misfit(links, information, residual, prior * links.spread)
    cones = [_inertia_cone(links.values[part], change[part], best[part]) for part in links.link_slices]
    motors = links.motor_slice
    deviations = prior * links.spread[motors]
    positive = Affine(change[motors] / deviations[:, None], best[motors] / deviations)
    y = semidefinite_least_squares(cones, positive)
    if isinstance(y, Unsolved):
        raise NotConverged(
            f"{robot.name}: no parameters of bodies that can exist were found ({y.status})",
            residual=float(np.linalg.norm(residual)),
        )
    values = best + change @ y
    values[motors] = np.maximum(values[motors], 0.0)
    for part in links.link_slices:
        if (values[part] != links.values[part]).any():
            link = Element("link")
            _write_inertial(link, values[part])
            values[part] = read_inertial_parameters(link)  # exactly as a file would store this link
    return values


def _minimise_misfit(
    links: LinkParameters, information: Array, residual: Array, deviation: Array
) -> tuple[Array, Array]:
    """Minimise misfit plus prior without constraints; return minimum (u,) and `change` (u, u).

    For any y, misfit plus prior at the parameters minimum + change y exceeds its least value by |y|^2. In
    units of the prior deviations (u,), with T = `to_parameters`, the quadratic form has the matrix
    T' A'A T + 1 = V diag(w) V'. The minimum differs from the file's values by V diag(1 / w) V' T' A'r.
    """
    T = links.to_parameters * deviation  # (p, u)
    w, V = np.linalg.eigh(T.T @ information @ T + np.eye(len(deviation)))
    root = np.sqrt(np.maximum(w, 1.0))  # with the prior no eigenvalue is below 1
    change = deviation[:, None] * V / root
    return links.values + change @ (V.T @ (T.T @ residual) / root), change


def _inertia_cone(file: Array, change: Array, best: Array) -> LinearMatrix:
    """Return the scaled pseudo-inertia D P D of a link, affine in y (u,).

    P belongs to the link's parameters best + change y, with `best` (10,) and `change` (10, u). D belongs to
    the values of the `file` (10,). A small multiple of the identity is added against rounding.
    """
    D = _balancing_scale(file)
    slopes = np.moveaxis(D @ pseudo_inertia(change.T) @ D, 0, 2)
    offset = D @ pseudo_inertia(best) @ D
    return LinearMatrix(slopes, offset + ROUNDED_BODY * np.eye(4))


def _balancing_scale(parameters: Array) -> Array:
    """Compute the diagonal D (4, 4) that gives D P D mass 1 and largest second moment 1.

    P is the pseudo-inertia of parameters (10,).
    """
    diagonal = np.diag(pseudo_inertia(parameters))
    largest = diagonal[:3].max() or diagonal[3]  # all moments of a point mass at the origin are zero
    return np.diag(1.0 / np.sqrt([largest, largest, largest, diagonal[3]]))


def with_masses_and_motors(robot: ParallelRobot, links: LinkParameters, values: Array) -> RobotDescription:
    """Return the robot's description with other parameters of links and motors.

    Args:
        links: the layout of the parameters: a slice for each link, then one for the motors.
        values: (u,) inertial parameters of the links; rotor inertia, damping and friction of each motor.
    """
    description = robot.description
    urdf = fromstring(description.urdf_text)
    elements = elements_by_name(urdf, "link")
    for name, part in zip(links.links, links.link_slices, strict=True):
        if (values[part] != links.values[part]).any():
            _write_inertial(elements[name], values[part])
    motors = values[links.motor_slice].reshape(-1, len(OF_MOTORS))
    actuators = []
    joints = dict(description.joints)
    for actuator, (rotor, damping, friction) in zip(description.actuators, motors.tolist(), strict=True):
        actuators.append(replace(actuator, rotor_inertia=rotor))
        in_file = joints.get(actuator.joint, JointDynamics())
        joints[actuator.joint] = replace(in_file, damping=damping, friction=friction)
    return replace(
        description,
        urdf_text=tostring(urdf, encoding="unicode"),
        actuators=tuple(actuators),
        joints=joints,
    )


def _write_inertial(link: Element, parameters: Array) -> None:
    """Write ten parameters (10,) about a link's origin as its <inertial>.

    <inertial> is about the centre of mass c. With S about the origin, the second moments about c are
    S - m c c'. The inertia is their trace times the identity, minus the second moments.
    """
    mass = float(parameters[0])
    centre = parameters[1:4] / parameters[0]
    second_moments = pseudo_inertia(parameters)[:3, :3] - mass * np.outer(centre, centre)
    moments, axes = np.linalg.eigh(second_moments)
    second_moments = (axes * np.maximum(moments, 0.0)) @ axes.T  # moments are negative only by rounding
    inertia = np.trace(second_moments) * np.eye(3) - second_moments
    remove_children(link, "inertial")
    link.insert(0, inertial_element(mass, centre, inertia))
