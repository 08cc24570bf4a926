"""What a robot file adds to a URDF of somebody else: frames on its links, and a root that is free to move.

Both are written into the URDF text, so that everything downstream sees one tree of one-degree joints.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from typing import NamedTuple

GROUND = "ground"
ROOT_JOINTS = ("root_x", "root_y", "root_z", "root_rz", "root_ry", "root_rx")


class AddedFrame(NamedTuple):
    """A frame fixed to the link `parent` at `xyz` [m] and `rpy` [rad]."""

    name: str
    parent: str
    xyz: tuple[float, float, float]
    rpy: tuple[float, float, float]


def add_frames(urdf_text: str, frames: Sequence[AddedFrame]) -> str:
    """The URDF with a massless link, fixed to its parent, for each frame."""
    if not frames:
        return urdf_text
    root = ElementTree.fromstring(urdf_text)
    for frame in frames:
        joint = _joint(root, f"{frame.name}_mount", "fixed", frame.parent, frame.name)
        ElementTree.SubElement(
            joint, "origin", xyz=" ".join(map(repr, frame.xyz)), rpy=" ".join(map(repr, frame.rpy))
        )
    return ElementTree.tostring(root, encoding="unicode")


def free_root(urdf_text: str) -> str:
    """The URDF on a new root link `ground`, its old root carried by six joints, ROOT_JOINTS.

    Three slides along the base axes, then turns about z, y and x: singular only when the root pitches by
    90 degrees.
    """
    root = ElementTree.fromstring(urdf_text)
    children = {child.get("link") for child in root.iter("child")}
    (old,) = (link.get("name", "") for link in root.findall("link") if link.get("name") not in children)
    parent = GROUND
    ElementTree.SubElement(root, "link", name=GROUND)
    for name in ROOT_JOINTS:
        kind = "revolute" if "_r" in name else "prismatic"
        child = old if name == ROOT_JOINTS[-1] else f"{name}_link"
        joint = _joint(root, name, kind, parent, child, add_child=child != old)
        axis = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}[name[-1]]
        ElementTree.SubElement(joint, "axis", xyz=axis)
        ElementTree.SubElement(joint, "limit", lower="-1e9", upper="1e9", effort="0", velocity="1e9")
        parent = child
    return ElementTree.tostring(root, encoding="unicode")


def _joint(
    root: ElementTree.Element, name: str, kind: str, parent: str, child: str, add_child: bool = True
) -> ElementTree.Element:
    if add_child:
        ElementTree.SubElement(root, "link", name=child)
    joint = ElementTree.SubElement(root, "joint", name=name, type=kind)
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    return joint
