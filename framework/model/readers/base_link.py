"""A part of a larger robot: what one link carries moves, and all else is locked where the reference has it.

A leg of a humanoid or the wrist of an arm is examined so without an edit to its file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from framework.errors import RobotFileError, choose_from
from framework.model.description import Closure
from framework.model.readers.urdf_tree import UrdfTree


def lock_all_but(tree: UrdfTree, base: str, reference: Mapping[str, float]) -> None:
    """Lock all joints that the link `base` does not carry, at the reference [rad, m], else at zero.

    Raises:
        RobotFileError: there is no such link, or it carries no joint that moves.
    """
    if base not in tree.links:
        raise RobotFileError(f"--base: {choose_from('link', base, tree.links)}")
    carried = {
        joint.name
        for joint in tree.joints.values()
        if joint.parent == base or any(above.child == base for above in tree.path_to_base(joint.parent))
    }
    if not any(tree.joints[name].moves for name in carried):
        raise RobotFileError(
            f"--base: no joint moves that link {base!r} carries; give a link nearer to the root"
        )
    for joint in list(tree.joints.values()):
        if joint.moves and joint.name not in carried:
            tree.fix(joint, *(reference.get(name, 0.0) for name in joint.coordinates))


def loops_of_the_rest(tree: UrdfTree, closures: Sequence[Closure]) -> list[Closure]:
    """The closures that still have a joint that moves between their frames."""
    return [c for c in closures if any(tree.moving_chains(*map(tree.link_of, c.frames)))]
