"""Physically possible parameters of bodies and motors that fit the data and are near the file's values.

The misfit to the data is a quadratic form of all parameters. A prior keeps parameters that the data do not
determine at the file's values. Every body's pseudo-inertia must be positive semidefinite (Wensing, Kim and
Slotine, IEEE Robotics and Automation Letters 3(1), 2018); rotor inertia, damping and friction must not be
negative. This is a semidefinite program. Links fixed to one another are one body, whose parameters the prior
divides among the links.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple
from xml.etree.ElementTree import Element, fromstring, tostring

import numpy as np
import pinocchio as pin

from framework.dynamics.body_parameters import (
    parameter_transform,
    pseudo_inertia,
)
from framework.errors import NotConverged
from framework.identification.base_parameters import LENGTH_POWERS, OF_MOTORS, TorqueParameters
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import link_axes
from framework.model.description import JointDynamics, RobotDescription
from framework.model.documents import attribute, child_element, read_origin, remove_children
from framework.model.urdf_edits import inertial_element
from framework.numerics.arrays import Array
from framework.numerics.cone_program import Affine, LinearMatrix, Unsolved, semidefinite_least_squares

MOMENTS = ("ixx", "ixy", "iyy", "ixz", "iyz", "izz")  # in the order of pinocchio
NO_ROTOR = 1e-9  # over the size of a motor's inertia: prior deviation of a rotor that is zero in the file
ROUNDED_BODY = 1e-9  # over mass and second moments: negative eigenvalues that count as rounding


class LinkParameters(NamedTuple):
    """The u parameters of all links, (10,) each on the link's axes, and of motors."""

    links: tuple[str, ...]  # with mass in the file
    values: Array  # (u,) of the file: ten of each link, then three of each motor
    spread: Array  # (u,) sizes of the parameters, units of their prior deviation
    to_parameters: Array  # (p, u) matrix from these to parameters of bodies and motors, `TorqueParameters`


def collect_link_parameters(robot: ParallelRobot, parameters: TorqueParameters) -> LinkParameters:
    """Collect the parameters of all links with mass and of the motors.

    The parameters of a body are the sum of those of its links, each transformed to the axes of the body.
    """
    urdf = fromstring(robot.description.urdf_text)
    in_file = {link.get("name", ""): read_inertial_parameters(link) for link in urdf.findall("link")}
    links: list[str] = []
    columns: list[Array] = []  # a link's columns of `to_parameters`, (p, 10)
    for i, j in enumerate(map(int, parameters.bodies)):
        for frame in robot.model.frames:
            is_link = frame.parentJoint == j and frame.type == pin.FrameType.BODY
            if is_link and in_file.get(frame.name, np.zeros(1))[0] > 0.0:
                of_link = np.zeros((len(parameters.names), 10))
                pose_on_body = link_axes(robot.model, j).inverse() * frame.placement
                of_link[10 * i : 10 * i + 10] = parameter_transform(pose_on_body)
                links.append(str(frame.name))
                columns.append(of_link)
    motors = slice(10 * len(parameters.bodies), None)
    of_motors = np.eye(len(parameters.names))[:, motors]
    link_values = [in_file[link] for link in links]
    return LinkParameters(
        links=tuple(links),
        values=np.concatenate([*link_values, parameters.values[motors]]),
        spread=np.concatenate([*map(_body_sizes, link_values), _motor_spread(parameters, motors)]),
        to_parameters=np.concatenate([*columns, of_motors], axis=1),
    )


def _motor_spread(parameters: TorqueParameters, motors: slice) -> Array:
    """Return prior sizes (3 n_a,) of motors' parameters.

    Of a rotor the size is the file's inertia, or next to nothing.
    """
    spread = parameters.sizes[motors].copy()
    rotors = slice(None, None, len(OF_MOTORS))  # the first of each motor's parameters
    rotor_values = parameters.values[motors][rotors]
    spread[rotors] = np.maximum(rotor_values, NO_ROTOR * spread[rotors])
    return spread


def _body_sizes(body: Array) -> Array:
    """Compute sizes (10,) of a body's parameters: mass times powers of its radius.

    Powers 0, 1, 2 of the radius of gyration. A point mass at the origin has the radius 0: its moments remain
    zero.
    """
    trace = np.trace(pseudo_inertia(body)[:3, :3])
    radius = np.sqrt(max(trace, 0.0) / body[0])
    return body[0] * radius**LENGTH_POWERS


def read_inertial_parameters(link: Element) -> Array:
    """Read the ten parameters (10,) of a link about its origin; zeros without."""
    inertial = link.find("inertial")
    if inertial is None:
        return np.zeros(10)
    where = f"link {link.get('name')!r}: <inertial>"
    mass = attribute(child_element(inertial, where, "mass"), where, "value")
    inertia = child_element(inertial, where, "inertia")
    entries = [float(attribute(inertia, where, key)) for key in MOMENTS]
    pose = read_origin(inertial.find("origin"), where)
    return parameter_transform(pin.SE3(pose)) @ np.array([float(mass), 0.0, 0.0, 0.0, *entries])


