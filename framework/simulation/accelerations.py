"""Accelerations at one instant: forward dynamics without a step of time.

    M a + c + g + K (q - rest) = S' n tau + f + J' lambda,        J a + drift = 0

with f the forces of the world, in all coordinates and therefore regular at Type 2. Of the motions that the
loops allow, Z has mass and Z_0 has none (`consistent.free_motions`, as at the start of every simulation):

    a = a_0 + Z alpha,    J a_0 = -drift,    Z' M Z alpha = Z' (S' n tau + f - c - g - K (q - rest) - M a_0).

Along Z_0 the springs must balance, or the state is none that the robot can be in; how they go on balancing is
told by the rates of the torques alone: a has no component known along Z_0, and M a does not feel it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray
from framework.errors import InvalidInput
from framework.kinematics.closures import closure_drift
from framework.kinematics.frames import frame_motions
from framework.simulation.consistent import balancing_step, free_motions
from framework.simulation.equations import EquationsOfMotion

BALANCED = 1e-8  # [rad, robot lengths] of springs from their balance, of which no state is better known
MOVED = 1e-9  # share of a unit motion without mass that a joint has: less is rounding


class Accelerations(NamedTuple):
    """Joint accelerations of an instant under given torques."""

    a: Array  # (nv,) least along motions without mass, which no force feels
    undetermined: BoolArray  # (nv,) what such a motion moves: the torques of one instant do not tell


def accelerations(
    equations: EquationsOfMotion, q: Array, v: Array, torque: Array, applied: Array
) -> Accelerations:
    """What motor torques (n_a,) [N m], motor side, and the world do to an assembled state.

    Args:
        q, v: (nq,), (nv,), on which the loops and their rates are closed.
        applied: generalised forces (nv,) of the world.

    Raises:
        InvalidInput: springs of parts without mass are out of balance there; or a motion has neither mass nor
            stiffness nor damping.
    """
    robot = equations.robot
    at = equations.tangent(q[None], v[None], np.zeros((1, robot.model.nv)))
    massive, light = free_motions(equations, at)
    drift = closure_drift(equations.rows, at.frames, frame_motions(robot, at.frames, q[None], v[None]))[0]
    scale = robot.column_scale
    a = -scale * np.linalg.lstsq(at.jacobian[0] * scale, drift, rcond=None)[0]
    free = equations.applied(torque[None])[0] + applied - at.force[0]
    if light.shape[1]:
        _check_balance(equations, light @ balancing_step(equations, at, massive, light, -free))
    inertia = massive.T @ at.mass[0] @ massive
    a += massive @ np.linalg.solve(inertia, massive.T @ (free - at.mass[0] @ a))
    return Accelerations(a, np.abs(light / scale[:, None]).max(axis=1, initial=0.0) > MOVED)


def _check_balance(equations: EquationsOfMotion, step: Array) -> None:
    robot = equations.robot
    off = np.abs(step / robot.column_scale)
    worst = int(np.argmax(off))
    if off[worst] > BALANCED:
        raise InvalidInput(
            f"q: {robot.joint_of(worst)} of {robot.name}, {robot.flexibility}, has no mass and is "
            f"{off[worst]:.3g} rad or robot lengths from where its springs balance these torques: its "
            f"acceleration would be infinite; `Stepper.start` gives the state next to this one"
        )
