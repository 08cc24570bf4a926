"""Writes urdf/par4/par4.urdf: four legs in pairs on two half plates, which two parallel bars join.

Source of the mechanism: V. Nabat, M. Rodriguez, O. Company, S. Krut and F. Pierrot, "Par4: very high speed
parallel robot for pick-and-place", IROS 2005. Dimensions and masses are ours.
"""

from __future__ import annotations

import numpy as np

from framework.numerics.arrays import Array
from robots.generators.elements import (
    ZERO,
    Element,
    Value,
    cylinder,
    document,
    fixed,
    joint,
    link,
    origin,
    shape,
    solid_cylinder,
    sphere,
)

LEGS = (1, 2, 3, 4)
YAW = np.deg2rad([-45.0, 45.0, 135.0, 225.0])  # of the legs; 1 and 2 hold half plate a, 3 and 4 hold b
BASE, ARM, ROD = 0.2, 0.35, 0.8  # motor axes from the centre, arm, forearm [m]
BAR, WRIST, APART = 0.16, 0.06, 0.1  # bar, wrist from first pivot, second pivot from first [m]
ARM_MASS, ROD_MASS, HALF_MASS, BAR_MASS, TOOL_MASS = 0.8, 0.2, 0.15, 0.1, 1.5  # [kg]
ARM_RADIUS, ROD_RADIUS, BAR_RADIUS, HALF_RADIUS = 0.025, 0.008, 0.008, 0.02  # [m]
TOOL_RADIUS, TOOL = 0.1, 0.03  # radius and thickness [m]

HEADER = """<?xml version="1.0"?>
<!--
Par4, a robot of four legs with three translations and a turn. Written by robots/generators/par4.py: change
that.

Source of the mechanism: V. Nabat, M. Rodriguez, O. Company, S. Krut and F. Pierrot, "Par4: very high speed
parallel robot for pick-and-place", IROS 2005. Dimensions and masses are ours: uniform arms of 0.8 kg and
forearms of 0.2 kg, half plates of 0.15 kg as rods, bars of 0.1 kg, a tool of 1.5 kg as a disc, clamped to
bar 1 without the robot's gear.

Units: m, kg, rad. z points up, the motor axes lie in the plane z = 0. Leg i stands at -45, 45, 135 and 225
degrees; at 0 its arm points outward, and a positive angle lowers it. Each parallelogram of a forearm is
modelled by one rod between two universal joints with parallel axes, which moves and holds the half plate in
the same way. At 0 it hangs down. Legs 1 and 2 hold half plate a, 3 and 4 hold b; neither half can turn. Two
parallel bars on pivots along z join them: the halves, moved apart, turn the bars. A URDF is a tree: leg 1
carries a, bar 1 carries b; par4.yaml closes the rest.
-->
<robot name="par4">
  <material name="frame"><color rgba="0.25 0.27 0.30 1"/></material>
  <material name="arm"><color rgba="0.84 0.37 0.10 1"/></material>
  <material name="rod"><color rgba="0.12 0.47 0.71 1"/></material>
  <material name="steel"><color rgba="0.75 0.76 0.78 1"/></material>
  <material name="payload"><color rgba="0.93 0.72 0.13 1"/></material>
"""


def files() -> dict[str, str]:
    """The text of each file that is kept, by its place below urdf/."""
    return {"par4/par4.urdf": urdf()}


def urdf() -> str:
    """The text of the URDF."""
    housings = [
        shape(cylinder(0.035, 0.08), origin(_along(yaw, BASE), (-np.pi / 2, 0, yaw)), "frame") for yaw in YAW
    ]
    plate = shape(cylinder(0.16, 0.02), origin((0, 0, 0.06)), "frame")
    parts: list[Element | str] = ["", link("base", plate, *housings), ""]
    for leg in LEGS:
        parts += _leg(leg)
    return document(HEADER, [*parts, *_plate()])


