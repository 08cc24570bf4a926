"""Content of a foreign file without a place in the records, named with its size."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from framework.errors import RobotFileError
from framework.model.readers.urdf_tree import UrdfTree


class LeftOut(NamedTuple):
    """An element that is not read, with the joints and links under its action.

    Without the force of most elements a robot is still the same mechanism; where one decides how the
    mechanism moves (`is_decisive`), it cannot be left out of parts that move.
    """

    what: str
    acts_on: tuple[str, ...]
    is_decisive: bool = False


def left_out_of(tree: UrdfTree, items: Iterable[LeftOut]) -> tuple[str, ...]:
    """Return the elements left out of parts that move, each once.

    Raises:
        RobotFileError: it decides how they move.
    """
    concerned = [item for item in items if any(moves(tree, name) for name in item.acts_on)]
    for item in concerned:
        if item.is_decisive:
            raise RobotFileError(item.what)
    return tuple(dict.fromkeys(item.what for item in concerned))


def moves(tree: UrdfTree, name: str) -> bool:
    """Whether a joint moves, or a joint that carries the link of a name."""
    if name in tree.joints:
        return tree.joints[name].moves
    return name in tree.parent_joint and any(joint.moves for joint in tree.path_to_base(name))
