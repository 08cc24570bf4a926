"""Writes urdf/gough_stewart/gough_stewart.urdf: six equal legs, one of which carries the platform.

Source of all dimensions: The MathWorks, Stewart platform example of SimMechanics, 1998-2003 (the variant of
its control design case study, mech_stewart_control_setup.m): base radius 3 m, joints in pairs 2.5 degrees
beside 0, 120 and 240 degrees; platform radius 1 m, joints 10 degrees beside 60, 180 and 300 degrees, 2 m
above the base at home; both parts of a leg three quarters of its length at home, a tube of 50 and 30 mm
radius and a rod of 30 mm; platform 50 mm thick; steel of 76e3 N/m^3. There a leg has a universal joint at
both ends and a cylindrical one between; here a ball at its tip takes the place of the second and of the
turn of the rod in the tube.
"""

from __future__ import annotations

import numpy as np

from framework.numerics.arrays import Array
from robots.generators.elements import (
    ZERO,
    Element,
    cylinder,
    document,
    fixed,
    inertial,
    joint,
    link,
    oriented,
    origin,
    shape,
    solid_cylinder,
    sphere,
)

LEGS = range(1, 7)
BASE_RADIUS, PLATFORM_RADIUS, HOME_HEIGHT = 3.0, 1.0, 2.0  # [m]
TUBE, BORE, THICKNESS = 0.05, 0.03, 0.05  # radii of the leg's tube and rod, platform [m]
DENSITY = 76e3 / 9.81  # [kg/m^3]


def base_joints() -> Array:
    """Centres of the universal joints in the base frame (6, 3) [m]."""
    return _ring(BASE_RADIUS, [-2.5, 2.5, 117.5, 122.5, 237.5, 242.5])


def platform_joints() -> Array:
    """Centres of the ball joints in the platform frame (6, 3) [m]."""
    return _ring(PLATFORM_RADIUS, [-50.0, 50.0, 70.0, 170.0, 190.0, 290.0])


def _ring(radius: float, degrees: list[float]) -> Array:
    angle = np.deg2rad(degrees)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0.0 * angle])


def home_length() -> float:
    """Length of every leg at home [m]."""
    return float(np.linalg.norm(platform_joints()[0] + [0, 0, HOME_HEIGHT] - base_joints()[0]))


HEADER = """<?xml version="1.0"?>
<!--
Gough-Stewart platform, 6-UPS. Written by robots/generators/gough_stewart.py: change that, not this.

Source of all dimensions and masses: The MathWorks, Stewart platform example of SimMechanics, 1998-2003.
The masses are those of solid steel; universal and ball joints have none. The balls at the tips are ours, for
a universal joint and a rod that turns in its tube.

Units: m, kg, rad. Each leg is a universal joint on the base (two revolutes), a prismatic joint whose
coordinate is the length of the leg, and a ball at its tip. A URDF is a tree: leg 1 carries the platform on a
ball of three revolutes, the other five are closed on it in gough_stewart.yaml. With all passive joints
at 0 the platform is at home, 2 m above the base, axes parallel.
-->
<robot name="gough_stewart">
  <material name="frame"><color rgba="0.25 0.27 0.30 1"/></material>
  <material name="tube"><color rgba="0.12 0.47 0.71 1"/></material>
  <material name="rod"><color rgba="0.75 0.76 0.78 1"/></material>
  <material name="joint"><color rgba="0.84 0.37 0.10 1"/></material>
  <material name="platform"><color rgba="0.93 0.72 0.13 1"/></material>
"""


def files() -> dict[str, str]:
    """The text of each file that is kept, by its place below urdf/."""
    return {"gough_stewart/gough_stewart.urdf": urdf()}


def urdf() -> str:
    """The text of the URDF."""
    part = 0.75 * home_length()
    floor = origin(_along_z(-0.5 * THICKNESS - TUBE))
    base = link("base", shape(cylinder(BASE_RADIUS + 2 * TUBE, THICKNESS), floor, "frame"))
    parts: list[Element | str] = ["", base, ""]
    for i in LEGS:
        parts += _leg(i, part)
    return document(HEADER, [*parts, *_platform()])


