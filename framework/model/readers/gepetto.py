"""The pair robot.urdf + robot.yaml of "Extended URDF: Accounting for parallel mechanism in robot
description" (Batto, de Matteis, Mansard 2025; Gepetto's example-parallel-robots).

    closed_loop: [[frame_A, frame_B], ...]     frames that coincide
    type: [3d, 6d, ...]                        one each: the points, or the whole frames
    name_mot: [joint, ...]                     joints with a motor
    joint_name: [joint, ...]                   joints of the URDF that stand for another type ...
    joint_type: [SPHERICAL, UJOINT_XY, FIXED]  ... which is this one

A UJOINT_XY is written as two turns that end in its letters, J_X and J_Y. The file says nothing about the
platform.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from framework.errors import RobotFileError, check_name, check_unique, choose_from, short
from framework.model.description import Closure, ParsedRobot, locked_axes
from framework.model.readers.describe import Options, Pull, describe
from framework.model.readers.urdf_tree import MAX_LOOPS, UrdfTree

KEYS = ("closed_loop", "type", "name_mot", "joint_name", "joint_type")
_KINDS = {"3d": "spherical", "6d": "fixed"}
_U_JOINTS = tuple(f"UJOINT_{a}{b}" for a in "XYZ" for b in "XYZ" if a != b)


def read_pair(file: Path, content: Mapping[Any, Any], tree: UrdfTree, options: Options) -> ParsedRobot:
    """Read the description in the content of a robot.yaml and the tree of its URDF.

    Raises:
        RobotFileError: names the key.
    """
    for key in content:
        check_name(short(key), "key", key, KEYS)
    pairs = content.get("closed_loop")
    if not isinstance(pairs, list) or not pairs:
        raise RobotFileError(f"closed_loop: needs a list of pairs of frames, got {short(pairs)}")
    if len(pairs) > MAX_LOOPS:
        raise RobotFileError(f"closed_loop: {len(pairs)} loops; at most {MAX_LOOPS} are read")
    if "type" not in content:
        raise RobotFileError("type: missing; needs 3d or 6d for each pair of closed_loop")
    kinds = names_list("type", content["type"])
    if len(kinds) != len(pairs):
        raise RobotFileError(f"type: needs one entry a pair of closed_loop ({len(pairs)}), got {len(kinds)}")
    _replace_joints(tree, content)
    closures = []
    for i, (pair, kind) in enumerate(zip(pairs, kinds, strict=True)):
        frames = names_list(f"closed_loop[{i}]", pair)
        if len(frames) != 2:
            raise RobotFileError(f"closed_loop[{i}]: needs two frames, got {short(pair)}")
        for frame in frames:
            check_name(f"closed_loop[{i}]", "frame", frame, tree.frames)
        if kind.lower() not in _KINDS:
            raise RobotFileError(f"type[{i}]: {choose_from('type', kind, _KINDS)}")
        axes = locked_axes(_KINDS[kind.lower()])
        closures.append(Closure("-".join(frames), (frames[0], frames[1]), axes))
    motors = names_list("name_mot", content["name_mot"]) if "name_mot" in content else ()
    for i, name in enumerate(motors):
        check_name(f"name_mot[{i}]", "movable joint", name, tree.movable)
    check_unique("name_mot", motors)
    return describe(tree, file, options, closures, pulls=map(Pull.motor_on, motors))


def _replace_joints(tree: UrdfTree, content: Mapping[Any, Any]) -> None:
    names = names_list("joint_name", content.get("joint_name", []))
    kinds = names_list("joint_type", content.get("joint_type", []))
    if len(names) != len(kinds):
        raise RobotFileError(
            f"joint_type: needs one entry a joint of joint_name ({len(names)}), got {len(kinds)}"
        )
    check_unique("joint_name", names)
    for i, (name, kind) in enumerate(zip(names, kinds, strict=True)):
        check_name(f"joint_name[{i}]", "joint", name, tree.joints)
        joint = tree.joints[name]
        if kind == "FIXED":
            tree.fix(joint)
        elif kind == "SPHERICAL":
            tree.replace_by_ball(joint)
        elif kind.upper() in _U_JOINTS:
            tree.replace_by_turns(joint, kind[-2:].upper())
        else:
            raise RobotFileError(
                f"joint_type[{i}]: {choose_from('joint type', kind, ('FIXED', 'SPHERICAL', *_U_JOINTS))}"
            )


def names_list(where: str, value: object) -> tuple[str, ...]:
    """Read a list of texts.

    Raises:
        RobotFileError: it is not.
    """
    if not isinstance(value, list) or not all(isinstance(item, str) and item for item in value):
        raise RobotFileError(f"{where}: needs a list of names, got {short(value)}")
    return tuple(value)
