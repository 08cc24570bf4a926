"""Which dialect a file is written in, and the description in it."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from framework.errors import RobotFileError, choose_from, short
from framework.model.description import RobotDescription
from framework.model.readers import gepetto, ros_constraint, urdf_plus
from framework.model.readers.missing_fields import Options, checked_reference, resolve
from framework.model.readers.mjcf import read_mjcf
from framework.model.readers.ros_constraint import read_ros_constraint
from framework.model.readers.sdf import raise_for_sdf
from framework.model.readers.urdf_plus import read_urdf_plus
from framework.model.readers.urdf_tree import UrdfTree
from framework.model.robot_file import read_robot_file

DIALECTS = {
    "robot file": "our own YAML beside a URDF",
    "gepetto": "the pair robot.urdf + robot.yaml of Extended URDF (key closed_loop)",
    "urdf+": "URDF with <loop> and <coupling>",
    "ros": "URDF with <constraint> (urdfdom pull request 264)",
    "mjcf": "MuJoCo's XML with <equality>",
}
LARGEST_FILE = 10_000_000  # bytes
LARGEST_YAML_TEXT = 500_000  # characters
LARGEST_YAML = 20_000  # nodes, aliases written out
_BLANK = "\ufeff \t\r\n"
_OWN_KEYS = ("version", "urdf", "platform", "actuators", "closures")


def read_any(
    file: str | Path,
    *,
    platform: str | None = None,
    axes: Sequence[str] | None = None,
    motors: Sequence[str] | None = None,
    reference: Mapping[str, float] | None = None,
) -> RobotDescription:
    """The description in a file of any dialect, recognised by its content.

    The options say what a foreign file does not, and overrule what it does: the `platform` frame and
    its `axes`, the joints that are `motors`, and a `reference` [rad, m] where the file's zero pose is not
    near the wanted one. For a pair of Gepetto give the YAML or the folder of the two.

    Raises:
        RobotFileError: the file cannot be read, is of no known dialect, is malformed, says something
            the records cannot hold, or leaves something unsaid that no option says.
    """
    path = Path(file)
    options = Options(
        platform,
        None if axes is None else tuple(axes),
        None if motors is None else tuple(motors),
        dict(reference or {}),
    )
    if path.is_dir():
        path = _pair_in(path)
    text = _text(path)
    is_xml = text.lstrip(_BLANK).startswith("<")
    if path.suffix.lower() in (".urdf", ".xml", ".mjcf", ".sdf") and not is_xml:
        raise RobotFileError(f"{path}: not well-formed XML: it does not begin with <")
    try:
        if is_xml:
            return _from_xml(path, text, options)
        return _from_yaml(path, text, options)
    except RecursionError:
        raise RobotFileError(f"{path}: nested too deeply") from None
    except RobotFileError as error:
        message = str(error)
        raise RobotFileError(message if message.startswith(f"{path}: ") else f"{path}: {message}") from None


def dialect_of(file: str | Path) -> str:
    """Which of DIALECTS a file is written in, by its content.

    Raises:
        RobotFileError: it cannot be read, or is of none of them.
    """
    path = Path(file)
    path = _pair_in(path) if path.is_dir() else path
    text = _text(path)
    try:
        if text.lstrip(_BLANK).startswith("<"):
            return _dialect_of_xml(parse_xml(text))
        return _dialect_of_yaml(parse_yaml(text))
    except RecursionError:
        raise RobotFileError(f"{path}: nested too deeply") from None
    except RobotFileError as error:
        raise RobotFileError(f"{path}: {error}") from None


def _dialect_of_xml(root: ElementTree.Element) -> str:
    if root.tag == "sdf":
        raise_for_sdf()
    if root.tag == "mujoco":
        return "mjcf"
    if root.tag != "robot":
        raise RobotFileError(f"unknown dialect: {choose_from('root element', root.tag, ('robot', 'mujoco'))}")
    plus = any(root.find(tag) is not None for tag in urdf_plus.ELEMENTS)
    ros = any(root.find(tag) is not None for tag in ros_constraint.ELEMENTS)
    if plus and ros:
        raise RobotFileError("mixes two dialects: <loop> or <coupling> (URDF+) with <constraint> (ROS)")
    if plus or ros:
        return "urdf+" if plus else "ros"
    UrdfTree(root)  # a mistyped element is the likelier complaint
    raise RobotFileError(
        "a URDF without loops: declare them in it (<loop> of URDF+, <constraint> of ROS) or in a YAML file "
        "beside it (ours, or Gepetto's with closed_loop), and give that file"
    )


def _dialect_of_yaml(content: Any) -> str:
    if not isinstance(content, dict):
        raise RobotFileError(f"needs a mapping of keys, got {short(content)}")
    if any(key in content for key in _OWN_KEYS):
        return "robot file"
    if any(key in content for key in gepetto.KEYS):
        return "gepetto"
    valid = ", ".join(map(short, content)) or "nothing"
    raise RobotFileError(
        f"unknown dialect: has neither version (our robot file) nor closed_loop (Gepetto); given: {valid}"
    )


def _from_xml(path: Path, text: str, options: Options) -> RobotDescription:
    root = parse_xml(text)
    read = {"mjcf": read_mjcf, "urdf+": read_urdf_plus, "ros": read_ros_constraint}
    return read[_dialect_of_xml(root)](path, root, options)


def _from_yaml(path: Path, text: str, options: Options) -> RobotDescription:
    content = parse_yaml(text)
    if _dialect_of_yaml(content) == "robot file":
        return _own(path, options)
    urdf = path.with_suffix(".urdf")
    try:
        tree = UrdfTree(parse_xml(_text(urdf)))
    except RobotFileError as error:
        raise RobotFileError(f"{urdf.name}: {str(error).removeprefix(f'{urdf}: ')}") from None
    return gepetto.read_pair(path, content, tree, options)


def _own(path: Path, options: Options) -> RobotDescription:
    """Our robot file; options overrule it."""
    description = read_robot_file(path)
    root = ElementTree.fromstring(description.urdf_text)
    joints = [
        joint.get("name", "") for joint in root.findall("joint") if joint.get("type") not in ("fixed", None)
    ]
    said = resolve(
        options,
        frames=[element.get("name", "") for tag in ("link", "joint") for element in root.findall(tag)],
        joints=joints,
        platform=description.platform,
        actuators=description.actuators,
    )
    reference = checked_reference(options, joints, description.reference)
    return replace(description, platform=said.platform, actuators=said.actuators, reference=reference)


# ------------------------------------------------------------------ text, XML, YAML, within limits


def _pair_in(folder: Path) -> Path:
    found = [folder / name for name in ("robot.yaml", f"{folder.resolve().name}.yaml")]
    for path in found:
        if path.is_file():
            return path
    names = " or ".join(path.name for path in found)
    raise RobotFileError(f"{folder}: a folder without {names}, and without the plan.json of a plan")


def _text(path: Path) -> str:
    try:
        if path.exists() and not path.is_file():
            raise RobotFileError(f"{path}: not a file")
        size = os.path.getsize(path)
        if size > LARGEST_FILE:
            raise RobotFileError(f"{path}: {size} bytes; at most {LARGEST_FILE} are read")
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise RobotFileError(f"{path}: cannot read it: not UTF-8 text") from None
    except (OSError, ValueError) as error:
        raise RobotFileError(f"{path}: cannot read it: {getattr(error, 'strerror', None) or error}") from None


def parse_xml(text: str) -> ElementTree.Element:
    """The root of an XML text without a document type.

    Raises:
        RobotFileError: it has one (entities can grow without bound), or is not well-formed.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise RobotFileError("<!DOCTYPE>: document types and entities are not read; leave them out")
    try:
        return ElementTree.fromstring(text.lstrip(_BLANK))
    except (ElementTree.ParseError, ValueError) as error:
        raise RobotFileError(f"not well-formed XML: {error}") from None


