"""The `<loop_joint>` of a URDF, as Isaac Sim reads and writes it, and Drake once did.

    <loop_joint name="tip" type="spherical">
      <link1 link="left_rod" xyz="0.25 0 0" rpy="0 0 0"/>   <link2 link="right_rod" xyz="0.25 0 0"/>
    </loop_joint>

The second link may be a second `<link1>`, as in Isaac Sim's manual. Isaac Sim closes loops by balls; `fixed`
needs no axis either, `revolute` and `prismatic` have an `<axis xyz>` in both frames. `<fixed_frame>` is a
frame. Motors are the joints with a transmission or a command interface; nothing is said of the platform.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import numpy as np

from framework.errors import RobotFileError, choose_from
from framework.model.description import Closure, locked_axes
from framework.model.placement import placement, turning
from framework.model.readers.urdf_tree import UrdfTree
from framework.model.xml_reading import attribute, axis_of, child_element, only, origin_of

_ORIGIN = ("xyz", "rpy")
_KINDS = {"continuous": "revolute"} | {kind: kind for kind in ("spherical", "fixed", "revolute", "prismatic")}


def read_fixed_frame(tree: UrdfTree, element: ElementTree.Element) -> None:
    """Add the frame of a `<fixed_frame>` to the tree."""
    name = attribute(element, "<fixed_frame>", "name")
    where = f"fixed_frame {name!r}"
    parent = attribute(child_element(element, where, "parent"), f"{where}: <parent>", "link")
    tree.add_frame(
        name, tree.link(f"{where}: <parent>", parent), origin_of(element.find("origin"), f"{where}: <origin>")
    )


def read_loop_joint(tree: UrdfTree, element: ElementTree.Element) -> Closure:
    """Read the closure of a `<loop_joint>`; complaints name the element."""
    name = attribute(element, "<loop_joint>", "name")
    where = f"loop_joint {name!r}"
    for child in element:
        if child.tag not in ("link1", "link2", "axis"):
            raise RobotFileError(f"{where}: {choose_from('element', child.tag, ('link1', 'link2', 'axis'))}")
    given = attribute(element, where, "type")
    if given.lower() not in _KINDS:
        raise RobotFileError(f"{where}: {choose_from('type', given, _KINDS)}")
    kind, turn = _KINDS[given.lower()], np.eye(3)
    if kind in ("revolute", "prismatic"):
        turn = turning("z", axis_of(child_element(element, where, "axis"), f"{where}: <axis>"))
    ends = [child for child in element if child.tag in ("link1", "link2")]
    if len(ends) != 2:
        raise RobotFileError(f"{where}: needs two links (<link1>, <link2>), got {len(ends)}")
    frames = []
    for number, end in enumerate(ends, start=1):
        only(end, f"{where}: <{end.tag}>", (), ("link", *_ORIGIN))
        link = tree.link(f"{where}: <{end.tag}>", end.get("link"))
        origin = ElementTree.Element("origin", {key: end.attrib[key] for key in _ORIGIN if key in end.attrib})
        place = origin_of(origin, f"{where}: <{end.tag}>") @ placement(turn)
        frames.append(tree.frame_at(f"{name}_{number}", link, place))
    return Closure(name, (frames[0], frames[1]), locked_axes(kind))
