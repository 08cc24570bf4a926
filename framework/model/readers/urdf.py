"""Read URDFs with loops, in the syntaxes of several programs.

URDF+ (Chignoli, Slotine, Wensing, Kim 2024). The axis is the same in both frames:

    <loop name="tip" type="revolute">
      <predecessor link="left_rod">  <origin xyz="0.25 0 0"/> </predecessor>
      <successor link="right_rod">   <origin xyz="0.25 0 0"/> </successor>  <axis xyz="0 0 1"/>
    </loop>
    <coupling name="belt">           ratio * (angle of the predecessor) = angle of the successor
      <predecessor link="pulley"/> <successor link="wheel"/> <ratio value="1"/>
    </coupling>

The angle of a link is the sum of the angles of the joints that carry this link and not the other. Three forms
are read: a coupling that fixes one joint, a coupling of links with equal rotations (ratio 1, all axes
parallel), and a coupling of two joints.

The proposal for ROS (urdfdom pull request 264). Each axis is in its own frame; a type may end in `_joint`:

    <constraint name="tip" type="spherical">
      <parent link="left_rod"/>   <parent_origin xyz="0.25 0 0" rpy="0 0 0"/>  <parent_axis xyz="0 0 1"/>
      <child link="right_rod"/>   <child_origin xyz="0.25 0 0"/>               <child_axis xyz="0 0 1"/>
    </constraint>

Without `<child_axis>` the child's axis is the parent's. A universal joint needs both, at right angles.

Isaac Sim. The order in the document decides which link is the first; the second may be another `<link1>`.
`<fixed_frame>` adds a frame:

    <loop_joint name="tip" type="spherical">
      <link1 link="left_rod" xyz="0.25 0 0" rpy="0 0 0"/>   <link2 link="right_rod" xyz="0.25 0 0"/>
    </loop_joint>

Exporters from Fusion 360 write `<loop_joint>` with the ends of `<constraint>`, `<parent>` and `<child>`, and
one `<axis frame="parent">` in the parent link.

Also read are

- Drake's `<drake:ball_constraint>`, Gazebo's SDF joints `<gazebo><joint>`, and `<mimic>`;
- pairs of links `closing_NAME_1` and `closing_NAME_2` of onshape-to-robot, whose origins coincide (a hinge
  has a second pair, `closing_NAME_1_z`);
- loop_closures.yaml beside the URDF, with the hinges that sw2robot, a CAD exporter for ROS 2, has cut.

Motors are the joints with a transmission or a command interface of ros2_control, with the gear of the
transmission. The two motors of a differential or a four-bar linkage become massless rotors that follow both
joints. Without motors, joints marked `independent` are likely ones. The file says nothing about the platform.

In the functions `where` names the element in messages.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from framework.errors import RobotFileError, check_name
from framework.model.description import locked_axes
from framework.model.documents import (
    attribute,
    check_parts,
    child_element,
    parse_origin,
    parse_yaml,
    prefix_errors,
    read_axis,
    read_link,
    read_number,
    read_origin,
)
from framework.model.placement import invert_placement, placement
from framework.model.readers.describe import Options, describe
from framework.model.readers.sdf import close_joint, make_joint
from framework.model.readers.sdf_scope import (
    BALL_CONSTRAINT,
    TRUE_TEXTS,
    WORLD,
    Scope,
    add_content,
    drop_detached,
)
from framework.model.readers.urdf_tree import UnreadElement, UrdfTree, read_urdf_tree
from framework.model.urdf_elements import ParsedRobot
from framework.numerics.arrays import Array
from framework.numerics.fields import list_of, one_of, read_table, required, text, vector3
from framework.numerics.input import read_text
from framework.tolerances import FILE_ROUNDING

LOOP_CLOSURES = "loop_closures.yaml"
# kinds of closures by the type that each syntax has for them
_SHARED_KINDS = {
    "fixed": "fixed",
    "spherical": "spherical",
    "revolute": "revolute",
    "prismatic": "prismatic",
    "continuous": "revolute",
}
_KINDS_IN_URDF_PLUS = _SHARED_KINDS | {"cylindrical": "cylindrical", "planar": "planar"}
_KINDS_IN_ROS = _KINDS_IN_URDF_PLUS | {"universal": "universal", "link": "fixed"}
# names of the frames of onshape-to-robot: the loop, its end, and a mark of the second pair of a hinge
_CLOSING_LINK = re.compile(r"closing_(?P<name>.+)_(?P<end>[12])(?P<second>_z)?")


class _Syntax(NamedTuple):
    """The syntax of a loop element: its types, and the tags of its ends and axes."""

    ends: tuple[str, str]
    kinds: Mapping[str, str]  # closure kind by type
    axes: tuple[str, ...] = ("axis",)  # of both ends, or of each end


_LOOP_SYNTAX = {
    "loop": _Syntax(("predecessor", "successor"), _KINDS_IN_URDF_PLUS),
    "constraint": _Syntax(("parent", "child"), _KINDS_IN_ROS, ("parent_axis", "child_axis")),
    "loop_joint": _Syntax(("link1", "link2"), _SHARED_KINDS),
}


def _element_name(element: Element) -> tuple[str, str]:
    """Return an element's name, and `where` as messages name the element."""
    name = attribute(element, f"<{element.tag}>", "name")
    return name, f"{element.tag} {name!r}"


