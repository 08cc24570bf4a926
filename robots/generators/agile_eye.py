"""Writes the URDF of two spherical 3-RRR robots, agile_eye and spherical_rrr: the same but for an arc.

    python -m robots.generators.agile_eye

Source of the geometry: C. M. Gosselin and J.-F. Hamel, "The Agile Eye: a high-performance
three-degree-of-freedom camera-orienting device", ICRA 1994: all pairs of adjacent axes are orthogonal. The
axes at the reference are those of I. A. Bonev, D. Chablat and P. Wenger, "Working and Assembly Modes of the
Agile Eye", ICRA 2006. In spherical_rrr the arcs at the motors span 60 degrees. Radii and masses are ours.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path

import numpy as np

from framework.arrays import Array
from robots.files import URDF

PROXIMAL = {"agile_eye": 90.0, "spherical_rrr": 60.0}  # arc from the motor's axis to the elbow's [degrees]
DISTAL = 90.0  # arc from the elbow's axis to the wrist's [degrees]
PROXIMAL_RADIUS, DISTAL_RADIUS, BAR = 0.14, 0.12, 0.006  # of the two arcs, of their bars [m]
PROXIMAL_MASS, DISTAL_MASS = 0.25, 0.2  # [kg]
CAMERA_MASS, CAMERA_RADIUS, CAMERA_LENGTH, CAMERA_OFFSET = 1.2, 0.03, 0.08, 0.02  # [kg], [m]
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


def file(name: str) -> Path:
    """Where the URDF of this robot is kept."""
    return URDF / name / f"{name}.urdf"


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
    lines = [HEADER.format(name=name, what=what, arc=arc), '  <link name="base">']
    for leg in (1, 2, 3):
        axis = base_axes(leg)
        lines += _shape(_cylinder(0.02, 0.06), "frame", 0.2 * axis[:, 2], axis)
    lines += ["  </link>", ""]
    for leg in (1, 2, 3):
        lines += _leg(leg, np.deg2rad(arc))
    lines += _platform()
    return "\n".join([*lines, "</robot>", ""])


def _leg(leg: int, arc: float) -> list[str]:
    limit = 'lower="-6.28" upper="6.28" effort="50" velocity="30"'
    motor = _joint(f"motor_{leg}", "base", f"proximal_{leg}", base_axes(leg), limit)
    elbow = _joint(f"elbow_{leg}", f"proximal_{leg}", f"distal_{leg}", _about_x(arc))
    end = _joint(f"distal_{leg}_end", f"distal_{leg}", f"tip_{leg}", _about_x(np.deg2rad(DISTAL)), "")
    return [
        f"  <!-- Leg {leg}: motor, proximal arc, elbow, distal arc, and the frame of its wrist. -->",
        *motor,
        *_arc(f"proximal_{leg}", "proximal", arc, PROXIMAL_RADIUS, PROXIMAL_MASS),
        *elbow,
        *_arc(f"distal_{leg}", "distal", np.deg2rad(DISTAL), DISTAL_RADIUS, DISTAL_MASS),
        *end,
        f'  <link name="tip_{leg}">',
        *_shape(_cylinder(0.01, 0.03), "steel", np.array([0, 0, DISTAL_RADIUS - 0.01])),
        "  </link>",
        "",
    ]


def _arc(name: str, material: str, angle: float, radius: float, mass: float) -> list[str]:
    """A link of straight bars from z towards -y, with a pin at its end."""
    corners = [_about_x(a) @ [0, 0, radius] for a in np.linspace(0, angle, PARTS + 1)]
    centres = [(a + b) / 2 for a, b in pairwise(corners)]
    middle = np.sum(centres, axis=0) / PARTS
    inertia, shapes = np.zeros((3, 3)), []
    for k, centre in enumerate(centres):
        bar = corners[k + 1] - corners[k]
        length, axes = float(np.linalg.norm(bar)), _about_x((k + 0.5) * angle / PARTS + np.pi / 2)
        moments = _moments(mass / PARTS, BAR, length)
        away = centre - middle
        inertia += axes @ np.diag(moments) @ axes.T
        inertia += mass / PARTS * (away @ away * np.eye(3) - np.outer(away, away))
        shapes += _shape(_cylinder(BAR, length), material, centre, axes)
    pin = _shape(_cylinder(0.008, 0.03), "steel", corners[-1], _about_x(angle))
    return [f'  <link name="{name}">', *_inertial(middle, mass, inertia), *shapes, *pin, "  </link>"]


def _platform() -> list[str]:
    """The camera on the wrist of leg 1; it looks along (1, 1, 1) of the platform's frame."""
    x, y, z = np.array([1, -1, 0]) / np.sqrt(2), np.array([1, 1, -2]) / np.sqrt(6), np.ones(3) / np.sqrt(3)
    looks = np.column_stack([x, y, z])
    centre = CAMERA_OFFSET * z
    moments = _moments(CAMERA_MASS, CAMERA_RADIUS, CAMERA_LENGTH)
    lines = [
        "  <!-- The platform, on the wrist of leg 1. -->",
        *_joint("wrist_1", "tip_1", "platform_1", np.eye(3)),
        '  <link name="platform_1"/>',
        *_joint("platform_frame", "platform_1", "platform", platform_axes(1).T, ""),
        '  <link name="platform">',
        *_inertial(centre, CAMERA_MASS, looks @ np.diag(moments) @ looks.T),
        *_shape(_cylinder(CAMERA_RADIUS, CAMERA_LENGTH), "camera", centre, looks),
    ]
    for leg in (1, 2, 3):
        wrist = platform_axes(leg)
        lines += _shape(_cylinder(0.006, 0.08), "steel", 0.06 * wrist[:, 2], wrist)
    lines += ["  </link>"]
    for leg in (2, 3):
        lines += _joint(f"platform_wrist_{leg}", "platform", f"platform_{leg}", platform_axes(leg), "")
        lines += [f'  <link name="platform_{leg}"/>']
    return lines


