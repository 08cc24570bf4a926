"""Writes the URDF of two spherical 3-RRR robots, agile_eye and spherical_rrr: the same but for an arc.

Source of the geometry: C. M. Gosselin and J.-F. Hamel, "The Agile Eye: a high-performance
three-degree-of-freedom camera-orienting device", ICRA 1994: all pairs of adjacent axes are orthogonal. The
axes at the reference are those of I. A. Bonev, D. Chablat and P. Wenger, "Working and Assembly Modes of the
Agile Eye", ICRA 2006. In spherical_rrr the arcs at the motors span 60 degrees. Radii and masses are ours.
"""

from __future__ import annotations

from itertools import pairwise, permutations

import numpy as np

from framework.numerics.arrays import Array
from robots.generators.elements import (
    ZERO,
    Element,
    cylinder,
    cylinder_moments,
    document,
    inertial,
    joint,
    link,
    oriented,
    origin,
    shape,
)

PROXIMAL = {"agile_eye": 90.0, "spherical_rrr": 60.0}  # arc from the motor's axis to the elbow's [degrees]
DISTAL = 90.0  # arc from the elbow's axis to the wrist's [degrees]
PROXIMAL_RADIUS, DISTAL_RADIUS, BAR = 0.14, 0.12, 0.006  # of the two arcs, of their bars [m]
PROXIMAL_MASS, DISTAL_MASS = 0.25, 0.2  # [kg]
CAMERA_MASS, CAMERA_RADIUS, CAMERA_LENGTH, CAMERA_OFFSET = 1.2, 0.03, 0.08, 0.02  # [kg], [m]
BASE = 0.22  # from the centre to the beams of the base [m]
PARTS = 3  # straight bars that make one arc

HEADER = """<?xml version="1.0"?>
<!--
Spherical 3-RRR robot: {what}.
Written by robots/generators/agile_eye.py: change that, not this.

Source of the geometry: C. M. Gosselin and J.-F. Hamel, "The Agile Eye: a high-performance
three-degree-of-freedom camera-orienting device", ICRA 1994; axes at the reference as in I. A. Bonev, D.
Chablat and P. Wenger, "Working and Assembly Modes of the Agile Eye", ICRA 2006. Radii and masses are ours:
arcs of three straight bars each, a camera of 1.2 kg as a cylinder, its centre 20 mm before the point that
it turns about.

Units: m, kg, rad. The motors turn about x, y and z; the axes of all joints, all along z of their frames,
meet in the origin, and every joint frame stands there: the bearings, on spheres about it, are shapes only.
From a motor's axis to its elbow's is an arc of {arc:g} degrees, from there to the wrist's one of 90
degrees, both about x of the link. A URDF is a tree: leg 1 carries the platform, legs 2 and 3 are closed on
it in {name}.yaml.
-->
<robot name="{name}">
  <material name="frame"><color rgba="0.25 0.27 0.30 1"/></material>
  <material name="proximal"><color rgba="0.12 0.47 0.71 1"/></material>
  <material name="distal"><color rgba="0.84 0.37 0.10 1"/></material>
  <material name="steel"><color rgba="0.75 0.76 0.78 1"/></material>
  <material name="camera"><color rgba="0.93 0.72 0.13 1"/></material>
"""


def files() -> dict[str, str]:
    """The text of each file that is kept, by its place below urdf/."""
    return {f"{name}/{name}.urdf": urdf(name) for name in PROXIMAL}


def base_axes(leg: int) -> Array:
    """Frame of a motor as columns (3, 3): z is its axis."""
    return np.roll(np.eye(3), leg, axis=0)


def platform_axes(leg: int) -> Array:
    """Frame of a wrist in the platform's frame as columns (3, 3): z is its axis."""
    return np.roll(np.eye(3), leg - 1, axis=0) * [1.0, -1.0, -1.0]


def urdf(name: str) -> str:
    """The text of the URDF."""
    arc = PROXIMAL[name]
    what = "the Agile Eye" if arc == 90.0 else "an Agile Eye with shorter arcs at the motors"
    motors = [
        shape(cylinder(0.02, 0.06), oriented(0.2 * axis[:, 2], axis), "frame")
        for axis in map(base_axes, (1, 2, 3))
    ]
    # edges of a cube that carry the motors, out of the way of the arcs
    frame = [
        shape(cylinder(0.009, BASE + 0.018), oriented(BASE * (one[:, 2] + 0.5 * other[:, 2]), other), "frame")
        for one, other in permutations(map(base_axes, (1, 2, 3)), 2)
    ]
    parts: list[Element | str] = ["", link("base", *motors, *frame), ""]
    for leg in (1, 2, 3):
        parts += _leg(leg, np.deg2rad(arc))
    return document(HEADER.format(name=name, what=what, arc=arc), [*parts, *_platform()])


