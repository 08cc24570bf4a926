"""Write elements of a URDF, and edit a URDF for a robot file, for springs and for pinocchio's parser.

A robot file adds frames and bodies to links, locks joints and frees the root. A spring is a virtual joint:

    parent --after--> child      becomes      parent --after--> (massless) --spring--> child

A motor therefore drives the side of its spring that is nearer to the root, and a link bends at its far end.
All other modules see one tree.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement, fromstring, tostring

import numpy as np
import pinocchio as pin

from framework.errors import check_name
from framework.model.description import RobotDescription, Spring
from framework.model.documents import child_element, read_axis, remove_children
from framework.model.placement import placement, rotation_about, to_rpy, unit_vector
from framework.model.urdf_elements import (
    COORDINATE_SUFFIXES,
    INERTIA_ENTRIES,
    MOVING,
    Joint,
    add_endless_limit,
    read_tree,
)
from framework.numerics.arrays import Array

GROUND = "ground"  # the root link of a robot whose file frees the root
ROOT_JOINTS = ("root_x", "root_y", "root_z", "root_rz", "root_ry", "root_rx")
# the children of joints that pinocchio reads, of all and of moving ones
_JOINT_PARTS = ("parent", "child", "origin")
_MOVING_JOINT_PARTS = (*_JOINT_PARTS, "axis", "limit")
# the attributes of these children, and of those of `<inertial>`, that hold numbers
_NUMBERS = {"xyz", "rpy", "value", "lower", "upper", "effort", "velocity", *INERTIA_ENTRIES}


def vector_text(values: Iterable[float]) -> str:
    """Write numbers with all digits, and zero without a sign."""
    return " ".join(repr(float(value) + 0.0) for value in values)  # -0.0 + 0.0 is 0.0


def origin_element(matrix: Array) -> Element:
    """Return the `<origin>` of a placement (4, 4)."""
    return Element("origin", xyz=vector_text(matrix[:3, 3]), rpy=vector_text(to_rpy(matrix[:3, :3])))


class NewJoint(NamedTuple):
    """A joint to write; None leaves an element out."""

    name: str
    kind: str  # type in the URDF
    origin: Array | None = None  # (4, 4) placement in the parent link
    axis: Array | None = None  # (3,) in the joint's frame
    limits: Sequence[float] | None = None  # lower and upper limit [rad, m]


def joint_element(joint: NewJoint, parent: str, child: str) -> Element:
    """Return a `<joint>` from link `parent` to link `child`.

    Limits that URDF requires and `joint` does not have are so large that no motion reaches them. A continuous
    joint with limits becomes a revolute one.
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
            lower, upper = joint.limits
            limit.attrib |= {"lower": repr(lower), "upper": repr(upper)}
    return element


def chain_elements(
    parent: str, motions: Sequence[NewJoint], body: str, end: Array, taken: set[str]
) -> Iterator[Element]:
    """Yield a chain of joints from `parent` to `body`, and the massless links between.

    Args:
        parent: link.
        motions: the joints, from the parent on.
        body: link behind the last joint.
        end: (4, 4) placement of the body behind the last joint. Unless it is the identity, a fixed joint is
            added there.
        taken: names in use, to which the names of the chain are added.
    """
    for motion in motions:
        carries_body = motion is motions[-1] and np.array_equal(end, np.eye(4))
        child = body if carries_body else free_name(f"{motion.name}_link", taken)
        if not carries_body:
            yield Element("link", name=child)
        yield joint_element(motion, parent, child)
        parent = child
    if parent != body:
        yield joint_element(NewJoint(free_name(f"{body}_mount", taken), "fixed", end), parent, body)


def free_name(wanted: str, taken: set[str]) -> str:
    """Append underscores to a taken name until the result is free; add the result to `taken`."""
    while wanted in taken:
        wanted += "_"
    taken.add(wanted)
    return wanted


def visual_element(shape: str, sizes: dict[str, str], origin: Array) -> Element:
    """Return the `<visual>` of a primitive shape at a placement `origin` (4, 4) in the link.

    `shape` is the tag of the shape, such as box; `sizes` are its attributes, such as size or radius [m].
    """
    visual = Element("visual")
    visual.append(origin_element(origin))
    SubElement(SubElement(visual, "geometry"), shape, sizes)
    return visual


