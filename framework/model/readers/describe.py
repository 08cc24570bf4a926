"""The records of a foreign file, once its tree is read and its loops are known.

A part of a larger robot, such as a leg or a wrist, is selected by --base and --lock, without an edit to its
file.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from framework.errors import FrameworkError, RobotFileError, check_name, choose_from
from framework.model.description import (
    Closure,
    Coupling,
    JointDynamics,
    ParsedRobot,
    Platform,
    RobotDescription,
    locked_by_couplings,
)
from framework.model.readers.left_out import LeftOut, left_out_of, moves
from framework.model.readers.missing_fields import Known, Options, checked_reference, completed_description
from framework.model.readers.transmissions import Motor, Pull, actuators_of, add_pulls
from framework.model.readers.urdf_tree import UrdfTree
from framework.model.robot_keys import joint_dynamics
from framework.model.urdf_elements import declared_couplings, declared_dynamics

# names that exporters give to every model
_NO_NAMES = ("", "mjcf", "model", "mujoco", "mujoco model", "onshape", "robot", "scene", "urdf")


def describe(
    tree: UrdfTree,
    file: Path,
    options: Options,
    closures: Sequence[Closure],
    *,
    couplings: Sequence[Coupling] = (),
    platform: Platform | None = None,
    motors: Sequence[Motor] = (),
    pulls: Iterable[Pull] = (),
    likely_motors: Sequence[str] = (),
    joints: Mapping[str, JointDynamics] | None = None,
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81),
    reference: Mapping[str, float] | None = None,
    left_out: Sequence[LeftOut] = (),
    remarks: Sequence[str] = (),
) -> ParsedRobot:
    """Make the records of a tree and its loops, completed by the options.

    Joints not behind --base and joints of --lock are fixed, and forces on them are ignored.

    Raises:
        RobotFileError: there is no loop, or one that closes nothing; or platform, axes or motors are missing.
    """
    near = checked_reference(options, tree.coordinates, reference or {})
    couplings = [*couplings, *declared_couplings(tree.root)]
    left_out = [*left_out, *(LeftOut(text, (name,), is_decisive=True) for name, text in tree.impossible)]
    if not closures and not couplings:
        left_out_of(tree, left_out)
        raise RobotFileError("there is no loop in it: a parallel robot needs at least one closure")
    _check_closures(closures)
    if options.base is not None:
        lock_all_but(tree, options.base, near)
    lock(tree, options.locked, near)
    couplings = couplings_of_the_rest(tree, couplings)
    loops = [one for one in closures if any(tree.moving_chains(*map(tree.link_of, one.frames)))]
    if not loops and not couplings:
        raise _no_loop(options, closures[0] if closures else None)
    actuators, several = actuators_of(motors, tree, couplings)
    acting, apart = add_pulls(pulls, joints or {}, tree, couplings)
    description = RobotDescription(
        name=_name(tree.root, file),
        file=file,
        urdf_text="",
        platform=Platform(tree.base, ()),
        actuators=tuple(actuators),
        closures=tuple(loops),
        couplings=tuple(couplings),
        joints=_acting(tree, acting),
        gravity=gravity,
        reference={name: value for name, value in near.items() if name in tree.coordinates},
    )
    known = Known(tree, description, platform, tuple(likely_motors))
    left_out = [*left_out, *apart]
    try:
        resolved = completed_description(options, known)
    except FrameworkError:
        left_out_of(tree, left_out)  # the more precise reason, if there is one
        raise
    description = replace(
        resolved.description,
        urdf_text=ElementTree.tostring(tree.root, encoding="unicode"),
        left_out=(*several, *left_out_of(tree, left_out)),
    )
    remarks = (*remarks, *_omissions(tree, left_out), *resolved.remarks)
    return ParsedRobot(description, tree.root, remarks=remarks)


def _omissions(tree: UrdfTree, left_out: Sequence[LeftOut]) -> Iterator[str]:
    """Yield remarks on decisive elements without motion, and on elements of other programs."""
    for item in left_out:
        if item.is_decisive and not any(moves(tree, name) for name in item.acts_on):
            yield f"not used, since it does not move: {item.what}"
    if tree.skipped:
        yield f"not read, of other programs: {', '.join(f'<{tag}>' for tag in tree.skipped)}"


def _check_closures(closures: Sequence[Closure]) -> None:
    names = [closure.name for closure in closures]
    for closure in closures:
        if names.count(closure.name) > 1:
            raise RobotFileError(f"duplicate closure {closure.name!r}")
        if closure.frames[0] == closure.frames[1]:
            raise RobotFileError(
                f"closure {closure.name!r}: joins {closure.frames[0]!r} with itself; needs two frames"
            )


def _no_loop(options: Options, closure: Closure | None) -> RobotFileError:
    """Return the error where nothing is left of the loops of a file."""
    if options.base is not None:
        return RobotFileError(f"--base: no loop moves that link {options.base!r} carries")
    if closure is None or options.locked:
        return RobotFileError("--lock: no loop moves any more")
    first, second = closure.frames
    return RobotFileError(
        f"closure {closure.name!r}: no joint moves between {first!r} and {second!r}, so it closes no loop"
    )


def _name(root: ElementTree.Element, file: Path) -> str:
    """Return the model's own name, else that of its file, else of its folders; fit to name a file."""
    for name in (root.get("name", ""), file.stem, *(folder.name for folder in file.absolute().parents[:2])):
        clean = "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in name)
        if name.lower() not in _NO_NAMES and clean.strip("_"):
            return clean
    return file.stem


def _acting(tree: UrdfTree, joints: Mapping[str, JointDynamics]) -> dict[str, JointDynamics]:
    """Return springs, damping and friction of the coordinates that move: the dialect's, or <dynamics>."""
    declared = joint_dynamics(declared_dynamics(tree.root), {})
    return {name: value for name, value in {**declared, **joints}.items() if name in tree.coordinates}


# ------------------------------------------------------------------ a part of a larger robot


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
    """Lock joints at values [rad, m]; None means the reference, else zero.

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


def couplings_of_the_rest(tree: UrdfTree, couplings: Sequence[Coupling]) -> list[Coupling]:
    """Return the couplings of moving joints; fix a joint coupled with a fixed one."""
    while locked := locked_by_couplings(couplings, {name: values[0] for name, values in tree.held.items()}):
        for name, value in locked.items():
            tree.fix(tree.joints[name], value)
    return [c for c in couplings if tree.joints[c.joint].moves and tree.joints[c.of].moves]
