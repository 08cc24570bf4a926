"""Changes of a URDF: by a robot file, by springs, and for pinocchio's parser.

A robot file adds frames and bodies to links, locks joints and frees the root. A spring is a virtual joint,

    parent --after--> child      becomes      parent --after--> (massless) --spring--> child

so a motor turns the near side of its spring, and a link gives way at its far end. Everything downstream sees
one tree.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence

import numpy as np

from framework.errors import check_name
from framework.model.description import Spring
from framework.model.inertia import ENTRIES
from framework.model.placement import about, placement
from framework.model.urdf_elements import JOINT_TYPES, MOVING, SEVERAL, Joint, read_tree
from framework.model.urdf_writing import (
    AXIS,
    ChainJoint,
    chain_elements,
    inertial_element,
    joint_element,
    no_limit,
    origin_element,
    remove_children,
    vector_text,
    visual_element,
)
from framework.model.xml_reading import child_element

GROUND = "ground"
ROOT_JOINTS = ("root_x", "root_y", "root_z", "root_rz", "root_ry", "root_rx")
# children that pinocchio reads, by tag and by type of joint
_READ_PARTS = {"link": ("inertial",), "inertial": ("origin", "mass", "inertia")}
_READ_PARTS |= dict.fromkeys(JOINT_TYPES, ("parent", "child", "origin"))
_READ_PARTS |= dict.fromkeys(MOVING, ("parent", "child", "origin", "axis", "limit"))
# and their attributes of numbers
_NUMBERS = {
    "origin": ("xyz", "rpy"),
    "mass": ("value",),
    "inertia": ENTRIES,
    "axis": ("xyz",),
    "limit": ("lower", "upper", "effort", "velocity"),
}


def add_frame(
    root: ElementTree.Element,
    name: str,
    parent: str,
    xyz: Sequence[float],
    rpy: Sequence[float],
    mass: float = 0.0,
    inertia: Sequence[float] = (0.0, 0.0, 0.0),
) -> None:
    """Add a link fixed to the link `parent` at `xyz` [m] and `rpy` [rad], with or without a body.

    The body has its centre at the frame's origin, and `inertia` [kg m^2] about its axes. It looks like the
    box of even density with this mass and inertia: edges a_x^2 = 6 (I_yy + I_zz - I_xx) / m and so on.
    """
    link = ElementTree.SubElement(root, "link", name=name)
    place = ElementTree.Element("origin", xyz=vector_text(xyz), rpy=vector_text(rpy))
    root.append(joint_element(f"{name}_mount", "fixed", parent, name, origin=place))
    if not mass:
        return
    link.append(inertial_element(mass, np.zeros(3), np.diag(inertia)))
    squares = 6.0 / mass * (sum(inertia) - 2.0 * np.array(inertia))
    if squares.min() > 0.0:
        visual = visual_element("box", {"size": vector_text(np.sqrt(squares))}, np.eye(4))
        link.append(visual)
        material = ElementTree.SubElement(visual, "material", name=f"{name}_colour")
        ElementTree.SubElement(material, "color", rgba="0.93 0.72 0.13 1")  # of platforms in the catalogue


def lock_joints(root: ElementTree.Element, locked: Mapping[str, float]) -> None:
    """Fix some joints of a URDF at given values [rad, m]; a locked joint mimics no other.

    Raises:
        RobotFileError: a name is not that of a revolute, continuous or prismatic joint.
    """
    tree = read_tree(root)
    for name, value in locked.items():
        check_name(f"locked.{name}", "joint", name, tree.movable)
        fix_joint(tree.joints[name], value)


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
    tree = read_tree(root)
    motions = [
        ChainJoint(
            name,
            "revolute" if "_r" in name else "prismatic",
            np.eye(4),
            np.eye(3)["xyz".index(name[-1])],
        )
        for name in ROOT_JOINTS
    ]
    ElementTree.SubElement(root, "link", name=GROUND)
    root.extend(chain_elements(GROUND, motions, tree.base, np.eye(4), set(tree.links)))
    for limit in root.findall("joint/limit")[-len(motions) :]:
        limit.set("effort", "0")  # nothing drives them


# ------------------------------------------------------------------ for pinocchio


def bare_urdf(root: ElementTree.Element) -> ElementTree.Element:
    """Return a checked URDF without shapes, its numbers parsed by Python.

    Pinocchio's parser prints errors in visuals and collisions to the console, and reads numbers by rules of
    its own.
    """
    bare = ElementTree.Element("robot", name=root.get("name", ""))
    bare.extend(_copy_read_parts(element) for element in root if element.tag in ("link", "joint"))
    return bare


def _copy_read_parts(element: ElementTree.Element) -> ElementTree.Element:
    """Copy an element with the first of each child in _READ_PARTS."""
    copy = ElementTree.Element(element.tag, element.attrib)
    for key in _NUMBERS.get(element.tag, ()):
        if key in copy.attrib:
            copy.set(key, vector_text(map(float, copy.attrib[key].split())))
    kind = element.get("type", "") if element.tag == "joint" else element.tag
    first_children = (element.findall(tag)[:1] for tag in _READ_PARTS.get(kind, ()))
    copy.extend(_copy_read_parts(child) for children in first_children for child in children)
    return copy


def make_continuous_joints_revolute(root: ElementTree.Element) -> None:
    """Replace continuous joints of a URDF by unlimited revolute ones.

    Pinocchio keeps a continuous joint as a point on a circle; a motor behind a gear needs the angle,
    with its full turns.
    """
    for joint in root.findall("joint"):
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            remove_children(joint, "limit")
            joint.append(no_limit())


# ------------------------------------------------------------------ springs


def virtual_link(name: str) -> str:
    """Name of the massless link in front of a virtual joint."""
    return f"{name}_base"


def insert_springs(root: ElementTree.Element, springs: Sequence[Spring]) -> None:
    """Put one virtual joint for each coordinate of each spring into a URDF.

    The springs' names and `after` must be valid for this URDF, as `read_robot_file` checks. Several
    springs behind one joint follow it in the order given.
    """
    joints = {joint.get("name"): joint for joint in root.findall("joint")}
    last = dict(joints)  # the joint that now stands nearest to the child of each `after`
    for spring in springs:
        after = joints[spring.after]
        own_axis = after.find("axis")
        own = "1 0 0" if own_axis is None else own_axis.get("xyz", "1 0 0")
        kind = "prismatic" if after.get("type") == "prismatic" else "revolute"
        motions = [("revolute" if "r" in axis else "prismatic", AXIS[axis[-1]]) for axis in spring.motion]
        for name, motion in zip(spring.coordinates, motions or [(kind, own)], strict=True):
            end, middle = child_element(last[spring.after], "", "child"), virtual_link(name)
            ElementTree.SubElement(root, "link", name=middle)
            joint = joint_element(name, motion[0], middle, end.get("link", ""), axis=motion[1])
            end.set("link", middle)
            root.append(joint)
            last[spring.after] = joint
