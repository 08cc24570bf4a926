"""Physically possible parameters of bodies and motors, nearest to the file and to the data.

The misfit to the data is a quadratic form of all parameters; a prior keeps parameters that they do not
determine at the file's values. Every body's pseudo-inertia is positive semidefinite (Wensing, Kim and
Slotine, IEEE Robotics and Automation Letters 3(1), 2018), rotor inertia, damping and friction are not
negative: a semidefinite program. Links fixed to one another make one body, whose parameters the prior divides
among them.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.arrays import Array
from framework.dynamics.body_parameters import (
    parameter_transform,
    pseudo_inertia,
)
from framework.errors import NotConverged
from framework.identification.torque_parameters import LENGTH_POWERS, OF_MOTORS, TorqueParameters
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import link_axes
from framework.model.description import JointDynamics, RobotDescription
from framework.model.urdf_writing import inertial_element, remove_children
from framework.model.xml_reading import attribute, child_element, origin_of
from framework.motion.cone_program import Affine, LinearMatrix, Unsolved, semidefinite_least_squares

MOMENTS = ("ixx", "ixy", "iyy", "ixz", "iyz", "izz")  # in the order of pinocchio
NO_ROTOR = 1e-9  # of the size of a motor's inertia: spread of a rotor that the file does not have
ROUNDED_BODY = 1e-9  # of mass and second moments: negative parts that rounding may leave


class LinkParameters(NamedTuple):
    """The u parameters of single links, (10,) each on its own axes, and of motors."""

    links: tuple[str, ...]  # with mass in the file
    values: Array  # (u,) ten of each link, then three of each motor
    spread: Array  # (u,) sizes of each link and motor
    to_parameters: Array  # (p, u) to those of bodies and motors, `TorqueParameters`


def link_parameters_of(robot: ParallelRobot, parameters: TorqueParameters) -> LinkParameters:
    """Return the parameters of all links with mass and of the motors."""
    urdf = ElementTree.fromstring(robot.description.urdf_text)
    own = {link.get("name", ""): inertial_parameters(link) for link in urdf.findall("link")}
    links, blocks = [], []
    for i, j in enumerate(map(int, parameters.bodies)):
        for frame in robot.model.frames:
            is_link = frame.parentJoint == j and frame.type == pin.FrameType.BODY
            if is_link and own.get(frame.name, np.zeros(1))[0] > 0.0:
                block = np.zeros((len(parameters.names), 10))
                place = link_axes(robot.model, j).inverse() * frame.placement
                block[10 * i : 10 * i + 10] = parameter_transform(place)
                links.append(str(frame.name))
                blocks.append(block)
    motors = slice(10 * len(parameters.bodies), None)
    spread = parameters.sizes[motors].copy()
    rotors = slice(None, None, len(OF_MOTORS))
    spread[rotors] = np.maximum(parameters.values[motors][rotors], NO_ROTOR * spread[rotors])
    return LinkParameters(
        links=tuple(links),
        values=np.concatenate([*(own[link] for link in links), parameters.values[motors]]),
        spread=np.concatenate([*(_body_sizes(own[link]) for link in links), spread]),
        to_parameters=np.concatenate([*blocks, np.eye(len(parameters.names))[:, motors]], axis=1),
    )


def _body_sizes(body: Array) -> Array:
    """Return sizes (10,) of a body's parameters, by its mass and its extent; a point stays a point."""
    moments = np.trace(pseudo_inertia(body)[:3, :3])
    arm = np.sqrt(max(moments, 0.0) / body[0])
    return body[0] * arm**LENGTH_POWERS


def inertial_parameters(link: ElementTree.Element) -> Array:
    """Return the ten parameters of a URDF's link, about its origin; zeros without <inertial>."""
    inertial = link.find("inertial")
    if inertial is None:
        return np.zeros(10)
    where = f"link {link.get('name')!r}: <inertial>"
    mass = attribute(child_element(inertial, where, "mass"), where, "value")
    inertia = child_element(inertial, where, "inertia")
    entries = [float(attribute(inertia, where, key)) for key in MOMENTS]
    place = origin_of(inertial.find("origin"), where)
    return parameter_transform(pin.SE3(place)) @ np.array([float(mass), 0.0, 0.0, 0.0, *entries])


