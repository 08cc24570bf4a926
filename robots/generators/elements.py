"""Elements of a URDF for the generators, and the text of a file made of them.

A generator says which elements there are, `document` how they are laid out. A vector is a text, which stands
as it is, or numbers, which the document formats.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from framework.numerics.arrays import Array

Value = str | float | Iterable[float]
Limit = tuple[Value, Value, Value, Value]  # lower, upper, effort, velocity
ZERO = (0.0, 0.0, 0.0)


class Element(NamedTuple):
    """An XML element; the order of its attributes is that of the text."""

    tag: str
    attributes: Mapping[str, Value]
    children: tuple[Element, ...] = ()


# ------------------------------------------------------------------ links, joints, shapes


def link(name: str, *contents: Iterable[Element]) -> Element:
    """A link of inertias and shapes; without any it is a frame."""
    return Element("link", {"name": name}, tuple(part for content in contents for part in content))


def joint(
    name: str,
    kind: str,
    parent: str,
    child: str,
    place: Element | None = None,
    axis: Value = "",
    limit: Limit | None = None,
) -> Element:
    """A joint; `axis` and `limit` (lower, upper, effort, velocity) only where it moves."""
    children = [Element("parent", {"link": parent}), Element("child", {"link": child}), place or origin()]
    if limit is not None:
        names = ("lower", "upper", "effort", "velocity")
        children += [Element("axis", {"xyz": axis}), Element("limit", dict(zip(names, limit, strict=True)))]
    return Element("joint", {"name": name, "type": kind}, tuple(children))


def turning(name: str, parent: str, child: str, xyz: Value, effort: float = 0) -> Element:
    """A revolute joint about z; without a motor its effort is 0."""
    return joint(name, "revolute", parent, child, origin(xyz), "0 0 1", (-6.28, 6.28, effort, 20))


def fixed(name: str, parent: str, child: str, xyz: Value = ZERO, rpy: Value = ZERO) -> tuple[Element, ...]:
    """A fixed joint and the empty link behind it: a frame."""
    return joint(name, "fixed", parent, child, origin(xyz, rpy)), link(child)


def origin(xyz: Value = ZERO, rpy: Value = ZERO) -> Element:
    """A placement [m, rad]."""
    return Element("origin", {"xyz": xyz, "rpy": rpy})


def oriented(xyz: Value, axes: Array) -> Element:
    """A placement of axes given as columns (3, 3)."""
    if np.hypot(axes[0, 0], axes[1, 0]) > 1e-9:
        pitch = np.arctan2(-axes[2, 0], np.hypot(axes[0, 0], axes[1, 0]))
        return origin(xyz, (np.arctan2(axes[2, 1], axes[2, 2]), pitch, np.arctan2(axes[1, 0], axes[0, 0])))
    up = -np.sign(axes[2, 0])  # x points up or down: roll and yaw turn about the same line
    return origin(xyz, (np.arctan2(up * axes[0, 1], axes[1, 1]), up * np.pi / 2, 0.0))


def shape(geometry: Element, place: Element, material: str) -> tuple[Element, Element]:
    """The same primitive to look at and to collide with."""
    body = (place, Element("geometry", {}, (geometry,)))
    return (
        Element("visual", {}, (*body, Element("material", {"name": material}))),
        Element("collision", {}, body),
    )


def cylinder(radius: Value, length: Value) -> Element:
    """A cylinder along z [m]."""
    return Element("cylinder", {"radius": radius, "length": length})


def sphere(radius: Value) -> Element:
    """A ball [m]."""
    return Element("sphere", {"radius": radius})


def box(size: Value) -> Element:
    """A box with these edges [m]."""
    return Element("box", {"size": size})


def material(name: str, rgb: str) -> Element:
    """A colour of the robot."""
    return Element("material", {"name": name}, (Element("color", {"rgba": f"{rgb} 1"}),))


# ------------------------------------------------------------------ inertia


def inertial(mass: Value, centre: Value, moments: Sequence[Value] | Array) -> tuple[Element]:
    """Mass [kg] at a centre [m]; three moments about the axes of the link, or the matrix (3, 3) [kg m^2]."""
    values: dict[str, Value] = {"ixy": "0", "ixz": "0", "iyz": "0"}
    if isinstance(moments, np.ndarray):
        rows, columns = np.triu_indices(3)
        values = {f"i{'xyz'[i]}{'xyz'[j]}": moments[i, j] for i, j in zip(rows, columns, strict=True)}
    else:
        values |= dict(zip(("ixx", "iyy", "izz"), moments, strict=True))
    parts = (origin(centre, "0 0 0"), Element("mass", {"value": mass}), Element("inertia", values))
    return (Element("inertial", {}, parts),)


def solid_cylinder(
    mass: float, radius: float, length: float, along: str, centre: Value = ZERO
) -> tuple[Element]:
    """Inertia of a uniform cylinder along an axis (x, y or z) of the link."""
    return inertial(mass, centre, cylinder_moments(mass, radius, length, along))


def cylinder_moments(mass: float, radius: float, length: float, along: str) -> list[float]:
    """Of a uniform cylinder along an axis (x, y or z) about its centre [kg m^2]."""
    moments = [mass * (3 * radius**2 + length**2) / 12] * 3
    moments["xyz".index(along)] = mass * radius**2 / 2
    return moments


# ------------------------------------------------------------------ text


class Layout(NamedTuple):
    """How elements become text: their numbers, which stand on one line, the order of moments of inertia."""

    number: Callable[[float], str]
    flat: tuple[str, ...]
    moments: tuple[str, ...]


# SPACED is for numbers of sines and roots: no digit depends on the machine. COMPACT keeps all but the last.
SPACED = Layout(
    lambda value: f"{round(value, 15) + 0.0:.15g}",
    ("geometry", "material"),
    ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
)
COMPACT = Layout(
    lambda value: f"{value + 0.0:.16g}",
    ("joint", "inertial", "visual", "collision"),
    ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"),
)


def document(head: str, parts: Iterable[Element | str], layout: Layout = SPACED) -> str:
    """The text of a URDF: its head up to `<robot>`, then elements and, as they are, lines of text."""
    lines = [head.removesuffix("\n")]
    for part in parts:
        lines += [part] if isinstance(part, str) else _lines(part, "  ", layout)
    return "\n".join([*lines, "</robot>", ""])


def _lines(element: Element, indent: str, layout: Layout) -> list[str]:
    names: Iterable[str] = layout.moments if element.tag == "inertia" else element.attributes
    attributes = "".join(f' {name}="{_text(element.attributes[name], layout)}"' for name in names)
    if not element.children:
        return [f"{indent}<{element.tag}{attributes}/>"]
    inner = [line for child in element.children for line in _lines(child, f"{indent}  ", layout)]
    lines = [f"{indent}<{element.tag}{attributes}>", *inner, f"{indent}</{element.tag}>"]
    return [indent + "".join(map(str.strip, lines))] if element.tag in layout.flat else lines


def _text(value: Value, layout: Layout) -> str:
    if isinstance(value, str):
        return value
    return " ".join(layout.number(float(v)) for v in np.atleast_1d(np.asarray(value, dtype=float)))
