"""Write springs into the URDF as virtual joints, before pinocchio parses it.

    parent --after--> child      becomes      parent --after--> (massless) --spring--> child

so a motor turns the near side of its spring, and a link gives way at its far end. The rigid robot is
the untouched URDF; everything else treats the new joints like any other.

They are written into the part that moves (`bare_urdf`): pinocchio's parser prints errors in visuals and
collisions to the console, which kinematics and dynamics do not need, and reads numbers by rules of its own.
Its input is links with their inertia and joints with their origin, axis and limit, and each number as Python
has read it.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence

from framework.model.description import Spring
from framework.model.urdf_elements import MOVING
from framework.model.urdf_writing import AXIS, joint_element, no_limit, remove_children, vector_text

# attributes of numbers, by tag
_ORIGIN = {"origin": ("xyz", "rpy")}
_INERTIAL = {**_ORIGIN, "mass": ("value",), "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}
_MOVING = {**_ORIGIN, "axis": ("xyz",), "limit": ("lower", "upper", "effort", "velocity")}


def bare_urdf(root: ElementTree.Element) -> ElementTree.Element:
    """Return a copy of the URDF without shapes, materials and other parts that do not move.

    The URDF must be one that `check_urdf` or `UrdfTree` has checked.
    """
    bare = ElementTree.Element("robot", name=root.get("name", ""))
    for link in root.findall("link"):
        copy = ElementTree.SubElement(bare, "link", name=link.get("name", ""))
        inertial = link.find("inertial")
        if inertial is not None:
            _copy(inertial, ElementTree.SubElement(copy, "inertial"), _INERTIAL)
    for joint in root.findall("joint"):
        copy = ElementTree.SubElement(bare, "joint", name=joint.get("name", ""), type=joint.get("type", ""))
        for end in ("parent", "child"):
            ends = joint.find(end)
            assert ends is not None  # checked by the reader
            ElementTree.SubElement(copy, end, link=ends.get("link", ""))
        _copy(joint, copy, _MOVING if joint.get("type") in MOVING else _ORIGIN)
    return bare


def _copy(
    source: ElementTree.Element, target: ElementTree.Element, tables: Mapping[str, Sequence[str]]
) -> None:
    """Copy existing children and numbers of their attributes, by tag."""
    for tag, keys in tables.items():
        element = source.find(tag)
        if element is not None:
            texts = {key: element.get(key, "").split() for key in keys if key in element.attrib}
            numbers = {key: vector_text(map(float, parts)) for key, parts in texts.items()}
            ElementTree.SubElement(target, tag, numbers)


def virtual_link(name: str) -> str:
    """Name of the massless link in front of a virtual joint."""
    return f"{name}_base"


def make_continuous_joints_revolute(root: ElementTree.Element) -> None:
    """Replace continuous joints of a URDF by unlimited revolute ones.

    Pinocchio keeps a continuous joint as a point on a circle; a motor behind a gear needs the angle,
    with its full turns.
    """
    continuous = [joint for joint in root.findall("joint") if joint.get("type") == "continuous"]
    for joint in continuous:
        joint.set("type", "revolute")
        remove_children(joint, "limit")
        joint.append(no_limit())


def insert_springs(root: ElementTree.Element, springs: Sequence[Spring]) -> None:
    """Put one virtual joint for each coordinate of each spring into a URDF.

    The springs' names and `after` must be valid for this URDF, as `read_robot_file` checks. Several
    springs behind one joint follow it in the order given.
    """
    joints = {joint.get("name"): joint for joint in root.findall("joint")}
    last = dict(joints)  # the joint that now stands nearest to the child of each `after`
    for spring in springs:
        after = joints[spring.after]
        if spring.motion:
            motions = [
                ("revolute" if axis.startswith("r") else "prismatic", AXIS[axis[-1]])
                for axis in spring.motion
            ]
        else:
            axis_element = after.find("axis")
            kind = "prismatic" if after.get("type") == "prismatic" else "revolute"
            motions = [(kind, axis_element.get("xyz", "1 0 0") if axis_element is not None else "1 0 0")]
        for name, (kind, axis) in zip(spring.coordinates, motions, strict=True):
            last[spring.after] = _append(root, last[spring.after], name, kind, axis)


def _append(
    root: ElementTree.Element, before: ElementTree.Element, name: str, kind: str, axis: str
) -> ElementTree.Element:
    """Put the virtual joint `name` between the joint `before` and its child; returns the new joint."""
    end = before.find("child")
    assert end is not None  # checked by the reader
    child = end.get("link", "")
    middle = virtual_link(name)
    end.set("link", middle)
    root.append(ElementTree.Element("link", name=middle))
    joint = joint_element(name, kind, middle, child, axis=axis)
    root.append(joint)
    return joint
