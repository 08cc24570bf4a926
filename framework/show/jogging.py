"""The answers to the page on which a robot is moved by hand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from framework.dynamics.action_lines import action_lines
from framework.dynamics.platform_wrench import hold_at
from framework.errors import InvalidInput, NotAssembled
from framework.kinematics.continuation.forward_kinematics import motors_are_free
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import joint_poses, platform_frame_twists, platform_positions
from framework.numerics.arrays import Array
from framework.numerics.output import Document, plain, select_fields
from framework.show.captions import describe_catalogue_entry, wrench_kind, wrench_unit
from framework.show.scene import encode_floats, encode_locus, force_edges, page_robot_document, why_no_figure
from framework.show.sight import robot_sight
from framework.singularity.drawn_locus import locus_curves
from framework.singularity.jogging import (
    CLASSES,
    JoggedPose,
    LooseMotion,
    describe_jogged_pose,
    drag_platform,
    loose_motion,
    move_motor,
    move_platform,
)

HELD_WRENCH = 10.0  # [N, or N m on a platform that only turns] along t_s, that the motors are to hold


def hand_document(robot: ParallelRobot) -> Document:
    """Return the page's document of a robot at its reference, with sliders."""
    reference = robot.reference
    poses = joint_poses(robot, reference.q[None])
    platform = platform_positions(robot, poses)
    document: Document = plain(
        page_robot_document(robot, poses, robot_sight(robot))
        | {
            "kind": "hand",
            "about": describe_catalogue_entry(robot),
            "push": f"{HELD_WRENCH:g} {wrench_unit(robot)} {wrench_kind(robot).split()[1]} t_s",
            "flat": robot.n == 2,
            "lines": _has_lines(robot),
            "no_figure": (why_no_figure(robot) or "") if len(robot.passive) else "",
            "drag": len(robot.platform.sliding) > 0,
            "poses": encode_floats(poses),
            "locus": encode_locus(robot, locus_curves(robot, reference.q, reference.x), platform, beside=1.2),
            "free_motors": motors_are_free(robot),
            "sliders": _sliders(robot, describe_jogged_pose(robot, reference.q)),
            "start": _pose_document(robot, describe_jogged_pose(robot, reference.q)),
        }
    )
    return document


def move_by_hand(robot: ParallelRobot, movement: Document) -> Document:
    """Answer one movement of a slider or of the dragged platform.

    It is {q, part, index, value} or {q, part, place}, with `part` platform, motor or drag, and the `place`
    [m] of the platform's origin in the base.

    Raises:
        InvalidInput: a movement that cannot be right.
    """
    try:
        q, part = np.array(movement["q"], dtype=float), movement["part"]
        if part == "drag":
            place = np.array(movement["place"], dtype=float)
        else:
            index, value = int(movement["index"]), float(movement["value"])
    except (KeyError, TypeError, OverflowError, ValueError):
        raise InvalidInput("a movement needs q, part, and index and value or place") from None
    if part == "drag":
        return _pose_document(robot, drag_platform(robot, q, place))
    if part not in ("platform", "motor"):
        raise InvalidInput(f"part: needs platform, motor or drag, got {part!r}")
    pose = (move_platform if part == "platform" else move_motor)(robot, q, index, value)
    return _pose_document(robot, pose)


def _describe_pose(pose: JoggedPose) -> str:
    """Describe a pose in one or two sentences, the first one short."""
    preposition = {"near": "Near", "singular": "On"}.get(pose.level)
    if preposition is None:
        return "The motors hold the platform. Lead it to where g is 0: the purple curve, where one is drawn."
    if pose.kind == "type_1":
        state = "nearly stretched or folded" if pose.level == "near" else "stretched or folded"
        end = f"It is {preposition.lower()} its end, a Type 1 singularity, and follows no further."
        return f"A leg is {state}. {end}"
    if pose.kind == "type_2":
        sentence = (
            "The arrow is the motion of the platform that the motors hold least."
            if pose.level == "near"
            else "Motors that are locked do not resist a small motion along the arrow."
        )
        return f"{preposition} a Type 2 singularity. {sentence}"
    name, meaning = CLASSES[pose.kind]
    adverb = "There" if pose.level == "near" else "Here"
    return f"{preposition} a {name}. {adverb} {meaning}."