def possible_parameters(
    robot: ParallelRobot, links: LinkParameters, information: Array, residual: Array, prior: float
) -> Array:
    """Compute possible parameters (u,) of links and motors, nearest to the data and the file.

    They minimise |A (theta - theta_file) - r|^2 and their distance from the file's.

    Args:
        information: A' A (p, p) of rows of unit noise; residual: A' r (p,).
        prior: standard deviation of the file's values, as a share of each link's own size.

    Raises:
        NotConverged: the solver does not settle.
    """
    spread = prior * links.spread
    along = links.to_parameters * spread
    # unknowns in which the quadratic form is a distance; with the prior no square is below 1
    squares, axes = np.linalg.eigh(along.T @ information @ along + np.eye(len(spread)))
    squares = np.maximum(squares, 1.0)
    change = spread[:, None] * axes / np.sqrt(squares)  # of the parameters along the unknowns
    best = links.values + change @ (axes.T @ (along.T @ residual) / np.sqrt(squares))  # possible or not
    bodies = [slice(10 * i, 10 * i + 10) for i in range(len(links.links))]
    matrices = [_inertia_cone(links.values[body], change[body], best[body]) for body in bodies]
    motors = slice(10 * len(links.links), None)
    positive = Affine(change[motors] / spread[motors, None], best[motors] / spread[motors])
    solution = semidefinite_least_squares(matrices, positive)
    if isinstance(solution, Unsolved):
        raise NotConverged(
            f"{robot.name}: no parameters of bodies that can exist were found ({solution.status})",
            residual=float(np.linalg.norm(residual)),
        )
    values = best + change @ solution
    values[motors] = np.maximum(values[motors], 0.0)
    return values


def _inertia_cone(file: Array, change: Array, best: Array) -> LinearMatrix:
    """Return a body's pseudo-inertia, linear in u unknowns by changes (10, u) of its parameters."""
    balance = _balance(file)
    slopes = np.moveaxis(balance @ pseudo_inertia(change.T) @ balance, 0, 2)
    offset = balance @ pseudo_inertia(best) @ balance
    return LinearMatrix(slopes, offset + ROUNDED_BODY * np.eye(4))


def _balance(parameters: Array) -> Array:
    """Return the diagonal matrix (4, 4) that makes mass and the largest second moment of mass 1."""
    diagonal = np.diag(pseudo_inertia(parameters))
    largest = diagonal[:3].max() or diagonal[3]
    return np.diag(1.0 / np.sqrt([largest, largest, largest, diagonal[3]]))


def with_masses_and_motors(robot: ParallelRobot, links: LinkParameters, values: Array) -> RobotDescription:
    """Return the robot's description with parameters (u,) of links and motors, its URDF rewritten."""
    description = robot.description
    urdf = ElementTree.fromstring(description.urdf_text)
    elements = {link.get("name", ""): link for link in urdf.findall("link")}
    for i, name in enumerate(links.links):
        body = slice(10 * i, 10 * i + 10)
        if (values[body] != links.values[body]).any():
            _write_inertial(elements[name], values[body])
    motors = values[10 * len(links.links) :].reshape(-1, len(OF_MOTORS))
    actuators, joints = [], dict(description.joints)
    for actuator, (rotor, damping, friction) in zip(description.actuators, motors.tolist(), strict=True):
        actuators.append(replace(actuator, rotor_inertia=rotor))
        own = joints.get(actuator.joint, JointDynamics())
        joints[actuator.joint] = replace(own, damping=damping, friction=friction)
    return replace(
        description,
        urdf_text=ElementTree.tostring(urdf, encoding="unicode"),
        actuators=tuple(actuators),
        joints=joints,
    )


def _write_inertial(link: ElementTree.Element, parameters: Array) -> None:
    """Write the ten parameters of a link about its origin into its <inertial>, about the centre of mass."""
    mass, centre = float(parameters[0]), parameters[1:4] / parameters[0]
    moments = pseudo_inertia(parameters)[:3, :3] - mass * np.outer(centre, centre)
    squares, axes = np.linalg.eigh(moments)  # not negative but for the solver's rounding
    moments = (axes * np.maximum(squares, 0.0)) @ axes.T
    remove_children(link, "inertial")
    link.insert(0, inertial_element(mass, centre, np.trace(moments) * np.eye(3) - moments))
