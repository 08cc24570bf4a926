"""Read a robot file (YAML beside its URDF) into frozen records, strictly.

A table says for each mapping which keys it has and how each is read. Every complaint names the file and the
key, says what was given and what is valid.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from framework.errors import RobotFileError, check_unique
from framework.model.description import ParsedRobot, RobotDescription, Spring, locked_by_couplings
from framework.model.documents import LEADING_BLANKS, naming, parse_xml, parse_yaml
from framework.model.parameters import fill_placeholders, with_parameters
from framework.model.robot_keys import joint_dynamics, robot_table
from framework.model.urdf_edits import add_frame, free_root, lock_joints, virtual_link
from framework.model.urdf_elements import (
    MOVING,
    Tree,
    check_inertia,
    check_urdf,
    declared_couplings,
    declared_dynamics,
    locate_urdf,
)
from framework.numerics.fields import (
    Reader,
    Table,
    anything,
    entries,
    integer,
    list_of,
    mapping_of,
    number,
    one_of,
    optional,
    positive,
    read_table,
    record,
    required,
    text,
    vector3,
)
from framework.numerics.input import read_text

VERSION = 1


def read_robot_file(file: str | Path) -> RobotDescription:
    """Read the description in a robot file.

    Raises:
        RobotFileError: the file or its URDF is missing or malformed, or a key is unknown, missing,
            of the wrong type or length, not finite, or names something that the URDF does not have.
    """
    path = Path(file)
    text = read_text(path, f"{path}: cannot read the robot file", error=RobotFileError)
    with naming(path):
        text, parameters = with_parameters(text)
        return parse_robot(path, parse_yaml(text), parameters).description


def parse_robot(path: Path, content: Any, parameters: Mapping[str, float]) -> ParsedRobot:
    """Parse the content of the robot file `path` and of its URDF with `parameters`.

    Raises:
        RobotFileError: as `read_robot_file`, without the name of the file.
    """
    tree = read_table("", content, _TREE, others=None)
    urdf_text, root, urdf = _urdf(path.parent, tree, parameters)
    locked = tree["locked"]
    with naming(f"urdf: {tree['urdf']}"):
        mimicked = declared_couplings(root, locked)
    table = robot_table(urdf, is_coupled="couplings" in content or bool(mimicked), locked=tuple(locked))
    robot = read_table("", content, table, others=_TREE)
    coupled = [coupling.joint for coupling in robot["couplings"]]
    robot["couplings"] += tuple(coupling for coupling in mimicked if coupling.joint not in coupled)
    if further := locked_by_couplings(robot["couplings"], locked):
        return parse_robot(path, {**content, "locked": {**locked, **further}}, parameters)
    joints = robot.pop("joints")
    springs = _separate_springs(robot.pop("springs"), joints)
    robot["couplings"] = tuple(coupling for coupling in robot["couplings"] if coupling.joint not in locked)
    robot["reference"] = {name: q for name, q in robot["reference"].items() if name not in locked}
    joints = {name: entry for name, entry in joints.items() if name not in locked}
    description = RobotDescription(
        name=path.stem,
        file=path,
        urdf_text=urdf_text,
        springs=tuple(spring for spring in springs if spring.motion or spring.after not in locked),
        joints=joint_dynamics(declared_dynamics(root), joints),
        parameters=dict(parameters),
        **robot,
    )
    _check_scenes(description)
    _check_names(description, urdf)
    return ParsedRobot(description, root)


def _separate_springs(
    springs: Sequence[Spring | Mapping[str, Any]], joints: dict[str, dict[str, float]]
) -> list[Spring]:
    """Return the virtual joints among the springs; put a spring on a URDF joint into the joint's entry.

    Raises:
        RobotFileError: the joint has a spring already.
    """
    for spring in springs:
        if isinstance(spring, Spring):
            continue
        entry = joints.setdefault(spring["joint"], {})
        if "stiffness" in entry or "rest" in entry:
            raise RobotFileError(
                f"springs: joint {spring['joint']!r} has two springs of its own; add them up"
            )
        entry.update(stiffness=spring["stiffness"], rest=spring["rest"])
    return [spring for spring in springs if isinstance(spring, Spring)]


# ------------------------------------------------------------------ the tree


def _version(where: str, given: Any) -> int:
    """Read the version of a robot file; refuse all but `VERSION`."""
    version = integer(where, given)
    if version != VERSION:
        raise RobotFileError(f"{where}: got {version}, this program reads version {VERSION}")
    return version


_TREE: Table = {
    "version": required(_version),
    "urdf": required(text),
    "parameters": optional(anything, {}),  # read before the file is, see `parameters`
    "locked": optional(mapping_of(number), {}),
    "root": optional(one_of("root", ("fixed", "free")), "fixed"),
    "frames": optional(entries(anything), ()),
}


def _urdf(
    folder: Path, tree: Mapping[str, Any], parameters: Mapping[str, float]
) -> tuple[str, ElementTree.Element, Tree]:
    """Return the URDF with the robot file's changes, as text and parsed, and its names."""
    path = locate_urdf(folder, tree["urdf"])
    text = read_text(path, f"urdf: cannot read {path}", error=RobotFileError).lstrip(LEADING_BLANKS)
    with naming(f"urdf: {path}"):
        text = fill_placeholders(text, parameters)
        root = parse_xml(text)
    urdf, is_free = check_urdf(path, root), tree["root"] == "free"
    if not (tree["locked"] or is_free or tree["frames"]):
        return text, root, urdf
    lock_joints(root, tree["locked"])
    if is_free:
        free_root(root)
    read_frames = list_of(_added_frame(check_urdf(path, root)))
    for frame in read_frames("frames", list(tree["frames"])):
        add_frame(root, **frame)
    return ElementTree.tostring(root, encoding="unicode"), root, check_urdf(path, root)


