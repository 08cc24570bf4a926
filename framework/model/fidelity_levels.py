"""Levels of fidelity as data: models of one robot, from the simplest to all that its file describes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from xml.etree.ElementTree import Element, fromstring, tostring

from framework.model.description import RobotDescription
from framework.model.documents import remove_children
from framework.model.urdf_elements import read_tree


@dataclass(frozen=True)
class Level:
    """One model of a robot: its bodies with mass, its springs and its geometry."""

    name: str  # in robot files, tables and JSON
    summary: str
    bodies: str = "all"  # that have mass: none, payload or all; rotors always have their inertia
    flexibility: str = "rigid"  # says which springs exist, see `description.FLEXIBILITIES`
    geometry: str = "rigid"  # of the robot on which forces are computed: rigid or deformed
    elastic_inertia: bool = True  # whether the rates of deflections cause inertia forces


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
