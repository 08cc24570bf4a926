"""Writes the URDF of the 3-UPU robot: three equal legs, 120 degrees apart.

`python -m robots.generators.three_upu urdf/three_upu` writes the kept file.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

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


def urdf() -> str:
    """The URDF of the open tree."""
    lines = ['  <link name="base">']
    lines += _shape("0 0 -0.06", '<cylinder radius="0.34" length="0.04"/>', "frame")
    lines += ["  </link>"]
    for i in (1, 2, 3):
        lines += ["", *_leg(i, (i - 1) * 2 * math.pi / 3)]
    lines += [""]
    lines += _joint("wrist_1b", "revolute", "cross_1", "wrist_1", axis="1 0 0")
    lines += ['  <link name="wrist_1"/>', "", *_joint("mount", "fixed", "wrist_1", "platform", _shifted(0))]
    lines += [
        '  <link name="platform">',
        *_inertial("0 0 0", PLATFORM, ("0.018", "0.018", "0.036")),
        *_shape("0 0 0.05", '<cylinder radius="0.14" length="0.03"/>', "platform_colour"),
        "  </link>",
    ]
    for i in (2, 3):
        angle = (i - 1) * 2 * math.pi / 3
        place = f"{_at(PLATFORM_RADIUS, angle)}", f"0 0 {angle!r}"
        lines += [*_joint(f"anchor_{i}_mount", "fixed", "platform", f"anchor_{i}", place)]
        lines += [f'  <link name="anchor_{i}"/>']
    return _HEAD + "\n".join([*lines, "</robot>", ""])


def write(folder: Path) -> Path:
    """Write the URDF; returns it."""
    file = folder / "three_upu.urdf"
    file.write_text(urdf(), encoding="utf-8")
    return file


def _at(radius: float, angle: float) -> str:
    return f"{radius * math.cos(angle):.17g} {radius * math.sin(angle):.17g} 0"


def _shifted(angle: float) -> tuple[str, str]:
    """From the platform joint of leg 1 to the centre of the platform."""
    return f"{-PLATFORM_RADIUS!r} 0 0", f"0 0 {angle!r}"


def _leg(i: int, angle: float) -> list[str]:
    """Local axes: x radial, y tangential, z up."""
    eye = '<cylinder radius="0.02" length="0.05"/>'
    return [
        *_joint(f"hip_{i}a", "revolute", "base", f"yoke_{i}", (_at(BASE_RADIUS, angle), f"0 0 {angle!r}")),
        f'  <link name="yoke_{i}"/>',
        *_joint(f"hip_{i}b", "revolute", f"yoke_{i}", f"tube_{i}", axis="0 1 0"),
        f'  <link name="tube_{i}">',
        *_inertial(f"0 0 {TUBE_CENTRE}", TUBE, (TUBE_INERTIA[0], *TUBE_INERTIA)),
        *_shape(f"0 0 {TUBE_CENTRE + 0.02}", '<cylinder radius="0.03" length="0.26"/>', "tube"),
        *_shape("0 0 0", eye, "tube"),
        "  </link>",
        *_joint(f"slide_{i}", "prismatic", f"tube_{i}", f"rod_{i}", axis="0 0 1"),
        f'  <link name="rod_{i}">',
        *_inertial(f"0 0 {-ROD_CENTRE}", ROD, (ROD_INERTIA[0], *ROD_INERTIA)),
        *_shape(f"0 0 {-ROD_CENTRE - 0.02}", '<cylinder radius="0.015" length="0.36"/>', "rod"),
        *_shape("0 0 0", eye, "rod"),
        "  </link>",
        *_joint(f"rod_{i}_end", "fixed", f"rod_{i}", f"tip_{i}"),
        f'  <link name="tip_{i}"/>',
        *_joint(f"wrist_{i}a", "revolute", f"tip_{i}", f"cross_{i}", axis="0 1 0"),
        f'  <link name="cross_{i}"/>',
    ]


def _joint(
    name: str,
    kind: str,
    parent: str,
    child: str,
    place: tuple[str, str] = ("0 0 0", "0 0 0"),
    axis: str = "1 0 0",
) -> list[str]:
    lines = [
        f'  <joint name="{name}" type="{kind}">',
        f'    <parent link="{parent}"/>',
        f'    <child link="{child}"/>',
        f'    <origin xyz="{place[0]}" rpy="{place[1]}"/>',
    ]
    if kind == "revolute":
        lines += [f'    <axis xyz="{axis}"/>']
        lines += ['    <limit lower="-1.4" upper="1.4" effort="0" velocity="10"/>']
    if kind == "prismatic":
        lines += [f'    <axis xyz="{axis}"/>']
        lines += ['    <limit lower="0.42" upper="0.9" effort="5000" velocity="2"/>']
    return [*lines, "  </joint>"]


def _inertial(xyz: str, mass: float, inertia: tuple[str, str, str]) -> list[str]:
    xx, yy, zz = inertia
    return [
        "    <inertial>",
        f'      <origin xyz="{xyz}" rpy="0 0 0"/>',
        f'      <mass value="{mass}"/>',
        f'      <inertia ixx="{xx}" ixy="0" ixz="0" iyy="{yy}" iyz="0" izz="{zz}"/>',
        "    </inertial>",
    ]


def _shape(xyz: str, geometry: str, material: str) -> list[str]:
    """The same shape to see and to touch."""
    inner = [f'      <origin xyz="{xyz}" rpy="0 0 0"/>', f"      <geometry>{geometry}</geometry>"]
    look = [*inner, f'      <material name="{material}"/>']
    return ["    <visual>", *look, "    </visual>", "    <collision>", *inner, "    </collision>"]


if __name__ == "__main__":
    write(Path(sys.argv[1]))
