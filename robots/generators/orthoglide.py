"""Writes urdf/orthoglide/orthoglide.urdf: three equal legs on orthogonal rails, and a platform on the first.

    python -m robots.generators.orthoglide

Source of the mechanism: D. Chablat and P. Wenger, "Architecture optimization of a 3-DOF translational
parallel mechanism for machining applications, the Orthoglide", IEEE Trans. Robotics and Automation 19(3),
2003, DOI 10.1109/TRA.2003.810242. The length of the legs follows from the rule of design that is told of
it, not checked against the original: in a cube of 200 mm the speed of a motor is between 1/2 and 2 times
that of the platform. Both bounds are met at opposite corners on the diagonal, L / sqrt(6) and L / sqrt(18)
from the isotropic point along each axis. All other dimensions and the masses are ours.
"""

from __future__ import annotations

from math import pi, sqrt

from robots.files import robot_file
from robots.generators.three_rrr import box, cylinder, inertial, joint, link, shape

CUBE = 0.2  # edge of the workspace [m]
LENGTH = round(CUBE / (1 / sqrt(6) + 1 / sqrt(18)), 5)  # of a leg [m], 0.31058
HALF = 0.04  # from the middle of a parallelogram to its rods [m]
OFFSET = 0.05  # from the tool's point to the end of a leg, along its rail [m]
CARRIAGE, COLUMN, CROSS, ROD, BAR, PLATFORM = 1.5, 0.5, 0.2, 0.12, 0.1, 2.5  # masses [kg]
EDGE, RADIUS, BEAM, POST = (
    0.06,
    0.007,
    0.012,
    0.015,
)  # edge of a carriage; radii of rod, cross and bar, column [m]
HEIGHT = 0.2  # of a column: so far the rail stands beside the leg [m]
SPINDLE, SPINDLE_LENGTH = 0.025, 0.08  # radius and length [m]
TURNED = ((0.0, 0.0, 0.0), (0.5 * pi, 0.0, 0.5 * pi), (-0.5 * pi, -0.5 * pi, 0.0))  # rpy of the legs
ALONG_X, ALONG_Y = (0.0, 0.5 * pi, 0.0), (0.5 * pi, 0.0, 0.0)  # rpy of a cylinder
SIDES = (("a", HALF), ("b", -HALF))

HEAD = f"""<?xml version="1.0"?>
<!--
The Orthoglide, three translations on three orthogonal rails.
Written by robots/generators/orthoglide.py: change that, not this.

Source of the mechanism: D. Chablat and P. Wenger, "Architecture optimization of a 3-DOF translational
parallel mechanism for machining applications, the Orthoglide", IEEE Trans. Robotics and Automation 19(3),
2003, DOI 10.1109/TRA.2003.810242. The legs of {1000 * LENGTH:.2f} mm follow from the rule of design that is
told of it, not checked against the original: a cube of 200 mm in which the speed of a motor is between 1/2
and 2 times that of the platform. All other dimensions and the masses are ours: carriages of {CARRIAGE:g} kg,
columns of {COLUMN:g} kg, crosses of {CROSS:g} kg, rods of {ROD:g} kg, bars of {BAR:g} kg, and {PLATFORM:g} kg
of platform and spindle as one cylinder.

Units: m, kg, rad, N. z points up; the legs stand on the axes x, y and z. In the frame of a leg that axis is
x: the carriage slides along it on a rail {1000 * HEIGHT:g} mm below, its column carries a cross that turns
about y, two rods swing on the cross about z, a bar joins their ends, and the platform turns on the bar about
y. So a leg lets the platform turn about y only, and two legs keep it from turning at all; the third does it
once more. slide_i is the coordinate of the carriage less the {1000 * OFFSET:g} mm from the tool's point to
the end of the leg. A URDF is a tree: leg 1 carries the platform, rod a of each leg its bar; rods b and legs
2 and 3 are closed in orthoglide.yaml.
-->
<robot name="orthoglide">
  <material name="frame"><color rgba="0.25 0.27 0.30 1"/></material>
  <material name="carriage"><color rgba="0.84 0.37 0.10 1"/></material>
  <material name="rod"><color rgba="0.12 0.47 0.71 1"/></material>
  <material name="steel"><color rgba="0.75 0.76 0.78 1"/></material>
  <material name="spindle"><color rgba="0.93 0.72 0.13 1"/></material>
"""


def tube(mass: float, radius: float, length: float, along: str, middle: tuple[float, ...]) -> str:
    """Inertia of a uniform cylinder along an axis of the link's frame."""
    across = mass * (3 * radius**2 + length**2) / 12
    moments = tuple(0.5 * mass * radius**2 if axis == along else across for axis in "xyz")
    return inertial(mass, middle, moments)


def passive(name: str, parent: str, child: str, xyz: tuple[float, ...], axis: str) -> str:
    """A hinge without a motor."""
    limit = 'lower="-3.14" upper="3.14" effort="0" velocity="30"'
    return joint(name, "revolute", parent, child, xyz, axis, limit)


