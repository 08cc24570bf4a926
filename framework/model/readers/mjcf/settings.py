"""Units, Euler sequence, gravity and defaults of an MJCF file, and what its elements say with them."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from typing import Any

import numpy as np

from framework.arrays import Array
from framework.errors import RobotFileError, choose_from, short
from framework.model.description import SMALLEST_LENGTH
from framework.model.placement import about, from_quaternion, placement
from framework.model.xml_reading import numbers
from framework.tolerances import FILE_ROUNDING

UNIT_ROUNDING = 1e-15  # of a unit vector
MAX_NESTING_DEPTH = 200  # bodies in bodies, defaults in defaults
TURNS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")


class CompilerSettings:
    """Units, Euler sequence, gravity, defaults."""

    def __init__(self, root: ElementTree.Element) -> None:
        compiler = {key: value for c in root.findall("compiler") for key, value in c.attrib.items()}
        angle = word(compiler, "<compiler>", "angle", ("degree", "radian"), "degree")
        self.angle = math.pi / 180.0 if angle == "degree" else 1.0
        if compiler.get("coordinate") == "global":
            raise RobotFileError(
                "<compiler> coordinate: global coordinates are of old versions of MuJoCo, and no new one "
                "reads them; load and save the file with MuJoCo 2.2, which writes local ones"
            )
        word(compiler, "<compiler>", "coordinate", ("local",), "local")
        self.eulerseq = compiler.get("eulerseq", "xyz")
        if len(self.eulerseq) != 3 or set(self.eulerseq.lower()) - set("xyz"):
            raise RobotFileError(
                f"<compiler> eulerseq: needs three of x, y, z, X, Y, Z, got {short(self.eulerseq)}"
            )
        self.autolimits = word(compiler, "<compiler>", "autolimits", ("true", "false"), "true") == "true"
        self.from_geoms = word(compiler, "<compiler>", "inertiafromgeom", ("auto", "true", "false"), "auto")
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
        if depth > MAX_NESTING_DEPTH:
            raise RobotFileError("<default>: nested too deeply")
        of_class = {tag: dict(values) for tag, values in above.items()}
        for child in element:
            if child.tag != "default":
                of_class[child.tag] = {**of_class.get(child.tag, {}), **child.attrib}
        self.defaults[name] = of_class
        for child in element.findall("default"):
            self._read_default(child, of_class, depth + 1)

    def attributes(
        self, element: ElementTree.Element, where: str, childclass: str | None, tag: str | None = None
    ) -> dict[str, str]:
        """Return the attributes of an element over those of its class."""
        name = element.get("class", childclass or "main")
        if name not in self.defaults:
            raise RobotFileError(f"{where}: {choose_from('class', name, self.defaults)}")
        return {**self.defaults[name].get(tag or element.tag, {}), **element.attrib}

    def placed(self, attributes: Mapping[str, str], where: str) -> Array:
        """Return the placement of `pos` and one of the ways to write an orientation."""
        orientations = [key for key in TURNS if key in attributes]
        if len(orientations) > 1:
            raise RobotFileError(f"{where}: needs one orientation, got {' and '.join(orientations)}")
        position = numbers(f"{where} pos", attributes.get("pos", "0 0 0"), 3)
        if not orientations:
            return placement(None, position)
        key = orientations[0]
        values = numbers(
            f"{where} {key}", attributes[key], {"quat": 4, "axisangle": 4, "xyaxes": 6}.get(key, 3)
        )
        if key != "euler" and max(map(abs, values[: 4 if key == "quat" else 3])) < SMALLEST_LENGTH:
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
            turn = least_turn(np.array(values))
        else:
            turn = _from_xy(np.array(values[:3]), np.array(values[3:]), f"{where} xyaxes")
        return placement(turn, position)


def between_ends(where: str, text: str) -> tuple[Array, float]:
    """Return the placement half-way between two ends (`fromto`), z along them, and half their distance."""
    ends = np.array(numbers(f"{where} fromto", text, 6))
    along = ends[:3] - ends[3:]
    half = 0.5 * float(np.linalg.norm(along))
    if half < SMALLEST_LENGTH:
        raise RobotFileError(f"{where} fromto: the two ends coincide")
    return placement(least_turn(along), 0.5 * (ends[:3] + ends[3:])), half


def least_turn(z: Array) -> Array:
    """Return the least turn that brings z to this direction."""
    z = z / np.linalg.norm(z)
    axis = np.cross((0.0, 0.0, 1.0), z)
    if np.linalg.norm(axis) < UNIT_ROUNDING:
        return np.eye(3) if z[2] > 0 else np.diag([1.0, -1.0, -1.0])
    return about(axis, math.atan2(float(np.linalg.norm(axis)), float(z[2])))


def _from_xy(x: Array, y: Array, where: str) -> Array:
    x = x / np.linalg.norm(x)
    y = y / max(float(np.linalg.norm(y)), SMALLEST_LENGTH)
    y = y - (x @ y) * x
    if np.linalg.norm(y) < FILE_ROUNDING:
        raise RobotFileError(f"{where}: the two axes are parallel")
    y = y / np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])


def known(element: ElementTree.Element, where: str, valid: tuple[str, ...]) -> None:
    """Refuse attributes that are not known."""
    for key in element.attrib:
        if key not in valid:
            raise RobotFileError(f"{where}: {choose_from('attribute', key, valid)}")


def word(attributes: Mapping[str, Any], where: str, key: str, valid: tuple[str, ...], default: str) -> str:
    """Read an attribute that is one of a few words."""
    value = str(attributes.get(key, default))
    if value not in valid:
        raise RobotFileError(f"{where} {key}: {choose_from('value', value, valid)}")
    return value