def inertial_element(mass: float, centre: Array, inertia: Array) -> Element:
    """Return the `<inertial>` of a body: mass [kg], centre (3,) [m], central inertia (3, 3) [kg m^2]."""
    inertial = Element("inertial")
    SubElement(inertial, "origin", xyz=vector_text(centre), rpy="0 0 0")
    SubElement(inertial, "mass", value=repr(float(mass)))
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    entries = map(repr, inertia[np.triu_indices(3)].tolist())
    SubElement(inertial, "inertia", dict(zip(names, entries, strict=True)))
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
    """Add a link at a placement `origin` (4, 4) in `parent`, with or without a body.

    The body's centre of mass is the frame's origin; its principal moments `inertia` (3,) [kg m^2] are about
    the frame's axes. Its visual is the box of uniform density with this mass [kg] and inertia: the edges
    satisfy a_x^2 = 6 (I_yy + I_zz - I_xx) / m, and so on.
    """
    link = SubElement(root, "link", name=name)
    root.append(joint_element(NewJoint(f"{name}_mount", "fixed", origin), parent, name))
    if not mass:
        return
    link.append(inertial_element(mass, np.zeros(3), np.diag(inertia)))
    squared_edges = 6.0 / mass * (sum(inertia) - 2.0 * np.array(inertia))
    if squared_edges.min() > 0.0:  # a flat body has no box
        visual = visual_element("box", {"size": vector_text(np.sqrt(squared_edges))}, np.eye(4))
        link.append(visual)
        material = SubElement(visual, "material", name=f"{name}_colour")
        SubElement(material, "color", rgba="0.93 0.72 0.13 1")  # the colour of platforms in the catalogue


def lock_joints(root: Element, locked: Mapping[str, float]) -> None:
    """Fix joints of one freedom at values [rad, m], by name; a fixed joint follows no other any more.

    Raises:
        RobotFileError: no joint of one freedom has such a name.
    """
    tree = read_tree(root)
    for name, value in locked.items():
        check_name(f"locked.{name}", "joint", name, tree.movable)
        fix_joint(tree.joints[name], value)


def fix_joint(joint: Joint, *values: float) -> None:
    """Fix a joint that moves at the values [rad, m] of its coordinates; remove axis, limits and mimic."""
    if joint.kind in COORDINATE_SUFFIXES:
        rotation_vector = np.array(values[-3:])
        translation = values[:-3] or (0.0, 0.0, 0.0)  # a ball has the rotation alone
        motion = placement(pin.exp3(rotation_vector), translation)
    elif joint.kind == "prismatic":
        motion = placement(translation=values[0] * joint.axis / np.linalg.norm(joint.axis))
    else:
        motion = placement(rotation_about(joint.axis, values[0]))
    joint.origin = joint.origin @ motion
    joint.kind = "fixed"
    joint.element.set("type", "fixed")
    remove_children(joint.element, "axis", "limit", "mimic", "origin")
    joint.element.append(origin_element(joint.origin))


def free_root(root: Element) -> None:
    """Mount a URDF on a new root link `ground` by the six ROOT_JOINTS.

    They are three slides along the base axes, then rotations about z, y and x. The chain is singular only
    when the root pitches by 90 degrees.
    """
    tree = read_tree(root)
    motions = []
    for name in ROOT_JOINTS:
        kind = "revolute" if "_r" in name else "prismatic"
        motions.append(NewJoint(name, kind, np.eye(4), unit_vector(name[-1])))
    SubElement(root, "link", name=GROUND)
    root.extend(chain_elements(GROUND, motions, tree.base, np.eye(4), set(tree.links)))
    for limit in root.findall("joint/limit")[-len(motions) :]:  # of the chain, which was added last
        limit.set("effort", "0")  # nothing drives these joints


# ------------------------------------------------------------------ for levels of fidelity


