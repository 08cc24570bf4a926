"""MJCF, MuJoCo's XML: its bodies become a URDF, its `<equality>` the closures.

Read are: bodies with hinge, slide and ball joints (a ball becomes three turns J_X, J_Y, J_Z), `<inertial>`
or the inertia of primitive geoms, sites as frames, primitive geoms as shapes, defaults and their classes,
gravity, springs of joints, motors with gear and armature, the first keyframe as the reference (else the
zero pose). Of `<equality>`: connect is spherical, weld is fixed, joint is read where it holds a joint or
keeps two turns about parallel axes equal. Anchors are resolved at the zero pose, as MuJoCo does. What moves
otherwise - free joints, tendons, flexes, mocap bodies, includes - is refused by name; contact, damping,
friction, joint ranges, sensors, cameras and meshes are left out. The file says nothing about the platform.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from framework.arrays import Array
from framework.errors import RobotFileError, choose_from, short
from framework.model.description import Actuator, Closure, JointSpring, ParsedRobot, locked_axes
from framework.model.inertia import check_inertia, symmetric
from framework.model.placement import about, from_quaternion, inverse, placement
from framework.model.readers.describe import describe
from framework.model.readers.missing_fields import Options
from framework.model.readers.urdf_tree import MOST_LOOPS, UrdfTree
from framework.model.urdf_writing import AXIS, joint_element, origin_element, vector_text
from framework.model.xml_reading import numbers

WORLD = "world"
DEEPEST = 200  # bodies in bodies
_SECTIONS_LEFT_OUT = ("asset", "contact", "sensor", "visual", "statistic", "size", "custom")
_SECTIONS = ("compiler", "option", "default", "worldbody", "equality", "actuator", "keyframe")
_TURNS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")
_BODY = ("name", "childclass", "mocap", "pos", *_TURNS, "gravcomp", "user", "sleep")
_INERTIAL = ("pos", *_TURNS, "mass", "diaginertia", "fullinertia")
_JOINT = (
    *("name", "class", "type", "group", "pos", "axis", "springdamper", "solreflimit", "solimplimit"),
    *("solreffriction", "solimpfriction", "stiffness", "range", "limited", "actuatorfrcrange"),
    *("actuatorfrclimited", "actuatorgravcomp", "margin", "ref", "springref", "armature", "damping"),
    *("frictionloss", "user"),
)
_EQUALITY = ("name", "class", "active", "solref", "solimp")
_CONNECT = (*_EQUALITY, "body1", "body2", "anchor", "site1", "site2")
_WELD = (*_CONNECT, "relpose", "torquescale")
_JOINT_EQUALITY = (*_EQUALITY, "joint1", "joint2", "polycoef")
_MOTORS = ("motor", "position", "velocity", "intvelocity", "damper", "general")
_GEOMS = ("sphere", "box", "cylinder", "capsule", "ellipsoid")
_FREE = "a free body is not supported; carry it by slides and hinges"
_DENSITY = 1000.0  # MuJoCo's default [kg/m^3]


def read_mjcf(file: Path, root: ElementTree.Element, options: Options) -> ParsedRobot:
    """The description in an MJCF file.

    Raises:
        RobotFileError: names the element.
    """
    for section in root:
        if section.tag == "tendon" and not len(section):
            continue
        if section.tag not in (*_SECTIONS, *_SECTIONS_LEFT_OUT):
            raise RobotFileError(choose_from("or unsupported section", f"<{section.tag}>", _SECTIONS))
    model = _Model(_Settings(root))
    worlds = root.findall("worldbody")
    if not worlds:
        raise RobotFileError("<worldbody> is missing")
    for world in worlds:
        model.body_content(world, WORLD, None, 0)
    return model.describe(file, root, options)


# ------------------------------------------------------------------ settings and defaults


class _Settings:
    """Units, Euler sequence, gravity, defaults."""

    def __init__(self, root: ElementTree.Element) -> None:
        compiler = {key: value for c in root.findall("compiler") for key, value in c.attrib.items()}
        angle = _word(compiler, "<compiler>", "angle", ("degree", "radian"), "degree")
        self.angle = math.pi / 180.0 if angle == "degree" else 1.0
        _word(compiler, "<compiler>", "coordinate", ("local",), "local")
        self.eulerseq = compiler.get("eulerseq", "xyz")
        if len(self.eulerseq) != 3 or set(self.eulerseq.lower()) - set("xyz"):
            raise RobotFileError(
                f"<compiler> eulerseq: needs three of x, y, z, X, Y, Z, got {short(self.eulerseq)}"
            )
        self.from_geoms = _word(compiler, "<compiler>", "inertiafromgeom", ("auto", "true", "false"), "auto")
        for key in ("settotalmass", "boundmass", "boundinertia"):
            if numbers(f"<compiler> {key}", compiler.get(key, "0"), 1)[0] > 0:
                raise RobotFileError(f"<compiler> {key}: not supported; give each body its own inertia")
        if "inertiagrouprange" in compiler:
            raise RobotFileError("<compiler> inertiagrouprange: not supported; give bodies an <inertial>")
        self.gravity = (0.0, 0.0, -9.81)
        for option in root.findall("option"):
            if "gravity" in option.attrib:
                x, y, z = numbers("<option> gravity", option.get("gravity"), 3)
                self.gravity = (x, y, z)
            for flag in option.findall("flag"):
                if flag.get("gravity") == "disable":
                    self.gravity = (0.0, 0.0, 0.0)
                if flag.get("equality") == "disable":
                    raise RobotFileError("<flag> equality: disabled, so there would be no loop")
        self.defaults: dict[str, dict[str, dict[str, str]]] = {"main": {}}
        for default in root.findall("default"):
            self._read_default(default, {}, 0)

    def _read_default(
        self, element: ElementTree.Element, above: dict[str, dict[str, str]], depth: int
    ) -> None:
        name = element.get("class", "main" if depth == 0 else "")
        if not name:
            raise RobotFileError("<default>: a nested default needs a class")
        if depth > DEEPEST:
            raise RobotFileError("<default>: nested too deeply")
        own = {tag: dict(values) for tag, values in above.items()}
        for child in element:
            if child.tag != "default":
                own[child.tag] = {**own.get(child.tag, {}), **child.attrib}
        self.defaults[name] = own
        for child in element.findall("default"):
            self._read_default(child, own, depth + 1)

    def attributes(
        self, element: ElementTree.Element, where: str, childclass: str | None, tag: str | None = None
    ) -> dict[str, str]:
        """The attributes of an element over those of its class."""
        name = element.get("class", childclass or "main")
        if name not in self.defaults:
            raise RobotFileError(f"{where}: {choose_from('class', name, self.defaults)}")
        return {**self.defaults[name].get(tag or element.tag, {}), **element.attrib}

    def placed(self, attributes: Mapping[str, str], where: str) -> Array:
        """The placement of `pos` and one of the ways to write an orientation."""
        given = [key for key in _TURNS if key in attributes]
        if len(given) > 1:
            raise RobotFileError(f"{where}: needs one orientation, got {' and '.join(given)}")
        position = numbers(f"{where} pos", attributes.get("pos", "0 0 0"), 3)
        if not given:
            return placement(None, position)
        key = given[0]
        values = numbers(
            f"{where} {key}", attributes[key], {"quat": 4, "axisangle": 4, "xyaxes": 6}.get(key, 3)
        )
        if key != "euler" and not any(values[:4] if key == "quat" else values[:3]):
            raise RobotFileError(f"{where} {key}: zero has no direction")
        if key == "quat":
            turn = from_quaternion(values[0], values[1], values[2], values[3])
        elif key == "axisangle":
            turn = about(values[:3], self.angle * values[3])
        elif key == "euler":
            turn = np.eye(3)
            for letter, angle in zip(self.eulerseq, values, strict=True):
                one = about(np.eye(3)["xyz".index(letter.lower())], self.angle * angle)
                turn = turn @ one if letter.islower() else one @ turn
        elif key == "zaxis":
            turn = _least_turn(np.array(values))
        else:
            turn = _from_xy(np.array(values[:3]), np.array(values[3:]), f"{where} xyaxes")
        return placement(turn, position)


def _least_turn(z: Array) -> Array:
    """The least turn that brings z to this direction."""
    z = z / np.linalg.norm(z)
    axis = np.cross((0.0, 0.0, 1.0), z)
    if np.linalg.norm(axis) < 1e-15:
        return np.eye(3) if z[2] > 0 else np.diag([1.0, -1.0, -1.0])
    return about(axis, math.atan2(float(np.linalg.norm(axis)), float(z[2])))


def _from_xy(x: Array, y: Array, where: str) -> Array:
    x = x / np.linalg.norm(x)
    y = y - (x @ y) * x
    if np.linalg.norm(y) < 1e-12:
        raise RobotFileError(f"{where}: the two axes are parallel")
    y = y / np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])


# ------------------------------------------------------------------ bodies


@dataclass
class _Coordinate:
    """A joint of the file: its URDF joints, and where it is at the zero pose."""

    joints: list[str]
    kind: str
    ref: float
    armature: float


@dataclass
class _Model:
    """The URDF that grows, and what the equalities need to know."""

    settings: _Settings
    root: ElementTree.Element = field(default_factory=lambda: ElementTree.Element("robot", name="mjcf"))
    bodies: list[str] = field(default_factory=lambda: [WORLD])
    sites: dict[str, tuple[str, Array]] = field(default_factory=dict)
    coordinates: dict[str, _Coordinate] = field(default_factory=dict)  # in the order of qpos
    springs: list[JointSpring] = field(default_factory=list)
    names: set[str] = field(default_factory=lambda: {WORLD})  # of links
    links: dict[str, ElementTree.Element] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.new_link(WORLD)

    def new_link(self, name: str) -> None:
        """Add a link without mass."""
        self.links[name] = ElementTree.SubElement(self.root, "link", name=name)

    def new_name(self, wanted: str) -> str:
        """A name that no link has."""
        name = wanted
        while name in self.names:
            name += "_"
        self.names.add(name)
        return name

    def body_content(
        self, element: ElementTree.Element, link: str, childclass: str | None, depth: int
    ) -> None:
        """Geoms, sites and bodies below one body; its joints and inertia are already there."""
        if depth > DEEPEST:
            raise RobotFileError(f"body {link!r}: more than {DEEPEST} bodies inside each other")
        valid = ("body", "geom", "site", "camera", "light") + (("joint", "inertial") if link != WORLD else ())
        where = f"body {link!r}"
        for child in element:
            if child.tag == "freejoint":
                raise RobotFileError(f"{where}: {_FREE}")
            if child.tag not in valid:
                raise RobotFileError(f"{where}: {choose_from('or unsupported element', child.tag, valid)}")
            if child.tag == "body":
                self.body(child, link, childclass, depth + 1)
            elif child.tag == "site":
                self.site(child, link, childclass)
            elif child.tag == "geom" and (shape := self.shape(child, link, childclass)) is not None:
                self.links[link].append(shape)

    def body(self, element: ElementTree.Element, parent: str, childclass: str | None, depth: int) -> None:
        given = element.get("name") or None  # MuJoCo takes an empty name for none
        name = given or self.new_name(f"body_{len(self.bodies)}")
        if given is not None:
            if given in self.names:
                raise RobotFileError(f"body {given!r}: the name is there twice, or taken")
            self.names.add(given)
        where = f"body {name!r}"
        _known(element, where, _BODY)
        if element.get("mocap") == "true":
            raise RobotFileError(f"{where}: mocap bodies are not supported")
        if "gravcomp" in element.attrib and numbers(f"{where} gravcomp", element.get("gravcomp"), 1)[0]:
            raise RobotFileError(f"{where}: gravcomp is not supported")
        childclass = element.get("childclass", childclass)
        offset = self.settings.placed(element.attrib, where)
        # a joint turns about a point of the body; its link stands in that point, the body's own behind it
        joints = element.findall("joint")
        for i, joint in enumerate(joints):
            attributes = self.settings.attributes(joint, f"{where}: <joint>", childclass)
            at = numbers(f"{where}: <joint> pos", attributes.get("pos", "0 0 0"), 3)
            last = i == len(joints) - 1 and not any(at)
            parent = self.joint(name, i, attributes, parent, offset @ placement(None, at), last)
            offset = placement(None, [-value for value in at])
        if not joints or parent != name:
            self.new_link(name)
            mount = self.new_name(f"{name}_mount")
            self.root.append(joint_element(mount, "fixed", parent, name, origin=origin_element(offset)))
        self.bodies.append(name)
        if len(self.bodies) > 5000:
            raise RobotFileError("<worldbody>: more than 5000 bodies")
        self.inertia(element, name, childclass)
        self.body_content(element, name, childclass, depth)

    def joint(
        self, body: str, i: int, attributes: dict[str, str], parent: str, origin: Array, last: bool
    ) -> str:
        """Add the URDF joints of one joint; returns the link behind them."""
        name = attributes.get("name") or f"{body}_joint" + (f"_{i + 1}" if i else "")
        where = f"joint {name!r}"
        for key in attributes:
            if key not in _JOINT:
                raise RobotFileError(f"{where}: {choose_from('attribute', key, _JOINT)}")
        if name in self.coordinates:
            raise RobotFileError(f"{where}: the name is there twice")
        kind = attributes.get("type", "hinge")
        if kind == "free":
            raise RobotFileError(f"{where}: {_FREE}")
        if kind not in ("hinge", "slide", "ball"):
            raise RobotFileError(f"{where}: {choose_from('type', kind, ('hinge', 'slide', 'ball'))}")
        unit = 1.0 if kind == "slide" else self.settings.angle
        if any(numbers(f"{where} springdamper", attributes.get("springdamper", "0 0"), 2)):
            raise RobotFileError(f"{where} springdamper: not supported; give stiffness")
        armature = numbers(f"{where} armature", attributes.get("armature", "0"), 1)[0]
        ref = unit * numbers(f"{where} ref", attributes.get("ref", "0"), 1)[0] if kind != "ball" else 0.0
        names = [f"{name}_{letter}" for letter in "XYZ"] if kind == "ball" else [name]
        axis = np.array(numbers(f"{where} axis", attributes.get("axis", "0 0 1"), 3))
        if kind != "ball" and np.linalg.norm(axis) < 1e-13:
            raise RobotFileError(f"{where} axis: the axis is zero")
        for k, joint in enumerate(names):
            child = body if last and k == len(names) - 1 else self.new_name(f"{joint}_link")
            self.new_link(child)
            urdf_kind = "prismatic" if kind == "slide" else "continuous"
            turns = AXIS["xyz"[k]] if kind == "ball" else vector_text(axis)
            place = origin_element(origin)
            self.root.append(joint_element(joint, urdf_kind, parent, child, origin=place, axis=turns))
            parent, origin = child, np.eye(4)
        self.coordinates[name] = _Coordinate(names, kind, ref, armature)
        self.spring(name, kind, attributes, unit, ref)
        return parent

    def spring(self, name: str, kind: str, attributes: dict[str, str], unit: float, ref: float) -> None:
        """A spring on the joint, if it has one. MuJoCo's stiffness is per radian whatever the unit."""
        where = f"joint {name!r} stiffness"
        parts = attributes.get("stiffness", "0").split()
        values = numbers(where, attributes.get("stiffness", "0"), min(max(len(parts), 1), 3))
        if any(values[1:]) or values[0] < 0:
            raise RobotFileError(f"{where}: needs one number of at least zero, got {' '.join(parts)}")
        if values[0] == 0:
            return
        if kind == "ball":
            raise RobotFileError(f"{where}: springs of ball joints are not supported")
        rest = unit * numbers(f"joint {name!r} springref", attributes.get("springref", "0"), 1)[0]
        self.springs.append(JointSpring(f"{name}_spring", name, values[0], rest - ref))

    def site(self, element: ElementTree.Element, link: str, childclass: str | None) -> None:
        name = element.get("name")
        attributes = self.settings.attributes(element, f"site {name!r}", childclass)
        if not name:
            return
        if name in self.sites:
            raise RobotFileError(f"site {name!r} is there twice")
        if "fromto" in attributes:
            raise RobotFileError(f"site {name!r} fromto: not supported; give pos and an orientation")
        self.sites[name] = (link, self.settings.placed(attributes, f"site {name!r}"))

    # -------------------------------------------------------------- mass and shape

    def inertia(self, element: ElementTree.Element, link: str, childclass: str | None) -> None:
        """The `<inertial>` of a body, else the one of its geoms."""
        found = element.findall("inertial")
        if len(found) > 1:
            raise RobotFileError(f"body {link!r}: <inertial> is there twice")
        if found and self.settings.from_geoms != "true":
            where = f"body {link!r}: <inertial>"
            _known(found[0], where, _INERTIAL)
            mass, com, matrix = self._given_inertia(found[0], where)
        elif self.settings.from_geoms == "false":
            return
        else:
            parts = [
                part
                for geom in element.findall("geom")
                if (part := self._geom_inertia(geom, link, childclass)) is not None
            ]
            if not parts:
                return
            mass, com, matrix = _together(parts)
        inertial = ElementTree.SubElement(self.links[link], "inertial")
        inertial.append(origin_element(placement(None, com)))
        ElementTree.SubElement(inertial, "mass", value=repr(float(mass)))
        names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        entries = matrix[np.triu_indices(3)]
        ElementTree.SubElement(
            inertial, "inertia", {n: repr(float(v)) for n, v in zip(names, entries, strict=True)}
        )

    def _given_inertia(self, element: ElementTree.Element, where: str) -> tuple[float, Array, Array]:
        if "mass" not in element.attrib:
            raise RobotFileError(f"{where}: mass is missing")
        (mass,) = numbers(f"{where} mass", element.get("mass"), 1)
        if mass < 0:
            raise RobotFileError(f"{where} mass: must not be negative, got {mass:g}")
        where_at = self.settings.placed(element.attrib, where)
        if "fullinertia" in element.attrib:
            if any(key in element.attrib for key in (*_TURNS, "diaginertia")):
                raise RobotFileError(f"{where}: fullinertia goes without an orientation and diaginertia")
            xx, yy, zz, xy, xz, yz = numbers(f"{where} fullinertia", element.get("fullinertia"), 6)
            matrix = symmetric(xx, yy, zz, xy, xz, yz)
            check_inertia(f"{where} fullinertia", matrix, mass)
            return mass, where_at[:3, 3], matrix
        if "diaginertia" not in element.attrib:
            raise RobotFileError(f"{where}: needs diaginertia or fullinertia")
        diagonal = np.diag(numbers(f"{where} diaginertia", element.get("diaginertia"), 3))
        check_inertia(f"{where} diaginertia", diagonal, mass)
        turn = where_at[:3, :3]
        return mass, where_at[:3, 3], turn @ diagonal @ turn.T

    def _geom_inertia(
        self, element: ElementTree.Element, link: str, childclass: str | None
    ) -> tuple[float, Array, Array] | None:
        where = f"body {link!r}: <geom>"
        attributes = self.settings.attributes(element, where, childclass)
        density = numbers(f"{where} density", attributes.get("density", repr(_DENSITY)), 1)[0]
        mass = numbers(f"{where} mass", attributes["mass"], 1)[0] if "mass" in attributes else None
        if mass == 0.0 or (mass is None and density == 0.0):
            return None
        kind, size, where_at = self.geometry(attributes, where)
        if kind not in _GEOMS:
            raise RobotFileError(
                f"{where} type: the inertia of a {kind} is not computed; give the body an <inertial>"
            )
        volume, unit = _solid(kind, size)  # of a solid of one kilogram
        mass = density * volume if mass is None else mass
        turn = where_at[:3, :3]
        return mass, where_at[:3, 3], mass * turn @ np.diag(unit) @ turn.T

    def geometry(self, attributes: Mapping[str, str], where: str) -> tuple[str, tuple[float, ...], Array]:
        """Type, sizes and placement of a geom."""
        kind = attributes.get("type", "mesh" if "mesh" in attributes else "sphere")
        if kind not in _GEOMS:
            if kind not in ("plane", "hfield", "mesh", "sdf"):
                raise RobotFileError(f"{where} type: {choose_from('type', kind, (*_GEOMS, 'mesh', 'plane'))}")
            return kind, (), np.eye(4)
        count = {"sphere": 1, "box": 3, "ellipsoid": 3}.get(kind, 2)
        if "fromto" in attributes:
            if kind == "sphere":
                raise RobotFileError(f"{where} fromto: a sphere has no ends")
            ends = np.array(numbers(f"{where} fromto", attributes["fromto"], 6))
            along = ends[:3] - ends[3:]
            half = 0.5 * float(np.linalg.norm(along))
            if half == 0.0:
                raise RobotFileError(f"{where} fromto: the two ends coincide")
            first = _sizes(attributes, f"{where} size", 1)
            sizes = (first[0], half) if count == 2 else (first[0], first[0], half)
            return kind, sizes, placement(_least_turn(along), 0.5 * (ends[:3] + ends[3:]))
        return kind, _sizes(attributes, f"{where} size", count), self.settings.placed(attributes, where)

    def shape(
        self, element: ElementTree.Element, link: str, childclass: str | None
    ) -> ElementTree.Element | None:
        """The URDF's `<visual>` of a primitive geom; a capsule is drawn as a cylinder."""
        where = f"body {link!r}: <geom>"
        kind, size, where_at = self.geometry(self.settings.attributes(element, where, childclass), where)
        visual = ElementTree.Element("visual")
        visual.append(origin_element(where_at))
        geometry = ElementTree.SubElement(visual, "geometry")
        if kind == "sphere":
            ElementTree.SubElement(geometry, "sphere", radius=repr(size[0]))
        elif kind == "box":
            ElementTree.SubElement(geometry, "box", size=" ".join(repr(2 * value) for value in size))
        elif kind in ("cylinder", "capsule"):
            ElementTree.SubElement(geometry, "cylinder", radius=repr(size[0]), length=repr(2 * size[1]))
        else:
            return None
        return visual

    # -------------------------------------------------------------- loops, motors, pose

    def describe(self, file: Path, root: ElementTree.Element, options: Options) -> ParsedRobot:
        if sum(len(section) for section in root.findall("equality")) > MOST_LOOPS:
            raise RobotFileError(f"<equality>: at most {MOST_LOOPS} equalities are read")
        tree = UrdfTree(self.root)
        frames = {name: tree.add_frame(name, link, at) for name, (link, at) in self.sites.items()}
        closures: list[Closure] = []
        for section in root.findall("equality"):
            for element in section:
                if (closure := self.equality(tree, frames, element, len(closures) + 1)) is not None:
                    closures.append(closure)
        return describe(
            tree,
            file,
            options,
            closures,
            actuators=self.actuators(root, tree),
            joint_springs=[spring for spring in self.springs if spring.joint in tree.movable],
            gravity=self.settings.gravity,
            reference={name: value for name, value in self.keyframe(root).items() if name in tree.movable},
        )

    def equality(
        self, tree: UrdfTree, frames: Mapping[str, str], element: ElementTree.Element, number: int
    ) -> Closure | None:
        kinds = {"connect": _CONNECT, "weld": _WELD, "joint": _JOINT_EQUALITY}
        if element.tag not in kinds:
            raise RobotFileError(f"<equality>: {choose_from('or unsupported element', element.tag, kinds)}")
        name = element.get("name") or f"{element.tag}_{number}"
        where = f"{element.tag} {name!r}"
        _known(element, where, kinds[element.tag])
        attributes = {
            key: value
            for key, value in self.settings.attributes(element, where, None, "equality").items()
            if key in kinds[element.tag]
        }
        if _word(attributes, where, "active", ("true", "false"), "true") == "false":
            return None
        if element.tag == "joint":
            return self._joint_equality(tree, name, where, attributes)
        fixed = element.tag == "weld"
        if fixed and numbers(f"{where} torquescale", attributes.get("torquescale", "1"), 1)[0] == 0.0:
            fixed = False
        axes = locked_axes("fixed" if fixed else "spherical")
        if "site1" in attributes or "site2" in attributes:
            first, second = self._sites(where, attributes)
            return Closure(name, (frames[first], frames[second]), axes)
        (link1, at1), (link2, at2) = self._bodies(tree, where, element.tag, attributes)
        return Closure(
            name, (tree.frame_at(f"{name}_1", link1, at1), tree.frame_at(f"{name}_2", link2, at2)), axes
        )

    def _sites(self, where: str, attributes: dict[str, str]) -> tuple[str, str]:
        """The two sites that coincide."""
        for key in ("body1", "body2", "anchor", "relpose"):
            if key in attributes:
                raise RobotFileError(f"{where}: give either two sites or bodies, got a site and {key}")
        for key in ("site1", "site2"):
            if attributes.get(key) not in self.sites:
                raise RobotFileError(f"{where} {key}: {choose_from('site', attributes.get(key), self.sites)}")
        first, second = attributes["site1"], attributes["site2"]
        if self.sites[first][0] == self.sites[second][0]:
            raise RobotFileError(f"{where}: joins body {self.sites[first][0]!r} with itself")
        return first, second

    def _bodies(
        self, tree: UrdfTree, where: str, tag: str, attributes: dict[str, str]
    ) -> tuple[tuple[str, Array], tuple[str, Array]]:
        """The two bodies, and the placements in them that coincide."""
        if "body1" not in attributes:
            raise RobotFileError(f"{where}: needs body1, or site1 and site2")
        links = []
        for key in ("body1", "body2"):
            body = attributes.get(key, WORLD)
            if body not in self.bodies:
                raise RobotFileError(f"{where} {key}: {choose_from('body', body, self.bodies)}")
            links.append(body)
        first, second = links
        if first == second:
            raise RobotFileError(f"{where}: joins body {first!r} with itself")
        between = inverse(tree.at_zero(first)) @ tree.at_zero(second)  # second in first, at the zero pose
        if tag == "connect":
            if "anchor" not in attributes:
                raise RobotFileError(f"{where}: anchor is missing")
            at = placement(None, numbers(f"{where} anchor", attributes["anchor"], 3))
            there = inverse(between) @ at
            return (first, at), (second, placement(None, there[:3, 3]))
        anchor = placement(None, numbers(f"{where} anchor", attributes.get("anchor", "0 0 0"), 3))
        pose = numbers(f"{where} relpose", attributes.get("relpose", "0 1 0 0 0 0 0"), 7)
        if any(pose[3:]):
            turn = from_quaternion(pose[3], pose[4], pose[5], pose[6])
            return (first, placement(turn, pose[:3])), (second, anchor)
        return (first, between @ anchor), (second, anchor)

    def _joint_equality(
        self, tree: UrdfTree, name: str, where: str, attributes: dict[str, str]
    ) -> Closure | None:
        names = []
        for key in ("joint1", "joint2"):
            if key not in attributes and key == "joint2":
                continue
            given = attributes.get(key)
            valid = [n for n, c in self.coordinates.items() if c.kind != "ball"]
            if given not in valid:
                raise RobotFileError(f"{where} {key}: {choose_from('hinge or slide', given, valid)}")
            names.append(given)
        parts = attributes.get("polycoef", "0 1 0 0 0").split()
        parts += ["0", "1", "0", "0", "0"][len(parts) :]  # what is left out keeps its default
        coefficients = numbers(f"{where} polycoef", " ".join(parts), 5)
        first = tree.joints[str(names[0])]
        if len(names) == 1 or not any(coefficients[1:]):
            if not first.moves:
                raise RobotFileError(f"{where} joint1: {first.name!r} is already held")
            tree.fix(first, coefficients[0])
            return None
        second = tree.joints[str(names[1])]
        closure = None
        if coefficients == (0.0, 1.0, 0.0, 0.0, 0.0):
            chains = tree.moving_chains(first.child, second.child)
            if [[joint.name for joint in chain] for chain in chains] == [[first.name], [second.name]]:
                closure = tree.same_turning(name, first.child, second.child)
        if closure is None:
            raise RobotFileError(
                f"{where}: a coupling of {first.name!r} with {second.name!r} by polycoef "
                f"{' '.join(f'{value:g}' for value in coefficients)} cannot be held by loops of frames "
                f"(valid: one joint held, or two equal turns about parallel axes of one body)"
            )
        return closure

    def actuators(self, root: ElementTree.Element, tree: UrdfTree) -> list[Actuator]:
        found: dict[str, Actuator] = {}
        movable = set(tree.movable)
        valid = [name for name in self.coordinates if name in movable]
        for section in root.findall("actuator"):
            for element in section:
                where = f"<actuator>: {element.tag} {element.get('name', '')!r}"
                if element.tag not in _MOTORS:
                    raise RobotFileError(
                        f"{where}: {choose_from('or unsupported actuator', element.tag, _MOTORS)}"
                    )
                attributes = {
                    **self.settings.attributes(element, where, None, "general"),
                    **self.settings.attributes(element, where, None),
                }
                joint = attributes.get("joint", attributes.get("jointinparent"))
                if joint not in valid:
                    raise RobotFileError(f"{where} joint: {choose_from('hinge or slide', joint, valid)}")
                if joint in found:
                    raise RobotFileError(f"{where}: joint {joint!r} has two actuators")
                found[joint] = self._actuator(joint, attributes, where)
        for name, coordinate in self.coordinates.items():
            if coordinate.armature and name not in found:
                raise RobotFileError(
                    f"joint {name!r} armature: only supported on joints with an <actuator>; give the inertia "
                    f"to the body"
                )
        return list(found.values())

    def _actuator(self, joint: str, attributes: dict[str, str], where: str) -> Actuator:
        parts = attributes.get("gear", "1").split()
        gear = numbers(f"{where} gear", attributes.get("gear", "1"), max(len(parts), 1))
        if gear[0] <= 0 or any(gear[1:]):
            raise RobotFileError(f"{where} gear: needs one ratio greater than zero, got {' '.join(parts)}")
        armature = self.coordinates[joint].armature
        if armature < 0:
            raise RobotFileError(f"joint {joint!r} armature: must not be negative, got {armature:g}")
        limit = None
        if "forcerange" in attributes:
            low, high = numbers(f"{where} forcerange", attributes["forcerange"], 2)
            limit = high if high > 0 and low == -high else None
        return Actuator(joint, gear[0], armature / gear[0] ** 2, limit)

    def keyframe(self, root: ElementTree.Element) -> dict[str, float]:
        """Joint angles of the first key, from the zero pose; empty without one."""
        key = root.find("keyframe/key")
        if key is None or "qpos" not in key.attrib:
            return {}
        width = {"ball": 4}
        count = sum(width.get(c.kind, 1) for c in self.coordinates.values())
        values = list(numbers(f"<key> {key.get('name', '')!r} qpos", key.get("qpos"), count))
        reference = {}
        for name, coordinate in self.coordinates.items():
            if coordinate.kind != "ball":
                reference[name] = values.pop(0) - coordinate.ref
                continue
            quaternion, values = values[:4], values[4:]
            if not any(quaternion):
                raise RobotFileError(f"<key> qpos: the quaternion of ball {name!r} is zero")
            m = from_quaternion(*quaternion)
            angles = (
                math.atan2(-m[1, 2], m[2, 2]),
                math.atan2(m[0, 2], math.hypot(m[0, 0], m[0, 1])),
                math.atan2(-m[0, 1], m[0, 0]),
            )
            reference.update(zip(coordinate.joints, angles, strict=True))
        return reference


