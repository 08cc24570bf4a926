"""The records of a foreign file, once its tree is read and its loops are known.

A part of a larger robot can be asked for: it moves, and all else is locked where the reference has it, so
that a leg of a humanoid or the wrist of an arm is examined without an edit to its file. Motors and what else
acts along lengths goes to the joints that they drive. What is read and not kept is named with its size.
Platform, axes, motors and reference that a file leaves out are stated by options, or proposed.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element, tostring

from framework.errors import FrameworkError, RobotFileError, check_name, check_unique, list_names
from framework.model.description import (
    AXES,
    Actuator,
    Closure,
    JointDynamics,
    ParsedRobot,
    Platform,
    RobotDescription,
    locked_through_couplings,
)
from framework.model.readers.urdf_tree import MAX_LOOPS, UnreadElement, UrdfTree
from framework.model.robot_keys import merge_joint_dynamics
from framework.model.urdf_elements import declared_couplings, declared_dynamics
from framework.numerics.arrays import Names
from framework.numerics.fields import check_distinct

# names that exporters give to every model
_NO_NAMES = ("", "mjcf", "model", "mujoco", "mujoco model", "onshape", "robot", "scene", "urdf")


class PartialRobot(NamedTuple):
    """Content of a file, perhaps without platform and motors."""

    tree: UrdfTree
    description: RobotDescription  # its platform is the base on no axes, its motors those of the file
    platform: Platform | None = None
    chooses_motors: bool = False  # where the file has more than the mechanism needs
    remarks: tuple[str, ...] = ()

    def with_platform(self, platform: Platform, *remarks: str) -> PartialRobot:
        """Return the content with a platform in its description, and further remarks."""
        description = replace(self.description, platform=platform)
        return self._replace(description=description, remarks=(*self.remarks, *remarks))


@dataclass(frozen=True)
class Options:
    """The options of a reader; None means the file's value.

    `reference` [rad, m] goes by the names of joints, of a ball J by J_rx, J_ry, J_rz (a rotation vector); a
    foreign file's zero pose is the reference unless it says something else. `locked` [rad, m] holds joints,
    at the reference if the value is None. `propose` completes the rest.
    """

    platform: str | None = None
    axes: Names | None = None
    motors: Names | None = None
    reference: Mapping[str, float] = field(default_factory=dict)
    base: str | None = None  # a link: what it does not carry is locked
    locked: Mapping[str, float | None] = field(default_factory=dict)
    platform_joints: Names | None = None
    propose: Propose | None = None

    @property
    def is_silent(self) -> bool:
        """Whether the options leave platform and motors open."""
        return not (self.platform or self.axes or self.platform_joints or self.motors)


Propose = Callable[[Options, PartialRobot], PartialRobot]


def describe(tree: UrdfTree, file: Path, options: Options, dialect: str) -> ParsedRobot:
    """Make the description of a tree and its loops, completed by the options.

    Joints not behind --base and joints of --lock are fixed, and forces on them are ignored. No loop, or one
    that closes nothing, is an error.
    """
    reference = merge_reference(options, tree.coordinates, tree.reference)
    tree.couplings += declared_couplings(tree.root)
    if not tree.closures and not tree.couplings:
        unread_effects(tree)
        raise RobotFileError("there is no loop in it: a parallel robot needs at least one closure")
    _check_closures(tree.closures)
    if options.base is not None:
        lock_outside_base(tree, options.base, reference)
    apply_locks(tree, options.locked, reference)
    fix_coupled_joints(tree)
    loops = [one for one in tree.closures if any(tree.moving_chains(*map(tree.link_of, one.frames)))]
    if not loops and not tree.couplings:
        raise _no_loop_error(options, tree.closures)
    actuators = attach_transmissions(tree)
    description = RobotDescription(
        name=_choose_name(tree.root, file),
        file=file,
        urdf_text="",
        platform=Platform(tree.base, ()),
        actuators=actuators,
        closures=tuple(loops),
        couplings=tuple(tree.couplings),
        joints=_moving_dynamics(tree),
        gravity=tree.gravity,
        reference={name: value for name, value in reference.items() if name in tree.coordinates},
    )
    try:
        known = complete_robot(options, PartialRobot(tree, description))
    except FrameworkError:
        unread_effects(tree)  # its error is the more precise one
        raise
    urdf_text = tostring(tree.root, encoding="unicode")
    description = replace(known.description, urdf_text=urdf_text, left_out=unread_effects(tree))
    remarks = (*_remarks_on_omissions(tree), *tree.remarks, *known.remarks)
    return ParsedRobot(description, tree.root, dialect, remarks)


def _remarks_on_omissions(tree: UrdfTree) -> Iterator[str]:
    """Yield remarks on decisive elements that do not move, and on unused ones."""
    for item in tree.left_out:
        if item.is_decisive and not any(is_moved(tree, name) for name in item.acts_on):
            yield f"not used, since it does not move: {item.what}"
    if unused := ", ".join(f"{count} {kind}" for kind, count in tree.unused.items()):
        yield f"not used: {unused}"


def _check_closures(closures: Sequence[Closure]) -> None:
    """Refuse too many closures, equal names, and a frame joined with itself."""
    if len(closures) > MAX_LOOPS:
        raise RobotFileError(f"{len(closures)} loops; at most {MAX_LOOPS} are read")
    check_unique("closures", [closure.name for closure in closures])
    for closure in closures:
        if closure.frames[0] == closure.frames[1]:
            raise RobotFileError(
                f"closure {closure.name!r}: joins {closure.frames[0]!r} with itself; needs two frames"
            )


def _no_loop_error(options: Options, closures: Sequence[Closure]) -> RobotFileError:
    """Return the error for a file without a loop that moves."""
    if options.base is not None:
        return RobotFileError(f"--base: no loop moves that link {options.base!r} carries")
    if not closures or options.locked:
        return RobotFileError("--lock: no loop moves any more")
    first, second = closures[0].frames
    return RobotFileError(
        f"closure {closures[0].name!r}: no joint moves between {first!r} and {second!r}, so it closes no loop"
    )


def _choose_name(root: Element, file: Path) -> str:
    """Choose the first name fit for files: the model's, the file's, its folders'."""
    for name in (root.get("name", ""), file.stem, *(folder.name for folder in file.absolute().parents[:2])):
        clean = "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in name)
        if name.lower() not in _NO_NAMES and clean.strip("_"):
            return clean
    return file.stem


