"""The motors of an MJCF file, and the pose of its first keyframe."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from framework.errors import RobotFileError, choose_from
from framework.model.placement import from_quaternion
from framework.model.readers.left_out import LeftOut
from framework.model.readers.mjcf.bodies import Bodies, symmetric_range
from framework.model.readers.transmissions import Motor
from framework.model.urdf_elements import coordinates_of
from framework.model.xml_reading import numbers

_SCALAR = ("hinge", "slide")
_MOTORS = ("motor", "position", "velocity", "intvelocity", "damper", "general")
_OTHERS = ("cylinder", "muscle", "adhesion", "plugin", "dcmotor")


def motors_of(root: ElementTree.Element, bodies: Bodies) -> list[Motor]:
    """Read the motors on hinges, slides and fixed tendons of them; name others as left out.

    Raises:
        RobotFileError: names the element.
    """
    motors: list[Motor] = []
    tendons = _fixed_tendons(root, bodies)
    for section in root.findall("actuator"):
        for element in section:
            name = element.get("name") or element.get("joint") or element.get("tendon") or ""
            where = f"<actuator>: {element.tag} {name!r}"
            if element.tag not in (*_MOTORS, *_OTHERS):
                raise RobotFileError(
                    f"{where}: {choose_from('or unsupported actuator', element.tag, _MOTORS)}"
                )
            attributes = {
                **bodies.settings.attributes(element, where, None, "general"),
                **bodies.settings.attributes(element, where, None),
            }
            motor = _motor(bodies, tendons, name, element.tag, attributes, where)
            if motor is not None:
                motors.append(motor)
    return motors


def _motor(
    bodies: Bodies,
    tendons: Mapping[str, Mapping[str, float]],
    name: str,
    tag: str,
    attributes: dict[str, str],
    where: str,
) -> Motor | None:
    """Return the motor of an element; None for one that is left out."""
    valid = [joint for joint, coordinate in bodies.coordinates.items() if coordinate.kind in _SCALAR]
    joint = attributes.get("joint", attributes.get("jointinparent"))
    shares: Mapping[str, float] | None = None
    acts_on: tuple[str, ...] = ()
    if joint is not None:
        if joint not in bodies.coordinates:
            raise RobotFileError(f"{where} joint: {choose_from('hinge or slide', joint, valid)}")
        shares, acts_on = ({joint: 1.0} if joint in valid else None), (joint,)
    elif "tendon" in attributes:
        shares = tendons.get(attributes["tendon"])
        acts_on = tuple(bodies.coordinates)
    parts = attributes.get("gear", "1").split()
    gear = numbers(f"{where} gear", attributes.get("gear", "1"), max(len(parts), 1))[0]
    if shares is None or tag in _OTHERS or gear == 0.0:
        bodies.left_out.append(LeftOut(f"{tag} {name!r}: no motor on a hinge or a slide", acts_on))
        return None
    limits = [symmetric_range(attributes, where, "forcerange")]
    if tag == "motor":
        limits.append(symmetric_range(attributes, where, "ctrlrange"))
    if joint is not None and (limit := bodies.coordinates[joint].force_limit) is not None:
        limits.append(limit / abs(gear))
    return Motor(name, shares, gear, min((limit for limit in limits if limit is not None), default=None))


def _fixed_tendons(root: ElementTree.Element, bodies: Bodies) -> dict[str, dict[str, float]]:
    """Return the joints of each fixed tendon with their coefficients; what else a tendon does is left out."""
    fixed: dict[str, dict[str, float]] = {}
    for tendon in (element for section in root.findall("tendon") for element in section):
        name = tendon.get("name", "")
        where = f"tendon {name!r}"
        attributes = bodies.settings.attributes(tendon, where, None, "tendon")
        joints = {}
        for part in tendon.findall("joint"):
            if part.get("joint") not in bodies.coordinates:
                raise RobotFileError(
                    f"{where} joint: {choose_from('joint', part.get('joint'), bodies.coordinates)}"
                )
            (ratio,) = numbers(f"{where} coef", part.get("coef"), 1)
            joints[str(part.get("joint"))] = ratio
        if tendon.tag == "fixed":
            fixed[name] = joints
        acting = [
            f"{key} {attributes[key]}"
            for key in ("stiffness", "damping", "frictionloss", "armature", "range")
            if any(value not in ("0", "0.0") for value in attributes.get(key, "0").split())
        ]
        acts_on = tuple(joints) or tuple(bodies.coordinates)  # a spatial one may touch any body
        if acting:
            bodies.left_out.append(LeftOut(f"{where}: {', '.join(acting)}", acts_on))
    return fixed


def keyframe_reference(root: ElementTree.Element, bodies: Bodies) -> dict[str, float]:
    """Return joint angles of the first key, from the zero pose; empty without one."""
    key = root.find("keyframe/key")
    if key is None or "qpos" not in key.attrib:
        return {}
    width = {"ball": 4, "free": 7}
    count = sum(width.get(c.kind, 1) for c in bodies.coordinates.values())
    values = list(numbers(f"<key> {key.get('name', '')!r} qpos", key.get("qpos"), count))
    reference = {}
    for name, coordinate in bodies.coordinates.items():
        size = width.get(coordinate.kind, 1)
        entries, values = values[:size], values[size:]
        if size == 1:
            reference[name] = entries[0] - coordinate.ref
            continue
        if not any(entries[-4:]):
            raise RobotFileError(f"<key> qpos: the quaternion of {coordinate.kind} {name!r} is zero")
        turn = from_quaternion(*entries[-4:])
        slides: list[float] = []
        if coordinate.kind == "free":  # its qpos is the pose of the body, not the way from the zero pose
            zero = coordinate.place[:3, :3]
            slides = (zero.T @ (np.array(entries[:3]) - coordinate.place[:3, 3])).tolist()
            turn = zero.T @ turn
        names = coordinates_of(name, "floating" if slides else "spherical")
        reference.update(zip(names, [*slides, *pin.log3(turn).tolist()], strict=True))
    return reference
