"""Mass and shape of the bodies of an MJCF file: `<inertial>`, or the primitive geoms."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.errors import RobotFileError, choose_from
from framework.model.inertia import check_inertia, symmetric
from framework.model.placement import placement
from framework.model.readers.mjcf.settings import TURNS, CompilerSettings, between_ends, known
from framework.model.urdf_writing import origin_element
from framework.model.xml_reading import numbers

GEOMS = ("sphere", "box", "cylinder", "capsule", "ellipsoid")
DEFAULT_DENSITY = 1000.0  # MuJoCo's default [kg/m^3]
_INERTIAL = ("pos", *TURNS, "mass", "diaginertia", "fullinertia")


class UnknownInertia(RobotFileError):
    """A shape whose inertia is not computed has to give one."""


class _Inertia(NamedTuple):
    """Mass [kg], its centre (3,) [m], and the inertia (3, 3) [kg m^2] about that."""

    mass: float
    centre: Array
    matrix: Array


def inertial_element(
    settings: CompilerSettings, element: ElementTree.Element, link: str, childclass: str | None
) -> ElementTree.Element | None:
    """Return the URDF's `<inertial>` of a body: its own, else that of its geoms; None without mass."""
    inertials = element.findall("inertial")
    if len(inertials) > 1:
        raise RobotFileError(f"body {link!r}: duplicate <inertial>")
    if inertials and settings.from_geoms != "true":
        where = f"body {link!r}: <inertial>"
        known(inertials[0], where, _INERTIAL)
        mass, com, matrix = _given_inertia(settings, inertials[0], where)
    elif settings.from_geoms == "false":
        return None
    else:
        shapes = [_geom_inertia(settings, geom, link, childclass) for geom in element.findall("geom")]
        parts = [shape for shape in shapes if shape is not None]
        if not parts:
            return None
        mass, com, matrix = _together(parts)
    inertial = ElementTree.Element("inertial")
    inertial.append(origin_element(placement(None, com)))
    ElementTree.SubElement(inertial, "mass", value=repr(float(mass)))
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    entries = matrix[np.triu_indices(3)]
    ElementTree.SubElement(
        inertial, "inertia", {n: repr(float(v)) for n, v in zip(names, entries, strict=True)}
    )
    return inertial


def _given_inertia(settings: CompilerSettings, element: ElementTree.Element, where: str) -> _Inertia:
    """Return the inertia of an `<inertial>`."""
    if "mass" not in element.attrib:
        raise RobotFileError(f"{where}: mass is missing")
    (mass,) = numbers(f"{where} mass", element.get("mass"), 1)
    if mass < 0:
        raise RobotFileError(f"{where} mass: must not be negative, got {mass:g}")
    where_at = settings.placed(element.attrib, where)
    if "fullinertia" in element.attrib:
        if any(key in element.attrib for key in (*TURNS, "diaginertia")):
            raise RobotFileError(f"{where}: fullinertia goes without an orientation and diaginertia")
        xx, yy, zz, xy, xz, yz = numbers(f"{where} fullinertia", element.get("fullinertia"), 6)
        matrix = symmetric(xx, yy, zz, xy, xz, yz)
        check_inertia(f"{where} fullinertia", matrix)
        return _Inertia(mass, where_at[:3, 3], matrix)
    if "diaginertia" not in element.attrib:
        raise RobotFileError(f"{where}: needs diaginertia or fullinertia")
    diagonal = np.diag(numbers(f"{where} diaginertia", element.get("diaginertia"), 3))
    check_inertia(f"{where} diaginertia", diagonal)
    turn = where_at[:3, :3]
    return _Inertia(mass, where_at[:3, 3], turn @ diagonal @ turn.T)


def _geom_inertia(
    settings: CompilerSettings, element: ElementTree.Element, link: str, childclass: str | None
) -> _Inertia | None:
    """Return the inertia of a geom; None for one without mass."""
    where = f"body {link!r}: <geom>"
    attributes = settings.attributes(element, where, childclass)
    density = numbers(f"{where} density", attributes.get("density", repr(DEFAULT_DENSITY)), 1)[0]
    mass = numbers(f"{where} mass", attributes["mass"], 1)[0] if "mass" in attributes else None
    if mass == 0.0 or (mass is None and density == 0.0):
        return None
    kind, size, where_at = _geometry(settings, attributes, where)
    if kind not in GEOMS:
        raise UnknownInertia(f"{where}: the mass of a {kind} (the body has no <inertial>)")
    volume, unit = _solid(kind, size)  # of a solid of one kilogram
    mass = density * volume if mass is None else mass
    turn = where_at[:3, :3]
    return _Inertia(mass, where_at[:3, 3], mass * turn @ np.diag(unit) @ turn.T)


def _geometry(
    settings: CompilerSettings, attributes: Mapping[str, str], where: str
) -> tuple[str, tuple[float, ...], Array]:
    """Return type, sizes and placement of a geom."""
    kind = attributes.get("type", "mesh" if "mesh" in attributes else "sphere")
    if kind not in GEOMS:
        if kind not in ("plane", "hfield", "mesh", "sdf"):
            raise RobotFileError(f"{where} type: {choose_from('type', kind, (*GEOMS, 'mesh', 'plane'))}")
        return kind, (), np.eye(4)
    count = {"sphere": 1, "box": 3, "ellipsoid": 3}.get(kind, 2)
    if "fromto" in attributes:
        if kind == "sphere":
            raise RobotFileError(f"{where} fromto: a sphere has no ends")
        middle, half = between_ends(where, attributes["fromto"])
        first = _sizes(attributes, f"{where} size", 1)
        sizes = (first[0], half) if count == 2 else (first[0], first[0], half)
        return kind, sizes, middle
    return kind, _sizes(attributes, f"{where} size", count), settings.placed(attributes, where)


def visual_element(
    settings: CompilerSettings, element: ElementTree.Element, link: str, childclass: str | None
) -> ElementTree.Element | None:
    """Return the URDF's `<visual>` of a primitive geom, a cylinder for a capsule; None for other shapes."""
    where = f"body {link!r}: <geom>"
    kind, size, where_at = _geometry(settings, settings.attributes(element, where, childclass), where)
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


def _sizes(attributes: Mapping[str, str], where: str, count: int) -> tuple[float, ...]:
    parts = attributes.get("size", "").split()
    sizes = numbers(where, attributes.get("size"), max(len(parts), count))[:count]
    if min(sizes) <= 0:
        raise RobotFileError(f"{where}: must be greater than zero, got {' '.join(parts)}")
    return sizes


def _solid(kind: str, size: tuple[float, ...]) -> tuple[float, Array]:
    """Compute the volume of a primitive, and its principal moments of inertia for one kilogram."""
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


def _together(parts: list[_Inertia]) -> _Inertia:
    """Merge several solids into one (Steiner)."""
    mass = sum(part.mass for part in parts)
    centre = np.sum([part.mass * part.centre for part in parts], axis=0) / mass
    total = np.zeros((3, 3))
    for m, com, matrix in parts:
        d = com - centre
        total += matrix + m * (d @ d * np.eye(3) - np.outer(d, d))
    return _Inertia(mass, centre, total)
