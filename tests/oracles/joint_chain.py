"""A closure as a chain of real joints, and joints as a URDF."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable
from copy import deepcopy
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from framework.model.description import Closure

LETTERS = "xyz"


@dataclass(frozen=True)
class Edge:
    """A joint between two links, as in a URDF; `element` holds what else the file says of it."""

    name: str
    kind: str
    parent: str
    child: str
    origin: pin.SE3
    axis: np.ndarray  # (3,) in the child's frame
    element: ElementTree.Element | None = None


def fixed(name: str, parent: str, child: str, origin: pin.SE3) -> Edge:
    """A rigid connection."""
    return Edge(name, "fixed", parent, child, origin, np.array([1.0, 0, 0]))


def along_z(axis: np.ndarray) -> pin.SE3:
    """A rotation whose z is the axis."""
    z = axis / np.linalg.norm(axis)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    return pin.SE3(np.column_stack([x, np.cross(z, x), z]), np.zeros(3))


def chain(closure: Closure, first: str, second: str, between: pin.SE3) -> tuple[list[Edge], dict[str, float]]:
    """Joints that leave from link to link what the closure leaves, and their values for a pose.

    Slides along the free axes of the first link, then turns about those left free, x before y before z;
    three turns, a ball, are at zero for the given pose. A rod of constant length has two turns at its
    first end and a ball at the second.
    """
    turns = [axis for axis in LETTERS if f"r{axis}" not in closure.axes]
    place, after = pin.SE3.Identity(), pin.SE3.Identity()
    steps: list[tuple[str, str, float, pin.SE3]] = []  # kind, axis, value, origin
    if closure.length is not None:
        if len(closure.axes) > 1:
            raise ValueError(f"{closure.name}: both a distance and axes")
        aim = along_z(between.translation)
        rod = pin.SE3(np.eye(3), np.array([0, 0, closure.length]))
        steps = [("revolute", "x", 0.0, aim), ("revolute", "y", 0.0, place), ("revolute", "x", 0.0, rod)]
        steps += [("revolute", "y", 0.0, place), ("revolute", "z", 0.0, place)]
        after = pin.SE3(aim.rotation.T @ between.rotation, np.zeros(3))
    else:
        for axis, value in zip(LETTERS, between.translation, strict=True):
            if axis not in closure.axes:
                steps.append(("prismatic", axis, value, place))
        if len(turns) == 3:
            angles = np.zeros(3)
            after = pin.SE3(between.rotation, np.zeros(3))
        else:
            letters = "".join([*turns, *(axis for axis in LETTERS if axis not in turns)]).upper()
            angles = Rotation.from_matrix(between.rotation).as_euler(letters)
            if abs(angles[2]) > np.pi / 2:  # the other solution, in which nothing is left to the third
                angles = np.array([angles[0] + np.pi, np.pi - angles[1], 0.0])
            angles = (angles + np.pi) % (2 * np.pi) - np.pi
        steps += [("revolute", axis, angles[k], place) for k, axis in enumerate(turns)]
    edges, start, here = [], {}, first
    for kind, axis, value, origin in steps:
        name = f"{closure.name}_closed_{len(edges) + 1}"
        edges.append(Edge(name, kind, here, f"{name}_link", origin, np.eye(3)[LETTERS.index(axis)]))
        start[name] = float(value)
        here = f"{name}_link"
    return [*edges, fixed(f"{closure.name}_closed", here, second, after)], start


def urdf(text: str, tree: Iterable[Edge]) -> str:
    """The links of a URDF, and those that the joints add, on these joints."""
    root = ElementTree.fromstring(text)
    links = {link.get("name") for link in root.findall("link")}
    for joint in root.findall("joint"):
        root.remove(joint)
    for edge in tree:
        for link in {edge.parent: None, edge.child: None}.keys() - links:
            ElementTree.SubElement(root, "link", name=link)
            links.add(link)
        joint = ElementTree.SubElement(root, "joint", name=edge.name, type=edge.kind)
        ElementTree.SubElement(joint, "parent", link=edge.parent)
        ElementTree.SubElement(joint, "child", link=edge.child)
        rpy = pin.rpy.matrixToRpy(edge.origin.rotation)
        ElementTree.SubElement(joint, "origin", xyz=_numbers(edge.origin.translation), rpy=_numbers(rpy))
        ElementTree.SubElement(joint, "axis", xyz=_numbers(edge.axis))
        if edge.element is not None:
            joint.extend(deepcopy(edge.element.findall("limit")))
        elif edge.kind != "fixed":
            ElementTree.SubElement(joint, "limit", lower="-1e9", upper="1e9", effort="1e9", velocity="1e9")
    return ElementTree.tostring(root, encoding="unicode")


def _numbers(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in values)
