"""The geometric parameters of a robot: errors of the origins of the joints in its URDF.

Each joint between the base and a frame of the platform or of a closure, fixed joints included, has six:
displacements along, then turns about the axes of its origin. They are virtual joints, like springs, so that
the robot's own equations have loop equations, frames and derivatives along the parameters.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from framework.arrays import Array, ReadOnlyArrays
from framework.errors import check_choice
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.description import AXES, RobotDescription, Spring
from framework.model.placement import about, placement
from framework.model.urdf_writing import joint_element, origin_element
from framework.model.xml_reading import origin_of

ERRORS = "errors"  # ending of a virtual joint's name
PLACED = "placed"  # ending of the fixed joint with the origin of a joint that moves


@dataclass(frozen=True, eq=False)
class Geometry(ReadOnlyArrays):
    """A robot with errors of its joint origins: `model` has an elastic virtual joint for each parameter.

    joints: whose origins are parameters; names: (p,) JOINT.x .. JOINT.rz.
    turning: (p,) whether a parameter is an angle [rad], not a length [m].
    """

    robot: ParallelRobot
    model: ParallelRobot
    joints: tuple[str, ...]
    names: tuple[str, ...]
    turning: np.ndarray

    def description(self, values: Array) -> RobotDescription:
        """Return the robot's description with its joint origins moved by parameters (p,)."""
        description = self.robot.description
        urdf = ElementTree.fromstring(description.urdf_text)
        elements = {joint.get("name", ""): joint for joint in urdf.findall("joint")}
        for joint, move in zip(self.joints, values.reshape(-1, 6), strict=True):
            if move.any():
                _move_origin(elements[joint], move)
        return replace(description, urdf_text=ElementTree.tostring(urdf, encoding="unicode"))


def geometry_of(robot: ParallelRobot, joints: Sequence[str] | None = None) -> Geometry:
    """Return a robot with its geometric parameters.

    Args:
        joints: whose origins are parameters; by default all between the base and frames of platform or loops.

    Raises:
        InvalidInput: unknown joints; too many.
    """
    description = robot.description
    urdf = ElementTree.fromstring(description.urdf_text)
    elements = {joint.get("name", ""): joint for joint in urdf.findall("joint")}
    leading = _leading(description, elements)
    for name in joints or ():
        check_choice("joint", name, leading)
    chosen = tuple(name for name in leading if joints is None or name in joints)
    springs = []
    for name in chosen:
        after = name if elements[name].get("type") == "fixed" else _split(urdf, elements[name])
        springs.append(Spring(f"{name}_{ERRORS}", "joint", after, AXES, (1.0,) * len(AXES)))
    text = ElementTree.tostring(urdf, encoding="unicode")
    varied = replace(description, urdf_text=text, springs=tuple(springs))
    return Geometry(
        robot=robot,
        model=ParallelRobot.from_description(varied, flexibility="flexible_joints"),
        joints=chosen,
        names=tuple(f"{name}.{axis}" for name in chosen for axis in AXES),
        turning=np.tile([axis.startswith("r") for axis in AXES], len(chosen)),
    )


def _leading(description: RobotDescription, elements: dict[str, ElementTree.Element]) -> list[str]:
    """Return the joints between the root and the frames of the platform and of closures, as in the URDF."""
    above = {_end(joint, "child"): joint for joint in elements.values()}
    used = {description.platform.frame, *(name for c in description.closures for name in c.frames)}
    leading = set()
    for frame in used:
        link = frame if frame in above or frame not in elements else _end(elements[frame], "child")
        while link in above:
            leading.add(above[link].get("name", ""))
            link = _end(above[link], "parent")
    return [name for name in elements if name in leading]


def _end(joint: ElementTree.Element, end: str) -> str:
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def _split(urdf: ElementTree.Element, joint: ElementTree.Element) -> str:
    """Insert a fixed joint with the origin of a moving joint before the latter; return its name."""
    name = f"{joint.get('name')}_{PLACED}"
    link = f"{name}_link"
    ElementTree.SubElement(urdf, "link", name=link)
    parent, origin = joint.find("parent"), joint.find("origin")
    fixed = joint_element(name, "fixed", _end(joint, "parent"), link, origin=origin)
    if parent is not None:
        parent.set("link", link)
    if origin is not None:
        joint.remove(origin)
    urdf.append(fixed)
    return name


def _move_origin(joint: ElementTree.Element, move: Array) -> None:
    """Move the origin of a joint by displacements along and turns about its axes (6,)."""
    old = joint.find("origin")
    place = origin_of(old, f"joint {joint.get('name')!r}") @ placement(None, move[:3])
    for axis, angle in zip(np.eye(3), move[3:], strict=True):
        place = place @ placement(about(axis, angle))
    if old is not None:
        joint.remove(old)
    joint.append(origin_element(place))
