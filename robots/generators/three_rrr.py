"""Writes urdf/three_rrr/three_rrr.urdf: three equal legs and a platform on the first of them."""

from __future__ import annotations

from math import pi

from robots.generators.elements import (
    COMPACT,
    ZERO,
    Element,
    box,
    cylinder,
    document,
    fixed,
    joint,
    link,
    origin,
    shape,
    solid_cylinder,
    turning,
)

MOTORS = ((0.0, 0.0), (1.2, 0.0), (0.6, 1.0392304845413265))  # [m], 0.6 sqrt(3)
CORNERS = ((-0.0928, -0.0535), (0.0928, -0.0535), (0.0, 0.107))  # of the platform, in its frame [m]
LENGTH = 0.6  # of every crank and every rod [m]
CRANK, ROD, PLATFORM = (1.5, 0.015), (0.9, 0.012), (4.0, 0.12)  # mass [kg], radius [m]
THICKNESS = 0.03  # of the platform [m]
LAYER = 0.06  # cranks one layer below the rods, the platform one layer above [m]

HEAD = """<?xml version="1.0"?>
<!--
A planar 3-RRR robot: three legs of two equal links each, motors at the base, a triangular platform.
Written by robots/generators/three_rrr.py; change that file, not this one.

Source of the dimensions: J. Kotlarski, B. Heimann and T. Ortmaier, "Influence of kinematic redundancy on the
singularity-free workspace of parallel kinematic machines", Frontiers of Mechanical Engineering 7(2), 2012,
DOI 10.1007/s11465-012-0321-8, with its sliding motors locked: an equilateral base of 1.2 m, links of 0.6 m,
a platform whose corners lie 0.107 m from its centre (rounded to 0.1 mm). Masses are ours: uniform rods of
1.5 kg (cranks) and 0.9 kg (rods), a platform of 4 kg as a disc.

Units: m, kg, rad, N m. The xy plane is horizontal and the axis of every joint is z. Origin: the first motor.
A URDF is a tree: the platform hangs on leg 1; legs 2 and 3 are closed at its corners in three_rrr.yaml.
Every joint origin lies in the plane z = 0. The shapes stand in three layers: cranks, rods, platform.
-->
<robot name="three_rrr">
  <material name="frame"><color rgba="0.25 0.27 0.30 1"/></material>
  <material name="crank"><color rgba="0.12 0.47 0.71 1"/></material>
  <material name="rod"><color rgba="0.84 0.37 0.10 1"/></material>
  <material name="steel"><color rgba="0.75 0.76 0.78 1"/></material>
  <material name="payload"><color rgba="0.93 0.72 0.13 1"/></material>
"""


def files() -> dict[str, str]:
    """The text of each file that is kept, by its place below urdf/."""
    return {"three_rrr/three_rrr.urdf": urdf()}


def urdf() -> str:
    """The whole file."""
    flat = (0, 0.5 * pi, 0)  # a cylinder along x
    motors = [shape(cylinder(0.05, 0.08), origin((x, y, -LAYER - 0.08)), "frame") for x, y in MOTORS]
    table = shape(box((1.5, 1.3, 0.02)), origin((0.6, 0.5, -LAYER - 0.13)), "frame")
    parts: list[Element | str] = [link("base", *motors, table)]
    mass, radius = CRANK
    crank = (
        solid_cylinder(mass, radius, LENGTH, "x", (0.5 * LENGTH, 0, 0)),
        shape(cylinder(radius, LENGTH), origin((0.5 * LENGTH, 0, -LAYER), flat), "crank"),
        shape(cylinder(0.02, 0.04), origin((0, 0, -LAYER - 0.02)), "steel"),
    )
    mass, radius = ROD
    rod = (
        solid_cylinder(mass, radius, LENGTH, "x", (0.5 * LENGTH, 0, 0)),
        shape(cylinder(radius, LENGTH), origin((0.5 * LENGTH, 0, 0), flat), "rod"),
        shape(cylinder(0.015, LAYER), origin((0, 0, -0.5 * LAYER)), "steel"),
        shape(cylinder(0.015, LAYER), origin((LENGTH, 0, 0.5 * LAYER)), "steel"),
    )
    for n, (x, y) in enumerate(MOTORS, start=1):
        parts += [
            f"\n  <!-- Leg {n}: motor, crank, elbow, rod, and the frame at the tip of the rod. -->",
            turning(f"motor_{n}", "base", f"crank_{n}", (x, y, 0), effort=200),
            link(f"crank_{n}", *crank),
            turning(f"elbow_{n}", f"crank_{n}", f"rod_{n}", (LENGTH, 0, 0)),
            link(f"rod_{n}", *rod),
            *fixed(f"rod_{n}_tip", f"rod_{n}", f"tip_{n}", (LENGTH, 0, 0)),
        ]
    x, y = CORNERS[0]
    mass, radius = PLATFORM
    parts += [
        "\n  <!-- The platform: its frame at its centre, one frame at each corner. -->",
        turning("wrist_1", "tip_1", "corner_1", ZERO),
        link("corner_1"),
        joint("platform_centre", "fixed", "corner_1", "platform", origin((-x, -y, 0))),
        link(
            "platform",
            solid_cylinder(mass, radius, THICKNESS, "z"),
            shape(cylinder(radius, THICKNESS), origin((0, 0, LAYER)), "payload"),
        ),
    ]
    for n, (x, y) in enumerate(CORNERS[1:], start=2):
        parts += fixed(f"platform_corner_{n}", "platform", f"corner_{n}", (x, y, 0))
    return document(HEAD, parts, COMPACT)
