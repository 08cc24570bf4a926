"""Writes urdf/diamond/diamond.urdf: two equal legs of two parallelograms each, with hinges throughout.

Source of the mechanism: T. Huang, Z. Li, M. Li, D. G. Chetwynd and C. M. Gosselin, "Conceptual design and
dimensional synthesis of a novel 2-DOF translational parallel robot for pick-and-place operations", J. Mech.
Design 126, 2004; not checked against the original. Dimensions and masses are ours.
"""

from __future__ import annotations

import numpy as np

from robots.generators.elements import (
    Element,
    Limit,
    cylinder,
    document,
    fixed,
    joint,
    link,
    origin,
    shape,
    solid_cylinder,
)

YAW = {"r": 0.0, "l": np.pi}  # direction in which a leg stands [rad]
BASE, PLATFORM, ARM, ROD = 0.22, 0.07, 0.35, 0.45  # [m]; the first two from the middle
LIFT, WIDTH = 0.06, 0.05  # of the parallelograms of arm and idler, and of two rods [m]
ARM_MASS, IDLER_MASS, BRACKET_MASS, ROD_MASS, PLATFORM_MASS = 1.1, 0.25, 0.2, 0.16, 1.4  # [kg]
ARM_RADIUS, ROD_RADIUS, BRACKET_RADIUS = 0.025, 0.008, 0.015  # of the cylinders [m]

HEADER = """<?xml version="1.0"?>
<!--
The Diamond, two translations, as built: hinges throughout. Written by robots/generators/diamond.py: change
that, not this.

Dimensions and masses are ours: uniform arms of 1.1 kg, idlers of 0.25 kg, brackets of 0.2 kg and rods of 0.16
kg, a platform of 1.4 kg with its payload.

Units: m, kg, rad. z points up and all hinges are normal to the plane xz. Leg r stands at +x, leg l at -x; at
0 an arm points outward, a positive angle lowers it, and the rods hang down. Arm and idler are a parallelogram
that keeps the bracket at their ends level; the two rods of the bracket are one that keeps the platform level,
and so do those of the other leg. A URDF is a tree: rod ra carries the platform, diamond.yaml closes the rest.
-->
<robot name="diamond">
  <material name="frame"><color rgba="0.25 0.27 0.30 1"/></material>
  <material name="arm"><color rgba="0.84 0.37 0.10 1"/></material>
  <material name="rod"><color rgba="0.12 0.47 0.71 1"/></material>
  <material name="steel"><color rgba="0.75 0.76 0.78 1"/></material>
  <material name="payload"><color rgba="0.93 0.72 0.13 1"/></material>
"""


def files() -> dict[str, str]:
    """The text of each file that is kept, by its place below urdf/."""
    return {"diamond/diamond.urdf": urdf()}


def urdf() -> str:
    """The text of the URDF."""
    beam = shape(cylinder(0.03, 2 * BASE), origin((0, 0, 0.5 * LIFT), (0, np.pi / 2, 0)), "frame")
    parts: list[Element | str] = ["", link("base", beam), ""]
    for leg in YAW:
        parts += _leg(leg)
    return document(HEADER, [*parts, *_platform()])


def _leg(leg: str) -> list[Element | str]:
    knee, turn = f"bracket_{leg}", (0, 0, YAW[leg])
    x = np.cos(YAW[leg]) * BASE
    middle = origin((0.5 * ARM, 0, 0), (0, np.pi / 2, 0))
    return [
        f"  <!-- Leg {leg}. -->",
        _hinge(f"motor_{leg}", "base", f"arm_{leg}", origin((x, 0, 0), turn), (-2.2, 3.2, 200, 40)),
        link(
            f"arm_{leg}",
            solid_cylinder(ARM_MASS, ARM_RADIUS, ARM, "x", (0.5 * ARM, 0, 0)),
            shape(cylinder(ARM_RADIUS, ARM), middle, "arm"),
        ),
        _hinge(f"idle_{leg}", "base", f"idler_{leg}", origin((x, 0, LIFT), turn)),
        link(
            f"idler_{leg}",
            solid_cylinder(IDLER_MASS, ROD_RADIUS, ARM, "x", (0.5 * ARM, 0, 0)),
            shape(cylinder(ROD_RADIUS, ARM), middle, "rod"),
        ),
        *fixed(f"idler_{leg}_end", f"idler_{leg}", f"idler_tip_{leg}", (ARM, 0, 0)),
        _hinge(f"knee_{leg}", f"arm_{leg}", knee, origin((ARM, 0, 0))),
        link(
            knee,
            solid_cylinder(BRACKET_MASS, BRACKET_RADIUS, LIFT, "z", (0, 0, 0.5 * LIFT)),
            shape(cylinder(BRACKET_RADIUS, LIFT), origin((0, 0, 0.5 * LIFT)), "steel"),
            shape(cylinder(0.01, WIDTH), origin((0, 0, 0), (0, np.pi / 2, 0)), "steel"),
        ),
        *fixed(f"bracket_{leg}_top", knee, f"bracket_pin_{leg}", (0, 0, LIFT)),
        *(element for rod in "ab" for element in _rod(leg, rod)),
        "",
    ]


def _rod(leg: str, rod: str) -> list[Element]:
    """A rod of the bracket, which hangs at 0, and the frame at its tip."""
    name, middle = f"{leg}{rod}", (0, 0, -0.5 * ROD)
    return [
        _hinge(f"swing_{name}", f"bracket_{leg}", f"rod_{name}", origin((_across(rod), 0, 0))),
        link(
            f"rod_{name}",
            solid_cylinder(ROD_MASS, ROD_RADIUS, ROD, "z", middle),
            shape(cylinder(ROD_RADIUS, ROD), origin(middle), "rod"),
        ),
        *fixed(f"end_{name}", f"rod_{name}", f"tip_{name}", (0, 0, -ROD)),
    ]


def _platform() -> list[Element | str]:
    """The platform on rod ra, and the places of the other rods."""
    parts: list[Element | str] = [
        "  <!-- The platform. -->",
        _hinge("wrist", "tip_ra", "seat_ra", origin()),
        link("seat_ra"),
        joint("platform_centre", "fixed", "seat_ra", "platform", origin((-PLATFORM - _across("a"), 0, 0))),
        link(
            "platform",
            solid_cylinder(PLATFORM_MASS, 0.03, 2 * PLATFORM, "x"),
            shape(cylinder(0.012, 2 * PLATFORM + WIDTH), origin((0, 0, 0), (0, np.pi / 2, 0)), "steel"),
            shape(cylinder(0.03, 0.08), origin((0, 0, -0.05)), "payload"),
        ),
    ]
    for leg, rod in (("r", "b"), ("l", "a"), ("l", "b")):
        x = np.cos(YAW[leg]) * (PLATFORM + _across(rod))
        parts += fixed(f"platform_{leg}{rod}", "platform", f"seat_{leg}{rod}", (x, 0, 0), (0, 0, YAW[leg]))
    return parts


def _across(rod: str) -> float:
    """Where a rod stands beside the middle of its two, outward [m]."""
    return (0.5 if rod == "b" else -0.5) * WIDTH


def _hinge(name: str, parent: str, child: str, place: Element, limit: Limit = (-4.5, 4.5, 0, 100)) -> Element:
    """A hinge about the leg's y; without a motor its effort is 0."""
    return joint(name, "revolute", parent, child, place, "0 1 0", limit)