def fit_possible_parameters(
    robot: ParallelRobot, links: LinkParameters, information: Array, residual: Array, prior: float
) -> Array:
    """Compute the most probable possible parameters (u,) of links and motors.

    They minimise |A T (theta - theta_file) - r|^2 + |(theta - theta_file) / deviation|^2, with T of
    `to_parameters`. With theta = best + change y, where best is the unconstrained minimum and `change` makes
    the quadratic form |y|^2, this is the shortest y for which all parameters are possible.

    Args:
        information: A' A (p, p) of rows of unit noise; residual: A' r (p,).
        prior: standard deviation of the file's values, as a share of the size of each link's parameters.

    Raises:
        NotConverged: the solver does not converge.
    """
    best, change = _minimise_misfit(links, information, residual, prior * links.spread)
    bodies = [slice(10 * i, 10 * i + 10) for i in range(len(links.links))]
    matrices = [_inertia_cone(links.values[body], change[body], best[body]) for body in bodies]
    motors = slice(10 * len(links.links), None)
    unit = prior * links.spread[motors]
    positive = Affine(change[motors] / unit[:, None], best[motors] / unit)
    y = semidefinite_least_squares(matrices, positive)
    if isinstance(y, Unsolved):
        raise NotConverged(
            f"{robot.name}: no parameters of bodies that can exist were found ({y.status})",
            residual=float(np.linalg.norm(residual)),
        )
    values = best + change @ y
    values[motors] = np.maximum(values[motors], 0.0)
    for body in bodies:
        if (values[body] != links.values[body]).any():
            link = Element("link")
            _write_inertial(link, values[body])
            values[body] = read_inertial_parameters(link)  # of a body that can exist, as a file has it
    return values


def _minimise_misfit(
    links: LinkParameters, information: Array, residual: Array, deviation: Array
) -> tuple[Array, Array]:
    """Minimise misfit and prior without constraints: minimum (u,), change (u, u).

    About the minimum both together are |y|^2 for parameters minimum + change y. In units of the deviations
    (u,), with T of `to_parameters`, the quadratic form has the matrix T' A'A T + 1 = V diag(w) V', and the
    minimum is at V diag(1 / w) V' T' A'r off the file's values.
    """
    T = links.to_parameters * deviation  # (p, u)
    w, V = np.linalg.eigh(T.T @ information @ T + np.eye(len(deviation)))
    root = np.sqrt(np.maximum(w, 1.0))  # with the prior no eigenvalue is below 1
    change = deviation[:, None] * V / root
    return links.values + change @ (V.T @ (T.T @ residual) / root), change


def _inertia_cone(file: Array, change: Array, best: Array) -> LinearMatrix:
    """Return the scaled pseudo-inertia D P D of a link, affine in y (u,).

    Parameters are best + change y. D is chosen by the file's values (10,), and a small multiple of 1 is added
    for rounding.
    """
    D = _balancing_scale(file)
    slopes = np.moveaxis(D @ pseudo_inertia(change.T) @ D, 0, 2)
    offset = D @ pseudo_inertia(best) @ D
    return LinearMatrix(slopes, offset + ROUNDED_BODY * np.eye(4))


def _balancing_scale(parameters: Array) -> Array:
    """Compute the diagonal D (4, 4) that gives D P D mass 1 and largest moment 1.

    P is the pseudo-inertia of parameters (10,); its moments are the second moments.
    """
    diagonal = np.diag(pseudo_inertia(parameters))
    largest = diagonal[:3].max() or diagonal[3]
    return np.diag(1.0 / np.sqrt([largest, largest, largest, diagonal[3]]))


def with_masses_and_motors(robot: ParallelRobot, links: LinkParameters, values: Array) -> RobotDescription:
    """Return the robot's description with parameters (u,) of links and motors."""
    description = robot.description
    urdf = fromstring(description.urdf_text)
    elements = {link.get("name", ""): link for link in urdf.findall("link")}
    for i, name in enumerate(links.links):
        body = slice(10 * i, 10 * i + 10)
        if (values[body] != links.values[body]).any():
            _write_inertial(elements[name], values[body])
    motors = values[10 * len(links.links) :].reshape(-1, len(OF_MOTORS))
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
    """Write a link's <inertial> of ten parameters (10,) about its origin.

    <inertial> is about the centre of mass c. Second moments there are S - m c c', and the inertia is tr(S) -
    S.
    """
    mass = float(parameters[0])
    centre = parameters[1:4] / parameters[0]
    second_moments = pseudo_inertia(parameters)[:3, :3] - mass * np.outer(centre, centre)
    moments, axes = np.linalg.eigh(second_moments)  # not negative but for the solver's rounding
    second_moments = (axes * np.maximum(moments, 0.0)) @ axes.T
    inertia = np.trace(second_moments) * np.eye(3) - second_moments
    remove_children(link, "inertial")
    link.insert(0, inertial_element(mass, centre, inertia))
