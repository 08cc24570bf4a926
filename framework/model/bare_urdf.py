"""The part of a URDF that moves: what pinocchio gets to parse.

Its parser prints to the console whatever it finds wrong in visuals and collisions, which kinematics and
dynamics do not need, and reads numbers by rules of its own. So it is given links with their inertia and
joints with their origin, axis and limit, and each number as Python has read it.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

from framework.model.urdf_elements import MOVING

_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_LIMIT = ("lower", "upper", "effort", "velocity")


def bare_urdf(root: ElementTree.Element) -> ElementTree.Element:
    """Return a copy of the URDF without shapes, materials and what else does not move.

    The URDF must be one that `check_urdf` or `UrdfTree` has checked.
    """
    bare = ElementTree.Element("robot", name=root.get("name", ""))
    for link in root.findall("link"):
        copy = ElementTree.SubElement(bare, "link", name=link.get("name", ""))
        inertial = link.find("inertial")
        if inertial is not None:
            within = ElementTree.SubElement(copy, "inertial")
            _copy(inertial, within, "origin", ("xyz", "rpy"))
            _copy(inertial, within, "mass", ("value",))
            _copy(inertial, within, "inertia", _INERTIA)
    for joint in root.findall("joint"):
        copy = ElementTree.SubElement(bare, "joint", name=joint.get("name", ""), type=joint.get("type", ""))
        for end in ("parent", "child"):
            ends = joint.find(end)
            assert ends is not None  # checked by the reader
            ElementTree.SubElement(copy, end, link=ends.get("link", ""))
        _copy(joint, copy, "origin", ("xyz", "rpy"))
        if joint.get("type") in MOVING:
            _copy(joint, copy, "axis", ("xyz",))
            _copy(joint, copy, "limit", _LIMIT)
    return bare


def _copy(source: ElementTree.Element, target: ElementTree.Element, tag: str, keys: tuple[str, ...]) -> None:
    """Copy a child with these attributes, all of numbers, if it is there."""
    element = source.find(tag)
    if element is not None:
        values = {key: element.get(key, "").split() for key in keys if key in element.attrib}
        numbers = {key: " ".join(repr(float(part)) for part in parts) for key, parts in values.items()}
        ElementTree.SubElement(target, tag, numbers)
