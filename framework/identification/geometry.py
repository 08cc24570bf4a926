"""The geometric parameters of a robot: errors of the joint origins in its URDF.

Each joint between the base and a frame of the platform or of a closure, fixed joints included, has six
parameters: translations along the axes of its origin, then rotations about them. Each parameter is a virtual
joint, like that of a spring. So the equations of the robot with these joints also give derivatives with
respect to the parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from xml.etree.ElementTree import Element, SubElement, fromstring, tostring

import numpy as np

from framework.errors import check_choice
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.description import AXES, RobotDescription, Spring
from framework.model.documents import child_element, read_origin, remove_children
from framework.model.placement import placement, rotation_about
from framework.model.urdf_edits import NewJoint, joint_element, origin_element
from framework.numerics.arrays import Array, ReadOnlyArrays

ERRORS = "errors"  # suffix of the names of virtual joints
PLACED = "placed"  # suffix of the fixed joint that takes over the origin of a moving joint


@dataclass(frozen=True, eq=False)
class Geometry(ReadOnlyArrays):
    """A robot with p errors of its joint origins as parameters."""

    robot: ParallelRobot
    model: ParallelRobot  # the robot with an elastic virtual joint for each parameter
    joints: tuple[str, ...]  # (p / 6,) joints whose origins have errors
    names: tuple[str, ...]  # (p,) names of the parameters, JOINT.x .. JOINT.rz
    turning: np.ndarray  # (p,) true for an angle [rad], false for a length [m]

    def description(self, values: Array) -> RobotDescription:
        """Return the robot's description with joint origins moved by parameters (p,)."""
        description = self.robot.description
        urdf = fromstring(description.urdf_text)
        elements = elements_by_name(urdf, "joint")
        for joint, move in zip(self.joints, values.reshape(-1, 6), strict=True):
            if move.any():
                _move_origin(elements[joint], move)
        return replace(description, urdf_text=tostring(urdf, encoding="unicode"))


def parametrise_geometry(robot: ParallelRobot, joints: Sequence[str] | None = None) -> Geometry:
    """Add six geometric parameters to the origin of each joint.

    Each joint gets a spring of six virtual joints directly behind its origin. Behind the origin of a fixed
    joint this is behind the joint itself. For a moving joint a new fixed joint takes over the origin, and the
    virtual joints come between it and the moving joint.

    Args:
        joints: names of the joints; by default all joints between the base and the frames of the platform and
            of closures.

    Raises:
        InvalidInput: a joint is not one of these, or there are too many.
    """
    description = robot.description
    urdf = fromstring(description.urdf_text)
    elements = elements_by_name(urdf, "joint")
    candidates = _joints_to_frames(description, elements)
    for name in joints or ():
        check_choice("joint", name, candidates)
    chosen = tuple(name for name in candidates if joints is None or name in joints)
    springs = []
    for name in chosen:
        is_fixed = elements[name].get("type") == "fixed"
        origin_joint = name if is_fixed else _insert_origin_joint(urdf, elements[name])
        springs.append(Spring(f"{name}_{ERRORS}", "joint", origin_joint, AXES, (1.0,) * len(AXES)))
    urdf_text = tostring(urdf, encoding="unicode")
    with_errors = replace(description, urdf_text=urdf_text, springs=tuple(springs))
    return Geometry(
        robot=robot,
        model=ParallelRobot.from_description(with_errors, flexibility="flexible_joints"),
        joints=chosen,
        names=tuple(f"{name}.{axis}" for name in chosen for axis in AXES),
        turning=np.tile([axis.startswith("r") for axis in AXES], len(chosen)),
    )


def elements_by_name(urdf: Element, tag: str) -> dict[str, Element]:
    """Return the elements of a URDF with the tag "joint" or "link", by name."""
    return {element.get("name", ""): element for element in urdf.findall(tag)}


def _joints_to_frames(description: RobotDescription, elements: dict[str, Element]) -> list[str]:
    """Return the joints between the base and the frames of platform and closures, in URDF order.

    A frame is named by a link, or by a joint, which stands for its child link.
    """
    parent_joints = {_link_name(element, "child"): name for name, element in elements.items()}  # by link
    frames = [description.platform.frame]
    for closure in description.closures:
        frames += closure.frames
    joints = set()
    for frame in frames:
        is_joint = frame not in parent_joints and frame in elements
        link = _link_name(elements[frame], "child") if is_joint else frame
        while link in parent_joints:
            joint = parent_joints[link]
            joints.add(joint)
            link = _link_name(elements[joint], "parent")
    return [name for name in elements if name in joints]


def _link_name(joint: Element, end: str) -> str:
    """Return the name of a joint's "parent" or "child" link; empty without one."""
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def _insert_origin_joint(urdf: Element, joint: Element) -> str:
    """Insert a fixed joint that takes over the origin of a moving one; return its name."""
    name = f"{joint.get('name')}_{PLACED}"
    link = f"{name}_link"
    SubElement(urdf, "link", name=link)
    parent = child_element(joint, f"joint {joint.get('name')!r}", "parent")
    origin = joint.find("origin")
    fixed = joint_element(NewJoint(name, "fixed"), parent.get("link", ""), link)
    parent.set("link", link)
    if origin is not None:
        joint.remove(origin)
        fixed.append(origin)
    urdf.append(fixed)
    return name


def _move_origin(joint: Element, move: Array) -> None:
    """Move a joint's origin by `move` (6,): translations [m], then rotations [rad] about x, y, z.

    The virtual joints of `parametrise_geometry`, three slides and then three hinges, have the same effect.
    """
    pose = read_origin(joint, f"joint {joint.get('name')!r}") @ placement(None, move[:3])
    for axis, angle in zip(np.eye(3), move[3:], strict=True):
        pose = pose @ placement(rotation_about(axis, angle))
    remove_children(joint, "origin")
    joint.append(origin_element(pose))