def _leg(i: int, part: float) -> list[Element | str]:
    """Universal joint, tube, rod and tip of leg i; both parts are `part` [m] long."""
    foot = oriented(base_joints()[i - 1], home_axes(i))
    tube_mass, tube_moments = _hollow_cylinder(part, TUBE, BORE)
    rod_mass, rod_moments = _hollow_cylinder(part, BORE, 0.0)
    stroke = (repr(part), repr(2 * part), "1e6", 10)
    tube, rod, tip = f"leg_{i}_tube", f"leg_{i}_rod", f"leg_{i}_tip"
    return [
        f"  <!-- Leg {i}. -->",
        _passive(f"leg_{i}_swing", "base", f"leg_{i}_cross", "1 0 0", foot),
        link(f"leg_{i}_cross", shape(sphere(repr(1.5 * TUBE)), origin(), "joint")),
        _passive(f"leg_{i}_tilt", f"leg_{i}_cross", tube, "0 1 0"),
        link(
            tube,
            inertial(tube_mass, (0, 0, 0.5 * part), tube_moments),
            shape(cylinder(TUBE, part), origin(_along_z(0.5 * part), "0 0 0"), "tube"),
        ),
        joint(f"leg_{i}_motor", "prismatic", tube, rod, origin(), "0 0 1", stroke),
        link(
            rod,
            inertial(rod_mass, (0, 0, -0.5 * part), rod_moments),
            shape(cylinder(BORE, part), origin(_along_z(-0.5 * part), "0 0 0"), "rod"),
        ),
        joint(f"leg_{i}_end", "fixed", rod, tip),
        link(tip, shape(sphere(repr(TUBE)), origin(), "joint")),
        "",
    ]


def _platform() -> list[Element | str]:
    """The ball of leg 1, the platform on it, and the places of the other balls."""
    joints = platform_joints()
    mass = DENSITY * np.pi * PLATFORM_RADIUS**2 * THICKNESS
    parts: list[Element | str] = [
        "  <!-- The platform, on the ball of leg 1. -->",
        _passive("ball_x", "leg_1_tip", "ball_1", "1 0 0", oriented(ZERO, home_axes(1).T)),
        link("ball_1"),
        _passive("ball_y", "ball_1", "ball_2", "0 1 0"),
        link("ball_2"),
        _passive("ball_z", "ball_2", "platform_1", "0 0 1"),
        link("platform_1"),
        joint("platform_centre", "fixed", "platform_1", "platform", origin(-joints[0])),
        link(
            "platform",
            solid_cylinder(mass, PLATFORM_RADIUS, THICKNESS, "z"),
            shape(cylinder(PLATFORM_RADIUS, THICKNESS), origin(), "platform"),
        ),
    ]
    for i in LEGS[1:]:
        parts += fixed(f"platform_joint_{i}", "platform", f"platform_{i}", joints[i - 1])
    return parts


def home_axes(i: int) -> Array:
    """Axes of leg i at home as columns (3, 3): across and level, across, along the leg."""
    leg = platform_joints()[i - 1] + [0, 0, HOME_HEIGHT] - base_joints()[i - 1]
    z = leg / np.linalg.norm(leg)
    x = np.array([z[1], -z[0], 0.0]) / np.hypot(z[0], z[1])
    return np.column_stack([x, np.array([-z[2] * x[1], z[2] * x[0], z[0] * x[1] - z[1] * x[0]]), z])


def _hollow_cylinder(length: float, outer: float, inner: float) -> tuple[float, tuple[float, float, float]]:
    """Mass [kg] and moments of inertia about its centre [kg m^2], z along it."""
    mass = DENSITY * np.pi * (outer**2 - inner**2) * length
    across = mass * (3 * (outer**2 + inner**2) + length**2) / 12
    return mass, (across, across, mass * (outer**2 + inner**2) / 2)


def _passive(name: str, parent: str, child: str, axis: str, place: Element | None = None) -> Element:
    """A revolute joint without a motor."""
    return joint(name, "revolute", parent, child, place, axis, (-3.2, 3.2, 0, 20))


def _along_z(z: float) -> str:
    """A point on z, to its last digit [m]."""
    return f"0 0 {z!r}"
