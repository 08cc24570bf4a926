"""The geometric parameters of a robot: small displacements of its joints and of the frames of its loops.

Six of each joint that moves, and of each frame that a loop or the platform uses: of its placement on the body
before it (of a frame: on its own body), along and about its own axes. A parameter displaces all that comes
after it by one screw about the base's origin, as in pinocchio's kinematic regressors
(`computeFrameKinematicRegressor`), and F changes by the power of its wrenches on these displacements.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.arrays import Array, BoolArray
from framework.kinematics.frame_variations import tree_columns
from framework.kinematics.linearised_loops import LinearisedLoops
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.pinocchio_memory import scratch_of
from framework.kinematics.platform import JointPlatform
from framework.linalg.ordered_sums import cross

DISPLACEMENTS = ("x", "y", "z", "rx", "ry", "rz")


class GeometricParameters(NamedTuple):
    """The p geometric parameters of a robot at one configuration, as screws about the base's origin."""

    names: tuple[str, ...]  # (p,) JOINT.x [m] .. JOINT.rz [rad], FRAME.x .. FRAME.rz
    screws: Array  # (p, 6) what a unit of each does to all that it displaces
    frames: BoolArray  # (p, F) the frames that it displaces
    columns: BoolArray  # (p, nv) the joint axes that it displaces

    @property
    def displacements(self) -> Array:
        """Displacements of the frames (p, F, 6)."""
        return np.asarray(self.screws[:, None] * self.frames[..., None])


def geometric_parameters(robot: ParallelRobot, q: Array) -> GeometricParameters:
    """Return the parameters at a configuration q (nq,): of joints in pinocchio's order, then of frames."""
    model, data, tree = robot.model, scratch_of(robot).data, tree_columns(robot)
    pin.framesForwardKinematics(model, data, q)
    joints = range(1, model.njoints)
    places = [data.oMi[model.parents[j]] * model.jointPlacements[j] for j in joints]
    places += [data.oMf[frame] for frame in robot.frames]
    before = np.array([[j in model.supports[k] for k in range(model.njoints)] for j in joints])
    bodies = [model.frames[frame].parentJoint for frame in robot.frames]
    count = len(robot.frames)
    frames = np.concatenate([before[:, bodies], np.eye(count, dtype=bool)])
    columns = np.concatenate([before[:, tree.owner], np.zeros((count, model.nv), dtype=bool)])
    owners = [str(model.names[j]) for j in joints] + [str(model.frames[k].name) for k in robot.frames]
    return GeometricParameters(
        names=tuple(f"{owner}.{way}" for owner in owners for way in DISPLACEMENTS),
        screws=np.concatenate([place.toActionMatrix().T for place in places]),
        frames=np.repeat(frames, 6, axis=0),
        columns=np.repeat(columns, 6, axis=0),
    )


def equation_wrenches(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the wrenches (T, n + m, 6) of F about the base's origin, each on its second body."""
    frames, n = linearised.frames, robot.n
    wrench = np.zeros((len(frames.position), len(robot.equations.bodies), 6))
    wrench[:, :n] = robot.platform.wrenches(frames)
    wrench[:, n:] = linearised.loops.take(robot.structure.independent).wrench
    wrench[..., 3:] += cross(frames.position[:, robot.equations.bodies], wrench[..., :3])
    return wrench


def equation_slopes(robot: ParallelRobot, linearised: LinearisedLoops, displaced: Array) -> Array:
    """Compute the changes (n + m, p) of F at one configuration (T = 1) for displacements (p, F, 6) of frames.

    Of a platform of joints F does not see any: its coordinates are theirs.
    """
    loops, n = robot.loops, robot.n
    moved = np.zeros((len(displaced), n + len(loops.names), 6))
    if not isinstance(robot.platform, JointPlatform):
        moved[:, :n] = displaced[:, :1]
    moved[:, n:] = displaced[:, loops.second] - displaced[:, loops.first]
    return np.asarray(np.einsum("ei,pei->ep", equation_wrenches(robot, linearised)[0], moved))
