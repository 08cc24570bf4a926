"""URDFs with loops, in whichever of the ways that programs write them.

    <loop>, <coupling>              URDF+, see urdf_plus
    <constraint>                    the proposal for ROS, see ros_constraint
    <loop_joint>, <fixed_frame>     Isaac Sim, see loop_joint
    <drake:ball_constraint>         Drake: two bodies and a point of each
    <gazebo><joint>                 Gazebo: a joint of SDF between two links, see sdf
    links closing_NAME_1 and _2     onshape-to-robot, see onshape
    <mimic>                         a coupling of joints
    loop_closures.yaml beside it    hinges that sw2robot, an exporter of CAD for ROS 2, has cut

Motors are the joints with a transmission or a command interface of ros2_control, else likely those marked
`independent`; the file says nothing about the platform.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from framework.errors import RobotFileError, choose_from
from framework.fields import list_of, text, vector3
from framework.input import read_text
from framework.model.description import Closure, ParsedRobot, locked_axes
from framework.model.documents import naming, parse_yaml
from framework.model.placement import inverse, placement, turning
from framework.model.readers.describe import describe
from framework.model.readers.loop_joint import read_fixed_frame, read_loop_joint
from framework.model.readers.missing_fields import Options
from framework.model.readers.onshape import read_closing_frames
from framework.model.readers.ros_constraint import read_constraint
from framework.model.readers.sdf import Scope, read_cut_joint
from framework.model.readers.transmissions import Motor
from framework.model.readers.urdf_plus import read_coupling, read_loop
from framework.model.readers.urdf_tree import UrdfTree
from framework.model.xml_reading import attribute, numbers

LOOP_CLOSURES = "loop_closures.yaml"


def _ball_constraint(tree: UrdfTree, element: ElementTree.Element) -> Closure:
    """Read the closure of a `<drake:ball_constraint>`."""
    parts = {child.tag.rsplit("}", 1)[-1].removeprefix("ball_constraint_"): child for child in element}
    where, frames = "ball_constraint", []
    name = f"ball_{tree.extra.index(element) + 1}"
    for body, point in (("body_A", "p_AP"), ("body_B", "p_BQ")):
        for key in (body, point):
            if key not in parts:
                raise RobotFileError(f"<{where}>: {key} is missing")
        link = tree.link(f"<{where}> {body}", attribute(parts[body], f"<{where}> {body}", "name"))
        at = numbers(f"<{where}> {point}", parts[point].get("value"), 3)
        frames.append(tree.frame_at(f"{name}_{body[-1]}", link, placement(None, at)))
    return Closure(name, (frames[0], frames[1]), locked_axes("spherical"))


# by element: the dialect and what reads it; None of what adds no closure
_LOOPS: dict[str, tuple[str, Callable[[UrdfTree, ElementTree.Element], Closure | None]]] = {
    "loop": ("urdf+", read_loop),
    "coupling": ("urdf+", read_coupling),
    "constraint": ("ros", read_constraint),
    "loop_joint": ("loop_joint", read_loop_joint),
    "fixed_frame": ("loop_joint", read_fixed_frame),
    "ball_constraint": ("urdf", _ball_constraint),
}


def read_urdf(
    file: Path, root: ElementTree.Element, options: Options, beside: Mapping[str, Any] | None = None
) -> ParsedRobot:
    """Read the description in a URDF with loops; `beside` is the content of a loop_closures.yaml.

    Raises:
        RobotFileError: names the element.
    """
    independent = [
        joint.get("name", "")
        for joint in root.findall("joint")
        if joint.get("independent", "").lower() in ("true", "1")
    ]
    tree = UrdfTree(root, tuple(_LOOPS))
    loops = [(*_LOOPS[tag], element) for tag, element in zip(tree.extra_tags, tree.extra, strict=True)]
    closures = [closure for _, read, element in loops if (closure := read(tree, element)) is not None]
    closures += _gazebo_joints(tree)
    framed = read_closing_frames(tree)
    if beside is None:
        beside = _loop_closures_beside(file)
    closures += [*framed, *_listed(tree, beside)]
    if not closures and not loops and root.find("joint/mimic") is None:
        raise RobotFileError(
            "a URDF without loops: declare them in it (<loop> of URDF+, <constraint> of ROS, <loop_joint> of "
            "Isaac Sim, <mimic>, links closing_X_1 and closing_X_2 of onshape-to-robot) or in a YAML file "
            "beside it (ours, or Gepetto's with closed_loop), and give that file"
        )
    dialect = loops[0][0] if loops else "onshape" if framed else "urdf"
    for name in tree.motors:
        if dialect == "ros" and name not in tree.movable:
            raise RobotFileError(f"transmission: {choose_from('movable joint', name, tree.movable)}")
    motors = [Motor.on(name) for name in tree.motors if name in tree.movable]
    likely = [*independent, *beside.get("independent", [])]
    return describe(tree, file, options, closures, motors=motors, likely_motors=likely)._replace(
        dialect=dialect
    )


def _gazebo_joints(tree: UrdfTree) -> list[Closure]:
    """Return the closures of the joints that Gazebo adds to the tree."""
    joints = [joint for joint in tree.root.findall("gazebo/joint") if joint.find("child") is not None]
    scope = Scope(version=np.inf)
    for link in tree.links:
        scope.links[link] = ElementTree.Element("link")
        scope.relative[link] = ("world", tree.at_zero(link))
    return [read_cut_joint(scope, tree, joint) for joint in joints]


def _loop_closures_beside(file: Path) -> Mapping[str, Any]:
    """Return the content of a loop_closures.yaml beside a URDF or in the package around it; empty without."""
    folder = file.parent
    for path in (folder / LOOP_CLOSURES, *(folder.parent / name / LOOP_CLOSURES for name in ("", "config"))):
        if path.is_file():
            with naming(path):
                content = parse_yaml(read_text(path, "cannot read it", error=RobotFileError))
                return content if isinstance(content, dict) else {}
    return {}


def _listed(tree: UrdfTree, content: Mapping[str, Any]) -> list[Closure]:
    """Return the hinges of a loop_closures.yaml: point and axis in the frame of the root link at zero."""
    closures = []
    for i, entry in enumerate(list_of(lambda _, given: dict(given))("closures", content.get("closures", []))):
        where = f"{LOOP_CLOSURES}: closures[{i}]"
        links = [tree.link(f"{where}.{key}", text(where, entry.get(key))) for key in ("link_a", "link_b")]
        axis = np.array(vector3(f"{where}.axis", entry.get("axis")))
        if not axis.any():
            raise RobotFileError(f"{where}.axis: the axis is zero")
        hinge = placement(turning("z", axis), vector3(f"{where}.point", entry.get("point")))
        frames = [
            tree.frame_at(f"loop_{i + 1}_{end}", link, inverse(tree.at_zero(link)) @ hinge)
            for end, link in zip("ab", links, strict=True)
        ]
        closures.append(Closure(f"loop_{i + 1}", (frames[0], frames[1]), locked_axes("revolute")))
    return closures


def urdf_of_closures(path: Path) -> Path:
    """Return the URDF that a loop_closures.yaml is of: the only one beside it or in the package."""
    for folder in (path.parent, path.parent / "urdf", path.parent.parent / "urdf"):
        urdfs = list(folder.glob("*.urdf"))
        if len(urdfs) == 1:
            return urdfs[0]
    raise RobotFileError("a list of closures: give the URDF that they are of")
