"""Make the records of a foreign file once its tree and its loops are read.

Options can select a part of a larger robot: all other joints are locked at the reference, so that a leg of a
humanoid or the wrist of an arm can be examined without editing its file. Motors and tendons act on the joints
that they drive. Effects that the records cannot express are named with their size. Options state the
platform, axes, motors and reference that the file leaves out; without options they are proposed.
"""

from __future__ import annotations

import os
import re
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from framework.errors import (
    FrameworkError,
    InvalidInput,
    MissingPackage,
    RobotFileError,
    check_name,
    check_unique,
    list_names,
)
from framework.model.description import (
    AXES,
    Actuator,
    Closure,
    JointDynamics,
    Platform,
    RobotDescription,
)
from framework.model.documents import parse_numbers
from framework.model.readers.urdf_tree import MAX_LOOPS, UnreadElement, UrdfTree
from framework.model.robot_keys import RobotReader, closure_entry
from framework.model.urdf_edits import urdf_text
from framework.model.urdf_elements import (
    PACKAGE,
    ParsedRobot,
    declared_couplings,
    declared_dynamics,
    locate_urdf,
)
from framework.numerics.arrays import Names
from framework.numerics.fields import check_distinct

# names that exporters give to every model
_GENERIC_NAMES = ("", "mjcf", "model", "mujoco", "mujoco model", "onshape", "robot", "scene", "urdf")


class PartialRobot(NamedTuple):
    """The content of a file, which may lack platform and motors."""

    tree: UrdfTree
    description: RobotDescription  # with the motors of the file; its platform is a stand-in
    platform: Platform | None = None  # that the file states
    chooses_motors: bool = False  # whether to choose among motors where the file has too many
    remarks: tuple[str, ...] = ()
    # whether the file is completed with some fields of Options changed; advice is given only where it is
    is_answered: Callable[..., bool] = lambda **_: False

    def with_platform(self, platform: Platform, *remarks: str) -> PartialRobot:
        """Return the content with a platform in its description, and further remarks."""
        description = replace(self.description, platform=platform)
        return self._replace(description=description, remarks=self.remarks + remarks)


@dataclass(frozen=True)
class Options:
    """The options of a reader; None means the file's value.

    `reference` [rad, m] is by names of joints; those of a ball J are J_rx, J_ry, J_rz (a rotation vector).
    Without it the reference of a foreign file is the one that the file states, else the zero pose. `locked`
    [rad, m] are joints to lock, at the reference if the value is None. `propose` completes what is missing.
    """

    platform: str | None = None  # frame
    axes: Names | None = None  # of the platform, out of AXES
    motors: Names | None = None  # joints
    reference: Mapping[str, float] = field(default_factory=dict)
    base: str | None = None  # a link; joints that it does not carry are locked
    locked: Mapping[str, float | None] = field(default_factory=dict)
    platform_joints: Names | None = None  # coordinates of the platform, instead of axes
    closures: Sequence[Sequence[str]] = ()  # two frames, a kind, and an axis or a length, of each
    packages: Sequence[str] = ()  # NAME=FOLDER, where meshes of package://NAME/ are
    propose: Propose | None = None

    @property
    def is_silent(self) -> bool:
        """Whether the options say nothing about platform and motors."""
        return not (self.platform or self.axes or self.platform_joints or self.motors)


Propose = Callable[[Options, PartialRobot], PartialRobot]  # completes a robot by guesses


