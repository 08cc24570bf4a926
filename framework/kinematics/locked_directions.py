"""The directions that closures keep alike, which tell a closed loop from one that is turned over.

A rotation is locked by keeping axes of the two frames perpendicular (see `LoopRows`). That is exact near the
right pose, but holds as well with a hinge's axis turned round, or two welded frames turned by 120 degrees
about (1, 1, 1) or by 180 degrees about an axis: the equations are closed there, but the joint would have to
be taken apart to get there. The vector between an axis on the one frame and the same on the other vanishes
in the right pose alone.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, IntArray
from framework.kinematics.frames import FrameStack, cross
from framework.model import ParallelRobot

TURNED = 1.0  # length of the vector between two unit axes; closed equations leave 0, or sqrt(2) and more


class LockedDirections(NamedTuple):
    """Axes of two frames that are to point the same way, d of them."""

    first: IntArray  # (d,) frame, as index into ParallelRobot.frames
    second: IntArray  # (d,)
    axis: IntArray  # (d,) 0..2, of both frames
    closures: tuple[str, ...]  # (d,) names

    def take(self, which: IntArray) -> LockedDirections:
        """Some of them."""
        names = tuple(self.closures[i] for i in which)
        return LockedDirections(self.first[which], self.second[which], self.axis[which], names)


@lru_cache(maxsize=128)
def locked_directions(robot: ParallelRobot) -> LockedDirections:
    """One direction for each closure that locks two rotations, two for each that locks all.

    Only rotations that the robot's rows do lock: some of them may have been taken out to be examined.

    Memoised: a pure function of a frozen robot.
    """
    place = dict(zip(robot.rows.names, zip(robot.rows.first, robot.rows.second, strict=True), strict=True))
    table, names = [], []
    for closure in robot.description.closures:
        turns = [axis for axis in closure.axes if f"{closure.name}.{axis}" in place and axis.startswith("r")]
        free = [k for k in range(3) if f"r{'xyz'[k]}" not in turns]
        for k in {3: (0, 1), 2: free}.get(len(turns), ()):
            table.append((*place[f"{closure.name}.{turns[0]}"], k))
            names.append(closure.name)
    first, second, axis = np.array(table, dtype=np.intp).reshape(-1, 3).T
    return LockedDirections(first, second, axis, tuple(names))


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


def turned_over(robot: ParallelRobot, at: FrameStack) -> str | None:
    """The name of a closure whose equations may hold, T = 1, but in a pose that is turned over."""
    directions = locked_directions(robot)
    lengths = np.linalg.norm(direction_gaps(directions, at)[0], axis=1)
    return directions.closures[int(np.argmax(lengths))] if np.any(lengths > TURNED) else None
