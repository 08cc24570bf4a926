"""The robot's frames out of what one call of pinocchio leaves for the whole tree.

Asking pinocchio for every frame costs a call each; the tree's Jacobian on world axes and the placements of
the joints hold the same, and the rest is stacked numpy.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from framework.arrays import Array, IntArray
from framework.kinematics.frames import FrameStack, rotations
from framework.kinematics.parallel_robot import ParallelRobot
from framework.linalg.ordered_sums import matmul, matvec


class FrameGeometry(NamedTuple):
    """The placements of the robot's frames on its joints, and the columns of the joints."""

    joint: IntArray  # (F,) that carries the frame
    rotation: Array  # (F, 3, 3) of the frame in its joint
    translation: Array  # (F, 3)
    carried: Array  # (F, nv) 1 where the joint carries the frame, else 0
    before: NDArray[np.bool_]  # (nv, nv) column i belongs to the joint of column j or to one before it

    @staticmethod
    def of(robot: ParallelRobot) -> FrameGeometry:
        """Return the geometry of `robot.frames`."""
        model = robot.model
        frames = [model.frames[frame] for frame in robot.frames]
        owner = np.repeat(np.arange(1, model.njoints), [joint.nv for joint in model.joints[1:]])
        supports: Sequence[set[int]] = [set(model.supports[joint]) for joint in range(model.njoints)]
        return FrameGeometry(
            joint=np.array([int(frame.parentJoint) for frame in frames]),
            rotation=np.array([frame.placement.rotation for frame in frames]),
            translation=np.array([frame.placement.translation for frame in frames]),
            carried=np.array([[float(j in supports[frame.parentJoint]) for j in owner] for frame in frames]),
            before=np.array([[i in supports[j] for j in owner] for i in owner]),
        )

    def frames(self, q: Array, placed: Array, tree: Array) -> FrameStack:
        """Compute frames at q (T, nq) of joint placements (T, joints, 12) and the tree's world Jacobian."""
        placed = placed[:, self.joint]
        rotation = rotations(placed)
        position = placed[..., 9:] + matvec(rotation, self.translation)
        return FrameStack(position, matmul(rotation, self.rotation), tree.swapaxes(1, 2), self.carried, q)
