"""Positions, Jacobians and accelerations of a robot's frames for a stack of configurations.

The only place, with `dynamics.forces`, that loops over configurations in Python: pinocchio is called
there and nothing else; all that follows is stacked numpy. Twists are (linear, angular), at the frame's
origin, on the axes of the base frame (pinocchio's LOCAL_WORLD_ALIGNED).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.arrays import Array
from framework.model import ParallelRobot

_WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


class FrameStack(NamedTuple):
    """The robot's frames (F of them, `ParallelRobot.frames`) at T configurations."""

    position: Array  # (T, F, 3) [m]
    rotation: Array  # (T, F, 3, 3), columns are the frame's axes
    jacobian: Array  # (T, F, 6, nv)


def frames_at(robot: ParallelRobot, q: Array) -> FrameStack:
    """Pose and Jacobian of every frame at q (T, nq)."""
    model, frames = robot.model, robot.frames
    data = model.createData()
    placement = np.empty((len(q), len(frames), 4, 4))
    jacobian = np.empty((len(q), len(frames), 6, model.nv))
    for k in range(len(q)):
        pin.computeJointJacobians(model, data, q[k])
        pin.updateFramePlacements(model, data)
        placements = data.oMf
        for f, frame in enumerate(frames):
            placement[k, f] = placements[frame].homogeneous
            jacobian[k, f] = pin.getFrameJacobian(model, data, frame, _WORLD_AXES).reshape(
                6, -1
            )  # (6,) if nv = 1
    return FrameStack(placement[..., :3, 3], placement[..., :3, :3], jacobian)


def drift_accelerations(robot: ParallelRobot, q: Array, v: Array) -> Array:
    """Classical accelerations of the frames when all joint accelerations are zero, (T, F, 6)."""
    model, frames = robot.model, robot.frames
    data = model.createData()
    rest = np.zeros(model.nv)
    drift = np.empty((len(q), len(frames), 6))
    for k in range(len(q)):
        pin.forwardKinematics(model, data, q[k], v[k], rest)
        for f, frame in enumerate(frames):
            drift[k, f] = pin.getFrameClassicalAcceleration(model, data, frame, _WORLD_AXES).vector
    return drift


def move(robot: ParallelRobot, q: Array, step: Array) -> Array:
    """q (..., nq) moved by tangent vectors (..., nv): pinocchio's integrate, stacked."""
    model = robot.model
    if model.nq == model.nv:  # every joint a line: integrating is adding
        return q + step
    q = np.broadcast_to(q, (*step.shape[:-1], model.nq))
    flat = [
        pin.integrate(model, np.ascontiguousarray(a), np.ascontiguousarray(b))
        for a, b in zip(q.reshape(-1, model.nq), step.reshape(-1, model.nv), strict=True)
    ]
    return np.array(flat).reshape(*step.shape[:-1], model.nq)


def offset(robot: ParallelRobot, start: Array, q: Array) -> Array:
    """Tangent vectors (T, nv) from one configuration `start` (nq,) to q (T, nq)."""
    model = robot.model
    if model.nq == model.nv:
        return q - start
    return np.array([pin.difference(model, start, np.ascontiguousarray(row)) for row in q])
