"""`<include file>` of MJCF: the children of another file's root, put in its place."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

from framework.errors import RobotFileError
from framework.input import read_text
from framework.model.documents import naming, parse_xml
from framework.model.xml_reading import attribute


def with_includes(root: ElementTree.Element, folder: Path) -> ElementTree.Element:
    """Return the root of an MJCF file with all its includes put in, which are files below or beside `folder`.

    Raises:
        RobotFileError: a file cannot be read, is no MJCF, or is included twice (which MuJoCo refuses, too).
    """
    if root.find(".//include") is not None:
        _put_in(root, folder, set())
    return root


def _put_in(parent: ElementTree.Element, folder: Path, included: set[Path]) -> None:
    for position, child in reversed(list(enumerate(parent))):
        if child.tag != "include":
            _put_in(child, folder, included)
            continue
        name = attribute(child, "<include>", "file")
        path = folder / name
        if path in included:
            raise RobotFileError(f"<include> {name!r}: included twice")
        included.add(path)
        text = read_text(path, f"<include> {name!r}: cannot read it", error=RobotFileError)
        with naming(f"<include> {name!r}"):
            other = parse_xml(text)
        _put_in(other, folder, included)
        parent.remove(child)
        for offset, element in enumerate(other):
            parent.insert(position + offset, element)
