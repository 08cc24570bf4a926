"""Edits of a URDF in its text, as tests want to read it."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path
from typing import Any

import robots
from framework.model.urdf_edits import urdf_text
from framework.model.urdf_elements import read_tree


def edited(urdf: str, *edits: tuple[Callable[..., None], *tuple[Any, ...]]) -> str:
    """The text of a URDF after edits: each a function of its tree, and what else that takes."""
    tree = read_tree(ElementTree.fromstring(urdf))
    for edit, *given in edits:
        edit(tree, *given)
    return urdf_text(tree)


def add_fixed_link(root: ElementTree.Element, name: str, parent: str, xyz: str) -> None:
    """A link without a body on another one."""
    ElementTree.SubElement(root, "link", name=name)
    joint = ElementTree.SubElement(root, "joint", name=f"{name}_mount", type="fixed")
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=name)
    ElementTree.SubElement(joint, "origin", xyz=xyz)


def parametric_five_bar(folder: Path) -> Path:
    """A robot file in the folder: the paper's 5R with the lengths of cranks and rods as parameters l1, l2."""
    source = robots.load("five_bar").description.file
    first, *rest = source.with_suffix(".urdf").read_text().split('xyz="0.25 0 0"')
    assert len(rest) == 4  # crank and rod, left and right
    text = first + "".join(
        f'xyz="${{{name}}} 0 0"{part}' for name, part in zip(("l1", "l2", "l1", "l2"), rest, strict=True)
    )
    (folder / "named.urdf").write_text(text)
    file = folder / "named.yaml"
    names = "urdf: named.urdf\nparameters: {l1: [0.25, 0.23], l2: [0.25, 0.27, 0.6]}"
    file.write_text(source.read_text().replace("urdf: five_bar.urdf", names))
    return file