def describe(tree: UrdfTree, file: Path, options: Options, dialect: str) -> ParsedRobot:
    """Make the description of a tree and its loops, completed by the options.

    Joints that --base does not carry and joints of --lock become fixed, and forces on them are ignored.

    Args:
        tree: the content of the file; its locked joints become fixed.
        file: the file that was read.
        options: override and complete the file.
        dialect: one of `recognise.DIALECTS`.

    Raises:
        RobotFileError: there is no loop that moves; a closure joins a frame with itself; names are repeated
            or unknown; a joint has a negative armature, damping, friction or stiffness; an unread element
            decides how a part moves; platform or motors are missing.
    """
    reference = merge_reference(options, tree.coordinates, tree.reference)
    tree.couplings += declared_couplings(tree)
    tree.closures += [_read_typed_closure(tree, words) for words in options.closures]
    _locate_meshes(tree, file, options.packages)
    if not tree.closures and not tree.couplings:
        # raises a more precise error if a decisive element is unread
        unread = "; ".join(unread_effects(tree)[:2])
        reason = f"; not read: {unread}" if unread else ": --close FRAME FRAME KIND closes one"
        raise RobotFileError(f"there is no loop in it{reason}")
    if len(tree.closures) > MAX_LOOPS:
        raise RobotFileError(f"{len(tree.closures)} loops; at most {MAX_LOOPS} are read")
    check_unique("closures", [closure.name for closure in tree.closures])
    for closure in tree.closures:
        first, second = closure.frames
        if first == second:
            raise RobotFileError(f"closure {closure.name!r}: joins {first!r} with itself; needs two frames")

    # lock joints; then only loops in which a joint still moves count
    if options.base is not None:
        lock_outside_base(tree, options.base, reference)
    apply_locks(tree, options.locked, reference)
    tree.fix_coupled_joints()
    loops = [closure for closure in tree.closures if _is_moving(tree, closure.frames)]
    if not loops and not tree.couplings:
        if options.base is not None:
            raise RobotFileError(f"--base: no loop moves that link {options.base!r} carries")
        if not tree.closures or options.locked:
            raise RobotFileError("--lock: no loop moves any more")
        first, second = tree.closures[0].frames
        where = f"closure {tree.closures[0].name!r}"
        raise RobotFileError(
            f"{where}: no joint moves between {first!r} and {second!r}, so it closes no loop"
        )

    # URDF and platform are stand-ins until options or proposals have completed the robot
    actuators = attach_transmissions(tree)  # adds to the dynamics of joints
    dynamics = declared_dynamics(tree)
    for name, value in dynamics.items():
        if min(value.armature, value.damping, value.friction, value.stiffness) < 0.0:
            raise RobotFileError(
                f"joint {name!r}: armature, damping, friction and stiffness must not be negative"
            )
    names = [tree.name, file.stem, *(folder.name for folder in file.absolute().parents[:2])]
    telling = (name for name in names if name.lower() not in _GENERIC_NAMES)
    file_names = (re.sub(r"[^\w-]", "_", name) for name in telling)
    description = RobotDescription(
        name=next((name for name in file_names if name.strip("_")), file.stem),
        file=file,
        urdf_text="",
        platform=Platform(tree.base),
        actuators=actuators,
        closures=tuple(loops),
        couplings=tuple(tree.couplings),
        line_springs=tuple(spring for spring in tree.line_springs if _is_moving(tree, spring.between)),
        joints=dynamics,
        gravity=tree.gravity,
        reference={name: value for name, value in reference.items() if name in tree.coordinates},
    )
    try:
        completed = complete_robot(options, PartialRobot(tree, description))
    except FrameworkError:
        unread_effects(tree)  # raises a more precise error if a decisive element is unread
        raise

    left_out = unread_effects(tree)
    description = replace(completed.description, urdf_text=urdf_text(tree), left_out=left_out)
    idle = [
        item
        for item in tree.left_out
        if item.is_decisive and not any(is_moved(tree, x) for x in item.acts_on)
    ]
    omissions = [f"not used, since it does not move: {item.what}" for item in idle]
    if tree.unused:
        omissions.append("not used: " + ", ".join(f"{count} {kind}" for kind, count in tree.unused.items()))
    remarks = (*omissions, *tree.remarks, *completed.remarks)
    return ParsedRobot(description, tree, dialect, remarks, reference)


