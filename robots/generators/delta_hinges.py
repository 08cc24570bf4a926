"""Writes urdf/delta_hinges/delta_hinges.urdf: three equal legs whose parallelograms have four hinges each.

Source of the mechanism: L.-W. Tsai, G. C. Walsh and R. E. Stamper, "Kinematics of a novel three DOF
translational platform", ICRA 1996; not checked against the original. Dimensions and masses are ours.
"""

from __future__ import annotations

import numpy as np

from framework.numerics.arrays import Array
from robots.generators.elements import (
    ZERO,
    Element,
    Limit,
    Value,
    cylinder,
    document,
    fixed,
    joint,
    link,
    origin,
    shape,
    solid_cylinder,
)

YAW = (0.0, 2 * np.pi / 3, -2 * np.pi / 3)  # of the legs [rad]
BASE, PLATFORM, ARM, ROD, WIDTH = 0.18, 0.05, 0.26, 0.54, 0.11  # [m]
ARM_MASS, BAR_MASS, ROD_MASS, PLATFORM_MASS = 0.7, 0.06, 0.09, 0.5  # [kg]; bars join the rods above and below
ARM_RADIUS, BAR_RADIUS, ROD_RADIUS, PLATE_RADIUS, PLATE = 0.022, 0.008, 0.006, 0.05, 0.02  # [m]

HEADER = """<?xml version="1.0"?>
<!--
A Delta robot with hinges throughout, after Tsai. Written by robots/generators/delta_hinges.py: change that,
not this.

Dimensions and masses are ours: uniform arms of 0.7 kg, rods of 0.09 kg and bars of 0.06 kg between two rods,
a platform of 0.5 kg as a disc.

Units: m, kg, rad. z points up, the motor axes lie in the plane z = 0. Leg i stands at 0, 120 and 240 degrees;
at 0 its arm points outward, and a positive angle lowers it. The upper bar of a forearm turns on the arm's end
about an axis parallel to the motor's. Two rods hang on it, a and b, which lean sideways together, and carry
the lower bar: a parallelogram of four parallel hinges. The lower bar turns on the platform. A URDF is a tree:
leg 1 carries the platform by its rod a; delta_hinges.yaml closes the rest.
-->
<robot name="delta_hinges">
  <material name="frame"><color rgba="0.25 0.27 0.30 1"/></material>
  <material name="arm"><color rgba="0.84 0.37 0.10 1"/></material>
  <material name="rod"><color rgba="0.12 0.47 0.71 1"/></material>
  <material name="steel"><color rgba="0.75 0.76 0.78 1"/></material>
"""


def files() -> dict[str, str]:
    """The text of each file that is kept, by its place below urdf/."""
    return {"delta_hinges/delta_hinges.urdf": urdf()}


def urdf() -> str:
    """The text of the URDF."""
    housings = [
        shape(cylinder(0.03, 0.08), origin(_along(yaw, BASE), (-np.pi / 2, 0, yaw)), "frame") for yaw in YAW
    ]
    plate = shape(cylinder(0.13, 0.02), origin((0, 0, 0.04)), "frame")
    parts: list[Element | str] = ["", link("base", plate, *housings), ""]
    for leg, yaw in enumerate(YAW, start=1):
        parts += _leg(leg, yaw)
    return document(HEADER, [*parts, *_platform()])


def _leg(leg: int, yaw: float) -> list[Element | str]:
    place = origin(_along(yaw, BASE), (0, 0, yaw))
    return [
        f"  <!-- Leg {leg}. -->",
        joint(f"motor_{leg}", "revolute", "base", f"arm_{leg}", place, "0 1 0", (-1.6, 3.2, 100, 40)),
        link(
            f"arm_{leg}",
            solid_cylinder(ARM_MASS, ARM_RADIUS, ARM, "x", (0.5 * ARM, 0, 0)),
            shape(cylinder(ARM_RADIUS, ARM), origin((0.5 * ARM, 0, 0), (0, np.pi / 2, 0)), "arm"),
        ),
        _hinge(f"swing_{leg}", f"arm_{leg}", f"upper_{leg}", "0 1 0", (ARM, 0, 0), (-4.8, 3.2, 0, 60)),
        _bar(f"upper_{leg}", 0.0),
        *_rod(f"{leg}a", f"upper_{leg}", 0.5 * WIDTH),
        *_rod(f"{leg}b", f"upper_{leg}", -0.5 * WIDTH),
        _hinge(f"low_{leg}", f"tip_{leg}a", f"lower_{leg}", "1 0 0"),
        _bar(f"lower_{leg}", -0.5 * WIDTH),
        *fixed(f"lower_{leg}_end", f"lower_{leg}", f"pin_{leg}", (0, -WIDTH, 0)),
        *fixed(f"lower_{leg}_middle", f"lower_{leg}", f"wrist_{leg}", (0, -0.5 * WIDTH, 0)),
        "",
    ]


def _rod(name: str, parent: str, y: float) -> list[Element]:
    """A rod at y on the upper bar, which hangs at 0, and the frame at its tip."""
    middle = (0, 0, -0.5 * ROD)
    return [
        _hinge(f"lean_{name}", parent, f"rod_{name}", "1 0 0", (0, y, 0)),
        link(
            f"rod_{name}",
            solid_cylinder(ROD_MASS, ROD_RADIUS, ROD, "z", middle),
            shape(cylinder(ROD_RADIUS, ROD), origin(middle), "rod"),
        ),
        *fixed(f"end_{name}", f"rod_{name}", f"tip_{name}", (0, 0, -ROD)),
    ]


def _bar(name: str, y: float) -> Element:
    """A bar between two rods, its middle at y."""
    place = origin((0, y, 0), (np.pi / 2, 0, 0))
    return link(
        name,
        solid_cylinder(BAR_MASS, BAR_RADIUS, WIDTH, "y", (0, y, 0)),
        shape(cylinder(BAR_RADIUS, WIDTH), place, "steel"),
    )


def _platform() -> list[Element | str]:
    """The platform on the lower bar of leg 1, and the places of the other two."""
    parts: list[Element | str] = [
        "  <!-- The platform. -->",
        _hinge("platform_1", "wrist_1", "seat_1", "0 1 0"),
        link("seat_1"),
        joint("platform_centre", "fixed", "seat_1", "platform", origin((-PLATFORM, 0, 0))),
        link(
            "platform",
            solid_cylinder(PLATFORM_MASS, PLATE_RADIUS, PLATE, "z"),
            shape(cylinder(PLATE_RADIUS, PLATE), origin(), "steel"),
        ),
    ]
    for leg, yaw in enumerate(YAW[1:], start=2):
        parts += fixed(f"platform_seat_{leg}", "platform", f"seat_{leg}", _along(yaw, PLATFORM), (0, 0, yaw))
    return parts


def _along(yaw: float, radius: float) -> Array:
    """The point of a leg's plane at this distance from the centre [m]."""
    return radius * np.array([np.cos(yaw), np.sin(yaw), 0.0])


def _hinge(
    name: str, parent: str, child: str, axis: str, xyz: Value = ZERO, limit: Limit = (-3.2, 3.2, 0, 60)
) -> Element:
    """A hinge without a motor."""
    return joint(name, "revolute", parent, child, origin(xyz), axis, limit)
