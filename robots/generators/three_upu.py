"""Writes the URDF of the 3-UPU robot: three equal legs, 120 degrees apart."""

from __future__ import annotations

import math

from robots.generators.elements import (
    Element,
    cylinder,
    document,
    fixed,
    inertial,
    joint,
    link,
    origin,
    shape,
)

BASE_RADIUS, PLATFORM_RADIUS = 0.30, 0.12  # [m] circles through the centres of the universal joints
TUBE, ROD, PLATFORM = 1.5, 0.8, 5.0  # [kg]
TUBE_CENTRE, ROD_CENTRE = 0.15, 0.20  # [m] from the base joint, and back from the platform joint
# about the centre of mass, across and along [kg m^2]: uniform cylinders, 0.3 m by 60 mm and 0.4 m by 30 mm
TUBE_INERTIA, ROD_INERTIA = ("0.0115875", "0.000675"), ("0.010711667", "0.00009")

_HEAD = """<?xml version="1.0"?>
<!--
A translational 3-UPU robot with the joint layout of the prototype of Seoul National University: in each leg
the first and the last axis are radial, pointing to the centre of base and platform, and the two inner axes
are parallel. When the centres stand above one another the constraints of the three legs coincide and the
platform gains two rotations, a constraint singularity: I. Bonev and D. Zlatanov, The mystery of the singular
SNU translational parallel robot, parallemic.org, Review 4; D. Zlatanov, I. Bonev and C. Gosselin, Constraint
singularities of parallel mechanisms, IEEE ICRA 2002, not read here. The family: L.-W. Tsai, Kinematics of a
three-dof platform with three extensible limbs, Recent Advances in Robot Kinematics, 1996. The dimensions are
our own.
Written by robots/generators/three_upu.py: change that, not this.

Units: m, kg, rad, N. z is up. Base joints lie on a circle of 0.30 m, platform joints on one of 0.12 m, at
0, 120 and 240 degrees. slide_i is the distance between the universal joints of a leg. Leg 1 carries the
platform; legs 2 and 3 end in cross_2 and cross_3, the crosses of their platform joints, which three_upu.yaml
hinges to the platform about x, radial.
-->
<robot name="three_upu">
  <material name="frame"><color rgba="0.25 0.27 0.30 1"/></material>
  <material name="tube"><color rgba="0.12 0.47 0.71 1"/></material>
  <material name="rod"><color rgba="0.75 0.76 0.78 1"/></material>
  <material name="platform_colour"><color rgba="0.93 0.72 0.13 1"/></material>
"""


def files() -> dict[str, str]:
    """The text of each file that is kept, by its place below urdf/."""
    return {"three_upu/three_upu.urdf": urdf()}


def urdf() -> str:
    """The URDF of the open tree."""
    floor = shape(cylinder("0.34", "0.04"), origin("0 0 -0.06"), "frame")
    parts: list[Element | str] = [link("base", floor)]
    for i in (1, 2, 3):
        parts += ["", *_leg(i, (i - 1) * 2 * math.pi / 3)]
    parts += ["", _hinge("wrist_1b", "cross_1", "wrist_1", "1 0 0"), link("wrist_1"), ""]
    parts += [
        joint("mount", "fixed", "wrist_1", "platform", origin(f"{-PLATFORM_RADIUS!r} 0 0", "0 0 0")),
        link(
            "platform",
            inertial(f"{PLATFORM}", "0 0 0", ("0.018", "0.018", "0.036")),
            shape(cylinder("0.14", "0.03"), origin("0 0 0.05"), "platform_colour"),
        ),
    ]
    for i in (2, 3):
        angle = (i - 1) * 2 * math.pi / 3
        parts += fixed(f"anchor_{i}_mount", "platform", f"anchor_{i}", *_at(PLATFORM_RADIUS, angle))
    return document(_HEAD, parts)


def _at(radius: float, angle: float) -> tuple[str, str]:
    """A place on a circle, x radial, to the last digit: xyz and rpy."""
    return f"{radius * math.cos(angle):.17g} {radius * math.sin(angle):.17g} 0", f"0 0 {angle!r}"


def _leg(i: int, angle: float) -> list[Element | str]:
    """Local axes: x radial, y tangential, z up."""
    eye, foot = cylinder("0.02", "0.05"), origin(*_at(BASE_RADIUS, angle))
    tube, rod = f"tube_{i}", f"rod_{i}"
    return [
        _hinge(f"hip_{i}a", "base", f"yoke_{i}", "1 0 0", foot),
        link(f"yoke_{i}"),
        _hinge(f"hip_{i}b", f"yoke_{i}", tube, "0 1 0"),
        link(
            tube,
            inertial(f"{TUBE}", f"0 0 {TUBE_CENTRE}", (TUBE_INERTIA[0], *TUBE_INERTIA)),
            shape(cylinder("0.03", "0.26"), origin(f"0 0 {TUBE_CENTRE + 0.02}"), "tube"),
            shape(eye, origin(), "tube"),
        ),
        joint(f"slide_{i}", "prismatic", tube, rod, None, "0 0 1", ("0.42", "0.9", "5000", "2")),
        link(
            rod,
            inertial(f"{ROD}", f"0 0 {-ROD_CENTRE}", (ROD_INERTIA[0], *ROD_INERTIA)),
            shape(cylinder("0.015", "0.36"), origin(f"0 0 {-ROD_CENTRE - 0.02}"), "rod"),
            shape(eye, origin(), "rod"),
        ),
        *fixed(f"rod_{i}_end", rod, f"tip_{i}"),
        _hinge(f"wrist_{i}a", f"tip_{i}", f"cross_{i}", "0 1 0"),
        link(f"cross_{i}"),
    ]


def _hinge(name: str, parent: str, child: str, axis: str, place: Element | None = None) -> Element:
    return joint(name, "revolute", parent, child, place, axis, ("-1.4", "1.4", "0", "10"))
