"""Recognise the dialect of a file, and read the robot in it.

Readers of foreign dialects are imported only when a file may be in their dialect, since most files are ours.
"""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

from framework.errors import InvalidInput, MissingPackage, RobotFileError, check_name, expect, short
from framework.model.description import RobotDescription
from framework.model.documents import LEADING_BLANKS, parse_xml, parse_yaml, prefix_errors
from framework.model.parameters import fill_parameters
from framework.model.readers.describe import Options, PartialRobot, complete_robot, merge_reference
from framework.model.readers.urdf_tree import UrdfTree, read_urdf_tree
from framework.model.robot_file import parse_robot
from framework.model.urdf_elements import ParsedRobot
from framework.numerics.input import read_text

DIALECTS = {
    "robot file": "our own YAML beside a URDF",
    "gepetto": "the pair robot.urdf + robot.yaml of Extended URDF (key closed_loop)",
    "urdf+": "URDF with <loop> and <coupling>",
    "ros": "URDF with <constraint> (urdfdom pull request 264)",
    "loop_joint": "URDF with <loop_joint> (Isaac Sim)",
    "mjcf": "MuJoCo's XML with <equality>",
    "sdf": "SDFormat, whose joints close loops",
    "urdf": "URDF with <mimic>, or loops of Gazebo, Drake or loop_closures.yaml",
    "onshape": "URDF of onshape-to-robot with frames closing_NAME_1 and closing_NAME_2",
}
_USD_REFUSAL = (
    "USD is not read; write it as URDF or MJCF first, with the exporters of Isaac Sim or Newton, and declare "
    "there the loops that they cut"
)
_OTHER_FILES = {  # what a file is, by how it begins in lower case
    "#usda": _USD_REFUSAL,
    "version https://git-lfs": "a pointer of Git LFS: `git lfs pull` in its repository fetches the file",
    "<!doctype html": "a page of HTML: download the file itself",
    "<html": "a page of HTML: download the file itself",
}
_LIST_OPTIONS = ("axes", "motors", "platform_joints")  # options that are lists of names
_MAPPING_OPTIONS = ("parameters", "reference", "locked")
_OWN_KEYS = ("version", "urdf", "platform", "actuators", "closures")  # of our robot file


def read_any(file: str | Path, **options: Any) -> RobotDescription:
    """Read the description in a file of any dialect, with the options of `parse_any`.

    Raises:
        RobotFileError: see `parse_any`.
    """
    return parse_any(file, **options).description


def parse_any(
    file: str | Path, *, parameters: Mapping[str, float] | None = None, **options: Any
) -> ParsedRobot:
    """Read a file of any dialect, recognised by its content.

    Args:
        file: a file; for a pair of Gepetto its YAML or the folder of both files.
        parameters: replace values that a robot file of ours declares.
        options: the fields of `Options`, which complete a foreign file and override it:

            * `platform`: its frame;
            * `axes` or `platform_joints`: the platform's coordinates, along base axes or of joints;
            * `motors`: the motors' joints;
            * `reference`: joint positions [rad, m] near an assembled pose, by default those that the file
              states, else zero;
            * `locked`: positions [rad, m] of joints to lock; None stands for the reference;
            * `base`: a link; all joints that the link does not carry are locked at the reference;
            * `closures`: loops to close, as words: two frames, a kind, and the axis or length of the joint;
            * `packages`: folders NAME=FOLDER of the meshes of package://NAME/;
            * `propose`: a function that completes what is still missing.

    Raises:
        RobotFileError: the file cannot be read, is of no known dialect, is malformed, has content that the
            records cannot express, or leaves out something that no option completes.
    """
    path = Path(file)
    for key, value in {"parameters": parameters, **options}.items():
        if key in _MAPPING_OPTIONS and value is not None:
            expect(key, value, Mapping, '{"knee": 0.5}')
    stated: dict[str, Any] = {
        name: tuple(value) if name in _LIST_OPTIONS else value
        for name, value in options.items()
        if value is not None
    }
    chosen = Options(**stated)
    if os.path.isdir(path):
        path = _find_pair(path)
    if path.name == "plan.json":
        raise RobotFileError(f"{path}: is of a plan, which is given by its folder, {path.parent}")
    text = read_text(path, f"{path}: cannot read it", error=RobotFileError)
    if path.suffix.lower() in (".usd", ".usda", ".usdc", ".usdz"):
        raise RobotFileError(f"{path}: {_USD_REFUSAL}")
    beginning = text.lstrip(LEADING_BLANKS)[:99].lower()
    if not beginning:
        raise RobotFileError(f"{path}: is empty")
    for start, words in _OTHER_FILES.items():
        if beginning.startswith(start):
            raise RobotFileError(f"{path}: {words}")
    is_xml = beginning.startswith("<")
    if path.suffix.lower() in (".urdf", ".xml", ".mjcf", ".sdf") and not is_xml:
        raise RobotFileError(f"{path}: not well-formed XML: it does not begin with <")
    with prefix_errors(path):
        if not is_xml:
            return _from_yaml(path, text, chosen, parameters)
        if parameters:
            raise RobotFileError("parameters: only robot files of ours have some")
        return _from_xml(path, text, chosen)


