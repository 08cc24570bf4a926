"""The records of a foreign file, once its tree is read and its loops are known."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path

from framework.errors import RobotFileError
from framework.model.description import (
    Actuator,
    Closure,
    JointSpring,
    ParsedRobot,
    Platform,
    RobotDescription,
)
from framework.model.readers.base_link import lock_all_but, loops_of_the_rest
from framework.model.readers.missing_fields import Options, checked_reference, resolve
from framework.model.readers.urdf_tree import UrdfTree


def describe(
    tree: UrdfTree,
    file: Path,
    options: Options,
    closures: Sequence[Closure],
    *,
    platform: Platform | None = None,
    actuators: Sequence[Actuator] = (),
    likely_motors: Sequence[str] = (),
    joint_springs: Sequence[JointSpring] = (),
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81),
    reference: dict[str, float] | None = None,
) -> ParsedRobot:
    """The records of a tree and its loops, once the options have said what the file does not; and its URDF.

    Raises:
        RobotFileError: there is no loop, or one that closes nothing; or platform, axes or motors are missing.
    """
    if not closures:
        raise RobotFileError("there is no loop in it: a parallel robot needs at least one closure")
    if options.base is not None:
        lock_all_but(tree, options.base, reference or {})
        actuators = [actuator for actuator in actuators if actuator.joint in tree.movable]
        joint_springs = [spring for spring in joint_springs if spring.joint in tree.movable]
        reference = {name: value for name, value in (reference or {}).items() if name in tree.coordinates}
        closures = loops_of_the_rest(tree, closures)
        if not closures:
            raise RobotFileError(f"--base: no loop moves that link {options.base!r} carries")
    names = [closure.name for closure in closures]
    for closure in closures:
        if names.count(closure.name) > 1:
            raise RobotFileError(f"duplicate closure {closure.name!r}")
        if closure.frames[0] == closure.frames[1]:
            raise RobotFileError(
                f"closure {closure.name!r}: joins {closure.frames[0]!r} with itself; needs two frames"
            )
        if not any(tree.moving_chains(*map(tree.link_of, closure.frames))):
            raise RobotFileError(
                f"closure {closure.name!r}: no joint moves between {closure.frames[0]!r} and "
                f"{closure.frames[1]!r}, so it closes no loop"
            )
    frames, joints = tree.frames, tree.movable
    resolved = resolve(
        options,
        frames=frames,
        joints=joints,
        platform=platform,
        actuators=actuators,
        likely_motors=likely_motors,
    )
    description = RobotDescription(
        name=file.stem,
        file=file,
        urdf_text=ElementTree.tostring(tree.root, encoding="unicode"),
        platform=resolved.platform,
        actuators=resolved.actuators,
        closures=tuple(closures),
        joint_springs=tuple(joint_springs),
        gravity=gravity,
        reference=checked_reference(options, tree.coordinates, reference or {}),
    )
    return ParsedRobot(description, tree.root)
