"""The part of a URDF that moves, as input of pinocchio's parser.

The parser prints errors in visuals and collisions to the console, which kinematics and
dynamics do not need, and reads numbers by rules of its own. Its input has links with their inertia and
joints with their origin, axis and limit, and each number as Python has read it.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence

from framework.model.urdf_elements import MOVING
from framework.model.urdf_writing import vector_text

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
