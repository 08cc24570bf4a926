"""URDF+ (Chignoli, Slotine, Wensing, Kim 2024; the parser of ROAM lab's GRBDA): `<loop>` and `<coupling>`.

    <loop name="tip" type="revolute">
      <predecessor link="left_rod">  <origin xyz="0.25 0 0"/> </predecessor>
      <successor link="right_rod">   <origin xyz="0.25 0 0"/> </successor>
      <axis xyz="0 0 1"/>            in both frames, which the joint makes coincide but for its motion
    </loop>
    <coupling name="belt">           ratio * (angle of the predecessor) = angle of the successor
      <predecessor link="pulley"/> <successor link="wheel"/> <ratio value="1"/>
    </coupling>

The angle of a link is the sum of the joints that carry it and not the other. A coupling is no loop of
frames; only two kinds of it are one: a joint that is held, and links turned alike (ratio 1, all axes
parallel). Others are refused. The file says nothing about platform and motors; joints marked
`independent` are proposed as motors.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import numpy as np

from framework.arrays import Array
from framework.errors import RobotFileError, choose_from
from framework.model.description import Closure, locked_axes
from framework.model.placement import placement, turning
from framework.model.readers.urdf_tree import UrdfTree
from framework.model.urdf_elements import MOVING
from framework.model.xml_reading import attribute, axis_of, child_element, numbers, only, origin_of

_KINDS = {"revolute": "revolute", "continuous": "revolute"} | {
    kind: kind for kind in ("prismatic", "cylindrical", "planar", "spherical", "fixed")
}
_WITHOUT_AXIS = ("spherical", "fixed")


def read_loop(tree: UrdfTree, element: ElementTree.Element) -> Closure:
    """Read the closure of a `<loop>`; complaints name the element."""
    name = attribute(element, "<loop>", "name")
    where = f"loop {name!r}"
    only(element, where, ("predecessor", "successor", "axis"), ("name", "type"))
    kind = attribute(element, where, "type")
    if kind not in _KINDS:
        raise RobotFileError(f"{where}: {choose_from('type', kind, _KINDS)}")
    turn: Array = np.eye(3)
    if kind not in _WITHOUT_AXIS:
        turn = turning("z", axis_of(child_element(element, where, "axis"), f"{where}: <axis>"))
    frames = []
    for end in ("predecessor", "successor"):
        link, origin = _end(tree, element, where, end)
        frames.append(tree.frame_at(f"{name}_{end}", link, origin @ placement(turn)))
    return Closure(name, (frames[0], frames[1]), locked_axes(_KINDS[kind]))


def read_coupling(tree: UrdfTree, element: ElementTree.Element) -> Closure | None:
    """Read the closure of a `<coupling>`; None of one that holds a joint, which is done."""
    name = attribute(element, "<coupling>", "name")
    where = f"coupling {name!r}"
    only(element, where, ("predecessor", "successor", "ratio"), ("name", "type"))
    first, _ = _end(tree, element, where, "predecessor")
    second, _ = _end(tree, element, where, "successor")
    value = child_element(element, where, "ratio")
    only(value, f"{where}: <ratio>", (), ("value",))
    (ratio,) = numbers(f"{where}: <ratio>", attribute(value, f"{where}: <ratio>", "value"), 1)
    if first == second:
        raise RobotFileError(f"{where}: couples {first!r} with itself")
    drivers, driven = tree.moving_chains(first, second)
    held, others = (driven, drivers) if ratio == 0.0 or not drivers else (drivers, driven)
    if len(held) == 1 and held[0].kind in MOVING and (ratio == 0.0 or not others):
        tree.fix(held[0])
        return None
    closure = tree.same_turning(name, first, second) if ratio == 1.0 else None
    if closure is None:
        raise RobotFileError(
            f"{where}: a gear of ratio {ratio:g} between {first!r} and {second!r} cannot be held by loops "
            f"of frames (valid: ratio 1 between turns about parallel axes, or a joint that is held); "
            f"leave the geared link out and give its motor a gear_ratio"
        )
    return closure


def _end(tree: UrdfTree, element: ElementTree.Element, where: str, end: str) -> tuple[str, Array]:
    body = child_element(element, where, end)
    where = f"{where}: <{end}>"
    only(body, where, ("origin",), ("link",))
    link = tree.link(where, attribute(body, where, "link"))
    return link, origin_of(body.find("origin"), f"{where}: <origin>")
