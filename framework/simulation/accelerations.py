"""Accelerations at instants: forward dynamics without a step of time.

    M a + c + g + K (q - rest) = S' n tau + f + J' lambda,        J a + drift = 0

with f the forces of the world, in all coordinates and therefore regular at Type 2. Of the motions that the
loops allow, Z has mass and Z_0 has none (`consistent.allowed_motions`, as at the start of every simulation):

    a = a_0 + Z alpha,    J a_0 = -drift,    Z' M Z alpha = Z' (S' n tau + f - c - g - K (q - rest) - M a_0).

Along Z_0 the springs must balance, or the robot cannot be in this state. The component of a along Z_0 depends
on the rates of the torques and is not determined; M a does not depend on that component.

Sums run in the order of their index (`ordered_sums`): a state of a stack comes out as it does alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput
from framework.kinematics.closures import closure_drift
from framework.kinematics.frames import frame_motions
from framework.numerics.arrays import Array, BoolArray
from framework.numerics.ordered_sums import matmul, matvec
from framework.simulation.consistent import allowed_motions, balancing_step
from framework.simulation.equations import EquationsOfMotion
from framework.simulation.schemes import State
from framework.tolerances import RANK_ROUNDING, SPRINGS_BALANCED


class Accelerations(NamedTuple):
    """Joint accelerations of T states under given torques."""

    a: Array  # (T, nv) least along motions without mass, which no force feels
    undetermined: BoolArray  # (T, nv) joints that such a motion moves: they depend on the torques' rates


def accelerations(
    equations: EquationsOfMotion, q: Array, v: Array, torque: Array, applied: Array
) -> Accelerations:
    """Compute the accelerations of assembled states under motor torques (T, n_a) [N m], motor side.

    Args:
        q, v: (T, nq), (T, nv), on which the loops and their rates are closed.
        applied: generalised forces (T, nv) of the world.

    Raises:
        InvalidInput: springs of parts without mass are out of balance there; or a motion has neither mass nor
            stiffness nor damping.
    """
    robot = equations.robot
    tangent = equations.tangent(q, v, np.zeros(v.shape))
    Z, light, closing = allowed_motions(equations, tangent)  # (T, nv, d), (T, d), (T, nv, m)
    force = equations.motor_forces(torque) + applied - tangent.force
    for k in np.flatnonzero(light.any(axis=1)).tolist():
        row = f", row {k}" if len(q) > 1 else ""
        _check_balance(equations, State(q[k : k + 1], v[k : k + 1]), Z[k], light[k], force[k], row)
    drift = closure_drift(equations.rows, frame_motions(robot, tangent.frames, v))
    a = -matvec(closing, drift)  # a_0, (T, nv)
    Z_rows = Z.swapaxes(1, 2)  # Z'
    unbalanced = np.where(light, 0.0, matvec(Z_rows, force - matvec(tangent.mass, a)))  # (T, d)
    # alpha is 0 along motions without mass: their rows and columns are those of the unit matrix
    is_light = light[:, None] | light[:, :, None]  # (T, d, d)
    inertia = np.where(is_light, np.eye(light.shape[1]), matmul(Z_rows, matmul(tangent.mass, Z)))
    a += matvec(Z, np.linalg.solve(inertia, unbalanced[..., None])[..., 0])
    motion = np.abs(Z * light[:, None] / robot.column_scale[:, None]).max(axis=2, initial=0.0)
    return Accelerations(a, motion > RANK_ROUNDING)


def _check_balance(
    equations: EquationsOfMotion, state: State, basis: Array, light: BoolArray, free: Array, row: str
) -> None:
    """Refuse a state (T = 1) whose springs of parts without mass do not balance the forces (nv,)."""
    robot, massless = equations.robot, basis[:, light]
    tangent = equations.tangent(*state, np.zeros((1, robot.nv)))
    step = massless @ balancing_step(equations, tangent, basis[:, ~light], massless, -free)
    distances = np.abs(step / robot.column_scale)
    worst = int(np.argmax(distances))
    if distances[worst] > SPRINGS_BALANCED:
        raise InvalidInput(
            f"q{row}: {robot.coordinates.name_of(worst)} of {robot.name}, {robot.flexibility}, has no mass "
            f"and is {distances[worst]:.3g} rad or robot lengths from where its springs balance these "
            f"torques: its acceleration would be infinite; `Stepper.start` gives the state next to this one"
        )