def _leg(leg: int) -> list[Element | str]:
    yaw = YAW[leg - 1]
    place, limit = origin(_along(yaw, BASE), (0, 0, yaw)), (-1.6, 2.4, 300, 30)
    middle = (0, 0, -0.5 * ROD)
    return [
        f"  <!-- Leg {leg}. -->",
        joint(f"motor_{leg}", "revolute", "base", f"arm_{leg}", place, "0 1 0", limit),
        link(
            f"arm_{leg}",
            solid_cylinder(ARM_MASS, ARM_RADIUS, ARM, "x", (0.5 * ARM, 0, 0)),
            shape(cylinder(ARM_RADIUS, ARM), origin((0.5 * ARM, 0, 0), (0, np.pi / 2, 0)), "arm"),
        ),
        joint(f"arm_{leg}_end", "fixed", f"arm_{leg}", f"knee_{leg}", origin((ARM, 0, 0))),
        link(f"knee_{leg}", shape(cylinder(0.015, 0.08), origin(ZERO, (np.pi / 2, 0, 0)), "steel")),
        _passive(f"swing_{leg}", f"knee_{leg}", f"cross_{leg}", "0 1 0"),
        link(f"cross_{leg}", shape(sphere("0.018"), origin(), "steel")),
        _passive(f"lean_{leg}", f"cross_{leg}", f"rod_{leg}", "1 0 0"),
        link(
            f"rod_{leg}",
            solid_cylinder(ROD_MASS, ROD_RADIUS, ROD, "z", middle),
            shape(cylinder(ROD_RADIUS, ROD), origin(middle), "rod"),
        ),
        joint(f"rod_{leg}_end", "fixed", f"rod_{leg}", f"tip_{leg}", origin((0, 0, -ROD))),
        link(f"tip_{leg}", shape(sphere("0.015"), origin(), "steel")),
        *(_wrist(leg) if leg in (2, 3) else ()),
        "",
    ]


def _wrist(leg: int) -> tuple[Element, Element]:
    """The cross of a universal joint: leans on the rod, swings on the half plate."""
    name = f"wrist_{leg}"
    return _passive(f"wrist_lean_{leg}", f"tip_{leg}", name, "1 0 0"), link(name)


def _plate() -> list[Element | str]:
    yaw = YAW[0]
    parts: list[Element | str] = [
        "  <!-- Half plate a on the wrist of leg 1, the two bars, half plate b on bar 1. -->",
        *_wrist(1),
        _passive("wrist_swing_1", "wrist_1", "seat_1", "0 1 0"),
        link("seat_1"),
        joint("half_a", "fixed", "seat_1", "a", origin(_turned(-yaw, -_along(yaw, WRIST)), (0, 0, -yaw))),
        _half("a", (1, 2)),
        *fixed("seat_a_2", "a", "seat_2", _along(YAW[1], WRIST), (0, 0, YAW[1])),
        _passive("pivot_1", "a", "bar_1", "0 0 1"),
        _bar("bar_1", 0.0),
        joint("tool_mount", "fixed", "bar_1", "tool", origin((-0.5 * BAR, 0, 0))),
        link(
            "tool",
            solid_cylinder(TOOL_MASS, TOOL_RADIUS, TOOL, "z"),
            shape(cylinder(TOOL_RADIUS, TOOL), origin((0, 0, -0.06)), "payload"),
        ),
        _passive("pivot_2", "bar_1", "b", "0 0 1", (-BAR, 0, 0)),
        _half("b", (3, 4)),
        *fixed("pivot_b", "b", "b_end", (APART, 0, 0)),
    ]
    for leg in (3, 4):
        yaw = YAW[leg - 1]
        parts += fixed(f"seat_b_{leg}", "b", f"seat_{leg}", _along(yaw, WRIST), (0, 0, yaw))
    return [
        *parts,
        _passive("pivot_3", "a", "bar_2", "0 0 1", (APART, 0, 0)),
        _bar("bar_2", -0.03),
        *fixed("bar_2_end", "bar_2", "bar_2_tip", (-BAR, 0, 0)),
    ]


def _half(name: str, legs: tuple[int, int]) -> Element:
    """A half plate: its pivots lie along x, arms reach from the first to the wrists of its legs."""
    arms = [
        shape(cylinder(0.01, WRIST), origin(_along(yaw, 0.5 * WRIST), (0, np.pi / 2, yaw)), "steel")
        for yaw in (YAW[leg - 1] for leg in legs)
    ]
    return link(
        name,
        solid_cylinder(HALF_MASS, HALF_RADIUS, APART, "x", (0.5 * APART, 0, 0)),
        shape(cylinder(0.01, APART), origin((0.5 * APART, 0, 0.015), (0, np.pi / 2, 0)), "steel"),
        *arms,
    )


def _bar(name: str, z: float) -> Element:
    """A bar along -x from its pivot."""
    return link(
        name,
        solid_cylinder(BAR_MASS, BAR_RADIUS, BAR, "x", (-0.5 * BAR, 0, 0)),
        shape(cylinder(BAR_RADIUS, BAR), origin((-0.5 * BAR, 0, z - 0.015), (0, np.pi / 2, 0)), "arm"),
    )


def _along(yaw: float, radius: float) -> Array:
    return radius * np.array([np.cos(yaw), np.sin(yaw), 0.0])


def _turned(yaw: float, vector: Array) -> Array:
    """The vector of the base frame, turned by yaw."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2]])


def _passive(name: str, parent: str, child: str, axis: str, xyz: Value = ZERO) -> Element:
    """A revolute joint without a motor."""
    return joint(name, "revolute", parent, child, origin(xyz), axis, (-3.2, 3.2, 0, 30))
