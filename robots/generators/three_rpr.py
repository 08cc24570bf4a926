"""Writes urdf/three_rpr/three_rpr.urdf: three rods that slide through their pivots, and a platform."""

from __future__ import annotations

from math import atan2, hypot, pi, sqrt

import numpy as np

from robots.generators.elements import (
    COMPACT,
    ZERO,
    Element,
    box,
    cylinder,
    document,
    fixed,
    inertial,
    joint,
    link,
    origin,
    shape,
    solid_cylinder,
    turning,
)

UNIT = 0.05  # [m], what we take for the source's unit of length
PIVOTS = ((0.0, 0.0), (15.91 * UNIT, 0.0), (0.0, 10 * UNIT))  # A_i [m]
SIDE_12, SIDE_23, SIDE_31 = 17.04 * UNIT, 16.54 * UNIT, 20.84 * UNIT  # B_1 B_2, B_2 B_3, B_3 B_1 [m]
_X3 = (SIDE_12**2 + SIDE_31**2 - SIDE_23**2) / (2 * SIDE_12)
CORNERS = ((0.0, 0.0), (SIDE_12, 0.0), (_X3, sqrt(SIDE_31**2 - _X3**2)))  # B_i in the platform [m]
ROD_LENGTH = 1.2  # [m], from its tip B_i back through the pivot
BLOCK, ROD, PLATFORM = 1.5, 2.0, 5.0  # masses [kg]
RADIUS = 0.012  # of the rods [m]
EDGE = 0.08  # of a block [m], a cube
THICKNESS = 0.02  # of the platform [m]
HEIGHTS = (0.0, 0.0, -0.09)  # of the legs' shapes: rod 3 passes under rod 1 [m]
LAYER = 0.08  # the platform stands this much above legs 1 and 2 [m]
FLOOR = -0.2  # [m]

HEAD = """<?xml version="1.0"?>
<!--
A planar 3-RPR robot: three rods that slide through turning blocks, driven there, and a triangular platform.
Written by robots/generators/three_rpr.py; change that file, not this one.

Dimensions after C. Innocenti and V. Parenti-Castelli, "Singularity-free evolution from one configuration to
another in serial and fully-parallel manipulators", ASME J. Mechanical Design 120, 1998, the example also of
M. Zein, P. Wenger and D. Chablat, "Singular curves in the joint space and cusp points of 3-RPR parallel
manipulators", Robotica 25, 2007, arXiv 0711.0574; not checked against the originals: A_1 (0, 0), A_2
(15.91, 0), A_3 (0, 10), B_1 B_2 = 17.04, B_2 B_3 = 16.54, B_3 B_1 = 20.84, in units that we take for 0.05 m.
Masses are ours: blocks of 1.5 kg, uniform rods of 2 kg and 1.2 m, a platform of 5 kg as a uniform triangular
plate.

Units: m, kg, rad, N. The xy plane is horizontal, blocks and platform turn about z. Origin: A_1.
A URDF is a tree: the platform hangs on leg 1; legs 2 and 3 are closed at its corners in three_rpr.yaml.
The coordinate of a sliding joint is the length of its leg, from A_i to B_i. Every joint origin lies in the
plane z = 0. The shapes stand in layers: leg 3, legs 1 and 2, the platform.
-->
<robot name="three_rpr">
  <material name="frame"><color rgba="0.25 0.27 0.30 1"/></material>
  <material name="block"><color rgba="0.12 0.47 0.71 1"/></material>
  <material name="rod"><color rgba="0.84 0.37 0.10 1"/></material>
  <material name="steel"><color rgba="0.75 0.76 0.78 1"/></material>
  <material name="payload"><color rgba="0.93 0.72 0.13 1"/></material>
"""


