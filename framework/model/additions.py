"""Changes of a foreign URDF by a robot file: frames and bodies on links, locked joints, a free root.

All are written into the URDF, so that everything downstream sees one tree of one-degree joints.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from framework.errors import check_name
from framework.model.placement import about, placement
from framework.model.urdf_elements import MOVING, SEVERAL, Joint, read_tree
from framework.model.urdf_writing import (
    AXIS,
    inertial_element,
    joint_element,
    origin_element,
    remove_children,
    vector_text,
    visual_element,
)

GROUND = "ground"
ROOT_JOINTS = ("root_x", "root_y", "root_z", "root_rz", "root_ry", "root_rx")


class AddedFrame(NamedTuple):
    """A frame fixed to the link `parent` at `xyz` [m] and `rpy` [rad], with or without a body.

    `mass` [kg] has its centre at the frame's origin and `inertia` [kg m^2] about its axes.
    """

    name: str
    parent: str
    xyz: tuple[float, float, float]
    rpy: tuple[float, float, float]
    mass: float = 0.0
    inertia: tuple[float, float, float] = (0.0, 0.0, 0.0)


def add_frames(root: ElementTree.Element, frames: Sequence[AddedFrame]) -> None:
    """Add to a URDF a link, fixed to its parent, for each frame; without mass unless the frame has one.

    A body with inertia looks like the box of even density that has this mass and inertia.
    """
    for frame in frames:
        link = ElementTree.SubElement(root, "link", name=frame.name)
        place = ElementTree.Element("origin", xyz=vector_text(frame.xyz), rpy=vector_text(frame.rpy))
        root.append(joint_element(f"{frame.name}_mount", "fixed", frame.parent, frame.name, origin=place))
        if frame.mass:
            link.append(inertial_element(frame.mass, np.zeros(3), np.diag(frame.inertia)))
            _add_box(link, frame)


def _add_box(link: ElementTree.Element, frame: AddedFrame) -> None:
    """Add a box with edges a_x^2 = 6 (I_yy + I_zz - I_xx) / m and so on, if all are positive."""
    squares = 6.0 / frame.mass * (sum(frame.inertia) - 2.0 * np.array(frame.inertia))
    if squares.min() <= 0.0:
        return
    visual = visual_element("box", {"size": vector_text(np.sqrt(squares))}, np.eye(4))
    link.append(visual)
    material = ElementTree.SubElement(visual, "material", name=f"{frame.name}_colour")
    ElementTree.SubElement(material, "color", rgba="0.93 0.72 0.13 1")  # of platforms in the catalogue


def lock_joints(root: ElementTree.Element, locked: Mapping[str, float]) -> None:
    """Fix some joints of a URDF at given values [rad, m]; a locked joint mimics no other.

    Raises:
        RobotFileError: a name is not that of a revolute, continuous or prismatic joint.
    """
    joints = read_tree(root).joints
    movable = [name for name, joint in joints.items() if joint.kind in MOVING]
    for name, value in locked.items():
        check_name(f"locked.{name}", "joint", name, movable)
        fix_joint(joints[name], value)


def fix_joint(joint: Joint, *values: float) -> None:
    """Make a joint fixed, its origin moved along with its coordinates [rad, m]."""
    if joint.kind in SEVERAL:
        *along, x, y, z = values
        angle = math.hypot(x, y, z)
        motion = placement(about((x, y, z), angle) if angle else None, along or (0.0, 0.0, 0.0))
    elif joint.kind == "prismatic":
        motion = placement(None, values[0] * joint.axis / np.linalg.norm(joint.axis))
    else:
        motion = placement(about(joint.axis, values[0]))
    joint.origin = joint.origin @ motion
    joint.kind = "fixed"
    joint.element.set("type", "fixed")
    remove_children(joint.element, "axis", "limit", "mimic", "origin")
    joint.element.append(origin_element(joint.origin))


def free_root(root: ElementTree.Element) -> None:
    """Stand a URDF on a new root link `ground`, its old root carried by six joints, ROOT_JOINTS.

    Three slides along the base axes, then turns about z, y and x: singular only when the root pitches by
    90 degrees.
    """
    children = {child.get("link") for child in root.iter("child")}
    (old,) = (link.get("name", "") for link in root.findall("link") if link.get("name") not in children)
    parent = GROUND
    ElementTree.SubElement(root, "link", name=GROUND)
    for name in ROOT_JOINTS:
        kind = "revolute" if "_r" in name else "prismatic"
        child = old if name == ROOT_JOINTS[-1] else f"{name}_link"
        if child != old:
            ElementTree.SubElement(root, "link", name=child)
        root.append(joint_element(name, kind, parent, child, axis=AXIS[name[-1]], effort="0"))
        parent = child
