"""Read the pair robot.urdf + robot.yaml of "Extended URDF: Accounting for parallel mechanism in robot
description" (Batto, de Matteis, Mansard 2025; Gepetto's example-parallel-robots).

    closed_loop: [[frame_A, frame_B], ...]     frames that coincide
    type: [3d, 6d, ...]                        for each pair: the origins coincide (3d), or the frames (6d)
    name_mot: [joint, ...]                     joints with a motor
    joint_name: [joint, ...]                   joints whose type in the URDF is not the true one ...
    joint_type: [SPHERICAL, UJOINT_XY, FIXED]  ... and their true types

A joint J of type UJOINT_XY becomes two hinges, J_X and J_Y. The file says nothing about the platform.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from framework.errors import RobotFileError, check_name, check_unique, short
from framework.model.description import Closure, locked_axes
from framework.model.readers.describe import Options, describe
from framework.model.readers.urdf_tree import UrdfTree
from framework.model.urdf_elements import ParsedRobot
from framework.numerics.fields import Table, list_of, one_of, optional, read_table, required, text

KEYS = ("closed_loop", "type", "name_mot", "joint_name", "joint_type")
# closure kinds by the types of pairs
_KIND_OF_TYPE = {"3d": "spherical", "3D": "spherical", "6d": "fixed", "6D": "fixed"}
_U_JOINTS = ("UJOINT_XY", "UJOINT_XZ", "UJOINT_YX", "UJOINT_YZ", "UJOINT_ZX", "UJOINT_ZY")
_TRUE_TYPES: Table = dict.fromkeys(("joint_name", "joint_type"), optional(list_of(text), ()))


def read_pair(file: Path, content: Mapping[Any, Any], tree: UrdfTree, options: Options) -> ParsedRobot:
    """Read the robot in a robot.yaml and the tree of a URDF.

    Args:
        file: the robot.yaml.
        content: of this file.
        tree: of the URDF.
        options: of the reader.

    Raises:
        InvalidInput: a key is missing or unknown, or its value is of another type or names what the URDF does
            not have.
        RobotFileError: lists differ in length; a pair has not two frames; see `describe`.
    """
    _replace_joints(tree, **read_table("", content, _TRUE_TYPES, others=KEYS))  # changes the tree's frames
    table = {
        "closed_loop": required(list_of(list_of(one_of("frame", tree.frames)), least=1)),
        "type": required(list_of(one_of("type", _KIND_OF_TYPE))),
        "name_mot": optional(list_of(one_of("movable joint", tree.movable)), ()),
    }
    values = read_table("", content, table, others=KEYS)
    pairs, kinds, motors = values["closed_loop"], values["type"], values["name_mot"]
    _check_count("type", kinds, "pair of closed_loop", pairs)
    for i, (frames, kind) in enumerate(zip(pairs, kinds, strict=True)):
        if len(frames) != 2:
            raise RobotFileError(f"closed_loop[{i}]: needs two frames, got {short(frames)}")
        tree.closures.append(Closure("-".join(frames), frames, locked_axes(_KIND_OF_TYPE[kind])))
    check_unique("name_mot", motors)
    for motor in motors:
        tree.add_motor(motor)
    return describe(tree, file, options, "gepetto")


def _check_count(key: str, entries: Sequence[str], what: str, others: Sequence[Any]) -> None:
    """Refuse two lists of different lengths.

    In the message `key` names the list `entries`, and `what` names one entry of `others`.
    """
    if len(entries) != len(others):
        raise RobotFileError(f"{key}: needs one entry a {what} ({len(others)}), got {len(entries)}")


def _replace_joints(tree: UrdfTree, joint_name: Sequence[str], joint_type: Sequence[str]) -> None:
    """Replace joints of the URDF by joints of their true types, as the two lists of the file say."""
    _check_count("joint_type", joint_type, "joint of joint_name", joint_name)
    check_unique("joint_name", joint_name)
    for i, (name, kind) in enumerate(zip(joint_name, map(str.upper, joint_type), strict=True)):
        check_name(f"joint_name[{i}]", "joint", name, tree.joints)
        check_name(f"joint_type[{i}]", "joint type", kind, ("FIXED", "SPHERICAL", *_U_JOINTS))
        joint = tree.joints[name]
        if kind == "FIXED":
            tree.fix(joint)
        elif kind == "SPHERICAL":
            tree.put(replace(joint, kind="spherical", limits=None, mimic=None, element=None))
        else:
            letters = kind.removeprefix("UJOINT_")
            tree.replace_by_turns(joint, letters.lower(), [f"{name}_{letter}" for letter in letters])