def _read_loop(tree: UrdfTree, element: Element) -> None:
    """Read a loop element and add its closure to the tree."""
    syntax = _LOOP_SYNTAX[element.tag]
    if element.find("parent") is not None:
        syntax = syntax._replace(ends=("parent", "child"))
    elif element.tag == "loop_joint":  # both ends may be called link1
        ends_in_order = [end for end in element if end.tag in syntax.ends]
        for tag, end in zip(syntax.ends, ends_in_order, strict=False):
            end.tag = tag
    name, where = _element_name(element)
    origins = [f"{end}_origin" for end in syntax.ends]
    check_parts(element, where, (*syntax.ends, *syntax.axes, *origins), ("name", "type"))
    written = attribute(element, where, "type").lower().removesuffix("_joint")
    check_name(where, "type", written, syntax.kinds)
    kind = syntax.kinds[written]
    axes = _read_axes(element, where, kind, syntax.axes)
    ends = [(end.removeprefix("link"), *_read_end(tree, element, where, end)) for end in syntax.ends]
    if axes and element.find("axis[@frame='parent']") is not None:
        # on the axes of the first link, at zero joint positions
        in_base = tree.zero_pose(ends[0][1])[:3, :3] @ axes[0]
        axes = [(tree.zero_pose(link) @ origin)[:3, :3].T @ in_base for _, link, origin in ends]
    tree.close(name, locked_axes(kind), ends, axes)


def _read_axes(element: Element, where: str, kind: str, tags: Sequence[str]) -> list[Array]:
    """Read the axes (3,) of a closure: one for each end, one for both, or none.

    Args:
        element: the loop.
        kind: of the closure.
        tags: of the axes.
    """
    if kind in ("fixed", "spherical"):
        return []
    axes = []
    for tag in tags:
        # only a universal joint requires a second axis
        if tag == tags[0] or kind == "universal" or element.find(tag) is not None:
            axes.append(read_axis(child_element(element, where, tag), f"{where}: <{tag}>"))
    if kind == "prismatic" and len(axes) == 2:
        first, second = axes
        sine = np.linalg.norm(np.cross(first, second)) / (np.linalg.norm(first) * np.linalg.norm(second))
        if sine > FILE_ROUNDING:
            raise RobotFileError(
                f"{where}: <child_axis>: differs from <parent_axis>; a prismatic joint does not turn, so "
                f"turn the frame by the rpy of <child_origin> instead"
            )
        return [first]
    return axes


def _read_end(tree: UrdfTree, element: Element, where: str, end: str) -> tuple[str, Array]:
    """Read an end of a loop: the link, and the joint's placement (4, 4) in the link.

    The tag of the end is `end`. The placement is an `<origin>` in the end, an `<END_origin>` beside the end,
    or attributes of the end.
    """
    body = child_element(element, where, end)
    label = f"{where}: <{end}>"
    check_parts(body, label, ("origin",), ("link", "xyz", "rpy"))
    link = read_link(element, where, end, tree.links)
    origins = body.findall("origin") + element.findall(f"{end}_origin")
    attributes: dict[str, str] = {key: body.attrib[key] for key in ("xyz", "rpy") if key in body.attrib}
    if attributes:
        origins.append(Element("origin", attributes))
    if len(origins) > 1:
        raise RobotFileError(f"{label}: has more than one origin; keep one of them")
    if not origins:
        return link, np.eye(4)
    (origin,) = origins
    return link, parse_origin(origin, f"{label}: <{origin.tag}>")


