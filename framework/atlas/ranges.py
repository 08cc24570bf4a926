"""A map within the limits of a robot: what is reached beyond a joint's range has that as its reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage

from framework.arrays import Array, BoolArray, IntArray
from framework.atlas.sweep import REASON_WORDS, PoseReason
from framework.atlas.workspace_map import WorkspaceMap
from framework.errors import LimitsExceeded
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import positions_beyond_limits, shares_beyond_limits

NOT_JOINED = "within all limits, not joined to the reference within them"
TOO_WEAK = "beyond the torque limits at rest"


def within_ranges(workspace: WorkspaceMap) -> WorkspaceMap:
    """Return the map with values only at poses that are joined to the reference within all joints' ranges.

    With the quantity `holding` also within the limits of the motors' torques at rest. A pose beyond several
    ranges counts for the joint that is farthest beyond its own, as a share of it. Codes of `reason` after
    those of `PoseReason` mean the reasons of `reason_words` in their order.

    Raises:
        LimitsExceeded: the reference itself is beyond a range.
    """
    robot = workspace.robot
    check_reference(robot)
    joints = [limit.joint for limit in robot.limits]
    shares = shares_beyond_limits(robot.limits, workspace.q)
    within = workspace.reached & (shares <= 0.0).all(axis=-1)
    beyond = workspace.reached & ~within
    weak = within & (workspace.values.get("holding", np.zeros(within.shape)) > 1.0)
    within &= ~weak
    joined = _joined(workspace, within)
    reason = workspace.reason.astype(np.uint16)
    reason[within & ~joined] = len(PoseReason)
    reason[weak] = len(PoseReason) + 1
    if beyond.any():
        reason[beyond] = len(PoseReason) + 2 + np.argmax(shares[beyond], axis=-1)
    words = (
        *REASON_WORDS.values(),
        NOT_JOINED,
        TOO_WEAK,
        *(f"beyond the range of {joint}" for joint in joints),
    )
    return replace(
        workspace,
        values={key: np.where(joined, values, np.nan) for key, values in workspace.values.items()},
        reason=reason,
        assembly=np.where(joined, workspace.assembly, 0).astype(np.int8),
        reason_words=words,
    )


def check_reference(robot: ParallelRobot) -> None:
    """Raise LimitsExceeded where the reference is beyond the range of a joint."""
    beyond = positions_beyond_limits(robot.limits, robot.reference.q[None])
    if beyond:
        listed = "; ".join(f"{joint}: {excess}" for joint, excess in beyond.items())
        raise LimitsExceeded(f"{robot.name}: the reference is beyond ranges: {listed}", exceeded=beyond)


def _joined(workspace: WorkspaceMap, within: BoolArray) -> BoolArray:
    """Return which poses neighbours join to the one nearest to the reference, of those within ranges."""
    if not within.any():
        return within
    labels: IntArray = ndimage.label(within)[0]
    away: Array = np.abs(workspace.window.points() - workspace.robot.reference.x).max(axis=2)
    return np.asarray(labels == labels.flat[np.argmin(np.where(within, away, np.inf))])
