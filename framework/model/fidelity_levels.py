"""Levels of fidelity as data: models of one robot, from the least to the most that its file can express."""

from __future__ import annotations

from dataclasses import dataclass, replace
from xml.etree.ElementTree import Element, fromstring, tostring

from framework.model.description import RobotDescription
from framework.model.documents import remove_children
from framework.model.urdf_elements import read_tree

BODIES = ("none", "payload", "all")


@dataclass(frozen=True)
class Level:
    """One model of a robot: its bodies, springs and geometry.

    bodies: with mass: none, the payload, all. Rotors always have their inertia.
    flexibility: existing springs.
    geometry: whether forces are those of the undeformed (rigid) or of the deformed robot.
    elastic_inertia: whether the rates of springs cause inertia forces, or only their deflections count.
    """

    name: str  # in robot files, tables and JSON
    summary: str
    bodies: str = "all"
    flexibility: str = "rigid"
    geometry: str = "rigid"
    elastic_inertia: bool = True


LEVELS = (
    Level("kinematics", "no body has mass; the motors turn their rotors", bodies="none"),
    Level("payload", "the platform's body has mass, the legs have none", bodies="payload"),
    Level("rigid", "all bodies have mass, nothing gives way"),
    Level("flexible_joints", "the drives give way", flexibility="flexible_joints"),
    Level("flexible_links", "links too; forces of the undeformed robot", flexibility="flexible_links"),
    Level(
        "deformed",
        "forces of the deformed robot, singular where that is",
        flexibility="flexible_links",
        geometry="deformed",
        elastic_inertia=False,
    ),
    Level(
        "elastic_inertia",
        "the bodies feel how the springs move",
        flexibility="flexible_links",
        geometry="deformed",
    ),
)
LEVELS_BY_NAME = {level.name: level for level in LEVELS}


def with_bodies(description: RobotDescription, bodies: str) -> RobotDescription:
    """Return the robot with mass in none, the payload or all of its bodies.

    The payload is the inertia of the platform's link, or of the moving body that the platform's frame is on
    if that link has none of its own, as in `control.variation`. Without any mass nothing acts on the
    joints either: only the rotors have forces.
    """
    if bodies == BODIES[-1]:
        return description
    root = fromstring(description.urdf_text)
    payload = _payload_links(description, root) if bodies == "payload" else frozenset[str]()
    for link in root.findall("link"):
        if link.get("name") not in payload:
            remove_children(link, "inertial")
    return replace(
        description,
        urdf_text=tostring(root, encoding="unicode"),
        joints=description.joints if payload else {},
    )


def _payload_links(description: RobotDescription, root: Element) -> frozenset[str]:
    """Return the names of the links whose inertia is the payload's."""
    platform, urdf = description.platform.frame, read_tree(root)
    (link,) = (link for link in root.findall("link") if link.get("name") == platform)
    mass = link.find("inertial/mass")
    if mass is not None and float(mass.get("value", "0")) > 0:
        return frozenset({platform})
    body = urdf.body(platform)
    return frozenset(name for name in urdf.links if urdf.body(name) == body)