def _read_coupling(tree: UrdfTree, element: Element) -> None:
    """Read a `<coupling>` of two links and add its loop equation to the tree."""
    name, where = _element_name(element)
    ends = _LOOP_SYNTAX["loop"].ends
    check_parts(element, where, (*ends, "ratio"), ("name", "type"))
    first, second = (_read_end(tree, element, where, end)[0] for end in ends)  # links, without placements
    ratio_element = child_element(element, where, "ratio")
    check_parts(ratio_element, f"{where}: <ratio>", (), ("value",))
    ratio = read_number(ratio_element, f"{where}: <ratio>", "value")
    if first == second:
        raise RobotFileError(f"{where}: couples {first!r} with itself")

    # the sum of angles of the driven joints is the ratio times that of the drivers
    drivers, driven = tree.moving_chains(first, second)
    arms = {joint.name: 1.0 for joint in driven} | {joint.name: -ratio for joint in drivers}
    if not tree.equate(name, arms, 0.0, (second, first)):
        listed = ", ".join(joint.name for joint in (*drivers, *driven))
        raise RobotFileError(f"{where}: couples {listed}: needs joints of one freedom")


def _read_fixed_frame(tree: UrdfTree, element: Element) -> None:
    """Read a `<fixed_frame>` and add the frame to the tree."""
    name, where = _element_name(element)
    parent = read_link(element, where, "parent", tree.links)
    tree.add_frame(name, parent, read_origin(element, where))


# the dialect of each element, and the reader of the element
_ELEMENTS: dict[str, tuple[str, Callable[[UrdfTree, Element], None]]] = {
    "loop": ("urdf+", _read_loop),
    "coupling": ("urdf+", _read_coupling),
    "constraint": ("ros", _read_loop),
    "loop_joint": ("loop_joint", _read_loop),
    "fixed_frame": ("loop_joint", _read_fixed_frame),
}


def read_urdf(
    file: Path, root: Element, options: Options, beside: Mapping[str, Any] | None = None
) -> ParsedRobot:
    """Read the robot in a URDF with loops.

    Args:
        file: of the URDF.
        root: of its XML, which is changed.
        options: complete and override the file.
        beside: content of a loop_closures.yaml, by default of the one near the file.

    Raises:
        RobotFileError: the file is malformed or has no loop; the message names the element.
    """
    beside = _find_loop_closures(file) if beside is None else beside
    independent = [
        joint.get("name", "")
        for joint in root.findall("joint")
        if joint.get("independent", "").lower() in TRUE_TEXTS
    ]
    tree, elements = read_urdf_tree(root, (*_ELEMENTS, BALL_CONSTRAINT), options.base)
    beside_independent = list_of(text)(f"{LOOP_CLOSURES}: independent", beside.get("independent", []))
    of_plugins = [element.text or "" for element in root.iter("joint_name")]  # of Gazebo's controllers
    named_by_plugins = [name for name in dict.fromkeys(of_plugins) if name in tree.movable]
    tree.likely_motors = [*independent, *beside_independent] or named_by_plugins

    dialect = ""
    for element in elements:
        if element.tag in _ELEMENTS:
            dialect_of_element, read = _ELEMENTS[element.tag]
            read(tree, element)
            dialect = dialect or dialect_of_element
    _close_joints_of_other_programs(tree, elements)
    has_closing_frames = _close_named_frames(tree)
    _close_hinges(tree, beside)
    is_closed = tree.closures or tree.couplings or options.closures
    if not is_closed and root.find("joint/mimic") is None:
        unread = "".join(f"{linkage}; " for linkage in tree.unread_transmissions)
        raise RobotFileError(
            f"{unread}a URDF without loops: declare them in it (<loop> of URDF+, <constraint> of ROS, "
            f"<loop_joint> of Isaac Sim, <mimic>, links closing_X_1 and closing_X_2 of onshape-to-robot) or "
            f"in a YAML file beside it (ours, or Gepetto's with closed_loop), and give that file; or let "
            f"`convert --close` close them in words"
        )
    dialect = dialect or ("onshape" if has_closing_frames else "urdf")
    for name in tree.motors:
        if dialect == "ros":
            check_name("transmission", "movable joint", name, tree.movable)
        if name in tree.movable:
            tree.add_motor(name)
    return describe(tree, file, options, dialect)