def plate() -> Element:
    """The platform: inertia of a uniform triangular plate, its edges and its middle as shapes."""
    x, y = (sum(corner[k] for corner in CORNERS) / 3 for k in range(2))
    spokes = [(cx - x, cy - y) for cx, cy in CORNERS]
    xx, yy, xy = (
        PLATFORM / 12 * sum(s[i] * s[j] for s in spokes)  # second moments of the mass
        for i, j in ((0, 0), (1, 1), (0, 1))
    )
    out = PLATFORM * THICKNESS**2 / 12
    moments = np.array([[yy + out, -xy, 0], [-xy, xx + out, 0], [0, 0, xx + yy]])
    edges = [
        shape(
            box((hypot(bx - ax, by - ay), 0.03, THICKNESS)),
            origin((0.5 * (ax + bx), 0.5 * (ay + by), LAYER), (0, 0, atan2(by - ay, bx - ax))),
            "payload",
        )
        for (ax, ay), (bx, by) in zip(CORNERS, (*CORNERS[1:], CORNERS[0]), strict=True)
    ]
    return link(
        "platform",
        inertial(PLATFORM, (x, y, 0), moments),
        *edges,
        shape(cylinder(0.06, THICKNESS), origin((x, y, LAYER)), "payload"),
    )


def base() -> Element:
    """Posts from the floor to the lower faces of the blocks, and the plate under everything."""
    posts = []
    for place, z in zip(PIVOTS, HEIGHTS, strict=True):
        top = z - 0.5 * EDGE
        posts.append(shape(cylinder(0.025, top - FLOOR), origin((*place, 0.5 * (top + FLOOR))), "frame"))
    return link("base", *posts, shape(box((1.1, 0.8, 0.02)), origin((0.4, 0.25, FLOOR - 0.01)), "frame"))


def block(name: str, z: float) -> Element:
    """A block that turns on its post, its shape at height z [m]."""
    cube = inertial(BLOCK, ZERO, [BLOCK * EDGE**2 / 6] * 3)
    return link(name, cube, shape(box((EDGE, EDGE, EDGE)), origin((0, 0, z)), "block"))


def rod(name: str, z: float) -> Element:
    """A rod, its shape at height z [m], with the pin at its tip that reaches the platform."""
    return link(
        name,
        solid_cylinder(ROD, RADIUS, ROD_LENGTH, "x", (-0.5 * ROD_LENGTH, 0, 0)),
        shape(cylinder(RADIUS, ROD_LENGTH), origin((-0.5 * ROD_LENGTH, 0, z), (0, 0.5 * pi, 0)), "rod"),
        shape(cylinder(0.015, LAYER - z), origin((0, 0, 0.5 * (LAYER + z))), "steel"),
    )


def files() -> dict[str, str]:
    """The text of each file that is kept, by its place below urdf/."""
    return {"three_rpr/three_rpr.urdf": urdf()}


def urdf() -> str:
    """The whole file."""
    parts: list[Element | str] = [base()]
    stroke = (0, ROD_LENGTH, 5000, 5)
    for n, ((x, y), z) in enumerate(zip(PIVOTS, HEIGHTS, strict=True), start=1):
        parts += [
            f"\n  <!-- Leg {n}: pivot, block, sliding motor, rod, and the frame at its tip. -->",
            turning(f"pivot_{n}", "base", f"block_{n}", (x, y, 0)),
            block(f"block_{n}", z),
            joint(f"motor_{n}", "prismatic", f"block_{n}", f"rod_{n}", origin(), "1 0 0", stroke),
            rod(f"rod_{n}", z),
            *fixed(f"rod_{n}_tip", f"rod_{n}", f"tip_{n}"),
        ]
    parts += [
        "\n  <!-- The platform: its frame at corner B_1, one frame at each other corner. -->",
        turning("wrist_1", "tip_1", "platform", ZERO),
        plate(),
    ]
    for n, (x, y) in enumerate(CORNERS[1:], start=2):
        parts += fixed(f"platform_corner_{n}", "platform", f"corner_{n}", (x, y, 0))
    return document(HEAD, parts, COMPACT)
