"""What a robot looks like, as its URDF says: the solids that hang on its joints.

A shape hangs on a `node`, the number of a pinocchio joint (0 is the base), at a fixed placement. Sizes are
in metres; cylinders have their axis along z, as in URDF.
"""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ElementTree
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from framework.arrays import Array, IntArray
from framework.errors import RobotFileError
from framework.model.parallel_robot import ParallelRobot
from framework.model.spring_joints import count_turns, insert_springs
from framework.model.urdf import PACKAGE, locate_urdf

Color = tuple[float, float, float, float]


class Shape(NamedTuple):
    """One solid on one node."""

    node: int
    kind: str  # box, cylinder, sphere, mesh
    size: tuple[float, ...]  # edges; radius, length; radius; nothing
    placement: Array  # (4, 4) in the node's frame
    color: Color
    vertices: Array | None = None  # (V, 3) of a mesh
    faces: IntArray | None = None  # (F, 3)

    def corners(self) -> Array:
        """The corners (8, 3) of a box around it, in the node's frame."""
        if self.vertices is not None:
            low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        else:
            across = 2 * self.size[0]
            edges = {"box": self.size, "cylinder": (across, across, self.size[-1]), "sphere": (across,) * 3}
            sides = np.array(edges[self.kind])
            low, high = -0.5 * sides, 0.5 * sides
        which = np.array(list(product((0, 1), repeat=3)))
        box = np.where(which, high, low)
        return np.asarray(box @ self.placement[:3, :3].T + self.placement[:3, 3])


def read_visuals(robot: ParallelRobot) -> list[Shape]:
    """What the URDF shows, meshes and all; what has no file here, or no format known here, is left out."""
    springs = robot.description.active_springs(robot.flexibility)
    text = _with_meshes_found(robot, insert_springs(count_turns(robot.description.urdf_text), springs))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pinocchio warns of the list of folders, empty as it is
            drawn = pin.buildGeomFromUrdfString(robot.model, text, pin.GeometryType.VISUAL, [])
    except ValueError:  # a mesh of a format that it cannot read
        return []
    shapes = []
    for item in drawn.geometryObjects:
        known = _solid(item.geometry)
        if known is not None:
            kind, size, vertices, faces = known
            red, green, blue, alpha = (float(part) for part in item.meshColor)
            color = (red, green, blue, alpha)
            shapes.append(
                Shape(item.parentJoint, kind, size, item.placement.homogeneous, color, vertices, faces)
            )
    return shapes


def _with_meshes_found(robot: ParallelRobot, text: str) -> str:
    """The URDF with its mesh files by full path; visuals whose file is not here are left out."""
    root = ElementTree.fromstring(text)
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            mesh = visual.find("geometry/mesh")
            if mesh is None:
                continue
            reference = mesh.get("filename", "").removeprefix("file://")
            try:
                file = locate_urdf(robot.description.file.parent, reference)
            except RobotFileError:
                file = None
            if file is None or not file.is_file() or reference == PACKAGE:
                link.remove(visual)
            else:
                mesh.set("filename", str(file))
    return ElementTree.tostring(root, encoding="unicode")


def _solid(geometry: Any) -> tuple[str, tuple[float, ...], Array | None, IntArray | None] | None:
    """Kind, size and mesh of one of coal's geometries; None for those that nothing draws."""
    kind = type(geometry).__name__
    if kind == "Box":
        return "box", tuple(float(2 * half) for half in geometry.halfSide), None, None
    if kind in ("Cylinder", "Capsule"):
        return "cylinder", (geometry.radius, 2 * geometry.halfLength), None, None
    if kind == "Sphere":
        return "sphere", (geometry.radius,), None, None
    if kind.startswith("BVHModel"):
        vertices = np.array(geometry.vertices(), dtype=float).reshape(-1, 3)
        triangles = [geometry.tri_indices(k) for k in range(geometry.num_tris)]
        faces = np.array([[each[0], each[1], each[2]] for each in triangles], dtype=np.intp)
        return "mesh", (), vertices, faces
    return None
