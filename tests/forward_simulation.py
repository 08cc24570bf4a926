"""Forward dynamics with all coordinates: an independent witness of planned torques.

Torques that come out of an inverse dynamics go in here, and the robot must come back along the
planned path. Nothing is shared with the inverse dynamics under test: no choice of independent
coordinates, no inversion of A, no condition at the crossing. At every instant one solves

    [ M  J' ] [   a    ]   [ S' tau - h ]        M (nv, nv) mass matrix, rotors included
    [ J  0  ] [ -force ] = [   -drift   ]        J (nc, nv) closure rows, J a + drift = 0

which is regular at a Type 2 singularity: there the passive columns of J lose rank, not J itself.
The constraints enter by their second derivative only (index 1); each output is the state of the
integration itself, neither stabilised nor projected, so that the drift is part of the testimony.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

FRAME_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


def closure_terms(
    model: pin.Model,
    data: pin.Data,
    q: np.ndarray,
    v: np.ndarray,
    closure_frames: Sequence[tuple[int, int]],
    closure_rows: Sequence[Sequence[int]],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Closures p_2 - p_1 = 0 [m] at q, v: value (nc,), Jacobian (nc, nv), drift (nc,) [m/s^2].

    drift is the part of the second derivative that is left when the joint accelerations are zero.
    """
    pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    value, jacobian, drift = [], [], []
    for ends, rows in zip(closure_frames, closure_rows, strict=True):
        keep = list(rows)
        place = [data.oMf[f].translation for f in ends]
        value.append((place[1] - place[0])[keep])
        slope = [pin.getFrameJacobian(model, data, f, FRAME_AXES)[:3] for f in ends]
        jacobian.append((slope[1] - slope[0])[keep])
        bias = [pin.getFrameClassicalAcceleration(model, data, f, FRAME_AXES) for f in ends]
        drift.append((bias[1].linear - bias[0].linear)[keep])
    return np.concatenate(value), np.vstack(jacobian), np.concatenate(drift)


def forward_simulate(
    model: pin.Model,
    *,
    closure_frames: Sequence[tuple[int, int]],
    closure_rows: Sequence[Sequence[int]],
    actuated: Sequence[int],
    armature: ArrayLike,
    torque: Callable[[float], np.ndarray],
    q0: ArrayLike,
    v0: ArrayLike,
    times: ArrayLike,
    rtol: float = 1e-13,
    atol: float = 1e-15,
) -> tuple[np.ndarray, np.ndarray]:
    """Integrate the closed-loop robot under joint-side torques.

    Args:
        model: the open tree, joint-space only (nq == nv, so that q' = v), `model.armature` zero.
        closure_frames: for each loop the two frame ids whose origins coincide.
        closure_rows: for each loop the world axes kept among (0, 1, 2), e.g. (0, 1) for a planar
            robot. Redundant rows make the system singular: the caller leaves them out.
        actuated: columns of v that carry a motor, (n_a,).
        armature: n^2 I_a of each column, (nv,) [kg m^2], zero where there is no motor.
        torque: t [s] -> generalised forces on the actuated columns (n_a,) [N m or N], joint side
            (motor torque times gear ratio).
        q0, v0: assembled configuration (nq,) and a velocity (nv,) that the closures allow.
        times: output instants (T,) [s], increasing; the first is the instant of q0, v0. Where the
            torque has a kink, a time should stand on it: each interval is integrated anew.
        rtol, atol: of DOP853, per step, on q [rad or m] and v alike.

    Returns:
        q (T, nq) and v (T, nv).
    """
    if model.nq != model.nv:
        raise ValueError(f"joint-space models only: nq = {model.nq}, nv = {model.nv}")
    if np.any(model.armature):
        raise ValueError("model.armature is not zero: crba would count the rotors twice")
    data, nv, columns = model.createData(), model.nv, list(actuated)
    rotors = np.diag(np.asarray(armature, float))
    upper = np.tri(nv, dtype=bool).T  # the half of the mass matrix that crba is sure to fill
    nc = sum(len(rows) for rows in closure_rows)

    def slope(t: float, state: np.ndarray) -> np.ndarray:
        q, v = state[:nv], state[nv:]
        _, jacobian, drift = closure_terms(model, data, q, v, closure_frames, closure_rows)
        mass = pin.crba(model, data, q)
        force = -pin.nonLinearEffects(model, data, q, v)
        force[columns] += torque(t)
        kkt = np.zeros((nv + nc, nv + nc))
        kkt[:nv, :nv] = np.where(upper, mass, mass.T) + rotors
        kkt[:nv, nv:] = jacobian.T
        kkt[nv:, :nv] = jacobian
        return np.concatenate([v, np.linalg.solve(kkt, np.concatenate([force, -drift]))[:nv]])

    times = np.asarray(times, float)
    states = [np.concatenate([np.asarray(q0, float), np.asarray(v0, float)])]
    for start, end in pairwise(times):
        # Ending a step on every output keeps the order 8: the dense output has only 7.
        solution = solve_ivp(
            slope, (start, end), states[-1], "DOP853", rtol=rtol, atol=atol, first_step=end - start
        )
        if not solution.success:
            raise ArithmeticError(f"integration stopped in [{start}, {end}] s: {solution.message}")
        states.append(solution.y[:, -1])
    trajectory = np.array(states)  # (T, nq + nv)
    return trajectory[:, :nv], trajectory[:, nv:]
