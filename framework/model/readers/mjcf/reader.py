"""MJCF, MuJoCo's XML: its bodies become a URDF, its `<equality>` the closures.

Read are: bodies with hinge, slide, ball and free joints, `<inertial>` or the inertia of primitive geoms,
sites as frames, primitive geoms as shapes, defaults and their classes, gravity, ranges and springs of joints,
motors with gear and armature, the first keyframe as the reference (else the zero pose). Of `<equality>`:
connect is spherical, weld is fixed, joint is read where it holds a joint or keeps two turns about parallel
axes equal. Anchors are resolved at the zero pose, as MuJoCo does. What moves otherwise - tendons, flexes,
mocap bodies, includes - is refused by name; contact, damping, friction, sensors, cameras and meshes are left
out. The file says nothing about the platform.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

from framework.errors import RobotFileError, choose_from
from framework.model.description import ParsedRobot
from framework.model.readers.describe import describe
from framework.model.readers.missing_fields import Options
from framework.model.readers.mjcf.bodies import WORLD, Bodies
from framework.model.readers.mjcf.equalities import closures_of
from framework.model.readers.mjcf.motors import actuators_of, reference_of
from framework.model.readers.mjcf.settings import CompilerSettings
from framework.model.readers.urdf_tree import MOST_LOOPS, UrdfTree

_SECTIONS_LEFT_OUT = ("asset", "contact", "sensor", "visual", "statistic", "size", "custom")
_SECTIONS = ("compiler", "option", "default", "worldbody", "equality", "actuator", "keyframe")


def read_mjcf(file: Path, root: ElementTree.Element, options: Options) -> ParsedRobot:
    """The description in an MJCF file.

    Raises:
        RobotFileError: names the element.
    """
    for section in root:
        if section.tag == "tendon" and not len(section):
            continue
        if section.tag not in (*_SECTIONS, *_SECTIONS_LEFT_OUT):
            raise RobotFileError(choose_from("or unsupported section", f"<{section.tag}>", _SECTIONS))
    bodies = Bodies(CompilerSettings(root))
    worlds = root.findall("worldbody")
    if not worlds:
        raise RobotFileError("<worldbody> is missing")
    for world in worlds:
        bodies.body_content(world, WORLD, None, 0)
    if sum(len(section) for section in root.findall("equality")) > MOST_LOOPS:
        raise RobotFileError(f"<equality>: at most {MOST_LOOPS} equalities are read")
    tree = UrdfTree(bodies.root)
    frames = {name: tree.add_frame(name, link, at) for name, (link, at) in bodies.sites.items()}
    closures = closures_of(root, bodies, tree, frames)
    actuators = actuators_of(root, bodies, tree)
    reference = reference_of(root, bodies)
    return describe(
        tree,
        file,
        options,
        closures,
        actuators=actuators,
        joint_springs=[spring for spring in bodies.springs if spring.joint in tree.movable],
        gravity=bodies.settings.gravity,
        reference={name: value for name, value in reference.items() if name in tree.coordinates},
    )