def _close_named_frames(tree: UrdfTree) -> bool:
    """Close loops at pairs of links closing_X_1, closing_X_2; return whether any exists."""
    pairs: dict[str, dict[str, str]] = {}  # by loop, then by end, "1" or "2": the link
    for link in tree.links:
        if match := _CLOSING_LINK.fullmatch(link):
            pairs.setdefault(match["name"] + (match["second"] or ""), {})[match["end"]] = link
    for name, ends in pairs.items():
        if len(ends) < 2:
            ((end, link),) = ends.items()
            other_end = "2" if end == "1" else "1"
            missing = re.sub(rf"_{end}(_z)?$", rf"_{other_end}\1", link)
            raise RobotFileError(f"link {link!r}: the other end of its loop, {missing!r}, is missing")
        tree.close(name, locked_axes("spherical"), [(end, ends[end], np.eye(4)) for end in ("1", "2")])
    return bool(pairs)


def _close_joints_of_other_programs(tree: UrdfTree, elements: Sequence[Element]) -> None:
    """Close the loops of Gazebo's joints, and of Drake's constraints among the dialect's `elements`.

    They are read as the content of an SDF model, whose links have the poses at zero joint positions.
    """
    scope = Scope(version=np.inf)
    for link in tree.links:
        scope.links[link] = Element("link")
        scope.relative[link] = (WORLD, tree.zero_pose(link))
    model = Element("model", name=tree.name)
    gazebo = [element for element in tree.others if element.tag == "gazebo"]
    model.extend(joint for element in gazebo for joint in element.findall("joint[child]"))
    model.extend(plugin for element in gazebo for plugin in element.findall("plugin[child_link]"))
    model.extend(element for element in elements if element.tag == BALL_CONSTRAINT)
    add_content(scope, model, Path(), "", WORLD)
    detached = [item for item in drop_detached(scope) if item[1] in tree.links]
    tree.left_out += [UnreadElement(text, (parent,)) for text, parent in detached]
    for name in scope.joints:
        close_joint(tree, make_joint(scope, name))


def _find_loop_closures(file: Path) -> Mapping[str, Any]:
    """Return the content of the loop_closures.yaml near a URDF; an empty mapping without one."""
    folder = file.parent
    for place in (folder, folder.parent, folder.parent / "config"):
        path = place / LOOP_CLOSURES
        if path.is_file():
            with prefix_errors(path):
                content = parse_yaml(read_text(path, "cannot read it", error=RobotFileError))
                return content if isinstance(content, dict) else {}
    return {}


def _close_hinges(tree: UrdfTree, content: Mapping[str, Any]) -> None:
    """Close the hinges listed in the `content` of a loop_closures.yaml.

    An entry names two links, and gives a point [m] and an axis in the base frame at zero joint positions.
    Each link gets a frame at the point, and the hinge joins both frames.
    """
    link = required(one_of("link", tree.links))
    keys = {"link_a": link, "link_b": link, "point": required(vector3), "axis": required(vector3)}
    # further keys of an entry are ignored (others=None)
    read = list_of(lambda where, given: read_table(where, given, keys, others=None))
    for i, entry in enumerate(read(f"{LOOP_CLOSURES}: closures", content.get("closures", []))):
        axis = np.array(entry["axis"])
        if not axis.any():
            raise RobotFileError(f"{LOOP_CLOSURES}: closures[{i}].axis: the axis is zero")
        hinge_at_zero = placement(translation=entry["point"])
        ends = []
        for end in ("a", "b"):
            name = entry[f"link_{end}"]
            ends.append((end, name, invert_placement(tree.zero_pose(name)) @ hinge_at_zero))
        tree.close(f"loop_{i + 1}", locked_axes("revolute"), ends, [axis])
