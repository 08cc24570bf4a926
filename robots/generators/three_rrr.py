"""Writes urdf/three_rrr/three_rrr.urdf: three equal legs and a platform on the first of them."""

from __future__ import annotations

from math import pi

from robots.files import robot_file

MOTORS = ((0.0, 0.0), (1.2, 0.0), (0.6, 1.0392304845413265))  # [m], 0.6 sqrt(3)
CORNERS = ((-0.0928, -0.0535), (0.0928, -0.0535), (0.0, 0.107))  # of the platform, in its frame [m]
LENGTH = 0.6  # of every crank and every rod [m]
CRANK, ROD, PLATFORM = (1.5, 0.015), (0.9, 0.012), (4.0, 0.12)  # mass [kg], radius [m]
THICKNESS = 0.03  # of the platform [m]
LAYER = 0.06  # cranks one layer below the rods, the platform one layer above [m]

HEAD = """<?xml version="1.0"?>
<!--
A planar 3-RRR robot: three legs of two equal links each, motors at the base, a triangular platform.
Written by robots/generators/three_rrr.py; change that file, not this one.

Source of the dimensions: J. Kotlarski, B. Heimann and T. Ortmaier, "Influence of kinematic redundancy on the
singularity-free workspace of parallel kinematic machines", Frontiers of Mechanical Engineering 7(2), 2012,
DOI 10.1007/s11465-012-0321-8, with its sliding motors locked: an equilateral base of 1.2 m, links of 0.6 m,
a platform whose corners lie 0.107 m from its centre (rounded to 0.1 mm). Masses are ours: uniform rods of
1.5 kg (cranks) and 0.9 kg (rods), a platform of 4 kg as a disc.

Units: m, kg, rad, N m. The xy plane is horizontal and the axis of every joint is z. Origin: the first motor.
A URDF is a tree: the platform hangs on leg 1; legs 2 and 3 are closed at its corners in three_rrr.yaml.
Every joint origin lies in the plane z = 0. The shapes stand in three layers: cranks, rods, platform.
-->
<robot name="three_rrr">
  <material name="frame"><color rgba="0.25 0.27 0.30 1"/></material>
  <material name="crank"><color rgba="0.12 0.47 0.71 1"/></material>
  <material name="rod"><color rgba="0.84 0.37 0.10 1"/></material>
  <material name="steel"><color rgba="0.75 0.76 0.78 1"/></material>
  <material name="payload"><color rgba="0.93 0.72 0.13 1"/></material>
"""


def numbers(*values: float) -> str:
    """Numbers as URDF writes them."""
    return " ".join(f"{value + 0.0:.16g}" for value in values)


def shape(geometry: str, xyz: tuple[float, ...], material: str, rpy: tuple[float, ...] = (0, 0, 0)) -> str:
    """A visual and its collision shape."""
    place = f'<origin xyz="{numbers(*xyz)}" rpy="{numbers(*rpy)}"/><geometry>{geometry}</geometry>'
    colour = f'<material name="{material}"/>'
    return f"    <visual>{place}{colour}</visual>\n    <collision>{place}</collision>\n"


def box(*size: float) -> str:
    """A box with these edges [m]."""
    return f'<box size="{numbers(*size)}"/>'


def cylinder(radius: float, length: float) -> str:
    """A cylinder along z [m]."""
    return f'<cylinder radius="{numbers(radius)}" length="{numbers(length)}"/>'


def inertial(mass: float, centre: tuple[float, ...], moments: tuple[float, ...], ixy: float = 0.0) -> str:
    """Mass [kg] at a centre [m], its moments of inertia about it [kg m^2]."""
    tensor = " ".join(f'i{axis}{axis}="{numbers(m)}"' for axis, m in zip("xyz", moments, strict=True))
    return (
        f'    <inertial><origin xyz="{numbers(*centre)}" rpy="0 0 0"/><mass value="{numbers(mass)}"/>'
        f'<inertia {tensor} ixy="{numbers(ixy)}" ixz="0" iyz="0"/></inertial>\n'
    )


def bar(mass: float, radius: float, length: float, start: float = 0.0) -> str:
    """Inertia of a uniform round bar that runs along x from `start` [m]."""
    along, across = 0.5 * mass * radius**2, mass * (3 * radius**2 + length**2) / 12
    return inertial(mass, (start + 0.5 * length, 0, 0), (along, across, across))


