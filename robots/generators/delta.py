"""Writes urdf/delta/delta.urdf: three equal legs with real parallelograms, and a platform on one rod.

    python -m robots.generators.delta

Source of the dimensions: R. L. Williams II, "The Delta Parallel Robot: Kinematics Solutions", Ohio
University, 2015, table of the ABB FlexPicker IRB 360-1/1600, as other programs quote it: arms of 0.524 m,
forearms of 1.244 m and 0.131 m wide; a base triangle with sides of 0.567 m, which puts the motor axes 0.164 m
from the centre, and a platform triangle with sides of 0.076 m, its corners, where the forearms end, 0.044 m
from the centre. Masses are ours.
"""

from __future__ import annotations

import numpy as np

from framework.arrays import Array
from robots.files import URDF

FILE = URDF / "delta" / "delta.urdf"
BASE, PLATFORM, ARM, ROD, WIDTH = 0.164, 0.044, 0.524, 1.244, 0.131  # [m]
ARM_MASS, ROD_MASS, PLATFORM_MASS = 1.6, 0.18, 1.5  # [kg]; the platform with 1 kg of payload
# A forearm may hang or lie level (1.6 rad either way) wherever its arm is, from -1.6 to 4.2 rad: its rods
# pass beside the arm.
SWING = 'lower="-5.8" upper="3.2" effort="0" velocity="30"'
ARM_RADIUS, ROD_RADIUS, PLATE_RADIUS, PLATE = 0.03, 0.008, 0.08, 0.02  # of the shapes [m]


def urdf() -> str:
    """The text of the URDF."""
    lines = [HEADER, *_base()]
    for leg in (1, 2, 3):
        lines += _leg(leg)
    lines += _platform()
    return "\n".join([*lines, "</robot>", ""])


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
on it in delta.yaml. Nothing but the six rods keeps the platform level.
-->
<robot name="delta">
  <material name="frame"><color rgba="0.25 0.27 0.30 1"/></material>
  <material name="arm"><color rgba="0.84 0.37 0.10 1"/></material>
  <material name="rod"><color rgba="0.12 0.47 0.71 1"/></material>
  <material name="steel"><color rgba="0.75 0.76 0.78 1"/></material>
  <material name="payload"><color rgba="0.93 0.72 0.13 1"/></material>
"""


def _base() -> list[str]:
    """A plate below the motors, small enough for the forearms to pass beside it, and three housings."""
    lines = ['  <link name="base">', *_shape(_cylinder(0.14, 0.02), "frame", (0, 0, -0.05))]
    for leg in (1, 2, 3):
        place = (*_outward(leg, BASE), 0.0)
        lines += _shape(_cylinder(0.035, 0.09), "frame", place, (-np.pi / 2, 0, _yaw(leg)))
    return [*lines, "  </link>", ""]


def _leg(leg: int) -> list[str]:
    across = ARM_MASS * (3 * ARM_RADIUS**2 + ARM**2) / 12
    along = ARM_MASS * ARM_RADIUS**2 / 2
    lines = [
        f"  <!-- Leg {leg}. -->",
        *_joint(
            f"motor_{leg}",
            "base",
            f"arm_{leg}",
            "0 1 0",
            (*_outward(leg, BASE), 0.0),
            (0, 0, _yaw(leg)),
            'lower="-1.6" upper="4.2" effort="500" velocity="20"',
        ),
        f'  <link name="arm_{leg}">',
        *_inertial((0.5 * ARM, 0, 0), ARM_MASS, (along, across, across)),
        *_shape(_cylinder(ARM_RADIUS, ARM), "arm", (0.5 * ARM, 0, 0), (0, np.pi / 2, 0)),
        *_shape(_cylinder(0.5 * ARM_RADIUS, WIDTH), "steel", (ARM, 0, 0), (np.pi / 2, 0, 0)),
        "  </link>",
    ]
    for rod, side in (("a", 0.5), ("b", -0.5)):
        lines += _rod(leg, f"{leg}{rod}", side * WIDTH)
    return [*lines, ""]


def _rod(leg: int, name: str, y: float) -> list[str]:
    """One rod of the forearm on its universal joint, at y on the arm's end, with the frame at its tip."""
    across = ROD_MASS * (3 * ROD_RADIUS**2 + ROD**2) / 12
    along = ROD_MASS * ROD_RADIUS**2 / 2
    return [
        *_joint(f"swing_{name}", f"arm_{leg}", f"cross_{name}", "0 1 0", (ARM, y, 0), limit=SWING),
        f'  <link name="cross_{name}">',
        *_shape('<sphere radius="0.018"/>', "steel", (0, 0, 0)),
        "  </link>",
        *_joint(f"lean_{name}", f"cross_{name}", f"rod_{name}", "1 0 0"),
        f'  <link name="rod_{name}">',
        *_inertial((0, 0, -0.5 * ROD), ROD_MASS, (across, across, along)),
        *_shape(_cylinder(ROD_RADIUS, ROD), "rod", (0, 0, -0.5 * ROD)),
        "  </link>",
        *_joint(f"end_{name}", f"rod_{name}", f"tip_{name}", "", (0, 0, -ROD)),
        f'  <link name="tip_{name}">',
        *_shape('<sphere radius="0.015"/>', "steel", (0, 0, 0)),
        "  </link>",
    ]


