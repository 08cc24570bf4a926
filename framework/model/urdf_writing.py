"""Elements of a URDF, to be put into its tree."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from framework.model.placement import to_rpy
from framework.numerics.arrays import Array

AXIS = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}


def vector_text(values: Iterable[float]) -> str:
    """Write numbers to their last digit, and zero without a sign."""
    return " ".join(repr(float(value) + 0.0) for value in values)


def origin_element(matrix: Array) -> ElementTree.Element:
    """Return the `<origin>` of a placement (4, 4)."""
    return ElementTree.Element(
        "origin", xyz=vector_text(matrix[:3, 3]), rpy=vector_text(to_rpy(matrix[:3, :3]))
    )


def joint_element(
    name: str,
    kind: str,
    parent: str,
    child: str,
    *,
    origin: ElementTree.Element | None = None,
    axis: str | None = None,
    limits: Sequence[float] | None = None,
) -> ElementTree.Element:
    """Return a `<joint>`, with limits that nothing reaches if URDF requires some.

    A continuous joint with limits is a revolute one.
    """
    kind = "revolute" if limits and kind == "continuous" else kind
    element = ElementTree.Element("joint", name=name, type=kind)
    ElementTree.SubElement(element, "parent", link=parent)
    ElementTree.SubElement(element, "child", link=child)
    if origin is not None:
        element.append(origin)
    if axis is not None:
        ElementTree.SubElement(element, "axis", xyz=axis)
    if kind in ("revolute", "prismatic"):
        limit = no_limit()
        if limits:
            limit.attrib |= zip(("lower", "upper"), map(repr, limits), strict=True)
        element.append(limit)
    return element


class ChainJoint(NamedTuple):
    """A joint of a chain: `place` (4, 4) is its origin in the link before."""

    name: str
    kind: str
    place: Array
    axis: Array | None = None
    limits: Sequence[float] | None = None


def chain_elements(
    parent: str, motions: Sequence[ChainJoint], body: str, end: Array, taken: set[str]
) -> Iterator[ElementTree.Element]:
    """Yield the joints between two links, and a link without mass behind each but the last.

    Args:
        end: (4, 4) placement of the body behind the last joint; a fixed joint where it is none.
        taken: names of links, which grow by those of the chain.
    """
    for motion in motions:
        is_last = motion is motions[-1] and np.array_equal(end, np.eye(4))
        child = body if is_last else free_name(f"{motion.name}_link", taken)
        if not is_last:
            yield ElementTree.Element("link", name=child)
        yield joint_element(
            motion.name,
            motion.kind,
            parent,
            child,
            origin=origin_element(motion.place),
            axis=None if motion.axis is None else vector_text(motion.axis),
            limits=motion.limits,
        )
        parent = child
    if parent != body:
        mount = free_name(f"{body}_mount", taken)
        yield joint_element(mount, "fixed", parent, body, origin=origin_element(end))


def free_name(wanted: str, taken: set[str]) -> str:
    """Return the wanted name with underscores until free, and mark the name as taken."""
    while wanted in taken:
        wanted += "_"
    taken.add(wanted)
    return wanted


def visual_element(shape: str, words: dict[str, str], place: Array) -> ElementTree.Element:
    """Return the `<visual>` of a primitive shape at a placement (4, 4)."""
    visual = ElementTree.Element("visual")
    visual.append(origin_element(place))
    ElementTree.SubElement(ElementTree.SubElement(visual, "geometry"), shape, words)
    return visual


def inertial_element(mass: float, centre: Array, inertia: Array) -> ElementTree.Element:
    """Return the `<inertial>` of a body: mass [kg], centre (3,) [m], central inertia (3, 3) [kg m^2]."""
    inertial = ElementTree.Element("inertial")
    ElementTree.SubElement(inertial, "origin", xyz=vector_text(centre), rpy="0 0 0")
    ElementTree.SubElement(inertial, "mass", value=repr(float(mass)))
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    pairs = zip(names, inertia[np.triu_indices(3)].tolist(), strict=True)
    ElementTree.SubElement(inertial, "inertia", {name: repr(value) for name, value in pairs})
    return inertial


def remove_children(element: ElementTree.Element, *tags: str) -> None:
    """Remove all children with some tags."""
    for tag in tags:
        for child in element.findall(tag):
            element.remove(child)


def no_limit() -> ElementTree.Element:
    """Return a `<limit>` that nothing reaches."""
    return ElementTree.Element("limit", lower="-1e9", upper="1e9", effort="1e9", velocity="1e9")
