"""Maps within the limits of a robot: poses beyond a limit have no values and that limit as their reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage

from framework.atlas.quantities import has_torque_limits
from framework.atlas.survey import Window, longest_cell_edge
from framework.atlas.sweep import REASON_WORDS, PoseReason
from framework.atlas.workspace_map import WorkspaceMap
from framework.errors import InvalidInput, LimitsExceeded, point
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import positions_beyond_limits, shares_beyond_limits
from framework.numerics.arrays import Array, BoolArray, IntArray
from framework.tolerances import SAME_PLACE

NOT_JOINED = "within all limits, not joined to the reference within them"
TOO_WEAK = "beyond the torque limits at rest"


def restrict_to_ranges(workspace: WorkspaceMap) -> WorkspaceMap:
    """Keep values at poses that steps within all limits join to the reference.

    Limits are the ranges of joints and, if motors have torque limits, these at rest, by the quantity
    `holding`. The reason of a pose beyond several ranges is the joint farthest beyond its range, as a share
    of the range. Codes of `reason` are indices into `reason_words`: first those of `PoseReason`, then not
    joined, too weak, and one for each joint.

    Raises:
        InvalidInput: motors have limits of torque and the map lacks `holding`; or see `check_window`.
        LimitsExceeded: the reference itself is beyond a range, or no pose beside it is within all limits.
    """
    robot = workspace.robot
    check_reference(robot)
    check_window(robot, workspace.window)
    if has_torque_limits(robot) and "holding" not in workspace.values:
        raise InvalidInput(
            f"quantities: {robot.name} has limits of torque, with which the quantity holding is compared; "
            f"add it"
        )
    shares = shares_beyond_limits(robot.limits, workspace.q)
    in_range = workspace.reached & (shares <= 0.0).all(axis=-1)
    beyond = workspace.reached & ~in_range
    too_weak = in_range & (workspace.values.get("holding", np.zeros(in_range.shape)) > 1.0)
    within = in_range & ~too_weak
    joined = _join_to_reference(workspace, within)
    reason = workspace.reason.astype(np.uint16)
    reason[within & ~joined] = len(PoseReason)
    reason[too_weak] = len(PoseReason) + 1
    if beyond.any():
        reason[beyond] = len(PoseReason) + 2 + np.argmax(shares[beyond], axis=-1)
    words = (
        *REASON_WORDS.values(),
        NOT_JOINED,
        TOO_WEAK,
        *(f"beyond the range of {limit.joint}" for limit in robot.limits),
    )
    return replace(
        workspace,
        values={key: np.where(joined, values, np.nan) for key, values in workspace.values.items()},
        reason=reason,
        assembly=np.where(joined, workspace.assembly, 0).astype(np.int8),
        reason_words=words,
    )


def check_reference(robot: ParallelRobot) -> None:
    """Refuse a robot whose reference is beyond the range of a joint."""
    beyond = positions_beyond_limits(robot.limits, robot.reference.q[None])
    if beyond:
        listed = "; ".join(f"{joint}: {excess}" for joint, excess in beyond.items())
        raise LimitsExceeded(f"{robot.name}: the reference is beyond ranges: {listed}", exceeded=beyond)


def check_window(robot: ParallelRobot, window: Window) -> None:
    """Refuse a window without a pose within one step of the reference."""
    if not _reference_distances(robot, window).min() <= 1.0:
        raise InvalidInput(
            f"window: it does not contain the reference {point(robot.reference.x)} of {robot.name}, to which "
            f"poses within limits have to be joined; take one that does, or leave the limits out"
        )


def _reference_distances(robot: ParallelRobot, window: Window) -> Array:
    """Compute distances (I, J) of poses from the reference, in longest cell edges."""
    offset = np.abs(window.points() - robot.reference.x) / robot.platform_scale
    return offset.max(axis=2) / (longest_cell_edge(robot, window) * (1.0 + SAME_PLACE))


def _join_to_reference(workspace: WorkspaceMap, within: BoolArray) -> BoolArray:
    """Mark poses (I, J) joined to the reference by neighbours within limits.

    Raises:
        LimitsExceeded: the nearest pose is more than one step away from the reference.
    """
    distance = np.where(within, _reference_distances(workspace.robot, workspace.window), np.inf)
    nearest = np.argmin(distance)
    if not distance.flat[nearest] <= 1.0:
        raise LimitsExceeded(
            f"{workspace.robot.name}: no pose of the map within one step of the reference is within all "
            f"limits; take a finer map, or leave the limits out",
            exceeded={},
        )
    labels: IntArray = ndimage.label(within)[0]
    return labels == labels.flat[nearest]
