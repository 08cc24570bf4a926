"""A part of a larger robot: what is asked for moves, and all else is locked where the reference has it.

A leg of a humanoid or the wrist of an arm is examined so without an edit to its file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from framework.errors import RobotFileError, check_name, choose_from
from framework.model.description import Closure, Coupling, locked_by_couplings
from framework.model.readers.urdf_tree import UrdfTree


def lock_all_but(tree: UrdfTree, base: str, reference: Mapping[str, float]) -> None:
    """Lock all joints that the link `base` does not carry, at the reference [rad, m], else at zero.

    Raises:
        RobotFileError: there is no such link, or it carries no joint that moves.
    """
    check_name("--base", "link", base, tree.links)
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


def lock(tree: UrdfTree, locked: Mapping[str, float | None], reference: dict[str, float]) -> None:
    """Lock joints at a value [rad, m]; at the reference, else at zero, where it is None.

    Of a ball J one turn may be held, J_rx, J_ry or J_rz: it becomes a cross about the other two, whose angles
    come into the reference.

    Raises:
        RobotFileError: there is no such joint that moves, or it has several coordinates and a value.
    """
    for name, value in locked.items():
        ball = tree.joints.get(name[:-3])
        if ball is not None and ball.kind == "spherical" and name in ball.coordinates:
            turn = [reference.pop(key, 0.0) for key in ball.coordinates]
            reference.update(tree.hold_turn(ball, name[-1], value, turn))
            continue
        movable = [joint.name for joint in tree.joints.values() if joint.moves]
        if name not in movable:
            if name in tree.held:
                continue  # by --base, or with another joint
            raise RobotFileError(f"--lock: {choose_from('joint that moves', name, movable)}")
        joint = tree.joints[name]
        if value is not None and len(joint.coordinates) > 1 and value:
            raise RobotFileError(
                f"--lock: {name!r} is {joint.kind}; give {name} alone, and its turn by --reference "
                f"{joint.coordinates[-1]}=VALUE"
            )
        values = [reference.get(name, 0.0) for name in joint.coordinates]
        tree.fix(joint, *(values if value is None else [value] * len(values)))


def loops_of_the_rest(tree: UrdfTree, closures: Sequence[Closure]) -> list[Closure]:
    """Return the closures that still have a joint that moves between their frames."""
    return [c for c in closures if any(tree.moving_chains(*map(tree.link_of, c.frames)))]


def couplings_of_the_rest(tree: UrdfTree, couplings: Sequence[Coupling]) -> list[Coupling]:
    """Return the couplings of two joints that still move; where one is held, hold the other with it."""
    while more := locked_by_couplings(couplings, {name: values[0] for name, values in tree.held.items()}):
        for name, value in more.items():
            tree.fix(tree.joints[name], value)
    return [c for c in couplings if tree.joints[c.joint].moves and tree.joints[c.of].moves]