def _added_frame(urdf: Tree) -> Reader[dict[str, Any]]:
    """Return a reader of a frame on a link, with a body of mass [kg] and inertia if stated."""
    table = {
        "name": required(text),
        "parent": required(one_of("link", urdf.links)),
        "xyz": optional(vector3, (0.0, 0.0, 0.0)),
        "rpy": optional(vector3, (0.0, 0.0, 0.0)),
        "mass": optional(positive),
        "inertia": optional(_moments),
    }

    def make(where: str, values: dict[str, Any]) -> dict[str, Any]:
        """Return the stated values; a body's inertia needs its mass."""
        if values["inertia"] is not None and values["mass"] is None:
            raise RobotFileError(f"{where}.inertia: needs a mass beside it")
        return {key: value for key, value in values.items() if value is not None}

    return record(table, make)


def _moments(where: str, given: Any) -> tuple[float, float, float]:
    """Read principal moments of inertia (3,) [kg m^2] that a body can have."""
    moments = vector3(where, given)
    check_inertia(where, np.diag(moments))
    return moments


# ------------------------------------------------------------------ what the keys say together


def _check_scenes(description: RobotDescription) -> None:
    """Check that a point of a path has one number for each coordinate of the platform."""
    axes = description.platform.names
    for name, scene in description.scenes.items():
        for i, point in enumerate(scene.points):
            if len(point) != len(axes):
                raise RobotFileError(
                    f"scenes.{name}.{scene.kind}[{i}]: needs {len(axes)} numbers, one for each axis of the "
                    f"platform ({', '.join(axes)}), got {list(point)}"
                )


def _check_names(description: RobotDescription, urdf: Tree) -> None:
    """Check that names are unique, and that no virtual joint takes a name of the URDF."""
    groups = {
        "actuators": description.motor_joints,
        "closures": [closure.name for closure in description.closures],
        "couplings": [coupling.joint for coupling in description.couplings],
        "springs": [name for spring in description.springs for name in spring.coordinates],
    }
    for key, names in groups.items():
        check_unique(key, names)
    for name in groups["springs"]:
        if name in urdf.joints:
            raise RobotFileError(f"springs: {name!r} is already a joint of the URDF")
        if virtual_link(name) in urdf.frames:
            raise RobotFileError(
                f"springs: {name!r} needs the name {virtual_link(name)!r}, taken in the URDF"
            )
    for actuator in description.actuators:
        kind = urdf.joints[actuator.joint].kind
        if kind not in MOVING:
            raise RobotFileError(
                f"actuators: joint {actuator.joint!r} is {kind}; a motor needs a revolute, continuous or "
                f"prismatic joint"
            )
