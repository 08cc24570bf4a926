"""The directions that closures keep alike, which tell a closed loop from one that is turned over.

A rotation is locked by keeping axes of the two frames perpendicular (see `LoopRows`). That is exact near the
right pose, but holds as well with a hinge's axis turned round, or two welded frames turned by 120 degrees
about (1, 1, 1) or by 180 degrees about an axis: the equations are closed there, but the joint would have to
be taken apart to get there. The vector between an axis on the one frame and the same on the other vanishes
in the right pose alone.
"""

from __future__ import annotations

import numpy as np

from framework.arrays import Array, IntArray
from framework.kinematics.frames import FrameStack, cross
from framework.kinematics.mechanism import Mechanism
from framework.model.loop_rows import LockedDirections

TURNED = 1.0  # length of the vector between two unit axes; closed equations leave 0, or sqrt(2) and more


def direction_gaps(directions: LockedDirections, at: FrameStack) -> Array:
    """The vectors (T, d, 3) from each axis on the first frame to the same on the second."""
    axes = at.rotation.swapaxes(2, 3)
    return np.asarray(
        axes[:, directions.second, directions.axis] - axes[:, directions.first, directions.axis]
    )


def direction_slopes(directions: LockedDirections, at: FrameStack) -> Array:
    """Their derivatives (T, d, 3, nv): an axis e of a frame that turns with w changes by w x e."""
    axes, turns = at.rotation.swapaxes(2, 3), at.jacobian[:, :, 3:].swapaxes(2, 3)  # (T, F, nv, 3)

    def change(frames: IntArray) -> Array:
        e = axes[:, frames, directions.axis][:, :, None]  # (T, d, 1, 3)
        return cross(turns[:, frames], np.broadcast_to(e, turns[:, frames].shape)).swapaxes(2, 3)

    return np.asarray(change(directions.second) - change(directions.first))


def turned_over(mechanism: Mechanism, at: FrameStack) -> str | None:
    """The name of a closure whose equations may hold, T = 1, but in a pose that is turned over."""
    directions = mechanism.directions
    lengths = np.linalg.norm(direction_gaps(directions, at)[0], axis=1)
    return directions.closures[int(np.argmax(lengths))] if np.any(lengths > TURNED) else None
