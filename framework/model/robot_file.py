"""Read a robot file (YAML beside a URDF) into frozen records, strictly.

Every error names the file and the key, the value found there, and the valid values.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any
from xml.etree.ElementTree import tostring

from framework.errors import RobotFileError, check_unique
from framework.model.description import JointDynamics, LineSpring, RobotDescription, Spring, lock_couplings
from framework.model.documents import LEADING_BLANKS, parse_xml, parse_yaml, prefix_errors
from framework.model.parameters import PLACEHOLDER, fill_parameters, fill_placeholders
from framework.model.placement import from_rpy, placement
from framework.model.robot_keys import TREE, RobotReader
from framework.model.urdf_edits import add_frame, free_root, lock_joints, urdf_root, virtual_link_name
from framework.model.urdf_elements import (
    MOVING,
    ParsedRobot,
    Tree,
    declared_couplings,
    declared_dynamics,
    locate_urdf,
    read_tree,
)
from framework.numerics.fields import list_of, read_table
from framework.numerics.input import read_text


def read_robot_file(file: str | Path, given: Mapping[str, float] | None = None) -> RobotDescription:
    """Read the description in a robot file, with `given` values of some of its parameters.

    Raises:
        RobotFileError: the file or its URDF is missing or malformed; a key is missing or unknown; a value has
            the wrong type or length, is not finite, or names something that the URDF does not have.
    """
    path = Path(file)
    text = read_text(path, f"{path}: cannot read the robot file", error=RobotFileError)
    with prefix_errors(path):
        text, parameters = fill_parameters(text, given)
        return parse_robot(path, parse_yaml(text), parameters).description


def unused_parameters(description: RobotDescription) -> list[str]:
    """Return the parameters of a robot file that neither it nor its URDF uses."""
    if not description.parameters:
        return []
    file = description.file
    text = read_text(file, f"{file}: cannot read the robot file", error=RobotFileError)
    urdf = locate_urdf(file.parent, parse_yaml(PLACEHOLDER.sub("0", text))["urdf"])
    text += read_text(urdf, f"{urdf}: cannot read it", error=RobotFileError)
    used = {word for expression in PLACEHOLDER.findall(text) for word in re.findall(r"\w+", expression)}
    return [name for name in description.parameters if name not in used]


def parse_robot(path: Path, content: Any, parameters: Mapping[str, float]) -> ParsedRobot:
    """Parse the content of the robot file `path` and of its URDF.

    First the keys of the tree are read (TREE), which change the URDF. Then the other keys are read, since
    they name joints and links of the changed URDF.

    Args:
        path: of the robot file; nothing is read there.
        content: of the YAML.
        parameters: values for the placeholders in the URDF.

    Raises:
        RobotFileError: as `read_robot_file`, without the name of the file in the message.
    """
    values = read_table("", content, TREE, others=None)
    text, tree = _read_urdf(path.parent, values, parameters)
    return describe_tree(path, text, tree, content, parameters, values["locked"])


def describe_tree(
    path: Path,
    text: str,
    tree: Tree,
    content: Mapping[str, Any],
    parameters: Mapping[str, float],
    locked: Mapping[str, float] = MappingProxyType({}),
) -> ParsedRobot:
    """Read the keys of a robot file on a tree, and make the description.

    Args:
        path: of the robot file.
        text, tree: the URDF, and its links and joints.
        content: of the robot file; the keys in TREE are not read.
        parameters: with which placeholders were filled.
        locked: positions [rad, m] by name of joints that are fixed in `tree`.

    Raises:
        RobotFileError: as `read_robot_file`, without the name of the file in the message.
    """
    with prefix_errors(f"urdf: {content.get('urdf', path.name)}"):
        mimics = declared_couplings(tree, locked)

    is_coupled = "couplings" in content or bool(mimics)
    table = RobotReader(tree, locked).table(is_coupled=is_coupled)
    robot = read_table("", content, table, others=TREE)
    coupled = [coupling.joint for coupling in robot["couplings"]]  # these override the URDF's mimics
    couplings = [*robot["couplings"], *(mimic for mimic in mimics if mimic.joint not in coupled)]

    remaining, coupled_to_locked = lock_couplings(couplings, locked)
    if coupled_to_locked:
        # start again: joints that follow locked ones are locked, too
        return parse_robot(path, {**content, "locked": {**locked, **coupled_to_locked}}, parameters)
    robot["couplings"] = tuple(remaining)
    _sort_springs(robot, locked)
    for key in ("reference", "joints"):
        robot[key] = {name: value for name, value in robot[key].items() if name not in locked}

    joints = declared_dynamics(tree)  # which the file overrides
    for name, values in robot["joints"].items():
        joints[name] = replace(joints.get(name, JointDynamics()), **values)
    robot |= {"joints": joints, "parameters": dict(parameters)}
    description = RobotDescription(name=path.stem, file=path, urdf_text=text, **robot)
    axes = description.platform.names
    for name, scene in description.scenes.items():
        for i, point in enumerate(scene.points):
            if len(point) != len(axes):
                raise RobotFileError(
                    f"scenes.{name}.{scene.kind}[{i}]: needs {len(axes)} numbers, one for each axis of the "
                    f"platform ({', '.join(axes)}), got {list(point)}"
                )
    _check_names(description, tree)
    return ParsedRobot(description, tree)


def _sort_springs(robot: dict[str, Any], locked: Mapping[str, float]) -> None:
    """Separate springs between points, and move those along URDF joints into the entries of `joints`.

    Springs of joints that are locked are dropped. `robot` has the values of the file's keys and is changed;
    `locked` are the positions of locked joints.
    """
    springs, line_springs = [], []
    for spring in robot["springs"]:
        if isinstance(spring, LineSpring):
            line_springs.append(spring)
        elif isinstance(spring, Spring):
            # without axes of its own it moves like its joint, and is locked with the joint
            springs += [spring] if spring.motion or spring.after not in locked else []
        elif spring["joint"] not in locked:
            entry = robot["joints"].setdefault(spring["joint"], {})
            if "stiffness" in entry or "rest" in entry:
                raise RobotFileError(
                    f"springs: joint {spring['joint']!r} has two springs of its own; add them up"
                )
            entry.update(stiffness=spring["stiffness"], rest=spring["rest"])
    robot.update(springs=tuple(springs), line_springs=tuple(line_springs))


# ------------------------------------------------------------------ the tree


def _read_urdf(folder: Path, values: Mapping[str, Any], parameters: Mapping[str, float]) -> tuple[str, Tree]:
    """Read the URDF, and lock joints, free the root and add frames as the robot file says.

    Args:
        folder: of the robot file.
        values: of the keys in TREE.
        parameters: values for the placeholders in the URDF.

    Returns:
        The text of the URDF, and its links and joints.
    """
    path = locate_urdf(folder, values["urdf"])
    text = read_text(path, f"urdf: cannot read {path}", error=RobotFileError).lstrip(LEADING_BLANKS)
    with prefix_errors(f"urdf: {path}"):
        text = fill_placeholders(text, parameters)
        tree = read_tree(parse_xml(text))
    if not (values["locked"] or values["root"] == "free" or values["frames"]):
        return text, tree  # the text as it is in the file
    lock_joints(tree, values["locked"])
    if values["root"] == "free":
        free_root(tree)
    for frame in list_of(RobotReader(tree).added_frame)("frames", values["frames"]):
        origin = placement(from_rpy(frame.pop("rpy")), frame.pop("xyz"))
        with prefix_errors(f"urdf: {path}"):  # the name of an added frame may be taken
            add_frame(tree, origin=origin, **frame)  # `frame` has the other arguments
    root = urdf_root(tree)
    return tostring(root, encoding="unicode"), read_tree(root)  # with the numbers of the text


# ------------------------------------------------------------------ checks across keys


def _check_names(description: RobotDescription, urdf: Tree) -> None:
    """Refuse repeated names, names in use in the URDF, and motors on joints without exactly one freedom."""
    virtual_joints = [name for spring in description.springs for name in spring.coordinates]
    check_unique("actuators", description.motor_joints)
    check_unique("closures", [closure.name for closure in description.closures])
    check_unique("couplings", [coupling.joint for coupling in description.couplings])
    check_unique("springs", [*virtual_joints, *(spring.label for spring in description.line_springs)])
    for name in virtual_joints:
        if name in urdf.joints:
            raise RobotFileError(f"springs: {name!r} is already a joint of the URDF")
        link = virtual_link_name(name)
        if link in urdf.frames:
            raise RobotFileError(f"springs: {name!r} needs the name {link!r}, taken in the URDF")
    for joint in description.motor_joints:
        kind = urdf.joints[joint].kind
        if kind not in MOVING:
            raise RobotFileError(
                f"actuators: joint {joint!r} is {kind}; a motor needs a revolute, continuous or prismatic "
                f"joint"
            )
