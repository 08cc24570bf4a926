"""The joints and links of a URDF of a foreign dialect, read one by one and checked."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass

import numpy as np

from framework.arrays import Array
from framework.errors import RobotFileError, choose_from, short
from framework.model.inertia import ENTRIES, check_inertia, symmetric
from framework.model.urdf import JOINT_TYPES, MOVING
from framework.model.xml_reading import attribute, axis_of, numbers, origin_of, required

_LIMIT = ("lower", "upper", "effort", "velocity")


@dataclass
class Joint:
    """A joint of the tree; `origin` (4, 4) is its placement in the parent link at zero."""

    element: ElementTree.Element
    name: str
    kind: str
    parent: str
    child: str
    origin: Array
    axis: Array

    @property
    def moves(self) -> bool:
        return self.kind in MOVING


def unique_names(root: ElementTree.Element, tag: str) -> list[str]:
    """Names of the elements with this tag, each there once.

    Raises:
        RobotFileError: an element has no name, or that of another.
    """
    names: dict[str, None] = {}
    for element in root.findall(tag):
        name = attribute(element, f"<{tag}>", "name")
        if name in names:
            raise RobotFileError(f"{tag} {name!r} is there twice")
        names[name] = None
    return list(names)


def read_joint(element: ElementTree.Element, links: set[str]) -> Joint:
    """A joint between two of these links; what has no meaning is taken out of the element.

    Raises:
        RobotFileError: its type, links, axis, limit or placement cannot be right.
    """
    name = str(element.get("name"))
    where = f"joint {name!r}"
    kind = attribute(element, where, "type")
    if kind not in JOINT_TYPES:
        raise RobotFileError(f"{where}: {choose_from('type', kind, JOINT_TYPES)}")
    if element.find("mimic") is not None:
        raise RobotFileError(f"{where}: <mimic> is not supported; declare a loop instead")
    ends = []
    for end in ("parent", "child"):
        link = attribute(required(element, where, end), f"{where}: <{end}>", "link")
        if link not in links:
            raise RobotFileError(f"{where}: {end}: {choose_from('link', link, links)}")
        ends.append(link)
    axis = element.find("axis")
    direction = np.array([1.0, 0.0, 0.0])
    if kind == "fixed" and axis is not None:
        element.remove(axis)  # without a meaning, and some exporters write 0 0 0
    elif axis is not None:
        direction = axis_of(axis, f"{where}: <axis>")
    if kind in ("revolute", "prismatic"):
        limit = required(element, where, "limit")
        for key in ("effort", "velocity"):
            attribute(limit, f"{where}: <limit>", key)
        lower, upper, effort, velocity = (
            # some files mean no limit by 1.8e308
            numbers(f"{where}: <limit> {key}", limit.get(key, "0"), 1, largest=math.inf)[0]
            for key in _LIMIT
        )
        if lower > upper or effort < 0 or velocity < 0:
            raise RobotFileError(
                f"{where}: <limit>: needs lower <= upper, effort and velocity of at least zero, got lower "
                f"{lower:g}, upper {upper:g}, effort {effort:g}, velocity {velocity:g}"
            )
    if "independent" in element.attrib:
        del element.attrib["independent"]  # a URDF+ hint, read before
    origin = origin_of(element.find("origin"), f"{where}: <origin>")
    return Joint(element, name, kind, ends[0], ends[1], origin, direction)


def check_link(link: ElementTree.Element) -> None:
    """Look at a link's inertia.

    Raises:
        RobotFileError: a number is missing or not finite, or no body has such an inertia.
    """
    where = f"link {link.get('name')!r}"
    inertial = link.find("inertial")
    if inertial is None:
        return
    origin_of(inertial.find("origin"), f"{where}: <inertial> <origin>")
    mass = required(inertial, f"{where}: <inertial>", "mass")
    (kilograms,) = numbers(f"{where}: <mass>", attribute(mass, f"{where}: <mass>", "value"), 1)
    if kilograms < 0:
        raise RobotFileError(f"{where}: <mass>: must not be negative, got {short(mass.get('value'))}")
    inertia = required(inertial, f"{where}: <inertial>", "inertia")
    values = [
        numbers(f"{where}: <inertia> {key}", attribute(inertia, f"{where}: <inertia>", key), 1)[0]
        for key in ENTRIES
    ]
    check_inertia(f"{where}: <inertia>", symmetric(*values), kilograms)


def declared_motors(root: ElementTree.Element) -> list[str]:
    """Joints with a transmission or a command interface, as ROS says which joints are driven."""
    names = [joint.get("name", "") for joint in root.findall("transmission/joint")]
    names += [
        joint.get("name", "")
        for joint in root.findall("ros2_control/joint")
        if joint.find("command_interface") is not None
    ]
    return list(dict.fromkeys(name for name in names if name))


def local_name(tag: str) -> str:
    """A tag without its namespace."""
    return tag.rsplit("}", 1)[-1]