def parse_yaml(text: str) -> Any:
    """The content of a YAML text, if it is of a sensible size with its aliases written out.

    Raises:
        RobotFileError: it is not, or is no YAML.
    """
    if len(text) > LARGEST_YAML_TEXT:
        raise RobotFileError(f"{len(text)} characters of YAML; at most {LARGEST_YAML_TEXT} are read")
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        if node is not None and _size(node, {}) > LARGEST_YAML:
            raise RobotFileError(f"aliases: more than {LARGEST_YAML} values when written out, or endless")
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise RobotFileError(f"not valid YAML: {' '.join(str(error).split())}") from None
    except (ValueError, TypeError, OverflowError, AttributeError) as error:  # PyYAML on odd scalars and keys
        raise RobotFileError(f"not valid YAML: {' '.join(str(error).split())}") from None


def _size(node: yaml.Node, known: dict[int, int]) -> int:
    """Values of a node with its aliases written out; an alias of itself counts as too many."""
    if id(node) in known:
        return known[id(node)]
    known[id(node)] = LARGEST_YAML + 1  # for those met again below themselves
    total = 1
    if isinstance(node, yaml.SequenceNode):
        total += sum(_size(child, known) for child in node.value)
    elif isinstance(node, yaml.MappingNode):
        keys: set[str] = set()
        for key, value in node.value:
            total += _size(key, known) + _size(value, known)
            if isinstance(key, yaml.ScalarNode):
                if key.value in keys:
                    raise RobotFileError(f"{short(key.value)}: the key is there twice")
                keys.add(key.value)
    known[id(node)] = total
    return total
