"""Writes urdf/delta/delta.urdf: three equal legs with real parallelograms, and a platform on one rod.

Source of the dimensions: R. L. Williams II, "The Delta Parallel Robot: Kinematics Solutions", Ohio
University, 2015, table of the ABB FlexPicker IRB 360-1/1600, as other programs quote it: arms of 0.524 m,
forearms of 1.244 m and 0.131 m wide; a base triangle with sides of 0.567 m, which puts the motor axes 0.164 m
from the centre, and a platform triangle with sides of 0.076 m, its corners, where the forearms end, 0.044 m
from the centre. Masses are ours.
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
    sphere,
)

BASE, PLATFORM, ARM, ROD, WIDTH = 0.164, 0.044, 0.524, 1.244, 0.131  # [m]
ARM_MASS, ROD_MASS, PLATFORM_MASS = 1.6, 0.18, 1.5  # [kg]; the platform with 1 kg of payload
# A forearm may hang or lie level (1.6 rad either way) wherever its arm is, from -1.6 to 4.2 rad: its rods
# pass beside the arm.
SWING = (-5.8, 3.2, 0, 30)
ARM_RADIUS, ROD_RADIUS, PLATE_RADIUS, PLATE = 0.03, 0.008, 0.08, 0.02  # of the shapes [m]


HEADER = """<?xml version="1.0"?>
<!--
Clavel's Delta robot with real parallelograms. Written by robots/generators/delta.py: change that, not this.

Source of the dimensions: R. L. Williams II, "The Delta Parallel Robot: Kinematics Solutions", Ohio
University, 2015, table of the ABB FlexPicker IRB 360-1/1600, as other programs quote it. Masses are ours:
uniform arms of 1.6 kg and rods of 0.18 kg, a platform of 0.5 kg with 1 kg of payload as one disc. The
universal and ball joints have none.