def fixed(
    name: str, parent: str, child: str, xyz: tuple[float, ...], rpy: tuple[float, ...] = (0, 0, 0)
) -> str:
    """A fixed joint to an empty link, a frame."""
    return joint(name, "fixed", parent, child, xyz, rpy=rpy) + link(child)


def leg(number: int) -> str:
    """Rail, carriage, column, cross, two rods and the bar at their ends."""
    n = number
    stroke = 'lower="0" upper="0.6" effort="3000" velocity="5"'
    rail = shape(box(0.5, 0.03, 0.03), (0.4, 0, -HEIGHT - 0.035), "frame")
    text = f"\n  <!-- Leg {n}: rail, carriage, column, cross, rods a and b, and the bar at their ends. -->\n"
    text += joint(f"rail_{n}_mount", "fixed", "base", f"rail_{n}", (0, 0, 0), rpy=TURNED[n - 1])
    text += link(f"rail_{n}", rail)
    text += joint(f"slide_{n}", "prismatic", f"rail_{n}", f"carriage_{n}", (OFFSET, 0, 0), "1 0 0", stroke)
    block = inertial(CARRIAGE, (0, 0, -HEIGHT), (CARRIAGE * EDGE**2 / 6,) * 3)
    text += link(f"carriage_{n}", block, shape(box(EDGE, EDGE, EDGE / 2), (0, 0, -HEIGHT), "carriage"))
    post, middle = HEIGHT - BEAM, (0.0, 0.0, -0.5 * (HEIGHT + BEAM))
    column = tube(COLUMN, POST, post, "z", middle) + shape(cylinder(POST, post), middle, "carriage")
    text += joint(f"column_{n}_foot", "fixed", f"carriage_{n}", f"column_{n}", (0, 0, 0))
    text += link(f"column_{n}", column)
    text += passive(f"tilt_{n}", f"column_{n}", f"cross_{n}", (0, 0, 0), "0 1 0")
    beam = shape(cylinder(BEAM, 2 * HALF), (0, 0, 0), "steel", ALONG_Y)
    text += link(f"cross_{n}", tube(CROSS, BEAM, 2 * HALF, "y", (0, 0, 0)), beam)
    middle = (-0.5 * LENGTH, 0, 0)
    rod = tube(ROD, RADIUS, LENGTH, "x", middle) + shape(cylinder(RADIUS, LENGTH), middle, "rod", ALONG_X)
    for side, y in SIDES:
        text += passive(f"swing_{n}{side}", f"cross_{n}", f"rod_{n}{side}", (0, y, 0), "0 0 1")
        text += link(f"rod_{n}{side}", rod)
    text += fixed(f"rod_{n}b_end", f"rod_{n}b", f"tip_{n}b", (-LENGTH, 0, 0))
    text += passive(f"pin_{n}", f"rod_{n}a", f"bar_{n}", (-LENGTH, 0, 0), "0 0 1")
    beam = shape(cylinder(BEAM, 2 * HALF), (0, -HALF, 0), "steel", ALONG_Y)
    text += link(f"bar_{n}", tube(BAR, BEAM, 2 * HALF, "y", (0, -HALF, 0)), beam)
    text += fixed(f"bar_{n}_b", f"bar_{n}", f"seat_{n}b", (0, -2 * HALF, 0))
    return text + fixed(f"bar_{n}_middle", f"bar_{n}", f"middle_{n}", (0, -HALF, 0))


def platform() -> str:
    """The platform on the bar of leg 1, and the frames at which the other bars hold it."""
    text = "\n  <!-- The platform: its frame at the tool's point. -->\n"
    text += passive("level_1", "middle_1", "mount_1", (0, 0, 0), "0 1 0") + link("mount_1")
    text += joint("platform_point", "fixed", "mount_1", "platform", (-OFFSET, 0, 0))
    spindle = shape(cylinder(SPINDLE, SPINDLE_LENGTH), (0, 0, 0), "spindle")
    for middle, rpy in (((0.5, 0, 0), ALONG_X), ((0, 0.5, 0), ALONG_Y), ((0, 0, 0.5), (0, 0, 0))):
        spindle += shape(cylinder(BEAM, OFFSET), tuple(OFFSET * m for m in middle), "steel", rpy)
    text += link("platform", tube(PLATFORM, SPINDLE, SPINDLE_LENGTH, "z", (0, 0, 0)), spindle)
    for n in (2, 3):
        place = (0.0, OFFSET, 0.0) if n == 2 else (0.0, 0.0, OFFSET)
        text += fixed(f"platform_mount_{n}", "platform", f"mount_{n}", place, TURNED[n - 1])
    return text


def urdf() -> str:
    """The whole file."""
    text = HEAD + link("base")
    return text + "".join(leg(n) for n in (1, 2, 3)) + platform() + "</robot>\n"


def main() -> None:
    """Write the file beside its robot file."""
    robot_file("orthoglide").with_suffix(".urdf").write_text(urdf(), encoding="utf-8")


if __name__ == "__main__":
    main()
