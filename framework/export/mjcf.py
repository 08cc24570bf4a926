"""A robot as MuJoCo's model: the open tree with its springs, the loops as equalities between sites.

Joints keep their names, axes and zeros; the frames of the platform and of the loops become sites. A rotor is
the armature gear ratio^2 times its inertia, a motor an actuator of that gear whose control is its torque, a
spring a joint with stiffness. MuJoCo closes points and welded frames; a hinge is closed by two points on its
axis, and a closure of another kind is refused by its name. MuJoCo wants mass in each body that moves: where
the robot has none, MASS and INERTIA stand in. Bodies have no shape; limits are not written.

Source: MuJoCo's documentation, chapter "XML Reference". Loops are as hard as the step allows.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable

import numpy as np
import pinocchio as pin

from framework.arrays import Array
from framework.errors import InvalidInput
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.description import locked_axes

MASS, INERTIA = 1e-9, 1e-12  # [kg], [kg m^2] of bodies without; MuJoCo refuses less than 1e-15
STEP = 1e-3  # [s]
HARD = "0.9999 0.9999 0.001 0.5 2"  # solimp: what is nearest to a rigid loop
ALONG = 0.1  # robot lengths between the two points that close a hinge
POINT, WELD = locked_axes("spherical"), locked_axes("fixed")
HINGES = {locked_axes("revolute", axis): k for k, axis in enumerate("xyz")}  # and the axis that is free


def mjcf_text(robot: ParallelRobot) -> str:
    """The robot with its springs as MJCF; the keyframe `reference` is its assembled reference.

    Raises:
        InvalidInput: a loop that MuJoCo has no equality for; names it.
    """
    root = ElementTree.Element("mujoco", model=robot.name)
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="false")
    ElementTree.SubElement(
        root,
        "option",
        timestep=repr(STEP),
        gravity=_numbers(robot.model.gravity.linear),
        integrator="implicitfast",
    )
    bodies = [ElementTree.SubElement(root, "worldbody")]
    q, data = robot.reference.q, robot.model.createData()
    pin.forwardKinematics(robot.model, data, q, np.zeros(robot.model.nv))
    for j in range(1, robot.model.njoints):
        bodies.append(_body(robot, data, j, bodies[robot.model.parents[j]]))
    _add_loops(robot, root, bodies)
    actuator = ElementTree.SubElement(root, "actuator")
    for motor in robot.description.actuators:
        ElementTree.SubElement(
            actuator,
            "motor",
            name=f"{motor.joint}_torque",
            joint=motor.joint,
            gear=repr(float(motor.gear_ratio)),
        )
    keys = ElementTree.SubElement(root, "keyframe")
    ElementTree.SubElement(keys, "key", name="reference", qpos=_numbers(q))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _body(robot: ParallelRobot, data: pin.Data, j: int, parent: ElementTree.Element) -> ElementTree.Element:
    """The body behind joint j, in that of its parent."""
    model = robot.model
    name, column = str(model.names[j]), model.joints[j].idx_v
    body = ElementTree.SubElement(
        parent, "body", {"name": f"{name}_body"} | _placed(model.jointPlacements[j])
    )
    linear, angular = np.split(np.asarray(data.joints[j].S).ravel(), 2)  # the axis, fixed in the joint
    slides = np.linalg.norm(angular) == 0
    joint = {
        "name": name,
        "type": "slide" if slides else "hinge",
        "axis": _numbers(linear if slides else angular),
    }
    armature = np.zeros(model.nv)
    armature[robot.actuated] = robot.rotor_inertia * robot.gear_ratio**2
    stiffness = robot.joint_stiffness.copy()
    stiffness[robot.elastic] = robot.stiffness
    for key, value in (
        ("armature", armature[column]),
        ("stiffness", stiffness[column]),
        ("springref", robot.joint_rest[column]),
    ):
        if value:
            joint[key] = repr(float(value))
    ElementTree.SubElement(body, "joint", joint)
    inertia = model.inertias[j]
    moments = _accepted(np.asarray(inertia.inertia))
    ElementTree.SubElement(
        body,
        "inertial",
        pos=_numbers(inertia.lever),
        mass=repr(max(float(inertia.mass), MASS)),
        fullinertia=_numbers(moments[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]),
    )
    return body


def _accepted(inertia: Array) -> Array:
    """An inertia matrix that MuJoCo takes: with principal moments that a body can have.

    Planar robots are often given one moment of three; each of the others becomes half of it, which nothing in
    the plane feels.
    """
    moments, axes = np.linalg.eigh(inertia)
    if moments[0] + moments[1] < moments[2]:
        moments[:2] = np.maximum(moments[:2], 0.5 * moments[2])
    return np.asarray(axes @ np.diag(np.maximum(moments, INERTIA)) @ axes.T)


def _add_loops(robot: ParallelRobot, root: ElementTree.Element, bodies: list[ElementTree.Element]) -> None:
    """The equalities, and the sites that they and the platform stand on."""
    closures = robot.description.closures
    names = dict.fromkeys(
        [robot.description.platform.frame, *(name for one in closures for name in one.frames)]
    )
    frames = dict(zip(names, robot.frames, strict=True))

    def site(name: str, frame: str, offset: Array) -> None:
        at = robot.model.frames[frames[frame]]
        placed = at.placement * pin.SE3(np.eye(3), offset)
        ElementTree.SubElement(bodies[at.parentJoint], "site", {"name": name} | _placed(placed))

    equality = ElementTree.SubElement(root, "equality")
    hard = {"solref": f"{2 * STEP!r} 1", "solimp": HARD}
    for name in names:
        site(name, name, np.zeros(3))
    for closure in closures:
        first, second = closure.frames
        if closure.axes == WELD:
            joined = {"name": closure.name, "site1": first, "site2": second}
            ElementTree.SubElement(equality, "weld", joined | hard)
            continue
        if closure.axes != POINT and closure.axes not in HINGES:
            raise InvalidInput(
                f"{robot.name}: MuJoCo has no equality for closure {closure.name!r}, which locks "
                f"{', '.join(closure.axes)} (valid: kinds spherical, revolute and fixed)"
            )
        pairs = {closure.name: (first, second)}
        if closure.axes in HINGES:
            offset = ALONG * robot.length * np.eye(3)[HINGES[closure.axes]]
            pairs[f"{closure.name}_axis"] = (f"{first}_{closure.name}_axis", f"{second}_{closure.name}_axis")
            for name, frame in zip(pairs[f"{closure.name}_axis"], (first, second), strict=True):
                site(name, frame, offset)
        for name, (one, two) in pairs.items():
            ElementTree.SubElement(equality, "connect", {"name": name, "site1": one, "site2": two} | hard)


def _placed(placement: pin.SE3) -> dict[str, str]:
    turned = pin.Quaternion(placement.rotation)
    return {
        "pos": _numbers(placement.translation),
        "quat": _numbers([turned.w, turned.x, turned.y, turned.z]),
    }


def _numbers(values: Iterable[float] | Array) -> str:
    return " ".join(repr(float(value) + 0.0) for value in np.asarray(values))
