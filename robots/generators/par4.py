"""Writes urdf/par4/par4.urdf: four legs in pairs on two half plates, which two parallel bars join.

    python -m robots.generators.par4

Source of the mechanism: V. Nabat, M. Rodriguez, O. Company, S. Krut and F. Pierrot, "Par4: very high speed
parallel robot for pick-and-place", IROS 2005. Dimensions and masses are ours.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from framework.arrays import Array
from robots.files import URDF

FILE = URDF / "par4" / "par4.urdf"
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


def urdf() -> str:
    """The text of the URDF."""
    lines = [HEADER, '  <link name="base">', *_shape(_cylinder(0.16, 0.02), "frame", (0, 0, 0.06))]
    for yaw in YAW:
        lines += _shape(_cylinder(0.035, 0.08), "frame", _along(yaw, BASE), (-np.pi / 2, 0, yaw))
    lines += ["  </link>", ""]
    for leg in LEGS:
        lines += _leg(leg)
    lines += _plate()
    return "\n".join([*lines, "</robot>", ""])


def _leg(leg: int) -> list[str]:
    yaw = YAW[leg - 1]
    limit = 'lower="-1.6" upper="2.4" effort="300" velocity="30"'
    return [
        f"  <!-- Leg {leg}. -->",
        *_joint(f"motor_{leg}", "base", f"arm_{leg}", "0 1 0", _along(yaw, BASE), (0, 0, yaw), limit),
        f'  <link name="arm_{leg}">',
        *_rod_inertial(ARM_MASS, ARM_RADIUS, ARM, (0.5 * ARM, 0, 0), 0),
        *_shape(_cylinder(ARM_RADIUS, ARM), "arm", (0.5 * ARM, 0, 0), (0, np.pi / 2, 0)),
        "  </link>",
        *_joint(f"arm_{leg}_end", f"arm_{leg}", f"knee_{leg}", "", (ARM, 0, 0)),
        f'  <link name="knee_{leg}">',
        *_shape(_cylinder(0.015, 0.08), "steel", (0, 0, 0), (np.pi / 2, 0, 0)),
        "  </link>",
        *_joint(f"swing_{leg}", f"knee_{leg}", f"cross_{leg}", "0 1 0"),
        f'  <link name="cross_{leg}">',
        *_shape('<sphere radius="0.018"/>', "steel", (0, 0, 0)),
        "  </link>",
        *_joint(f"lean_{leg}", f"cross_{leg}", f"rod_{leg}", "1 0 0"),
        f'  <link name="rod_{leg}">',
        *_rod_inertial(ROD_MASS, ROD_RADIUS, ROD, (0, 0, -0.5 * ROD), 2),
        *_shape(_cylinder(ROD_RADIUS, ROD), "rod", (0, 0, -0.5 * ROD)),
        "  </link>",
        *_joint(f"rod_{leg}_end", f"rod_{leg}", f"tip_{leg}", "", (0, 0, -ROD)),
        f'  <link name="tip_{leg}">',
        *_shape('<sphere radius="0.015"/>', "steel", (0, 0, 0)),
        "  </link>",
        *(_wrist(leg) if leg in (2, 3) else []),
        "",
    ]


def _wrist(leg: int) -> list[str]:
    """The cross of a universal joint: leans on the rod, swings on the half plate."""
    name = f"wrist_{leg}"
    return [*_joint(f"wrist_lean_{leg}", f"tip_{leg}", name, "1 0 0"), f'  <link name="{name}"/>']


def _plate() -> list[str]:
    yaw = YAW[0]
    lines = [
        "  <!-- Half plate a on the wrist of leg 1, the two bars, half plate b on bar 1. -->",
        *_joint("wrist_lean_1", "tip_1", "wrist_1", "1 0 0"),
        '  <link name="wrist_1"/>',
        *_joint("wrist_swing_1", "wrist_1", "seat_1", "0 1 0"),
        '  <link name="seat_1"/>',
        *_joint("half_a", "seat_1", "a", "", _turned(-yaw, -_along(yaw, WRIST)), (0, 0, -yaw)),
        *_half("a", (1, 2)),
        *_joint("seat_a_2", "a", "seat_2", "", _along(YAW[1], WRIST), (0, 0, YAW[1])),
        '  <link name="seat_2"/>',
        *_joint("pivot_1", "a", "bar_1", "0 0 1"),
        *_bar("bar_1", 0.0),
        *_joint("tool_mount", "bar_1", "tool", "", (-0.5 * BAR, 0, 0)),
        '  <link name="tool">',
        *_rod_inertial(TOOL_MASS, TOOL_RADIUS, TOOL, (0, 0, 0), 2),
        *_shape(_cylinder(TOOL_RADIUS, TOOL), "payload", (0, 0, -0.06)),
        "  </link>",
        *_joint("pivot_2", "bar_1", "b", "0 0 1", (-BAR, 0, 0)),
        *_half("b", (3, 4)),
        *_joint("pivot_b", "b", "b_end", "", (APART, 0, 0)),
        '  <link name="b_end"/>',
    ]
    for leg in (3, 4):
        place = _along(YAW[leg - 1], WRIST)
        lines += _joint(f"seat_b_{leg}", "b", f"seat_{leg}", "", place, (0, 0, YAW[leg - 1]))
        lines += [f'  <link name="seat_{leg}"/>']
    return [
        *lines,
        *_joint("pivot_3", "a", "bar_2", "0 0 1", (APART, 0, 0)),
        *_bar("bar_2", -0.03),
        *_joint("bar_2_end", "bar_2", "bar_2_tip", "", (-BAR, 0, 0)),
        '  <link name="bar_2_tip"/>',
    ]


def _half(name: str, legs: tuple[int, int]) -> list[str]:
    """A half plate: its pivots lie along x, arms reach from the first to the wrists of its legs."""
    lines = [f'  <link name="{name}">', *_rod_inertial(HALF_MASS, HALF_RADIUS, APART, (0.5 * APART, 0, 0), 0)]
    lines += _shape(_cylinder(0.01, APART), "steel", (0.5 * APART, 0, 0.015), (0, np.pi / 2, 0))
    for leg in legs:
        yaw = YAW[leg - 1]
        lines += _shape(_cylinder(0.01, WRIST), "steel", _along(yaw, 0.5 * WRIST), (0, np.pi / 2, yaw))
    return [*lines, "  </link>"]


def _bar(name: str, z: float) -> list[str]:
    """A bar along -x from its pivot."""
    return [
        f'  <link name="{name}">',
        *_rod_inertial(BAR_MASS, BAR_RADIUS, BAR, (-0.5 * BAR, 0, 0), 0),
        *_shape(_cylinder(BAR_RADIUS, BAR), "arm", (-0.5 * BAR, 0, z - 0.015), (0, np.pi / 2, 0)),
        "  </link>",
    ]


def _along(yaw: float, radius: float) -> Array:
    return radius * np.array([np.cos(yaw), np.sin(yaw), 0.0])


def _turned(yaw: float, vector: Array) -> Array:
    """The vector of the base frame, turned by yaw."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2]])


