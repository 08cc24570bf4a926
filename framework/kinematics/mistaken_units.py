"""Remarks on points in millimetres and angles in degrees: no link reaches them, they are many turns."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from framework.errors import point
from framework.kinematics.mechanism import Mechanism, velocity_columns
from framework.numerics.arrays import Array


def remark_on_turns(mechanism: Mechanism, joints: Mapping[str, float]) -> str:
    """Return a remark on hinges beyond a full turn; empty without any.

    `joints`: their angles [rad] by name.
    """
    turns = []
    for column, (joint, angle) in zip(velocity_columns(mechanism.model, joints), joints.items(), strict=True):
        if not mechanism.sliding[column] and abs(angle) > 2.0 * np.pi:
            turns.append(f"{joint} at {angle:g} rad is {abs(angle) / (2.0 * np.pi):.3g} turns")
    return f"; angles are in rad: {', '.join(turns)}" if turns else ""


def longest_reach(robot: Mechanism) -> float:
    """Return the summed length [m] of the links from base to platform.

    Slides are at the end of their range, springs at rest; infinite if a joint moves without bound.
    """
    model = robot.model
    frame = model.frames[model.getFrameId(robot.description.platform.frame)]
    reach = float(np.linalg.norm(frame.placement.translation))
    for k in list(model.supports[frame.parentJoint])[1:]:
        joint = model.joints[k]
        reach += float(np.linalg.norm(model.jointPlacements[k].translation))
        if robot.sliding[joint.idx_v] and joint.idx_v not in robot.elastic:
            ends = model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]
            reach += float(np.abs(ends).max())
        elif joint.shortname().startswith(("JointModelFree", "JointModelPlanar", "JointModelTranslation")):
            return np.inf
    return reach


def remark_on_reach(robot: Mechanism, position: Array) -> str:
    """Return a remark on a platform that no link reaches; empty if one may.

    `position`: the prescribed coordinates of its frame's origin [m].
    """
    distance, reach = float(np.linalg.norm(position)), longest_reach(robot)
    if distance <= reach:
        return ""
    return (
        f"; points are in m: {point(position)} is {distance:.4g} m from the base, "
        f"{distance / robot.length:.3g} times the size of the robot, and its links in one line reach "
        f"{reach:.3g} m"
    )
