"""The reference of a converted file: away from singularities, and the words that choose other modes."""

from __future__ import annotations

import shlex
from dataclasses import replace
from itertools import islice

import numpy as np

from framework.errors import FrameworkError
from framework.kinematics.assembly import NEARBY_DISTANCE
from framework.kinematics.diagnostics.regular_reference import regular_reference
from framework.kinematics.frames import difference
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.description import RobotDescription
from framework.model.urdf_elements import ParsedRobot
from framework.numerics.arrays import Array
from framework.proofs.assembly_modes import assembly_modes

MAX_MOTORS = 12  # each adds two directions to a search, and may double the number of modes


def choose_reference(parsed: ParsedRobot) -> tuple[RobotDescription, list[str]]:
    """Move a reference that the file does not state away from singularities; remark on other modes.

    A stated reference stays, and the remark has the one away from singularities. Other assembly modes are
    listed if the reference had to be moved to close the loops. If no robot can be assembled, the only remark
    says why.
    """
    description = parsed.description
    try:
        robot = ParallelRobot.from_description(description)
    except FrameworkError as error:
        return description, [f"NOT ASSEMBLED, so that nothing can be planned yet: {error.sentence}"]
    if parsed.stated is None:  # a robot file of ours
        return description, []
    count = len(description.actuators)
    if count > MAX_MOTORS:
        remark = f"reference: for {count} motors neither singularities near it nor other modes are looked for"
        return description, [remark]
    try:
        require_square(robot)
        near, regular = regular_reference(robot)
    except FrameworkError:  # `crossing check` explains it
        return description, []
    remarks = []
    if near.kind:
        place = f"{near.distance:.2g} rad or robot lengths from a {near.kind} singularity"
        q = robot.reference.q if regular is None else regular
        words = _reference_option(robot, q)
        if regular is not None and words and not parsed.stated:
            remarks.append(f"reference: moved on, as the nearest closed pose is {place}")
            robot = ParallelRobot.from_description(
                replace(description, reference=robot.reference_values(regular))
            )
        else:
            instead = f"; farther is {words}" if regular is not None and words else ""
            remarks.append(f"reference: {place}{instead}")
    q = robot.reference.q
    positions = robot.reference_values(q)
    moved = [abs(value - parsed.stated.get(name, 0.0)) for name, value in positions.items()]
    if not parsed.stated or max(moved) > NEARBY_DISTANCE:
        remarks += _other_modes(robot)
    return robot.description, remarks


def _other_modes(robot: ParallelRobot) -> list[str]:
    """Return a remark on the other poses of the reference's motors, with words that choose each."""
    motors = robot.actuated_coordinates(robot.reference.q[None])[0]
    try:
        found = assembly_modes(robot, motors).modes
    except FrameworkError:  # such as motors that do not determine the pose
        return []
    offsets = [difference(robot, robot.reference.q, mode.q) / robot.column_scale for mode in found]
    is_other = [np.abs(offset[robot.joints]).max() > NEARBY_DISTANCE for offset in offsets]
    others = [mode.q for mode, apart in zip(found, is_other, strict=True) if apart]
    place = f"mode: {robot.place(robot.reference.x)}; the same motor positions close the loops otherwise, too"
    max_listed, max_joints = 4, 8
    if len(robot.joints) > max_joints:
        values = " ".join(f"{value:.6g}" for value in motors)
        listing = f"crossing pose FILE --motors {values} --all lists with a reference each"
        return [f"{place}, in {len(others)} ways, which {listing}"] if others else []
    words = list(islice(filter(None, (_reference_option(robot, q) for q in others)), max_listed))
    more = f"; and {len(others) - len(words)} more" if len(others) > len(words) else ""
    return [f"{place}, with {'; or '.join(words)}{more}"] if words else []


def _reference_option(robot: ParallelRobot, q: Array) -> str:
    """Return the option `--reference` of a pose q (nq,); empty unless it leads to q.

    Joints have six digits.
    """
    values = robot.printed_reference(q)
    try:
        posed = ParallelRobot.from_description(replace(robot.description, reference=values))
    except FrameworkError:
        return ""
    if np.abs(difference(robot, q, posed.reference.q)).max() > NEARBY_DISTANCE:
        return ""
    return shlex.join(["--reference", *(f"{name}={value:g}" for name, value in values.items())])
