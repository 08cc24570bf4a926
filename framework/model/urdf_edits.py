"""Elements of a URDF; its changes by a robot file, by springs, and for pinocchio's parser.

A robot file adds frames and bodies to links, locks joints and frees the root. A spring is a virtual joint,

    parent --after--> child      becomes      parent --after--> (massless) --spring--> child

so a motor turns the near side of its spring, and a link gives way at its far end. Everything downstream sees
one tree.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from framework.errors import check_name
from framework.model.description import Spring
from framework.model.documents import child_element, remove_children
from framework.model.placement import placement, rotation_about, to_rpy
from framework.model.urdf_elements import (
    ENTRIES,
    JOINT_TYPES,
    MOVING,
    SEVERAL,
    Joint,
    add_endless_limit,
    read_tree,
)
from framework.numerics.arrays import Array

AXIS = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
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


def vector_text(values: Iterable[float]) -> str:
    """Write numbers with all digits, and zero without a sign."""
    return " ".join(repr(float(value) + 0.0) for value in values)


def origin_element(matrix: Array) -> Element:
    """Return the `<origin>` of a placement (4, 4)."""
    return Element("origin", xyz=vector_text(matrix[:3, 3]), rpy=vector_text(to_rpy(matrix[:3, :3])))


class NewJoint(NamedTuple):
    """A joint to write.

    `origin` (4, 4) is its placement in the parent link, `axis` (3,) is in the joint's frame, `limits` are the
    lower and the upper one [rad, m].
    """

    name: str
    kind: str
    origin: Array | None = None
    axis: Array | None = None
    limits: Sequence[float] | None = None


def joint_element(joint: NewJoint, parent: str, child: str) -> Element:
    """Return a `<joint>`; where URDF requires limits and none are given, huge ones.

    A continuous joint with limits is a revolute one.
    """
    kind = "revolute" if joint.limits and joint.kind == "continuous" else joint.kind
    element = Element("joint", name=joint.name, type=kind)
    SubElement(element, "parent", link=parent)
    SubElement(element, "child", link=child)
    if joint.origin is not None:
        element.append(origin_element(joint.origin))
    if joint.axis is not None:
        SubElement(element, "axis", xyz=vector_text(joint.axis))
    if kind in ("revolute", "prismatic"):
        limit = add_endless_limit(element)
        if joint.limits:
            limit.attrib |= zip(("lower", "upper"), map(repr, joint.limits), strict=True)
    return element


def chain_elements(
    parent: str, motions: Sequence[NewJoint], body: str, end: Array, taken: set[str]
) -> Iterator[Element]:
    """Yield a chain of joints from `parent` to `body`, and the massless links between.

    Args:
        end: (4, 4) placement of the body behind the last joint; unless the identity, a fixed joint more.
        taken: names of links, which grow by those of the chain.
    """
    for motion in motions:
        is_last = motion is motions[-1] and np.array_equal(end, np.eye(4))
        child = body if is_last else free_name(f"{motion.name}_link", taken)
        if not is_last:
            yield Element("link", name=child)
        yield joint_element(motion, parent, child)
        parent = child
    if parent != body:
        yield joint_element(NewJoint(free_name(f"{body}_mount", taken), "fixed", end), parent, body)


def free_name(wanted: str, taken: set[str]) -> str:
    """Append underscores to a name until free, and mark the result as taken."""
    while wanted in taken:
        wanted += "_"
    taken.add(wanted)
    return wanted


def visual_element(shape: str, words: dict[str, str], origin: Array) -> Element:
    """Return the `<visual>` of a primitive shape at a placement (4, 4)."""
    visual = Element("visual")
    visual.append(origin_element(origin))
    SubElement(SubElement(visual, "geometry"), shape, words)
    return visual


def inertial_element(mass: float, centre: Array, inertia: Array) -> Element:
    """Return the `<inertial>` of a body: mass [kg], centre (3,) [m], central inertia (3, 3) [kg m^2]."""
    inertial = Element("inertial")
    SubElement(inertial, "origin", xyz=vector_text(centre), rpy="0 0 0")
    SubElement(inertial, "mass", value=repr(float(mass)))
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    pairs = zip(names, inertia[np.triu_indices(3)].tolist(), strict=True)
    SubElement(inertial, "inertia", {name: repr(value) for name, value in pairs})
    return inertial


# ------------------------------------------------------------------ for robot files


def add_frame(
    root: Element,
    name: str,
    parent: str,
    origin: Array,
    mass: float = 0.0,
    inertia: Sequence[float] = (0.0, 0.0, 0.0),
) -> None:
    """Add a link at a placement (4, 4) in `parent`, with or without a body.

    The body has its centre at the frame's origin, and `inertia` [kg m^2] about its axes. It looks like the
    box of even density with this mass and inertia: edges a_x^2 = 6 (I_yy + I_zz - I_xx) / m and so on.
    """
    link = SubElement(root, "link", name=name)
    root.append(joint_element(NewJoint(f"{name}_mount", "fixed", origin), parent, name))
    if not mass:
        return
    link.append(inertial_element(mass, np.zeros(3), np.diag(inertia)))
    squares = 6.0 / mass * (sum(inertia) - 2.0 * np.array(inertia))
    if squares.min() > 0.0:
        visual = visual_element("box", {"size": vector_text(np.sqrt(squares))}, np.eye(4))
        link.append(visual)
        material = SubElement(visual, "material", name=f"{name}_colour")
        SubElement(material, "color", rgba="0.93 0.72 0.13 1")  # of platforms in the catalogue


def lock_joints(root: Element, locked: Mapping[str, float]) -> None:
    """Fix joints of one freedom at given values [rad, m]; remove their mimics."""
    tree = read_tree(root)
    for name, value in locked.items():
        check_name(f"locked.{name}", "joint", name, tree.movable)
        fix_joint(tree.joints[name], value)


def fix_joint(joint: Joint, *values: float) -> None:
    """Make a joint fixed at the values [rad, m] of its coordinates."""
    if joint.kind in SEVERAL:
        *along, x, y, z = values  # shifts of a joint with 6 freedoms, then the rotation vector
        motion = placement(pin.exp3(np.array([x, y, z])), along or (0.0, 0.0, 0.0))
    elif joint.kind == "prismatic":
        motion = placement(None, values[0] * joint.axis / np.linalg.norm(joint.axis))
    else:
        motion = placement(rotation_about(joint.axis, values[0]))
    joint.origin = joint.origin @ motion
    joint.kind = "fixed"
    joint.element.set("type", "fixed")
    remove_children(joint.element, "axis", "limit", "mimic", "origin")
    joint.element.append(origin_element(joint.origin))


def free_root(root: Element) -> None:
    """Mount a URDF on a new root link `ground` by six joints, ROOT_JOINTS.

    Three slides along the base axes, then turns about z, y and x: singular only when the root pitches by
    90 degrees.
    """
    tree = read_tree(root)
    motions = [
        NewJoint(
            name, "revolute" if "_r" in name else "prismatic", np.eye(4), np.eye(3)["xyz".index(name[-1])]
        )
        for name in ROOT_JOINTS
    ]
    SubElement(root, "link", name=GROUND)
    root.extend(chain_elements(GROUND, motions, tree.base, np.eye(4), set(tree.links)))
    for limit in root.findall("joint/limit")[-len(motions) :]:
        limit.set("effort", "0")  # nothing drives them


# ------------------------------------------------------------------ for pinocchio


def copy_without_shapes(root: Element) -> Element:
    """Copy a checked URDF without shapes, its numbers parsed by Python.

    Pinocchio's parser prints errors in visuals and collisions to the console, and reads numbers by rules of
    its own.
    """
    bare = Element("robot", name=root.get("name", ""))
    bare.extend(_copy_read_parts(element) for element in root if element.tag in ("link", "joint"))
    return bare


def _copy_read_parts(element: Element) -> Element:
    """Copy an element with the first of each child in _READ_PARTS."""
    copy = Element(element.tag, element.attrib)
    for key in _NUMBERS.get(element.tag, ()):
        if key in copy.attrib:
            copy.set(key, vector_text(map(float, copy.attrib[key].split())))
    kind = element.get("type", "") if element.tag == "joint" else element.tag
    first_children = (element.findall(tag)[:1] for tag in _READ_PARTS.get(kind, ()))
    copy.extend(_copy_read_parts(child) for children in first_children for child in children)
    return copy


def make_continuous_joints_revolute(root: Element) -> None:
    """Replace continuous joints of a URDF by unlimited revolute ones.

    Pinocchio keeps a continuous joint as a point on a circle; a motor behind a gear needs the angle,
    with its full turns.
    """
    for joint in root.findall("joint"):
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            remove_children(joint, "limit")
            add_endless_limit(joint)


# ------------------------------------------------------------------ springs


def virtual_link_name(name: str) -> str:
    """Name of the massless link in front of a virtual joint."""
    return f"{name}_base"


def insert_springs(root: Element, springs: Sequence[Spring]) -> None:
    """Insert the virtual joints of springs into a URDF.

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
        for name, (kind_of_motion, axis) in zip(spring.coordinates, motions or [(kind, own)], strict=True):
            end, middle = child_element(last[spring.after], "", "child"), virtual_link_name(name)
            SubElement(root, "link", name=middle)
            motion = NewJoint(name, kind_of_motion, axis=np.array(axis.split(), dtype=float))
            joint = joint_element(motion, middle, end.get("link", ""))
            end.set("link", middle)
            root.append(joint)
            last[spring.after] = joint
