"""Edit the tree of a URDF for a robot file and for springs, and write it.

A robot file adds frames and bodies to links, locks joints and frees the root. A spring is a virtual joint:

    parent --after--> child      becomes      parent --after--> (massless) --spring--> child

A motor therefore drives the side of its spring that is nearer to the root, and a link bends at its far end.
All other modules see one tree.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from xml.etree.ElementTree import Element, SubElement, fromstring, tostring

import numpy as np
import pinocchio as pin

from framework.errors import RobotFileError, check_name
from framework.model.description import RobotDescription, Spring
from framework.model.documents import remove_children
from framework.model.placement import placement, rotation_about, to_rpy, unit_vector
from framework.model.urdf_elements import (
    COORDINATE_SUFFIXES,
    ENDLESS,
    MOVING,
    Joint,
    Tree,
    read_inertial,
    read_tree,
)
from framework.numerics.arrays import Array

GROUND = "ground"  # the root link of a robot whose file frees the root
ROOT_JOINTS = ("root_x", "root_y", "root_z", "root_rz", "root_ry", "root_rx")


def urdf_text(tree: Tree) -> str:
    """Write a tree as the text of a URDF."""
    return tostring(urdf_root(tree), encoding="unicode")


def urdf_root(tree: Tree) -> Element:
    """Return the `<robot>` of a tree, with the elements of joints that have one."""
    root = Element("robot", name=tree.name)
    root.extend(tree.others)
    root.extend(tree.links.values())
    for joint in tree.joints.values():
        root.append(joint_element(joint) if joint.element is None else joint.element)
    return root


def vector_text(values: Iterable[float]) -> str:
    """Write numbers with all digits, and zero without a sign."""
    return " ".join(repr(float(value) + 0.0) for value in values)  # -0.0 + 0.0 is 0.0


def origin_element(matrix: Array) -> Element:
    """Return the `<origin>` of a placement (4, 4)."""
    return Element("origin", xyz=vector_text(matrix[:3, 3]), rpy=vector_text(to_rpy(matrix[:3, :3])))


def joint_element(joint: Joint) -> Element:
    """Return the `<joint>` of a joint; limits that URDF requires are `ENDLESS` by default."""
    element = Element("joint", name=joint.name, type=joint.kind)
    SubElement(element, "parent", link=joint.parent)
    SubElement(element, "child", link=joint.child)
    element.append(origin_element(joint.origin))
    if joint.kind in MOVING:
        SubElement(element, "axis", xyz=vector_text(joint.axis))
    if joint.kind in ("revolute", "prismatic"):
        lower, upper = joint.limits or (-ENDLESS, ENDLESS)
        limit = {"lower": lower, "upper": upper, "effort": joint.effort, "velocity": joint.speed}
        SubElement(element, "limit", {key: f"{value!r}" for key, value in limit.items()})
    return element


def add_chain(
    tree: Tree, parent: str, motions: Sequence[Joint], body: str, end: Array, taken: set[str]
) -> None:
    """Add a chain of joints from a link `parent` to a link `body`, with massless links between.

    A continuous joint with limits becomes a revolute one.

    Args:
        motions: the joints, from the parent on.
        end: (4, 4) placement of the body behind the last joint. Unless it is the identity, a fixed joint is
            added there.
        taken: names in use, to which the names of the chain are added.
    """
    for motion in motions:
        carries_body = motion is motions[-1] and np.array_equal(end, np.eye(4))
        child = body if carries_body else free_name(f"{motion.name}_link", taken)
        kind = "revolute" if motion.limits and motion.kind == "continuous" else motion.kind
        tree.put(replace(motion, kind=kind, parent=parent, child=child))
        parent = child
    if parent != body:
        mount = free_name(f"{body}_mount", taken)
        tree.put(Joint(mount, "fixed", end, parent=parent, child=body))


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
    tree: Tree,
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

    Raises:
        RobotFileError: a name is taken.
    """
    for tag, taken, new in (("link", tree.links, name), ("joint", tree.joints, f"{name}_mount")):
        if new in taken:
            raise RobotFileError(f"duplicate {tag} {new!r}")
    tree.put(Joint(f"{name}_mount", "fixed", origin, parent=parent, child=name))
    if not mass:
        return
    link = tree.links[name]
    link.append(inertial_element(mass, np.zeros(3), np.diag(inertia)))
    squared_edges = 6.0 / mass * (sum(inertia) - 2.0 * np.array(inertia))
    if squared_edges.min() > 0.0:  # a flat body has no box
        visual = visual_element("box", {"size": vector_text(np.sqrt(squared_edges))}, np.eye(4))
        link.append(visual)
        material = SubElement(visual, "material", name=f"{name}_colour")
        SubElement(material, "color", rgba="0.93 0.72 0.13 1")  # the colour of platforms in the catalogue


