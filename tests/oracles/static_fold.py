"""The fold of a robot's deflections at rest, in all coordinates and by differences: a witness for any robot.

Unknown are the joints q and the logarithm of the compliance eps. Closed loops, the platform in its place, and
the equilibrium of what neither motors nor loops hold,

    closures(q) = 0,     platform(q) = x,     P (g(q) - springs(q) / eps) = 0,     P = 1 - C' (C C')^+ C,

with C the rows of the loops and of the motors, are followed by arclength until eps turns back.
"""

import numpy as np
import pinocchio as pin

from framework import ParallelRobot
from tests.oracles.closure_rows import closure_errors, closure_rows, frame_of
from tests.oracles.equations_of_motion import apart
from tests.oracles.forward_simulation import kinematics, springs

STEP = 1e-6  # of differences


def residual(robot: ParallelRobot, x: np.ndarray, unknowns: np.ndarray) -> np.ndarray:
    """What the equations leave at (q, log eps)."""
    model, q, compliance = robot.model, unknowns[:-1], np.exp(unknowns[-1])
    data = model.createData()
    kinematics(model, data, q, np.zeros(model.nv))
    closures = robot.description.closures
    motors = np.eye(model.nv)[robot.actuated]
    held = np.concatenate([closure_rows(model, data, closures)[0], motors])
    load = pin.computeGeneralizedGravity(model, model.createData(), q) - springs(robot, q) / compliance
    free = load - np.linalg.pinv(held) @ (held @ load)
    pose = data.oMf[frame_of(model, robot.description.platform.frame)]
    return np.concatenate([closure_errors(model, data, closures), apart(robot, q, pose, x), free])


def slopes(robot: ParallelRobot, x: np.ndarray, unknowns: np.ndarray) -> np.ndarray:
    """Central differences of the residual."""
    columns = [
        (residual(robot, x, unknowns + step) - residual(robot, x, unknowns - step)) / (2.0 * STEP)
        for step in STEP * np.eye(len(unknowns))
    ]
    return np.array(columns).T


def fold(robot: ParallelRobot, x: np.ndarray, q: np.ndarray, step: float = 0.05) -> float:
    """The largest compliance on the curve that begins with stiff springs at q (nq,)."""
    at, along = np.append(q, np.log(1e-3)), np.eye(len(q) + 1)[-1]
    highest = -np.inf
    at = corrected(robot, x, at)
    for _ in range(2000):
        tangent = np.linalg.svd(slopes(robot, x, at))[2][-1]
        along = tangent * np.sign(tangent @ along)
        if at[-1] < highest - 0.05:
            return float(np.exp(highest))
        highest = max(highest, at[-1])
        at = corrected(robot, x, at + step * along)
    raise AssertionError("the curve does not turn back")


def corrected(robot: ParallelRobot, x: np.ndarray, unknowns: np.ndarray) -> np.ndarray:
    """The point of the curve nearest to the unknowns."""
    for _ in range(20):
        left = residual(robot, x, unknowns)
        if np.abs(left).max() < 1e-9:
            return unknowns
        unknowns = unknowns - np.linalg.lstsq(slopes(robot, x, unknowns), left, rcond=1e-9)[0]
    raise AssertionError("no point of the curve near")
