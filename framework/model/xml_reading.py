"""Attributes and children of an XML element: there, known, and numbers where numbers are due.

`where` names the element in messages.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Collection

import numpy as np

from framework.errors import RobotFileError, check_name, nearest, short
from framework.model.description import SMALLEST_LENGTH
from framework.model.placement import from_rpy, placement
from framework.numerics.arrays import Array
from framework.numerics.fields import LARGEST_NUMBER


def numbers(
    where: str, text: str | None, count: int, *, largest: float = LARGEST_NUMBER
) -> tuple[float, ...]:
    """Parse `count` finite numbers of an attribute.

    Raises:
        RobotFileError: another count, or one that is no finite number or larger than `largest`.
    """
    try:
        values = tuple(map(float, (text or "").split()))
    except ValueError:
        values = (math.nan,)
    problem = ""
    if not all(map(math.isfinite, values)):
        problem = "needs finite numbers"
    elif max(map(abs, values), default=0.0) > largest:
        problem = f"must be at most {largest:g} in size"
    elif len(values) != count:
        problem = f"needs {count} number{'s' * (count != 1)}"
    if problem:
        raise RobotFileError(f"{where}: {problem}, got {short(text)}")
    return values


def number_of(
    element: ElementTree.Element,
    where: str,
    key: str,
    default: str | None = None,
    *,
    largest: float = LARGEST_NUMBER,
) -> float:
    """Return the number of an attribute, needed if it has no default.

    Raises:
        RobotFileError: as `attribute` and `numbers` do.
    """
    text = attribute(element, where, key) if default is None else element.get(key, default)
    return numbers(f"{where} {key}", text, 1, largest=largest)[0]


def only(
    element: ElementTree.Element, where: str, children: Collection[str], attributes: Collection[str]
) -> None:
    """Refuse unknown and repeated children, and mistyped attributes; other programs may have their own."""
    tags = [child.tag for child in element]
    for tag in tags:
        check_name(where, "element", tag, children)
        if tags.count(tag) > 1:
            raise RobotFileError(f"{where}: duplicate <{tag}>")
    for attribute in element.attrib:
        if nearest(attribute, attributes):
            check_name(where, "attribute", attribute, attributes)


def child_element(element: ElementTree.Element, where: str, tag: str) -> ElementTree.Element:
    """Return the child with this tag; raise RobotFileError if missing."""
    found = element.find(tag)
    if found is None:
        given = ", ".join(f"<{child.tag}>" for child in element) or "nothing"
        raise RobotFileError(f"{where}: <{tag}> is missing (given: {given})")
    return found


def attribute(element: ElementTree.Element, where: str, key: str) -> str:
    """Return an attribute; raise RobotFileError if missing or empty."""
    value = element.get(key)
    if not value:
        given = ", ".join(element.attrib) or "nothing"
        raise RobotFileError(f"{where}: attribute {key!r} is missing or empty (given: {given})")
    return value


def remove_children(element: ElementTree.Element, *tags: str) -> None:
    """Remove all children with some tags."""
    for tag in tags:
        for child in element.findall(tag):
            element.remove(child)


def origin_of(element: ElementTree.Element | None, where: str) -> Array:
    """Return the placement of an `<origin xyz rpy>`; the identity without one."""
    xyz, rpy = origin_numbers(element, where)
    return placement(from_rpy(rpy) if any(rpy) else None, xyz)


def origin_numbers(
    element: ElementTree.Element | None, where: str
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the xyz (3,) [m] and rpy (3,) [rad] of an `<origin>`; zeros without one."""
    if element is None:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    only(element, where, (), ("xyz", "rpy"))
    xyz = numbers(f"{where} xyz", element.get("xyz", "0 0 0"), 3)
    return xyz, numbers(f"{where} rpy", element.get("rpy", "0 0 0"), 3)


def axis_of(element: ElementTree.Element, where: str) -> Array:
    """Return the direction of an `<axis xyz>`, which must not be zero."""
    only(element, where, (), ("xyz",))
    axis = np.array(numbers(f"{where} xyz", attribute(element, where, "xyz"), 3))
    if np.abs(axis).max() < SMALLEST_LENGTH:
        raise RobotFileError(f"{where}: the axis is zero")
    return axis
