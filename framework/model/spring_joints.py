"""Write springs into the URDF as virtual joints, before pinocchio parses it.

    parent --after--> child      becomes      parent --after--> (massless) --spring--> child

so a motor turns the near side of its spring, and a link gives way at its far end. The rigid robot is
the untouched URDF; everything else treats the new joints like any other.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence

from framework.model.description import Spring
from framework.model.urdf_writing import AXIS, joint_element, no_limit, remove_children


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
