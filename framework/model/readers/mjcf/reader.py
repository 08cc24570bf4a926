"""MJCF, MuJoCo's XML: its bodies become a URDF, its `<equality>` the closures.

Read are: bodies with hinge, slide, ball and free joints, `<inertial>` or the inertia of primitive geoms,
sites as frames, primitive geoms as shapes, defaults and their classes, gravity, ranges, armature, damping,
dry friction and springs of joints, motors with their gear, on joints or on fixed tendons of them, the first
keyframe as the reference (else the zero pose). Of `<equality>`: connect is spherical, weld is fixed, joint is
a coupling or holds a joint. Anchors are resolved at the zero pose, as MuJoCo does. What else acts (springs
and limits of tendons, muscles, compensation of gravity) is left out by name; contact, sensors, cameras and
meshes without a word. The file says nothing about the platform.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

from framework.errors import RobotFileError, choose_from
from framework.model.description import ParsedRobot
from framework.model.readers.describe import describe
from framework.model.readers.left_out import LeftOut
from framework.model.readers.missing_fields import Options
from framework.model.readers.mjcf.bodies import WORLD, Bodies
from framework.model.readers.mjcf.equalities import loops_of
from framework.model.readers.mjcf.frames import without_frames
from framework.model.readers.mjcf.includes import with_includes
from framework.model.readers.mjcf.motors import keyframe_reference, motors_of
from framework.model.readers.mjcf.settings import CompilerSettings
from framework.model.readers.urdf_tree import MAX_LOOPS, UrdfTree
from framework.model.xml_reading import numbers

_SECTIONS_LEFT_OUT = (
    *("asset", "contact", "sensor", "visual", "statistic", "size", "custom", "extension", "deformable"),
)
_SECTIONS = (*("compiler", "option", "default", "worldbody", "equality", "tendon", "actuator", "keyframe"),)


def _fluid(root: ElementTree.Element, bodies: Bodies) -> list[LeftOut]:
    """Return the fluid of <option> that drags at all bodies."""
    values = {key: value for option in root.findall("option") for key, value in option.attrib.items()}
    around = [
        f"{key} {values[key]}"
        for key in ("density", "viscosity")
        if numbers(f"<option> {key}", values.get(key, "0"), 1)[0] > 0.0
    ]
    text = f"<option> {', '.join(around)}: the drag of the fluid"
    return [LeftOut(text, tuple(bodies.coordinates))] if around else []


def read_mjcf(file: Path, root: ElementTree.Element, options: Options) -> ParsedRobot:
    """Read the description in an MJCF file.

    Raises:
        RobotFileError: names the element.
    """
    root = with_includes(root, file.parent)
    for section in root:
        if section.tag not in (*_SECTIONS, *_SECTIONS_LEFT_OUT):
            raise RobotFileError(choose_from("or unsupported section", f"<{section.tag}>", _SECTIONS))
    bodies = Bodies(CompilerSettings(root))
    bodies.root.set("name", root.get("model") or "mjcf")
    worlds = root.findall("worldbody")
    if not worlds:
        raise RobotFileError("<worldbody> is missing")
    for world in worlds:
        without_frames(bodies.settings, world)
        bodies.body_content(world, WORLD, None, 0)
    if sum(len(section) for section in root.findall("equality")) > MAX_LOOPS:
        raise RobotFileError(f"<equality>: at most {MAX_LOOPS} equalities are read")
    tree = UrdfTree(bodies.root)
    frames = {name: tree.add_frame(name, link, place) for name, (link, place) in bodies.sites.items()}
    closures, couplings = loops_of(root, bodies, tree, frames)
    motors = motors_of(root, bodies)
    bodies.left_out.extend(_fluid(root, bodies))
    reference = keyframe_reference(root, bodies)
    return describe(
        tree,
        file,
        options,
        closures,
        couplings=couplings,
        motors=motors,
        joints=bodies.joints,
        gravity=bodies.settings.gravity,
        reference={name: value for name, value in reference.items() if name in tree.coordinates},
        left_out=bodies.left_out,
    )