def lock_joints(tree: Tree, locked: Mapping[str, float]) -> None:
    """Fix joints of one freedom at values [rad, m], by name.

    Raises:
        RobotFileError: no joint of one freedom has such a name.
    """
    movable = tree.movable
    for name, value in locked.items():
        check_name(f"locked.{name}", "joint", name, movable)
        tree.put(fixed_joint(tree.joints[name], value))


def fixed_joint(joint: Joint, *values: float) -> Joint:
    """Return a joint fixed at the values [rad, m] of its coordinates."""
    if joint.kind in COORDINATE_SUFFIXES:
        rotation_vector = np.array(values[-3:])
        translation = values[:-3] or (0.0, 0.0, 0.0)  # a ball has the rotation alone
        motion = placement(pin.exp3(rotation_vector), translation)
    elif joint.kind == "prismatic":
        motion = placement(translation=values[0] * joint.axis / np.linalg.norm(joint.axis))
    else:
        motion = placement(rotation_about(joint.axis, values[0]))
    return Joint(joint.name, "fixed", joint.origin @ motion, parent=joint.parent, child=joint.child)


def free_root(tree: Tree) -> None:
    """Mount a tree on a new root link `ground` by the six ROOT_JOINTS.

    They are three slides along the base axes, then rotations about z, y and x. The chain is singular only
    when the root pitches by 90 degrees. Nothing drives these joints.

    Raises:
        RobotFileError: the name of a joint or of the link is taken.
    """
    base = tree.base
    for name in (GROUND, *ROOT_JOINTS):
        if name in tree.links or name in tree.joints:
            raise RobotFileError(f"root: free: the name {name!r} is taken in the URDF")
    motions = []
    for name in ROOT_JOINTS:
        kind = "revolute" if "_r" in name else "prismatic"
        motions.append(Joint(name, kind, axis=unit_vector(name[-1]), effort=0.0))
    tree.links[GROUND] = Element("link", name=GROUND)
    add_chain(tree, GROUND, motions, base, np.eye(4), set(tree.links))


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
    tree = read_tree(fromstring(description.urdf_text))
    platform = description.platform.frame
    with_mass = []
    if bodies == "payload" and platform in tree.links and read_inertial(tree.links[platform])[0] > 0.0:
        with_mass = [platform]
    elif bodies == "payload":
        with_mass = [name for name in tree.links if tree.body(name) == tree.body(platform)]
    for name, link in tree.links.items():
        if name not in with_mass:
            remove_children(link, "inertial")
    return replace(
        description,
        urdf_text=urdf_text(tree),
        joints=description.joints if with_mass else {},
    )


# ------------------------------------------------------------------ springs


def virtual_link_name(name: str) -> str:
    """Return the name of the massless link before a virtual joint."""
    return f"{name}_base"


def insert_springs(tree: Tree, springs: Sequence[Spring]) -> None:
    """Insert the virtual joints of springs into a tree.

    The springs' names and `after` must be valid for this tree, as `read_robot_file` checks. Several springs
    behind one joint follow the joint in the order given.
    """
    last: dict[str, str] = {}  # the last joint so far in the chain that each `after` begins
    for spring in springs:
        after = tree.joints[spring.after]
        axes = spring.motion or ("own",)
        for name, axis in zip(spring.coordinates, axes, strict=True):
            if axis == "own":
                kind, direction = "prismatic" if after.kind == "prismatic" else "revolute", after.axis
            else:
                kind, direction = "revolute" if "r" in axis else "prismatic", unit_vector(axis[-1])
            end = tree.joints[last.get(spring.after, spring.after)]
            link = virtual_link_name(name)
            tree.put(replace(end, child=link, element=None))
            tree.put(Joint(name, kind, axis=direction, parent=link, child=end.child))
            last[spring.after] = name
