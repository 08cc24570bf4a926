"""The `<constraint>` proposed for ROS's URDF (urdfdom pull request 264, urdfdom_headers 108).

    <constraint name="tip" type="spherical">
      <parent link="left_rod"/>   <parent_origin xyz="0.25 0 0" rpy="0 0 0"/>  <parent_axis xyz="0 0 1"/>
      <child link="right_rod"/>   <child_origin xyz="0.25 0 0"/>               <child_axis xyz="0 0 1"/>
    </constraint>

Each axis is in its own frame. A revolute, prismatic, cylindrical or planar joint has one axis: the
child's is the parent's unless given. A universal joint has two at right angles, both needed. `fixed` (or
`link`, a cut link) and `spherical` have none. A kind may end in `_joint`.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import numpy as np

from framework.arrays import Array
from framework.errors import RobotFileError, choose_from
from framework.model.description import Closure, locked_axes
from framework.model.placement import placement, turning
from framework.model.readers.urdf_tree import UrdfTree
from framework.model.xml_reading import attribute, axis_of, child_element, only, origin_of
from framework.tolerances import FILE_ROUNDING

_KINDS = {"continuous": "revolute", "link": "fixed"} | {
    kind: kind
    for kind in ("fixed", "spherical", "revolute", "prismatic", "cylindrical", "planar", "universal")
}
_PARTS = ("parent", "parent_origin", "parent_axis", "child", "child_origin", "child_axis")


def read_constraint(tree: UrdfTree, element: ElementTree.Element) -> Closure:
    """Read the closure of a `<constraint>`; complaints name the element."""
    name = attribute(element, "<constraint>", "name")
    where = f"constraint {name!r}"
    only(element, where, _PARTS, ("name", "type"))
    given = attribute(element, where, "type")
    name_of_kind = given.lower().removesuffix("_joint")
    if name_of_kind not in _KINDS:
        raise RobotFileError(f"{where}: {choose_from('type', given, _KINDS)}")
    kind = _KINDS[name_of_kind]
    frames = []
    for end, turn in zip(("parent", "child"), _turns(element, where, kind), strict=True):
        body = child_element(element, where, end)
        only(body, f"{where}: <{end}>", (), ("link",))
        link = tree.link(f"{where}: <{end}>", attribute(body, f"{where}: <{end}>", "link"))
        origin = origin_of(element.find(f"{end}_origin"), f"{where}: <{end}_origin>")
        frames.append(tree.frame_at(f"{name}_{end}", link, origin @ placement(turn)))
    return Closure(name, (frames[0], frames[1]), locked_axes(kind))


def _turns(element: ElementTree.Element, where: str, kind: str) -> tuple[Array, Array]:
    """Return turns of the two frames that put the axes where the closure wants them."""
    if kind in ("fixed", "spherical"):
        return np.eye(3), np.eye(3)
    axis = axis_of(child_element(element, where, "parent_axis"), f"{where}: <parent_axis>")
    child = element.find("child_axis")
    if kind == "universal":
        child_axis = axis_of(child_element(element, where, "child_axis"), f"{where}: <child_axis>")
        # the first axis is x of the first frame, the second is y of the second frame
        return turning("x", axis), turning("y", child_axis)
    child_axis = axis_of(child, f"{where}: <child_axis>") if child is not None else axis
    if kind == "prismatic" and np.linalg.norm(np.cross(axis, child_axis)) > FILE_ROUNDING * np.linalg.norm(
        axis
    ) * np.linalg.norm(child_axis):
        raise RobotFileError(
            f"{where}: <child_axis>: differs from <parent_axis>; a prismatic joint does not turn, so turn "
            f"the frame by the rpy of <child_origin> instead"
        )
    return turning("z", axis), turning("z", child_axis if kind != "prismatic" else axis)
