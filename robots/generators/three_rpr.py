"""Writes urdf/three_rpr/three_rpr.urdf: three rods that slide through their pivots, and a platform."""

from __future__ import annotations

from math import atan2, hypot, pi, sqrt

from robots.files import robot_file
from robots.generators.three_rrr import bar, box, cylinder, inertial, joint, link, shape, turning

UNIT = 0.05  # [m], what we take for the source's unit of length
PIVOTS = ((0.0, 0.0), (15.91 * UNIT, 0.0), (0.0, 10 * UNIT))  # A_i [m]
SIDE_12, SIDE_23, SIDE_31 = 17.04 * UNIT, 16.54 * UNIT, 20.84 * UNIT  # B_1 B_2, B_2 B_3, B_3 B_1 [m]
_X3 = (SIDE_12**2 + SIDE_31**2 - SIDE_23**2) / (2 * SIDE_12)
CORNERS = ((0.0, 0.0), (SIDE_12, 0.0), (_X3, sqrt(SIDE_31**2 - _X3**2)))  # B_i in the platform [m]
ROD_LENGTH = 1.2  # [m], from its tip B_i back through the pivot
BLOCK, ROD, PLATFORM = 1.5, 2.0, 5.0  # masses [kg]
RADIUS = 0.012  # of the rods [m]
EDGE = 0.08  # of a block [m], a cube
THICKNESS = 0.02  # of the platform [m]
HEIGHTS = (0.0, 0.0, -0.09)  # of the legs' shapes: rod 3 passes under rod 1 [m]
LAYER = 0.08  # the platform stands this much above legs 1 and 2 [m]
FLOOR = -0.2  # [m]

HEAD = """<?xml version="1.0"?>
<!--
A planar 3-RPR robot: three rods that slide through turning blocks, driven there, and a triangular platform.
Written by robots/generators/three_rpr.py; change that file, not this one.

Dimensions after C. Innocenti and V. Parenti-Castelli, "Singularity-free evolution from one configuration to
another in serial and fully-parallel manipulators", ASME J. Mechanical Design 120, 1998, the example also of
M. Zein, P. Wenger and D. Chablat, "Singular curves in the joint space and cusp points of 3-RPR parallel
manipulators", Robotica 25, 2007, arXiv 0711.0574; not checked against the originals: A_1 (0, 0), A_2
(15.91, 0), A_3 (0, 10), B_1 B_2 = 17.04, B_2 B_3 = 16.54, B_3 B_1 = 20.84, in units that we take for 0.05 m.
Masses are ours: blocks of 1.5 kg, uniform rods of 2 kg and 1.2 m, a platform of 5 kg as a uniform triangular
plate.

Units: m, kg, rad, N. The xy plane is horizontal, blocks and platform turn about z. Origin: A_1.
A URDF is a tree: the platform hangs on leg 1; legs 2 and 3 are closed at its corners in three_rpr.yaml.
The coordinate of a sliding joint is the length of its leg, from A_i to B_i. Every joint origin lies in the
plane z = 0. The shapes stand in layers: leg 3, legs 1 and 2, the platform.
-->
<robot name="three_rpr">
  <material name="frame"><color rgba="0.25 0.27 0.30 1"/></material>
  <material name="block"><color rgba="0.12 0.47 0.71 1"/></material>
  <material name="rod"><color rgba="0.84 0.37 0.10 1"/></material>
  <material name="steel"><color rgba="0.75 0.76 0.78 1"/></material>
  <material name="payload"><color rgba="0.93 0.72 0.13 1"/></material>
"""


def plate() -> str:
    """The platform: inertia of a uniform triangular plate, its edges and its middle as shapes."""
    x, y = (sum(corner[k] for corner in CORNERS) / 3 for k in range(2))
    spokes = [(cx - x, cy - y) for cx, cy in CORNERS]
    xx, yy, xy = (
        PLATFORM / 12 * sum(s[i] * s[j] for s in spokes)  # second moments of the mass
        for i, j in ((0, 0), (1, 1), (0, 1))
    )
    out = PLATFORM * THICKNESS**2 / 12
    text = inertial(PLATFORM, (x, y, 0), (yy + out, xx + out, xx + yy), ixy=-xy)
    for (ax, ay), (bx, by) in zip(CORNERS, (*CORNERS[1:], CORNERS[0]), strict=True):
        size = box(hypot(bx - ax, by - ay), 0.03, THICKNESS)
        middle = (0.5 * (ax + bx), 0.5 * (ay + by), LAYER)
        text += shape(size, middle, "payload", (0, 0, atan2(by - ay, bx - ax)))
    return text + shape(cylinder(0.06, THICKNESS), (x, y, LAYER), "payload")


def floor() -> str:
    """The plate under everything."""
    return shape(box(1.1, 0.8, 0.02), (0.4, 0.25, FLOOR - 0.01), "frame")


def post(place: tuple[float, float], z: float) -> str:
    """From the floor to the lower face of a block at height z [m]."""
    top = z - 0.5 * EDGE
    return shape(cylinder(0.025, top - FLOOR), (*place, 0.5 * (top + FLOOR)), "frame")


def block(z: float) -> str:
    """A block that turns on its post, its shape at height z [m]."""
    text = inertial(BLOCK, (0, 0, 0), (BLOCK * EDGE**2 / 6,) * 3)
    return text + shape(box(EDGE, EDGE, EDGE), (0, 0, z), "block")


def rod(z: float) -> str:
    """A rod, its shape at height z [m], with the pin at its tip that reaches the platform."""
    text = bar(ROD, RADIUS, ROD_LENGTH, start=-ROD_LENGTH)
    text += shape(cylinder(RADIUS, ROD_LENGTH), (-0.5 * ROD_LENGTH, 0, z), "rod", (0, 0.5 * pi, 0))
    return text + shape(cylinder(0.015, LAYER - z), (0, 0, 0.5 * (LAYER + z)), "steel")


def urdf() -> str:
    """The whole file."""
    text = HEAD + link("base", *[post(place, z) for place, z in zip(PIVOTS, HEIGHTS, strict=True)], floor())
    stroke = f'lower="0" upper="{ROD_LENGTH}" effort="5000" velocity="5"'
    for number, (x, y) in enumerate(PIVOTS, start=1):
        z = HEIGHTS[number - 1]
        text += f"\n  <!-- Leg {number}: pivot, block, sliding motor, rod, and the frame at its tip. -->\n"
        text += turning(f"pivot_{number}", "base", f"block_{number}", (x, y, 0))
        text += link(f"block_{number}", block(z))
        text += joint(
            f"motor_{number}", "prismatic", f"block_{number}", f"rod_{number}", (0, 0, 0), "1 0 0", stroke
        )
        text += link(f"rod_{number}", rod(z))
        text += joint(f"rod_{number}_tip", "fixed", f"rod_{number}", f"tip_{number}", (0, 0, 0))
        text += link(f"tip_{number}")
    text += "\n  <!-- The platform: its frame at corner B_1, one frame at each other corner. -->\n"
    text += turning("wrist_1", "tip_1", "platform", (0, 0, 0))
    text += link("platform", plate())
    for number, (x, y) in enumerate(CORNERS[1:], start=2):
        text += joint(f"platform_corner_{number}", "fixed", "platform", f"corner_{number}", (x, y, 0))
        text += link(f"corner_{number}")
    return text + "</robot>\n"


def main() -> None:
    """Write the file beside its robot file."""
    robot_file("three_rpr").with_suffix(".urdf").write_text(urdf(), encoding="utf-8")


if __name__ == "__main__":
    main()
