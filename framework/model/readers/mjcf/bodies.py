"""The bodies of an MJCF file with their joints and sites, as the links and joints of a URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field

import numpy as np

from framework.arrays import Array
from framework.errors import RobotFileError, choose_from
from framework.model.description import SMALLEST_LENGTH, JointDynamics
from framework.model.placement import placement
from framework.model.readers.left_out import LeftOut
from framework.model.readers.mjcf.geoms import UnknownInertia, inertial_element, visual_element
from framework.model.readers.mjcf.settings import (
    MAX_NESTING_DEPTH,
    TURNS,
    CompilerSettings,
    between_ends,
    known,
    word,
)
from framework.model.urdf_elements import coordinates_of
from framework.model.urdf_writing import joint_element, origin_element, vector_text
from framework.model.xml_reading import child_element, numbers

WORLD = "world"
_BODY = ("name", "childclass", "mocap", "pos", *TURNS, "gravcomp", "user", "sleep")
_JOINT = (
    *("name", "class", "type", "group", "pos", "axis", "springdamper", "solreflimit", "solimplimit"),
    *("solreffriction", "solimpfriction", "stiffness", "range", "limited", "actuatorfrcrange"),
    *("actuatorfrclimited", "actuatorgravcomp", "margin", "ref", "springref", "armature", "damping"),
    *("frictionloss", "user"),
)
_FREEJOINT = ("name", "group", "align")
_IN_URDF = {"hinge": "continuous", "slide": "prismatic", "ball": "spherical", "free": "floating"}


@dataclass
class Coordinate:
    """A joint of the file, and where it is at the zero pose."""

    kind: str
    ref: float
    force_limit: float | None  # of all motors on it together [N m, N]
    place: Array  # (4, 4) of the body in its parent at the zero pose


@dataclass
class Bodies:
    """The URDF that grows, and what the equalities need to know."""

    settings: CompilerSettings
    root: ElementTree.Element = field(default_factory=lambda: ElementTree.Element("robot", name="mjcf"))
    bodies: list[str] = field(default_factory=lambda: [WORLD])
    sites: dict[str, tuple[str, Array]] = field(default_factory=dict)
    coordinates: dict[str, Coordinate] = field(default_factory=dict)  # in the order of qpos
    joints: dict[str, JointDynamics] = field(default_factory=dict)  # by coordinate
    left_out: list[LeftOut] = field(default_factory=list)
    names: set[str] = field(default_factory=lambda: {WORLD})  # of links
    links: dict[str, ElementTree.Element] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.new_link(WORLD)

    def new_link(self, name: str) -> None:
        """Add a link without mass."""
        self.links[name] = ElementTree.SubElement(self.root, "link", name=name)

    def new_name(self, wanted: str) -> str:
        """Return a name that no link has."""
        name = wanted
        while name in self.names:
            name += "_"
        self.names.add(name)
        return name

    def body_content(
        self, element: ElementTree.Element, link: str, childclass: str | None, depth: int
    ) -> None:
        """Read geoms, sites and bodies below one body; its joints and inertia are already there."""
        if depth > MAX_NESTING_DEPTH:
            raise RobotFileError(f"body {link!r}: more than {MAX_NESTING_DEPTH} bodies inside each other")
        carried = ("joint", "freejoint", "inertial") if link != WORLD else ()
        valid = ("body", "geom", "site", "camera", "light", "plugin", *carried)
        where = f"body {link!r}"
        for child in element:
            if child.tag not in valid:
                raise RobotFileError(f"{where}: {choose_from('or unsupported element', child.tag, valid)}")
            if child.tag == "body":
                self.body(child, link, childclass, depth + 1)
            elif child.tag == "site":
                self.site(child, link, childclass)
            elif (
                child.tag == "geom"
                and (shape := visual_element(self.settings, child, link, childclass)) is not None
            ):
                self.links[link].append(shape)

    def body(self, element: ElementTree.Element, parent: str, childclass: str | None, depth: int) -> None:
        """Read one body: the joints that carry it, its mass, and its children."""
        given = element.get("name") or None  # MuJoCo takes an empty name for none
        name = given or self.new_name(f"body_{len(self.bodies)}")
        if given is not None:
            if given in self.names:
                raise RobotFileError(f"body {given!r}: duplicate name, or taken")
            self.names.add(given)
        where = f"body {name!r}"
        known(element, where, _BODY)
        if element.get("mocap") == "true":
            self.left_out.append(LeftOut(f"{where}: mocap, so it stands still", (name,)))
        childclass = element.get("childclass", childclass)
        offset = self.settings.placed(element.attrib, where)
        # a joint turns about a point of the body; its link stands in that point, the body's own behind it
        joints = [child for child in element if child.tag in ("joint", "freejoint")]
        for i, joint in enumerate(joints):
            attributes = self.joint_attributes(joint, where, childclass)
            if attributes.get("type") == "free" and (len(joints) > 1 or parent != WORLD):
                raise RobotFileError(f"{where}: only a body of the world is free, and has no other joint")
            position = numbers(f"{where}: <joint> pos", attributes.get("pos", "0 0 0"), 3)
            last = i == len(joints) - 1 and not any(position)
            parent = self.joint(name, i, attributes, parent, offset @ placement(None, position), last)
            offset = placement(None, [-value for value in position])
        if not joints or parent != name:
            self.new_link(name)
            mount = self.new_name(f"{name}_mount")
            self.root.append(joint_element(mount, "fixed", parent, name, origin=origin_element(offset)))
        self.bodies.append(name)
        if len(self.bodies) > 5000:
            raise RobotFileError("<worldbody>: more than 5000 bodies")
        try:
            mass = inertial_element(self.settings, element, name, childclass)
        except UnknownInertia as unknown:
            self.left_out.append(LeftOut(str(unknown), (name,)))
            mass = None
        if mass is not None:
            self.links[name].append(mass)
            self.gravity_compensation(element, name, mass)
        self.body_content(element, name, childclass, depth)

    def joint_attributes(
        self, element: ElementTree.Element, where: str, childclass: str | None
    ) -> dict[str, str]:
        """Return the attributes of a joint with their defaults; `<freejoint>` takes none."""
        if element.tag == "joint":
            return self.settings.attributes(element, f"{where}: <joint>", childclass)
        known(element, f"{where}: <freejoint>", _FREEJOINT)
        return {"type": "free"} | ({"name": element.get("name", "")} if element.get("name") else {})

    def joint(
        self, body: str, i: int, attributes: dict[str, str], parent: str, origin: Array, last: bool
    ) -> str:
        """Add one joint; returns the link behind it."""
        name = attributes.get("name") or f"{body}_joint" + (f"_{i + 1}" if i else "")
        where = f"joint {name!r}"
        for key in attributes:
            if key not in _JOINT:
                raise RobotFileError(f"{where}: {choose_from('attribute', key, _JOINT)}")
        if name in self.coordinates:
            raise RobotFileError(f"{where}: duplicate name")
        kind = attributes.get("type", "hinge")
        if kind not in _IN_URDF:
            raise RobotFileError(f"{where}: {choose_from('type', kind, _IN_URDF)}")
        unit = 1.0 if kind == "slide" else self.settings.angle
        several = kind in ("ball", "free")
        ref = 0.0 if several else unit * numbers(f"{where} ref", attributes.get("ref", "0"), 1)[0]
        axis = np.array(numbers(f"{where} axis", attributes.get("axis", "0 0 1"), 3))
        if not several and np.abs(axis).max() < SMALLEST_LENGTH:
            raise RobotFileError(f"{where} axis: the axis is zero")
        child = body if last else self.new_name(f"{name}_link")
        self.new_link(child)
        along, placed = None if several else vector_text(axis), origin_element(origin)
        limits = () if several else self.range(where, attributes, unit, ref)
        in_urdf = "revolute" if limits and kind == "hinge" else _IN_URDF[kind]
        element = joint_element(name, in_urdf, parent, child, origin=placed, axis=along)
        for key, value in zip(("lower", "upper"), limits, strict=False):
            child_element(element, where, "limit").set(key, repr(value))
        self.root.append(element)
        limit = symmetric_range(attributes, where, "actuatorfrcrange")
        self.coordinates[name] = Coordinate(kind, ref, limit, origin)
        acting = self.acting(name, kind, attributes, unit, ref)
        if acting != JointDynamics():
            self.joints.update(dict.fromkeys(coordinates_of(name, _IN_URDF[kind]), acting))
        return child

    def range(self, where: str, attributes: dict[str, str], unit: float, ref: float) -> tuple[float, ...]:
        """Return lower and upper limit [rad, m] from the zero pose; empty without limits."""
        limited = word(attributes, where, "limited", ("true", "false", "auto"), "auto")
        lower, upper = numbers(f"{where} range", attributes.get("range", "0 0"), 2)
        if limited == "false" or (limited == "auto" and lower == upper == 0.0):
            return ()
        if limited == "auto" and not self.settings.autolimits:
            raise RobotFileError(f"{where} limited: needs true or false beside a range without autolimits")
        if lower >= upper:
            raise RobotFileError(f"{where} range: needs lower < upper, got {lower:g} {upper:g}")
        return unit * lower - ref, unit * upper - ref

    def acting(
        self, name: str, kind: str, attributes: dict[str, str], unit: float, ref: float
    ) -> JointDynamics:
        """Return inertia, damping, dry friction and spring of a joint, per radian whatever the unit."""
        where = f"joint {name!r}"
        values = {"armature": 0.0, "damping": 0.0, "frictionloss": 0.0, "stiffness": 0.0}
        for key in values:
            # of a polynomial (MuJoCo 3.4) the first coefficient is the linear one
            parts = attributes.get(key, "0").split()
            first, *higher = numbers(f"{where} {key}", attributes.get(key, "0"), max(len(parts), 1))
            if first < 0:
                raise RobotFileError(f"{where} {key}: must not be negative, got {first:g}")
            if any(higher):
                self.left_out.append(LeftOut(f"{where} {key}: higher powers {' '.join(parts[1:])}", (name,)))
            values[key] = first
        if any(numbers(f"{where} springdamper", attributes.get("springdamper", "0 0"), 2)):
            text = f"{where} springdamper {attributes['springdamper']}: time constant and damping ratio"
            self.left_out.append(LeftOut(text, (name,)))
        if kind in ("ball", "free") and values["stiffness"]:
            text = f"{where}: spring of a {kind} joint, {values['stiffness']:g} N m/rad"
            self.left_out.append(LeftOut(text, (name,)))
            values["stiffness"] = 0.0
        rest = unit * numbers(f"{where} springref", attributes.get("springref", "0"), 1)[0] - ref
        return JointDynamics(
            armature=values["armature"],
            damping=values["damping"],
            friction=values["frictionloss"],
            stiffness=values["stiffness"],
            rest=rest if values["stiffness"] else 0.0,
        )

    def gravity_compensation(
        self, element: ElementTree.Element, body: str, inertial: ElementTree.Element
    ) -> None:
        """Name the force that holds a body up, if there is one: it is left out."""
        (share,) = numbers(f"body {body!r} gravcomp", element.get("gravcomp", "0"), 1)
        if share:
            mass = float(child_element(inertial, body, "mass").get("value", "0"))
            force = share * mass * float(np.linalg.norm(self.settings.gravity))
            self.left_out.append(LeftOut(f"body {body!r} gravcomp {share:g}: {force:.3g} N", (body,)))

    def site(self, element: ElementTree.Element, link: str, childclass: str | None) -> None:
        """Make a frame of a site with a name."""
        name = element.get("name")
        attributes = self.settings.attributes(element, f"site {name!r}", childclass)
        if not name:
            return
        if name in self.sites:
            raise RobotFileError(f"duplicate site {name!r}")
        where = f"site {name!r}"
        ends = attributes.get("fromto")
        place = self.settings.placed(attributes, where) if ends is None else between_ends(where, ends)[0]
        self.sites[name] = (link, place)


def symmetric_range(attributes: dict[str, str], where: str, key: str) -> float | None:
    """Return the upper end of a range that is as wide on either side; None without one."""
    low, high = numbers(f"{where} {key}", attributes.get(key, "0 0"), 2)
    return high if high > 0 and low == -high else None
