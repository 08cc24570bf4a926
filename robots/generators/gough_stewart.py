"""Writes urdf/gough_stewart/gough_stewart.urdf: six equal legs, one of which carries the platform.

    python -m robots.generators.gough_stewart

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

from framework.arrays import Array
from robots.files import URDF

FILE = URDF / "gough_stewart" / "gough_stewart.urdf"
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


def urdf() -> str:
    """The text of the URDF."""
    part = 0.75 * home_length()
    lines = [HEADER, *_base()]
    for i in LEGS:
        lines += _leg(i, part)
    lines += _platform()
    return "\n".join([*lines, "</robot>", ""])


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


def _base() -> list[str]:
    lines = ['  <link name="base">']
    lines += _shape(f"0 0 {-0.5 * THICKNESS - TUBE!r}", _cylinder(BASE_RADIUS + 2 * TUBE, THICKNESS), "frame")
    return [*lines, "  </link>", ""]


def _leg(i: int, part: float) -> list[str]:
    """Universal joint, tube, rod and tip of leg i; both parts are `part` [m] long."""
    foot = base_joints()[i - 1]
    place = _origin(foot, home_axes(i))
    tube_mass, tube_inertia = _hollow_cylinder(part, TUBE, BORE)
    rod_mass, rod_inertia = _hollow_cylinder(part, BORE, 0.0)
    return [
        f"  <!-- Leg {i}. -->",
        *_joint(f"leg_{i}_swing", "revolute", "base", f"leg_{i}_cross", place, "1 0 0"),
        f'  <link name="leg_{i}_cross">',
        *_shape("0 0 0", f'<sphere radius="{1.5 * TUBE!r}"/>', "joint"),
        "  </link>",
        *_joint(f"leg_{i}_tilt", "revolute", f"leg_{i}_cross", f"leg_{i}_tube", _origin(), "0 1 0"),
        f'  <link name="leg_{i}_tube">',
        *_inertial(0.5 * part, tube_mass, tube_inertia),
        *_shape(f"0 0 {0.5 * part!r}", _cylinder(TUBE, part), "tube"),
        "  </link>",
        *_joint(
            f"leg_{i}_motor",
            "prismatic",
            f"leg_{i}_tube",
            f"leg_{i}_rod",
            _origin(),
            "0 0 1",
            f'lower="{part!r}" upper="{2 * part!r}" effort="1e6" velocity="10"',
        ),
        f'  <link name="leg_{i}_rod">',
        *_inertial(-0.5 * part, rod_mass, rod_inertia),
        *_shape(f"0 0 {-0.5 * part!r}", _cylinder(BORE, part), "rod"),
        "  </link>",
        *_joint(f"leg_{i}_end", "fixed", f"leg_{i}_rod", f"leg_{i}_tip", _origin()),
        f'  <link name="leg_{i}_tip">',
        *_shape("0 0 0", f'<sphere radius="{TUBE!r}"/>', "joint"),
        "  </link>",
        "",
    ]


def _platform() -> list[str]:
    """The ball of leg 1, the platform on it, and the places of the other balls."""
    joints = platform_joints()
    mass = DENSITY * np.pi * PLATFORM_RADIUS**2 * THICKNESS
    across, along = (
        mass * (3 * PLATFORM_RADIUS**2 + THICKNESS**2) / 12,
        mass * PLATFORM_RADIUS**2 / 2,
    )
    level = _origin(np.zeros(3), home_axes(1).T)
    lines = [
        "  <!-- The platform, on the ball of leg 1. -->",
        *_joint("ball_x", "revolute", "leg_1_tip", "ball_1", level, "1 0 0"),
        '  <link name="ball_1"/>',
        *_joint("ball_y", "revolute", "ball_1", "ball_2", _origin(), "0 1 0"),
        '  <link name="ball_2"/>',
        *_joint("ball_z", "revolute", "ball_2", "platform_1", _origin(), "0 0 1"),
        '  <link name="platform_1"/>',
        *_joint("platform_centre", "fixed", "platform_1", "platform", _origin(-joints[0])),
        '  <link name="platform">',
        *_inertial(0.0, mass, (across, across, along)),
        *_shape("0 0 0", _cylinder(PLATFORM_RADIUS, THICKNESS), "platform"),
        "  </link>",
    ]
    for i in LEGS[1:]:
        lines += _joint(f"platform_joint_{i}", "fixed", "platform", f"platform_{i}", _origin(joints[i - 1]))
        lines += [f'  <link name="platform_{i}"/>']
    return lines


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


def _joint(
    name: str, kind: str, parent: str, child: str, origin: str, axis: str = "", limit: str = ""
) -> list[str]:
    lines = [
        f'  <joint name="{name}" type="{kind}">',
        f'    <parent link="{parent}"/>',
        f'    <child link="{child}"/>',
        f"    {origin}",
    ]
    if axis:
        limit = limit or 'lower="-3.2" upper="3.2" effort="0" velocity="20"'
        lines += [f'    <axis xyz="{axis}"/>', f"    <limit {limit}/>"]
    return [*lines, "  </joint>"]


def _origin(xyz: Array | None = None, axes: Array | None = None) -> str:
    """An <origin> with the axes, as columns, in fixed-axis roll, pitch and yaw."""
    xyz = np.zeros(3) if xyz is None else xyz
    R = np.eye(3) if axes is None else axes
    rpy = (
        np.arctan2(R[2, 1], R[2, 2]),
        np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0])),
        np.arctan2(R[1, 0], R[0, 0]),
    )
    return f'<origin xyz="{_numbers(xyz)}" rpy="{_numbers(rpy)}"/>'


def _inertial(z: float, mass: float, moments: tuple[float, float, float]) -> list[str]:
    ixx, iyy, izz = (_number(value) for value in moments)
    return [
        "    <inertial>",
        f'      <origin xyz="0 0 {_number(z)}" rpy="0 0 0"/>',
        f'      <mass value="{_number(mass)}"/>',
        f'      <inertia ixx="{ixx}" ixy="0" ixz="0" iyy="{iyy}" iyz="0" izz="{izz}"/>',
        "    </inertial>",
    ]


def _shape(xyz: str, geometry: str, material: str) -> list[str]:
    """The same primitive to look at and to collide with."""
    place = f'      <origin xyz="{xyz}" rpy="0 0 0"/>'
    body = [place, f"      <geometry>{geometry}</geometry>"]
    seen = ["    <visual>", *body, f'      <material name="{material}"/>', "    </visual>"]
    return [*seen, "    <collision>", *body, "    </collision>"]


def _cylinder(radius: float, length: float) -> str:
    return f'<cylinder radius="{_number(radius)}" length="{_number(length)}"/>'


def _numbers(values: Array | tuple[float, ...]) -> str:
    return " ".join(_number(value) for value in np.asarray(values, dtype=float))


def _number(value: float) -> str:
    """To 15 digits, so that the last one does not depend on the machine's sine."""
    return f"{round(float(value), 15) + 0.0:.15g}"


if __name__ == "__main__":
    FILE.write_text(urdf(), encoding="utf-8")