def link(name: str, *contents: str) -> str:
    """A link."""
    inside = "".join(contents)
    return f'  <link name="{name}">\n{inside}  </link>\n' if inside else f'  <link name="{name}"/>\n'


def joint(
    name: str,
    kind: str,
    parent: str,
    child: str,
    xyz: tuple[float, ...],
    axis: str = "",
    limit: str = "",
    *,
    rpy: tuple[float, ...] = (0, 0, 0),
) -> str:
    """A joint; `axis` and `limit` only where it moves."""
    place = f'<origin xyz="{numbers(*xyz)}" rpy="{numbers(*rpy)}"/>'
    moves = f'<axis xyz="{axis}"/><limit {limit}/>' if axis else ""
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'  <joint name="{name}" type="{kind}">{ends}{place}{moves}</joint>\n'


def turning(name: str, parent: str, child: str, xyz: tuple[float, ...], effort: float = 0) -> str:
    """A revolute joint about z; without a motor its effort is 0."""
    limit = f'lower="-6.28" upper="6.28" effort="{effort}" velocity="20"'
    return joint(name, "revolute", parent, child, xyz, "0 0 1", limit)


def urdf() -> str:
    """The whole file."""
    flat = (0, 0.5 * pi, 0)  # a cylinder along x
    table = [
        shape(cylinder(0.05, 0.08), (x, y, -LAYER - 0.08), "frame")  # motor housings
        for x, y in MOTORS
    ]
    table.append(shape(box(1.5, 1.3, 0.02), (0.6, 0.5, -LAYER - 0.13), "frame"))
    text = HEAD + link("base", *table)
    mass, radius = CRANK
    crank = bar(mass, radius, LENGTH) + shape(
        cylinder(radius, LENGTH), (0.5 * LENGTH, 0, -LAYER), "crank", flat
    )
    crank += shape(cylinder(0.02, 0.04), (0, 0, -LAYER - 0.02), "steel")
    mass, radius = ROD
    rod = bar(mass, radius, LENGTH) + shape(cylinder(radius, LENGTH), (0.5 * LENGTH, 0, 0), "rod", flat)
    rod += shape(cylinder(0.015, LAYER), (0, 0, -0.5 * LAYER), "steel")
    rod += shape(cylinder(0.015, LAYER), (LENGTH, 0, 0.5 * LAYER), "steel")
    for number, (x, y) in enumerate(MOTORS, start=1):
        text += f"\n  <!-- Leg {number}: motor, crank, elbow, rod, and the frame at the tip of the rod. -->\n"
        text += turning(f"motor_{number}", "base", f"crank_{number}", (x, y, 0), effort=200)
        text += link(f"crank_{number}", crank)
        text += turning(f"elbow_{number}", f"crank_{number}", f"rod_{number}", (LENGTH, 0, 0))
        text += link(f"rod_{number}", rod)
        text += joint(f"rod_{number}_tip", "fixed", f"rod_{number}", f"tip_{number}", (LENGTH, 0, 0))
        text += link(f"tip_{number}")
    text += "\n  <!-- The platform: its frame at its centre, one frame at each corner. -->\n"
    text += turning("wrist_1", "tip_1", "corner_1", (0, 0, 0))
    text += link("corner_1")
    x, y = CORNERS[0]
    text += joint("platform_centre", "fixed", "corner_1", "platform", (-x, -y, 0))
    mass, radius = PLATFORM
    across = mass * (3 * radius**2 + THICKNESS**2) / 12
    disc = inertial(mass, (0, 0, 0), (across, across, 0.5 * mass * radius**2))
    text += link("platform", disc, shape(cylinder(radius, THICKNESS), (0, 0, LAYER), "payload"))
    for number, (x, y) in enumerate(CORNERS[1:], start=2):
        text += joint(f"platform_corner_{number}", "fixed", "platform", f"corner_{number}", (x, y, 0))
        text += link(f"corner_{number}")
    return text + "</robot>\n"


def main() -> None:
    """Write the file beside its robot file."""
    robot_file("three_rrr").with_suffix(".urdf").write_text(urdf(), encoding="utf-8")


if __name__ == "__main__":
    main()
