"""Accelerations at single instants: forward dynamics without time steps.

    M a + c + g + K (q - rest) + D v = S' n tau + f + J' lambda,        J a + drift = 0

with the external forces f. The equations contain all coordinates and are therefore regular at Type 2. The
motions that the loops allow are split into Z with mass and Z_0 without (`consistent.allowed_motions`, as at
the start of every simulation):

    a = a_0 + Z alpha,    J a_0 = -drift,
    Z' M Z alpha = Z' (S' n tau + f - c - g - K (q - rest) - D v - M a_0).

Along Z_0 the springs must be in balance; otherwise the robot cannot be in this state. The component of a
along Z_0 depends on the rates of the torques and stays undetermined. It does not affect M a.

Sums run in the order of their index (`ordered_sums`), so a state gives the same result alone and in a stack.
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
from framework.tolerances import RANK_ROUNDING, SPRINGS_BALANCED


class Accelerations(NamedTuple):
    """Joint accelerations of T states under given torques."""

    a: Array  # (T, nv) of least norm where motions without mass leave a undetermined
    undetermined: BoolArray  # (T, nv) joints that such a motion moves: their a depends on the torques' rates


def accelerations(
    equations: EquationsOfMotion, q: Array, v: Array, torque: Array, applied: Array
) -> Accelerations:
    """Compute joint accelerations (T, nv) under motor torques (T, n_a) [N m], motor side.

    Args:
        q, v: (T, nq), (T, nv) with closed loops, also in their rates.
        applied: generalised external forces (T, nv).

    Raises:
        InvalidInput: the springs of parts without mass are not in balance; or a motion has neither mass nor
            stiffness nor damping.
    """
    tangent = equations.tangent(q, v, np.zeros(v.shape))
    Z, light, closing = allowed_motions(equations, tangent)  # (T, nv, d), (T, d), (T, nv, m)
    force = equations.motor_forces(torque) + applied - tangent.force
    for k in np.flatnonzero(light.any(axis=1)).tolist():
        row = f", row {k}" if len(q) > 1 else ""
        _check_balance(equations, q[k], Z[k][:, light[k]], force[k], row)

    drift = closure_drift(equations.rows, frame_motions(equations.robot, tangent.frames, v))
    a = -matvec(closing, drift)  # a_0, (T, nv)

    # Solve Z' M Z alpha = Z' (force - M a_0). Motions without mass have alpha = 0: their rows and columns are
    # replaced by those of the unit matrix, and their right sides by 0
    Z_rows = Z.swapaxes(1, 2)  # Z'
    reduced_mass = matmul(Z_rows, matmul(tangent.mass, Z))  # Z' M Z, (T, d, d)
    inertia = np.where(light[:, None] | light[:, :, None], np.eye(light.shape[1]), reduced_mass)
    along_Z = matvec(Z_rows, force - matvec(tangent.mass, a))  # (T, d)
    alpha = np.linalg.solve(inertia, np.where(light, 0.0, along_Z)[..., None])[..., 0]
    a += matvec(Z, alpha)

    light_rates = np.abs(Z * light[:, None]).max(axis=2, initial=0.0)  # (T, nv)
    return Accelerations(a, undetermined=light_rates / equations.robot.column_scale > RANK_ROUNDING)


def _check_balance(equations: EquationsOfMotion, q: Array, light: Array, force: Array, row: str) -> None:
    """Refuse q (nq,) unless the forces (nv,) balance along massless motions `light` (nv, k).

    `row` names the row of q in the message; it is empty for a single state.
    """
    robot = equations.robot
    step = light @ balancing_step(equations, equations.tangent_at_rest(q), light, -force)
    distances = np.abs(step / robot.column_scale)
    worst = int(np.argmax(distances))
    if distances[worst] > SPRINGS_BALANCED:
        raise InvalidInput(
            f"q{row}: {robot.coordinates.name_of(worst)} of {robot.name}, {robot.flexibility}, has no mass "
            f"and is {distances[worst]:.3g} rad or robot lengths from where its springs balance these "
            f"torques: its acceleration would be infinite; `Stepper.start` gives the state next to this one"
        )
