"""Propose platform, axes, motors and reference of a mechanism if its file states none.

Proposals follow from the motions that the loops allow at a closed pose. The motors are those of the file, or
else the joints nearest to the base that determine the motions. The platform is a body that every motor moves.
Its coordinates are the positions of the joints that carry it, if there are as many as freedoms and none has a
motor (pitch and roll of an ankle). They are its turns if the motors turn it about one point. Otherwise they
are the axes of one of its frames along which it moves best. Each proposal is tested before it is made: the
robot must assemble, its platform must move along each axis, and its motors must drive all motions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import combinations
from math import comb
from typing import Any

import numpy as np
import pinocchio as pin

from framework.errors import FrameworkError, NotAssembled, RobotFileError, SingularReference
from framework.kinematics.diagnostics.mobility import (
    BESIDE_SINGULARITY,
    MAX_LISTED,
    PROPOSED_AXES_CLEARANCE,
    LoopMotions,
    count_freedoms,
    coupled_joints,
    examine_platform_axes,
    motions_near_reference,
    motions_within_limits,
    null_space,
    scaled_twists,
)
from framework.kinematics.loop_structure import choose_rows
from framework.kinematics.mechanism import frame_index
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.description import AXES, Actuator, Closure, Platform, RobotDescription
from framework.model.readers.describe import Options, PartialRobot
from framework.model.readers.recognise import parse_any
from framework.model.readers.urdf_tree import UrdfTree, merge_overlapping
from framework.model.urdf_edits import urdf_text
from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import least_singular_values
from framework.tolerances import ALIKE_CHOICES, FILE_ROUNDING, NEARLY_AT_REST

IN_NO_LOOP = "in no loop; --motors or --platform say otherwise"
# Parts of the usual names of tools and platforms.
NAMES_OF_TOOLS = ("effector", "tcp", "tool", "tip", "platform", "plate", "foot", "sole", "hand", "eff", "pad")


class _UndrivenMotions(RobotFileError):
    """The error for motions that no motor drives: `joints` can be held, for the reason `why`."""

    def __init__(self, message: str, motions: LoopMotions, joints: Sequence[str], why: str) -> None:
        """Store the message, the joints to hold, the reason `why`, and the closed pose as a reference."""
        super().__init__(message)
        self.joints, self.why, self.remarks = joints, why, motions.remarks
        self.reference = motions.mechanism.reference_values(motions.q)


def propose(options: Options, partial: PartialRobot) -> PartialRobot:
    """Complete the description with missing platform, motors and reference; remark on each.

    Options that the remarks and errors advise have been tried on the file.

    Raises:
        NotAssembled, RobotFileError: as `_propose`.
    """

    def is_answered(**changes: Any) -> bool:
        """Return whether the file is completed with changed options."""
        locked = {**options.locked, **changes.pop("locked", {})}
        trial = vars(options) | changes | {"locked": locked, "propose": _propose}
        with suppress(FrameworkError):
            parse_any(partial.description.file, **trial)
            return True
        return False

    return _propose(options, partial._replace(is_answered=is_answered))


def _propose(options: Options, partial: PartialRobot) -> PartialRobot:
    """Complete the description with missing platform, motors and reference; remark on each.

    Serial joints are those in no loop. Free bases are held. So are serial joints that carry no loop (a wrist
    on a delta), unless the options name them or they carry the platform. If nothing can be proposed for the
    robot then, springs and idle turns without a motor are held, too, and, unless the options exclude it,
    serial joints that carry loops (the hip of a leg).

    Raises:
        NotAssembled: the loops close nowhere.
        RobotFileError: nothing can be proposed; the message names sufficient options.
    """
    partial = partial._replace(chooses_motors=options.motors is None)
    serial = _serial_joints(partial)
    free = [name for name in serial if partial.tree.joints[name].kind == "floating"]
    partial = _hold_joints(partial, free, "a free base, which no motor drives")
    without_loops, carrying_loops = _split_serial_joints(partial, options)
    partial = _hold_joints(partial, without_loops, IN_NO_LOOP)
    if partial.platform is not None and options.motors is not None:
        with suppress(RobotFileError, NotAssembled):  # of what is stated only the reference may be missing
            return _complete_description(partial, by_joints=False)
        return partial.with_platform(partial.platform)

    if carrying_loops and options.is_silent:
        with suppress(RobotFileError):
            return _complete_description(partial, by_joints=False)
        partial = _hold_joints(partial, carrying_loops, IN_NO_LOOP)
    try:
        return _complete_description(partial, by_joints=True)
    except _UndrivenMotions as undriven:
        description = replace(partial.description, reference=undriven.reference)
        partial = partial._replace(description=description, remarks=(*partial.remarks, *undriven.remarks))
        return _complete_description(_hold_joints(partial, undriven.joints, undriven.why), by_joints=True)


def _complete_description(partial: PartialRobot, *, by_joints: bool) -> PartialRobot:
    """Complete the description with platform, motors and reference; lock no joints.

    At a singular reference a pose beside it is taken. If nothing can be proposed at the file's pose, and this
    pose exceeds joint limits, a pose within the limits is tried.

    Args:
        by_joints: whether positions of joints may become the platform's coordinates.
    """
    description = replace(partial.description, urdf_text=urdf_text(partial.tree))
    partial = partial._replace(description=description)
    try:
        return _complete_at_pose(partial, motions_near_reference(partial.description), by_joints=by_joints)
    except SingularReference as singular:
        if not singular.poses:
            raise
        beside = motions_near_reference(replace(partial.description, reference=singular.poses[0]))
        beside = beside._replace(remarks=(*beside.remarks, BESIDE_SINGULARITY))
        return _complete_at_pose(partial, beside, by_joints=by_joints)
    except RobotFileError:
        within = motions_within_limits(partial.description)
        if within is None:  # the file's pose is within the limits, or no closed pose is found
            raise
    return _complete_at_pose(partial, within, by_joints=by_joints)


def _complete_at_pose(partial: PartialRobot, motions: LoopMotions, *, by_joints: bool) -> PartialRobot:
    """Choose motors at a closed pose, then the first platform that the motors drive.

    Frames are tried first, then, if `by_joints`, positions of joints.
    """
    if not motions.freedoms and motions.basis.shape[1] and not motions.mechanism.mass:
        raise RobotFileError("no link that moves has a mass: an inertia is missing")
    if not motions.freedoms:
        names = sorted(_loop_joint_names(partial))
        more = f" and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else ""
        joints = f"{', '.join(names[:MAX_LISTED])}{more}"
        raise RobotFileError(f"the loops leave no freedom that moves a mass to their joints {joints}")
    partial = _choose_motors(motions, partial)
    _check_driven(motions, partial)
    if partial.platform is not None:
        return partial.with_platform(partial.platform)
    for platform in _likely_platforms(motions, partial):
        if _is_driven(partial.description, platform):
            remark = f"platform: {', '.join(platform.names)} of {platform.frame} (proposed)"
            return partial.with_platform(platform, remark)

    joint_platforms = list(_joint_platforms(motions, partial)) if by_joints else []
    for platform in joint_platforms:
        if _is_driven(partial.description, platform):
            max_motors = 12  # with which it is worth the time to try parts of the robot
            part = _advise_on_parts(partial) if len(partial.description.actuators) <= max_motors else ""
            alternative = f"; or {part.removesuffix(', ')}" if part else ""
            why = f"no body is moved by all of the motors{alternative}"
            remark = f"platform: the joints {', '.join(platform.names)} (proposed: {why})"
            return partial.with_platform(platform, remark)

    if joint_platforms:  # the construction of the robot may raise a more precise error
        ParallelRobot.from_description(replace(partial.description, platform=joint_platforms[-1]))
    # (nv, k) motions that move neither a mass nor a motor
    idle = motions.basis @ null_space(motions.working.T @ motions.basis)
    holding = _choose_joints_to_hold(motions, idle, partial)
    holding = _select_helpful(partial, holding)
    remedy = f"hold joints (such as --lock {' '.join(holding)})" if holding else "give --platform and --axes"
    part = _advise_on_parts(partial)
    remedies = f"{part}or {remedy}" if part else remedy
    raise RobotFileError(
        f"no body is moved by all of the motors {', '.join(partial.description.motor_joints)} along "
        f"{motions.freedoms} axes, and by them alone; {remedies}"
    )


def _choose_motors(motions: LoopMotions, partial: PartialRobot) -> PartialRobot:
    """Return the content of the file with the closed pose as reference and with motors.

    If the file has more motors than there are freedoms, the best ones are chosen, unless options name the
    motors.
    """
    mechanism = motions.mechanism
    description = replace(mechanism.description, reference=mechanism.reference_values(motions.q))
    actuators, remarks = description.actuators, [*motions.remarks]
    if not actuators:
        # joints whose rates determine the motions that move a mass or a motor: first those that the file
        # suggests as motors, or slides if there is one for each motion (as in the legs of a Stewart
        # platform), then those nearest to the base
        by_depth = sorted(
            partial.tree.movable,
            key=lambda name: len(partial.tree.path_to_base(partial.tree.joints[name].child)),
        )
        in_loops = _loop_joint_names(partial)
        likely, why = partial.tree.likely_motors, "nearest to the base"
        slides = [name for name in partial.tree.movable if partial.tree.joints[name].kind == "prismatic"]
        if not likely and len(slides) == motions.freedoms > 1 and in_loops.issuperset(slides):
            likely, why = slides, "the slides"
        suggested = [name for name in likely if name in by_depth]
        without_repetitions = dict.fromkeys([*suggested, *by_depth])
        motors = motions.choose_independent(motions.working, without_repetitions)
        actuators = tuple(map(Actuator, motors))
        remarks.append(f"motors: {', '.join(motors)} (proposed: {why})")
    elif partial.chooses_motors and len(actuators) > motions.freedoms:
        motors = _choose_best_motors(motions, partial)
        remarks.append(
            f"motors: {', '.join(motors)} (of {len(actuators)} in the file, for {motions.freedoms} freedoms: "
            f"these tell them apart best at the reference)"
        )
        actuators = tuple(actuator for actuator in actuators if actuator.joint in motors)
    description = replace(description, actuators=actuators)
    return partial._replace(description=description, remarks=(*partial.remarks, *remarks))


def _advise_on_parts(partial: PartialRobot) -> str:
    """Return advice to select one of several parts with loops, such as a leg; empty without several.

    The links that a joint carries are a part if they have several of the motors but not all, and only whole
    loops.
    """
    tree, description = partial.tree, partial.description
    motor_paths = [tree.path_to_base(tree.joints[name].child) for name in description.motor_joints]
    loop_paths = []  # the paths from both ends of each loop
    for closure in description.closures:
        loop_paths.append([tree.path_to_base(tree.link_of(frame)) for frame in closure.frames])
    for joint in sorted(tree.joints.values(), key=lambda joint: len(tree.path_to_base(joint.child))):
        carried_ends = {sum(joint in path for path in paths) for paths in loop_paths}  # 0, 1 or 2 of a loop
        carried_motors = sum(joint in path for path in motor_paths)
        has_whole_loops = carried_ends == {0, 2}  # each loop is carried with both ends or not at all
        is_part = 1 < carried_motors < len(motor_paths) and has_whole_loops
        if is_part and partial.is_answered(base=joint.child):
            return f"take a part of the robot (such as --base {joint.child}), "
    # lock all loops that share no joint with the first one; if they have motors, these are enough
    # each group: joints of loops that share joints, directly or through others; no group without closures
    groups = merge_overlapping(_loop_joints(tree, loop) for loop in description.closures)
    first_group, *others = groups or [[]]
    other_joints = [name for joints in others for name in joints]
    to_lock = [name for name in other_joints if name in description.motor_joints] or other_joints
    to_lock = _select_helpful(partial, to_lock)
    if not to_lock:
        return ""
    first_joint = first_group[0]
    return f"hold the loops beside those of {first_joint} (such as --lock {' '.join(to_lock)}), "


def _loop_joints(tree: UrdfTree, closure: Closure) -> list[str]:
    """Return the names of the joints between the two frames of a closure."""
    chains = tree.moving_chains(*map(tree.link_of, closure.frames))
    return [joint.name for chain in chains for joint in chain]


def _choose_best_motors(motions: LoopMotions, partial: PartialRobot) -> list[str]:
    """Choose as many of the file's motors as freedoms, with the best conditioned rates.

    Conditioned best are the rates with the largest least singular value. Beyond `max_choices` sets of motors,
    pivoting chooses.
    """
    max_choices = 20_000
    names = partial.description.motor_joints
    count = motions.freedoms
    rates = motions.rates(names)  # (n_a, w)
    if comb(len(names), count) > max_choices:
        return [names[i] for i in choose_rows(rates, count)]

    choices = np.array(list(combinations(range(len(names)), count)))  # (choices, count) indices of motors
    clearances = least_singular_values(rates[choices])  # (choices,)
    best_two = np.argsort(-clearances, kind="stable")[:2]
    largest, second_largest = clearances[best_two]
    best, second = ([names[i] for i in choice] for choice in choices[best_two])
    if largest > FILE_ROUNDING and second_largest > (1.0 - ALIKE_CHOICES) * largest:
        helpful = [choice for choice in (best, second) if partial.is_answered(motors=tuple(choice))]
        advice = " or ".join(f"--motors {' '.join(choice)}" for choice in helpful) or "--motors"
        raise RobotFileError(
            f"{len(names)} motors for {count} freedoms, and none are better than others: give {advice}"
        )
    return best


def _select_helpful(partial: PartialRobot, joints: list[str]) -> list[str]:
    """Return the joints if a file with these joints locked is completed, else none."""
    return joints if joints and partial.is_answered(locked=dict.fromkeys(joints)) else []


def _choose_joints_to_hold(motions: LoopMotions, unwanted: Array, partial: PartialRobot) -> list[str]:
    """Choose joints that, when locked, stop all of k independent `unwanted` motions (nv, k).

    Passive joints with springs come first, then those far from the base. Joints whose rates in the unwanted
    motions are independent stop one motion each. If there are fewer than k of them, all joints in no loop are
    chosen, provided that they have k freedoms. The result is empty if neither choice stops the motions.
    """
    tree, description = partial.tree, partial.description
    springs = [name for name, joint in description.joints.items() if joint.stiffness]
    names = dict.fromkeys([*springs, *reversed(tree.movable)])  # in order of preference, without repetitions
    passive = [name for name in names if name in tree.movable and name not in description.motor_joints]
    to_lock = motions.choose_independent(unwanted, passive)
    count = unwanted.shape[1]  # k
    if len(to_lock) == count:
        return to_lock
    serial = _serial_joints(partial)
    freedoms = [name for joint in serial for name in tree.joints[joint].coordinates]
    return serial if len(freedoms) == count else []


def _check_driven(motions: LoopMotions, partial: PartialRobot) -> None:
    """Refuse a mechanism with motions that no motor determines; propose joints to lock.

    Raises:
        _UndrivenMotions: joints can be held. Either these joints have springs, or a body that all motors move
            is at rest in the undriven motions and can be the platform.
        RobotFileError: no joints can be held for these reasons.
    """
    description = partial.description
    motors = description.motor_joints
    undriven = motions.working @ null_space(motions.rates(motors))  # (nv, k) motions with motors at rest
    if not undriven.shape[1]:
        return
    if not motors:
        raise RobotFileError("no joint of one freedom says where the mechanism is: a motor needs one")

    message = (
        f"{motions.freedoms} freedoms and {len(motors)} motor{'s' * (len(motors) != 1)} "
        f"({', '.join(motors)}): no motor drives {undriven.shape[1]} of them"
    )
    possible = motions.choose_independent(undriven, partial.tree.movable)  # joints that could have a motor
    if missing := undriven.shape[1] - len(possible):
        joints = partial.tree.joints.values()
        free = [joint.name for joint in joints if joint.moves and len(joint.coordinates) > 1]
        message += (
            f", and no hinge or slide tells {missing} of these; "
            f"they need hinges or slides in the place of {', '.join(free)}"
        )
    else:
        message += "; name more motors"
    to_hold = _choose_joints_to_hold(motions, undriven, partial)
    if not to_hold:
        raise RobotFileError(message)
    if all(name in description.joints and description.joints[name].stiffness for name in to_hold):
        why = "springs that no motor drives, taken as rigid; --motors chooses other motors"
        raise _UndrivenMotions(message, motions, to_hold, why)
    moved_frames = _moved_frames(motions, partial)
    if any(np.abs(twists @ undriven).max() < FILE_ROUNDING for _, _, twists in moved_frames):  # one rests
        why = (
            "no motor drives them, and a body that all motors move rests when they turn; --motors chooses "
            "other motors"
        )
        raise _UndrivenMotions(message, motions, to_hold, why)
    helpful = _select_helpful(partial, to_hold)
    advice = f", or hold joints (such as --lock {' '.join(helpful)})" if helpful else ""
    raise RobotFileError(f"{message}{advice}")


# ------------------------------------------------------------------ the platform


def _likely_platforms(motions: LoopMotions, partial: PartialRobot) -> list[Platform]:
    """Return platforms to try, most likely first, on frames that every motor moves."""
    max_tried = 12  # number of platforms that are tried
    scored: list[tuple[float, Platform]] = []
    for number, frame, joint_twists in _moved_frames(motions, partial):
        # frames named like a tool come first; the order in the file decides between equal scores
        is_named_like_tool = any(tool in frame.lower() for tool in NAMES_OF_TOOLS)
        frame_score = is_named_like_tool - 0.001 * number
        twists = joint_twists @ motions.working  # (6, w)
        platforms = _frame_platforms(twists, frame, motions.freedoms, partial)
        scored += [(axes_score + frame_score, platform) for axes_score, platform in platforms]
    scored.sort(key=lambda entry: -entry[0])
    return [platform for _, platform in scored[:max_tried]]


def _joint_platforms(motions: LoopMotions, partial: PartialRobot) -> Iterator[Platform]:
    """Yield platforms whose coordinates are joints: first joints without motors, then with motors."""
    tree, motors, count = partial.tree, partial.description.motor_joints, motions.freedoms
    without_motors = [name for name in tree.movable if name not in motors]
    for names in (without_motors, motors):
        if len(names) < count:
            continue
        rates = motions.rates(names)
        chosen = choose_rows(rates, count)
        if least_singular_values(rates[chosen]) > PROPOSED_AXES_CLEARANCE:
            joints = tuple(names[i] for i in chosen)
            yield Platform(frame=tree.joints[joints[-1]].child, joints=joints)


def _frame_platforms(
    twists: Array, frame: str, count: int, partial: PartialRobot
) -> Iterator[tuple[float, Platform]]:
    """Yield platforms of `count` coordinates on one `frame`, each with a score for ranking.

    If all joints that carry the frame are passive, their positions come first, with score 3. Then come axes
    of the frame. Their score is the least singular value of the frame's twists (6, w) along them, at most 1,
    plus up to 2 for the share of translations among them.
    """
    tree = partial.tree
    # the moving joints from the base to the frame
    names = tuple(joint.name for joint in reversed(tree.path_to_base(tree.link_of(frame))) if joint.moves)
    passive = set(tree.movable).difference(partial.description.motor_joints)
    if len(names) == count and passive.issuperset(names):
        yield 3.0, Platform(frame, joints=names)
    turns_about_a_point = _turns_about_a_point(twists)
    for axes in combinations(range(6), count):
        least = least_singular_values(twists[list(axes)])
        translations = sum(axis < 3 for axis in axes)
        if least <= FILE_ROUNDING or (turns_about_a_point and translations):
            continue
        score = min(least, 1.0) + 2.0 * translations / count
        axis_names = tuple(AXES[axis] for axis in axes)
        yield score, Platform(frame, axis_names)
        if count == 2 and not translations:  # the reverse order of two turns gives other coordinates
            yield score, Platform(frame, axis_names[::-1])


def _turns_about_a_point(twists: Array) -> bool:
    """Return whether all twists (6, w) of a body are turns about the same point."""
    linear, angular = twists[:3], twists[3:]
    # least squares for the point p that is at rest in all motions: v + w x p = 0 for all columns
    cross_matrices = np.concatenate([pin.skew(np.ascontiguousarray(w)) for w in angular.T])  # (3 w, 3)
    v = linear.T.ravel()
    p = np.linalg.lstsq(cross_matrices, -v, rcond=None)[0]
    rests = np.abs(cross_matrices @ p + v).max() < NEARLY_AT_REST
    has_several_axes = np.linalg.matrix_rank(angular, tol=PROPOSED_AXES_CLEARANCE) > 1
    return bool(rests and has_several_axes)


def _moved_frames(motions: LoopMotions, partial: PartialRobot) -> Iterator[tuple[int, str, Array]]:
    """Yield number, name and twists (6, nv) for unit joint rates of each frame that every motor moves.

    The twists are on base axes, at the frame's origin [rad, robot lengths].
    """
    mechanism, model = motions.mechanism, motions.mechanism.model
    data = model.createData()
    pin.computeJointJacobians(model, data, motions.q)
    pin.updateFramePlacements(model, data)
    axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    # (nv, n_a) joint rates at unit rates of the motors
    driven = motions.working @ np.linalg.pinv(motions.rates(partial.description.motor_joints))
    for number, frame in enumerate(partial.tree.frames):
        jacobian = pin.getFrameJacobian(model, data, frame_index(model, frame), axes).reshape(6, model.nv)
        twists = scaled_twists(mechanism, jacobian)
        speeds = np.linalg.norm(twists @ driven, axis=0)  # (n_a,) of the frame
        if np.all(speeds > FILE_ROUNDING):
            yield number, frame, twists


def _is_driven(description: RobotDescription, platform: Platform) -> bool:
    """Return whether the robot moves along all axes of a platform and in no other way."""
    try:
        robot = ParallelRobot.from_description(replace(description, platform=platform))
        mobility = count_freedoms(robot)
        driven = mobility.working - len(mobility.loose)  # loose motions passed `_check_driven`: nearly idle
        stuck = examine_platform_axes(robot, driven).stuck_here
    except FrameworkError:
        return False
    return robot.n == driven <= robot.n_a and not stuck


# ------------------------------------------------------------------ joints in no loop


def _loop_joint_names(partial: PartialRobot) -> set[str]:
    """Return the names of the joints in loops and couplings."""
    needed = set(coupled_joints(partial.description))
    for closure in partial.description.closures:
        needed.update(_loop_joints(partial.tree, closure))
    return needed


def _serial_joints(partial: PartialRobot) -> list[str]:
    """Return the names of moving joints in no loop."""
    needed = _loop_joint_names(partial)
    return [joint.name for joint in partial.tree.joints.values() if joint.moves and joint.name not in needed]


def _split_serial_joints(partial: PartialRobot, options: Options) -> tuple[list[str], list[str]]:
    """Split the joints in no loop into joints that carry no loop and joints that carry one.

    Joints that the options name or that carry the platform are left out.

    Returns:
        Names of the joints that carry no loop; names of the joints that carry one.
    """
    tree = partial.tree
    needed = {*(options.motors or ()), *(options.platform_joints or ())}
    frame = options.platform or (partial.platform.frame if partial.platform else None)
    if frame is not None:
        needed |= {joint.name for joint in tree.path_to_base(tree.link_of(frame))}

    carrying: set[str] = set()  # joints that carry a loop
    for name in _loop_joint_names(partial):
        carrying.update(joint.name for joint in tree.path_to_base(tree.joints[name].parent))
    serial = [name for name in _serial_joints(partial) if name not in needed]
    return [name for name in serial if name not in carrying], [name for name in serial if name in carrying]


def _hold_joints(partial: PartialRobot, joints: Sequence[str], why: str) -> PartialRobot:
    """Lock joints at the reference, edit the description accordingly, and remark `why`."""
    if not joints:
        return partial
    tree, description = partial.tree, partial.description
    for name in joints:
        tree.fix_at_reference(tree.joints[name], description.reference)
    tree.fix_coupled_joints()
    remaining = set(tree.coordinates)
    description = replace(
        description,
        couplings=tuple(tree.couplings),
        actuators=tuple(actuator for actuator in description.actuators if actuator.joint in remaining),
        joints={name: joint for name, joint in description.joints.items() if name in remaining},
        reference={name: value for name, value in description.reference.items() if name in remaining},
    )
    remark = f"held: {', '.join(joints)} ({why})"
    return partial._replace(description=description, remarks=(*partial.remarks, remark))