def _has_lines(robot: ParallelRobot) -> bool:
    """Return whether each motor's force has a line."""
    try:
        hold = hold_at(robot, robot.reference.q, np.zeros(robot.n))
    except NotAssembled:
        return False
    return action_lines(robot, hold.motor_speed[None]) is not None


def _describe_hold(robot: ParallelRobot, pose: JoggedPose) -> Document:
    """Return the motor torques that withstand a push along t_s, the uncontrolled motion.

    With the forces that motors can give, and their lines of action. A platform that both shifts and turns
    has no push of one unit: it gets no torques.
    """
    try:
        hold = hold_at(robot, pose.q, HELD_WRENCH * pose.twist)
    except NotAssembled:  # a Type 1 singularity: the platform does not determine the motors
        return {"torques": None, "sides": None, "lines": None}
    one_unit = len(set(robot.platform.translations)) == 1
    pushed = pose.g is not None and pose.level != "singular" and one_unit
    speeds = hold.motor_speed[None]
    sides = force_edges(robot, speeds, np.ones(robot.n_a)) if pose.g is not None else None
    lines = action_lines(robot, speeds) if pose.kind == "type_2" else None
    return {
        "torques": np.abs(hold.torque) if pushed and hold.torque is not None else None,
        "sides": None if sides is None else sides[0],
        "lines": None if lines is None else np.stack([lines.point[0], lines.direction[0]], axis=1),
    }


def _wobble_document(robot: ParallelRobot, pose: JoggedPose) -> Document | None:
    """Return the platform's motion along t_s on the locus, loops closed.

    With the small motions of the motors.
    """
    if pose.kind != "type_2" or pose.level != "singular":
        return None
    loose = loose_motion(robot, pose)
    if loose is None:
        return None
    poses = joint_poses(robot, loose.q)
    places = platform_positions(robot, poses)
    return {
        "poses": encode_floats(poses),
        "places": encode_floats(places),
        "count": len(places),
        "words": _describe_wobble(robot, loose),
    }


def _describe_wobble(robot: ParallelRobot, loose: LooseMotion) -> str:
    """Describe how far the platform moves while the motors all but rest."""
    slides = robot.sliding[robot.actuated]
    sizes = [f"{1e3 * loose.shift:.3g} mm"] * (loose.shift > 0) + [f"{loose.turn:.2g} rad"] * (loose.turn > 0)
    motors = [
        f"{scale * loose.motors[kind].max():.2g} {unit}"
        for kind, scale, unit in ((slides, 1e3, "mm"), (~slides, 1.0, "rad"))
        if kind.any()
    ]
    return (
        f"It wobbles: {' with '.join(sizes)} of the platform to either side take no more than "
        f"{' or '.join(motors)} of a motor."
    )


def _pose_document(robot: ParallelRobot, pose: JoggedPose) -> Document:
    """Return a pose for the page: bodies, platform, motors, measures and words."""
    poses = joint_poses(robot, pose.q[None])
    twist = platform_frame_twists(robot, pose.q[None], pose.twist[None])[0]
    document: Document = plain(
        _describe_hold(robot, pose)
        | {
            "q": pose.q,
            "poses": encode_floats(poses),
            "origin": platform_positions(robot, poses)[0],
            "platform": pose.x,
            "motor": pose.motors,
            **select_fields(pose, "g", "smallest", "level", "kind", "verdict", "stopped"),
            "words": _describe_pose(pose),
            "t_s": [twist[:3], twist[3:]],
            "wobble": _wobble_document(robot, pose),
        }
    )
    return document


def _sliders(robot: ParallelRobot, start: JoggedPose) -> dict[str, list[Document]]:
    """Return names, units and ranges of the sliders."""

    def sliders(names: Sequence[str], units: list[str], values: Array, turn: float) -> list[Document]:
        """Return sliders about values (n,): 0.8 robot lengths [m] or `turn` [rad] to both sides."""
        reach = np.where(np.array(units) == "m", 0.8 * robot.length, turn)
        rows = zip(names, units, values - reach, values + reach, strict=True)
        return [dict(zip(("name", "unit", "low", "high"), row, strict=True)) for row in rows]

    turns_freely = np.sum(~robot.translations) > 1  # a rotation vector ends at half a turn
    return {
        "platform": sliders(robot.axis_names, robot.axis_units, start.x, 1.5 if turns_freely else np.pi),
        "motor": sliders(robot.actuator_names, robot.motor_joint_units, start.motors, np.pi),
    }
