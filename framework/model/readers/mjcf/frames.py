"""`<frame>` of MJCF: what it holds, placed and classed by it, in its place; `<replicate>` in the world.

A frame moves what it holds and is no body: after this there is none. Copies that `<replicate>` makes in the
world are scenery, and dropped: no loop can name them.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import numpy as np
import pinocchio as pin

from framework.arrays import Array
from framework.errors import RobotFileError
from framework.model.readers.mjcf.settings import MAX_NESTING_DEPTH, TURNS, CompilerSettings, known
from framework.model.urdf_writing import vector_text
from framework.model.xml_reading import numbers

_FRAME = ("name", "childclass", "pos", *TURNS)
_PLACED = ("body", "geom", "site", "camera", "light")


def without_frames(
    settings: CompilerSettings, parent: ElementTree.Element, childclass: str | None = None, depth: int = 0
) -> None:
    """Put what the frames below an element hold in their place.

    Raises:
        RobotFileError: names the element.
    """
    if depth > MAX_NESTING_DEPTH:
        raise RobotFileError(f"<{parent.tag}>: more than {MAX_NESTING_DEPTH} bodies inside each other")
    childclass = parent.get("childclass", childclass)
    for position, child in reversed(list(enumerate(parent))):
        if child.tag in ("body", "frame"):
            without_frames(settings, child, childclass, depth + 1)
        if child.tag == "replicate":
            if parent.tag != "worldbody":
                raise RobotFileError(
                    "<replicate>: copies in a body are not read; load and save the file with MuJoCo, "
                    "which writes them out"
                )
            parent.remove(child)
        if child.tag == "frame":
            where = f"frame {child.get('name', '')!r}"
            known(child, where, _FRAME)
            place = settings.placed(child.attrib, where)
            parent.remove(child)
            for offset, element in enumerate(child):
                _classed(element, child.get("childclass"))
                _move(settings, element, place, child.get("childclass", childclass))
                parent.insert(position + offset, element)


def _classed(element: ElementTree.Element, childclass: str | None) -> None:
    """Give an element the class of its frame, where it has none of its own."""
    key = "childclass" if element.tag == "body" else "class"
    if childclass is not None and element.tag != "freejoint":
        element.attrib.setdefault(key, childclass)


def _move(
    settings: CompilerSettings, element: ElementTree.Element, frame: Array, childclass: str | None
) -> None:
    """Place an element by a frame (4, 4) beside its own placement."""
    where = f"<{element.tag}>"
    values = element.attrib if element.tag == "body" else settings.attributes(element, where, childclass)
    if element.tag == "joint":
        position = numbers(f"{where} pos", values.get("pos", "0 0 0"), 3)
        axis = numbers(f"{where} axis", values.get("axis", "0 0 1"), 3)
        element.set("pos", vector_text(frame[:3, :3] @ position + frame[:3, 3]))
        element.set("axis", vector_text(frame[:3, :3] @ axis))
    elif "fromto" in values:
        ends = np.reshape(numbers(f"{where} fromto", values["fromto"], 6), (2, 3))
        element.set("fromto", vector_text((ends @ frame[:3, :3].T + frame[:3, 3]).ravel()))
    elif element.tag in _PLACED:
        place = frame @ settings.placed(values, where)
        x, y, z, w = pin.Quaternion(np.ascontiguousarray(place[:3, :3])).coeffs()
        for key in TURNS:
            element.attrib.pop(key, None)
        element.set("pos", vector_text(place[:3, 3]))
        element.set("quat", vector_text([w, x, y, z]))