def _about_x(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def _moments(mass: float, radius: float, length: float) -> tuple[float, float, float]:
    """Of a cylinder along z about its centre [kg m^2]."""
    across = mass * (3 * radius**2 + length**2) / 12
    return across, across, mass * radius**2 / 2


def _joint(
    name: str,
    parent: str,
    child: str,
    axes: Array,
    limit: str = 'lower="-6.28" upper="6.28" effort="0" velocity="30"',
) -> list[str]:
    """A revolute joint about z, or a fixed one without a limit."""
    lines = [
        f'  <joint name="{name}" type="{"revolute" if limit else "fixed"}">',
        f'    <parent link="{parent}"/>',
        f'    <child link="{child}"/>',
        f"    {_origin(np.zeros(3), axes)}",
    ]
    if limit:
        lines += ['    <axis xyz="0 0 1"/>', f"    <limit {limit}/>"]
    return [*lines, "  </joint>"]


def _origin(xyz: Array, axes: Array) -> str:
    """An <origin> with the axes, as columns, in fixed-axis roll, pitch and yaw."""
    if np.hypot(axes[0, 0], axes[1, 0]) > 1e-9:
        pitch = np.arcsin(np.clip(-axes[2, 0], -1, 1))
        rpy = (np.arctan2(axes[2, 1], axes[2, 2]), pitch, np.arctan2(axes[1, 0], axes[0, 0]))
    else:  # x points up or down: roll and yaw turn about the same line
        up = -np.sign(axes[2, 0])
        rpy = (np.arctan2(up * axes[0, 1], axes[1, 1]), up * np.pi / 2, 0.0)
    return f'<origin xyz="{_numbers(xyz)}" rpy="{_numbers(rpy)}"/>'


def _inertial(xyz: Array, mass: float, inertia: Array) -> list[str]:
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    values = inertia[np.triu_indices(3)]
    entries = " ".join(f'{n}="{_numbers([v])}"' for n, v in zip(names, values, strict=True))
    return [
        "    <inertial>",
        f'      <origin xyz="{_numbers(xyz)}" rpy="0 0 0"/>',
        f'      <mass value="{_numbers([mass])}"/>',
        f"      <inertia {entries}/>",
        "    </inertial>",
    ]


def _shape(geometry: str, material: str, xyz: Array, axes: Array | None = None) -> list[str]:
    """The same primitive to look at and to collide with."""
    place = _origin(xyz, np.eye(3) if axes is None else axes)
    body = [f"      {place}", f"      <geometry>{geometry}</geometry>"]
    seen = ["    <visual>", *body, f'      <material name="{material}"/>', "    </visual>"]
    return [*seen, "    <collision>", *body, "    </collision>"]


def _cylinder(radius: float, length: float) -> str:
    return f'<cylinder radius="{_numbers([radius])}" length="{_numbers([length])}"/>'


def _numbers(values: Iterable[float]) -> str:
    """To 15 decimals, so that the last digit does not depend on the machine's sine."""
    return " ".join(f"{round(float(value), 15) + 0.0:.15g}" for value in values)


if __name__ == "__main__":
    for robot in PROXIMAL:
        file(robot).write_text(urdf(robot), encoding="utf-8")