def _moving_dynamics(tree: UrdfTree) -> dict[str, JointDynamics]:
    """Return the dynamics of moving coordinates, of the dialect or of <dynamics>."""
    dynamics = {**merge_joint_dynamics(declared_dynamics(tree.root), {}), **tree.dynamics}
    moving = {name: value for name, value in dynamics.items() if name in tree.coordinates}
    for name, value in moving.items():
        if min(value.armature, value.damping, value.friction, value.stiffness) < 0.0:
            raise RobotFileError(
                f"joint {name!r}: armature, damping, friction and stiffness must not be negative"
            )
    return moving


# ------------------------------------------------------------------ what moves


def lock_outside_base(tree: UrdfTree, base: str, reference: Mapping[str, float]) -> None:
    """Lock joints that link `base` does not carry, at the reference [rad, m] or zero."""
    check_name("--base", "link", base, tree.links)
    carried = {
        joint.name
        for joint in tree.joints.values()
        if any(above.parent == base for above in tree.path_to_base(joint.child))
    }
    if not any(tree.joints[name].moves for name in carried):
        raise RobotFileError(
            f"--base: no joint moves that link {base!r} carries; give a link nearer to the root"
        )
    for joint in list(tree.joints.values()):
        if joint.moves and joint.name not in carried:
            tree.fix_at_reference(joint, reference)


def apply_locks(tree: UrdfTree, locked: Mapping[str, float | None], reference: dict[str, float]) -> None:
    """Lock joints at values [rad, m]; None means the reference, else zero.

    Of a ball J one turn can be locked, J_rx, J_ry or J_rz: the ball becomes a cross about the other two,
    whose angles enter the reference.
    """
    for name, value in locked.items():
        ball = tree.joints.get(name[:-3])
        if ball is not None and ball.kind == "spherical" and name in ball.coordinates:
            turn = [reference.pop(key, 0.0) for key in ball.coordinates]
            reference.update(tree.lock_turn_of_ball(ball, name[-1], value, turn))
            continue
        if name in tree.fixed_at:
            continue  # by --base, or with another joint
        movable = [joint.name for joint in tree.joints.values() if joint.moves]
        check_name("--lock", "joint that moves", name, movable)
        joint = tree.joints[name]
        if value is not None and len(joint.coordinates) > 1 and value:
            raise RobotFileError(
                f"--lock: {name!r} is {joint.kind}; give {name} alone, and its turn by --reference "
                f"{joint.coordinates[-1]}=VALUE"
            )
        tree.fix_at_reference(joint, reference if value is None else dict.fromkeys(joint.coordinates, value))


def fix_coupled_joints(tree: UrdfTree) -> None:
    """Fix joints coupled with fixed ones; keep the couplings of moving joints."""
    while further := locked_through_couplings(
        tree.couplings, {name: values[0] for name, values in tree.fixed_at.items()}
    ):
        for name, value in further.items():
            tree.fix(tree.joints[name], value)
    tree.couplings = [c for c in tree.couplings if tree.joints[c.joint].moves and tree.joints[c.of].moves]


# ------------------------------------------------------------------ what acts


