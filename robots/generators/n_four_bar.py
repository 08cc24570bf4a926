"""Writes the URDF and the robot file of the N-four-bar mechanism, for any number of loops.

`python -m robots.generators.n_four_bar LOOPS FOLDER` writes them; two loops are kept.
"""

from __future__ import annotations

import sys
from pathlib import Path

from robots.generators.elements import (
    Element,
    box,
    cylinder,
    document,
    fixed,
    inertial,
    joint,
    link,
    material,
    origin,
    shape,
)

NAME = "n_four_bar"
_COLOURS = {
    "frame": "0.25 0.27 0.30",
    "rod": "0.12 0.47 0.71",
    "bar": "0.84 0.37 0.10",
    "steel": "0.75 0.76 0.78",
}
# 1/12 kg m^2 across a thin rod of 1 m and 1 kg; along it that of a rod of 40 mm diameter.
_ACROSS, _ALONG = "0.08333333333333333", "0.0002"


_URDF_HEAD = """<?xml version="1.0"?>
<!--
The N-four-bar mechanism with N = {loops}: N + 1 rods on the ground, upright at zero, linked at their tips by
N level bars. Each measures 1 m between its joint axes and weighs 1 kg, evenly spread.
Written by robots/generators/n_four_bar.py: change that, not this.

Source: problem A02, N-four-bar, of the IFToMM library of computational benchmark problems; M. Gonzalez,
D. Dopico, U. Lugris and J. Cuadrado, A benchmarking system for MBS simulation software, Multibody System
Dynamics 16, 2006.

Units: m, kg, rad, N m. The mechanism stands in the xz plane, z up; every joint turns about y, and a positive
angle leans a rod towards x. Joint origins lie in the plane y = 0; the shapes of the bars alone stand beside
it, odd ones in front, even ones behind. The loops are closed in the robot file.
-->
<robot name="n_four_bar">
"""

_ROBOT_FILE = """\
# The N-four-bar mechanism of the IFToMM multibody benchmarks with N = {loops}, and a drive on its first rod.
# SI units: m, kg, s, rad, N, N m. Written by robots/generators/n_four_bar.py: change that, not this.
version: 1
urdf: n_four_bar.urdf

# x = the angle of the last rod from the vertical.
platform: {{frame: rod_{loops}, axes: [ry]}}

# The benchmark has no motor: a servo drive of usual size, 1:100, with its rotor.
actuators:
  - {{joint: pivot_0, gear_ratio: 100, rotor_inertia: 3.3e-5}}

# Hinges of a solid mechanism: five axes locked each, three of them (y, rx, rz) for nothing.
closures:
{closures}

# The gear [N m/rad], and each bar along itself [N/m]; not part of the benchmark.
springs:
  - {{name: drive, part: joint, after: pivot_0, stiffness: 30000}}
{springs}

# A row of parallelograms, all rods leaning by the same angle [rad].
reference:
{reference}

# From one side to the other [rad], duration [s]. At +-pi/2 all rods and bars lie on one line: every loop
# loses a rank there and may fold, whatever the motor does. The scene stays away from it.
scenes:
  swing: {{line: [[0.9], [-0.9]], duration: 1.5, fidelity: {{level: rigid, tolerance: 0.01}}}}
"""


def files() -> dict[str, str]:
    """The text of each file that is kept, by its place below urdf/: two loops."""
    return {"n_four_bar/n_four_bar.urdf": urdf(2), "n_four_bar/n_four_bar.yaml": robot_file(2)}


def urdf(loops: int) -> str:
    """The URDF of the open tree with this many loops."""
    parts: list[Element | str] = [material(name, rgb) for name, rgb in _COLOURS.items()]
    parts += ["", _base(loops)]
    for k in range(loops + 1):
        parts += ["", _hinge(f"pivot_{k}", "base", f"rod_{k}", f"{k} 0 0", "200"), _rod(k)]
        if k > 0:
            parts += fixed(f"rod_{k}_end", f"rod_{k}", f"rod_{k}_tip", "0 0 1", "0 0 0")
    for k in range(1, loops + 1):
        parts += ["", _hinge(f"hinge_{k}", f"rod_{k - 1}", f"bar_{k}", "0 0 1", "0"), _bar(k)]
        parts += fixed(f"bar_{k}_end", f"bar_{k}", f"bar_{k}_tip", "1 0 0", "0 0 0")
    return document(_URDF_HEAD.format(loops=loops), parts)


def robot_file(loops: int) -> str:
    """The robot file beside that URDF."""
    numbers = range(1, loops + 1)
    return _ROBOT_FILE.format(
        loops=loops,
        closures="\n".join(
            f"  - {{name: loop_{k}, frames: [bar_{k}_tip, rod_{k}_tip], kind: revolute, axis: y}}"
            for k in numbers
        ),
        springs="\n".join(
            f"  - {{name: bar_{k}_length, part: link, after: bar_{k}_end, motion: x, stiffness: 500000}}"
            for k in numbers
        ),
        reference="\n".join(
            [f"  pivot_{k}: 0.5" for k in range(loops + 1)] + [f"  hinge_{k}: -0.5" for k in numbers]
        ),
    )


def write(folder: Path, loops: int) -> Path:
    """Write both files for this many loops, at least one; returns the robot file."""
    if loops < 1:
        raise ValueError(f"loops: needs at least 1, got {loops}")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{NAME}.urdf").write_text(urdf(loops), encoding="utf-8")
    file = folder / f"{NAME}.yaml"
    file.write_text(robot_file(loops), encoding="utf-8")
    return file


def _hinge(name: str, parent: str, child: str, xyz: str, effort: str) -> Element:
    limit = ("-6.28", "6.28", effort, "20")
    return joint(name, "revolute", parent, child, origin(xyz, "0 0 0"), "0 1 0", limit)


_ALONG_X, _ALONG_Y, _ALONG_Z = "0 1.5707963267948966 0", "1.5707963267948966 0 0", "0 0 0"
_LONG = cylinder("0.02", "0.96")


def _base(loops: int) -> Element:
    table = shape(box(f"{loops + 0.4} 0.2 0.04"), origin(f"{loops / 2} 0 -0.11", _ALONG_Z), "frame")
    forks = [
        shape(box("0.06 0.02 0.14"), origin(f"{k} {y} -0.04", _ALONG_Z), "frame")
        for k in range(loops + 1)
        for y in ("-0.04", "0.04")
    ]
    return link("base", table, *forks)


def _rod(k: int) -> Element:
    eye = cylinder("0.025", "0.055")
    return link(
        f"rod_{k}",
        inertial("1", "0 0 0.5", (_ACROSS, _ACROSS, _ALONG)),
        shape(_LONG, origin("0 0 0.5", _ALONG_Z), "rod"),
        shape(eye, origin("0 0 0", _ALONG_Y), "steel"),
        shape(eye, origin("0 0 1", _ALONG_Y), "steel"),
    )


def _bar(k: int) -> Element:
    y = "-0.055" if k % 2 else "0.055"
    eye = cylinder("0.025", "0.05")
    return link(
        f"bar_{k}",
        inertial("1", "0.5 0 0", (_ALONG, _ACROSS, _ACROSS)),
        shape(_LONG, origin(f"0.5 {y} 0", _ALONG_X), "bar"),
        shape(eye, origin(f"0 {y} 0", _ALONG_Y), "steel"),
        shape(eye, origin(f"1 {y} 0", _ALONG_Y), "steel"),
    )


if __name__ == "__main__":
    write(Path(sys.argv[2]), int(sys.argv[1]))
