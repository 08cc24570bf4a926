"""The `<equality>` of an MJCF file: closures, couplings of joints, and joints that it holds."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping

from framework.arrays import Array
from framework.errors import RobotFileError, choose_from
from framework.model.description import Closure, Coupling, locked_axes
from framework.model.placement import from_quaternion, inverse, placement
from framework.model.readers.left_out import LeftOut
from framework.model.readers.mjcf.bodies import WORLD, Bodies
from framework.model.readers.mjcf.settings import known, word
from framework.model.readers.urdf_tree import UrdfTree
from framework.model.xml_reading import numbers

_OTHERS = ("tendon", "flex", "flexvert", "flexstrain", "distance")
_EQUALITY = ("name", "class", "active", "solref", "solimp")
_CONNECT = (*_EQUALITY, "body1", "body2", "anchor", "site1", "site2")
_WELD = (*_CONNECT, "relpose", "torquescale")
_JOINT_EQUALITY = (*_EQUALITY, "joint1", "joint2", "polycoef")


def loops_of(
    root: ElementTree.Element, bodies: Bodies, tree: UrdfTree, frames: Mapping[str, str]
) -> tuple[list[Closure], list[Coupling]]:
    """Read the loops of a file whose bodies became the tree; `frames` has the tree's frame of each site.

    Joints that an equality holds become fixed in the tree.

    Raises:
        RobotFileError: names the element.
    """
    closures: list[Closure] = []
    couplings: list[Coupling] = []
    for section in root.findall("equality"):
        for element in section:
            loop = _loop(root, bodies, tree, frames, element, len(closures) + 1)
            if isinstance(loop, Closure):
                closures.append(loop)
            elif loop is not None:
                couplings.append(loop)
    return closures, couplings


def _joints_of_tendons(root: ElementTree.Element, equality: ElementTree.Element) -> tuple[str, ...]:
    """Return the joints that the tendons of an equality pull at."""
    names = {equality.get("tendon1"), equality.get("tendon2")} - {None}
    tendons = [tendon for section in root.findall("tendon") for tendon in section]
    return tuple(
        part.get("joint", "")
        for tendon in tendons
        if tendon.get("name") in names
        for part in tendon.findall("joint")
    )


def _loop(
    root: ElementTree.Element,
    bodies: Bodies,
    tree: UrdfTree,
    frames: Mapping[str, str],
    element: ElementTree.Element,
    number: int,
) -> Closure | Coupling | None:
    """Read the loop of one equality; None for one that is off, left out, or holds a joint (which is done)."""
    kinds = {"connect": _CONNECT, "weld": _WELD, "joint": _JOINT_EQUALITY}
    if element.tag in _OTHERS:
        text = f"<equality>: {element.tag} {element.get('name', '')!r}: only bodies and joints are joined"
        bodies.left_out.append(LeftOut(text, _joints_of_tendons(root, element), is_decisive=True))
        return None
    if element.tag not in kinds:
        raise RobotFileError(f"<equality>: {choose_from('or unsupported element', element.tag, kinds)}")
    name = element.get("name") or f"{element.tag}_{number}"
    where = f"{element.tag} {name!r}"
    known(element, where, kinds[element.tag])
    attributes = {
        key: value
        for key, value in bodies.settings.attributes(element, where, None, "equality").items()
        if key in kinds[element.tag]
    }
    if word(attributes, where, "active", ("true", "false"), "true") == "false":
        return None
    if element.tag == "joint":
        return _joint_equality(bodies, tree, name, where, attributes)
    fixed = element.tag == "weld"
    if fixed and numbers(f"{where} torquescale", attributes.get("torquescale", "1"), 1)[0] == 0.0:
        fixed = False
    axes = locked_axes("fixed" if fixed else "spherical")
    if "site1" in attributes or "site2" in attributes:
        first, second = _sites(bodies, where, attributes)
        return Closure(name, (frames[first], frames[second]), axes)
    (link1, at1), (link2, at2) = _bodies(bodies, tree, where, element.tag, attributes)
    return Closure(
        name, (tree.frame_at(f"{name}_1", link1, at1), tree.frame_at(f"{name}_2", link2, at2)), axes
    )


def _sites(bodies: Bodies, where: str, attributes: dict[str, str]) -> tuple[str, str]:
    """Return the two sites that coincide."""
    for key in ("body1", "body2", "anchor", "relpose"):
        if key in attributes:
            raise RobotFileError(f"{where}: give either two sites or bodies, got a site and {key}")
    for key in ("site1", "site2"):
        if attributes.get(key) not in bodies.sites:
            raise RobotFileError(f"{where} {key}: {choose_from('site', attributes.get(key), bodies.sites)}")
    first, second = attributes["site1"], attributes["site2"]
    if bodies.sites[first][0] == bodies.sites[second][0]:
        raise RobotFileError(f"{where}: joins body {bodies.sites[first][0]!r} with itself")
    return first, second


def _bodies(
    bodies: Bodies, tree: UrdfTree, where: str, tag: str, attributes: dict[str, str]
) -> tuple[tuple[str, Array], tuple[str, Array]]:
    """Return the two bodies, and the placements in them that coincide."""
    if "body1" not in attributes:
        raise RobotFileError(f"{where}: needs body1, or site1 and site2")
    links = []
    for key in ("body1", "body2"):
        body = attributes.get(key, WORLD)
        if body not in bodies.bodies:
            raise RobotFileError(f"{where} {key}: {choose_from('body', body, bodies.bodies)}")
        links.append(body)
    first, second = links
    if first == second:
        raise RobotFileError(f"{where}: joins body {first!r} with itself")
    between = inverse(tree.at_zero(first)) @ tree.at_zero(second)  # second in first, at the zero pose
    if tag == "connect":
        if "anchor" not in attributes:
            raise RobotFileError(f"{where}: anchor is missing")
        at = placement(None, numbers(f"{where} anchor", attributes["anchor"], 3))
        in_second = inverse(between) @ at
        return (first, at), (second, placement(None, in_second[:3, 3]))
    anchor = placement(None, numbers(f"{where} anchor", attributes.get("anchor", "0 0 0"), 3))
    pose = numbers(f"{where} relpose", attributes.get("relpose", "0 1 0 0 0 0 0"), 7)
    if any(pose[3:]):
        turn = from_quaternion(pose[3], pose[4], pose[5], pose[6])
        return (first, placement(turn, pose[:3])), (second, anchor)
    return (first, between @ anchor), (second, anchor)


def _joint_equality(
    bodies: Bodies, tree: UrdfTree, name: str, where: str, attributes: dict[str, str]
) -> Closure | Coupling | None:
    """Read the coupling of two joints; a joint that is held alone becomes fixed.

    Equal turns about parallel axes of one body are a closure, which all proofs know. MuJoCo's polynomial is
    between the ways of the two from their zero pose, as ours is.
    """
    names = []
    for key in ("joint1", "joint2"):
        if key not in attributes and key == "joint2":
            continue
        joint_name = attributes.get(key)
        valid = [n for n, c in bodies.coordinates.items() if c.kind in ("hinge", "slide")]
        if joint_name not in valid:
            raise RobotFileError(f"{where} {key}: {choose_from('hinge or slide', joint_name, valid)}")
        names.append(str(joint_name))
    parts = attributes.get("polycoef", "0 1 0 0 0").split()
    parts += ["0", "1", "0", "0", "0"][len(parts) :]  # what is left out keeps its default
    offset, ratio, *higher = numbers(f"{where} polycoef", " ".join(parts), 5)
    joint = tree.joints[names[0]]
    if len(names) == 1 or not any((ratio, *higher)):
        if not joint.moves:
            raise RobotFileError(f"{where} joint1: {joint.name!r} is already held")
        tree.fix(joint, offset)
        return None
    if any(higher):
        text = f"{where}: polycoef {' '.join(parts)}: only linear couplings of joints are read"
        bodies.left_out.append(LeftOut(text, tuple(names), is_decisive=True))
        return None
    if (offset, ratio) == (0.0, 1.0):
        second = tree.joints[names[1]]
        chains = tree.moving_chains(joint.child, second.child)
        if [[part.name for part in chain] for chain in chains] == [[joint.name], [second.name]]:
            closure = tree.same_turning(name, joint.child, second.child)
            if closure is not None:
                return closure
    return Coupling(names[0], names[1], ratio, offset)
