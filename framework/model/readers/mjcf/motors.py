"""The motors of an MJCF file, and the pose of its first keyframe."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import numpy as np
import pinocchio as pin

from framework.errors import RobotFileError, choose_from
from framework.model.description import Actuator
from framework.model.placement import from_quaternion
from framework.model.readers.mjcf.bodies import Bodies
from framework.model.readers.urdf_tree import UrdfTree
from framework.model.urdf_elements import coordinates_of
from framework.model.xml_reading import numbers

_MOTORS = ("motor", "position", "velocity", "intvelocity", "damper", "general")


def actuators_of(root: ElementTree.Element, bodies: Bodies, tree: UrdfTree) -> list[Actuator]:
    """The motors of a file whose bodies became the tree.

    Raises:
        RobotFileError: names the element.
    """
    found: dict[str, Actuator] = {}
    movable = set(tree.movable)
    valid = [name for name in bodies.coordinates if name in movable]
    for section in root.findall("actuator"):
        for element in section:
            where = f"<actuator>: {element.tag} {element.get('name', '')!r}"
            if element.tag not in _MOTORS:
                raise RobotFileError(
                    f"{where}: {choose_from('or unsupported actuator', element.tag, _MOTORS)}"
                )
            attributes = {
                **bodies.settings.attributes(element, where, None, "general"),
                **bodies.settings.attributes(element, where, None),
            }
            joint = attributes.get("joint", attributes.get("jointinparent"))
            if joint not in valid:
                raise RobotFileError(f"{where} joint: {choose_from('hinge or slide', joint, valid)}")
            if joint in found:
                raise RobotFileError(f"{where}: joint {joint!r} has two actuators")
            found[joint] = _actuator(bodies, joint, attributes, where)
    for name, coordinate in bodies.coordinates.items():
        if coordinate.armature and name not in found:
            raise RobotFileError(
                f"joint {name!r} armature: only supported on joints with an <actuator>; give the inertia "
                f"to the body"
            )
    return list(found.values())


def _actuator(bodies: Bodies, joint: str, attributes: dict[str, str], where: str) -> Actuator:
    parts = attributes.get("gear", "1").split()
    gear = numbers(f"{where} gear", attributes.get("gear", "1"), max(len(parts), 1))
    if gear[0] <= 0 or any(gear[1:]):
        raise RobotFileError(f"{where} gear: needs one ratio greater than zero, got {' '.join(parts)}")
    armature = bodies.coordinates[joint].armature
    if armature < 0:
        raise RobotFileError(f"joint {joint!r} armature: must not be negative, got {armature:g}")
    limit = None
    if "forcerange" in attributes:
        low, high = numbers(f"{where} forcerange", attributes["forcerange"], 2)
        limit = high if high > 0 and low == -high else None
    return Actuator(joint, gear[0], armature / gear[0] ** 2, limit)


def reference_of(root: ElementTree.Element, bodies: Bodies) -> dict[str, float]:
    """Joint angles of the first key, from the zero pose; empty without one."""
    key = root.find("keyframe/key")
    if key is None or "qpos" not in key.attrib:
        return {}
    width = {"ball": 4, "free": 7}
    count = sum(width.get(c.kind, 1) for c in bodies.coordinates.values())
    values = list(numbers(f"<key> {key.get('name', '')!r} qpos", key.get("qpos"), count))
    reference = {}
    for name, coordinate in bodies.coordinates.items():
        size = width.get(coordinate.kind, 1)
        own, values = values[:size], values[size:]
        if size == 1:
            reference[name] = own[0] - coordinate.ref
            continue
        if not any(own[-4:]):
            raise RobotFileError(f"<key> qpos: the quaternion of {coordinate.kind} {name!r} is zero")
        turn = from_quaternion(*own[-4:])
        slides: list[float] = []
        if coordinate.kind == "free":  # its qpos is the pose of the body, not the way from the zero pose
            zero = coordinate.place[:3, :3]
            slides = (zero.T @ (np.array(own[:3]) - coordinate.place[:3, 3])).tolist()
            turn = zero.T @ turn
        names = coordinates_of(name, "floating" if slides else "spherical")
        reference.update(zip(names, [*slides, *pin.log3(turn).tolist()], strict=True))
    return reference