def _read_typed_closure(tree: UrdfTree, words: Sequence[str]) -> Closure:
    """Read the words of `--close FRAME FRAME KIND [AXIS or LENGTH]`; return the closure.

    An entry has the keys of a closure in a robot file; a few kinds have a length [m] instead of an axis.
    """
    where = f"--close {' '.join(words)}"
    if len(words) not in (3, 4):
        raise RobotFileError(f"{where}: needs FRAME FRAME KIND, and an axis or a length of some kinds")
    entry = closure_entry(words)
    if "length" in entry:
        (entry["length"],) = parse_numbers(f"{where}: length", words[-1], 1)
    return RobotReader(tree).closure(where, entry)


def _locate_meshes(tree: UrdfTree, file: Path, packages: Sequence[str]) -> None:
    """Replace package://NAME/ in the paths of meshes by the stated folders; remark on missing files.

    Args:
        file: that was read, from whose folder paths start.
        packages: NAME=FOLDER each.
    """
    folders = {"": os.fspath(file.parent)}  # some exporters write package:///FILE
    for word in packages:
        name, equals, folder = word.partition("=")
        if not equals or not os.path.isdir(folder):
            raise RobotFileError(f"--package: needs NAME=FOLDER with a folder that exists, got {word!r}")
        folders[name] = folder
    missing = []
    for mesh in [mesh for link in tree.links.values() for mesh in link.iter("mesh")]:
        reference = mesh.get("filename", "")
        package, _, rest = reference.removeprefix(PACKAGE).partition("/")
        if reference.startswith(PACKAGE) and package in folders:
            reference = str(Path(folders[package], rest).resolve())
            mesh.set("filename", reference)
        try:
            is_there = locate_urdf(file.parent, reference.removeprefix("file://")).is_file()
        except (InvalidInput, MissingPackage):
            is_there = False
        if not is_there:
            missing.append(reference)
    if missing:
        package, _, _ = missing[0].removeprefix(PACKAGE).partition("/")
        hint = f"; --package {package}=FOLDER says where" if missing[0].startswith(PACKAGE) else ""
        tree.remarks.append(f"meshes not found, and not drawn: {len(missing)}, such as {missing[0]}{hint}")


def _is_moving(tree: UrdfTree, frames: tuple[str, str]) -> bool:
    """Return whether a joint moves between two frames."""
    first, second = frames
    return any(tree.moving_chains(tree.link_of(first), tree.link_of(second)))


# ------------------------------------------------------------------ joints that move


def lock_outside_base(tree: UrdfTree, base: str, reference: Mapping[str, float]) -> None:
    """Lock joints that link `base` does not carry, at the reference [rad, m] or zero.

    Raises:
        RobotFileError: there is no such link, or it carries no joint that moves.
    """
    check_name("--base", "link", base, tree.links)
    moving = [joint for joint in tree.joints.values() if joint.moves]
    outside = [
        joint
        for joint in moving
        if all(ancestor.parent != base for ancestor in tree.path_to_base(joint.child))
    ]
    if len(outside) == len(moving):
        raise RobotFileError(
            f"--base: no joint moves that link {base!r} carries; give a link nearer to the root"
        )
    coordinates = [name for joint in outside for name in joint.coordinates if reference.get(name)]
    if posture := [f"{name} {reference[name]:.4g}" for name in coordinates]:
        tree.remarks.append(f"held by --base, in the file's posture: {', '.join(posture)}")
    for joint in outside:
        tree.fix_at_reference(joint, reference)