def _from_xml(path: Path, text: str, options: Options) -> ParsedRobot:
    """Read an XML file, whose content is `text`, with the reader of its root element.

    Errors begin with the line of the element that they name.
    """
    from framework.model.readers.mjcf import read_mjcf
    from framework.model.readers.sdf import read_sdf
    from framework.model.readers.urdf import read_urdf

    readers = {"robot": read_urdf, "mujoco": read_mjcf, "sdf": read_sdf, "gazebo": read_sdf}
    root = parse_xml(text)
    if root.tag == "mujocoinclude":
        raise RobotFileError("<mujocoinclude>: a part that MuJoCo's files include: give one that includes it")
    check_name("unknown dialect", "root element", root.tag, readers)
    try:
        return readers[root.tag](path, root, options)
    except MissingPackage:
        raise
    except InvalidInput as error:
        raise RobotFileError(f"{_line_of_element(str(error), text)}{error}") from None


def _line_of_element(message: str, text: str) -> str:
    """Return "line N: " for the element in `text` that a message begins with, or ""."""
    named = re.match(r"(?:<\w+>: )?<?(\w+)>? '([^']+)'", message)  # tag and name, as in "joint 'hip': ..."
    if named is None:
        return ""
    tag, name = named.groups()
    element = re.search(rf"<{tag}\b[^<>]*?\bname\s*=\s*[\"']{re.escape(name)}[\"']", text)
    if element is None:
        return ""
    line = text.count("\n", 0, element.start()) + 1
    return f"line {line}: "


def _from_yaml(
    path: Path, text: str, options: Options, parameters_given: Mapping[str, float] | None
) -> ParsedRobot:
    """Read a YAML file and its URDF, in the dialect that the keys of the YAML belong to.

    Args:
        path: of the YAML.
        text: of the YAML.
        options: of the reader.
        parameters_given: replace values that a robot file of ours declares.
    """
    text, parameters = fill_parameters(text, parameters_given)
    content = parse_yaml(text)
    if not isinstance(content, dict):
        raise RobotFileError(f"needs a mapping of keys, got {short(content)}")
    if "closures" in content and content.keys().isdisjoint(("version", "urdf", "platform")):
        from framework.model.readers.urdf import read_urdf

        urdf = _find_urdf(path)
        if not urdf.is_file():
            raise RobotFileError("a list of closures: give the URDF that they are of")
        with prefix_errors(urdf.name):
            return read_urdf(urdf, _parse_urdf(urdf), options, content)
    if not content.keys().isdisjoint(_OWN_KEYS):
        return _complete_own_file(parse_robot(path, content, parameters), options)
    from framework.model.readers import gepetto

    if content.keys().isdisjoint(gepetto.KEYS):
        keys = ", ".join(map(short, content)) or "nothing"
        raise RobotFileError(
            f"unknown dialect: has neither version (our robot file) nor closed_loop (Gepetto); given: {keys}"
        )
    urdf = _find_urdf(path)
    with prefix_errors(urdf.name):
        tree, _ = read_urdf_tree(_parse_urdf(urdf), base=options.base)
    tree.left_out = [item._replace(what=f"{urdf.name}: {item.what}") for item in tree.left_out]
    return gepetto.read_pair(path, content, tree, options)


def _parse_urdf(urdf: Path) -> Element:
    """Return the root of a URDF."""
    return parse_xml(read_text(urdf, "cannot read it", error=RobotFileError))


def _find_urdf(path: Path) -> Path:
    """Find the URDF of a foreign YAML: the one of the same name, else the only one nearby."""
    namesake = path.with_suffix(".urdf")
    if os.path.isfile(namesake):
        return namesake
    for folder in (path.parent, path.parent / "urdf", path.parent.parent / "urdf"):
        others = list(folder.glob("*.urdf"))
        if len(others) == 1:
            return others[0]
    return namesake  # the caller reports that it is missing


def _complete_own_file(robot: ParsedRobot, options: Options) -> ParsedRobot:
    """Complete a robot of our own file by the options."""
    said_by = {
        "--base": (options.base, "the key locked"),
        "--lock": (options.locked, "the key locked"),
        "--close": (options.closures, "the key closures"),
        "--package": (options.packages, "the paths of its meshes in its URDF"),
    }
    for option, (value, part) in said_by.items():
        if value:
            raise RobotFileError(f"{option}: for files of foreign dialects; a robot file of ours has {part}")
    if options == Options():
        return robot
    description = robot.description
    tree = UrdfTree(robot.tree)
    reference = merge_reference(options, tree.coordinates, description.reference)
    description = replace(description, reference=reference)
    completed = complete_robot(options, PartialRobot(tree, description, description.platform))
    return robot._replace(description=completed.description)


def _find_pair(folder: Path) -> Path:
    """Find the YAML of a pair in a folder: robot.yaml, else the one named like the folder."""
    names = ("robot.yaml", f"{os.path.basename(os.path.realpath(folder))}.yaml")
    for name in names:
        if os.path.isfile(folder / name):
            return folder / name
    if os.path.isfile(folder / "plan.json"):
        quoted = shlex.quote(str(folder))
        raise RobotFileError(
            f"{folder}: holds a plan, where a robot is needed: give its name or its file; "
            f"torques of the plan itself: `crossing export {quoted} --to csv --at 0 --out -` "
            f"or load_plan({str(folder)!r}).torque(t) in Python"
        )
    raise RobotFileError(
        f"{folder}: a folder without {' or '.join(names)}, and without the plan.json of a plan"
    )
