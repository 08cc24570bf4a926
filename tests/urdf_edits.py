"""Edits of a URDF in its text, as tests want to read it."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from typing import Any


def edited(urdf: str, *edits: tuple[Callable[..., None], Any] | tuple[Callable[..., None]]) -> str:
    """The text of a URDF after edits: each a function of its root, and what else that takes."""
    root = ElementTree.fromstring(urdf)
    for edit, *given in edits:
        edit(root, *given)
    return ElementTree.tostring(root, encoding="unicode")