def _joint(
    name: str,
    parent: str,
    child: str,
    axis: str,
    xyz: Iterable[float] = (0, 0, 0),
    rpy: Iterable[float] = (0, 0, 0),
    limit: str = 'lower="-3.2" upper="3.2" effort="0" velocity="30"',
) -> list[str]:
    """A revolute joint, or a fixed one without an axis."""
    lines = [
        f'  <joint name="{name}" type="{"revolute" if axis else "fixed"}">',
        f'    <parent link="{parent}"/>',
        f'    <child link="{child}"/>',
        f'    <origin xyz="{_numbers(xyz)}" rpy="{_numbers(rpy)}"/>',
    ]
    if axis:
        lines += [f'    <axis xyz="{axis}"/>', f"    <limit {limit}/>"]
    return [*lines, "  </joint>"]


def _rod_inertial(mass: float, radius: float, length: float, xyz: Iterable[float], axis: int) -> list[str]:
    """Of a uniform cylinder along an axis."""
    moments = [mass * (3 * radius**2 + length**2) / 12] * 3
    moments[axis] = mass * radius**2 / 2
    ixx, iyy, izz = (_numbers([value]) for value in moments)
    return [
        "    <inertial>",
        f'      <origin xyz="{_numbers(xyz)}" rpy="0 0 0"/>',
        f'      <mass value="{_numbers([mass])}"/>',
        f'      <inertia ixx="{ixx}" ixy="0" ixz="0" iyy="{iyy}" iyz="0" izz="{izz}"/>',
        "    </inertial>",
    ]


def _shape(geometry: str, material: str, xyz: Iterable[float], rpy: Iterable[float] = (0, 0, 0)) -> list[str]:
    """The same primitive to look at and to collide with."""
    body = [
        f'      <origin xyz="{_numbers(xyz)}" rpy="{_numbers(rpy)}"/>',
        f"      <geometry>{geometry}</geometry>",
    ]
    seen = ["    <visual>", *body, f'      <material name="{material}"/>', "    </visual>"]
    return [*seen, "    <collision>", *body, "    </collision>"]


def _cylinder(radius: float, length: float) -> str:
    return f'<cylinder radius="{_numbers([radius])}" length="{_numbers([length])}"/>'


def _numbers(values: Iterable[float]) -> str:
    """To 15 decimals, so that the last digit does not depend on the machine's sine."""
    return " ".join(f"{round(float(value), 15) + 0.0:.15g}" for value in values)


if __name__ == "__main__":
    FILE.write_text(urdf(), encoding="utf-8")