# ------------------------------------------------------------------ small things


def _known(element: ElementTree.Element, where: str, valid: tuple[str, ...]) -> None:
    for key in element.attrib:
        if key not in valid:
            raise RobotFileError(f"{where}: {choose_from('attribute', key, valid)}")


def _word(attributes: Mapping[str, Any], where: str, key: str, valid: tuple[str, ...], default: str) -> str:
    value = str(attributes.get(key, default))
    if value not in valid:
        raise RobotFileError(f"{where} {key}: {choose_from('value', value, valid)}")
    return value


def _sizes(attributes: Mapping[str, str], where: str, count: int) -> tuple[float, ...]:
    parts = attributes.get("size", "").split()
    sizes = numbers(where, attributes.get("size"), max(len(parts), count))[:count]
    if min(sizes) <= 0:
        raise RobotFileError(f"{where}: must be greater than zero, got {' '.join(parts)}")
    return sizes


def _solid(kind: str, size: tuple[float, ...]) -> tuple[float, Array]:
    """Volume of a primitive, and its principal moments of inertia for one kilogram."""
    if kind in ("sphere", "ellipsoid"):
        a, b, c = size if kind == "ellipsoid" else (size[0],) * 3
        return 4 / 3 * math.pi * a * b * c, np.array([b * b + c * c, a * a + c * c, a * a + b * b]) / 5
    if kind == "box":
        a, b, c = size
        return 8 * a * b * c, np.array([b * b + c * c, a * a + c * c, a * a + b * b]) / 3
    radius, half = size
    tube = 2 * math.pi * radius**2 * half
    across = radius**2 / 4 + half**2 / 3
    if kind == "cylinder":
        return tube, np.array([across, across, radius**2 / 2])
    ball = 4 / 3 * math.pi * radius**3
    cap = 0.4 * radius**2 + half**2 + 0.75 * half * radius  # two half balls about the middle
    volume = tube + ball
    across = (tube * across + ball * cap) / volume
    return volume, np.array([across, across, (tube * radius**2 / 2 + ball * 0.4 * radius**2) / volume])


def _together(parts: list[tuple[float, Array, Array]]) -> tuple[float, Array, Array]:
    """Mass, centre and inertia about it of several solids (Steiner)."""
    mass = sum(part[0] for part in parts)
    centre = np.sum([part[0] * part[1] for part in parts], axis=0) / mass
    total = np.zeros((3, 3))
    for m, com, matrix in parts:
        d = com - centre
        total += matrix + m * (d @ d * np.eye(3) - np.outer(d, d))
    return mass, centre, total