def _platform() -> list[str]:
    """The ball of rod 1a, the platform on it, and the places of the other balls."""
    across = PLATFORM_MASS * (3 * PLATE_RADIUS**2 + PLATE**2) / 12
    along = PLATFORM_MASS * PLATE_RADIUS**2 / 2
    lines = [
        "  <!-- The platform, on the ball of rod 1a. -->",
        *_joint("ball_x", "tip_1a", "ball_1", "1 0 0"),
        '  <link name="ball_1"/>',
        *_joint("ball_y", "ball_1", "ball_2", "0 1 0"),
        '  <link name="ball_2"/>',
        *_joint("ball_z", "ball_2", "platform_1a", "0 0 1"),
        '  <link name="platform_1a"/>',
        *_joint("platform_centre", "platform_1a", "platform", "", (-PLATFORM, -0.5 * WIDTH, 0)),
        '  <link name="platform">',
        *_inertial((0, 0, 0), PLATFORM_MASS, (across, across, along)),
        *_shape(_cylinder(PLATE_RADIUS, PLATE), "steel", (0, 0, 0)),
        *_shape(_cylinder(0.03, 0.08), "payload", (0, 0, -0.05)),
        "  </link>",
    ]
    for name in ("1b", "2a", "2b", "3a", "3b"):
        leg, side = int(name[0]), 0.5 if name[1] == "a" else -0.5
        place = _outward(leg, PLATFORM) + side * WIDTH * np.array([-1, 1]) * _outward(leg, 1.0)[::-1]
        lines += _joint(f"platform_ball_{name}", "platform", f"platform_{name}", "", (*place, 0.0))
        lines += [f'  <link name="platform_{name}"/>']
    return lines


def _yaw(leg: int) -> float:
    """Direction of a leg [rad]."""
    return (0.0, 2 * np.pi / 3, -2 * np.pi / 3)[leg - 1]


def _outward(leg: int, radius: float) -> Array:
    """The point (x, y) of a leg's plane at this distance from the centre [m]."""
    return radius * np.array([np.cos(_yaw(leg)), np.sin(_yaw(leg))])


def _joint(
    name: str,
    parent: str,
    child: str,
    axis: str,
    xyz: tuple[float, ...] = (0, 0, 0),
    rpy: tuple[float, ...] = (0, 0, 0),
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


def _inertial(xyz: tuple[float, ...], mass: float, moments: tuple[float, float, float]) -> list[str]:
    ixx, iyy, izz = (_numbers((value,)) for value in moments)
    return [
        "    <inertial>",
        f'      <origin xyz="{_numbers(xyz)}" rpy="0 0 0"/>',
        f'      <mass value="{_numbers((mass,))}"/>',
        f'      <inertia ixx="{ixx}" ixy="0" ixz="0" iyy="{iyy}" iyz="0" izz="{izz}"/>',
        "    </inertial>",
    ]


def _shape(
    geometry: str, material: str, xyz: tuple[float, ...], rpy: tuple[float, ...] = (0, 0, 0)
) -> list[str]:
    """The same primitive to look at and to collide with."""
    body = [
        f'      <origin xyz="{_numbers(xyz)}" rpy="{_numbers(rpy)}"/>',
        f"      <geometry>{geometry}</geometry>",
    ]
    seen = ["    <visual>", *body, f'      <material name="{material}"/>', "    </visual>"]
    return [*seen, "    <collision>", *body, "    </collision>"]


def _cylinder(radius: float, length: float) -> str:
    return f'<cylinder radius="{_numbers((radius,))}" length="{_numbers((length,))}"/>'


def _numbers(values: tuple[float, ...]) -> str:
    """To 15 digits, so that the last one does not depend on the machine's sine."""
    return " ".join(f"{round(float(value), 15) + 0.0:.15g}" for value in values)


if __name__ == "__main__":
    FILE.write_text(urdf(), encoding="utf-8")