def apply_locks(tree: UrdfTree, locked: Mapping[str, float | None], reference: dict[str, float]) -> None:
    """Lock joints at values [rad, m].

    A lock named J_rx, J_ry or J_rz locks one rotation of a ball J. The ball then becomes two hinges, whose
    angles replace those of the ball in `reference`.

    Args:
        locked: value of each lock by its name; None means the reference, or zero if the reference has none.
        reference: positions [rad, m] by coordinate, which locked balls change.

    Raises:
        RobotFileError: no joint of such a name moves; a joint of several freedoms has a value; a new hinge of
            a ball would have a name that is taken.
    """
    for name, value in locked.items():
        ball = tree.joints.get(name[:-3])  # J of J_rx; None after another lock has made hinges of J
        if ball is not None and ball.kind == "spherical" and name in ball.coordinates:
            rotation_vector = [reference.pop(key, 0.0) for key in ball.coordinates]
            reference.update(tree.lock_turn_of_ball(ball, name[-1], value, rotation_vector))
            continue
        if name in tree.fixed_positions:
            continue  # already locked, since --base does not carry the joint or through a coupling
        movable = [joint.name for joint in tree.joints.values() if joint.moves]
        check_name("--lock", "joint that moves", name, movable)
        joint = tree.joints[name]
        if value and len(joint.coordinates) > 1:  # one value does not say about which axis
            raise RobotFileError(
                f"--lock: {name!r} is {joint.kind}; give {name} alone, and its turn by --reference "
                f"{joint.coordinates[-1]}=VALUE"
            )
        tree.fix_at_reference(joint, reference if value is None else dict.fromkeys(joint.coordinates, value))


# ------------------------------------------------------------------ motors and tendons


def attach_transmissions(tree: UrdfTree) -> tuple[Actuator, ...]:
    """Attach motors and tendons to the joint that each drives; return the motors.

    A tendon over several joints drives one joint if couplings make the others follow it. If a joint has two
    motors, such as a servo's position and speed actuator, the first counts.
    """
    actuators: dict[str, Actuator] = {}
    for drive in tree.transmissions:
        has_dynamics = replace(drive.dynamics, rest=0.0) != JointDynamics()
        arms, constant = reduce_to_leaders(tree, drive.arms)
        if len(arms) > 1 and len(drive.arms) == 1:  # on one joint that follows several
            arms, constant = dict(drive.arms), 0.0
        if len(arms) > 1:
            if drive.is_motor or has_dynamics:
                text = f"{drive.name}: pulls at {' and '.join(arms)}, which move independently"
                tree.left_out.append(UnreadElement(text, tuple(arms)))
            continue
        for joint, arm in arms.items():  # one joint, or none that moves
            gear = drive.gear * arm
            if drive.is_motor and gear:
                # a motor on one joint stays there, also if this joint follows another
                (name, own_arm), *others = drive.arms.items()
                motor_joint, motor_gear = (joint, gear) if others else (name, drive.gear * own_arm)
                motor = Actuator(motor_joint, abs(motor_gear), torque_limit=drive.torque_limit)
                actuators.setdefault(joint, motor)
            if has_dynamics:
                # before the gear the coordinate is gear * (arm q + constant): subtract its constant part
                rest = drive.dynamics.rest - drive.gear * constant
                reflected = replace(drive.dynamics, rest=rest).reflect_through(gear)
                driven = tree.joints[joint]
                tree.put(replace(driven, dynamics=driven.dynamics + reflected))
    return tuple(actuators.values())


def reduce_to_leaders(tree: UrdfTree, arms: Mapping[str, float]) -> tuple[dict[str, float], float]:
    """Express a length sum(arm q) by joints that follow no other linearly.

    A joint that follows others by a linear coupling is replaced by them, a fixed joint by its position.
    Offsets and fixed positions add up to a constant: length = sum(arm q) + constant.

    Args:
        arms: moment arm of each joint.

    Returns:
        The moment arms of the joints that move and follow no other, without zeros; the constant part of the
        length.
    """
    equations = {coupling.joint: coupling.equation for coupling in tree.couplings if coupling.is_linear}
    length = defaultdict[str, float](float, arms)
    constant = 0.0
    for _ in equations:  # a chain of couplings is no longer than this
        for joint in [joint for joint in length if joint in equations]:
            arm = length.pop(joint)
            for product, coefficient in equations[joint].items():
                if not product:
                    constant -= arm * coefficient
                elif product != (joint,):
                    length[product[0]] -= arm * coefficient
    for joint in [joint for joint in length if not tree.joints[joint].moves]:
        constant += length.pop(joint) * tree.fixed_positions.get(joint, 0.0)
    return {joint: arm for joint, arm in length.items() if arm}, constant