Units: m, kg, rad. z points up, the motor axes lie in the plane z = 0. Leg i stands at 0, 120 and 240 degrees;
at 0 its arm points outward, and a positive angle lowers it. Each forearm is two rods, a and b, on universal
joints (two revolutes: about the motor's axis, then sideways) with balls at the platform; at 0 they hang down.
A URDF is a tree: rod 1a carries the platform on a ball of three revolutes, the other five rods are closed
on it in delta.yaml. Of a level platform the middle one leans as the rod does, and is at a right angle, where
three revolutes lose a freedom, only with the parallelogram flat. Nothing but the six rods keeps the platform
level.
-->
<robot name="delta">
  <material name="frame"><color rgba="0.25 0.27 0.30 1"/></material>
  <material name="arm"><color rgba="0.84 0.37 0.10 1"/></material>
  <material name="rod"><color rgba="0.12 0.47 0.71 1"/></material>
  <material name="steel"><color rgba="0.75 0.76 0.78 1"/></material>
  <material name="payload"><color rgba="0.93 0.72 0.13 1"/></material>
"""


def files() -> dict[str, str]:
    """The text of each file that is kept, by its place below urdf/."""
    return {"delta/delta.urdf": urdf()}


def urdf() -> str:
    """The text of the URDF."""
    parts = _base()
    for leg in (1, 2, 3):
        parts += _leg(leg)
    return document(HEADER, [*parts, *_platform()])


def _base() -> list[Element | str]:
    """A plate below the motors, small enough for the forearms to pass beside it, and three housings."""
    housings = [
        shape(cylinder(0.035, 0.09), origin((*_outward(leg, BASE), 0.0), (-np.pi / 2, 0, _yaw(leg))), "frame")
        for leg in (1, 2, 3)
    ]
    return ["", link("base", shape(cylinder(0.14, 0.02), origin((0, 0, -0.05)), "frame"), *housings), ""]


def _leg(leg: int) -> list[Element | str]:
    place = origin((*_outward(leg, BASE), 0.0), (0, 0, _yaw(leg)))
    parts: list[Element | str] = [
        f"  <!-- Leg {leg}. -->",
        joint(f"motor_{leg}", "revolute", "base", f"arm_{leg}", place, "0 1 0", (-1.6, 4.2, 500, 20)),
        link(
            f"arm_{leg}",
            solid_cylinder(ARM_MASS, ARM_RADIUS, ARM, "x", (0.5 * ARM, 0, 0)),
            shape(cylinder(ARM_RADIUS, ARM), origin((0.5 * ARM, 0, 0), (0, np.pi / 2, 0)), "arm"),
            shape(cylinder(0.5 * ARM_RADIUS, WIDTH), origin((ARM, 0, 0), (np.pi / 2, 0, 0)), "steel"),
        ),
    ]
    for rod, side in (("a", 0.5), ("b", -0.5)):
        parts += _rod(leg, f"{leg}{rod}", side * WIDTH)
    return [*parts, ""]


def _rod(leg: int, name: str, y: float) -> list[Element]:
    """One rod of the forearm on its universal joint, at y on the arm's end, with the frame at its tip."""
    middle = (0, 0, -0.5 * ROD)
    return [
        _passive(f"swing_{name}", f"arm_{leg}", f"cross_{name}", "0 1 0", (ARM, y, 0), SWING),
        link(f"cross_{name}", shape(sphere("0.018"), origin(), "steel")),
        _passive(f"lean_{name}", f"cross_{name}", f"rod_{name}", "1 0 0"),
        link(
            f"rod_{name}",
            solid_cylinder(ROD_MASS, ROD_RADIUS, ROD, "z", middle),
            shape(cylinder(ROD_RADIUS, ROD), origin(middle), "rod"),
        ),
        joint(f"end_{name}", "fixed", f"rod_{name}", f"tip_{name}", origin((0, 0, -ROD))),
        link(f"tip_{name}", shape(sphere("0.015"), origin(), "steel")),
    ]


def _platform() -> list[Element | str]:
    """The ball of rod 1a, the platform on it, and the places of the other balls."""
    centre = origin((-PLATFORM, -0.5 * WIDTH, 0))
    parts: list[Element | str] = [
        "  <!-- The platform, on the ball of rod 1a. -->",
        _passive("ball_z", "tip_1a", "ball_1", "0 0 1"),
        link("ball_1"),
        _passive("ball_x", "ball_1", "ball_2", "1 0 0"),
        link("ball_2"),
        _passive("ball_y", "ball_2", "platform_1a", "0 1 0"),
        link("platform_1a"),
        joint("platform_centre", "fixed", "platform_1a", "platform", centre),
        link(
            "platform",
            solid_cylinder(PLATFORM_MASS, PLATE_RADIUS, PLATE, "z"),
            shape(cylinder(PLATE_RADIUS, PLATE), origin(), "steel"),
            shape(cylinder(0.03, 0.08), origin((0, 0, -0.05)), "payload"),
        ),
    ]
    for name in ("1b", "2a", "2b", "3a", "3b"):
        leg, side = int(name[0]), 0.5 if name[1] == "a" else -0.5
        place = _outward(leg, PLATFORM) + side * WIDTH * np.array([-1, 1]) * _outward(leg, 1.0)[::-1]
        parts += fixed(f"platform_ball_{name}", "platform", f"platform_{name}", (*place, 0.0))
    return parts


def _yaw(leg: int) -> float:
    """Direction of a leg [rad]."""
    return (0.0, 2 * np.pi / 3, -2 * np.pi / 3)[leg - 1]


def _outward(leg: int, radius: float) -> Array:
    """The point (x, y) of a leg's plane at this distance from the centre [m]."""
    return radius * np.array([np.cos(_yaw(leg)), np.sin(_yaw(leg))])


def _passive(
    name: str, parent: str, child: str, axis: str, xyz: Value = ZERO, limit: Limit = (-3.2, 3.2, 0, 30)
) -> Element:
    """A revolute joint without a motor."""
    return joint(name, "revolute", parent, child, origin(xyz), axis, limit)
