"""Read the visuals of a URDF as solids on joints.

A shape is fixed to a `node`, the number of a pinocchio joint (0 is the base). Sizes are in metres; the axis
of a cylinder is z, as in URDF.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from itertools import product
from typing import NamedTuple
from xml.etree.ElementTree import Element, fromstring

import coal
import numpy as np
import pinocchio as pin

from framework.model.description import RobotDescription
from framework.model.documents import child_element, parse_numbers, read_origin
from framework.model.urdf_elements import SIZES_OF_SHAPES, locate_urdf
from framework.numerics.arrays import Array, IntArray
from framework.numerics.input import LARGEST_FILE

Color = tuple[float, float, float, float]

MAX_MESH_BYTES = 10 * LARGEST_FILE


class Shape(NamedTuple):
    """A solid, fixed to a pinocchio joint."""

    node: int
    kind: str  # box, cylinder, sphere, mesh
    size: tuple[float, ...]  # [m] three edges; radius and length; radius; none of a mesh
    placement: Array  # (4, 4) in the node's frame
    color: Color
    vertices: Array | None = None  # (V, 3) of a mesh
    faces: IntArray | None = None  # (F, 3)

    @property
    def half_edges(self) -> Array:
        """Half the edges (3,) [m] of the bounding box of a primitive shape."""
        if self.kind == "box":
            return 0.5 * np.array(self.size)
        radius = self.size[0]
        return np.array([radius, radius, 0.5 * self.size[1] if self.kind == "cylinder" else radius])

    def corners(self) -> Array:
        """Return the corners (8, 3) [m] of the bounding box, in the node's frame."""
        if self.vertices is not None:
            low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        else:
            low, high = -self.half_edges, self.half_edges
        corners = list(product(*zip(low, high, strict=True)))  # each a choice of low or high x, y, z
        return self.to_node(np.array(corners))

    def to_node(self, points: Array) -> Array:
        """Transform points (m, 3) from the shape's frame to the node's frame."""
        return points @ self.placement[:3, :3].T + self.placement[:3, 3]


def read_visuals(description: RobotDescription, model: pin.Model) -> list[Shape]:
    """Read the visuals of the URDF as shapes on the joints of a `model`.

    Malformed visuals and unreadable meshes are left out.
    """
    root = fromstring(description.urdf_text)
    materials = {material.get("name"): material for material in root.findall("material")}
    shapes = []
    for link in root.findall("link"):
        frame = model.frames[model.getFrameId(link.get("name", ""), pin.FrameType.BODY)]
        for visual in link.findall("visual"):
            try:
                geometry = child_element(visual, "<visual>", "geometry")  # a RobotFileError is a ValueError
                kind, size, vertices, faces = _read_solid(description, geometry)
                placement = frame.placement.homogeneous @ read_origin(visual, "<visual>")
                color = _read_color(visual.find("material"), materials)
            except ValueError:
                continue
            shapes.append(Shape(frame.parentJoint, kind, size, placement, color, vertices, faces))
    return shapes


def _read_solid(
    description: RobotDescription, geometry: Element
) -> tuple[str, tuple[float, ...], Array | None, IntArray | None]:
    """Read the first known shape of a `<geometry>`: kind, sizes [m], vertices and faces.

    A mesh has no sizes; the other shapes have neither vertices nor faces, None.

    Raises:
        ValueError: no shape is known, or a size is malformed or not positive.
    """
    for shape in geometry:
        if shape.tag == "mesh":
            return "mesh", (), *_load_mesh(description, shape)
        if shape.tag in SIZES_OF_SHAPES:
            sizes: tuple[float, ...] = ()
            for key in SIZES_OF_SHAPES[shape.tag]:  # `size`, of a box, lists three edges
                sizes += parse_numbers(key, shape.get(key), 3 if key == "size" else 1)
            if min(sizes) <= 0:
                raise ValueError("no size")
            # a capsule is drawn without its round ends
            return shape.tag.replace("capsule", "cylinder"), sizes, None, None
    raise ValueError("no known shape")


def _load_mesh(description: RobotDescription, element: Element) -> tuple[Array, IntArray]:
    """Load the vertices (V, 3) and faces (F, 3) of a mesh file.

    Raises:
        ValueError: the file or its surface is missing, too large or malformed.
    """
    reference = element.get("filename", "").removeprefix("file://")
    file = locate_urdf(description.file.parent, reference)
    if not (reference and os.path.isfile(file) and os.path.getsize(file) <= MAX_MESH_BYTES):
        raise ValueError("no mesh file")
    scale = parse_numbers("scale", element.get("scale", "1 1 1"), 3)
    mesh = coal.MeshLoader().load(os.path.abspath(file), np.array(scale))
    vertices = np.array(mesh.vertices(), dtype=float).reshape(-1, 3)
    triangles = [mesh.tri_indices(k) for k in range(mesh.num_tris)]  # not iterable: indexed by 0, 1, 2
    faces = np.array([[triangle[i] for i in range(3)] for triangle in triangles], dtype=np.intp)
    if not (triangles and np.all(np.isfinite(vertices))):
        raise ValueError("no surface")
    return vertices, faces


def _read_color(material: Element | None, materials: Mapping[str | None, Element]) -> Color:
    """Read the colour (red, green, blue, alpha) of a visual with a `material`.

    If the material has no colour, the one of the same name in `materials`, those of the robot, counts.
    Without any colour it is `default`.
    """
    default = (0.9, 0.9, 0.9, 1.0)  # of a visual without a colour
    if material is None:
        return default
    for element in (material, materials.get(material.get("name"))):
        if element is not None and (color := element.find("color")) is not None:
            red, green, blue, alpha = parse_numbers("rgba", color.get("rgba"), 4)
            return red, green, blue, alpha
    return default