def unread_effects(tree: UrdfTree) -> tuple[str, ...]:
    """Return the unread effects on parts that move.

    Raises:
        RobotFileError: an unread element decides how a part moves.
    """
    effects = []
    for item in tree.left_out:
        if any(is_moved(tree, name) for name in item.acts_on):
            if item.is_decisive:
                raise RobotFileError(item.what)
            effects.append(item.what)
    return tuple(dict.fromkeys(effects))


def is_moved(tree: UrdfTree, name: str) -> bool:
    """Return whether the joint or link of this name can move."""
    if name in tree.joints:
        return tree.joints[name].moves
    return any(joint.moves for joint in tree.path_to_base(name))


# ------------------------------------------------------------------ what the file leaves out


def complete_robot(options: Options, partial: PartialRobot) -> PartialRobot:
    """Complete the `partial` content of a file by the options, else by proposals.

    Raises:
        RobotFileError: platform or motors are missing (the message names the options and the candidates), or
            the options name unknown or repeated ones.
    """
    joints = partial.tree.movable
    description = partial.description
    if options.motors is not None:
        check_distinct("--motors", "movable joint", options.motors, joints)
        motors = {motor.joint: motor for motor in description.actuators}
        chosen = tuple(motors.get(name, Actuator(name)) for name in options.motors)
        description = replace(description, actuators=chosen)
    platform = _choose_platform(options, partial)
    partial = partial._replace(description=description, platform=platform)
    if options.propose is not None:
        return options.propose(options, partial)
    if platform is not None and description.actuators:
        return partial.with_platform(platform)

    missing = []
    if platform is None and options.platform is None:
        missing.append(f"--platform FRAME (of: {list_names(partial.tree.frames)})")
    if platform is None and options.axes is None:
        missing.append(f"--axes (of: {', '.join(AXES)})")
    if not description.actuators:
        missing.append(f"--motors (of: {list_names(partial.tree.likely_motors or joints)})")
    raise RobotFileError(
        f"the file does not say: give {'; '.join(missing)}; or let `crossing convert` propose them"
    )


def _choose_platform(options: Options, partial: PartialRobot) -> Platform | None:
    """Return the stated platform: the file's, overridden by options; None unless frame and axes are known."""
    frame = options.platform
    joints = options.platform_joints
    platform = partial.platform
    if frame is not None:
        check_name("--platform", "frame", frame, partial.tree.frames)
    if joints is not None:
        if options.axes is not None:
            raise RobotFileError("--platform-joints: the platform has joints or --axes, not both")
        check_distinct("--platform-joints", "movable joint", joints, partial.tree.movable)
        return Platform(frame or partial.tree.joints[joints[-1]].child, joints=joints)
    if options.axes is not None:
        check_distinct("--axes", "axis", options.axes, AXES)
        frame = frame or (platform.frame if platform else None)
        return None if frame is None else Platform(frame, options.axes)
    return platform if platform is None or frame is None else replace(platform, frame=frame)


def merge_reference(options: Options, names: Sequence[str], own: Mapping[str, float]) -> dict[str, float]:
    """Return the reference positions [rad, m] of a file, overridden by the options.

    Args:
        names: coordinates that a reference may name.
        own: reference of the file, by coordinate.

    Raises:
        RobotFileError: the options name another coordinate.
    """
    reference = dict(own)
    for name, value in options.reference.items():
        check_name("--reference", "movable joint", name, names)
        reference[name] = float(value)
    return reference
