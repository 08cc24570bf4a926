"""Writes urdf/orthoglide/orthoglide.urdf: three equal legs on orthogonal rails, and a platform on the first.

Source of the mechanism: D. Chablat and P. Wenger, "Architecture optimization of a 3-DOF translational
parallel mechanism for machining applications, the Orthoglide", IEEE Trans. Robotics and Automation 19(3),
2003, DOI 10.1109/TRA.2003.810242. The length of the legs follows from the rule of design that is told of
it, not checked against the original: in a cube of 200 mm the speed of a motor is between 1/2 and 2 times
that of the platform. Both bounds are met at opposite corners on the diagonal, L / sqrt(6) and L / sqrt(18)
from the isotropic point along each axis. All other dimensions and the masses are ours.
"""

from __future__ import annotations

from math import pi, sqrt

from robots.generators.elements import (
    COMPACT,
    ZERO,
    Element,
    Value,
    box,
    cylinder,
    document,
    fixed,
    inertial,
    joint,
    link,
    origin,
    shape,
    solid_cylinder,
)

CUBE = 0.2  # edge of the workspace [m]
LENGTH = round(CUBE / (1 / sqrt(6) + 1 / sqrt(18)), 5)  # of a leg [m], 0.31058
HALF = 0.04  # from the middle of a parallelogram to its rods [m]
OFFSET = 0.05  # from the tool's point to the end of a leg, along its rail [m]
CARRIAGE, COLUMN, CROSS, ROD, BAR, PLATFORM = 1.5, 0.5, 0.2, 0.12, 0.1, 2.5  # masses [kg]
EDGE = 0.06  # of a carriage [m]
RADIUS, BEAM, POST = 0.007, 0.012, 0.015  # of rod, of cross and bar, of column [m]
HEIGHT = 0.2  # of a column: so far the rail stands beside the leg [m]
RAIL = 0.03  # width of a rail [m]
AWAY = (
    -HEIGHT - 0.035
)  # of a rail from its leg's axis; from its end a beam runs to the corner of the frame, (AWAY, AWAY, AWAY)
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


def passive(name: str, parent: str, child: str, xyz: Value, axis: str) -> Element:
    """A hinge without a motor."""
    return joint(name, "revolute", parent, child, origin(xyz), axis, (-3.14, 3.14, 0, 30))


def leg(n: int) -> list[Element | str]:
    """Rail, carriage, column, cross, two rods and the bar at their ends."""
    post, middle = HEIGHT - BEAM, (0.0, 0.0, -0.5 * (HEIGHT + BEAM))
    parts: list[Element | str] = [
        f"\n  <!-- Leg {n}: rail, carriage, column, cross, rods a and b, and the bar at their ends. -->",
        joint(f"rail_{n}_mount", "fixed", "base", f"rail_{n}", origin(ZERO, TURNED[n - 1])),
        link(
            f"rail_{n}",
            shape(
                box((0.65 - AWAY + RAIL / 2, RAIL, RAIL)),
                origin((0.5 * (0.65 + AWAY - RAIL / 2), 0, AWAY)),
                "frame",
            ),
            shape(box((RAIL, -AWAY, RAIL)), origin((AWAY, 0.5 * (AWAY - RAIL), AWAY)), "frame"),
        ),
        joint(
            f"slide_{n}",
            "prismatic",
            f"rail_{n}",
            f"carriage_{n}",
            origin((OFFSET, 0, 0)),
            "1 0 0",
            (0, 0.6, 3000, 5),
        ),
        link(
            f"carriage_{n}",
            inertial(CARRIAGE, (0, 0, -HEIGHT), [CARRIAGE * EDGE**2 / 6] * 3),
            shape(box((EDGE, EDGE, EDGE / 2)), origin((0, 0, -HEIGHT)), "carriage"),
        ),
        joint(f"column_{n}_foot", "fixed", f"carriage_{n}", f"column_{n}"),
        link(
            f"column_{n}",
            solid_cylinder(COLUMN, POST, post, "z", middle),
            shape(cylinder(POST, post), origin(middle), "carriage"),
        ),
        passive(f"tilt_{n}", f"column_{n}", f"cross_{n}", ZERO, "0 1 0"),
        link(
            f"cross_{n}",
            solid_cylinder(CROSS, BEAM, 2 * HALF, "y"),
            shape(cylinder(BEAM, 2 * HALF), origin(ZERO, ALONG_Y), "steel"),
        ),
    ]
    middle = (-0.5 * LENGTH, 0, 0)
    rod = (
        solid_cylinder(ROD, RADIUS, LENGTH, "x", middle),
        shape(cylinder(RADIUS, LENGTH), origin(middle, ALONG_X), "rod"),
    )
    for side, y in SIDES:
        parts += [
            passive(f"swing_{n}{side}", f"cross_{n}", f"rod_{n}{side}", (0, y, 0), "0 0 1"),
            link(f"rod_{n}{side}", *rod),
        ]
    return [
        *parts,
        *fixed(f"rod_{n}b_end", f"rod_{n}b", f"tip_{n}b", (-LENGTH, 0, 0)),
        passive(f"pin_{n}", f"rod_{n}a", f"bar_{n}", (-LENGTH, 0, 0), "0 0 1"),
        link(
            f"bar_{n}",
            solid_cylinder(BAR, BEAM, 2 * HALF, "y", (0, -HALF, 0)),
            shape(cylinder(BEAM, 2 * HALF), origin((0, -HALF, 0), ALONG_Y), "steel"),
        ),
        *fixed(f"bar_{n}_b", f"bar_{n}", f"seat_{n}b", (0, -2 * HALF, 0)),
        *fixed(f"bar_{n}_middle", f"bar_{n}", f"middle_{n}", (0, -HALF, 0)),
    ]


def platform() -> list[Element | str]:
    """The platform on the bar of leg 1, and the frames at which the other bars hold it."""
    arms = [
        shape(cylinder(BEAM, OFFSET), origin(tuple(OFFSET * m for m in middle), rpy), "steel")
        for middle, rpy in (((0.5, 0, 0), ALONG_X), ((0, 0.5, 0), ALONG_Y), ((0, 0, 0.5), ZERO))
    ]
    return [
        "\n  <!-- The platform: its frame at the tool's point. -->",
        passive("level_1", "middle_1", "mount_1", ZERO, "0 1 0"),
        link("mount_1"),
        joint("platform_point", "fixed", "mount_1", "platform", origin((-OFFSET, 0, 0))),
        link(
            "platform",
            solid_cylinder(PLATFORM, SPINDLE, SPINDLE_LENGTH, "z"),
            shape(cylinder(SPINDLE, SPINDLE_LENGTH), origin(), "spindle"),
            *arms,
        ),
        *fixed("platform_mount_2", "platform", "mount_2", (0, OFFSET, 0), TURNED[1]),
        *fixed("platform_mount_3", "platform", "mount_3", (0, 0, OFFSET), TURNED[2]),
    ]


def files() -> dict[str, str]:
    """The text of each file that is kept, by its place below urdf/."""
    return {"orthoglide/orthoglide.urdf": urdf()}


def urdf() -> str:
    """The whole file."""
    parts = [link("base"), *leg(1), *leg(2), *leg(3), *platform()]
    return document(HEAD, parts, COMPACT)