def attach_transmissions(tree: UrdfTree) -> tuple[Actuator, ...]:
    """Attach motors and tendons to the joint that each drives; return the motors.

    A tendon over joints that couplings make one is a transmission to that one. Of two motors on a joint,
    such as a servo's position and speed, the first is taken.
    """
    actuators: dict[str, Actuator] = {}
    for drive in tree.transmissions:
        has_dynamics = replace(drive.dynamics, rest=0.0) != JointDynamics()
        arms, constant = reduce_to_leaders(tree, drive.arms)
        if len(arms) > 1:
            if drive.is_motor or has_dynamics:
                text = f"{drive.name}: pulls at {' and '.join(arms)}, which move independently"
                tree.left_out.append(UnreadElement(text, tuple(arms)))
            continue
        for joint, arm in arms.items():
            gear = drive.gear * arm
            if drive.is_motor and gear:
                actuators.setdefault(joint, Actuator(joint, abs(gear), torque_limit=drive.torque_limit))
            if has_dynamics:
                along = replace(drive.dynamics, rest=drive.dynamics.rest - drive.gear * constant)
                own = tree.dynamics.get(joint, JointDynamics())
                tree.dynamics[joint] = own + along.reflect_through(gear)
    return tuple(actuators.values())


def reduce_to_leaders(tree: UrdfTree, arms: Mapping[str, float]) -> tuple[dict[str, float], float]:
    """Reduce a length sum(c q) to leading joints: arms and a constant.

    A joint that follows another by a coupling is replaced by q = ratio q_of + offset, a fixed one by its
    value.
    """
    followed = {coupling.joint: coupling for coupling in tree.couplings}
    leaders = defaultdict[str, float](float)
    constant = 0.0
    for name, value in arms.items():
        joint, arm = name, value
        for _ in followed:  # no chain of couplings has more links
            if coupling := followed.get(joint):
                constant += arm * coupling.offset
                arm *= coupling.ratio
                joint = coupling.of
        if tree.joints[joint].moves:
            leaders[joint] += arm
        else:
            constant += arm * tree.fixed_at.get(joint, (0.0,))[0]
    return {joint: arm for joint, arm in leaders.items() if arm}, constant


def unread_effects(tree: UrdfTree) -> tuple[str, ...]:
    """Return the unread effects on parts that move; refuse decisive ones."""
    concerned = [item for item in tree.left_out if any(is_moved(tree, name) for name in item.acts_on)]
    for item in concerned:
        if item.is_decisive:
            raise RobotFileError(item.what)
    return tuple(dict.fromkeys(item.what for item in concerned))


def is_moved(tree: UrdfTree, name: str) -> bool:
    """Return whether a joint, or the link of this name, can move."""
    if name in tree.joints:
        return tree.joints[name].moves
    return name in tree.parent_joint and any(joint.moves for joint in tree.path_to_base(name))


# ------------------------------------------------------------------ what the file leaves out


def complete_robot(options: Options, known: PartialRobot) -> PartialRobot:
    """Complete the content of a file by the options, else the file, else proposals.

    What is said nowhere is an error, which names the options and the candidates.
    """
    joints, description = known.tree.movable, known.description
    if options.motors is not None:
        check_distinct("--motors", "movable joint", options.motors, joints)
        motors = {motor.joint: motor for motor in description.actuators}
        chosen = tuple(motors.get(name, Actuator(name)) for name in options.motors)
        description = replace(description, actuators=chosen)
    platform = _choose_platform(options, known)
    known = known._replace(description=description, platform=platform)
    if options.propose is not None:
        return options.propose(options, known)
    if platform is not None and description.actuators:
        return known.with_platform(platform)
    missing = []
    if platform is None and options.platform is None:
        missing.append(f"--platform FRAME (of: {list_names(known.tree.frames)})")
    if platform is None and options.axes is None:
        missing.append(f"--axes (of: {', '.join(AXES)})")
    if not description.actuators:
        missing.append(f"--motors (of: {list_names(known.tree.likely_motors or joints)})")
    raise RobotFileError(
        f"the file does not say: give {'; '.join(missing)}; or let `crossing convert` propose them"
    )


def _choose_platform(options: Options, known: PartialRobot) -> Platform | None:
    """Return the platform by options and file; None where both leave one open."""
    frame, platform, joints = options.platform, known.platform, options.platform_joints
    if frame is not None:
        check_name("--platform", "frame", frame, known.tree.frames)
    if joints is not None:
        if options.axes is not None:
            raise RobotFileError("--platform-joints: the platform has joints or --axes, not both")
        check_distinct("--platform-joints", "movable joint", joints, known.tree.movable)
        return Platform(frame or known.tree.joints[joints[-1]].child, (), joints)
    if options.axes is not None:
        check_distinct("--axes", "axis", options.axes, AXES)
        frame = frame or (platform.frame if platform else None)
        return None if frame is None else Platform(frame, options.axes)
    return platform if platform is None or frame is None else replace(platform, frame=frame)


def merge_reference(options: Options, names: Sequence[str], own: Mapping[str, float]) -> dict[str, float]:
    """Override the file's reference [rad, m] by the options', checked against `names`."""
    for name in options.reference:
        check_name("--reference", "movable joint", name, names)
    return {**own, **{name: float(value) for name, value in options.reference.items()}}