def with_bodies(description: RobotDescription, bodies: str) -> RobotDescription:
    """Return the robot with mass in no body, in the payload or in all.

    The payload is the inertia of the platform's link. If that link has no inertia of its own, the payload is
    the moving body that carries the platform's frame. A robot without any mass has no joint dynamics either:
    only its rotors cause forces.

    Args:
        bodies: that have mass: "none", "payload" or "all".
    """
    if bodies == "all":
        return description
    root = fromstring(description.urdf_text)
    with_mass = _payload_links(description, root) if bodies == "payload" else []
    for link in root.findall("link"):
        if link.get("name") not in with_mass:
            remove_children(link, "inertial")
    return replace(
        description,
        urdf_text=tostring(root, encoding="unicode"),
        joints=description.joints if with_mass else {},
    )


def _payload_links(description: RobotDescription, root: Element) -> list[str]:
    """Return the names of the links that carry the payload's inertia."""
    platform = description.platform.frame
    masses = [link.find("inertial/mass") for link in root.findall("link") if link.get("name") == platform]
    if any(mass is not None and float(mass.get("value", "0")) > 0 for mass in masses):
        return [platform]
    urdf = read_tree(root)
    body = urdf.body(platform)
    return [name for name in urdf.links if urdf.body(name) == body]


# ------------------------------------------------------------------ for pinocchio


def copy_without_shapes(root: Element) -> Element:
    """Copy a checked URDF without shapes, its numbers parsed by Python.

    Pinocchio's parser prints errors in visuals and collisions to the console, and parses numbers differently.
    """
    bare = Element("robot", name=root.get("name", ""))
    for element in root:
        if element.tag == "link":
            tags: tuple[str, ...] = ("inertial",)
        elif element.tag == "joint":
            tags = _MOVING_JOINT_PARTS if element.get("type") in MOVING else _JOINT_PARTS
        else:
            continue
        copy = SubElement(bare, element.tag, element.attrib)
        for tag in tags:
            copy.extend(deepcopy(element.findall(tag)[:1]))  # pinocchio reads the first of a tag
    for element in bare.iter():
        for key in _NUMBERS & element.attrib.keys():
            element.set(key, vector_text(map(float, element.attrib[key].split())))
    return bare


def make_continuous_joints_revolute(root: Element) -> None:
    """Replace the continuous joints of a URDF by unlimited revolute joints.

    Pinocchio's coordinates of a continuous joint are the cosine and sine of the angle. A motor behind a gear
    needs the angle itself, with full turns.
    """
    for joint in root.findall("joint[@type='continuous']"):
        joint.set("type", "revolute")
        remove_children(joint, "limit")
        add_endless_limit(joint)


# ------------------------------------------------------------------ springs


def virtual_link_name(name: str) -> str:
    """Return the name of the massless link before a virtual joint."""
    return f"{name}_base"


def insert_springs(root: Element, springs: Sequence[Spring]) -> None:
    """Insert the virtual joints of springs into a URDF.

    The springs' names and `after` must be valid for this URDF, as `read_robot_file` checks. Several springs
    behind one joint follow the joint in the order given.
    """
    joints = {joint.get("name"): joint for joint in root.findall("joint")}
    last = dict(joints)  # the last joint so far in the chain that each `after` begins
    for spring in springs:
        for motion in _virtual_joints(spring, joints[spring.after]):
            end = child_element(last[spring.after], "", "child")
            link = virtual_link_name(motion.name)
            SubElement(root, "link", name=link)
            joint = joint_element(motion, link, end.get("link", ""))
            end.set("link", link)  # the last joint now leads to the massless link before the spring
            root.append(joint)
            last[spring.after] = joint


def _virtual_joints(spring: Spring, after: Element) -> list[NewJoint]:
    """Return the virtual joints of a spring behind the joint `after`."""
    if not spring.motion:
        kind = "prismatic" if after.get("type") == "prismatic" else "revolute"
        axis = after.find("axis")
        direction = unit_vector("x") if axis is None else read_axis(axis, "")
        return [NewJoint(spring.name, kind, axis=direction)]
    return [
        NewJoint(name, "revolute" if "r" in axis else "prismatic", axis=unit_vector(axis[-1]))
        for name, axis in zip(spring.coordinates, spring.motion, strict=True)
    ]