def _leg(leg: int, arc: float) -> list[Element | str]:
    distal = np.deg2rad(DISTAL)
    tip = origin((0, 0, DISTAL_RADIUS - 0.01))
    return [
        f"  <!-- Leg {leg}: motor, proximal arc, elbow, distal arc, and the frame of its wrist. -->",
        _turning(f"motor_{leg}", "base", f"proximal_{leg}", base_axes(leg), effort=50),
        _arc(f"proximal_{leg}", "proximal", arc, PROXIMAL_RADIUS, PROXIMAL_MASS),
        _turning(f"elbow_{leg}", f"proximal_{leg}", f"distal_{leg}", _about_x(arc)),
        _arc(f"distal_{leg}", "distal", distal, DISTAL_RADIUS, DISTAL_MASS),
        joint(f"distal_{leg}_end", "fixed", f"distal_{leg}", f"tip_{leg}", oriented(ZERO, _about_x(distal))),
        link(f"tip_{leg}", shape(cylinder(0.01, 0.03), tip, "steel")),
        "",
    ]


def _arc(name: str, material: str, angle: float, radius: float, mass: float) -> Element:
    """A link of straight bars from z towards -y, with a pin at its end."""
    corners = [_about_x(a) @ [0, 0, radius] for a in np.linspace(0, angle, PARTS + 1)]
    centres = [(a + b) / 2 for a, b in pairwise(corners)]
    middle = np.sum(centres, axis=0) / PARTS
    inertia, shapes = np.zeros((3, 3)), []
    for k, centre in enumerate(centres):
        bar = corners[k + 1] - corners[k]
        length, axes = float(np.linalg.norm(bar)), _about_x((k + 0.5) * angle / PARTS + np.pi / 2)
        moments = cylinder_moments(mass / PARTS, BAR, length, "z")
        away = centre - middle
        inertia += axes @ np.diag(moments) @ axes.T
        inertia += mass / PARTS * (away @ away * np.eye(3) - np.outer(away, away))
        shapes.append(shape(cylinder(BAR, length), oriented(centre, axes), material))
    pin = shape(cylinder(0.008, 0.03), oriented(corners[-1], _about_x(angle)), "steel")
    return link(name, inertial(mass, middle, inertia), *shapes, pin)


def _platform() -> list[Element | str]:
    """The camera on the wrist of leg 1; it looks along (1, 1, 1) of the platform's frame."""
    x, y, z = np.array([1, -1, 0]) / np.sqrt(2), np.array([1, 1, -2]) / np.sqrt(6), np.ones(3) / np.sqrt(3)
    looks = np.column_stack([x, y, z])
    centre = CAMERA_OFFSET * z
    moments = cylinder_moments(CAMERA_MASS, CAMERA_RADIUS, CAMERA_LENGTH, "z")
    pins = [
        shape(cylinder(0.006, 0.08), oriented(0.06 * wrist[:, 2], wrist), "steel")
        for wrist in map(platform_axes, (1, 2, 3))
    ]
    parts: list[Element | str] = [
        "  <!-- The platform, on the wrist of leg 1. -->",
        _turning("wrist_1", "tip_1", "platform_1", np.eye(3)),
        link("platform_1"),
        joint("platform_frame", "fixed", "platform_1", "platform", oriented(ZERO, platform_axes(1).T)),
        link(
            "platform",
            inertial(CAMERA_MASS, centre, looks @ np.diag(moments) @ looks.T),
            shape(cylinder(CAMERA_RADIUS, CAMERA_LENGTH), oriented(centre, looks), "camera"),
            *pins,
        ),
    ]
    for leg in (2, 3):
        place = oriented(ZERO, platform_axes(leg))
        parts += [joint(f"platform_wrist_{leg}", "fixed", "platform", f"platform_{leg}", place)]
        parts += [link(f"platform_{leg}")]
    return parts


def _about_x(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def _turning(name: str, parent: str, child: str, axes: Array, effort: float = 0) -> Element:
    """A revolute joint about z of these axes."""
    limit = (-6.28, 6.28, effort, 30)
    return joint(name, "revolute", parent, child, oriented(ZERO, axes), "0 0 1", limit)
